//! The second pass: from a frame that was filled, or is still sparse, to the pixels to compute next.

use std::sync::Arc;

use lacuna_exr::{Frame, Samples, Window};
use lacuna_filters::sampling::refine::{self, Preference};
use lacuna_filters::variational::ss;
use lacuna_filters::{Mask, Plane, Planes, Run};

use super::canvas::{canvas, corner};
use super::generate::{Bounds, field};
use super::{MakeError, Masks};
use crate::channels::{Choice, Rule, full_names, shown};

/// The pixels to compute next.
#[derive(Clone, Debug)]
pub struct Next {
    /// Where they lie.
    pub window: Window,
    /// They by index row by row: those that are forced, then the others, the most useful first.
    pub pixels: Vec<usize>,
    /// The same as a mask.
    pub mask: Mask,
    /// The estimated error of the fill, 0 at measured pixels that are finite.
    pub error: Plane,
}

/// Chooses `round(add N)` of the N pixels, fewer only if fewer are missing (within the bounds), beside those that the bounds force.
///
/// Of a multi-part frame the first part that has colour and a mask counts; of its channels, what is nearest to its colour ([`shown`]). They are told as
/// pixels of the window that holds all parts.
///
/// # Errors
/// A frame without such a part, an empty mask, and what the filter refuses.
pub fn next(
    frame: &Frame,
    masks: &Masks,
    choices: &[Vec<Choice>],
    add: f64,
    preference: Preference,
    bounds: impl FnOnce(Window) -> Result<Bounds, MakeError>,
) -> Result<Next, MakeError> {
    let (index, channels, measured) = subject(frame, masks, choices).ok_or_else(|| {
        MakeError::Other("no colour with a sampling mask: nothing to estimate an error of".into())
    })?;
    let part = &frame.parts[index];
    let (size, window) = (part.size(), part.data_window);
    let planes: Vec<Vec<f32>> =
        channels.iter().map(|&channel| part.channels[channel].samples.as_f32()).collect();
    // A pixel that is not finite is measured, so not computed again, but says nothing about its surroundings.
    let finite = |pixel: usize| planes.iter().all(|plane| plane[pixel].is_finite());
    let width = size.width;
    let mask = Arc::new(Mask::from_fn(size, |row, column| {
        measured.is_measured(row, column) && finite(row * width + column)
    }));
    let planes: Result<Vec<Plane>, _> = planes.into_iter().map(|pixels| Plane::new(size, pixels)).collect();
    let samples = Planes::new(size, planes?)?;
    let estimate = refine::estimate_spline(&samples, &mask, &ss::Settings::default(), &Run::default())?;
    let bounds = bounds(window)?;
    let is_missing = |row, column| !measured.is_measured(row, column);
    let is_forced = |row, column| is_missing(row, column) && bounds.forces(size, row, column);
    let mut pixels: Vec<usize> =
        (0..size.pixels()).filter(|&pixel| is_forced(pixel / width, pixel % width)).collect();
    let may_follow = |pixel: usize| {
        let (row, column) = (pixel / width, pixel % width);
        is_missing(row, column) && bounds.admits(row, column) && !bounds.forces(size, row, column)
    };
    let count = (add * size.pixels() as f64).round() as usize;
    let (chosen, _) = estimate.next_beside(&pixels, count, field(window), preference, may_follow);
    pixels.extend(chosen);
    if pixels.is_empty() {
        return Err(MakeError::Other(if count == 0 {
            format!("--add {add} is none of {} x {} pixels: add more", size.width, size.height)
        } else {
            "there is no pixel to add: none is missing, or --inside leaves none".into()
        }));
    }
    let next = Next::of(window, pixels, estimate.error())?;
    match canvas(frame) {
        Some(all) if all != window => next.on(all),
        _ => Ok(next),
    }
}

impl Next {
    /// These pixels of a window.
    fn of(window: Window, pixels: Vec<usize>, error: Plane) -> Result<Self, MakeError> {
        let mut flags = vec![false; window.size().pixels()];
        for &pixel in &pixels {
            flags[pixel] = true;
        }
        let mask = Mask::new(window.size(), flags)?;
        Ok(Self { window, pixels, mask, error })
    }

    /// The same on a larger window, of which no other pixel is chosen.
    fn on(self, canvas: Window) -> Result<Self, MakeError> {
        let [top, left] = corner(canvas, self.window);
        let (size, width) = (canvas.size(), self.mask.size().width);
        let place = |pixel: usize| (top + pixel / width) * size.width + left + pixel % width;
        let mut error = Plane::filled(size, 0.0);
        for (pixel, value) in self.error.pixels().iter().enumerate() {
            error.pixels_mut()[place(pixel)] = *value;
        }
        Self::of(canvas, self.pixels.into_iter().map(place).collect(), error)
    }
}

/// The part, its channels that count, and their mask.
fn subject(frame: &Frame, masks: &Masks, choices: &[Vec<Choice>]) -> Option<(usize, Vec<usize>, Arc<Mask>)> {
    let all = frame.parts.iter().zip(choices).enumerate().filter_map(|(index, (part, choices))| {
        let filled: Vec<usize> = (0..part.channels.len())
            .filter(|&channel| choices[channel].rule == Rule::Fill && masks.get(index, channel).is_some())
            .filter(|&channel| !matches!(part.channels[channel].samples, Samples::Uint(_)))
            .collect();
        let (what, channels) = shown(&full_names(part), &filled);
        let mask = masks.get(index, *channels.first()?)?;
        // Channels of another mask have samples elsewhere.
        let same = |channel: &usize| masks.get(index, *channel) == Some(mask);
        Some((what, index, channels.into_iter().filter(same).collect(), Arc::clone(mask)))
    });
    let (_, index, channels, mask) = all.min_by_key(|(what, ..)| *what)?;
    Some((index, channels, mask))
}
