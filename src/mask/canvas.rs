//! The window that holds all parts of a frame, whose pixels are chosen together.

use lacuna_exr::{Frame, Window};

/// Pixels of it over those of all parts, at most.
const LARGEST: u64 = 4;

/// The window; nothing for a frame without parts, and if they lie too far apart.
pub fn canvas(frame: &Frame) -> Option<Window> {
    let union = |a: Window, b: Window| Window {
        x_min: a.x_min.min(b.x_min),
        y_min: a.y_min.min(b.y_min),
        x_max: a.x_max.max(b.x_max),
        y_max: a.y_max.max(b.y_max),
    };
    let all = frame.parts.iter().map(|part| part.data_window).reduce(union)?;
    let pixels = |window: Window| {
        let size = window.size();
        (size.height as u64).saturating_mul(size.width as u64)
    };
    let parts: u64 = frame.parts.iter().map(|part| pixels(part.data_window)).sum();
    (pixels(all) <= LARGEST.saturating_mul(parts)).then_some(all)
}

/// Row and column of the canvas at which a window begins.
pub fn corner(canvas: Window, window: Window) -> [usize; 2] {
    let from = |low: i32, at: i32| (i64::from(at) - i64::from(low)) as usize;
    [from(canvas.y_min, window.y_min), from(canvas.x_min, window.x_min)]
}
