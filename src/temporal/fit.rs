//! Whether a neighbour shows the pixels of the frame, as headers tell.

use lacuna_exr::{Frame, Part, PartHeader, Window};

/// What a part must have in common with that of a neighbour.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shape {
    name: Option<String>,
    data: Window,
    display: Window,
}

impl From<&Part> for Shape {
    fn from(part: &Part) -> Self {
        Self { name: part.name(), data: part.data_window, display: part.display_window }
    }
}

impl From<&PartHeader> for Shape {
    fn from(part: &PartHeader) -> Self {
        Self { name: part.name(), data: part.data_window, display: part.display_window }
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
    let pixels = |shapes: &[Shape]| {
        let sizes = shapes.iter().map(|shape| shape.data.size());
        sizes.fold(0, |sum: u64, size| {
            sum.saturating_add((size.height as u64).saturating_mul(size.width as u64))
        })
    };
    let (own, other) = (pixels(own), pixels(other));
    (other > own.saturating_mul(LARGER))
        .then(|| format!("its parts have {other} pixels, those of this frame {own}"))
}

/// Why a neighbour's part shows other pixels, if it does.
pub fn misfit(own: &Shape, other: Option<&Shape>) -> Option<String> {
    let Some(other) = other else { return Some("it has fewer parts".into()) };
    if own.name != other.name {
        return Some("its parts have other names, or another order".into());
    }
    let window = |window: Window| {
        let size = window.size();
        format!("{} x {} pixels from {}, {}", size.width, size.height, window.x_min, window.y_min)
    };
    if own.data != other.data {
        return Some(format!(
            "it has another window, {} (this frame: {})",
            window(other.data),
            window(own.data)
        ));
    }
    (own.display != other.display).then(|| {
        format!(
            "it has another display window, {} (this frame: {})",
            window(other.display),
            window(own.display)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{float, part, window};

    #[test]
    fn a_neighbour_serves_as_far_as_its_windows_agree() {
        let small = || part(window(0, 0, 2, 1), vec![float("R", &[0.0; 2])]);
        let large = || part(window(3, 0, 3, 1), vec![float("R", &[0.0; 3])]);
        let shown = || lacuna_exr::Part { display_window: window(0, 0, 9, 9), ..small() };
        let why = |own: &[Part], other: &[Part]| misfit_of_all(&shapes(own), &shapes(other));
        assert_eq!(why(&[small()], &[small(), small()]), None);
        assert_eq!(why(&[small(), large()], &[large(), large()]), None);
        assert_eq!(
            why(&[small()], &[large()]).unwrap(),
            "it has another window, 3 x 1 pixels from 3, 0 (this frame: 2 x 1 pixels from 0, 0)"
        );
        assert_eq!(
            why(&[small()], &[shown()]).unwrap(),
            "it has another display window, 9 x 9 pixels from 0, 0 (this frame: 2 x 1 pixels from 0, 0)"
        );
        assert_eq!(why(&[small()], &[]).unwrap(), "it has fewer parts");
        let huge = part(window(0, 0, 9, 9), vec![float("R", &[0.0; 81])]);
        let text = "its parts have 83 pixels, those of this frame 5";
        assert_eq!(why(&[small(), large()], &[small(), huge]).unwrap(), text);
    }
}
