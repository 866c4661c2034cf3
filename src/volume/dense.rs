//! Dense AOVs: what a coarse march without shading tells of every pixel, to steer the filling of the others' colour.
//!
//! Front to back as [`super::march`], in longer steps: colour without light and alpha, and the mean normal and the mean distance,
//! samples weighted by what they add to alpha. Isosurfaces and maxima are sought in the picture's own steps.

use super::kernel::Kernel;
use super::march::{Seen, visible};
use super::shade::ToWorld;
use super::transfer::Table;
use super::walk::Walk;

/// What the coarse march needs besides the walk.
#[derive(Clone, Copy, Debug)]
pub struct Dense<'a> {
    /// The transfer function.
    pub table: &'a Table,
    /// Where normals come from; none leaves them 0.
    pub to_world: Option<&'a ToWorld>,
    /// The march ends at this opacity.
    pub opaque: f32,
}

impl Dense<'_> {
    /// Marches along a ray.
    #[inline(always)]
    pub fn ray<K: Kernel>(&self, mut walk: Walk<'_, K>) -> Seen {
        let (mut seen, mut depth) = (Seen::NOTHING, 0.0);
        'ray: while let Some(bundle) = walk.next() {
            let (values, partial) = walk.values(&bundle);
            let colours = self.table.at_all(values, bundle.count);
            let wanted = visible(&colours, bundle.count);
            if wanted == 0 {
                continue;
            }
            let normals = self.to_world.map(|to_world| {
                let [x, y, z] = to_world.normals(walk.gradients(&bundle, &partial, wanted)).0;
                [x.to_array(), y.to_array(), z.to_array()]
            });
            for lane in 0..bundle.count {
                let [.., opacity] = colours[lane];
                if opacity <= 0.0 {
                    continue;
                }
                let part = (1.0 - seen.colour[3]) * opacity;
                for k in 0..3 {
                    seen.colour[k] += part * colours[lane][k];
                }
                if let Some(normals) = &normals {
                    for k in 0..3 {
                        seen.normal[k] += part * normals[k][lane];
                    }
                }
                depth += part * bundle.samples[lane];
                seen.colour[3] += part;
                if seen.colour[3] >= self.opaque {
                    break 'ray;
                }
            }
        }
        if seen.colour[3] > 0.0 {
            seen.depth = depth / seen.colour[3];
        }
        seen
    }
}
