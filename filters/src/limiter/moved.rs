//! How many values were moved, and how far.

use std::iter::Sum;
use std::ops::AddAssign;

/// Values that the limiter or a bound moved.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moved {
    /// How many; one that was moved twice counts twice.
    pub values: usize,
    /// The farthest that one was moved, in the units of the values; one that was not finite does not count.
    pub most: f32,
}

impl Moved {
    /// One value.
    pub(crate) fn from_to(from: f32, to: f32) -> Self {
        let distance = (to - from).abs();
        Self { values: 1, most: if distance.is_finite() { distance } else { 0.0 } }
    }

    /// One value, if it is another now.
    pub(crate) fn between(before: f32, after: f32) -> Self {
        if before == after { Self::default() } else { Self::from_to(before, after) }
    }
}

impl AddAssign for Moved {
    fn add_assign(&mut self, other: Self) {
        self.values += other.values;
        self.most = self.most.max(other.most);
    }
}

impl Sum for Moved {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::default(), |mut sum, one| {
            sum += one;
            sum
        })
    }
}
