//! Motion by depth and cameras, as the standard attributes say them.

use lacuna_core::parallel::prelude::*;
use lacuna_exr::{CAMERA, Frame, Part};
use lacuna_filters::baseline::nearest::NearestMap;
use lacuna_filters::temporal::camera::{Camera, Depth, Matrix};
use lacuna_filters::{Mask, Size};

use super::{Neighbour, fit};
use crate::channels::{self, Name, Rule};

/// The scene that `lacuna render` made a part of, in JSON.
pub const SCENE: &str = "lacuna/scene";

/// The camera of a part of a frame, over its display window: its own, or that of a part of the same pixels.
///
/// # Errors
/// What is missing, or wrong.
fn camera(frame: &Frame, part: usize) -> Result<Camera, String> {
    let known = |part: &usize| CAMERA.iter().all(|name| frame.parts[*part].attributes.get(name).is_some());
    let part = &frame.parts[fit::alike(frame, part).find(known).unwrap_or(part)];
    let [to_camera, to_ndc] = CAMERA.map(|name| matrix(part, name));
    let camera = Camera::new(&to_camera?, &to_ndc?, part.display_window.size());
    camera.ok_or_else(|| format!("a {} or {} that cannot be inverted", CAMERA[0], CAMERA[1]))
}

/// What is wrong with the camera of a part or of the neighbour's, where one is said at all.
pub fn broken((frame, part): (&Frame, usize), neighbour: &Neighbour) -> Option<String> {
    let wrong = |frame: &Frame| {
        let names = |part: usize| CAMERA.iter().any(|name| frame.parts[part].attributes.get(name).is_some());
        let said = names(part) || fit::alike(frame, part).any(names);
        camera(frame, part).err().filter(|_| said)
    };
    let own = wrong(frame).map(|what| format!("this frame has {what}"));
    own.or_else(|| wrong(&neighbour.frame).map(|what| format!("it has {what}")))
}

fn matrix(part: &Part, name: &str) -> Result<Matrix, String> {
    let attribute = part.attributes.get(name).ok_or_else(|| format!("no {name}"))?;
    let values: Vec<f64> = match attribute.kind.as_slice() {
        b"m44f" => attribute
            .value
            .as_chunks::<4>()
            .0
            .iter()
            .map(|bytes| f64::from(f32::from_le_bytes(*bytes)))
            .collect(),
        b"m44d" => {
            attribute.value.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect()
        }
        _ => Vec::new(),
    };
    if values.len() != 16 {
        let kind = String::from_utf8_lossy(&attribute.kind);
        return Err(format!("a {name} of type {}, not m44f or m44d", channels::visible(&kind)));
    }
    if values.iter().any(|value| !value.is_finite()) {
        return Err(format!("a {name} that is not finite"));
    }
    Ok(std::array::from_fn(|row| std::array::from_fn(|column| values[4 * row + column])))
}

/// The depth of each pixel of a neighbour's part, NaN where it is not known: the frame's own where it was measured, else of a dense AOV.
fn depths(neighbour: &Neighbour, part: usize) -> Option<Vec<f32>> {
    let own = &neighbour.frame.parts[part];
    let depth = |at: usize| channels::by_default(own, at).0 == Rule::Depth;
    let dense = channels::dense(own);
    let is_dense = |at: usize| dense.iter().any(|name| *name == own.channels[at].display_name());
    let named = |at: &usize| Name::new(&own.channels[*at].display_name()).component == "Z";
    let mut found: Vec<usize> = (0..own.channels.len()).filter(|&at| depth(at)).collect();
    found.sort_by_key(|at| (!is_dense(*at), !named(at)));
    let &first = found.first()?;
    let values = neighbour.floats(part, first)?;
    if is_dense(first) {
        return Some(values);
    }
    let mask = neighbour.masks.get(part, first)?;
    let measured = values.iter().zip(mask.as_slice());
    Some(measured.map(|(&value, &flag)| if flag { value } else { f32::NAN }).collect())
}

/// Where each pixel of a neighbour's part lies in the frame, in each way that its depth may be meant.
///
/// # Errors
/// What that takes and either frame lacks.
pub fn places((frame, part): (&Frame, usize), neighbour: &Neighbour) -> Result<Vec<Vec<[f32; 2]>>, String> {
    let (own, other) = (&frame.parts[part], &neighbour.frame.parts[part]);
    let here = camera(frame, part).map_err(|what| format!("this frame has {what}"))?;
    let there = camera(&neighbour.frame, part).map_err(|what| format!("it has {what}"))?;
    let depth = fit::alike(&neighbour.frame, part).find_map(|part| depths(neighbour, part));
    let depth = depth.ok_or("it has no depth that was measured")?;
    let size = other.size();
    let pixel = |at: usize| [at / size.width, at % size.width].map(|at| at as f64);
    // From pixels of the data windows to those of the display windows, which the cameras show.
    let corner = |part: &Part| part.display_window.corner_of(part.data_window).map(|at| at as f64);
    let (from, to) = (corner(other), corner(own));
    let moved = |[row, column]: [f64; 2], by: [f64; 2]| [row + by[0], column + by[1]];
    let local = |[row, column]: [f64; 2]| [(row - to[0]) as f32, (column - to[1]) as f32];
    if here.is_same(&there) {
        return Ok(vec![(0..size.pixels()).map(|at| local(moved(pixel(at), from))).collect()]);
    }
    let along = |along: Depth| -> Vec<[f32; 2]> {
        let carry = |(at, depth): (usize, &f32)| {
            if depth.is_nan() {
                return [f32::NAN; 2];
            }
            local(here.place(there.point(moved(pixel(at), from), f64::from(*depth), along)))
        };
        depth.par_iter().enumerate().map(carry)
    };
    let mut all = Vec::new();
    for convention in conventions(other) {
        let far = along(*convention);
        all.extend(with_surfaces(size, &depth, &far));
        all.push(far);
    }
    Ok(all)
}

/// The same, but that pixels without a finite depth move as the nearest one that has one: what shines through beside a surface moves with it.
fn with_surfaces(size: Size, depth: &[f32], places: &[[f32; 2]]) -> Option<Vec<[f32; 2]>> {
    let known = Mask::new(size, depth.iter().map(|depth| depth.is_finite()).collect()).ok()?;
    if known.is_empty() || !depth.iter().any(|depth| depth.is_infinite()) {
        return None;
    }
    let nearest = NearestMap::new(&known).ok()?;
    let place = |(at, &source): (usize, &u32)| {
        let from = source as usize;
        let shift =
            |axis: usize, pixel: usize, source: usize| places[from][axis] - source as f32 + pixel as f32;
        let width = size.width;
        [shift(0, at / width, from / width), shift(1, at % width, from % width)]
    };
    Some(nearest.as_slice().par_iter().enumerate().map(place))
}

/// What the depth of a frame is likely measured along: lacuna's own is along the ray.
fn conventions(part: &Part) -> &'static [Depth] {
    if part.attributes.get(SCENE).is_some() { &[Depth::Ray] } else { &[Depth::Plane, Depth::Ray] }
}
