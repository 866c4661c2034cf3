//! The images of a group while a frame is compared: for maps, pictures, and the flicker from frame to frame.

use std::collections::BTreeMap;

use lacuna_exr::Window;
use lacuna_filters::metric::ssim::Similarity;
use lacuna_filters::{Mask, Plane};

use super::groups::Kind;
use super::model::GroupReport;

/// What a comparison of one group has at hand.
pub struct Images<'a> {
    /// What was found so far: all but the flicker.
    pub report: &'a GroupReport,
    /// The reference, as it is in the file; one plane a channel.
    pub reference: &'a [Plane],
    /// The test image, as it is in the file.
    pub test: &'a [Plane],
    /// Structural similarity, one map a channel.
    pub similarity: &'a [Similarity],
    /// The distance in CIELUV, if it was wanted.
    pub cieluv: Option<&'a Plane>,
    /// LDR-FLIP, if it was wanted.
    pub flip: Option<&'a Plane>,
    /// Which pixels were measured.
    pub mask: Option<&'a Mask>,
    /// The estimated error of each pixel, where the test image has it.
    pub estimate: Option<&'a Plane>,
    /// The data window.
    pub window: Window,
}

/// The colours of one group of a frame.
#[derive(Debug)]
pub struct Colours {
    /// By channel, what the test image is off by.
    errors: Vec<Plane>,
    /// By channel, the reference.
    reference: Vec<Plane>,
    /// The pixels that were not measured, if that is known.
    missing: Option<Vec<bool>>,
}

/// What changed from one frame to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Changes {
    /// Of the error.
    pub flicker: f64,
    /// Of the reference.
    pub truth: f64,
}

/// The change of the error between frames, how much the result trembles where the reference does not, and that of the reference itself.
///
/// For frames t-1 and t with errors e: the root of the mean of `(e_t - e_(t-1))^2` over the channels, and over the pixels
/// that are missing in either frame (all pixels, if there is no mask); the same with references instead of errors. Values that are not
/// finite count as 0.
#[derive(Default)]
pub struct Flicker {
    /// By the frame's index, its groups by their labels.
    waiting: BTreeMap<usize, BTreeMap<String, Colours>>,
}

impl Flicker {
    /// A group's colours, to be given to [`Flicker::enter`].
    pub fn colours(images: &Images<'_>) -> Option<(String, Colours)> {
        if images.report.kind != Kind::Colour {
            return None;
        }
        let finite = |value: f32| if value.is_finite() { value } else { 0.0 };
        let map = |plane: &Plane, value: &dyn Fn(usize, f32) -> f32| {
            let mut plane = plane.clone();
            plane.pixels_mut().iter_mut().enumerate().for_each(|(at, own)| *own = finite(value(at, *own)));
            plane
        };
        let pairs = images.reference.iter().zip(images.test);
        let errors = pairs.map(|(r, t)| map(t, &|at, own| own - r.pixels()[at])).collect();
        let reference = images.reference.iter().map(|plane| map(plane, &|_, own| own)).collect();
        let missing = images.mask.map(|mask| mask.as_slice().iter().map(|flag| !flag).collect());
        Some((images.report.label(), Colours { errors, reference, missing }))
    }

    /// Enters the groups of frame number `index` of the sequence. Returns what is known now: index, group's label, what changed
    /// since the frame before.
    pub fn enter(&mut self, index: usize, groups: Vec<(String, Colours)>) -> Vec<(usize, String, Changes)> {
        self.waiting.insert(index, groups.into_iter().collect());
        let mut found = Vec::new();
        for later in [index, index + 1] {
            let before = later.checked_sub(1).and_then(|before| self.waiting.get(&before));
            let (Some(before), Some(now)) = (before, self.waiting.get(&later)) else { continue };
            for (label, now) in now {
                let changes = before.get(label).and_then(|before| Changes::between(before, now));
                found.extend(changes.map(|changes| (later, label.clone(), changes)));
            }
        }
        // A frame both of whose neighbours have come is not needed any more.
        let done = |at: usize| {
            let before = at == 0 || self.waiting.contains_key(&(at - 1));
            before && self.waiting.contains_key(&(at + 1))
        };
        for at in
            [index.saturating_sub(1), index, index + 1].into_iter().filter(|&at| done(at)).collect::<Vec<_>>()
        {
            if let Some(groups) = self.waiting.get_mut(&at) {
                groups.clear();
            }
        }
        found
    }
}

impl Changes {
    fn between(before: &Colours, now: &Colours) -> Option<Self> {
        let missing = |at: usize| match (&before.missing, &now.missing) {
            (None, None) => true,
            (before, now) => [before, now].into_iter().flatten().any(|flags| flags.get(at) == Some(&true)),
        };
        let flicker = change((&before.errors, &now.errors), &missing)?;
        Some(Self { flicker, truth: change((&before.reference, &now.reference), &missing)? })
    }
}

/// The root mean square of what planes differ by in some of the pixels; nothing if there are none, or the planes do not match.
fn change((before, now): (&[Plane], &[Plane]), counts: &dyn Fn(usize) -> bool) -> Option<f64> {
    let (mut squares, mut count) = (0.0_f64, 0_usize);
    if before.len() != now.len() {
        return None;
    }
    for (before, now) in before.iter().zip(now) {
        if before.size() != now.size() {
            return None;
        }
        for (at, (before, now)) in before.pixels().iter().zip(now.pixels()).enumerate() {
            if counts(at) {
                squares += f64::from(now - before).powi(2);
                count += 1;
            }
        }
    }
    (count > 0).then(|| (squares / count as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use lacuna_filters::Size;

    /// An error, and a reference that is twice as large.
    fn colours(value: f32, missing: Option<Vec<bool>>) -> Vec<(String, Colours)> {
        let plane = |value: f32| vec![Plane::new(Size::new(1, 2), vec![value, 0.0]).unwrap()];
        vec![("RGB".into(), Colours { errors: plane(value), reference: plane(2.0 * value), missing })]
    }

    #[test]
    fn pairs_are_found_in_any_order_and_once() {
        let of = |number: usize, flicker: f64| {
            (number, "RGB".to_owned(), Changes { flicker, truth: 2.0 * flicker })
        };
        let mut flicker = Flicker::default();
        let root = std::f64::consts::FRAC_1_SQRT_2;
        assert!(flicker.enter(2, colours(3.0, None)).is_empty());
        assert!(flicker.enter(0, colours(0.0, None)).is_empty());
        let found = flicker.enter(1, colours(1.0, None));
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].0, found[1].0), (1, 2));
        for (found, truth) in found.iter().zip([root, 2.0 * root]) {
            assert!((found.2.flicker - truth).abs() < 1e-15 && (found.2.truth - 2.0 * truth).abs() < 1e-15);
        }
        assert_eq!(flicker.enter(4, colours(1.0, None)), []);
        assert_eq!(flicker.enter(3, colours(3.0, None)), [of(3, 0.0), of(4, 2.0 * root)]);
    }

    #[test]
    fn only_missing_pixels_count() {
        let mut flicker = Flicker::default();
        flicker.enter(0, colours(0.0, Some(vec![true, false])));
        let mut next =
            |index, value, flags: [bool; 2]| flicker.enter(index, colours(value, Some(flags.to_vec())))[0].2;
        assert_eq!(next(1, 2.0, [false, false]), Changes { flicker: 2.0, truth: 4.0 });
        assert_eq!(next(2, 0.0, [false, true]), Changes { flicker: 0.0, truth: 0.0 });
        assert_eq!(next(3, 0.0, [false, false]), Changes { flicker: 0.0, truth: 0.0 });
    }
}
