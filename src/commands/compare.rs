//! Comparing frames with their references: what is done with each, and with all of them.

mod ending;

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use lacuna_exr::{Frame, Part};

use crate::commands::compare::ending::{judged, write, write_json};
use crate::files::error::PlanError;
use crate::files::identity::Sources;
use crate::files::inputs::Selection;
use crate::files::patterns::number_in_name;
use crate::files::plan::{Item, Plan, check_reports, pair};
use crate::files::reports;
use crate::mask::claimed_density;
use crate::mask::shared::MaskFiles;
use crate::mask::{self, Masks, Source};
use crate::report::{
    self, Changed, Comparison, Flicker, FrameReport, Gate, Images, MOST_PIXELS, Maps, Measure, Pair, Picture,
    Settings,
};
use crate::run::batch::{Decision, Failure, LastWords, RunOptions, Stage, Work};
use crate::run::console::Console;
use crate::run::record::{Heading, Record};
use crate::run::schedule::Need;
use crate::run::{batch, memory, outputs};
use crate::verify::Claims;

/// Frames to be compared.
#[derive(Clone, Debug, PartialEq)]
pub struct CompareJob {
    /// The references.
    pub selection: Selection,
    /// Whether references that do not exist are passed over.
    pub skip_missing: bool,
    /// File, pattern or folder of the test images.
    pub test: PathBuf,
    /// Where the mask comes from; what the test image says, if anything, if `None`.
    pub mask: Option<Source>,
    /// How images are compared.
    pub settings: Settings,
    /// What decides the exit status.
    pub gate: Gate,
    /// What is written.
    pub outputs: CompareOutputs,
    /// How to run; its `json` is the comparison's.
    pub run: RunOptions,
}

/// Files that a comparison writes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CompareOutputs {
    /// As CSV.
    pub csv: Option<PathBuf>,
    /// As Markdown.
    pub markdown: Option<PathBuf>,
    /// As one HTML page.
    pub html: Option<PathBuf>,
    /// A folder for maps of each frame.
    pub maps: Option<PathBuf>,
}

/// Compares the frames; the exit status.
pub fn compare(job: &CompareJob) -> Result<u8, PlanError> {
    let mask = match &job.mask {
        Some(Source::File { pattern, .. }) => Some(pattern.as_str()),
        _ => None,
    };
    let items = pair(&job.selection, &job.test, mask)?;
    check_outputs(job, &items)?;
    let work = Compare::new(job, &items);
    let console = job.run.console_beside(&job.outputs.reports())?;
    if job.run.dry_run {
        return Ok(outputs::print(
            &Plan { items: items.clone(), new_folders: BTreeSet::new() },
            &work,
            &console,
        ));
    }
    if let Some(folder) = &job.outputs.maps {
        std::fs::create_dir_all(folder).map_err(|error| {
            PlanError::Failed(format!("{}: cannot make the folder: {error}", folder.display()))
        })?;
    }
    console.listen();
    let heading =
        Heading { lacuna: env!("CARGO_PKG_VERSION"), command: "compare", filter: None, settings: None };
    let run = RunOptions { json: None, ..job.run.clone() };
    let status = batch::run(heading, &items, &run, &work, &console).map_err(PlanError::Failed)?;
    let (comparison, pictures) = work.finish(&console);
    let failed = comparison.frames.iter().any(|frame| !frame.failures.is_empty());
    let unwritten = write(job, &comparison, &pictures);
    for error in &unwritten {
        console.error(error);
    }
    Ok(status.max(u8::from(failed || !unwritten.is_empty())))
}

/// Refuses outputs that are inputs, or that cannot be files.
fn check_outputs(job: &CompareJob, items: &[Item]) -> Result<(), PlanError> {
    let run = [&job.run.json, &job.run.log].into_iter().flatten().map(PathBuf::as_path);
    check_reports(items, run.chain(job.outputs.reports().into_iter().map(|(_, path)| path)))?;
    let Some(folder) = &job.outputs.maps else { return Ok(()) };
    let mut read = Sources::new(items.iter().flat_map(Item::compared));
    let mut owners: HashMap<String, &Item> = HashMap::new();
    for item in items {
        let name = map_name(item);
        read.check(&folder.join(format!("{name}.maps.exr")))?;
        if let Some(other) = owners.insert(name.clone(), item) {
            return Err(PlanError::Usage(format!(
                "--maps {}: the maps of {} and {} would both be called {name}; compare them one by one",
                folder.display(),
                other.input.display(),
                item.input.display()
            )));
        }
    }
    Ok(())
}

/// What the maps of a frame are called: as the test image, with the frame's number where only its folder has it.
fn map_name(item: &Item) -> String {
    let stem = item.output.file_stem().map(|stem| stem.display().to_string()).unwrap_or_default();
    match item.number.filter(|&number| number_in_name(&item.output) != Some(number)) {
        Some(number) => format!("{stem}.{number:04}"),
        None => stem,
    }
}

impl CompareOutputs {
    /// The reports by their flags.
    fn reports(&self) -> Vec<reports::Asked<'_>> {
        let all = [("--csv", &self.csv), ("--md", &self.markdown), ("--html", &self.html)];
        all.into_iter().filter_map(|(flag, path)| Some((flag, path.as_deref()?))).collect()
    }
}

struct Compare<'a> {
    job: &'a CompareJob,
    items: &'a [Item],
    masks: MaskFiles,
    /// A signal's thread needs it as well.
    found: Arc<Mutex<Found>>,
}

/// What was found so far.
struct Found {
    frames: Vec<FrameReport>,
    flicker: Flicker,
    pictures: Vec<Option<Picture>>,
}

impl Found {
    fn enter(&mut self, changes: &[Changed]) {
        for changed in changes {
            let is_own = |frame: &&mut FrameReport| frame.frame == Some(changed.number);
            if let Some(frame) = self.frames.iter_mut().find(is_own) {
                enter_changes(frame, changed);
            }
        }
    }
}

impl Work for Compare<'_> {
    fn words(&self) -> (&'static str, &'static str) {
        ("compare", "compared")
    }

    fn is_gate(&self) -> bool {
        true
    }

    fn decide(&self, item: &Item) -> Result<Decision, Failure> {
        let decision = outputs::decide(item, self.job.skip_missing);
        let at = self.index(item);
        match &decision {
            Ok(Decision::Skip(reason)) => self.found().frames[at].skipped = Some(reason.clone()),
            Err(failure) => self.found().frames[at].error = Some(failure.text.clone()),
            Ok(Decision::Do | Decision::Again(_)) => {}
        }
        decision
    }

    fn pieces(&self) -> u64 {
        u64::from(self.wants_changes())
    }

    fn need(&self, item: &Item) -> Need {
        let (reference, test) = (&item.input, &item.output);
        let kept = || memory::to_follow(reference, test, self.job.settings.wanted.has_motion());
        let kept = if self.wants_changes() { kept() } else { 0 };
        memory::to_compare(reference, test).saturating_add(kept).into()
    }

    fn lost(&self, item: &Item) {
        if let Some(number) = item.number {
            self.found().flicker.lost(number);
        }
    }

    fn last_words(&self, console: &Arc<Console>) -> Option<LastWords> {
        self.job.run.json.as_ref()?;
        let (job, found, console) = (self.job.clone(), Arc::clone(&self.found), Arc::clone(console));
        Some(Box::new(move || {
            let frames = found.lock().unwrap_or_else(PoisonError::into_inner).frames.clone();
            write_json(&job.run, &judged(&job, frames, "not compared: stopped by a signal", &console))
        }))
    }

    fn frame(&self, item: &Item, stage: &Stage<'_>, record: &mut Record) -> Result<(), Failure> {
        let result = self.one(item, stage, record);
        if let Err(failure) = &result {
            let at = self.index(item);
            let frame = &mut self.found().frames[at];
            // What was measured stays, whatever became of the maps.
            if frame.groups.is_empty() {
                frame.error = Some(failure.text.clone());
            } else {
                frame.notes.push(format!("{}: {}", failure.file.display(), failure.text));
            }
        }
        result
    }
}

/// Says what makes a pair of frames an odd one to compare.
fn warn_of(reference: &Frame, test: &Frame) {
    if Claims::are_swapped(reference, test) {
        tracing::warn!("only the reference was filled by lacuna, and it comes first: are the two swapped?");
    }
    if crate::sparsify::check_complete(reference).is_err() {
        tracing::warn!(
            "the reference is sparse by its mask, and was not filled: where its pixels are missing, errors say nothing"
        );
    }
}

impl<'a> Compare<'a> {
    fn new(job: &'a CompareJob, items: &'a [Item]) -> Self {
        let pending = |item: &Item| FrameReport {
            frame: item.number,
            reference: item.input.display().to_string(),
            test: item.output.display().to_string(),
            ..FrameReport::default()
        };
        let frames = items.iter().map(pending).collect();
        let flicker = Flicker::new(items.iter().filter_map(|item| item.number));
        let pictures = items.iter().map(|_| None).collect();
        Self {
            job,
            items,
            masks: MaskFiles::default(),
            found: Arc::new(Mutex::new(Found { frames, flicker, pictures })),
        }
    }

    fn found(&self) -> MutexGuard<'_, Found> {
        self.found.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The place of an item of the plan in the order asked for.
    fn index(&self, item: &Item) -> usize {
        self.items.iter().position(|other| std::ptr::eq(other, item) || other == item).unwrap_or(0)
    }

    /// Whether changes from frame to frame are asked for, and there are some.
    fn wants_changes(&self) -> bool {
        self.job.settings.wanted.has_changes() && self.items.len() > 1
    }

    fn one(&self, item: &Item, stage: &Stage<'_>, record: &mut Record) -> Result<(), Failure> {
        let limits = memory::limits(self.job.run.memory, self.need(item).most);
        let (reference, test) = stage.read(record, || {
            let read = |path| lacuna_exr::read(path, &limits).map_err(|error| Failure::at(path, error));
            let reference = read(&item.input)?;
            if !item.output.exists() {
                let text = "the test image does not exist: make it, or leave its frame out with --frames \
                            (--missing-frame skip is for references)";
                return Err(Failure::at(&item.output, text));
            }
            Ok((reference, read(&item.output)?))
        })?;
        warn_of(&reference, &test);
        let (masks, unknown) = self.mask_of(item, &reference, &test, limits)?;
        record.density = masks.as_ref().and_then(Masks::density);
        let index = self.index(item);
        let mut seen = Seen::default();
        let wants_changes = self.wants_changes();
        let compared = stage.solve(record, || {
            report::compare(&reference, &test, masks.as_ref(), &self.job.settings, &mut |images: &Images<
                '_,
            >| {
                if wants_changes {
                    seen.colours.extend(Flicker::colours(images));
                }
                seen.look(images, &self.job.outputs, self.items.len());
            })
        });
        let mut compared = compared.map_err(|error| Failure::at(&item.output, error))?;
        compared.notes.extend(unknown);
        for note in &compared.notes {
            tracing::warn!("{note}");
        }
        let written = stage.write(record, || self.write_maps(item, std::mem::take(&mut seen.maps)));
        let mut found = self.found();
        if wants_changes {
            compared.notes.extend(self.why_no_flicker(item, &found.flicker));
        }
        let slot = &mut found.frames[index];
        *slot = FrameReport {
            frame: slot.frame,
            reference: std::mem::take(&mut slot.reference),
            test: std::mem::take(&mut slot.test),
            ..compared
        };
        found.pictures[index] = seen.picture;
        keep_the_worst(&mut found.pictures);
        if let Some(number) = item.number.filter(|_| wants_changes) {
            let moving = self.job.settings.wanted.has_motion().then(|| Arc::new(reference));
            let pairs = found.flicker.enter(number, seen.colours, moving);
            drop(found);
            // Motion takes its time, and others shall not wait for it.
            let changes: Vec<Changed> =
                stage.solve_more(record, || pairs.iter().flat_map(Pair::changes).collect());
            self.found().enter(&changes);
        }
        written
    }

    /// What keeps a frame of a sequence from having a flicker, if anything does; the first one has none.
    fn why_no_flicker(&self, item: &Item, flicker: &Flicker) -> Option<String> {
        let first = self.items.iter().filter_map(|item| item.number).min();
        let alone = item.number.filter(|number| Some(*number) != first && !flicker.expects(*number));
        alone.map(|_| "no flicker: no frame, or more than one, has the number before its own".to_owned())
    }

    /// The mask: the one asked for, in the test image or else in the reference; if none was asked for, what the test
    /// image says, where it says anything. A filled image whose mask is not to be had is compared without, and why is told.
    fn mask_of(
        &self,
        item: &Item,
        reference: &Frame,
        test: &Frame,
        limits: lacuna_exr::Limits,
    ) -> Result<(Option<Masks>, Option<String>), Failure> {
        let claims = Claims::read(test);
        let source = self.job.mask.as_ref().unwrap_or(&claims.mask);
        let path = match (&item.mask, source) {
            (Some(path), _) => Some(path.as_path()),
            (None, Source::File { pattern, .. }) => Some(Path::new(pattern)),
            _ => None,
        };
        let file = path.map(|path| self.masks.get(path, limits)).transpose();
        let found = file.map_err(|error| Failure::at(&item.output, error)).and_then(|file| {
            let in_test = mask::find(test, source, file.as_deref());
            // A mask for the reference serves as well, where the windows of both are the same.
            let windows = |frame: &Frame| frame.parts.iter().map(|part| part.data_window).collect::<Vec<_>>();
            let found = in_test.or_else(|error| match file.as_deref() {
                file if windows(reference) == windows(test) => {
                    mask::find(reference, source, file).map_err(|_| error)
                }
                _ => Err(error),
            });
            found.map_err(|error| Failure::at(&item.output, error))
        });
        match found {
            Ok(masks) if !shows_still(source, test, &masks) => {
                if self.job.mask.is_some() {
                    let why =
                        "finds other pixels in the filled frame than were missing; give an image of the mask";
                    return Err(Failure::at(
                        &item.output,
                        format!("--mask {source} {why}: --mask file:IMAGE"),
                    ));
                }
                let why = format!("was '{source}', which a filled frame does not show");
                Ok((None, Some(apart(&why))))
            }
            Ok(masks) if self.job.mask.is_some() && masks.density().is_none() => {
                let why = masks.why_none.iter().flatten().flatten().next().map_or("no mask", String::as_str);
                let text = format!("--mask {source}: {why}: give a mask that covers the test image");
                Err(Failure::at(&item.output, text))
            }
            Ok(masks) => Ok((Some(masks), None)),
            Err(failure) if self.job.mask.is_none() => {
                let claimed = !claims.filter.is_empty() && *source != Source::Auto;
                let why = if claimed {
                    Some(format!("is '{source}' ({})", failure.text))
                } else {
                    claims.drop_mask.then(|| "was left out of the file by --drop-mask".to_owned())
                };
                Ok((None, why.as_deref().map(apart)))
            }
            Err(failure) => Err(failure),
        }
    }

    /// Everything that was found, judged by the gate; failures are named.
    fn finish(&self, console: &Console) -> (Comparison, Vec<Option<Picture>>) {
        let pictures = std::mem::take(&mut self.found().pictures);
        // A copy: a signal's thread may need the frames while reports are written.
        let frames = self.found().frames.clone();
        // What was refused before it was opened, by its memory say.
        (judged(self.job, frames, "not compared; the log says why", console), pictures)
    }

    /// Writes the maps of a frame beside each other, named after the test image.
    fn write_maps(&self, item: &Item, maps: Maps) -> Result<(), Failure> {
        let (Some(folder), Some((frame, pictures))) = (&self.job.outputs.maps, maps.finish()) else {
            return Ok(());
        };
        let stem = map_name(item);
        let path = folder.join(format!("{stem}.maps.exr"));
        lacuna_exr::write(&frame, &path, &lacuna_exr::WriteOptions::default())
            .map_err(|error| Failure::at(&path, error))?;
        for (name, png) in pictures {
            let path = folder.join(format!("{stem}.{name}.png"));
            lacuna_exr::write_whole(&path, &png).map_err(|error| Failure::at(&path, error))?;
        }
        Ok(())
    }
}

/// What is taken from the images of a frame while they are there.
#[derive(Default)]
struct Seen {
    colours: Vec<(String, report::Colours)>,
    picture: Option<Picture>,
    maps: Maps,
}

impl Seen {
    fn look(&mut self, images: &Images<'_>, outputs: &CompareOutputs, frames: usize) {
        if outputs.html.is_some() && images.main {
            let width = if frames <= 20 { 160 } else { 64 };
            self.picture = Picture::new(images, width);
        }
        if outputs.maps.is_some() {
            self.maps.add(images);
        }
    }
}

/// That nothing is said of missing pixels alone, and why.
fn apart(why: &str) -> String {
    format!("nothing is said of the missing pixels alone: their mask {why}; name it with --mask file:IMAGE")
}

/// Whether a mask that was read from values is still what a filled image says that it was.
fn shows_still(source: &Source, filled: &Frame, masks: &Masks) -> bool {
    let by_values = matches!(source, Source::Alpha | Source::Finite | Source::Count { .. });
    let same = |(index, part): (usize, &Part)| match (claimed_density(part), masks.part_density(index)) {
        (Some(claimed), Some(found)) => claimed.to_bits() == (found as f32).to_bits(),
        _ => true,
    };
    !by_values || filled.parts.iter().enumerate().all(same)
}

/// Keeps every pixel of the worst frames only, as many as a page holds; which those are does not depend on the order of frames.
fn keep_the_worst(pictures: &mut [Option<Picture>]) {
    let pixels = |picture: &Option<Picture>| {
        picture
            .as_ref()
            .and_then(|picture| picture.pixels.as_ref())
            .map_or(0, |pixels| pixels.width * pixels.height)
    };
    while pictures.iter().map(pixels).sum::<usize>() > MOST_PIXELS {
        let mut full: Vec<_> =
            pictures.iter_mut().flatten().filter(|picture| picture.pixels.is_some()).collect();
        if full.len() < 2 {
            return;
        }
        full.sort_by(|a, b| a.score.total_cmp(&b.score));
        if let Some(best) = full.last_mut() {
            best.pixels = None;
        }
    }
}

/// Enters what changed where it was measured: in the missing pixels, or everywhere if there is no mask.
fn enter_changes(frame: &mut FrameReport, changed: &Changed) {
    let group = frame.groups.iter_mut().find(|group| group.label() == changed.label);
    let regions = group.map(|group| &mut group.regions);
    let region = regions.and_then(|regions| {
        let missing = regions.iter().position(|region| region.region == "missing").unwrap_or(0);
        regions.get_mut(missing)
    });
    if let Some(region) = region {
        region.measures.set(Measure::Flicker, changed.still.flicker);
        region.measures.set(Measure::Change, changed.still.truth);
        if let Some(along) = changed.along {
            region.measures.set(Measure::FlickerAlong, along.flicker);
            region.measures.set(Measure::ChangeAlong, along.truth);
        }
    }
}
