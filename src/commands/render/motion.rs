//! Where what a pixel shows lies in the next frame, by its distance and both cameras.

use lacuna_exr::{Frame, Samples};
use lacuna_filters::Size;
use lacuna_filters::temporal::camera::{self, Depth};
use lacuna_volume::Camera;

use super::picture::channel;
use crate::channels;

/// Across and down.
const NAMES: [&str; 2] = ["motion.X", "motion.Y"];

/// Adds the vectors of all pixels, in pixels to the next frame, y down; `depths` are along rays, infinite where nothing is seen.
///
/// # Errors
/// Where motion cannot be told.
pub fn add(
    frame: &mut Frame,
    depths: &[f32],
    (camera, next): (&Camera, &Camera),
) -> Result<(), &'static str> {
    let Some(part) = frame.parts.first_mut() else { return Ok(()) };
    let planes = vectors(part.size(), depths, (camera, next)).ok_or(
        "--motion: the camera's matrices cannot be inverted: move camera and volume nearer to the origin, or widen the angle",
    )?;
    part.channels
        .extend(NAMES.into_iter().zip(planes).map(|(name, plane)| channel(name, Samples::Float(plane))));
    channels::list_dense(part, NAMES);
    Ok(())
}

/// Across and down, 0 where nothing is seen, infinite behind the next camera; nothing if a camera cannot be inverted.
fn vectors(size: Size, depths: &[f32], (camera, next): (&Camera, &Camera)) -> Option<[Vec<f32>; 2]> {
    let mut planes = [vec![0.0; size.pixels()], vec![0.0; size.pixels()]];
    let seen =
        |camera: &Camera| camera::Camera::new(&camera.world_to_camera(), &camera.world_to_ndc(size), size);
    let (here, there) = (seen(camera)?, seen(next)?);
    if here.is_same(&there) {
        return Some(planes);
    }
    for (at, depth) in depths.iter().enumerate().filter(|(_, depth)| depth.is_finite()) {
        let place = [at / size.width, at % size.width].map(|at| at as f64);
        let moved = there.place(here.point(place, f64::from(*depth), Depth::Ray));
        // Not NaN: readers of vectors take both for unknown, but a guide may be infinite.
        let known = |v: f64| if v.is_nan() { f32::INFINITY } else { v as f32 };
        planes[0][at] = known(moved[1] - place[1]);
        planes[1][at] = known(moved[0] - place[0]);
    }
    Some(planes)
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
            let [across, down] = vectors(size, &depths, (&camera(0.0), &camera(0.1))).unwrap();
            // 0.1 of the world is 40 * 0.1 / depth pixels.
            assert!((across[middle] - off).abs() < 1e-3 && down[middle].abs() < 1e-5, "{}", across[middle]);
            assert!(across.iter().enumerate().all(|(at, v)| at == middle || *v == 0.0));
        }
        let [across, down] = vectors(size, &vec![1.0; size.pixels()], (&camera(0.3), &camera(0.3))).unwrap();
        assert!(across.iter().chain(&down).all(|v| *v == 0.0));
    }

    #[test]
    fn what_lies_behind_the_next_camera_moves_nobody_knows_where() {
        let size = Size::new(8, 8);
        let camera = |z: f64| Camera::look_at([0.0, 0.0, z], [0.0; 3], [0.0, 1.0, 0.0], 1.0).unwrap();
        let mut depths = vec![2.0; size.pixels()];
        depths[9] = f32::INFINITY;
        for plane in vectors(size, &depths, (&camera(10.0), &camera(5.0))).unwrap() {
            assert!(plane.iter().enumerate().all(|(at, v)| *v == if at == 9 { 0.0 } else { f32::INFINITY }));
        }
    }

    #[test]
    fn motion_does_not_depend_on_where_the_origin_is() {
        let size = Size::new(40, 40);
        let depths = vec![10.0; size.pixels()];
        let motion = |[x, y, z]: [f64; 3], field: f64| {
            let camera = |by: f64| {
                Camera::look_at([x + by, y, z + 10.0], [x + by, y, z], [0.0, 1.0, 0.0], field).unwrap()
            };
            vectors(size, &depths, (&camera(0.0), &camera(0.1 * field)))
        };
        let near = motion([0.0; 3], 1.0).unwrap();
        for origin in [[5e5, 5e6, 100.0], [-1e8, 3e7, 2e8]] {
            let far = motion(origin, 1.0).unwrap();
            for (far, near) in far.iter().flatten().zip(near.iter().flatten()) {
                assert!((far - near).abs() < 1e-4, "{origin:?}: {far} {near}");
            }
        }
        // A tenth of the plane's height at distance 1 is 40 * 0.1 / 10 pixels at the depth.
        let [across, down] = motion([0.0; 3], 1e-10).unwrap();
        assert!(across.iter().all(|v| (v + 0.4).abs() < 1e-4) && down.iter().all(|v| v.abs() < 1e-4));
        assert!(motion([0.0; 3], 1e-309).is_none());
    }
}
