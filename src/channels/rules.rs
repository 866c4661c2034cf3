//! The default rules: what a channel's name, type and part say about it, as a table read from the top.

use lacuna_exr::{Channel, Frame, Part, Samples, Window};

use super::Rule;
use super::geometry::{
    DEPTHS, NORMALS, is_clear_motion, is_coordinate, is_motion, is_position, is_statistic,
};
use super::names::{Name, without_view, words};
use super::picture::MAIN;

/// What the rows of the table look at.
struct Subject<'a> {
    part: &'a Part,
    index: usize,
    full: String,
    words: Vec<String>,
}

impl<'a> Subject<'a> {
    fn new(part: &'a Part, index: usize) -> Option<Self> {
        let full = part.channels.get(index)?.display_name().into_owned();
        Some(Self { part, index, words: words(&full), full })
    }
}

/// One row: the rule, the reason it gives, and the channels it is for.
struct Row {
    rule: Rule,
    why: &'static str,
    holds: fn(&Subject<'_>) -> bool,
}

/// Why a channel that no other row is for is filled.
const NO_RULE: &str = "a float channel without a rule of its own";

/// First match wins.
const TABLE: &[Row] = &[
    Row { rule: Rule::Keep, why: "a mask that is not in use", holds: is_mask },
    Row { rule: Rule::Keep, why: "a count of samples", holds: is_sample_count },
    Row { rule: Rule::Nearest, why: "whole numbers", holds: is_uint },
    Row { rule: Rule::Nearest, why: "Cryptomatte, by its header attributes", holds: is_listed_cryptomatte },
    Row { rule: Rule::Nearest, why: "Cryptomatte, by its name", holds: is_named_cryptomatte },
    Row { rule: Rule::Nearest, why: "an identifier, by its name", holds: is_identifier },
    Row { rule: Rule::Nearest, why: "few values, repeated exactly: a label", holds: is_valued_label },
    Row { rule: Rule::Fill, why: "mist, a share of light", holds: is_mist },
    Row { rule: Rule::Depth, why: "a depth, by its name", holds: is_depth },
    Row { rule: Rule::Normal, why: "a normal with its two siblings", holds: is_normal },
    Row {
        rule: Rule::Fill,
        why: "motion or disparity, by its name",
        holds: |subject| is_motion(&subject.full),
    },
    Row { rule: Rule::Fill, why: "alpha", holds: |subject| is_alpha(&subject.full) },
    Row { rule: Rule::Fill, why: "a matte", holds: |subject| is_matte(&subject.full) },
    Row { rule: Rule::Fill, why: "a position", holds: |subject| is_position(&subject.full) },
    Row { rule: Rule::Fill, why: "colour", holds: is_colour_of },
    Row { rule: Rule::Fill, why: NO_RULE, holds: |_| true },
];

/// The default rule for a channel of a part, and why.
pub fn by_default(part: &Part, channel: usize) -> (Rule, &'static str) {
    let Some(subject) = Subject::new(part, channel) else { return (Rule::Keep, "no such channel") };
    TABLE
        .iter()
        .find(|row| (row.holds)(&subject))
        .map_or((Rule::Fill, "a float channel"), |row| (row.rule, row.why))
}

/// What a channel is taken for by its name alone, if that is anything but numbers.
pub fn meaning(name: &str) -> Option<&'static str> {
    let samples = Samples::Float(vec![0.0]);
    let channel = Channel { name: name.into(), perceptually_linear: false, samples };
    let window = Window { x_min: 0, y_min: 0, x_max: 0, y_max: 0 };
    let (_, why) = by_default(&Part::new(window, vec![channel]), 0);
    (why != NO_RULE).then_some(why)
}

/// Words that make a channel an identifier wherever they stand in its name.
const IDENTIFIERS: &[&str] = &[
    "id",
    "ids",
    "identifier",
    "objectid",
    "objid",
    "materialid",
    "matid",
    "mtlid",
    "primid",
    "primitiveid",
    "shapeid",
    "geomid",
    "instanceid",
    "instid",
    "nodeid",
    "assetid",
    "renderid",
    "faceid",
    "puzzleid",
    "label",
    "labels",
    "segmentation",
    "index",
    "indexob",
    "indexma",
];

fn has(words: &[String], list: &[&str]) -> bool {
    words.iter().any(|word| list.contains(&word.as_str()))
}

/// Beside a channel called exactly `mask` one that differs in case is a matte.
fn is_mask(subject: &Subject<'_>) -> bool {
    let exact = || subject.part.channels.iter().any(|channel| channel.name == b"mask");
    subject.full == "mask" || (subject.full.eq_ignore_ascii_case("mask") && !exact())
}

fn is_sample_count(subject: &Subject<'_>) -> bool {
    let layer = Name::new(&subject.full).layer;
    let last = Name::new(layer).component;
    let component = Name::new(&subject.full).component;
    [last, component].iter().any(|name| {
        let joined = words(name).concat();
        matches!(
            joined.as_str(),
            "samples"
                | "samplecount"
                | "samplescount"
                | "numsamples"
                | "nsamples"
                | "debugsamplecount"
                | "raycount"
                | "numrays"
                | "nrays"
        )
    })
}

fn is_uint(subject: &Subject<'_>) -> bool {
    matches!(subject.part.channels[subject.index].samples, Samples::Uint(_))
}

/// The attribute `cryptomatte/<id>/name` is the layer that the ranks `<name>00`, `<name>01` ... append a number to.
fn is_listed_cryptomatte(subject: &Subject<'_>) -> bool {
    lists_cryptomatte(subject.part, subject)
}

/// Whether the attributes of any part of the frame list a channel as Cryptomatte.
pub fn is_cryptomatte_in(frame: &Frame, part: &Part, channel: usize) -> bool {
    Subject::new(part, channel)
        .is_some_and(|subject| frame.parts.iter().any(|other| lists_cryptomatte(other, &subject)))
}

fn lists_cryptomatte(part: &Part, subject: &Subject<'_>) -> bool {
    part.attributes.iter().any(|attribute| {
        let key = String::from_utf8_lossy(&attribute.name);
        if !key.starts_with("cryptomatte/") || !key.ends_with("/name") {
            return false;
        }
        let name = String::from_utf8_lossy(&attribute.value);
        let full = without_view(subject.part, &subject.full);
        let layer = Name::new(&full).layer;
        let rest = layer.strip_prefix(&*name).filter(|_| !name.is_empty());
        rest.is_some_and(|rest| rest.chars().all(|letter| letter.is_ascii_digit()))
    })
}

fn is_named_cryptomatte(subject: &Subject<'_>) -> bool {
    has(&subject.words, &["crypto", "cryptomatte", "cryptoobject", "cryptomaterial", "cryptoasset"])
}

/// What is chosen by an identifier is light or a mask, and none: `BY_OBJECT_ID_2.R`, `VRayLightSelect_ID_3.R`, `OBJECT_ID_MASK_1`.
fn is_identifier(subject: &Subject<'_>) -> bool {
    let at = subject.words.iter().position(|word| IDENTIFIERS.contains(&word.as_str()));
    at.is_some_and(|at| {
        let (before, after) = subject.words.split_at(at);
        !has(before, &["by", "select", "matte", "multimatte"]) && !has(after, &["mask", "matte"])
    })
}

/// Mist is antialiased like colour, and no distance.
fn is_mist(subject: &Subject<'_>) -> bool {
    has(&subject.words, &["mist"])
}

/// Layers of mattes and scalars without a rule of their own are labels if their values say so.
fn is_valued_label(subject: &Subject<'_>) -> bool {
    let Name { layer, component } = Name::new(&subject.full);
    let matte = has(&words(layer), &["puzzle", "matte", "mattes", "multimatte"]);
    let light = is_colour_of(subject) || is_alpha(&subject.full) || is_matte(&subject.full);
    let ruled =
        light || is_mist(subject) || is_depth(subject) || is_normal(subject) || is_motion(&subject.full);
    let coordinate = ["u", "v", "w", "x", "y", "z", "s", "t"]
        .contains(&component.to_ascii_lowercase().as_str())
        && !layer.is_empty();
    (matte || !(ruled || coordinate || is_position(&subject.full)))
        && few_values(&subject.part.channels[subject.index].samples)
}

/// The most values that labels have, zero and what is not finite left out.
const MOST_LABELS: usize = 64;
/// How often each is there on average.
const REPEATED: usize = 16;

/// Whether the samples hold few values, each many times; zeros, which missing pixels may have, say nothing.
fn few_values(samples: &Samples) -> bool {
    fn few<T: Copy>(values: &[T], bits: impl Fn(T) -> Option<u32>) -> bool {
        let (mut seen, mut count) = (Vec::<u32>::new(), 0_usize);
        for bits in values.iter().filter_map(|&value| bits(value)) {
            if let Err(at) = seen.binary_search(&bits) {
                if seen.len() == MOST_LABELS {
                    return false;
                }
                seen.insert(at, bits);
            }
            count += 1;
        }
        seen.len() > 1 && count >= seen.len() * REPEATED
    }
    match samples {
        Samples::Half(values) => few(values, |value| {
            (value.is_finite() && value.to_f32() != 0.0).then(|| u32::from(value.to_bits()))
        }),
        Samples::Float(values) => {
            few(values, |value| (value.is_finite() && value != 0.0).then(|| value.to_bits()))
        }
        Samples::Uint(_) => true,
    }
}

/// A `Z` without an `X` beside it (`ZBack`, `volume_Z`, Mantra's `Pz`), and everything in a layer called depth.
fn is_depth(subject: &Subject<'_>) -> bool {
    !is_statistic(&subject.full) && (is_lone_z(subject) || DEPTHS.are_meant(&subject.full))
}

fn is_lone_z(subject: &Subject<'_>) -> bool {
    let mut component = words(Name::new(&subject.full).component);
    while component
        .last()
        .is_some_and(|word| ["back", "front", "depth", "buffer", "noisy"].contains(&word.as_str()))
    {
        component.pop();
    }
    let ends = component.last().is_some_and(|word| ["z", "pz", "zback", "zfront"].contains(&word.as_str()));
    let x = |at: usize| format!("{}x{}", &subject.full[..at], &subject.full[at + 1..]);
    ends && subject.full.rfind(['z', 'Z']).is_some_and(|at| find(subject.part, &x(at)).is_none())
}

/// The axis along which a channel counts pixels, if it is motion or disparity in pixels: 0 across, 1 down. Velocities are of space;
/// the third component of four is a second motion's first, as in Cycles' `Vector`, and that of three a depth. Three components
/// are motion only if the name says no less: `vector_displacement.X` is of space, `motion_blur.R` is light.
pub fn motion_axis(part: &Part, channel: usize) -> Option<usize> {
    let subject =
        Subject::new(part, channel).filter(|subject| is_motion(&subject.full) && !is_uint(subject))?;
    let Name { layer, component } = Name::new(&subject.full);
    let light = sibling(part, layer, &["b", "blue"]).is_some();
    let space = sibling(part, layer, &["z"]).is_some() && sibling(part, layer, &["w"]).is_none();
    let vague = (light && !is_clear_motion(&subject.full))
        || (space && has(&subject.words, &["vector", "vectors"]) && !has(&subject.words, &["motion", "mv"]));
    if has(&subject.words, &["velocity"]) || vague {
        return None;
    }
    match component.to_ascii_lowercase().as_str() {
        "x" | "u" | "r" | "red" => Some(0),
        "y" | "v" | "g" | "w" | "green" => Some(1),
        "z" => sibling(part, layer, &["w"]).map(|_| 0),
        _ => None,
    }
}

fn is_normal(subject: &Subject<'_>) -> bool {
    normal_siblings(subject.part, subject.index).is_some()
}

/// Whether a channel that is filled is light: not an alpha, a matte or a coordinate.
pub fn is_light(full: &str) -> bool {
    !is_alpha(full) && !is_matte(full) && !is_coordinate(full)
}

/// Whether a channel is a colour by its component; `Y` is a luminance unless there is an `X` beside it.
pub fn is_colour(part: &Part, channel: usize) -> bool {
    Subject::new(part, channel).is_some_and(|subject| is_colour_of(&subject))
}

fn is_colour_of(subject: &Subject<'_>) -> bool {
    let Name { layer, component } = Name::new(&subject.full);
    let component = component.to_ascii_lowercase();
    let coordinate = component == "y" && sibling(subject.part, layer, &["x"]).is_some();
    !coordinate && ["r", "g", "b", "red", "green", "blue", "y", "ry", "by"].contains(&component.as_str())
}

/// Whether a channel is a chroma by its component: `RY` and `BY`, beside a luminance `Y`.
pub fn is_chroma(full: &str) -> bool {
    let component = Name::new(full).component;
    ["ry", "by"].iter().any(|name| component.eq_ignore_ascii_case(name))
}

/// Whether a channel is an alpha by its component: `A`, `alpha`, or one of the coloured `AR`, `AG`, `AB`.
pub fn is_alpha(full: &str) -> bool {
    let component = Name::new(full).component.to_ascii_lowercase();
    ["a", "alpha", "ar", "ag", "ab"].contains(&component.as_str())
}

/// Whether a channel is the alpha of a part's colour itself, in whichever view.
pub fn is_main_alpha(part: &Part, full: &str) -> bool {
    let main = |layer: &str| layer.is_empty() || MAIN.contains(&layer.to_ascii_lowercase().as_str());
    is_alpha(full) && main(Name::new(&without_view(part, full)).layer)
}

/// Whether a channel holds one identifier a pixel, by its name (not Cryptomatte, which holds several).
pub fn is_label(part: &Part, channel: usize) -> bool {
    Subject::new(part, channel).is_some_and(|subject| is_identifier(&subject) && !is_cryptomatte(&subject))
}

/// Whether a channel holds codes: whole numbers, Cryptomatte and other identifiers.
pub fn is_code(part: &Part, channel: usize) -> bool {
    is_bits(part, channel) || is_label(part, channel)
}

/// Whether a channel holds what only its bits tell, so that those of NaN are as good as any: whole numbers and Cryptomatte.
pub fn is_bits(part: &Part, channel: usize) -> bool {
    Subject::new(part, channel).is_some_and(|subject| is_uint(&subject) || is_cryptomatte(&subject))
}

fn is_cryptomatte(subject: &Subject<'_>) -> bool {
    is_listed_cryptomatte(subject) || is_named_cryptomatte(subject)
}

/// Whether a channel is a matte by its name; like an alpha it stays within 0 and 1 where it was.
pub fn is_matte(full: &str) -> bool {
    let component = words(Name::new(full).component);
    has(&component, &["mask", "matte"])
}

/// The three channels `X Y Z` or `R G B` of the layer of normals that the channel belongs to, in that order;
/// pbrt's `Nx Ny Nz` without a full stop as well.
pub fn normal_siblings(part: &Part, channel: usize) -> Option<[usize; 3]> {
    let full = part.channels.get(channel)?.display_name().into_owned();
    let Name { layer, component } = Name::new(&full);
    let stem = component.strip_suffix(['x', 'y', 'z', 'X', 'Y', 'Z']).unwrap_or("");
    let triples = if !layer.is_empty() && NORMALS.are_meant(&full) {
        siblings(part, layer)
    } else if layer.is_empty() && NORMALS.are_meant(&format!("{stem}.x")) {
        vec![["x", "y", "z"].map(|axis| find(part, &format!("{stem}{axis}")))]
    } else {
        return None;
    };
    triples.into_iter().find_map(|triple| {
        let [Some(x), Some(y), Some(z)] = triple else { return None };
        [x, y, z].contains(&channel).then_some([x, y, z])
    })
}

/// The triples that a layer may have: axes, then colours, in the order of the components.
pub fn siblings(part: &Part, layer: &str) -> Vec<[Option<usize>; 3]> {
    [["x", "y", "z"], ["r", "g", "b"], ["red", "green", "blue"]]
        .map(|names| names.map(|name| sibling(part, layer, &[name])))
        .to_vec()
}

/// The channel of a layer whose component is one of `names`, in any case.
fn sibling(part: &Part, layer: &str, names: &[&str]) -> Option<usize> {
    part.channels.iter().position(|channel| {
        let full = channel.display_name();
        let name = Name::new(&full);
        name.layer == layer && names.iter().any(|other| name.component.eq_ignore_ascii_case(other))
    })
}

/// The channel of that full name, in any case.
fn find(part: &Part, full: &str) -> Option<usize> {
    part.channels.iter().position(|channel| channel.display_name().eq_ignore_ascii_case(full))
}
