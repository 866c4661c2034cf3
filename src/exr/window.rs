//! Rectangles of pixels in absolute coordinates, and pixels on another one.

use lacuna_core::Size;

use super::{Channel, Part, Samples};

/// A rectangle of pixels in absolute coordinates; both corners belong to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub x_min: i32,
    /// First row.
    pub y_min: i32,
    /// Last column.
    pub x_max: i32,
    /// Last row.
    pub y_max: i32,
}

impl Window {
    /// Height and width.
    pub fn size(self) -> Size {
        let extent = |min: i32, max: i32| (i64::from(max) - i64::from(min) + 1).max(0) as usize;
        Size::new(extent(self.y_min, self.y_max), extent(self.x_min, self.x_max))
    }

    /// The number of pixels.
    pub fn pixels(self) -> u64 {
        let Size { height, width } = self.size();
        (height as u64).saturating_mul(width as u64)
    }

    /// The smallest window that holds both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self {
            x_min: self.x_min.min(other.x_min),
            y_min: self.y_min.min(other.y_min),
            x_max: self.x_max.max(other.x_max),
            y_max: self.y_max.max(other.y_max),
        }
    }

    /// The pixels of both; nothing if there are none.
    pub fn intersection(self, other: Self) -> Option<Self> {
        let both = Self {
            x_min: self.x_min.max(other.x_min),
            y_min: self.y_min.max(other.y_min),
            x_max: self.x_max.min(other.x_max),
            y_max: self.y_max.min(other.y_max),
        };
        (both.x_min <= both.x_max && both.y_min <= both.y_max).then_some(both)
    }

    /// Row and column, counted from the first of this window, at which another one begins.
    pub fn corner_of(self, other: Self) -> [i64; 2] {
        let from = |low: i32, at: i32| i64::from(at) - i64::from(low);
        [from(self.y_min, other.y_min), from(self.x_min, other.x_min)]
    }

    /// Values of this window's pixels, row by row, as those of another one, by absolute coordinates: `beyond` where this one has none.
    pub fn place<T: Copy>(self, values: &[T], on: Self, beyond: T) -> Vec<T> {
        if self == on {
            return values.to_vec();
        }
        let mut all = vec![beyond; on.size().pixels()];
        if let Some(both) = self.intersection(on) {
            let Size { height, width } = both.size();
            let begin = |window: Self, row: usize| {
                let [top, left] = window.corner_of(both);
                (top as usize + row) * window.size().width + left as usize
            };
            for row in 0..height {
                let (source, target) = (begin(self, row), begin(on, row));
                all[target..target + width].copy_from_slice(&values[source..source + width]);
            }
        }
        all
    }
}

impl Part {
    /// The same part with another data window: pixels keep their absolute coordinates, and those beyond the old window are 0.
    #[must_use]
    pub fn on(&self, window: Window) -> Self {
        let channel = |channel: &Channel| {
            let samples = match &channel.samples {
                Samples::Half(values) => {
                    Samples::Half(self.data_window.place(values, window, half::f16::ZERO))
                }
                Samples::Float(values) => Samples::Float(self.data_window.place(values, window, 0.0)),
                Samples::Uint(values) => Samples::Uint(self.data_window.place(values, window, 0)),
            };
            Channel { name: channel.name.clone(), samples, ..*channel }
        };
        Self {
            data_window: window,
            channels: self.channels.iter().map(channel).collect(),
            attributes: self.attributes.clone(),
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Window = Window { x_min: -2, y_min: 1, x_max: 0, y_max: 2 };

    #[test]
    fn pixels_keep_their_absolute_coordinates() {
        let values = [1, 2, 3, 4, 5, 6];
        let on = Window { x_min: -1, y_min: 0, x_max: 1, y_max: 1 };
        assert_eq!(A.place(&values, on, 9), [9, 9, 9, 2, 3, 9]);
        assert_eq!(A.place(&values, A, 9), values);
        let apart = Window { x_min: 5, y_min: 5, x_max: 6, y_max: 5 };
        assert_eq!(A.place(&values, apart, 9), [9, 9]);
        assert_eq!(A.union(on), Window { x_min: -2, y_min: 0, x_max: 1, y_max: 2 });
        assert_eq!(A.intersection(on), Some(Window { x_min: -1, y_min: 1, x_max: 0, y_max: 1 }));
        assert_eq!((A.intersection(apart), A.corner_of(apart)), (None, [4, 7]));
        let far = Window { x_min: i32::MIN, y_min: i32::MIN, x_max: i32::MAX, y_max: i32::MAX };
        assert_eq!((far.corner_of(A)[1], A.union(far).pixels()), ((1 << 31) - 2, u64::MAX));
    }

    #[test]
    fn a_part_on_another_window_is_0_beyond_its_own() {
        let name = |name: &str, samples| Channel { name: name.into(), perceptually_linear: true, samples };
        let all = vec![name("R", Samples::Float(vec![1.0; 6])), name("id", Samples::Uint(vec![7; 6]))];
        let on = Window { x_max: 1, ..A };
        let placed = Part::new(A, all).on(on);
        assert_eq!((placed.data_window, placed.display_window), (on, A));
        assert_eq!(placed.channels[0].samples, Samples::Float(vec![1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0]));
        assert_eq!(placed.channels[1], name("id", Samples::Uint(vec![7, 7, 7, 0, 7, 7, 7, 0])));
    }
}
