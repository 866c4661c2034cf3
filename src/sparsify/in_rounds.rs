//! Pixels chosen in rounds with a complete frame as the renderer, by its colours: those of every view, on the canvas that all its parts lie on.

use std::sync::Arc;

use lacuna_exr::{Channel, Frame, Part, Samples, Window};
use lacuna_filters::sampling::adaptive;
use lacuna_filters::{Mask, Plane, Planes, Run};

use super::Error;
use crate::mask::generate::field;
use crate::mask::rounds::{self, Rounds};

/// Pixels of the canvas over those of all parts, at most.
const LARGEST: u64 = 4;

/// The rounds, and the canvas that their pixels are of.
pub struct InRounds {
    /// The rounds.
    pub found: Rounds,
    canvas: Window,
    /// Chosen pixels with values that are not finite.
    non_finite: usize,
}

impl InRounds {
    /// Chooses by the colours of each view's first part that has some, else by all that the first part's channels measure.
    pub fn new(frame: &Frame, settings: &adaptive::Settings, run: &Run<'_>) -> Result<Self, Error> {
        let canvas = canvas(frame)?;
        let mut planes = Vec::new();
        for part in chosen_by(frame) {
            for channel in channels(part) {
                planes.push(on_canvas(canvas, part, channel)?);
            }
        }
        if planes.is_empty() {
            return Err(Error::Colourless);
        }
        let planes = Arc::new(Planes::new(canvas.size(), planes)?);
        let found = rounds::choose(settings, field(canvas), run, |_| Ok(Arc::clone(&planes)))?;
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

/// The window that holds those of all parts.
fn canvas(frame: &Frame) -> Result<Window, Error> {
    let union = |a: Window, b: Window| Window {
        x_min: a.x_min.min(b.x_min),
        y_min: a.y_min.min(b.y_min),
        x_max: a.x_max.max(b.x_max),
        y_max: a.y_max.max(b.y_max),
    };
    let all = frame.parts.iter().map(|part| part.data_window).reduce(union).ok_or(Error::Colourless)?;
    let pixels = |window: Window| {
        let size = window.size();
        (size.height as u64).saturating_mul(size.width as u64)
    };
    let parts: u64 = frame.parts.iter().map(|part| pixels(part.data_window)).sum();
    if pixels(all) > LARGEST.saturating_mul(parts) { Err(Error::FarApart) } else { Ok(all) }
}

/// The parts by whose channels pixels are chosen.
fn chosen_by(frame: &Frame) -> Vec<&Part> {
    let mut found: Vec<&Part> = Vec::new();
    for part in frame.parts.iter().filter(|part| part.channels.iter().any(is_colour)) {
        if !found.iter().any(|other| other.view() == part.view()) {
            found.push(part);
        }
    }
    if found.is_empty() {
        found.extend(frame.parts.iter().find(|part| part.channels.iter().any(counts)));
    }
    found
}

/// Those of its channels that count.
fn channels(part: &Part) -> Vec<&Channel> {
    let only = part.channels.iter().any(is_colour);
    let channels =
        part.channels.iter().filter(|channel| if only { is_colour(channel) } else { counts(channel) });
    let mut channels: Vec<&Channel> = channels.collect();
    if only {
        // R, G, B, as a renderer has them: sums over channels round by their order.
        channels.reverse();
    }
    channels
}

fn counts(channel: &Channel) -> bool {
    !matches!(channel.samples, Samples::Uint(_))
}

fn is_colour(channel: &Channel) -> bool {
    counts(channel) && matches!(channel.name.as_slice(), b"R" | b"G" | b"B")
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

/// Row and column of the canvas at which a window begins.
fn corner(canvas: Window, window: Window) -> [usize; 2] {
    let from = |low: i32, at: i32| (i64::from(at) - i64::from(low)) as usize;
    [from(canvas.y_min, window.y_min), from(canvas.x_min, window.x_min)]
}
