//! Isosurfaces and maxima along one ray.
//!
//! A surface lies where two samples stand on either side of the iso value; bisection of the interpolant between them
//! finds the place to `step / 2^16`.

use super::kernel::Kernel;
use super::march::Seen;
use super::shade::Shader;
use super::transfer::Table;
use super::walk::Walk;

/// Halvings of a step.
const HALVINGS: u32 = 16;

/// What finding a surface needs besides the walk.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// The iso value.
    pub value: f32,
    /// The surface's colour.
    pub colour: [f32; 3],
    /// The shading; none shows the plain colour.
    pub shader: Option<&'a Shader>,
}

impl Surface<'_> {
    /// The first surface along a ray of that direction.
    #[inline(always)]
    pub fn ray<K: Kernel>(&self, mut walk: Walk<'_, K>, view: [f32; 3]) -> Seen {
        let mut known = (u32::MAX, 0.0);
        let mut i = 0;
        while i < walk.count {
            let place = walk.place(i as f32);
            if i == 0 || known.0 != i - 1 {
                if let Some(next) = walk.leap(i, &place) {
                    i = next;
                    continue;
                }
                if i > 0 {
                    known = (i - 1, walk.sample((i - 1) as f32).0);
                }
            }
            walk.enter(&place);
            let (value, _) = walk.value(&place);
            if i > 0 && (value >= self.value) != (known.1 >= self.value) {
                return self.hit(&mut walk, i, known.1 >= self.value, view);
            }
            known = if walk.leap(i, &place).is_some() { (u32::MAX, 0.0) } else { (i, value) };
            i += 1;
        }
        Seen::NOTHING
    }

    /// The surface between sample `i - 1` and `i`; `inside` tells on which side the former is.
    #[inline(always)]
    fn hit<K: Kernel>(&self, walk: &mut Walk<'_, K>, i: u32, inside: bool, view: [f32; 3]) -> Seen {
        let (mut near, mut far) = ((i - 1) as f32, i as f32);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (near + far);
            if (walk.sample(middle).0 >= self.value) == inside {
                near = middle;
            } else {
                far = middle;
            }
        }
        let at = 0.5 * (near + far);
        let (mut colour, mut normal) = (self.colour, [0.0; 3]);
        if let Some(shader) = self.shader {
            let length;
            (normal, length) = shader.normal(walk.sample(at).1);
            colour = shader.shade(colour, normal, length, &shader.halfway(view));
        }
        Seen { colour: [colour[0], colour[1], colour[2], 1.0], normal, depth: at }
    }
}

/// How far interpolated values may leave the bounds of their voxels by rounding.
#[inline(always)]
pub fn slack(low: f32, high: f32) -> f32 {
    64.0 * f32::EPSILON * low.abs().max(high.abs())
}

/// The largest value along a ray, as the transfer function shows it; depth is that of the first sample that has it.
#[inline(always)]
pub fn maximum<K: Kernel>(mut walk: Walk<'_, K>, table: &Table) -> Seen {
    let mut best = (f32::NEG_INFINITY, -1.0);
    let mut most = f32::INFINITY;
    for i in 0..walk.count {
        let place = walk.place(i as f32);
        if walk.enter(&place) && walk.skips() {
            let (low, high) = walk.bounds();
            // Interpolated values may leave the bounds of their voxels by some units in the last place.
            most = high + slack(low, high);
        }
        // A cell that cannot have more than was seen needs no interpolation.
        if most > best.0 {
            let (value, _) = walk.value(&place);
            if value > best.0 {
                best = (value, i as f32);
            }
        }
    }
    let [red, green, blue, alpha] = table.at(best.0);
    if best.1 < 0.0 || alpha <= 0.0 {
        return Seen::NOTHING;
    }
    Seen { colour: [red * alpha, green * alpha, blue * alpha, alpha], normal: [0.0; 3], depth: best.1 }
}
