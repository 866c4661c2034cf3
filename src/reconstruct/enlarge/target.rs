//! By how much a frame is enlarged.

use std::fmt;
use std::str::FromStr;

/// What a display window becomes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// Factors along rows and columns, 1 to 16; the new size is rounded.
    Scale {
        /// Along rows: of the width.
        x: f64,
        /// Along columns: of the height.
        y: f64,
    },
    /// This size.
    Size {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
}

/// The largest factor.
pub const LARGEST: f64 = 16.0;

/// The command that makes frames smaller.
const SHRINK: &str = "to shrink a frame, use oiiotool INPUT --resize";

impl Target {
    /// Reads `2`, `1.5` or `2x1.5`.
    pub fn scale(text: &str) -> Result<Self, String> {
        let (x, y) = text.split_once('x').unwrap_or((text, text));
        let [x, y] = [x, y].map(f64::from_str);
        let (Ok(x), Ok(y)) = (x, y) else {
            return Err(
                "it must be a factor such as 2 or 1.5, or two, of width and height, such as 2x1.5".into()
            );
        };
        if ![x, y].iter().all(|s| s.is_finite() && *s > 0.0) {
            return Err("a factor must be above 1, and at most 16".into());
        }
        if x < 1.0 || y < 1.0 {
            let [x, y] = [x, y].map(|s| s * 100.0);
            return Err(format!("it enlarges only; {SHRINK} {x}%x{y}% -o OUTPUT"));
        }
        if x > LARGEST || y > LARGEST {
            return Err("16 times the size is the most".into());
        }
        if x <= 1.0 && y <= 1.0 {
            return Err("a factor of 1 changes nothing; lacuna fill fills frames at their own size".into());
        }
        Ok(Self::Scale { x, y })
    }

    /// Reads `3840x2160`.
    pub fn size(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.parse::<u32>().ok().filter(|n| (1..=1 << 24).contains(n));
        let pair = text.split_once('x').and_then(|(width, height)| Some((number(width)?, number(height)?)));
        let (width, height) =
            pair.ok_or("it must be a width and a height in pixels, each at least 1, such as 3840x2160")?;
        Ok(Self::Size { width, height })
    }

    /// The new number of pixels for `pixels` of a display window.
    pub(super) fn along(&self, pixels: u64, is_width: bool) -> Result<u64, String> {
        let new = match (self, is_width) {
            (Self::Scale { x: factor, .. }, true) | (Self::Scale { y: factor, .. }, false) => {
                (pixels as f64 * factor).round() as u64
            }
            (Self::Size { width: size, .. }, true) | (Self::Size { height: size, .. }, false) => {
                u64::from(*size)
            }
        };
        let what = if is_width { "wide" } else { "high" };
        if new < pixels {
            return Err(format!(
                "its display window is {pixels} pixels {what} already, more than {new}; {SHRINK} WxH -o OUTPUT"
            ));
        }
        if new as f64 > pixels as f64 * LARGEST {
            return Err(format!(
                "its display window is {pixels} pixels {what}: {new} is more than 16 times as many; go there in steps"
            ));
        }
        Ok(new)
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scale { x, y } => write!(f, "scale={x}x{y}"),
            Self::Size { width, height } => write!(f, "size={width}x{height}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_and_sizes_are_read() {
        assert_eq!(Target::scale("2"), Ok(Target::Scale { x: 2.0, y: 2.0 }));
        assert_eq!(Target::scale("1.5x1"), Ok(Target::Scale { x: 1.5, y: 1.0 }));
        assert_eq!(Target::size("3840x2160"), Ok(Target::Size { width: 3840, height: 2160 }));
    }

    #[test]
    fn nonsense_says_what_is_meant() {
        for (text, reason) in [
            ("0", "above 1"),
            ("-2", "above 1"),
            ("nan", "above 1"),
            ("inf", "above 1"),
            ("1", "changes nothing"),
            ("17", "16 times"),
            ("0.5", "oiiotool INPUT --resize 50%x50%"),
            ("2x", "a factor such as"),
            ("big", "a factor such as"),
        ] {
            let error = Target::scale(text).unwrap_err();
            assert!(error.contains(reason) && !error.contains('\n'), "{text}: {error}");
        }
        for text in ["0x10", "10x0", "10", "x", "-4x4", "1.5x2", "99999999999x1"] {
            assert!(Target::size(text).is_err(), "{text}");
        }
        let size = Target::Size { width: 100, height: 4000 };
        assert!(size.along(200, true).unwrap_err().contains("oiiotool"));
        assert!(size.along(200, false).unwrap_err().contains("16 times"));
        assert_eq!(Target::Scale { x: 1.5, y: 2.0 }.along(41, true), Ok(62));
    }
}
