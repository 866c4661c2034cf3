//! Where what a pixel shows lies in the next frame, by its distance and both cameras.

use lacuna_exr::{Frame, Samples};
use lacuna_filters::Size;
use lacuna_filters::temporal::camera::{self, Depth};
use lacuna_volume::Camera;

use super::picture::{channel, list_dense};

/// Across and down.
const NAMES: [&str; 2] = ["motion.X", "motion.Y"];

/// Adds the vectors of all pixels, in pixels to the next frame, y down; `depths` are along rays, infinite where nothing is seen.
pub fn add(frame: &mut Frame, depths: &[f32], (camera, next): (&Camera, &Camera)) {
    let Some(part) = frame.parts.first_mut() else { return };
    let planes = vectors(part.size(), depths, (camera, next));
    part.channels
        .extend(NAMES.into_iter().zip(planes).map(|(name, plane)| channel(name, Samples::Float(plane))));
    list_dense(part, &NAMES);
}

/// Across and down; 0 where nothing is seen, or that cannot be told.
fn vectors(size: Size, depths: &[f32], (camera, next): (&Camera, &Camera)) -> [Vec<f32>; 2] {
    let mut planes = [vec![0.0; size.pixels()], vec![0.0; size.pixels()]];
    let seen =
        |camera: &Camera| camera::Camera::new(&camera.world_to_camera(), &camera.world_to_ndc(size), size);
    let (Some(here), Some(there)) = (seen(camera), seen(next)) else { return planes };
    if here.is_same(&there) {
        return planes;
    }
    for (at, depth) in depths.iter().enumerate().filter(|(_, depth)| depth.is_finite()) {
        let place = [at / size.width, at % size.width].map(|at| at as f64);
        let moved = there.place(here.point(place, f64::from(*depth), Depth::Ray));
        if moved.iter().all(|at| at.is_finite()) {
            planes[0][at] = (moved[1] - place[1]) as f32;
            planes[1][at] = (moved[0] - place[0]) as f32;
        }
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_nearer_moves_farther_and_nothing_stays() {
        let size = Size::new(40, 40);
        let camera = |x: f64| Camera::look_at([x, 0.0, 10.0], [x, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0).unwrap();
        let mut depths = vec![f32::INFINITY; size.pixels()];
        // Beside the axis by half a pixel: as good as on it.
        let middle = 20 * size.width + 20;
        for (depth, off) in [(2.0_f32, -2.0_f32), (8.0, -0.5)] {
            depths[middle] = depth;
            let [across, down] = vectors(size, &depths, (&camera(0.0), &camera(0.1)));
            // 0.1 of the world is 40 * 0.1 / depth pixels.
            assert!((across[middle] - off).abs() < 1e-3 && down[middle].abs() < 1e-5, "{}", across[middle]);
            assert!(across.iter().enumerate().all(|(at, v)| at == middle || *v == 0.0));
        }
        let [across, down] = vectors(size, &vec![1.0; size.pixels()], (&camera(0.3), &camera(0.3)));
        assert!(across.iter().chain(&down).all(|v| *v == 0.0));
    }
}
