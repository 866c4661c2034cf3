//! A frame of a study: its colours, cropped, with a sum that tells them from others.

use std::path::Path;
use std::sync::Arc;

use lacuna_exr::{Channel, Frame, Limits, Part, Samples, Window};
use lacuna_filters::sampling::{Field, Temporal, adaptive, mask};
use lacuna_filters::{Mask, Run};

use super::definition::SubjectDefinition;
use super::selection::Selection;
use crate::channels::{non_finite, non_finite_note};

/// The channels that are studied, where the frame has them.
const COLOURS: [&[u8]; 4] = [b"R", b"G", b"B", b"Y"];

/// A frame that is ready to be made sparse.
#[derive(Clone, Debug)]
pub struct Subject {
    /// What plots call it.
    pub name: String,
    /// What kind of picture it is.
    pub class: String,
    /// One part with the colours.
    pub frame: Frame,
    /// Checksum of the pixels and their place.
    pub sum: u32,
    /// What the log should say of values that are not finite.
    pub non_finite: Option<String>,
}

impl Subject {
    /// Reads a frame; its file is relative to `folder`.
    ///
    /// # Errors
    /// A file that cannot be read, looks sparse, has no colours, or less than the crop.
    pub fn read(definition: &SubjectDefinition, folder: &Path) -> Result<Self, String> {
        let path = folder.join(&definition.file);
        let fail = |why: String| format!("{}: {why}", path.display());
        let mut frame =
            lacuna_exr::read(&path, &Limits::default()).map_err(|error| fail(error.to_string()))?;
        crate::sparsify::check_complete(&frame).map_err(|error| fail(error.to_string()))?;
        frame.parts.truncate(1);
        let part = frame.parts.first_mut().ok_or_else(|| fail("there is no part".into()))?;
        part.channels.retain(|channel| COLOURS.contains(&channel.name.as_slice()));
        if part.channels.is_empty() {
            return Err(fail("its first part has no channel R, G, B or Y".into()));
        }
        if let Some(window) = definition.crop {
            crop(part, window).map_err(fail)?;
        }
        let counts = part.channels.iter();
        let counts = counts.map(|channel| (channel.display_name(), non_finite(&channel.samples)));
        let said = "values are not finite; measured ones count as missing, and no measure counts any";
        let note = non_finite_note(said, counts).map(|note| format!("{}: {note}", path.display()));
        let (name, class, sum) = (definition.name.clone(), definition.class.clone(), sum(part));
        Ok(Self { name, class, frame, sum, non_finite: note })
    }

    /// Columns, rows and where they begin.
    pub fn window(&self) -> Window {
        self.frame.parts[0].data_window
    }

    /// The frame with the chosen pixels only, and a channel that says which.
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
                let (rounds, first) =
                    (rounds.unwrap_or(adaptive::ROUNDS), first.map(|share| share * density));
                let settings =
                    &adaptive::Settings { density, rounds, first, target: None, seed, frame: None };
                return sparsify(crate::sparsify::Pattern::Adaptive { settings, run: &Run::default() });
            }
        };
        let window = self.window();
        let field = Field { x: window.x_min, y: window.y_min, size: window.size() };
        let mask =
            mask(pattern, field, density, seed, Temporal::Fixed, 0).map_err(|error| error.to_string())?;
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

fn sum(part: &Part) -> u32 {
    let mut sum = flate2::Crc::new();
    let window = part.data_window;
    for edge in [window.x_min, window.y_min, window.x_max, window.y_max] {
        sum.update(&edge.to_le_bytes());
    }
    for channel in &part.channels {
        sum.update(&channel.name);
        for value in channel.samples.to_floats().unwrap_or_default() {
            sum.update(&value.to_le_bytes());
        }
    }
    sum.sum()
}

/// The mask that a sparse frame of a study has.
pub fn mask_of(masks: &crate::mask::Masks) -> Option<&Arc<Mask>> {
    masks.channels.iter().flatten().flatten().next()
}
