//! Where a point of one frame lies in another, by depth and cameras.
//!
//! Matrices are those of the standard attributes `worldToCamera` and `worldToNDC`, for row vectors: camera coordinates look along -z, normalised
//! device coordinates go from -1 to 1 to the right and upwards.

use crate::Size;

/// A matrix for row vectors.
pub type Matrix = [[f64; 4]; 4];

/// What depth is measured along.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// The ray, from the eye.
    Ray,
    /// The view, from the eye's plane.
    Plane,
}

/// A camera on an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    to_ndc: Matrix,
    to_world: Matrix,
    /// Camera to device coordinates.
    projection: Matrix,
    size: Size,
}

impl Camera {
    /// Nothing if the matrices are not those of a camera.
    pub fn new(world_to_camera: &Matrix, world_to_ndc: &Matrix, size: Size) -> Option<Self> {
        let to_world = inverse(world_to_camera)?;
        inverse(world_to_ndc)?;
        let projection = product(&to_world, world_to_ndc);
        Some(Self { to_ndc: *world_to_ndc, to_world, projection, size })
    }

    /// Whether both show the same.
    pub fn is_same(&self, other: &Self) -> bool {
        self == other
    }

    /// The point in homogeneous world coordinates that row and column show at this depth; NaN if there is none.
    pub fn point(&self, [row, column]: [f64; 2], depth: f64, along: Depth) -> [f64; 4] {
        let x = 2.0 * (column + 0.5) / self.size.width as f64 - 1.0;
        let y = 1.0 - 2.0 * (row + 0.5) / self.size.height as f64;
        let (near, far) = (self.at_plane(x, y, 1.0), self.at_plane(x, y, 2.0));
        let direction = [far[0] - near[0], far[1] - near[1], -1.0];
        // Where the line meets the eye's plane.
        let start = [near[0] - direction[0], near[1] - direction[1], 0.0];
        let length = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
        let steps = if along == Depth::Ray { depth / length } else { depth };
        let camera = if depth.is_infinite() && depth > 0.0 {
            [direction[0], direction[1], direction[2], 0.0]
        } else {
            [start[0] + steps * direction[0], start[1] + steps * direction[1], -steps, 1.0]
        };
        times(camera, &self.to_world)
    }

    /// The point of the plane at this distance that these device coordinates show, in camera coordinates.
    fn at_plane(&self, x: f64, y: f64, distance: f64) -> [f64; 2] {
        let p = &self.projection;
        // (c P)_x = x (c P)_w, the same for y, with c = (X, Y, -distance, 1).
        let rest = |k: usize| p[3][k] - distance * p[2][k];
        let row =
            |k: usize, at: f64| [p[0][k] - at * p[0][3], p[1][k] - at * p[1][3], at * rest(3) - rest(k)];
        let ([a, b, e], [c, d, f]) = (row(0, x), row(1, y));
        let determinant = a * d - b * c;
        [(e * d - b * f) / determinant, (a * f - e * c) / determinant]
    }

    /// Row and column of a point; NaN behind the camera.
    pub fn place(&self, world: [f64; 4]) -> [f64; 2] {
        let [x, y, _, w] = times(world, &self.to_ndc);
        if w.is_nan() || w <= 0.0 {
            return [f64::NAN; 2];
        }
        let row = (1.0 - y / w) * 0.5 * self.size.height as f64 - 0.5;
        let column = (x / w + 1.0) * 0.5 * self.size.width as f64 - 0.5;
        [row, column]
    }
}

fn times(v: [f64; 4], m: &Matrix) -> [f64; 4] {
    std::array::from_fn(|c| (0..4).map(|k| v[k] * m[k][c]).sum())
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|r| times(a[r], b))
}

/// By Gauss-Jordan with pivots; nothing if it is singular or not finite.
fn inverse(m: &Matrix) -> Option<Matrix> {
    let mut a: [[f64; 8]; 4] = std::array::from_fn(|r| {
        std::array::from_fn(|c| if c < 4 { m[r][c] } else { f64::from(u8::from(c - 4 == r)) })
    });
    let scale = m.iter().flatten().fold(0.0, |top: f64, v| top.max(v.abs()));
    for column in 0..4 {
        let pivot = (column..4).max_by(|&i, &j| a[i][column].abs().total_cmp(&a[j][column].abs()))?;
        if !a[pivot][column].is_finite() || a[pivot][column].abs() <= 1e-12 * scale {
            return None;
        }
        a.swap(column, pivot);
        let head = a[column][column];
        a[column].iter_mut().for_each(|v| *v /= head);
        let own = a[column];
        for (_, row) in a.iter_mut().enumerate().filter(|(r, _)| *r != column) {
            let factor = row[column];
            row.iter_mut().zip(own).for_each(|(v, o)| *v -= factor * o);
        }
    }
    Some(std::array::from_fn(|r| std::array::from_fn(|c| a[r][c + 4])))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera at `eye` that looks along -z, with square pixels and an image plane at distance 1 that is `field` high.
    fn camera(eye: [f64; 3], field: f64, size: Size) -> Camera {
        let mut view =
            [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        view[3] = [-eye[0], -eye[1], -eye[2], 1.0];
        let (x, y) = (0.5 * field * size.width as f64 / size.height as f64, 0.5 * field);
        let projection = [
            [1.0 / x, 0.0, 0.0, 0.0],
            [0.0, 1.0 / y, 0.0, 0.0],
            [0.0, 0.0, -1.0, -1.0],
            [0.0, 0.0, -1.0, 0.0],
        ];
        Camera::new(&view, &product(&view, &projection), size).unwrap()
    }

    #[test]
    fn points_come_back_to_their_pixels() {
        let own = camera([1.0, 2.0, 3.0], 0.7, Size::new(30, 50));
        for along in [Depth::Ray, Depth::Plane] {
            for place in [[0.0, 0.0], [29.0, 49.0], [12.25, 31.5]] {
                let back = own.place(own.point(place, 5.0, along));
                assert!((back[0] - place[0]).abs() < 1e-9 && (back[1] - place[1]).abs() < 1e-9);
                let far = own.place(own.point(place, f64::INFINITY, along));
                assert!((far[0] - place[0]).abs() < 1e-9 && (far[1] - place[1]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_camera_that_moves_sideways_moves_points_by_their_depth() {
        let size = Size::new(40, 40);
        let (a, b) = (camera([0.0; 3], 1.0, size), camera([0.1, 0.0, 0.0], 1.0, size));
        for depth in [1.0, 2.0, 8.0] {
            let [row, column] = b.place(a.point([19.5, 19.5], depth, Depth::Plane));
            // 0.1 of the world is 40 * 0.1 / depth pixels.
            assert!((row - 19.5).abs() < 1e-9 && (column - (19.5 - 4.0 / depth)).abs() < 1e-9, "{depth}");
        }
        // Off the axis, the way along the ray is longer than that along the view.
        let ray = b.place(a.point([19.5, 39.5], 1.25_f64.sqrt(), Depth::Ray));
        let plane = b.place(a.point([19.5, 39.5], 1.0, Depth::Plane));
        assert!((ray[1] - plane[1]).abs() < 1e-9);
        assert!(b.place([0.0, 0.0, 5.0, 1.0])[0].is_nan());
    }

    #[test]
    fn what_is_no_camera_is_refused() {
        let zero = [[0.0; 4]; 4];
        let mut one = zero;
        (0..4).for_each(|k| one[k][k] = 1.0);
        assert!(Camera::new(&zero, &one, Size::new(2, 2)).is_none());
        assert!(Camera::new(&one, &zero, Size::new(2, 2)).is_none());
        assert!(Camera::new(&[[f64::NAN; 4]; 4], &one, Size::new(2, 2)).is_none());
        assert!(Camera::new(&one, &one, Size::new(2, 2)).is_some());
    }
}
