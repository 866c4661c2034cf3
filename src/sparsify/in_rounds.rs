//! Pixels chosen in rounds with a complete frame as the renderer, by its colours: those of every view, on the canvas that all its parts lie on.

use std::sync::Arc;

use lacuna_exr::{Channel, Frame, Part, Samples, Window};
use lacuna_filters::sampling::adaptive;
use lacuna_filters::{Mask, Plane, Planes, Run};

use super::Error;
use crate::channels::{Rule, Shown, by_default, full_names, shown};
use crate::mask::canvas::{canvas, corner};
use crate::mask::generate::field;
use crate::mask::rounds::{self, Rounds};

/// The rounds, and the canvas that their pixels are of.
pub struct InRounds {
    /// The rounds.
    pub found: Rounds,
    canvas: Window,
    /// Chosen pixels with values that are not finite.
    non_finite: usize,
}

impl InRounds {
    /// Chooses by the colours of each view's first part that has some, else by what the first part's channels measure.
    pub fn new(frame: &Frame, settings: &adaptive::Settings, run: &Run<'_>) -> Result<Self, Error> {
        let canvas = canvas(frame).ok_or(Error::FarApart)?;
        let mut planes = Vec::new();
        for (part, channels) in chosen_by(frame) {
            for at in channels {
                planes.push(on_canvas(canvas, part, &part.channels[at])?);
            }
        }
        if planes.is_empty() {
            return Err(Error::Colourless);
        }
        let planes = Arc::new(Planes::new(canvas.size(), planes)?);
        let within = within(canvas, frame);
        let field = (field(canvas), within.as_ref());
        let found = rounds::choose(settings, field, run, |_| Ok(Arc::clone(&planes)))?;
        let finite = |at: usize| planes.as_slice().iter().all(|plane| plane.pixels()[at].is_finite());
        let chosen = (0..canvas.size().pixels()).filter(|&at| found.mask.as_slice()[at]);
        let non_finite = chosen.filter(|&at| !finite(at)).count();
        Ok(Self { found, canvas, non_finite })
    }

    /// The mask of each part.
    pub fn masks(&self, frame: &Frame) -> Vec<Arc<Mask>> {
        let one = |part: &Part| {
            let window = part.data_window;
            if window == self.canvas {
                return Arc::clone(&self.found.mask);
            }
            let [top, left] = corner(self.canvas, window);
            Arc::new(Mask::from_fn(part.size(), |row, column| {
                self.found.mask.is_measured(top + row, left + column)
            }))
        };
        frame.parts.iter().map(one).collect()
    }

    /// What a reader of the log should know.
    pub fn note(&self) -> Option<String> {
        let count = self.non_finite;
        let are = if count == 1 { "pixel has a value that is" } else { "pixels have values that are" };
        (count > 0).then(|| format!("{count} of the chosen {are} not finite: no pixel was chosen by these"))
    }
}

/// Of each view the first part that shows most of its colour, with the channels by which pixels are chosen; else all that the first part's channels
/// measure.
fn chosen_by(frame: &Frame) -> Vec<(&Part, Vec<usize>)> {
    let mut found: Vec<(Shown, &Part, Vec<usize>)> = Vec::new();
    let measures = |part: &Part, at: usize| !matches!(part.channels[at].samples, Samples::Uint(_));
    for part in &frame.parts {
        let filled = |at: &usize| measures(part, *at) && by_default(part, *at).0 == Rule::Fill;
        let filled: Vec<usize> = (0..part.channels.len()).filter(filled).collect();
        let (what, channels) = shown(&full_names(part), &filled);
        if channels.is_empty() {
            continue;
        }
        match found.iter_mut().find(|(_, other, _)| other.view() == part.view()) {
            Some(own) if what < own.0 => *own = (what, part, channels),
            Some(_) => {}
            None => found.push((what, part, channels)),
        }
    }
    let best = found.iter().map(|(what, ..)| *what).min();
    if best < Some(Shown::Other) {
        // Views without a colour have none to be judged by.
        found.retain(|(what, ..)| *what < Shown::Other);
    } else {
        found.truncate(1);
    }
    if found.is_empty() {
        let all = |part: &Part| (0..part.channels.len()).filter(|&at| measures(part, at)).collect::<Vec<_>>();
        let first = frame.parts.iter().map(|part| (part, all(part))).find(|(_, all)| !all.is_empty());
        return first.into_iter().collect();
    }
    found.into_iter().map(|(_, part, channels)| (part, channels)).collect()
}

/// The pixels of the canvas that some part has, if not each has all.
fn within(canvas: Window, frame: &Frame) -> Option<Mask> {
    if frame.parts.iter().any(|part| part.data_window == canvas) {
        return None;
    }
    let inside = |part: &Part, row: usize, column: usize| {
        let ([top, left], size) = (corner(canvas, part.data_window), part.size());
        (top..top + size.height).contains(&row) && (left..left + size.width).contains(&column)
    };
    Some(Mask::from_fn(canvas.size(), |row, column| frame.parts.iter().any(|part| inside(part, row, column))))
}

/// A channel on the canvas, 0 where the part has no pixels.
fn on_canvas(canvas: Window, part: &Part, channel: &Channel) -> Result<Plane, Error> {
    let (size, values) = (part.size(), channel.samples.as_f32());
    if part.data_window == canvas {
        return Ok(Plane::new(size, values)?);
    }
    let [top, left] = corner(canvas, part.data_window);
    let mut plane = Plane::filled(canvas.size(), 0.0);
    let width = canvas.size().width;
    for (row, values) in values.chunks_exact(size.width).enumerate() {
        plane.pixels_mut()[(top + row) * width + left..][..size.width].copy_from_slice(values);
    }
    Ok(plane)
}
