//! After a first pass, frame by frame: the pixels to compute next, and two renders united.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use lacuna_exr::{Attributes, Frame, Limits, Over, WriteOptions};
use lacuna_filters::sampling::refine::Preference;

use super::output::{BoundFiles, MaskOutput, failed, of_frame, report, source_of_frame};
use crate::channels::{self, part_label};
use crate::files::error::PlanError;
use crate::files::identity::Sources;
use crate::files::inputs::{Input, Selection, resolve};
use crate::files::patterns::Pattern;
use crate::files::ranges::Frames;
use crate::files::reports;
use crate::mask::output::{Listing, write_floats, write_mask};
use crate::mask::{self, MakeError, MaskFile, Masks, PATTERN, SEED, Source, after, merge};
use crate::reconstruct::{dropped_note, make_writable, of_other_pixels, prefixed, remove};
use crate::run::console::Console;
use crate::run::memory;

/// Pixels to choose after a first pass.
#[derive(Clone, Debug, PartialEq)]
pub struct NextPass {
    /// The filled or sparse frame, or a pattern.
    pub frame: PathBuf,
    /// The frames of the pattern; all that exist if `None`.
    pub frames: Option<Frames>,
    /// Where their masks come from.
    pub source: Source,
    /// Pixels to add over all pixels, 0 to 1.
    pub add: f64,
    /// The seed of the order that decides between equals.
    pub seed: u64,
    /// The number of the frame, once it is one of a pattern.
    pub number: Option<i64>,
    /// Where the estimated error goes.
    pub error_estimate: Option<PathBuf>,
    /// What the estimate does not decide.
    pub bounds: BoundFiles,
    /// Where to.
    pub output: MaskOutput,
}

/// Two sparse renders to unite.
#[derive(Clone, Debug, PartialEq)]
pub struct Union {
    /// The first render, or a pattern.
    pub first: PathBuf,
    /// The second render, or a pattern.
    pub second: PathBuf,
    /// The frames of the patterns; all that exist of either if `None`.
    pub frames: Option<Frames>,
    /// Where their masks come from.
    pub source: Source,
    /// Where to.
    pub output: MaskOutput,
}

/// Chooses the next pixels of every frame; the exit status.
pub fn next(task: &NextPass, memory: Option<u64>, console: &Console) -> Result<u8, PlanError> {
    let written: Vec<&Path> =
        std::iter::once(task.output.path.as_path()).chain(task.error_estimate.as_deref()).collect();
    let found = Found { input: &task.frame, other: None, frames: task.frames.as_ref() };
    each(&found, &written, console, |frame, number| {
        let task = task.of_frame(frame, number);
        task.check()?;
        task.output.make_folder(&task.output.path)?;
        let needed = memory::to_read(frame).saturating_add(memory::to_choose_of(frame));
        memory::afford(memory, needed).map_err(|error| failed(frame)(error.into()))?;
        task.write(memory::reading(memory), console)
    })
}

/// Unites the renders of every frame; the exit status.
pub fn unite(task: &Union, memory: Option<u64>, console: &Console) -> Result<u8, PlanError> {
    let found = Found { input: &task.first, other: Some(&task.second), frames: task.frames.as_ref() };
    each(&found, &[&task.output.path], console, |first, number| {
        let second = of_frame(&task.second, number);
        let source = source_of_frame(&task.source, number);
        let output = of_frame(&task.output.path, number);
        let mask = source.path().map(|path| (path, "mask"));
        Sources::new([(first, "first render"), (&*second, "second render")].into_iter().chain(mask))
            .check(&output)?;
        if !task.output.wants(&output, console) {
            return Ok(());
        }
        task.output.make_folder(&output)?;
        let limits = memory::reading(memory);
        let (a, a_masks) = read(first, &source, limits, console)?;
        let (b, b_masks) = read(&second, &source, limits, console)?;
        for (path, masks) in [(first, &a_masks), (&*second, &b_masks)] {
            if source == Source::Auto && masks.mask_channels.iter().all(Vec::is_empty) {
                let why = "nothing is missing in it, so that there is nothing to unite".into();
                return Err(failed(path)(MakeError::Other(why)));
            }
        }
        let forget = |attributes: &mut Attributes| dropped_note(&remove(attributes, of_other_pixels()));
        let mut merged = merge::merge((a, &a_masks), (&b, &b_masks), forget).map_err(failed(&second))?;
        for at in 0..merged.frame.parts.len() {
            let label = part_label(&merged.frame, at);
            let notes = make_writable(&mut merged.frame.parts[at], None);
            merged.notes.extend(prefixed(&label, notes));
        }
        merged.notes.iter().for_each(|note| console.warning(&format!("{}: {note}", output.display())));
        let options = WriteOptions { compression_level: None, over: Over::unless(task.output.no_clobber) };
        let written = lacuna_exr::write(&merged.frame, &output, &options).map_err(MakeError::from);
        if task.output.wrote(&output, written, console)? {
            console.note(&format!("{}: density {:.3} %", output.display(), 100.0 * merged.density));
        }
        Ok(())
    })
}

/// Where frames come from.
struct Found<'a> {
    /// A file, or a pattern or glob of frames.
    input: &'a Path,
    /// A pattern of further files of the same frames, where there are two.
    other: Option<&'a Path>,
    /// The frames; all that exist of either if `None`.
    frames: Option<&'a Frames>,
}

impl Found<'_> {
    /// The frames of the input, or nothing if that is one file. A number that only the other files have is a frame whose file is missing.
    fn frames(&self, numbered: &[&Path]) -> Result<Option<Vec<Input>>, PlanError> {
        let selection = |input: &Path| Selection {
            inputs: vec![input.into()],
            files_from: None,
            frames: self.frames.cloned(),
        };
        let found = resolve(&selection(self.input))?;
        if !found.is_set {
            return Ok(None);
        }
        let mut frames = found.frames;
        for path in self.other.iter().chain(numbered) {
            if !matches!(Pattern::of(path), Ok(Some(_))) {
                return Err(PlanError::Usage(format!(
                    "{}: several frames need a pattern here too, such as next.####.exr",
                    path.display()
                )));
            }
        }
        if let (Some(other), None) = (self.other, self.frames) {
            let own: BTreeSet<_> = frames.iter().map(|frame| frame.number).collect();
            let further = resolve(&selection(other))?.frames.into_iter();
            let further = further.filter(|frame| !own.contains(&frame.number));
            frames.extend(
                further.map(|frame| Input { path: of_frame(self.input, frame.number), number: frame.number }),
            );
            frames.sort_by_key(|frame| frame.number);
        }
        Ok(Some(frames))
    }
}

/// Does one frame, or all of a pattern; one that fails does not stop the others.
fn each(
    found: &Found<'_>,
    numbered: &[&Path],
    console: &Console,
    one: impl Fn(&Path, Option<i64>) -> Result<(), PlanError>,
) -> Result<u8, PlanError> {
    let Some(frames) = found.frames(numbered)? else {
        return one(found.input, None).map(|()| 0);
    };
    let mut status = 0;
    console.begin(frames.len() as u64);
    for frame in &frames {
        let path = frame.path.display();
        let done = match frame.number {
            // What a glob has no file for goes by the glob's name.
            Some(number) if frame.path == found.input && !frame.path.exists() => {
                Err(PlanError::Failed(format!("{path}: no file of frame {number} matches")))
            }
            Some(_) => one(&frame.path, frame.number),
            None => Err(PlanError::Failed(format!("{path}: no frame number in its name"))),
        };
        if let Err(error) = done {
            console.error(&error.to_string());
            status = 1;
        }
        console.advance(1);
    }
    console.end();
    Ok(status)
}

impl NextPass {
    fn of_frame(&self, frame: &Path, number: Option<i64>) -> Self {
        Self {
            frame: frame.into(),
            number,
            source: source_of_frame(&self.source, number),
            error_estimate: self.error_estimate.as_ref().map(|path| of_frame(path, number)),
            bounds: self.bounds.of_frame(number),
            output: MaskOutput { path: of_frame(&self.output.path, number), ..self.output.clone() },
            ..self.clone()
        }
    }

    /// Refuses outputs that are inputs or each other.
    fn check(&self) -> Result<(), PlanError> {
        let mask = self.source.path().map(|path| (path, "mask"));
        let read = std::iter::once((&*self.frame, "frame")).chain(mask).chain(self.bounds.files());
        let mut read = Sources::new(read);
        let estimate = self.error_estimate.as_deref().map(|path| ("--error-estimate", path));
        let outputs: Vec<_> = std::iter::once(("-o", &*self.output.path)).chain(estimate).collect();
        outputs.iter().try_for_each(|(_, output)| read.check(output))?;
        reports::check(&outputs, false)
    }

    fn choose(&self, limits: Limits, console: &Console) -> Result<after::Next, PlanError> {
        let (frame, masks) = read(&self.frame, &self.source, limits, console)?;
        let choices = channels::choose(&frame, &masks.mask_channels, &[]);
        let bounds = |window| self.bounds.read(window, limits);
        let preference = Preference::new(self.seed, self.number);
        after::next(&frame, &masks, &choices, self.add, preference, bounds).map_err(failed(&self.frame))
    }

    fn write(&self, limits: Limits, console: &Console) -> Result<(), PlanError> {
        let mask = Some(self.output.path.as_path()).filter(|path| self.output.wants(path, console));
        let estimate = self.error_estimate.as_deref().filter(|path| self.output.wants(path, console));
        if mask.is_none() && estimate.is_none() {
            return Ok(());
        }
        let (next, mut how) = (self.choose(limits, console)?, self.output.writing());
        if let Some(path) = mask {
            how.attributes = vec![(PATTERN, "after".into()), (SEED, self.seed.to_string())];
            let written = write_mask(path, &next.mask, next.window, &Listing::Given(&next.pixels), &how);
            if self.output.wrote(path, written, console)? {
                report(path, &next.mask, console);
            }
        }
        if let Some(path) = estimate {
            how.attributes.clear();
            let largest = next.error.pixels().iter().copied().fold(0.0, f32::max);
            let pixels = next.error.pixels().to_vec();
            let written = write_floats(path, "error", pixels, largest, next.window, &how);
            self.output.wrote(path, written, console)?;
        }
        Ok(())
    }
}

fn read(
    path: &Path,
    source: &Source,
    limits: Limits,
    console: &Console,
) -> Result<(Frame, Masks), PlanError> {
    let fail = |error: MakeError| failed(path)(error);
    let frame = lacuna_exr::read(path, &limits).map_err(|error| fail(error.into()))?;
    let file = match source.path() {
        Some(file) => Some(MaskFile::read(file, limits).map_err(|error| fail(error.into()))?),
        None => None,
    };
    let masks = mask::find(&frame, source, file.as_ref()).map_err(|error| fail(error.into()))?;
    masks.notes.iter().for_each(|note| console.warning(&format!("{}: {note}", path.display())));
    Ok((frame, masks))
}
