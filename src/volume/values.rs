//! Voxel values in the type they are kept in.

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
        fn of<T: Copy + PartialOrd>(values: &[T]) -> Option<(T, T)> {
            let first = *values.first()?;
            Some(values.iter().fold((first, first), |(low, high), &value| {
                (if value < low { value } else { low }, if value > high { value } else { high })
            }))
        }
        match self {
            Self::U8(values) => of(values).map(|(a, b)| (a.into(), b.into())),
            Self::U16(values) => of(values).map(|(a, b)| (a.into(), b.into())),
            Self::I16(values) => of(values).map(|(a, b)| (a.into(), b.into())),
            Self::F32(values) if values.iter().all(|value| value.is_finite()) => {
                of(values).map(|(a, b)| (a.into(), b.into()))
            }
            Self::F32(_) => None,
        }
    }
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
