//! The window that holds all parts of a frame, whose pixels are chosen together.

use lacuna_exr::{Frame, Window};

/// Pixels of it over those of all parts, at most.
const LARGEST: u64 = 4;

/// The window; nothing for a frame without parts, and if they lie too far apart.
pub fn canvas(frame: &Frame) -> Option<Window> {
    let all = frame.parts.iter().map(|part| part.data_window).reduce(Window::union)?;
    let parts: u64 = frame.parts.iter().map(|part| part.data_window.pixels()).sum();
    (all.pixels() <= LARGEST.saturating_mul(parts)).then_some(all)
}

/// Row and column of the canvas at which a window begins.
pub fn corner(canvas: Window, window: Window) -> [usize; 2] {
    canvas.corner_of(window).map(|at| at as usize)
}
