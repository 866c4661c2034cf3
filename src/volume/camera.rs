//! The camera: which ray belongs to which point of the image.
//!
//! The image plane stands at distance 1 before the eye; its height is `field`, so that the angle of view is
//! `2 atan(field / 2)`; pixels are square. An orthographic camera sends parallel rays from a plane of height
//! `field * distance` through the eye, so that both show the target at one size.

use lacuna_core::Size;

use super::Error;
use super::vector::{Affine, Vector, add, cross, dot, length, normalise, scale, subtract};

/// How rays leave the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Projection {
    /// All from the eye.
    #[default]
    Perspective,
    /// All in one direction.
    Orthographic,
}

/// A camera in world coordinates; `right`, `up`, `forward` have length 1 and are perpendicular.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Where it stands.
    pub eye: Vector,
    /// Along the view.
    pub forward: Vector,
    /// Along the rows, to larger columns.
    pub right: Vector,
    /// Against the columns.
    pub up: Vector,
    /// Height of the image plane at distance 1.
    pub field: f64,
    /// Distance to the target.
    pub distance: f64,
    /// How rays leave.
    pub projection: Projection,
}

/// A ray in world coordinates; the direction has length 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it begins.
    pub origin: Vector,
    /// Where it goes.
    pub direction: Vector,
}

impl Camera {
    /// A camera at `eye` that looks at `target`, `up` roughly upwards.
    ///
    /// # Errors
    /// [`Error::Scene`] if the directions do not make a camera.
    pub fn look_at(eye: Vector, target: Vector, up: Vector, field: f64) -> Result<Self, Error> {
        let view = subtract(target, eye);
        let forward = normalise(view);
        let right = normalise(cross(forward, up));
        let camera = Self {
            eye,
            forward,
            right,
            up: cross(right, forward),
            field,
            distance: length(view),
            projection: Projection::Perspective,
        };
        let finite = [eye, forward, right].iter().flatten().all(|part| part.is_finite());
        if !finite || length(right) < 0.5 || !(field > 0.0 && field.is_finite()) {
            return Err(Error::Scene(
                "camera: eye and target must differ, up must not point along the view, the field must be above 0".into(),
            ));
        }
        Ok(camera)
    }

    /// A camera on a sphere of radius `distance` around `target`: azimuth 0 and elevation 0 look along -z with y upwards,
    /// azimuth turns towards +x, elevation towards +y; in degrees.
    ///
    /// # Errors
    /// As [`Camera::look_at`].
    pub fn around(
        target: Vector,
        distance: f64,
        azimuth: f64,
        elevation: f64,
        field: f64,
    ) -> Result<Self, Error> {
        let (az, el) = (azimuth.to_radians(), elevation.to_radians());
        let back = [az.sin() * el.cos(), el.sin(), az.cos() * el.cos()];
        // Straight from above or below there is no other upwards than along the azimuth.
        let pole = el.cos().abs() < 1e-9;
        let up = if pole { [-az.sin() * el.sin(), 0.0, -az.cos() * el.sin()] } else { [0.0, 1.0, 0.0] };
        Self::look_at(add(target, scale(back, distance)), target, up, field)
    }

    /// The ray through a point of an image of that size; x to the right and y down, in pixels from the corner.
    pub fn ray(&self, size: Size, x: f64, y: f64) -> Ray {
        let (width, height) = (size.width as f64, size.height as f64);
        let sx = (x - 0.5 * width) / height * self.field;
        let sy = (0.5 * height - y) / height * self.field;
        let across = add(scale(self.right, sx), scale(self.up, sy));
        match self.projection {
            Projection::Perspective => {
                Ray { origin: self.eye, direction: normalise(add(self.forward, across)) }
            }
            Projection::Orthographic => {
                Ray { origin: add(self.eye, scale(across, self.distance)), direction: self.forward }
            }
        }
    }

    /// World to camera coordinates: x right, y up, looking along -z; rows as EXR has them, for row vectors.
    pub fn world_to_camera(&self) -> [[f64; 4]; 4] {
        let back = scale(self.forward, -1.0);
        let axes = [self.right, self.up, back];
        let mut matrix = [[0.0; 4]; 4];
        for (column, axis) in axes.into_iter().enumerate() {
            for row in 0..3 {
                matrix[row][column] = axis[row];
            }
            matrix[3][column] = -dot(axis, self.eye);
        }
        matrix[3][3] = 1.0;
        matrix
    }

    /// World to normalised device coordinates, for row vectors and after division by w: -1 to 1 from left to right and
    /// from the bottom to the top; z grows with the distance, 0 in the eye's plane for an orthographic camera, and is
    /// `1 - 1 / distance` for a perspective one.
    pub fn world_to_ndc(&self, size: Size) -> [[f64; 4]; 4] {
        let half = 0.5 * self.field;
        let (x, y) = (half * size.width as f64 / size.height as f64, half);
        let projection = match self.projection {
            Projection::Perspective => [
                [x.recip(), 0.0, 0.0, 0.0],
                [0.0, y.recip(), 0.0, 0.0],
                [0.0, 0.0, -1.0, -1.0],
                [0.0, 0.0, -1.0, 0.0],
            ],
            Projection::Orthographic => [
                [(x * self.distance).recip(), 0.0, 0.0, 0.0],
                [0.0, (y * self.distance).recip(), 0.0, 0.0],
                [0.0, 0.0, -1.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
            ],
        };
        let camera = self.world_to_camera();
        let mut product = [[0.0; 4]; 4];
        for (row, out) in camera.iter().zip(&mut product) {
            for (column, value) in out.iter_mut().enumerate() {
                *value = (0..4).map(|k| row[k] * projection[k][column]).sum();
            }
        }
        product
    }
}

/// The part of a ray within the box of a volume, in index coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Where the ray enters.
    pub entry: Vector,
    /// Index steps per world unit along the ray.
    pub direction: Vector,
    /// World distance from the ray's origin to the entry.
    pub start: f64,
    /// World length within the box.
    pub length: f64,
}

impl Segment {
    /// How many samples there are in steps of `step` world units from the entry on.
    #[inline(always)]
    pub fn samples(&self, step: f64) -> u32 {
        // Entry and exit are told from the eye, each to some units in the last place of its distance: a sample at the exit must not be
        // lost to that.
        let rounding = 16.0 * f64::EPSILON * (self.start + self.length);
        ((self.length + rounding) / step).min(1e9) as u32 + 1
    }
}

/// The part of a ray within the box `[0, last]`; nothing if it misses the box or leaves it behind.
pub fn clip(ray: &Ray, placement: &Affine, last: Vector) -> Option<Segment> {
    let rows = placement.inverse_rows();
    let index = |v: Vector| [dot(rows[0], v), dot(rows[1], v), dot(rows[2], v)];
    let origin = index(subtract(ray.origin, placement.origin));
    let direction = index(ray.direction);
    let (mut near, mut far) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        if direction[axis] == 0.0 {
            if origin[axis] < 0.0 || origin[axis] > last[axis] {
                return None;
            }
            continue;
        }
        let [a, b] = [0.0, last[axis]].map(|plane| (plane - origin[axis]) / direction[axis]);
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    (near <= far).then(|| Segment {
        entry: add(origin, scale(direction, near)),
        direction,
        start: near,
        length: far - near,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row_times(p: Vector, m: &[[f64; 4]; 4]) -> Vector {
        let v = [p[0], p[1], p[2], 1.0];
        let out: [f64; 4] = std::array::from_fn(|c| (0..4).map(|k| v[k] * m[k][c]).sum());
        [out[0] / out[3], out[1] / out[3], out[2] / out[3]]
    }

    #[test]
    fn matrices_agree_with_the_rays() {
        let size = Size::new(30, 50);
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let camera =
                Camera { projection, ..Camera::around([1.0, 2.0, 3.0], 10.0, 35.0, 25.0, 0.7).unwrap() };
            for (x, y) in [(0.0, 0.0), (50.0, 30.0), (13.5, 20.5)] {
                let ray = camera.ray(size, x, y);
                let point = add(ray.origin, scale(ray.direction, 7.0));
                let ndc = row_times(point, &camera.world_to_ndc(size));
                assert!((ndc[0] - (x / 25.0 - 1.0)).abs() < 1e-12, "{projection:?}");
                assert!((ndc[1] - (1.0 - y / 15.0)).abs() < 1e-12);
                assert!(row_times(point, &camera.world_to_camera())[2] < 0.0);
            }
            let target = row_times([1.0, 2.0, 3.0], &camera.world_to_camera());
            assert!((target[2] + 10.0).abs() < 1e-12 && target[0].abs() < 1e-12);
        }
    }

    #[test]
    fn rays_are_cut_at_the_box() {
        let placement =
            Affine { origin: [1.0, 0.0, 0.0], axes: [[2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] };
        let ray = Ray { origin: [-9.0, 1.0, 1.0], direction: [1.0, 0.0, 0.0] };
        let segment = clip(&ray, &placement, [4.0, 2.0, 2.0]).unwrap();
        assert_eq!((segment.start, segment.length), (10.0, 8.0));
        assert_eq!((segment.entry, segment.direction), ([0.0, 1.0, 1.0], [0.5, 0.0, 0.0]));
        assert!(clip(&Ray { origin: [-9.0, 3.0, 1.0], ..ray }, &placement, [4.0, 2.0, 2.0]).is_none());
        assert!(clip(&Ray { origin: [20.0, 1.0, 1.0], ..ray }, &placement, [4.0, 2.0, 2.0]).is_none());
    }

    #[test]
    fn what_is_no_camera_is_refused() {
        assert!(Camera::look_at([0.0; 3], [0.0; 3], [0.0, 1.0, 0.0], 1.0).is_err());
        assert!(Camera::look_at([0.0; 3], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], 1.0).is_err());
        assert!(Camera::look_at([0.0; 3], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], 0.0).is_err());
        assert!(Camera::around([0.0; 3], 1.0, 20.0, 90.0, 1.0).is_ok());
    }

    #[test]
    fn both_ends_are_samples_where_steps_divide_the_length() {
        for (spacing, corner) in
            [(1.0, 0.0), (0.7, -100.0), (0.1, 0.0), (0.3, 5.0), (0.15, 37.7), (0.1, 1e5), (1e3, 0.1)]
        {
            let placement = Affine { origin: [corner; 3], ..Affine::spacing([spacing; 3]) };
            let middle = placement.point([8.0; 3]);
            for (axis, away) in (0..3).flat_map(|axis| [1.3, 25.7, 1234.5].map(|away| (axis, away))) {
                let (mut eye, mut up) = (middle, [0.0; 3]);
                eye[axis] += away * 17.0 * spacing;
                up[(axis + 1) % 3] = 1.0;
                let camera = Camera::look_at(eye, middle, up, 1e-3).unwrap();
                let camera = Camera { projection: Projection::Orthographic, ..camera };
                let ray = camera.ray(Size::new(3, 3), 1.2, 1.7);
                let segment = clip(&ray, &placement, [16.0; 3]).unwrap();
                for (step, samples) in
                    [(0.5, 33), (0.25, 65), (0.2, 81), (0.3, 54), (16.0, 2), (17.0, 1), (15.9, 2)]
                {
                    assert_eq!(
                        segment.samples(step * spacing),
                        samples,
                        "{spacing} {corner} {axis} {away} {step}"
                    );
                }
            }
        }
    }
}
