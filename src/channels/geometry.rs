//! What the words of a name say of geometry: a normal, a position, a texture coordinate, motion, a depth.
//!
//! A light is called after its place or kind as well (`point_light`, `lgt_position_key`), and colours, vectors and statistics share the
//! components. So three things are looked at, in this order:
//!
//! 1. A word of statistics (`normal_var`) leaves no geometry.
//! 2. With a vector's component (`X`, `U`, ...) any word of geometry decides.
//! 3. With any other a clear word (`position`) decides, unless a word of light stands beside it; a short one (`P`, `point`) only
//!    where nothing else is said.

use super::names::{Name, words};

/// Words for one kind of geometry.
pub(super) struct Vocabulary {
    /// These need no company. They may be written as two words (`motion_vector`).
    clear: &'static [&'static str],
    /// These mean other things, too.
    short: &'static [&'static str],
}

pub(super) const NORMALS: Vocabulary = Vocabulary {
    clear: &["normal", "normals", "nworld", "nref", "wnref"],
    short: &["n", "ng", "ns", "nn", "nf", "ngn"],
};

const POSITIONS: Vocabulary = Vocabulary {
    clear: &["position", "positions", "pworld", "pref", "wpref", "wpos", "worldpos"],
    short: &["p", "po", "pos", "point", "points"],
};

const TEXTURE_COORDINATES: Vocabulary = Vocabulary {
    clear: &["texcoord", "texcoords", "texturecoordinate", "texturecoordinates"],
    short: &["uv", "uvs", "st"],
};

/// Motion and stereo disparity.
const MOTION: Vocabulary = Vocabulary {
    clear: &["motionvector", "motionvectors", "motionvec", "mvec", "velocity", "disparity"],
    short: &["motion", "mv", "vector", "vectors"],
};

/// Motion with a vector's component only: `forward.u`, but not `forward.R`.
const DIRECTED: &[&str] = &["forward", "backward", "flow", "motionfw", "motionbw"];

pub(super) const DEPTHS: Vocabulary =
    Vocabulary { clear: &["depth", "distance", "zdepth", "zback", "zbuffer", "zfiltered"], short: &["dd"] };

/// Words of light and of what is made with it; those that end in `light` are such words, too.
const LIGHT: &[&str] = &[
    "lights",
    "lighting",
    "lgt",
    "lit",
    "combined",
    "beauty",
    "rgb",
    "rgba",
    "radiance",
    "irradiance",
    "bounce",
    "glow",
    "fog",
    "haze",
    "diffuse",
    "specular",
    "reflection",
    "refraction",
    "emission",
    "direct",
    "indirect",
    // depth of field
    "field",
];

/// Words that say in which space, of which frame or by which renderer geometry is, and so leave it what it is.
const COMPANY: &[&str] = &[
    "world",
    "cam",
    "camera",
    "object",
    "local",
    "eye",
    "view",
    "screen",
    "space",
    "ref",
    "rest",
    "raw",
    "noisy",
    "smooth",
    "geo",
    "geometric",
    "geometry",
    "shading",
    "hit",
    "first",
    "back",
    "fore",
    "fw",
    "bw",
    "forward",
    "backward",
    "next",
    "previous",
    "left",
    "right",
    "pass",
    "map",
    "coordinate",
    "coordinates",
    "aov",
    "v",
    "ray",
];

/// Words of statistics.
const STATISTICS: &[&str] = &["var", "variance", "mse", "stddev"];

/// Components that no colour has.
const AXES: &[&str] = &["x", "y", "z", "w", "u", "v", "s", "t"];

fn has(words: &[String], list: &[&str]) -> bool {
    words.iter().any(|word| list.contains(&word.as_str()))
}

/// The words of the part of a name that tells most: the nearest to the component that is more than company such as a view.
fn nearest(full: &str) -> Vec<String> {
    let Name { layer, component } = Name::new(full);
    let mere = is_axis(full) || component.len() < 2 || ["red", "green", "blue"].contains(&component);
    let parts = if mere && !layer.is_empty() { layer } else { full };
    let telling = |words: &Vec<String>| words.iter().any(|word| !COMPANY.contains(&word.as_str()));
    parts.rsplit('.').map(words).find(telling).unwrap_or_default()
}

impl Vocabulary {
    /// Whether a name means this.
    pub(super) fn are_meant(&self, full: &str) -> bool {
        let all = words(full);
        if has(&all, STATISTICS) {
            return false;
        }
        let clear = self.is_clear(&all);
        if is_axis(full) {
            return clear || has(&words(Name::new(full).layer), self.short);
        }
        let own = nearest(full);
        let fits = |word: &String| has(&own, self.short) && self.knows(word);
        let lit = |word: &String| LIGHT.contains(&word.as_str()) || word.ends_with("light");
        (clear && !own.iter().any(lit)) || (!own.is_empty() && own.iter().all(fits))
    }

    fn is_clear(&self, words: &[String]) -> bool {
        has(words, self.clear) || words.windows(2).any(|pair| self.clear.contains(&pair.concat().as_str()))
    }

    fn knows(&self, word: &str) -> bool {
        [self.clear, self.short, COMPANY].iter().any(|list| list.contains(&word))
    }
}

fn is_axis(full: &str) -> bool {
    AXES.contains(&Name::new(full).component.to_ascii_lowercase().as_str())
}

/// Whether a channel is of the error of others: `normal_var.x`, `Variance.R`.
pub(super) fn is_statistic(full: &str) -> bool {
    has(&words(full), STATISTICS)
}

/// Whether a channel is a coordinate in space: `P.X`, `Px`, `position.*`.
pub fn is_position(full: &str) -> bool {
    let layered = !Name::new(full).layer.is_empty();
    ["Px", "Py", "Pz"].contains(&full) || (layered && POSITIONS.are_meant(full))
}

/// Whether a channel is a texture coordinate, by its layer: `uv.u`, `ViewLayer.UV.X`, `st.R`, `texcoord.V`.
fn is_texture_coordinate(full: &str) -> bool {
    !Name::new(full).layer.is_empty() && TEXTURE_COORDINATES.are_meant(full)
}

/// Whether a channel is motion or disparity, by its name: `Vector.X`, `motion.u`, `forward.u`, `disparityL.x`.
pub(super) fn is_motion(full: &str) -> bool {
    MOTION.are_meant(full) || (is_axis(full) && has(&words(full), DIRECTED))
}

/// Whether a name can mean nothing but motion.
pub(super) fn is_clear_motion(full: &str) -> bool {
    MOTION.is_clear(&words(full))
}

/// Whether a channel that is filled is one of a vector of space, of a texture or of motion, whose unit is not that of light.
pub fn is_coordinate(full: &str) -> bool {
    is_position(full) || is_texture_coordinate(full) || is_motion(full)
}

/// Words that, joined, make a layer one of surface colours without light.
const ALBEDO: &[&str] = &[
    "albedo",
    "basecolor",
    "basecolour",
    "diffcol",
    "diffusecolor",
    "glosscol",
    "glossycolor",
    "diffusefilter",
];

/// Whether a channel is the colour of a surface, light left out: `albedo.R`, `DiffCol.G`, `Diffuse Color.B`.
pub fn is_albedo(full: &str) -> bool {
    let layer = words(Name::new(full).layer).concat();
    !is_statistic(full) && ALBEDO.iter().any(|word| layer.contains(word))
}
