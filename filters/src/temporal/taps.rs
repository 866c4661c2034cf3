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
}

impl Taps {
    /// Places beyond the outermost pixels are theirs.
    pub fn new(size: Size, y: f32, x: f32) -> Self {
        Self { rows: Axis::new(y, size.height), columns: Axis::new(x, size.width) }
    }

    /// The value of a plane.
    pub fn of(&self, plane: &Plane) -> f32 {
        let Axis { at: [first, .., last], weights } = &self.columns;
        let mut columns = [0.0; 4];
        for (row, weight) in self.rows.at.iter().zip(self.rows.weights) {
            let row = plane.row(*row);
            let beside = if last - first == 3 { row[*first..].first_chunk() } else { None };
            let values = beside.copied().unwrap_or_else(|| self.columns.at.map(|column| row[column]));
            columns.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
        }
        let [a, b, c, d]: [f32; 4] = std::array::from_fn(|k| weights[k] * columns[k]);
        (a + b) + (c + d)
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
        Self { at: std::array::from_fn(|k| (low + k).saturating_sub(1).min(last)), weights }
    }
}
