//! Two frames whose data windows differ, on the windows that hold both: by absolute coordinates, as `oiiotool --diff` and `idiff` compare. A
//! pixel that only one of them has counts as 0 in the other.

use std::borrow::Cow;

use lacuna_exr::{Frame, Part, PartHeader, Samples, Window};

use super::compare::Error;
use super::values::value;
use crate::channels::part_label;

/// How many times as many pixels as either, or as the display window, the window of both may have.
const LARGER: u64 = 4;

/// The data and the display window of a part.
type Both = (Window, Window);

/// The window that holds the pixels of both; nothing if they are of different images, or lie too far apart.
fn common(a: Both, b: Both) -> Option<Window> {
    let all = a.0.union(b.0);
    let most = [a.0, b.0, a.1].map(Window::pixels).into_iter().fold(0, u64::max);
    (a.0 == b.0 || a.1 == b.1 && all.pixels() <= LARGER.saturating_mul(most)).then_some(all)
}

/// The same of headers; the window of the first if they cannot be compared.
pub fn of_headers(a: &PartHeader, b: &PartHeader) -> Window {
    common((a.data_window, a.display_window), (b.data_window, b.display_window)).unwrap_or(a.data_window)
}

/// Two parts on one window, and what is to be said if they had different ones.
pub struct Placed<'a> {
    /// That of the reference and that of the test image.
    pub parts: (Cow<'a, Part>, Cow<'a, Part>),
    /// The windows that they have in their files.
    pub windows: (Window, Window),
    /// One line.
    pub note: Option<String>,
}

/// Brings a part of the reference and one of the test image to one window.
///
/// # Errors
/// Parts of images with different display windows.
pub fn place<'a>(reference: &'a Frame, test: &'a Frame, parts: (usize, usize)) -> Result<Placed<'a>, Error> {
    let (own, other) = (&reference.parts[parts.0], &test.parts[parts.1]);
    let windows = (own.data_window, other.data_window);
    if windows.0 == windows.1 {
        return Ok(Placed { parts: (Cow::Borrowed(own), Cow::Borrowed(other)), windows, note: None });
    }
    let label = part_label(reference, parts.0);
    let both = |part: &Part| (part.data_window, part.display_window);
    let Some(all) = common(both(own), both(other)) else {
        return Err(Error::Windows {
            what: if label.is_empty() { "the frame".into() } else { label },
            reference: text(windows.0),
            test: text(windows.1),
            same_size: own.size() == other.size(),
        });
    };
    let label = if label.is_empty() { label } else { format!("{label}: ") };
    let note = Some(format!("{label}{}", note(windows)));
    Ok(Placed { parts: (Cow::Owned(own.on(all)), Cow::Owned(other.on(all))), windows, note })
}

/// What is said of parts whose windows differ.
fn note((a, b): (Window, Window)) -> String {
    let only = |own: Window, other: Window| own.pixels() - own.intersection(other).map_or(0, Window::pixels);
    format!(
        "the data windows differ, {} in the reference and {} in the test image: a pixel that only one has ({} in the reference, {} in the \
         test image) counts as 0 in the other",
        text(a),
        text(b),
        only(a, b),
        only(b, a)
    )
}

/// The corners of a window.
fn text(window: Window) -> String {
    format!("({}, {}) to ({}, {})", window.x_min, window.y_min, window.x_max, window.y_max)
}

/// The values of a channel on one window, that are not 0 where the other one has no pixel.
pub fn beyond(samples: &Samples, (on, other): (Window, Window)) -> usize {
    let inside = other.place(&vec![true; other.size().pixels()], on, false);
    inside.iter().enumerate().filter(|&(at, inside)| !inside && value(samples, at) != 0.0).count()
}
