//! The change of the error from frame to frame: how much a result trembles where its reference does not.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use lacuna_exr::{Frame, Window};
use lacuna_filters::{Plane, Size};

use super::groups::Kind;
use super::images::Images;
use crate::temporal;

/// How many times as many pixels as both together the window may have that holds the windows of two frames.
const LARGER: u64 = 4;

/// The colours of one group of a frame.
#[derive(Clone, Debug)]
pub struct Colours {
    /// Index of the part in the reference.
    part: usize,
    /// The full names of the channels.
    channels: Vec<String>,
    /// By channel, what the test image is off by.
    errors: Vec<Plane>,
    /// By channel, the reference.
    reference: Vec<Plane>,
    /// The pixels that were not measured, if that is known.
    missing: Option<Vec<bool>>,
    /// Where all of them lie.
    window: Window,
}

/// What changed from one frame to the next: root mean squares over the channels, and over the pixels that are missing in either frame (all pixels,
/// if none is or there is no mask), of colours clipped as they are compared. Values that are not finite count as 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Changes {
    /// Of the error.
    pub flicker: f64,
    /// Of the reference.
    pub truth: f64,
}

/// Changes of one group since the frame before.
#[derive(Clone, Debug)]
pub struct Changed {
    /// The frame's number.
    pub number: i64,
    /// The group's label.
    pub label: String,
    /// At every pixel.
    pub still: Changes,
    /// Along the motion, where that was asked for and is known.
    pub along: Option<Changes>,
}

/// Two frames in a row that are both there.
pub struct Pair {
    number: i64,
    before: Arc<Moment>,
    now: Arc<Moment>,
}

/// What is kept of a frame until those beside it have come.
struct Moment {
    /// By their labels.
    groups: BTreeMap<String, Colours>,
    /// The frame's reference, where motion is to be followed.
    reference: Option<Arc<Frame>>,
}

/// Pairs up the frames of a sequence whose numbers follow each other, in whatever order they come.
#[derive(Default)]
pub struct Flicker {
    /// The numbers that one frame has.
    expected: BTreeSet<i64>,
    /// By the frame's number; nothing for one that is not needed any more, or will not come.
    waiting: BTreeMap<i64, Option<Arc<Moment>>>,
}

impl Flicker {
    /// For frames of these numbers; which frame is meant by a number that several have is not known, so that none is.
    pub fn new(numbers: impl IntoIterator<Item = i64>) -> Self {
        let mut counts = BTreeMap::new();
        for number in numbers {
            *counts.entry(number).or_insert(0) += 1;
        }
        let once = counts.into_iter().filter(|(_, count)| *count == 1);
        Self { expected: once.map(|(number, _)| number).collect(), waiting: BTreeMap::new() }
    }

    /// Whether a frame of that number is to come, and the one before it.
    pub fn expects(&self, number: i64) -> bool {
        [number, beside(number)[0]].iter().all(|number| self.expected.contains(number))
    }

    /// A group's colours, to be given to [`Flicker::enter`].
    pub fn colours(images: &Images<'_>) -> Option<(String, Colours)> {
        if images.report.kind != Kind::Colour {
            return None;
        }
        let most = images.report.peak.filter(|_| images.report.clipped);
        let shown = |value: f32| most.map_or(value, |peak| value.clamp(0.0, peak));
        let map = |plane: &Plane, value: &dyn Fn(usize, f32) -> f32| {
            let mut plane = plane.clone();
            plane.pixels_mut().iter_mut().enumerate().for_each(|(at, own)| *own = value(at, *own));
            plane
        };
        let error = |own: f32, r: f32| if (own - r).is_finite() { shown(own) - shown(r) } else { 0.0 };
        let pairs = images.reference.iter().zip(images.test);
        let errors = pairs.map(|(r, t)| map(t, &|at, own| error(own, r.pixels()[at]))).collect();
        let reference = images.reference.iter().map(|plane| map(plane, &|_, own| error(own, 0.0))).collect();
        let missing = images.missing.map(<[bool]>::to_vec);
        let (part, channels) = (images.report.part, images.report.channels.clone());
        let window = images.part.data_window;
        Some((images.report.label(), Colours { part, channels, errors, reference, missing, window }))
    }

    /// Enters the groups of the frame of that number, and its reference if motion is to be followed. Returns the pairs that are complete now.
    pub fn enter(
        &mut self,
        number: i64,
        groups: Vec<(String, Colours)>,
        reference: Option<Arc<Frame>>,
    ) -> Vec<Pair> {
        if !self.expected.contains(&number) {
            return Vec::new();
        }
        let moment = Moment { groups: groups.into_iter().collect(), reference };
        self.waiting.insert(number, Some(Arc::new(moment)));
        let [before, after] = beside(number);
        let of = |at: i64| self.waiting.get(&at).cloned().flatten();
        let pair = |(earlier, later)| Some(Pair { number: later, before: of(earlier)?, now: of(later)? });
        let found = [(before, number), (number, after)].into_iter().filter_map(pair).collect();
        self.let_go(number);
        found
    }

    /// The frame of that number will not come: none waits for it.
    pub fn lost(&mut self, number: i64) {
        if self.expected.contains(&number) {
            self.waiting.insert(number, None);
            self.let_go(number);
        }
    }

    /// A frame is not needed any more once those beside it have come, of which this is the last.
    fn let_go(&mut self, last: i64) {
        let come = |at: i64| self.waiting.contains_key(&at) || !self.expected.contains(&at);
        let [before, after] = beside(last);
        let done = [before, last, after].into_iter().filter(|at| beside(*at).into_iter().all(come));
        for at in done.collect::<Vec<_>>() {
            self.waiting.entry(at).and_modify(|moment| *moment = None);
        }
    }
}

/// The numbers before and after one.
const fn beside(number: i64) -> [i64; 2] {
    [number.wrapping_sub(1), number.wrapping_add(1)]
}

impl Colours {
    /// On a window that holds theirs; where none is known to be `missing`, the pixels that they have are those that count.
    fn on(&self, window: Window, missing: bool) -> Cow<'_, Self> {
        if self.window == window && missing {
            return Cow::Borrowed(self);
        }
        let plane = |plane: &Plane| {
            Plane::new(window.size(), self.window.place(plane.pixels(), window, 0.0))
                .unwrap_or_else(|_| plane.clone())
        };
        let own = if missing { self.missing.clone() } else { Some(vec![true; self.window.size().pixels()]) };
        Cow::Owned(Self {
            errors: self.errors.iter().map(plane).collect(),
            reference: self.reference.iter().map(plane).collect(),
            missing: own.map(|flags| self.window.place(&flags, window, false)),
            channels: self.channels.clone(),
            part: self.part,
            window,
        })
    }
}

impl Pair {
    /// What changed, group by group.
    pub fn changes(&self) -> Vec<Changed> {
        let mut motion: BTreeMap<usize, Option<Vec<[f32; 2]>>> = BTreeMap::new();
        let mut found = Vec::new();
        for (label, now) in &self.now.groups {
            let Some(before) = self.before.groups.get(label) else { continue };
            let Some(still) = Changes::between(before, now) else { continue };
            let places = motion.entry(now.part).or_insert_with(|| self.motion(before, now));
            let along = places.as_ref().and_then(|places| Changes::along(before, now, places));
            found.push(Changed { number: self.number, label: label.clone(), still, along });
        }
        found
    }

    /// Where each pixel of the colours before lies in those of now, as the references show.
    fn motion(&self, before: &Colours, now: &Colours) -> Option<Vec<[f32; 2]>> {
        let frames = (self.before.reference.as_ref()?, self.now.reference.as_ref()?);
        let places = temporal::between(frames, now.part, &now.channels)?;
        // Colours may have larger windows than the references, those of their test images as well.
        let own = |frame: &Frame| frame.parts.get(now.part).map(|part| part.data_window);
        let corner = now.window.corner_of(own(frames.1)?).map(|at| at as f32);
        let places = own(frames.0)?.place(&places, before.window, [f32::NAN; 2]);
        Some(places.into_iter().map(|[y, x]| [y + corner[0], x + corner[1]]).collect())
    }
}

impl Changes {
    /// By absolute coordinates; a pixel that only one frame has is 0 in the other.
    fn between(before: &Colours, now: &Colours) -> Option<Self> {
        let all = before.window.union(now.window);
        if all.pixels() > LARGER.saturating_mul(before.window.pixels().saturating_add(now.window.pixels())) {
            return None;
        }
        let some = some_missing([before, now]);
        let on = |colours| {
            if before.window == now.window { Cow::Borrowed(colours) } else { Colours::on(colours, all, some) }
        };
        let (before, now) = (on(before), on(now));
        let (before, now) = (&*before, &*now);
        let all = !some_missing([before, now]);
        let counts = |at: usize| all || is_missing([(before, at), (now, at)]);
        let flicker = change((&before.errors, &now.errors), &counts)?;
        Some(Self { flicker, truth: change((&before.reference, &now.reference), &counts)? })
    }

    /// From each pixel of the frame before to the place in this one where it lies, between pixels linearly; places outside of the image and those
    /// that are not known do not count.
    fn along(before: &Colours, now: &Colours, places: &[[f32; 2]]) -> Option<Self> {
        let size = now.errors.first()?.size();
        if places.len() != before.window.size().pixels() || before.errors.len() != now.errors.len() {
            return None;
        }
        let inside = |[y, x]: [f32; 2]| {
            (0.0..=(size.height - 1) as f32).contains(&y) && (0.0..=(size.width - 1) as f32).contains(&x)
        };
        let near = |[y, x]: [f32; 2]| y.round() as usize * size.width + x.round() as usize;
        let all = !some_missing([before, now]);
        let counts = |(at, place): &(usize, [f32; 2])| {
            inside(*place) && (all || is_missing([(before, *at), (now, near(*place))]))
        };
        let pixels: Vec<(usize, [f32; 2])> = places.iter().copied().enumerate().filter(counts).collect();
        let change = |before: &[Plane], now: &[Plane]| {
            let one = |(before, now): (&Plane, &Plane)| -> f64 {
                let moved = |(at, place): &(usize, [f32; 2])| between(now, *place) - before.pixels()[*at];
                pixels.iter().map(|pixel| f64::from(moved(pixel)).powi(2)).sum()
            };
            let count = pixels.len() * before.len();
            let squares: f64 = before.iter().zip(now).map(one).sum();
            (count > 0).then(|| (squares / count as f64).sqrt())
        };
        let flicker = change(&before.errors, &now.errors)?;
        Some(Self { flicker, truth: change(&before.reference, &now.reference)? })
    }
}

/// The value of a plane between its pixels, linearly.
fn between(plane: &Plane, [y, x]: [f32; 2]) -> f32 {
    let Size { height, width } = plane.size();
    let (top, left) = (y as usize, x as usize);
    let (bottom, right) = ((top + 1).min(height - 1), (left + 1).min(width - 1));
    let (down, across) = (y - top as f32, x - left as f32);
    let row = |row: usize| plane.at(row, left) + across * (plane.at(row, right) - plane.at(row, left));
    row(top) + down * (row(bottom) - row(top))
}

/// Whether a pixel of two frames is known not to be measured.
fn some_missing(frames: [&Colours; 2]) -> bool {
    frames.into_iter().filter_map(|colours| colours.missing.as_ref()).any(|flags| flags.contains(&true))
}

/// Whether one of two pixels was not measured.
fn is_missing(pixels: [(&Colours, usize); 2]) -> bool {
    let is = |(colours, at): (&Colours, usize)| colours.missing.as_ref()?.get(at).copied();
    pixels.into_iter().filter_map(is).any(|missing| missing)
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
    use crate::testing::window;

    /// An error, and a reference that is twice as large.
    fn colours(value: f32, missing: Option<Vec<bool>>) -> Vec<(String, Colours)> {
        let plane = |value: f32| vec![Plane::new(Size::new(1, 2), vec![value, 0.0]).unwrap()];
        let (errors, reference) = (plane(value), plane(2.0 * value));
        vec![(
            "RGB".into(),
            Colours { part: 0, channels: Vec::new(), errors, reference, missing, window: window(0, 0, 2, 1) },
        )]
    }

    fn enter(flicker: &mut Flicker, number: i64, groups: Vec<(String, Colours)>) -> Vec<(i64, Changes)> {
        let pairs = flicker.enter(number, groups, None);
        pairs.iter().flat_map(Pair::changes).map(|changed| (changed.number, changed.still)).collect()
    }

    #[test]
    fn pairs_are_found_in_any_order_and_once() {
        let of = |number: i64, flicker: f64| (number, Changes { flicker, truth: 2.0 * flicker });
        let mut flicker = Flicker::new(0..5);
        let root = std::f64::consts::FRAC_1_SQRT_2;
        assert!(enter(&mut flicker, 2, colours(3.0, None)).is_empty());
        assert!(enter(&mut flicker, 0, colours(0.0, None)).is_empty());
        let found = enter(&mut flicker, 1, colours(1.0, None));
        assert_eq!(found.iter().map(|(number, _)| *number).collect::<Vec<_>>(), [1, 2]);
        for ((_, found), truth) in found.iter().zip([root, 2.0 * root]) {
            assert!((found.flicker - truth).abs() < 1e-15 && (found.truth - 2.0 * truth).abs() < 1e-15);
        }
        assert_eq!(enter(&mut flicker, 4, colours(1.0, None)), []);
        assert_eq!(enter(&mut flicker, 3, colours(3.0, None)), [of(3, 0.0), of(4, 2.0 * root)]);
        assert!(flicker.waiting.values().all(Option::is_none), "what is not needed any more is kept");
    }

    #[test]
    fn frames_beside_one_that_will_not_come_are_let_go() {
        let mut flicker = Flicker::new(0..7);
        enter(&mut flicker, 0, colours(0.0, None));
        flicker.lost(1);
        flicker.lost(3);
        assert!(enter(&mut flicker, 2, colours(0.0, None)).is_empty());
        enter(&mut flicker, 4, colours(0.0, None));
        assert_eq!(enter(&mut flicker, 5, colours(0.0, None)).len(), 1);
        flicker.lost(6);
        flicker.lost(9);
        assert!(flicker.waiting.values().all(Option::is_none) && flicker.waiting.len() == 7);
    }

    #[test]
    fn frames_whose_numbers_do_not_follow_each_other_are_no_pair() {
        let mut flicker = Flicker::new([9, 7, 4, 3, 3, 2]);
        for number in [9, 7, 4, 3, 3, 2] {
            assert!(enter(&mut flicker, number, colours(1.0, None)).is_empty() && !flicker.expects(number));
        }
        assert!(flicker.waiting.values().all(Option::is_none));
    }

    /// What moves by a pixel along with its window has changed by what lies in each place before and now.
    #[test]
    fn pixels_of_two_windows_are_those_of_one_place() {
        let moved = |x: i32| {
            let mut all = colours(3.0, None);
            all[0].1.window = window(x, 0, 2, 1);
            all
        };
        let mut flicker = Flicker::new(0..4);
        enter(&mut flicker, 0, moved(5));
        let found = enter(&mut flicker, 1, moved(6));
        // 3 0 and then 0 3 0, of which the first pixel has gone.
        assert!((found[0].1.flicker - 6.0_f64.sqrt()).abs() < 1e-15, "{found:?}");
        assert!(enter(&mut flicker, 2, moved(1 << 20)).is_empty());
    }

    #[test]
    fn only_missing_pixels_count() {
        let mut flicker = Flicker::new(0..5);
        enter(&mut flicker, 0, colours(0.0, Some(vec![true, false])));
        let mut next = |number, value, flags: [bool; 2]| {
            enter(&mut flicker, number, colours(value, Some(flags.to_vec())))[0].1
        };
        assert_eq!(next(1, 2.0, [false, false]), Changes { flicker: 2.0, truth: 4.0 });
        assert_eq!(next(2, 0.0, [false, true]), Changes { flicker: 0.0, truth: 0.0 });
        assert_eq!(next(3, 0.0, [false, false]), Changes { flicker: 0.0, truth: 0.0 });
        // Where none is, all count.
        let root = std::f64::consts::SQRT_2;
        assert_eq!(next(4, 2.0, [false, false]), Changes { flicker: root, truth: 2.0 * root });
        let [before, now] = [0.0, 2.0].map(|value| colours(value, Some(vec![false; 2])).remove(0).1);
        let places = [[0.0, 0.0], [0.0, 1.0]];
        assert_eq!(Changes::along(&before, &now, &places), Changes::between(&before, &now));
    }

    /// Errors that move with what they are errors of do not flicker.
    #[test]
    fn along_the_motion_only_what_changes_on_a_surface_counts() {
        let size = Size::new(6, 9);
        let colours = |shift: f32, more: f32| {
            let error = Plane::from_fn(size, |y, x| 0.1 * y as f32 + 0.2 * (x as f32 - shift) + more);
            Colours {
                part: 0,
                channels: Vec::new(),
                reference: vec![error.clone()],
                errors: vec![error],
                missing: None,
                window: window(0, 0, 9, 6),
            }
        };
        let (before, now) = (colours(0.0, 0.0), colours(1.5, 0.25));
        let place = |at: usize| match at {
            // Not known, and outside.
            3 => [f32::NAN; 2],
            4 => [-0.5, 2.0],
            _ => [(at / 9) as f32, (at % 9) as f32 + 1.5],
        };
        let places: Vec<_> = (0..54).map(place).collect();
        let found = Changes::along(&before, &now, &places).unwrap();
        assert!((found.flicker - 0.25).abs() < 1e-6 && (found.truth - 0.25).abs() < 1e-6, "{found:?}");
        // In place it is the slope's as well.
        let still = Changes::between(&before, &now).unwrap();
        assert!((still.flicker - 0.05).abs() < 1e-6, "{still:?}");
        assert_eq!(Changes::along(&before, &now, &[[f32::NAN; 2]; 54]), None);
    }
}
