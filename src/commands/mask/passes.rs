//! After a first pass, frame by frame: the pixels to compute next, and two renders united.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use lacuna_exr::{Attributes, Frame, Limits, Over, WriteOptions};
use lacuna_filters::sampling::refine::Preference;

use super::output::{BoundFiles, MaskOutput, failed, of_frame, output_of_frame, report, source_of_frame};
use crate::channels::{self, part_label};
use crate::files::error::PlanError;
use crate::files::inputs::{Input, Selection, resolve};
use crate::files::patterns::Pattern;
use crate::files::plan::check_apart;
use crate::files::ranges::Frames;
use crate::files::reports;
use crate::mask::output::{Listing, write_floats, write_mask};
use crate::mask::{self, MakeError, MaskFile, Masks, PATTERN, SEED, Source, after, merge};
use crate::reconstruct::{drop_errors, dropped_note, make_writable, of_other_pixels, prefixed, remove};
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
    let written: Vec<&Path> = task.written().into_iter().map(|(_, path)| path).collect();
    let found = Found { input: &task.frame, other: None, frames: task.frames.as_ref() };
    each(&found, &written, memory, console, |frame, number| task.of_frame(frame, number))
}

/// Unites the renders of every frame; the exit status.
pub fn unite(task: &Union, memory: Option<u64>, console: &Console) -> Result<u8, PlanError> {
    let found = Found { input: &task.first, other: Some(&task.second), frames: task.frames.as_ref() };
    each(&found, &[&task.output.path], memory, console, |first, number| task.of_frame(first, number))
}

/// What is done with one frame. Its files are known before any frame is read.
trait OfFrame {
    /// The frame.
    fn frame(&self) -> &Path;
    /// All files that it reads, and what they are.
    fn read(&self) -> Vec<(&Path, &'static str)>;
    /// The files that it writes, each with its flag.
    fn written(&self) -> Vec<reports::Asked<'_>>;
    /// Does it.
    fn run(&self, memory: Option<u64>, console: &Console) -> Result<(), PlanError>;
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

/// Does one frame, or all of a pattern, once no output of any frame is another one or a file that any reads; one that fails does not
/// stop the others.
fn each<T: OfFrame>(
    found: &Found<'_>,
    numbered: &[&Path],
    memory: Option<u64>,
    console: &Console,
    of: impl Fn(&Path, Option<i64>) -> T,
) -> Result<u8, PlanError> {
    let Some(frames) = found.frames(numbered)? else {
        let task = of(found.input, None);
        check(std::iter::once(&task))?;
        return task.run(memory, console).map(|()| 0);
    };
    let task = |frame: &Input| {
        let path = frame.path.display();
        match frame.number {
            // What a glob has no file for goes by the glob's name.
            Some(number) if frame.path == found.input && !frame.path.exists() => {
                Err(PlanError::Failed(format!("{path}: no file of frame {number} matches")))
            }
            Some(_) => Ok(of(&frame.path, frame.number)),
            None => Err(PlanError::Failed(format!("{path}: no frame number in its name"))),
        }
    };
    let tasks: Vec<Result<T, PlanError>> = frames.iter().map(task).collect();
    check(tasks.iter().flatten())?;
    let mut status = 0;
    console.begin(frames.len() as u64);
    for task in tasks {
        if let Err(error) = task.and_then(|task| task.run(memory, console)) {
            console.error(&error.to_string());
            status = 1;
        }
        console.advance(1);
    }
    console.end();
    Ok(status)
}

/// Refuses outputs that are inputs or each other, of one frame or of two.
fn check<'a, T: OfFrame + 'a>(tasks: impl Iterator<Item = &'a T> + Clone) -> Result<(), PlanError> {
    tasks.clone().try_for_each(|task| reports::check(&task.written(), false))?;
    let made = |task: &'a T| task.written().into_iter().map(|(_, output)| (task.frame(), output));
    check_apart(tasks.clone().flat_map(made), tasks.flat_map(T::read))
}

impl OfFrame for Union {
    fn frame(&self) -> &Path {
        &self.first
    }

    fn read(&self) -> Vec<(&Path, &'static str)> {
        let mask = self.source.path().map(|path| (path, "mask"));
        let renders = [(&*self.first, "first render"), (&*self.second, "second render")];
        renders.into_iter().chain(mask).collect()
    }

    fn written(&self) -> Vec<reports::Asked<'_>> {
        vec![("-o", &self.output.path)]
    }

    fn run(&self, memory: Option<u64>, console: &Console) -> Result<(), PlanError> {
        let Self { first, second, source, output, .. } = self;
        let path = &output.path;
        if !output.wants(path, console)? {
            return Ok(());
        }
        output.make_folder(path)?;
        let limits = memory::reading(memory);
        let without_errors = |path: &Path| {
            let mut frame = read(path, limits)?;
            for note in drop_errors(&mut frame, |_, _| true) {
                console.warning(&format!("{}: {note}", path.display()));
            }
            Ok((masks_of(path, &frame, source, limits, console)?, frame))
        };
        let ((a_masks, a), (b_masks, b)) = (without_errors(first)?, without_errors(second)?);
        for (path, masks) in [(first, &a_masks), (second, &b_masks)] {
            if *source == Source::Auto && masks.mask_channels.iter().all(Vec::is_empty) {
                let why = "nothing is missing in it, so that there is nothing to unite".into();
                return Err(failed(path)(MakeError::Other(why)));
            }
        }
        let forget = |attributes: &mut Attributes| dropped_note(&remove(attributes, of_other_pixels()));
        let mut merged = merge::merge((a, &a_masks), (&b, &b_masks), forget).map_err(failed(second))?;
        for at in 0..merged.frame.parts.len() {
            let label = part_label(&merged.frame, at);
            let notes = make_writable(&mut merged.frame.parts[at], None);
            merged.notes.extend(prefixed(&label, notes));
        }
        merged.notes.iter().for_each(|note| console.warning(&format!("{}: {note}", path.display())));
        let options = WriteOptions { compression_level: None, over: Over::unless(output.no_clobber) };
        let written = lacuna_exr::write(&merged.frame, path, &options).map_err(MakeError::from);
        if output.wrote(path, written, console)? {
            console.note(&format!("{}: density {:.3} %", path.display(), 100.0 * merged.density));
        }
        Ok(())
    }
}

impl Union {
    fn of_frame(&self, first: &Path, number: Option<i64>) -> Self {
        Self {
            first: first.into(),
            second: of_frame(&self.second, number),
            source: source_of_frame(&self.source, number),
            output: self.output.of_frame(first, number),
            ..self.clone()
        }
    }
}

impl OfFrame for NextPass {
    fn frame(&self) -> &Path {
        &self.frame
    }

    fn read(&self) -> Vec<(&Path, &'static str)> {
        let mask = self.source.path().map(|path| (path, "mask"));
        std::iter::once((&*self.frame, "frame")).chain(mask).chain(self.bounds.files()).collect()
    }

    fn written(&self) -> Vec<reports::Asked<'_>> {
        let estimate = self.error_estimate.as_deref().map(|path| ("--error-estimate", path));
        std::iter::once(("-o", &*self.output.path)).chain(estimate).collect()
    }

    fn run(&self, memory: Option<u64>, console: &Console) -> Result<(), PlanError> {
        // Both are to be there before pixels are chosen.
        self.written().into_iter().try_for_each(|(_, path)| self.output.make_folder(path))?;
        let needed = memory::to_read(&self.frame).saturating_add(memory::to_choose_of(&self.frame));
        memory::afford(memory, needed).map_err(|error| failed(&self.frame)(error.into()))?;
        self.write(memory::reading(memory), console)
    }
}

impl NextPass {
    fn of_frame(&self, frame: &Path, number: Option<i64>) -> Self {
        Self {
            frame: frame.into(),
            number,
            source: source_of_frame(&self.source, number),
            error_estimate: self.error_estimate.as_ref().map(|path| output_of_frame(path, frame, number)),
            bounds: self.bounds.of_frame(number),
            output: self.output.of_frame(frame, number),
            ..self.clone()
        }
    }

    fn choose(&self, limits: Limits, console: &Console) -> Result<after::Next, PlanError> {
        let frame = read(&self.frame, limits)?;
        let masks = masks_of(&self.frame, &frame, &self.source, limits, console)?;
        let choices = channels::choose(&frame, &masks.mask_channels, &[]);
        let bounds = |window| self.bounds.read(window, limits);
        let preference = Preference::new(self.seed, self.number);
        after::next(&frame, &masks, &choices, self.add, preference, bounds).map_err(failed(&self.frame))
    }

    fn write(&self, limits: Limits, console: &Console) -> Result<(), PlanError> {
        let (mask, estimate) = (self.output.path.as_path(), self.error_estimate.as_deref());
        let wants = |path: &Path| self.output.wants(path, console);
        let (wants_mask, wants_estimate) = (wants(mask)?, estimate.map_or(Ok(false), wants)?);
        if !wants_mask && !wants_estimate {
            return Ok(());
        }
        let (next, mut how) = (self.choose(limits, console)?, self.output.writing());
        if let Some(path) = wants_mask.then_some(mask) {
            how.attributes = vec![(PATTERN, "after".into()), (SEED, self.seed.to_string())];
            let written = write_mask(path, &next.mask, next.window, &Listing::Given(&next.pixels), &how);
            if self.output.wrote(path, written, console)? {
                report(path, &next.mask, console);
            }
        }
        if let Some(path) = estimate.filter(|_| wants_estimate) {
            how.attributes.clear();
            let largest = next.error.pixels().iter().copied().fold(0.0, f32::max);
            let pixels = next.error.pixels().to_vec();
            let written = write_floats(path, "error", pixels, largest, next.window, &how);
            self.output.wrote(path, written, console)?;
        }
        Ok(())
    }
}

fn read(path: &Path, limits: Limits) -> Result<Frame, PlanError> {
    lacuna_exr::read(path, &limits).map_err(|error| failed(path)(error.into()))
}

fn masks_of(
    path: &Path,
    frame: &Frame,
    source: &Source,
    limits: Limits,
    console: &Console,
) -> Result<Masks, PlanError> {
    let fail = |error: MakeError| failed(path)(error);
    let file = match source.path() {
        Some(file) => Some(MaskFile::read(file, limits).map_err(|error| fail(error.into()))?),
        None => None,
    };
    let masks = mask::find(frame, source, file.as_ref()).map_err(|error| fail(error.into()))?;
    masks.notes.iter().for_each(|note| console.warning(&format!("{}: {note}", path.display())));
    Ok(masks)
}
