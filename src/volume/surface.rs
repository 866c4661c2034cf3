//! Isosurfaces and maxima along one ray.
//!
//! A surface lies where two samples stand on either side of the iso value. The interval between them is cut by eight places
//! at once, again and again, which finds the place to `step / 9^5`.

use super::kernel::Kernel;
use super::lanes::{LANES, Lanes};
use super::march::Seen;
use super::shade::{Shader, ToWorld};
use super::transfer::Table;
use super::walk::Walk;

/// How often an interval is cut.
const CUTS: u32 = 5;

/// What finding a surface needs besides the walk.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// The iso value.
    pub value: f32,
    /// The surface's colour.
    pub colour: [f32; 3],
    /// The shading; none shows the plain colour.
    pub shader: Option<&'a Shader>,
    /// Where normals come from.
    pub to_world: &'a ToWorld,
    /// Whether normals are wanted.
    pub normals: bool,
}

impl Surface<'_> {
    /// The first surface along a ray of that direction.
    #[inline(always)]
    pub fn ray<K: Kernel>(&self, mut walk: Walk<'_, K>, view: [f32; 3]) -> Seen {
        // The last sample, and whether it lies inside.
        let mut known = (f32::NAN, false);
        while let Some(bundle) = walk.next() {
            let values = walk.values(&bundle).0.to_array();
            for lane in 0..bundle.count {
                let (sample, inside) = (bundle.samples[lane], values[lane] >= self.value);
                if known.0 == sample - 1.0 && known.1 != inside {
                    return self.hit(&mut walk, sample, known.1, view);
                }
                known = (sample, inside);
            }
        }
        Seen::NOTHING
    }

    /// The surface between a sample and the one before, which lies inside or not.
    #[inline(always)]
    fn hit<K: Kernel>(&self, walk: &mut Walk<'_, K>, sample: f32, inside: bool, view: [f32; 3]) -> Seen {
        let (mut near, mut far) = (sample - 1.0, sample);
        for _ in 0..CUTS {
            let width = (far - near) / (LANES + 1) as f32;
            let places: [f32; LANES] = std::array::from_fn(|k| near + (k + 1) as f32 * width);
            let bundle = walk.bundle(places, LANES);
            let values = walk.values(&bundle).0.to_array();
            let crossed = values.iter().position(|&value| (value >= self.value) != inside).unwrap_or(LANES);
            far = if crossed < LANES { places[crossed] } else { far };
            near = if crossed > 0 { places[crossed - 1] } else { near };
        }
        let at = 0.5 * (near + far);
        let mut seen = Seen { colour: [0.0, 0.0, 0.0, 1.0], normal: [0.0; 3], depth: at };
        let (mut share, mut white) = (1.0, 0.0);
        if self.shader.is_some() || self.normals {
            let (normals, lengths) = normals(walk, at, self.to_world);
            seen.normal = normals.map(|part| part.as_array()[0]);
            if let Some(shader) = self.shader {
                let shown = shader.shade(normals, lengths, &shader.halfway(view));
                (share, white) = (shown.0.as_array()[0], shown.1.as_array()[0]);
            }
        }
        for k in 0..3 {
            seen.colour[k] = share * self.colour[k] + white;
        }
        seen
    }
}

/// The normal at a sample, and the length of its gradient.
#[inline(always)]
fn normals<K: Kernel>(walk: &mut Walk<'_, K>, at: f32, to_world: &ToWorld) -> ([Lanes; 3], Lanes) {
    let bundle = walk.bundle([at; LANES], 1);
    let partial = walk.values(&bundle).1;
    to_world.normals(walk.gradients(&bundle, &partial, 1))
}

/// How far interpolated values may leave the bounds of their voxels by rounding.
#[inline(always)]
pub fn slack(low: f32, high: f32) -> f32 {
    64.0 * f32::EPSILON * low.abs().max(high.abs())
}

/// The largest value along a ray, as the transfer function shows it; depth and normal are those of the first sample that has it. Without
/// `to_world` the normal stays 0.
#[inline(always)]
pub fn maximum<K: Kernel>(mut walk: Walk<'_, K>, table: &Table, to_world: Option<&ToWorld>) -> Seen {
    let mut best = (f32::NEG_INFINITY, -1.0);
    while let Some(bundle) = walk.next() {
        let values = walk.values(&bundle).0.to_array();
        for lane in 0..bundle.count {
            if values[lane] > best.0 {
                best = (values[lane], bundle.samples[lane]);
            }
        }
        walk.beat(best.0);
    }
    let [red, green, blue, alpha] = table.at(best.0);
    if best.1 < 0.0 || alpha <= 0.0 {
        return Seen::NOTHING;
    }
    let normal = to_world
        .map_or([0.0; 3], |to_world| normals(&mut walk, best.1, to_world).0.map(|part| part.as_array()[0]));
    Seen { colour: [red * alpha, green * alpha, blue * alpha, alpha], normal, depth: best.1 }
}
