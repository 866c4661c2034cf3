//! A frame or a sequence of a study: its colours, cropped, with a sum that tells them from others.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use lacuna_exr::{Channel, Frame, Limits, Part, Samples, Window};
use lacuna_filters::sampling::{self, Field, Temporal, adaptive};
use lacuna_filters::{Mask, Run};

use super::definition::SubjectDefinition;
use super::selection::Selection;
use crate::channels::{Rule, by_default, motion_axis, non_finite, non_finite_note};
use crate::files::patterns::Pattern;

/// The channels that are studied, where the frame has them.
const COLOURS: [&[u8]; 4] = [b"R", b"G", b"B", b"Y"];

/// So large a part of values above 1 is told.
const BRIGHT: f64 = 0.05;

/// A frame that is ready to be made sparse, or a sequence of frames.
#[derive(Clone, Debug)]
pub struct Subject {
    /// What plots call it.
    pub name: String,
    /// What kind of picture it is.
    pub class: String,
    /// The frame; of a sequence those that are filled, and those beside them, by their numbers.
    pub shots: Vec<Shot>,
    /// What the log should say of its values.
    pub notes: Vec<String>,
}

/// A frame of a subject.
#[derive(Clone, Debug)]
pub struct Shot {
    /// Its number in a sequence.
    pub number: Option<i64>,
    /// Whether it is filled and measured; otherwise it lies beside one that is.
    pub studied: bool,
    /// Checksum of the pixels, their place and the attributes.
    pub sum: u32,
    /// One part with the colours; in a sequence also with depth and motion, which say where samples move.
    pub frame: Frame,
}

impl Subject {
    /// Reads a frame or a sequence, of that with up to `reach` frames on either side of each; its files are relative to `folder`.
    ///
    /// # Errors
    /// A file that cannot be read, looks sparse, has no colours, or less than the crop; frames of different windows.
    pub fn read(definition: &SubjectDefinition, folder: &Path, reach: usize) -> Result<Self, String> {
        let (mut shots, mut notes): (Vec<Shot>, Vec<String>) = (Vec::new(), Vec::new());
        for (number, path, studied) in files(definition, folder, reach)? {
            let frame = read(&path, number.is_some(), definition.crop)
                .map_err(|why| format!("{}: {why}", path.display()))?;
            let part = &frame.parts[0];
            if let Some(first) = shots.first().filter(|first| first.window() != part.data_window) {
                let [own, other] = [part.data_window, first.window()].map(|window| {
                    let size = window.size();
                    format!("{}x{} at ({}, {})", size.width, size.height, window.x_min, window.y_min)
                });
                return Err(format!(
                    "{}: its data window is {own}, that of the first frame {other}",
                    path.display()
                ));
            }
            // Depths may be infinite.
            let counts = part.channels.iter().filter(|channel| is_colour(channel));
            let counts = counts.map(|channel| (channel.display_name(), non_finite(&channel.samples)));
            let said = [
                "value is not finite; measured ones count as missing, and no measure counts any",
                "values are not finite; measured ones count as missing, and no measure counts any",
            ];
            notes.extend(non_finite_note(said, counts).map(|note| format!("{}: {note}", path.display())));
            notes.extend(bright(part).map(|note| format!("{}: {note}", path.display())));
            shots.push(Shot { number, studied, sum: sum(part), frame });
        }
        let (name, class) = (definition.name.clone(), definition.class.clone());
        Ok(Self { name, class, shots, notes })
    }

    /// The frames that are filled, and with them those up to `reach` beside one of these.
    pub fn needed(&self, reach: usize) -> impl Iterator<Item = (usize, &Shot)> {
        let near = move |shot: &Shot| {
            let beside = |other: &Shot| Some(other.number?.abs_diff(shot.number?) <= reach as u64);
            shot.studied || self.shots.iter().any(|other| other.studied && beside(other).unwrap_or(false))
        };
        self.shots.iter().enumerate().filter(move |(_, shot)| near(shot))
    }

    /// A checksum of these, their numbers and places.
    pub fn sum(&self, reach: usize) -> u32 {
        let mut sum = flate2::Crc::new();
        for (_, shot) in self.needed(reach) {
            let Some(number) = shot.number else { return shot.sum };
            sum.update(&number.to_le_bytes());
            sum.update(&shot.sum.to_le_bytes());
        }
        sum.sum()
    }
}

/// What is said of a part of whose colours many are above 1.
fn bright(part: &Part) -> Option<String> {
    let colours = part.channels.iter().filter(|channel| is_colour(channel));
    let (mut above, mut all) = (0_usize, 0_usize);
    for values in colours.filter_map(|channel| channel.samples.to_floats()) {
        above += values.iter().filter(|value| **value > 1.0).count();
        all += values.len();
    }
    let share = above as f64 / all.max(1) as f64;
    let said =
        || format!("{:.0} % of its values are above 1, and all measures take them for 1", 100.0 * share);
    (share > BRIGHT).then(said)
}

/// The files of a subject: the number of each, and whether it is studied.
fn files(
    definition: &SubjectDefinition,
    folder: &Path,
    reach: usize,
) -> Result<Vec<(Option<i64>, PathBuf, bool)>, String> {
    let path = folder.join(&definition.file);
    let pattern = Pattern::of(&path).map_err(|error| error.to_string())?;
    let (pattern, frames) = match (pattern, &definition.frames) {
        (None, None) => return Ok(vec![(None, path, true)]),
        (Some(pattern), Some(frames)) => (pattern, frames),
        (Some(_), None) => {
            return Err(format!("{}: say which frames, such as frames = \"3-7\"", path.display()));
        }
        (None, Some(_)) => {
            return Err(format!("{}: frames takes a pattern, such as shot.####.exr", path.display()));
        }
    };
    let studied: BTreeSet<i64> = frames.numbers().iter().copied().collect();
    let reach = reach as i64;
    let beside = |number: &i64| number.saturating_sub(reach)..=number.saturating_add(reach);
    let all: BTreeSet<i64> = studied.iter().flat_map(beside).collect();
    let one = |number: i64| (Some(number), pattern.path(number), studied.contains(&number));
    Ok(all.into_iter().map(one).filter(|(_, path, studied)| *studied || path.exists()).collect())
}

/// The first part of a frame, with what is studied.
fn read(path: &Path, in_sequence: bool, window: Option<[i32; 4]>) -> Result<Frame, String> {
    let mut frame = lacuna_exr::read(path, &Limits::default()).map_err(|error| error.to_string())?;
    crate::sparsify::check_complete(&frame).map_err(|error| error.to_string())?;
    frame.parts.truncate(1);
    let part = frame.parts.first_mut().ok_or("there is no part")?;
    let moves =
        |part: &Part, at: usize| motion_axis(part, at).is_some() || by_default(part, at).0 == Rule::Depth;
    let kept: Vec<bool> = (0..part.channels.len())
        .map(|at| is_colour(&part.channels[at]) || (in_sequence && moves(part, at)))
        .collect();
    if !part.channels.iter().any(is_colour) {
        return Err("its first part has no channel R, G, B or Y".into());
    }
    let mut kept = kept.into_iter();
    part.channels.retain(|_| kept.next().unwrap_or(false));
    if let Some(window) = window {
        crop(part, window)?;
    }
    Ok(frame)
}

fn is_colour(channel: &Channel) -> bool {
    COLOURS.contains(&channel.name.as_slice())
}

/// The frame without what is not studied.
pub fn colours(frame: &Frame) -> Frame {
    let mut frame = frame.clone();
    frame.parts.iter_mut().for_each(|part| part.channels.retain(is_colour));
    frame
}

impl Shot {
    /// Columns, rows and where they begin.
    pub fn window(&self) -> Window {
        self.frame.parts[0].data_window
    }

    /// The frame with the chosen pixels only, and a channel that says which. Frames of a sequence have masks that complete each other, as far as the pattern
    /// can; rounds choose other pixels in each.
    ///
    /// # Errors
    /// A pattern that cannot have that density.
    pub fn sparse(&self, selection: Selection, density: f64, seed: u64) -> Result<Frame, String> {
        let sparsify = |pattern: crate::sparsify::Pattern<'_>| {
            let sparse = crate::sparsify::sparsify(self.frame.clone(), pattern);
            sparse.map(|sparse| sparse.frame).map_err(|error| error.to_string())
        };
        let pattern = match selection {
            Selection::Pattern(pattern) => pattern,
            Selection::Half => return Err("half the resolution leaves no pixels out".into()),
            Selection::Rounds { rounds, first } => {
                let first = first.map(|share| share * density);
                let frame = self.number;
                let settings = &adaptive::Settings { density, rounds, first, target: None, seed, frame };
                return sparsify(crate::sparsify::Pattern::Adaptive { settings, run: &Run::default() });
            }
        };
        let window = self.window();
        let field = Field { x: window.x_min, y: window.y_min, size: window.size() };
        let temporal = match (self.number, pattern) {
            (None, _) => Temporal::Fixed,
            // Which has no order.
            (_, sampling::Pattern::Poisson) => Temporal::Offset,
            _ => Temporal::Complementary,
        };
        let mask = sampling::mask(pattern, field, density, seed, temporal, self.number.unwrap_or(0));
        let mask = mask.map_err(|error| error.to_string())?;
        let name = format!("{} density={density} seed={seed}", pattern.name());
        sparsify(crate::sparsify::Pattern::Given { mask: &Arc::new(mask), name: &name })
    }
}

/// Cuts a part to first column and row, width and height.
pub fn crop(part: &mut Part, [x, y, width, height]: [i32; 4]) -> Result<(), String> {
    let old = part.data_window;
    let (right, bottom) = (x.saturating_add(width - 1), y.saturating_add(height - 1));
    if width < 1 || height < 1 || x < old.x_min || y < old.y_min || right > old.x_max || bottom > old.y_max {
        return Err(format!(
            "crop [{x}, {y}, {width}, {height}] is not within the data window ({}, {}) to ({}, {})",
            old.x_min, old.y_min, old.x_max, old.y_max
        ));
    }
    let columns = old.size().width;
    let (left, top) = ((x - old.x_min) as usize, (y - old.y_min) as usize);
    for Channel { samples, .. } in &mut part.channels {
        let (width, height) = (width as usize, height as usize);
        match samples {
            Samples::Half(values) => *values = cut(values, columns, [left, top, width, height]),
            Samples::Float(values) => *values = cut(values, columns, [left, top, width, height]),
            Samples::Uint(values) => *values = cut(values, columns, [left, top, width, height]),
        }
    }
    part.data_window = Window { x_min: x, y_min: y, x_max: right, y_max: bottom };
    Ok(())
}

fn cut<T: Copy>(values: &[T], columns: usize, [left, top, width, height]: [usize; 4]) -> Vec<T> {
    let row = |y: usize| &values[y * columns + left..][..width];
    (top..top + height).flat_map(row).copied().collect()
}

/// A checksum of all of a part that decides results.
pub fn sum(part: &Part) -> u32 {
    let mut sum = flate2::Crc::new();
    let window = part.data_window;
    for edge in [window.x_min, window.y_min, window.x_max, window.y_max] {
        sum.update(&edge.to_le_bytes());
    }
    // Cameras, primaries and the shape of a pixel decide results as well.
    for attribute in part.attributes.iter() {
        sum.update(&attribute.name);
        sum.update(&attribute.value);
    }
    for channel in &part.channels {
        sum.update(&channel.name);
        sum.update(format!("{:?}", channel.samples.kind()).as_bytes());
        for value in channel.samples.as_f32() {
            sum.update(&value.to_le_bytes());
        }
    }
    sum.sum()
}

/// The mask that a sparse frame of a study has.
pub fn mask_of(masks: &crate::mask::Masks) -> Option<&Arc<Mask>> {
    masks.channels.iter().flatten().flatten().next()
}
