//! Dense AOVs: what a coarse march without shading tells of every pixel, to steer the filling of the others' colour.
//!
//! Front to back as [`super::march`], in longer steps: alpha, and the mean normal and the mean distance, samples weighted by
//! what they add to alpha. Isosurfaces and maxima are sought in the same long steps.

use super::camera::Camera;
use super::kernel::Kernel;
use super::march::{Seen, visible};
use super::picture::{Look, Renderer, Shot};
use super::shade::Shader;
use super::transfer::Table;
use super::vector::length;
use super::walk::Walk;

/// What the coarse march needs besides the walk.
#[derive(Clone, Copy, Debug)]
pub struct Dense<'a> {
    /// The transfer function.
    pub table: &'a Table,
    /// Where normals come from; none leaves them 0.
    pub shader: Option<&'a Shader>,
    /// The march ends at this opacity.
    pub opaque: f32,
}

impl Dense<'_> {
    /// Marches along a ray; only alpha of the colour is told.
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
            let normals = self.shader.map(|shader| {
                let [x, y, z] = shader.normals(walk.gradients(&bundle, &partial, wanted)).0;
                [x.to_array(), y.to_array(), z.to_array()]
            });
            for lane in 0..bundle.count {
                let opacity = colours[lane][3];
                if opacity <= 0.0 {
                    continue;
                }
                let part = (1.0 - seen.colour[3]) * opacity;
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

impl Renderer {
    /// The coarse renderer of the same volume, with steps of `step` world units or this one's, if they are longer. No block
    /// that is left out for this one holds anything for the coarse one.
    #[must_use]
    pub fn coarse(&self, step: f64) -> Self {
        let rows = self.grid.placement().inverse_rows();
        let steepest = rows.into_iter().map(length).fold(0.0, f64::max);
        // A surface must not be stepped over: see where the blocks are made.
        let most = if matches!(self.look, Look::Iso(..)) { (1.0 - 1e-9) / steepest } else { f64::INFINITY };
        let step = step.min(most).max(self.step);
        Self {
            look: if self.look == Look::Dvr { Look::Dense } else { self.look },
            table: if self.look == Look::Mip {
                self.table.clone()
            } else {
                self.table.longer(step / self.step)
            },
            integral: None,
            step,
            background: [0.0; 4],
            ..self.clone()
        }
    }
}

/// The shot of a coarse renderer for dense AOVs: every pixel, one sample through its centre.
pub fn shot<'a>(camera: &'a Camera, shader: Option<&'a Shader>, of: &Shot<'_>) -> Shot<'a> {
    Shot {
        camera,
        shader,
        size: of.size,
        mask: None,
        samples: 1,
        seed: 0,
        normals: true,
        depth: true,
        gradients: false,
    }
}

#[cfg(test)]
mod tests {
    use crate::volume::{Scene, dense_shot, prepare, render};

    /// Alpha, normal and depth against those of a march in the scene's own steps.
    #[test]
    fn the_coarse_march_sees_what_the_fine_one_sees() {
        for (mode, step) in [("dvr", 0.125), ("dvr", 1.0), ("iso", 0.5), ("mip", 0.5)] {
            let toml = format!(
                "volume=\"procedural:head:48\"\n[march]\nmode=\"{mode}\"\nstep={step:?}\ndense-step=1.0\n\
                 depth-opacity=0.5\n[image]\nsize=[60, 50]\nbackground=[1.0, 1.0, 1.0, 1.0]\n"
            );
            let stage = prepare(&Scene::parse(&toml, &[]).unwrap(), std::path::Path::new("")).unwrap();
            let camera = stage.camera(0).unwrap();
            let shader = stage.shader(&camera);
            let own = crate::volume::Shot {
                camera: &camera,
                shader: shader.as_ref(),
                size: stage.size(),
                mask: None,
                samples: 1,
                seed: 0,
                normals: true,
                depth: true,
                gradients: false,
            };
            let fine = crate::volume::Renderer { background: [0.0; 4], ..stage.renderer.clone() };
            let (fine, dense) = (
                render(&fine, &own, &|| true),
                render(&stage.coarse(), &dense_shot(&camera, shader.as_ref(), &own), &|| true),
            );
            let (mut sum, mut turned, mut hits) = (0.0, 0, 0);
            for at in 0..stage.size().pixels() {
                let [a, b] = [&fine, &dense].map(|picture| picture.colour[3][at]);
                sum += f64::from((a - b).abs());
                assert_eq!(dense.depth[at].is_finite(), b > 0.0, "{mode}");
                if a > 0.9 && b > 0.9 && mode != "mip" {
                    hits += 1;
                    let cosine: f32 = (0..3).map(|k| fine.normal[k][at] * dense.normal[k][at]).sum();
                    turned += usize::from(cosine < 0.9);
                    assert!((fine.depth[at] - dense.depth[at]).abs() < 24.0, "{mode}: within the head");
                }
            }
            let mean = sum / stage.size().pixels() as f64;
            // Steps of the same length and a surface give the same alpha but for edges.
            let bound = if step == 1.0 { 1e-6 } else { 0.02 };
            assert!(mean < bound, "{mode} {step}: {mean}");
            assert!(mode == "mip" || (hits > 200 && turned < hits / 10), "{mode} {step}: {turned} of {hits}");
        }
    }
}
