//! Volumes that the tool makes itself, for samples and tests: `procedural:NAME[:N]`.
//!
//! Sources: S. Marschner, R. Lobb, "An evaluation of reconstruction filters for volume rendering", Visualization 1994
//! (the test signal, frequency 6, amplitude 0.25). The head and the vessels are the project's own.

use lacuna_core::parallel::prelude::*;

use super::vector::{Affine, Vector, add, cross, dot, length, normalise, scale, subtract};
use super::{Error, Grid, Limits, Values};

/// The word before the name.
pub const PREFIX: &str = "procedural:";
/// Voxels along an edge unless told otherwise.
const EDGE: usize = 128;
/// Voxels along an edge at most.
const LARGEST: usize = 1024;

/// Makes the volume that `NAME[:N]` names, with N voxels along each edge.
///
/// # Errors
/// [`Error::Scene`] for an unknown name or size.
pub fn make(text: &str, limits: &Limits) -> Result<Grid, Error> {
    let (name, edge) = text.split_once(':').unwrap_or((text, ""));
    let edge: usize = if edge.is_empty() { EDGE } else { edge.parse().unwrap_or(0) };
    if !(2..=LARGEST).contains(&edge) {
        return Err(Error::Scene(format!("volume '{text}': the size must be 2 to {LARGEST}")));
    }
    // As floats, as bytes with and without a border, as coefficients.
    limits.voxels([edge; 3], 2 + 2 * size_of::<f32>() as u64)?;
    let function = match name {
        "marschner-lobb" => marschner_lobb,
        "head" => head,
        "vessels" => return build(edge, &vessels(edge)),
        _ => {
            return Err(Error::Scene(format!(
                "volume '{PREFIX}{name}' is not known; choose marschner-lobb, head or vessels"
            )));
        }
    };
    let value = |k: usize| {
        function([place(k % edge, edge), place(k / edge % edge, edge), place(k / edge / edge, edge)]) as f32
    };
    build(edge, &(0..edge * edge * edge).into_par_iter().map(value))
}

/// Where voxel `k` of an edge lies in -1 to 1.
fn place(k: usize, edge: usize) -> f64 {
    2.0 * k as f64 / (edge - 1) as f64 - 1.0
}

/// Values from 0 to 1 as bytes.
fn build(edge: usize, values: &[f32]) -> Result<Grid, Error> {
    let bytes = values.iter().map(|value| (255.0 * value.clamp(0.0, 1.0)).round() as u8).collect();
    Grid::new([edge; 3], &Values::U8(bytes), Affine::spacing([1.0; 3]))
}

/// The test signal over -1 to 1; its axis is y here, so that the rings are seen from above.
fn marschner_lobb([x, z, y]: Vector) -> f64 {
    use std::f64::consts::PI;
    const AMPLITUDE: f64 = 0.25;
    const FREQUENCY: f64 = 6.0;
    let rings = (2.0 * PI * FREQUENCY * (0.5 * PI * x.hypot(y)).cos()).cos();
    ((1.0 - (0.5 * PI * z).sin()) + AMPLITUDE * (1.0 + rings)) / (2.0 * (1.0 + AMPLITUDE))
}

/// 1 well inside, 0 well outside of a surface at signed distance `d`, over a voxel or two.
fn soft(d: f64) -> f64 {
    let t = (0.5 - d / 0.03).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// About the signed distance to an ellipsoid.
fn ellipsoid(p: Vector, centre: Vector, radii: Vector) -> f64 {
    let q = subtract(p, centre);
    let scaled = [q[0] / radii[0], q[1] / radii[1], q[2] / radii[2]];
    (length(scaled) - 1.0) * radii[0].min(radii[1]).min(radii[2])
}

/// Skin, skull, brain, eye sockets, nose and jaw as nested ellipsoids; y is up, z towards the face.
fn head(p: Vector) -> f64 {
    let mut value = 0.0;
    let mut layer = |d: f64, level: f64| value += (level - value) * soft(d);
    layer(ellipsoid(p, [0.0, 0.1, 0.0], [0.62, 0.75, 0.78]), 0.35);
    layer(ellipsoid(p, [0.0, -0.45, 0.22], [0.42, 0.42, 0.5]), 0.35);
    layer(ellipsoid(p, [0.0, -0.12, 0.8], [0.1, 0.18, 0.14]), 0.35);
    layer(ellipsoid(p, [0.0, -0.85, -0.1], [0.34, 0.5, 0.34]), 0.35);
    for side in [-1.0, 1.0] {
        layer(ellipsoid(p, [0.63 * side, -0.05, -0.02], [0.07, 0.17, 0.12]), 0.33);
    }
    layer(ellipsoid(p, [0.0, 0.14, -0.01], [0.55, 0.66, 0.69]), 0.85);
    layer(ellipsoid(p, [0.0, -0.45, 0.22], [0.33, 0.33, 0.42]), 0.8);
    layer(ellipsoid(p, [0.0, -0.4, 0.12], [0.26, 0.27, 0.38]), 0.3);
    layer(ellipsoid(p, [0.0, -0.85, -0.1], [0.12, 0.6, 0.12]), 0.75);
    for side in [-1.0, 1.0] {
        layer(ellipsoid(p, [0.2 * side, 0.02, 0.62], [0.13, 0.12, 0.18]), 0.3);
        layer(ellipsoid(p, [0.2 * side, 0.02, 0.6], [0.1, 0.1, 0.1]), 0.45);
    }
    layer(ellipsoid(p, [0.0, 0.16, -0.01], [0.47, 0.57, 0.6]), 0.5);
    let folds = 0.02 * ((17.0 * p[0]).sin() * (19.0 * p[1]).sin() + (15.0 * p[2] + 4.0 * p[0]).sin());
    layer(ellipsoid(p, [0.0, 0.16, -0.01], [0.43, 0.53, 0.56]) + folds, 0.42);
    value
}

/// A piece of a vessel: both ends and both radii.
type Piece = (Vector, Vector, f64, f64);

/// The values of a tree of vessels that divide in two.
fn vessels(edge: usize) -> Vec<f32> {
    let mut values = vec![0.0_f32; edge * edge * edge];
    let index = |x: f64| ((x + 1.0) * 0.5 * (edge - 1) as f64).clamp(0.0, (edge - 1) as f64);
    for (a, b, from, to) in tree() {
        let room = from.max(to) + 0.03;
        let low: [usize; 3] = std::array::from_fn(|k| index(a[k].min(b[k]) - room).floor() as usize);
        let high: [usize; 3] = std::array::from_fn(|k| index(a[k].max(b[k]) + room).ceil() as usize);
        let axis = subtract(b, a);
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    let p = [place(x, edge), place(y, edge), place(z, edge)];
                    let t = (dot(subtract(p, a), axis) / dot(axis, axis)).clamp(0.0, 1.0);
                    let distance = length(subtract(p, add(a, scale(axis, t)))) - (from + t * (to - from));
                    let value = &mut values[x + edge * (y + edge * z)];
                    *value = value.max(soft(distance) as f32);
                }
            }
        }
    }
    values
}

/// The pieces of the tree, by a fixed pseudo-random sequence.
fn tree() -> Vec<Piece> {
    let mut pieces = Vec::new();
    let mut state = 2015_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut tips = vec![([0.0, -0.95, 0.0], [0.0, 1.0, 0.0], 0.085, 0)];
    while let Some((start, direction, radius, level)) = tips.pop() {
        let reach = (0.42 - 0.03 * f64::from(level)) * (0.8 + 0.4 * random());
        let end = add(start, scale(direction, reach));
        let thinner = radius * 0.86;
        pieces.push((start, end, radius, thinner));
        if level == 7 || radius < 0.008 {
            continue;
        }
        let side = normalise(cross(direction, [random() - 0.5, random() - 0.5, random() - 0.5]));
        for (sign, part) in [(1.0, 0.82), (-1.0, 0.68)] {
            let spread = 0.45 + 0.4 * random();
            let inwards = scale(end, -0.35 * length(end));
            let turned = add(add(direction, scale(side, sign * spread)), inwards);
            tips.push((end, normalise(turned), thinner * part, level + 1));
        }
    }
    pieces
}
