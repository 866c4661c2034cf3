//! Where a point of one frame lies in another, by depth and cameras.
//!
//! Matrices are those of the standard attributes `worldToCamera` and `worldToNDC`, for row vectors: camera coordinates look along -z, normalised
//! device coordinates go from -1 to 1 to the right and upwards.

use crate::Size;

/// Pivots of an equilibrated matrix that are rounding.
const SINGULAR: f64 = 1e-12;

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
        let projection = product(&to_world, world_to_ndc);
        // Only x, y and w are asked of device coordinates: far from the origin their z is nearly w, which says nothing of the camera.
        let ([a, b], [c, d]) = ([projection[0][0], projection[1][0]], [projection[0][1], projection[1][1]]);
        let flat = (a * d - b * c).abs() <= SINGULAR * a.hypot(b) * c.hypot(d);
        if flat || !projection.iter().chain(world_to_ndc).flatten().all(|v| v.is_finite()) {
            return None;
        }
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

/// By Gauss-Jordan with complete pivots, which tell a singular matrix; nothing for one, or one that is not finite.
fn inverse(m: &Matrix) -> Option<Matrix> {
    let (m, rows, columns) = equilibrated(m);
    let mut a: [[f64; 8]; 4] = std::array::from_fn(|r| {
        std::array::from_fn(|c| if c < 4 { m[r][c] } else { f64::from(u8::from(c - 4 == r)) })
    });
    // Which column each row is solved for.
    let mut solved = [None; 4];
    for _ in 0..4 {
        let open = |r: &usize, c: &usize| solved[*r].is_none() && !solved.contains(&Some(*c));
        let places = (0..4).flat_map(|r| (0..4).map(move |c| (r, c))).filter(|(r, c)| open(r, c));
        let (row, column) = places.max_by(|&(i, j), &(k, l)| a[i][j].abs().total_cmp(&a[k][l].abs()))?;
        let head = a[row][column];
        if !head.is_finite() || head.abs() <= SINGULAR {
            return None;
        }
        solved[row] = Some(column);
        a[row].iter_mut().for_each(|v| *v /= head);
        let own = a[row];
        for (_, other) in a.iter_mut().enumerate().filter(|(r, _)| *r != row) {
            let factor = other[column];
            other.iter_mut().zip(own).for_each(|(v, o)| *v -= factor * o);
        }
    }
    let mut found = [[0.0; 4]; 4];
    for (values, column) in a.iter().zip(solved) {
        let column = column?;
        found[column] = std::array::from_fn(|c| columns[column] * values[c + 4] * rows[c]);
    }
    Some(found)
}

/// The matrix with rows and columns of about 1, and their factors: pivots do not depend on the unit of the world, nor on how far
/// its origin is. Powers of two round nothing.
fn equilibrated(m: &Matrix) -> (Matrix, [f64; 4], [f64; 4]) {
    let (mut m, mut rows, mut columns) = (*m, [1.0; 4], [1.0; 4]);
    let factor = |top: f64| if top > 0.0 { (-top.log2().floor()).exp2() } else { 1.0 };
    // What rows do to columns is done when columns have done the same to rows.
    for _ in 0..4 {
        for (row, all) in m.iter_mut().zip(&mut rows) {
            let by = factor(row.iter().fold(0.0, |top: f64, v| top.max(v.abs())));
            *all *= by;
            for v in row {
                *v *= by;
            }
        }
        for (column, all) in columns.iter_mut().enumerate() {
            let by = factor(m.iter().fold(0.0, |top: f64, row| top.max(row[column].abs())));
            *all *= by;
            for row in &mut m {
                row[column] *= by;
            }
        }
    }
    (m, rows, columns)
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

    /// Whether a matrix can be inverted does not depend on the unit of the world, on that of the camera, or on where the origin is.
    #[test]
    fn units_and_origins_keep_no_camera_out() {
        let number = |k: u32| (f64::from(k) * 0.754_877_666).fract() - 0.5;
        for k in 0..200 {
            let (sin, cos) = (40.0 * number(k)).sin_cos();
            let (a, b) = (40.0 * number(k + 1000)).sin_cos();
            let unit = 10_f64.powf(60.0 * number(3 * k));
            let far = unit * 10_f64.powf(7.0 + 14.0 * number(7 * k));
            let rotation = [[cos, sin * b, sin * a], [-sin, cos * b, cos * a], [0.0, -a, b]];
            let mut m = [[0.0; 4]; 4];
            for row in 0..3 {
                m[row][..3].copy_from_slice(&rotation[row].map(|v| unit * v));
                m[3][row] = far * number(11 * k + row as u32);
            }
            m[3][3] = 1.0;
            let one = product(&m, &inverse(&m).unwrap_or_else(|| panic!("{m:?}")));
            for (row, values) in one.iter().enumerate() {
                for (column, value) in values.iter().enumerate() {
                    let size = if row == 3 && column < 3 { far / unit } else { 1.0 };
                    let exact = f64::from(u8::from(row == column));
                    assert!((value - exact).abs() < 1e-13 * size.max(1.0), "{m:?} {one:?}");
                }
            }
            // Two axes of the world are one.
            m[1] = m[0].map(|v| -3.0 * v);
            assert!(inverse(&m).is_none(), "{m:?}");
        }
    }

    #[test]
    fn far_origins_and_narrow_angles_are_those_of_a_camera() {
        let size = Size::new(30, 50);
        for (eye, field) in [
            ([5e5, 5e6, 100.0], 0.7),
            ([1e7, 2e7, 3e7], 0.7),
            ([1.0, 2.0, 3.0], 1e-14),
            ([3e4, 0.0, 5e8], 1e-5),
        ] {
            let own = camera(eye, field, size);
            for place in [[0.0, 0.0], [29.0, 49.0], [12.25, 31.5]] {
                let back = own.place(own.point(place, 50.0, Depth::Ray));
                // Rounding of the eye's coordinates over a pixel at that depth.
                let bound = 1e-9 + 64.0 * f64::EPSILON * eye[2].max(eye[1]) / (50.0 * field / 30.0);
                assert!(
                    (back[0] - place[0]).abs() < bound && (back[1] - place[1]).abs() < bound,
                    "{eye:?} {back:?}"
                );
            }
        }
    }
}
