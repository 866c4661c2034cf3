//! The coarse renderer and the shot that dense AOVs are made with.

use super::camera::Camera;
use super::picture::{Look, Renderer, Shot};

impl Renderer {
    /// The coarse renderer of the same volume, with steps of `step` world units or this one's, if they are longer. No block
    /// that is left out for this one holds anything for the coarse one. Isosurfaces and maxima keep their steps: longer ones
    /// would step over thin surfaces and find other maxima.
    #[must_use]
    pub fn coarse(&self, step: f64) -> Self {
        let own = Self { integral: None, background: [0.0; 4], ..self.clone() };
        if self.look != Look::Dvr {
            return own;
        }
        let step = step.max(self.step);
        Self { look: Look::Dense, table: self.table.longer(step / self.step), step, ..own }
    }
}

/// The shot of a coarse renderer for dense AOVs: every pixel, the first `samples` of the picture's, without shading.
pub fn shot<'a>(camera: &'a Camera, of: &Shot<'_>, samples: u32) -> Shot<'a> {
    Shot {
        camera,
        shader: None,
        size: of.size,
        mask: None,
        samples: samples.min(of.samples),
        seed: of.seed,
        normals: true,
        depth: true,
        gradients: false,
    }
}

#[cfg(test)]
mod tests {
    use crate::picture::Picture;
    use crate::tests::shot;
    use crate::{
        Affine, Camera, Grid, Projection, Renderer, Scene, Stage, Values, dense_shot, prepare, render,
    };

    /// A stage's picture in its own steps, without a background, and its dense AOVs.
    fn both(stage: &Stage, camera: &Camera) -> [Picture; 2] {
        let shader = stage.shader(camera);
        let own = shot(stage, camera, shader.as_ref(), None);
        let fine = Renderer { background: [0.0; 4], ..stage.renderer.clone() };
        let dense = dense_shot(camera, &own, stage.scene().march.dense_samples);
        [render(&fine, &own, &|| true), render(&stage.coarse(), &dense, &|| true)]
    }

    /// Both pictures of a head.
    fn head(march: &str) -> [Picture; 2] {
        let toml = format!(
            "volume=\"procedural:head:48\"\n[march]\ndense-samples=3\n{march}\n[camera]\nzoom=1.8\n[image]\nsize=[60, 50]\n\
             samples=3\nbackground=[1.0, 1.0, 1.0, 1.0]\n"
        );
        let stage =
            prepare(&Scene::parse(&toml, &[]).unwrap(), std::path::Path::new(""), &crate::Limits::default())
                .unwrap();
        both(&stage, &stage.camera(0).unwrap())
    }

    fn cosine(a: &Picture, b: &Picture, at: usize) -> f32 {
        (0..3).map(|k| a.normal[k][at] * b.normal[k][at]).sum()
    }

    #[test]
    fn steps_of_one_length_see_the_same() {
        let [own, dense] = head("step=1.0\ndense-step=0.25");
        let mut seen = 0;
        for at in 0..3000 {
            let (a, b) = (own.colour[3][at], dense.colour[3][at]);
            // A table's entry may differ in its last digit, in each of some 100 samples.
            assert!((a - b).abs() <= 100.0 * f32::EPSILON, "{a} {b}");
            assert_eq!(dense.depth[at].is_finite(), b > 0.0);
            let normal = (0..3).map(|k| own.normal[k][at].abs()).sum::<f32>();
            if a > 0.01 && normal > 0.0 {
                seen += 1;
                assert!(cosine(&own, &dense, at) > 0.999, "{at}");
            }
        }
        assert!(seen > 500, "{seen}");
    }

    /// Both are the means of the same samples' colours, so that only the order of sums differs.
    #[test]
    fn albedo_is_the_picture_without_light() {
        for march in ["step=1.0", "mode=\"iso\"", "mode=\"mip\""] {
            let [own, dense] = head(&format!("{march}\n[shading]\nenabled=false"));
            let [_, other] = head(march);
            assert_eq!(dense, other, "{march}: light changes it");
            let mut most = 0.0_f32;
            for (own, dense) in own.colour.iter().zip(&dense.colour) {
                assert!(dense.iter().any(|value| *value > 0.1), "{march}");
                let apart = own.iter().zip(dense).map(|(a, b)| (a - b).abs());
                most = apart.fold(most, f32::max);
            }
            assert!(most <= 100.0 * f32::EPSILON, "{march}: {most}");
        }
    }

    #[test]
    fn longer_steps_see_nearly_the_same_and_shorter_ones_more_of_it() {
        let errors = [1.0, 0.25].map(|step| {
            let [own, dense] = head(&format!("step=0.0625\ndense-step={step:?}"));
            let one = |at: usize| (own.colour[3][at] - dense.colour[3][at]).abs();
            let turned = |at: usize| own.colour[3][at] * (1.0 - cosine(&own, &dense, at));
            [(0..3000).map(one).sum::<f32>(), (0..3000).map(turned).sum::<f32>()]
        });
        for k in 0..2 {
            assert!(errors[0][k] > 0.0 && errors[1][k] < 0.5 * errors[0][k], "{errors:?}");
        }
    }

    #[test]
    fn the_mean_distance_through_a_constant_cube_has_its_closed_form() {
        let grid = Grid::new([17; 3], &Values::F32(vec![1.0; 17 * 17 * 17]), Affine::spacing([1.0; 3]));
        let toml = "[transfer]\ndomain=[0.0, 1.0]\ncolour=[[0.0, 0.5, 0.25, 1.0]]\nopacity=[[0.0, 0.1]]\n\
                    [march]\nopaque=1.0\nstep=0.5\n[image]\nsize=[4, 4]";
        let scene = Scene::parse(toml, &[]).unwrap();
        let stage = crate::stage::prepare_grid(&scene, grid.unwrap(), std::path::Path::new(""));
        let mut camera = Camera::look_at([8.0, 8.0, 40.0], [8.0, 8.0, 8.0], [0.0, 1.0, 0.0], 0.05).unwrap();
        camera.projection = Projection::Orthographic;
        let [_, dense] = both(&stage.unwrap(), &camera);
        // Samples 0 to 16 voxels behind the entry, which is 24 away, each with a tenth of what is left.
        let share = |i: i32| 0.1 * 0.9_f64.powi(i);
        let alpha: f64 = (0..17).map(share).sum();
        let depth = 24.0 + (0..17).map(|i| f64::from(i) * share(i)).sum::<f64>() / alpha;
        let epsilon = f64::from(f32::EPSILON);
        for at in 0..16 {
            assert!((f64::from(dense.colour[3][at]) - alpha).abs() < 17.0 * 4.0 * epsilon);
            assert!(
                (f64::from(dense.depth[at]) - depth).abs() < 17.0 * 32.0 * epsilon,
                "{}",
                dense.depth[at]
            );
        }
    }

    #[test]
    fn thin_surfaces_and_maxima_lie_where_the_picture_shows_them() {
        for mode in ["iso", "mip"] {
            let toml = format!(
                "volume=\"procedural:vessels:64\"\n[march]\nmode=\"{mode}\"\nstep=0.125\n\
                 [camera]\nzoom=1.8\n[image]\nsize=[60, 50]\n"
            );
            let stage = prepare(
                &Scene::parse(&toml, &[]).unwrap(),
                std::path::Path::new(""),
                &crate::Limits::default(),
            );
            let stage = stage.unwrap();
            let [own, dense] = both(&stage, &stage.camera(0).unwrap());
            assert!(own.depth.iter().filter(|depth| depth.is_finite()).count() > 150, "{mode}");
            assert!((own.depth == dense.depth) && (own.normal == dense.normal), "{mode}");
            assert_eq!(own.colour[3], dense.colour[3], "{mode}");
        }
    }
}
