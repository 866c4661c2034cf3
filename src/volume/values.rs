//! Voxel values in the type they are kept in.

use lacuna_core::parallel::prelude::*;

/// Values of one type. Other types are converted when they are read: `i8` to `i16`; `u32`, `i32`, `f64` to `f32`.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// 8-bit unsigned integers.
    U8(Vec<u8>),
    /// 16-bit unsigned integers.
    U16(Vec<u16>),
    /// 16-bit signed integers.
    I16(Vec<i16>),
    /// 32-bit floats.
    F32(Vec<f32>),
}

impl Values {
    /// Number of values.
    pub const fn len(&self) -> usize {
        match self {
            Self::U8(values) => values.len(),
            Self::U16(values) => values.len(),
            Self::I16(values) => values.len(),
            Self::F32(values) => values.len(),
        }
    }

    /// Whether there is no value.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The full range of the type; 0 to 1 for floats.
    pub const fn type_range(&self) -> (f64, f64) {
        match self {
            Self::U8(_) => (0.0, u8::MAX as f64),
            Self::U16(_) => (0.0, u16::MAX as f64),
            Self::I16(_) => (i16::MIN as f64, i16::MAX as f64),
            Self::F32(_) => (0.0, 1.0),
        }
    }

    /// Least and largest value; nothing if there is none or one is not finite.
    pub fn range(&self) -> Option<(f64, f64)> {
        match self {
            Self::U8(values) => bounds(values).map(|(a, b)| (a.into(), b.into())),
            Self::U16(values) => bounds(values).map(|(a, b)| (a.into(), b.into())),
            Self::I16(values) => bounds(values).map(|(a, b)| (a.into(), b.into())),
            Self::F32(values) if finite(values) => bounds(values).map(|(a, b)| (a.into(), b.into())),
            Self::F32(_) => None,
        }
    }
}

/// Values that a thread looks at in one go.
const PIECE: usize = 1 << 16;
/// Bounds kept side by side, so that the comparisons do not wait for each other.
const ABREAST: usize = 32;

/// Least and largest of values that can all be compared.
fn bounds<T: Copy + PartialOrd + Sync + Send>(values: &[T]) -> Option<(T, T)> {
    fn wider<T: PartialOrd>(a: (T, T), b: (T, T)) -> (T, T) {
        (if b.0 < a.0 { b.0 } else { a.0 }, if b.1 > a.1 { b.1 } else { a.1 })
    }
    let first = *values.first()?;
    let piece = |values: &[T]| {
        let (rows, rest) = values.as_chunks::<ABREAST>();
        let (mut low, mut high) = ([first; ABREAST], [first; ABREAST]);
        for row in rows {
            for k in 0..ABREAST {
                low[k] = if row[k] < low[k] { row[k] } else { low[k] };
                high[k] = if row[k] > high[k] { row[k] } else { high[k] };
            }
        }
        let beside = low.into_iter().zip(high).chain(rest.iter().map(|&value| (value, value)));
        beside.fold((first, first), wider)
    };
    values.par_chunks(PIECE).map(piece).into_iter().reduce(wider)
}

fn finite(values: &[f32]) -> bool {
    // Without an early end within a piece, so that it is done side by side.
    values.par_chunks(PIECE).all(|piece| piece.iter().fold(true, |all, value| all & value.is_finite()))
}

impl Values {
    /// `slope value + intercept` of every value, as floats.
    #[must_use]
    pub fn rescaled(&self, slope: f64, intercept: f64) -> Self {
        fn of<T: Copy + Into<f64>>(values: &[T], slope: f64, intercept: f64) -> Values {
            Values::F32(values.iter().map(|&value| (slope * value.into() + intercept) as f32).collect())
        }
        match self {
            Self::U8(values) => of(values, slope, intercept),
            Self::U16(values) => of(values, slope, intercept),
            Self::I16(values) => of(values, slope, intercept),
            Self::F32(values) => of(values, slope, intercept),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_is_that_of_all_values() {
        for n in [1, 31, 32, 33, 70_000, 200_001] {
            let values: Vec<f32> = (0..n).map(|k| ((k * 7919) % 100_003) as f32 - 5e4).collect();
            let expected = values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &value| {
                (low.min(value), high.max(value))
            });
            let found = Values::F32(values.clone()).range().unwrap();
            assert_eq!(found, (expected.0.into(), expected.1.into()), "{n}");
            for (at, bad) in [(0, f32::NAN), (n / 2, f32::INFINITY), (n - 1, f32::NEG_INFINITY)] {
                let mut values = values.clone();
                values[at] = bad;
                assert_eq!(Values::F32(values).range(), None);
            }
        }
        assert_eq!(Values::U8(Vec::new()).range(), None);
        assert_eq!(Values::I16(vec![3, -7, 5]).range(), Some((-7.0, 5.0)));
    }
}
