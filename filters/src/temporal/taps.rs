//! Cubic interpolation of planes between their pixels.

use crate::{Plane, Size};

/// The pixels around a place and what they weigh.
pub(crate) struct Taps {
    rows: Axis,
    columns: Axis,
}

/// Four pixels along one axis, and their weights.
struct Axis {
    at: [usize; 4],
    weights: [f32; 4],
    /// Whether they are beside each other.
    beside: bool,
}

impl Taps {
    /// Places beyond the outermost pixels are theirs.
    pub fn new(size: Size, y: f32, x: f32) -> Self {
        Self { rows: Axis::new(y, size.height), columns: Axis::new(x, size.width) }
    }

    /// The value of a plane.
    pub fn of(&self, plane: &Plane) -> f32 {
        let (rows, columns) = (&self.rows, &self.columns);
        if !(rows.beside && columns.beside) {
            let row = |row: usize| columns.mean(columns.at.map(|column| plane.at(row, column)));
            return rows.mean(rows.at.map(row));
        }
        let width = plane.size().width;
        let mut pixels = plane.pixels()[rows.at[0] * width + columns.at[0]..].chunks(width);
        let mut sums = [0.0; 4];
        for weight in rows.weights {
            let values: &[f32; 4] = pixels.next().and_then(<[f32]>::first_chunk).unwrap_or(&[0.0; 4]);
            sums = std::array::from_fn(|k| sums[k] + weight * values[k]);
        }
        columns.mean(sums)
    }
}

impl Axis {
    fn new(at: f32, length: usize) -> Self {
        let last = length - 1;
        let at = at.clamp(0.0, last as f32);
        let low = at as usize;
        let t = at - low as f32;
        let weights = [
            0.5 * t * (t * (2.0 - t) - 1.0),
            0.5 * (t * t * (3.0 * t - 5.0) + 2.0),
            0.5 * t * (t * (4.0 - 3.0 * t) + 1.0),
            0.5 * t * t * (t - 1.0),
        ];
        let beside = low >= 1 && low + 2 <= last;
        Self { at: std::array::from_fn(|k| (low + k).saturating_sub(1).min(last)), weights, beside }
    }

    /// Of four values.
    fn mean(&self, values: [f32; 4]) -> f32 {
        let [a, b, c, d]: [f32; 4] = std::array::from_fn(|k| self.weights[k] * values[k]);
        (a + b) + (c + d)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Inside and beyond the borders, against the sum over 16 pixels.
    #[test]
    fn it_is_the_cubic_through_the_pixels_around() {
        let size = Size::new(7, 9);
        let plane = Plane::from_fn(size, |y, x| (0.7 * y as f32).sin() + (0.4 * x as f32 * y as f32).cos());
        let cubic = |t: f64| {
            let t = t.abs();
            if t < 1.0 {
                (1.5 * t - 2.5) * t * t + 1.0
            } else if t < 2.0 {
                ((2.5 - 0.5 * t) * t - 4.0) * t + 2.0
            } else {
                0.0
            }
        };
        for [y, x] in
            [[3.0_f64, 4.0], [2.25, 5.5], [0.0, 0.25], [5.75, 7.9], [6.0, 8.0], [1.5, 0.5], [-0.4, 8.4]]
        {
            let (row, column) = (y.clamp(0.0, 6.0), x.clamp(0.0, 8.0));
            let mut expected = 0.0;
            for (dy, dx) in (-2..9).flat_map(|dy: i32| (-2..11).map(move |dx: i32| (dy, dx))) {
                let value = plane.at(dy.clamp(0, 6) as usize, dx.clamp(0, 8) as usize);
                expected += cubic(row - f64::from(dy)) * cubic(column - f64::from(dx)) * f64::from(value);
            }
            let found = f64::from(Taps::new(size, y as f32, x as f32).of(&plane));
            assert!((found - expected).abs() < 8.0 * f64::from(f32::EPSILON), "{y} {x}: {found}, {expected}");
        }
    }
}
