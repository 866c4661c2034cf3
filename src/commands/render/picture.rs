//! A rendered picture as an EXR frame: channels, and attributes that say how it was made.

use half::f16;
use lacuna_exr::{Attributes, Channel, Compression, Frame, Part, SampleType, Samples, Window};
use lacuna_filters::{Mask, Size};
use lacuna_volume::{Camera, Picture, Projection};

use crate::reconstruct::{RENDER, SCENE, to_half, to_halves};
use crate::{channels, mask};

/// The name of the mask's channel.
const MASK: &str = "mask";
/// Those of the colour's channels.
const COLOURS: [&str; 4] = ["R", "G", "B", "A"];
/// Albedo, alpha and normals of the coarse march.
const DENSE: [&str; 7] =
    ["dense.albedo.R", "dense.albedo.G", "dense.albedo.B", "dense.A", "dense.N.X", "dense.N.Y", "dense.N.Z"];
/// Its depth.
const DENSE_DEPTH: &str = "dense.Z";

/// What the frame holds besides colour, alpha and mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
// Each is a flag of its own.
#[allow(clippy::struct_excessive_bools)]
pub struct Wanted {
    /// Depth `Z`, always 32 bits.
    pub depth: bool,
    /// Normals `N.X`, `N.Y`, `N.Z`.
    pub normals: bool,
    /// Samples a pixel, `samples`.
    pub samples: bool,
    /// The colour's derivatives, layers `dx` and `dy`.
    pub gradients: bool,
    /// Albedo, alpha, normal and depth of every pixel by a coarse march, layer `dense`.
    pub dense: bool,
    /// Motion of every pixel to the next frame, layer `motion`.
    pub motion: bool,
    /// The type of colours, normals and derivatives.
    pub kind: SampleType,
    /// How chunks are compressed.
    pub compression: Compression,
}

/// What the attributes of a frame say.
#[derive(Clone, Copy, Debug)]
pub struct Story<'a> {
    /// The scene on one line.
    pub scene: &'a str,
    /// Everything that the pixels depend on, on one line.
    pub render: &'a str,
    /// The camera.
    pub camera: &'a Camera,
    /// Of all patterns.
    pub seed: u64,
    /// Samples a pixel.
    pub samples: u32,
    /// How pixels were chosen, if not all were rendered.
    pub pattern: Option<&'a str>,
}

/// The frame of a picture, and how many values became the largest half; a mask channel says which pixels were rendered, if one is given.
pub fn frame(
    picture: Picture,
    size: Size,
    mask: Option<&Mask>,
    wanted: Wanted,
    story: &Story<'_>,
) -> (Frame, usize) {
    let mut channels: Vec<Channel> = Vec::new();
    let mut add = |name: String, samples: Samples| {
        channels.push(channel(&name, samples));
    };
    let mut clamped = 0;
    let mut values = |plane| values(plane, wanted.kind, &mut clamped);
    for (name, plane) in COLOURS.into_iter().zip(picture.colour) {
        add(name.into(), values(plane));
    }
    for (layer, planes) in ["dx", "dy"].into_iter().zip(picture.slopes).filter(|_| wanted.gradients) {
        for (name, plane) in COLOURS.into_iter().zip(planes) {
            add(format!("{layer}.{name}"), values(plane));
        }
    }
    for (name, plane) in ["N.X", "N.Y", "N.Z"].into_iter().zip(picture.normal).filter(|_| wanted.normals) {
        add(name.into(), values(plane));
    }
    if wanted.depth {
        add("Z".into(), Samples::Float(picture.depth));
    }
    let measured = |at: usize| mask.is_none_or(|mask| mask.as_slice()[at]);
    if wanted.samples {
        let count = |at: usize| if measured(at) { story.samples } else { 0 };
        add("samples".into(), Samples::Uint((0..size.pixels()).map(count).collect()));
    }
    if mask.is_some() {
        let flag = |at: usize| if measured(at) { f16::ONE } else { f16::ZERO };
        add(MASK.into(), Samples::Half((0..size.pixels()).map(flag).collect()));
    }
    let part = Part {
        attributes: attributes(size, mask.is_some(), story),
        compression: wanted.compression,
        ..part(size, channels)
    };
    (Frame { parts: vec![part] }, clamped)
}

/// Adds what a coarse march told of every pixel, and lists it as complete; how many values became the largest half.
pub fn add_dense(frame: &mut Frame, picture: Picture, kind: SampleType) -> usize {
    let Some(part) = frame.parts.first_mut() else { return 0 };
    let mut clamped = 0;
    let named = DENSE.into_iter().zip(picture.colour.into_iter().chain(picture.normal));
    part.channels.extend(named.map(|(name, plane)| channel(name, values(plane, kind, &mut clamped))));
    part.channels.push(channel(DENSE_DEPTH, Samples::Float(picture.depth)));
    channels::list_dense(part, DENSE.into_iter().chain([DENSE_DEPTH]));
    clamped
}

/// A plane's samples of that type; counts those that become the largest half.
fn values(plane: Vec<f32>, kind: SampleType, clamped: &mut usize) -> Samples {
    if kind != SampleType::Half {
        return Samples::Float(plane);
    }
    let (halves, more) = to_halves(&plane);
    *clamped += more;
    Samples::Half(halves)
}

/// A frame of that size with one channel, for what needs only its windows.
pub fn canvas(size: Size) -> Frame {
    Frame { parts: vec![part(size, vec![channel("R", Samples::Half(vec![f16::ZERO; size.pixels()]))])] }
}

pub fn channel(name: &str, samples: Samples) -> Channel {
    Channel { name: name.into(), perceptually_linear: false, samples }
}

fn part(size: Size, channels: Vec<Channel>) -> Part {
    let (x_max, y_max) = (size.width as i32 - 1, size.height as i32 - 1);
    Part::new(Window { x_min: 0, y_min: 0, x_max, y_max }, channels)
}

/// A value as a frame of that type holds it.
pub fn kept(value: f32, kind: SampleType) -> f32 {
    if kind == SampleType::Half { to_half(value, &mut 0).to_f32() } else { value }
}

fn attributes(size: Size, masked: bool, story: &Story<'_>) -> Attributes {
    let mut attributes = Attributes::default();
    let matrix = |rows: [[f64; 4]; 4]| -> Vec<u8> {
        rows.iter().flatten().flat_map(|value| (*value as f32).to_le_bytes()).collect()
    };
    attributes.set("worldToCamera", "m44f", matrix(story.camera.world_to_camera()));
    attributes.set("worldToNDC", "m44f", matrix(story.camera.world_to_ndc(size)));
    // Of the image plane at distance 1; there is none that an orthographic camera's rays go through from one point.
    if story.camera.projection == Projection::Perspective {
        let width = story.camera.field * size.width as f64 / size.height as f64;
        attributes.set("screenWindowWidth", "float", (width as f32).to_le_bytes().into());
    }
    attributes.set_text("lacuna/version", env!("CARGO_PKG_VERSION"));
    attributes.set_text(SCENE, story.scene);
    attributes.set_text(RENDER, story.render);
    attributes.set_text("lacuna/seed", &story.seed.to_string());
    if masked {
        attributes.set_text(mask::ATTRIBUTE, MASK);
    }
    if let Some(pattern) = story.pattern {
        attributes.set_text("lacuna/pattern", pattern);
    }
    attributes
}
