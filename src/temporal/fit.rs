//! Whether a neighbour shows the image of the frame, as headers tell.

use lacuna_core::Size;
use lacuna_exr::{Attributes, Frame, Part, PartHeader, Window};

/// What a part must have in common with that of a neighbour.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shape {
    name: Option<String>,
    data: Window,
    display: Window,
    /// Width over height of a pixel, as the bytes of the attribute.
    aspect: Vec<u8>,
}

impl Shape {
    fn new(attributes: &Attributes, data: Window, display: Window) -> Self {
        let aspect = attributes.get("pixelAspectRatio").map(|aspect| aspect.value.clone());
        let aspect = aspect.unwrap_or_else(|| 1.0_f32.to_le_bytes().into());
        Self { name: attributes.text("name"), data, display, aspect }
    }

    /// The pixels that it has, or would have if it showed all of the image.
    fn pixels(&self) -> u64 {
        self.data.pixels().max(self.display.pixels())
    }
}

impl From<&Part> for Shape {
    fn from(part: &Part) -> Self {
        Self::new(&part.attributes, part.data_window, part.display_window)
    }
}

impl From<&PartHeader> for Shape {
    fn from(part: &PartHeader) -> Self {
        Self::new(&part.attributes, part.data_window, part.display_window)
    }
}

/// The part itself, then those of the frame that show the same pixels in the same view: what it lacks may stand in one of them.
pub fn alike(frame: &Frame, part: usize) -> impl Iterator<Item = usize> {
    let own = &frame.parts[part];
    let same = move |other: &Part| {
        (other.data_window, other.display_window) == (own.data_window, own.display_window)
            && other.view() == own.view()
    };
    let others = (0..frame.parts.len()).filter(move |&other| other != part && same(&frame.parts[other]));
    std::iter::once(part).chain(others)
}

/// The shapes of all parts.
pub fn shapes<'a, P>(parts: &'a [P]) -> Vec<Shape>
where
    Shape: From<&'a P>,
{
    parts.iter().map(Shape::from).collect()
}

/// How many times as many pixels as the frame a neighbour may have in all, as what is of no use is decoded as well.
const LARGER: u64 = 2;

/// Why a neighbour is of no use to a frame: no part of it is (what is wrong with the first), or what else it has is too large.
pub fn misfit_of_all(own: &[Shape], other: &[Shape]) -> Option<String> {
    let all: Option<Vec<String>> =
        own.iter().enumerate().map(|(part, own)| misfit(own, other.get(part))).collect();
    if let Some(all) = all {
        return all.into_iter().next();
    }
    let sum = |pixels: &dyn Fn(&Shape) -> u64, shapes: &[Shape]| {
        shapes.iter().map(pixels).fold(0, u64::saturating_add)
    };
    let (own, other) = (sum(&Shape::pixels, own), sum(&|shape| shape.data.pixels(), other));
    (other > own.saturating_mul(LARGER))
        .then(|| format!("its parts have {other} pixels, those of this frame {own}"))
}

/// The window in which motion between two is estimated: one that holds both with as much of the display window around as lets motion be found at
/// coarse resolutions, half of it on each side.
pub fn around(own: Window, other: Window, display: Window) -> Window {
    if own == other {
        return own;
    }
    let both = own.union(other);
    let Size { height, width } = both.size();
    let by = |at: i32, length: usize, sign: i32| at.saturating_add(sign.saturating_mul((length / 2) as i32));
    let more = Window {
        x_min: by(both.x_min, width, -1),
        y_min: by(both.y_min, height, -1),
        x_max: by(both.x_max, width, 1),
        y_max: by(both.y_max, height, 1),
    };
    more.intersection(display).map_or(both, |shown| shown.union(both))
}

/// How many pixels such windows of all parts have beyond those of the neighbour.
pub fn beyond(own: &[Shape], other: &[Shape]) -> u64 {
    let pairs = own.iter().zip(other).filter(|(own, other)| misfit(own, Some(other)).is_none());
    let all =
        pairs.map(|(own, other)| around(own.data, other.data, own.display).pixels() - other.data.pixels());
    all.fold(0, u64::saturating_add)
}

/// Why a neighbour's part shows another image, if it does. Data windows are parts of it, and may differ.
pub fn misfit(own: &Shape, other: Option<&Shape>) -> Option<String> {
    let Some(other) = other else { return Some("it has fewer parts".into()) };
    if own.name != other.name {
        return Some("its parts have other names, or another order".into());
    }
    let window = |window: Window| {
        let size = window.size();
        format!("{} x {} pixels from {}, {}", size.width, size.height, window.x_min, window.y_min)
    };
    if own.display != other.display {
        return Some(format!(
            "it has another display window, {} (this frame: {})",
            window(other.display),
            window(own.display)
        ));
    }
    let far =
        own.data.union(other.data).pixels() > LARGER.saturating_mul(own.pixels().max(other.data.pixels()));
    if far {
        return Some(format!(
            "its window, {}, lies far from that of this frame, {}",
            window(other.data),
            window(own.data)
        ));
    }
    (own.aspect != other.aspect).then(|| "it has another pixelAspectRatio".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{float, part, window};

    #[test]
    fn a_neighbour_serves_as_far_as_its_windows_agree() {
        let small = || part(window(0, 0, 2, 1), vec![float("R", &[0.0; 2])]);
        let large = || part(window(3, 0, 3, 1), vec![float("R", &[0.0; 3])]);
        let shown = || Part { display_window: window(0, 0, 9, 9), ..small() };
        let cropped = || Part { display_window: window(0, 0, 9, 9), ..large() };
        let why = |own: &[Part], other: &[Part]| misfit_of_all(&shapes(own), &shapes(other));
        assert_eq!(why(&[small()], &[small(), small()]), None);
        assert_eq!(why(&[small(), large()], &[large(), large()]), None);
        assert_eq!(why(&[shown()], &[cropped()]), None);
        assert_eq!(
            why(&[small()], &[shown()]).unwrap(),
            "it has another display window, 9 x 9 pixels from 0, 0 (this frame: 2 x 1 pixels from 0, 0)"
        );
        let mut wide = shown();
        wide.attributes.set("pixelAspectRatio", "float", 2.0_f32.to_le_bytes().to_vec());
        assert_eq!(why(&[shown()], &[wide]).unwrap(), "it has another pixelAspectRatio");
        assert_eq!(why(&[small()], &[]).unwrap(), "it has fewer parts");
        let huge = part(window(0, 0, 9, 9), vec![float("R", &[0.0; 81])]);
        let text = "its parts have 83 pixels, those of this frame 5";
        assert_eq!(why(&[small(), large()], &[small(), huge]).unwrap(), text);
    }
}
