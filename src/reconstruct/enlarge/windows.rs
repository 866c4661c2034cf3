//! The windows of the larger frame, as `oiiotool --resize` has them, and where its pixels lie.
//!
//! The display window keeps its corner and gets its new size; the edges of the old and the new one lie on each other. The data
//! window follows: its first pixel is the one that its old corner lies in, and it has as many pixels as cover the old ones,
//! rounded up. All in whole numbers, so that no rounding moves a corner.

use lacuna_exr::{Part, PartHeader, Window};
use lacuna_filters::upscale::Axis;

use super::Target;

/// The windows of an enlarged part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Windows {
    /// The pixels that exist.
    pub data: Window,
    /// The pixels that are shown.
    pub display: Window,
    pub(super) vertical: Axis,
    pub(super) horizontal: Axis,
}

impl Windows {
    /// The windows of a part.
    ///
    /// # Errors
    /// Why there are none: what the part has and the way out.
    pub fn of(part: &Part, target: &Target) -> Result<Self, String> {
        Self::new(part.data_window, part.display_window, target)
    }

    /// The same from a header.
    ///
    /// # Errors
    /// As [`Windows::of`].
    pub fn of_header(part: &PartHeader, target: &Target) -> Result<Self, String> {
        Self::new(part.data_window, part.display_window, target)
    }

    fn new(data: Window, display: Window, target: &Target) -> Result<Self, String> {
        let across = Line::new((data.x_min, data.x_max), (display.x_min, display.x_max), target, true)?;
        let down = Line::new((data.y_min, data.y_max), (display.y_min, display.y_max), target, false)?;
        if across.axis.scale == 1.0 && down.axis.scale == 1.0 {
            return Err(
                "its display window has that size already; lacuna fill fills frames at their own size".into(),
            );
        }
        let window = |x: (i32, i32), y: (i32, i32)| Window { x_min: x.0, y_min: y.0, x_max: x.1, y_max: y.1 };
        Ok(Self {
            data: window(across.data, down.data),
            display: window(across.display, down.display),
            vertical: down.axis,
            horizontal: across.axis,
        })
    }
}

/// One axis of the windows: first and last pixel.
struct Line {
    data: (i32, i32),
    display: (i32, i32),
    axis: Axis,
}

impl Line {
    fn new(data: (i32, i32), display: (i32, i32), target: &Target, is_width: bool) -> Result<Self, String> {
        let count = |(from, to): (i32, i32)| i64::from(to) - i64::from(from) + 1;
        let (shown, held) = (count(display), count(data));
        if shown < 1 || held < 1 {
            return Err("it has a window without pixels, which has no larger size".into());
        }
        let new = target.along(shown as u64, is_width)? as i64;
        let from = i64::from(data.0) - i64::from(display.0);
        let scaled = i128::from(from) * i128::from(new);
        let first = scaled.div_euclid(i128::from(shown)) as i64;
        let rest = scaled.rem_euclid(i128::from(shown)) as f64;
        let pixels = (i128::from(held) * i128::from(new) + i128::from(shown) - 1) / i128::from(shown);
        let corner = |from: i64, count: i64| -> Result<(i32, i32), String> {
            let place = |at: i64| {
                i32::try_from(at).map_err(|_| String::from("its windows would leave the range of a file"))
            };
            Ok((place(from)?, place(from + count - 1)?))
        };
        Ok(Self {
            data: corner(i64::from(display.0) + first, pixels as i64)?,
            display: corner(i64::from(display.0), new)?,
            axis: Axis {
                inputs: held as usize,
                outputs: pixels as usize,
                scale: new as f64 / shown as f64,
                shift: if rest == 0.0 { 0.0 } else { -rest / shown as f64 },
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(x: (i32, i32), y: (i32, i32)) -> Window {
        Window { x_min: x.0, y_min: y.0, x_max: x.1, y_max: y.1 }
    }

    #[test]
    fn windows_are_those_of_oiiotool() {
        // As oiiotool --resize printed them: origin, size.
        let overscan = (window((-5, 44), (-3, 36)), window((0, 39), (0, 31)));
        let crop = (window((7, 26), (5, 14)), window((2, 42), (3, 35)));
        let scale = |s: f64| Target::Scale { x: s, y: s };
        let size = |width, height| Target::Size { width, height };
        for ((data, display), target, origin, held, shown) in [
            (overscan, scale(2.0), (-10, -6), (100, 80), (80, 64)),
            (overscan, scale(1.5), (-8, -5), (75, 60), (60, 48)),
            (overscan, size(100, 77), (-13, -8), (125, 97), (100, 77)),
            (crop, scale(2.0), (12, 7), (40, 20), (82, 66)),
            (crop, scale(1.5), (9, 6), (31, 16), (62, 50)),
            (crop, size(80, 64), (11, 6), (40, 20), (80, 64)),
            (crop, size(100, 77), (14, 7), (49, 24), (100, 77)),
        ] {
            let windows = Windows::new(data, display, &target).unwrap();
            assert_eq!((windows.data.x_min, windows.data.y_min), origin, "{target}");
            assert_eq!((windows.data.size().width, windows.data.size().height), held, "{target}");
            assert_eq!((windows.display.size().width, windows.display.size().height), shown, "{target}");
            assert_eq!((windows.display.x_min, windows.display.y_min), (display.x_min, display.y_min));
            for axis in [windows.vertical, windows.horizontal] {
                assert!(axis.shift > -1.0 && axis.shift <= 0.0);
            }
        }
    }

    #[test]
    fn the_size_that_a_frame_has_is_refused_as_a_factor_of_1_is() {
        let shown = window((0, 39), (0, 31));
        let size = |width, height| Windows::new(shown, shown, &Target::Size { width, height });
        assert!(size(40, 32).unwrap_err().contains("lacuna fill"));
        assert!(size(41, 32).is_ok() && size(40, 33).is_ok());
    }

    #[test]
    fn what_a_file_cannot_hold_is_refused() {
        let far = window((i32::MAX - 3, i32::MAX), (0, 3));
        assert!(Windows::new(far, window((0, 3), (0, 3)), &Target::Scale { x: 2.0, y: 2.0 }).is_err());
        let none = window((0, -1), (0, 3));
        assert!(Windows::new(none, window((0, 3), (0, 3)), &Target::Scale { x: 2.0, y: 2.0 }).is_err());
    }
}
