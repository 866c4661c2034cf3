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

/// The errors of one frame's colours.
struct Errors {
    /// Per group, by its label: the error of each channel, and whether pixels were missing.
    groups: BTreeMap<String, (Vec<Plane>, Option<Vec<bool>>)>,
}

/// The change of the error between frames: how much the result trembles where the reference does not.
///
/// For frames t-1 and t with errors e: the root of the mean of `(e_t - e_(t-1))^2` over the channels, and over the pixels
/// that are missing in either frame (all pixels, if there is no mask). Values that are not finite count as 0.
#[derive(Default)]
pub struct Flicker {
    waiting: BTreeMap<usize, Errors>,
}

impl Flicker {
    /// The errors of a group's colours, to be given to [`Flicker::enter`].
    pub fn errors(images: &Images<'_>) -> Option<(String, Vec<Plane>, Option<Vec<bool>>)> {
        if images.report.kind != Kind::Colour {
            return None;
        }
        let difference = |(r, t): (&Plane, &Plane)| {
            let mut error = t.clone();
            for (error, reference) in error.pixels_mut().iter_mut().zip(r.pixels()) {
                let by = *error - reference;
                *error = if by.is_finite() { by } else { 0.0 };
            }
            error
        };
        let planes = images.reference.iter().zip(images.test).map(difference).collect();
        let missing = images.mask.map(|mask| mask.as_slice().iter().map(|flag| !flag).collect());
        Some((images.report.label(), planes, missing))
    }

    /// Enters the errors of frame number `index` of the sequence. Returns what is known now: index, group's label, flicker
    /// of that frame against the one before.
    pub fn enter(
        &mut self,
        index: usize,
        errors: Vec<(String, Vec<Plane>, Option<Vec<bool>>)>,
    ) -> Vec<(usize, String, f64)> {
        let groups = errors.into_iter().map(|(label, planes, missing)| (label, (planes, missing))).collect();
        self.waiting.insert(index, Errors { groups });
        let mut found = Vec::new();
        for later in [index, index + 1] {
            let before = later.checked_sub(1).and_then(|before| self.waiting.get(&before));
            let (Some(before), Some(now)) = (before, self.waiting.get(&later)) else { continue };
            for (label, now) in &now.groups {
                let change = before.groups.get(label).and_then(|before| change(before, now));
                found.extend(change.map(|change| (later, label.clone(), change)));
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
            if let Some(errors) = self.waiting.get_mut(&at) {
                errors.groups.clear();
            }
        }
        found
    }
}

type Error = (Vec<Plane>, Option<Vec<bool>>);

fn change(before: &Error, now: &Error) -> Option<f64> {
    let (mut squares, mut count) = (0.0_f64, 0_usize);
    if before.0.len() != now.0.len() {
        return None;
    }
    let missing = |at: usize| match (&before.1, &now.1) {
        (None, None) => true,
        (before, now) => [before, now].into_iter().flatten().any(|flags| flags.get(at) == Some(&true)),
    };
    for (before, now) in before.0.iter().zip(&now.0) {
        if before.size() != now.size() {
            return None;
        }
        for (at, (before, now)) in before.pixels().iter().zip(now.pixels()).enumerate() {
            if missing(at) {
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

    fn errors(value: f32, missing: Option<Vec<bool>>) -> Vec<(String, Vec<Plane>, Option<Vec<bool>>)> {
        vec![("RGB".into(), vec![Plane::new(Size::new(1, 2), vec![value, 0.0]).unwrap()], missing)]
    }

    #[test]
    fn pairs_are_found_in_any_order_and_once() {
        let of = |number: usize, value: f64| (number, "RGB".to_owned(), value);
        let mut flicker = Flicker::default();
        let root = std::f64::consts::FRAC_1_SQRT_2;
        assert!(flicker.enter(2, errors(3.0, None)).is_empty());
        assert!(flicker.enter(0, errors(0.0, None)).is_empty());
        let found = flicker.enter(1, errors(1.0, None));
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].0, found[1].0), (1, 2));
        assert!((found[0].2 - root).abs() < 1e-15 && (found[1].2 - 2.0 * root).abs() < 1e-15);
        assert_eq!(flicker.enter(4, errors(1.0, None)), []);
        assert_eq!(flicker.enter(3, errors(3.0, None)), [of(3, 0.0), of(4, 2.0 * root)]);
    }

    #[test]
    fn only_missing_pixels_count() {
        let mut flicker = Flicker::default();
        flicker.enter(0, errors(0.0, Some(vec![true, false])));
        assert_eq!(flicker.enter(1, errors(2.0, Some(vec![false, false])))[0].2, 2.0);
        assert_eq!(flicker.enter(2, errors(0.0, Some(vec![false, true])))[0].2, 0.0);
        assert!(flicker.enter(3, errors(0.0, Some(vec![false, false])))[0].2.abs() < 1e-15);
    }
}
