//! Rendering frames of a scene: what is done with each, and with all of them.

mod motion;
mod picture;
mod rounds;
mod settings;
mod sources;

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use lacuna_exr::{Frame, PartHeader};
use lacuna_filters::fill::Estimate;
use lacuna_filters::sampling::{self, Field, Temporal, adaptive};
use lacuna_filters::{Mask, Method, Run, Size, Stop};
use lacuna_volume::{Camera, Look, Override, Picture, Scene, Shader, Shot};
use picture::Story;
pub use picture::Wanted;
use rounds::{Advance, PIECES};
use settings::Settings;
use sources::{check_files, mask_file, name, scene, volume_files};

use crate::channels;
use crate::commands::page::Page;
use crate::files::content::{Seen, Sums};
use crate::files::error::PlanError;
use crate::files::plan::{Item, Plan, Targets, outputs};
use crate::files::ranges::Frames;
use crate::mask::shared::MaskFiles;
use crate::mask::{self, Source};
use crate::reconstruct::{self, Plans, RENDER, Report, SOURCES};
use crate::run::batch::{Decision, Failure, RunOptions, Stage, Work};
use crate::run::existing::{self, Existing};
use crate::run::record::{Heading, Record};
use crate::run::schedule::Need;
use crate::run::{batch, memory, outputs};

const STOPPED: &str = "stopped by a signal";

/// A scene to be rendered, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderJob {
    /// The scene's file, or a volume.
    pub scene: PathBuf,
    /// Values over the scene's.
    pub overrides: Vec<Override>,
    /// The frames; one without a number if `None`.
    pub frames: Option<Frames>,
    /// Where outputs go, and the mask's file.
    pub targets: Targets,
    /// Whether a volume's header may name a file outside its own folder.
    pub allow_outside: bool,
    /// Which pixels are rendered.
    pub pixels: Pixels,
    /// What the frames hold.
    pub wanted: Wanted,
    /// The level of the compression.
    pub level: Option<u8>,
    /// What fills the other pixels, in memory.
    pub fill: Option<Method>,
    /// Whether the error of what was filled is estimated.
    pub estimate: bool,
    /// What happens to outputs that exist.
    pub existing: Existing,
    /// How to run.
    pub run: RunOptions,
}

/// Which pixels are rendered.
#[derive(Clone, Debug, PartialEq)]
pub enum Pixels {
    /// All.
    All,
    /// A nested low-discrepancy pattern of that density, with the scene's seed.
    Shuffle(f64),
    /// Chosen in rounds, with the scene's seed.
    Adaptive(adaptive::Settings),
    /// Those of a mask file.
    Mask(Source),
}

impl Pixels {
    /// Which pixels, on one line, if not all.
    fn pattern(&self) -> Option<String> {
        match self {
            Self::All => None,
            Self::Shuffle(density) => Some(format!("shuffle density={density}")),
            Self::Adaptive(settings) => Some(mask::rounds::pattern(settings)),
            Self::Mask(source) => Some(source.to_string()),
        }
    }
}

impl RenderJob {
    /// Whether there is a scene and a plan for it, as every task of a farm will find. Changes nothing.
    pub fn check(&self) -> Result<(), PlanError> {
        let (plan, (scene, folder)) = (plan(self)?, scene(self)?);
        let plan = plan.with_files(&lacuna_volume::files(&scene, &folder), &self.targets)?;
        plan.items
            .iter()
            .try_for_each(check_files)
            .map_err(|failure| PlanError::Failed(format!("{}: {}", failure.file.display(), failure.text)))?;
        self.run.console().map(drop)
    }
}

/// Renders the frames; the exit status.
pub fn render(job: &RenderJob) -> Result<u8, PlanError> {
    let plan = plan(job)?;
    let console = job.run.console()?;
    let (scene, folder) = match scene(job) {
        Err(PlanError::Failed(text)) if !job.run.dry_run => {
            without_scene(job, &plan, &text).map_err(PlanError::Failed)?;
            console.error(&text);
            return Ok(1);
        }
        other => other?,
    };
    let plan = plan.with_files(&lacuna_volume::files(&scene, &folder), &job.targets)?;
    let work = Render {
        job,
        settings: Settings::new(job, &scene),
        scene,
        folder,
        volume: OnceLock::new(),
        masks: MaskFiles::default(),
        sums: Sums::default(),
        plans: Plans::new(),
        page: Page::new(job.run.page.as_ref(), plan.items.len()),
    };
    if job.run.dry_run {
        return Ok(outputs::print(&plan, &work, &console));
    }
    console.listen();
    outputs::make_folders(&plan)?;
    let heading = heading(job, Some(work.settings.of(None)));
    batch::run(heading, &plan.items, &job.run, &work, &console).map_err(PlanError::Failed)
}

fn heading(job: &RenderJob, settings: Option<String>) -> Heading {
    let filter = job.fill.as_ref().map(|method| method.name().into());
    Heading { lacuna: env!("CARGO_PKG_VERSION"), command: "render", filter, settings }
}

/// The scene cannot be had: the ledger and the report say so of every frame.
fn without_scene(job: &RenderJob, plan: &Plan, text: &str) -> Result<(), String> {
    if job.run.log.is_none() && job.run.json.is_none() {
        return Ok(());
    }
    outputs::make_folders(plan)
        .map_err(|error| error.to_string())
        .and_then(|()| batch::none(heading(job, None), &plan.items, &job.run, text))
        .map_err(|more| format!("{text}; {more}"))
}

fn plan(job: &RenderJob) -> Result<Plan, PlanError> {
    let numbers: Vec<Option<i64>> = match &job.frames {
        None => vec![None],
        Some(frames) => frames.numbers().iter().copied().map(Some).collect(),
    };
    outputs((&job.scene, &name(&job.scene)), &numbers, &job.targets)
}

/// What is rendered, and the files that it was read from.
type Ready = Result<(Arc<lacuna_volume::Stage>, Seen), String>;

struct Render<'a> {
    job: &'a RenderJob,
    settings: Settings,
    scene: Scene,
    folder: PathBuf,
    /// Read by the first frame, for all.
    volume: OnceLock<Ready>,
    masks: MaskFiles,
    sums: Sums,
    plans: Plans,
    page: Page,
}

impl Work for Render<'_> {
    fn words(&self) -> (&'static str, &'static str) {
        ("render", "rendered")
    }

    fn pieces(&self) -> u64 {
        PIECES
    }

    fn decide(&self, item: &Item) -> Result<Decision, Failure> {
        // The scene was read already.
        let decision = outputs::decide_to_make(item, self.job.existing, |item| self.stale(item))?;
        if !matches!(decision, Decision::Skip(_)) {
            check_files(item)?;
        }
        Ok(decision)
    }

    fn need(&self, _: &Item) -> Need {
        // Nobody knows what the volume leaves before it is there.
        let most = if self.volume.get().is_some() { self.most() } else { u64::MAX };
        Need { least: self.bytes(memory::Fill::default()), most }
    }

    fn frame(&self, item: &Item, stage: &Stage<'_>, record: &mut Record) -> Result<(), Failure> {
        let at_input = |error: &dyn std::fmt::Display| Failure::at(&item.input, error);
        let (ready, seen, sources) = stage.read(record, || {
            let (ready, volume) = self.ready(item, stage).map_err(|error| at_input(&error))?;
            stage.share().ease(self.most());
            let seen = volume.and(Seen::new(mask_file(item)));
            let sources = seen.line(&self.sums);
            Ok::<_, Failure>((ready, seen, sources))
        })?;
        self.is_room(item)?;
        record.warnings.extend_from_slice(&ready.notes);
        let mut mask = self.mask(item, &ready)?;
        let (mut seconds, mut told) = ((0.0, None), None);
        let (mut rounds, mut clamped) = (None, 0);
        let mut frame = stage.solve(record, || {
            let start = Instant::now();
            let frame;
            if let Pixels::Adaptive(settings) = &self.job.pixels {
                let found;
                ((frame, clamped), found) = self.in_rounds(settings, item, &ready, stage)?;
                mask = Some(Arc::clone(&found.mask));
                rounds = Some((found, settings.target));
            } else {
                (frame, clamped) = self.picture(item, &ready, mask.as_deref(), stage)?;
            }
            seconds.0 = start.elapsed().as_secs_f64();
            let Some(method) = self.filler().filter(|_| !stage.stopped()) else { return Ok(frame) };
            if let Some(mask) = mask.as_deref().filter(|_| self.job.run.memory.is_some()) {
                let fill = memory::Fill::of([mask].into_iter(), method, self.job.estimate);
                stage.settle(item, self.bytes(fill))?;
            }
            let start = Instant::now();
            let (filled, report) = self.fill(frame, method, item, stage)?;
            seconds.1 = Some(start.elapsed().as_secs_f64());
            told = Some(report);
            Ok(filled)
        })?;
        self.page.look(item, &frame, |_, _| mask.as_deref(), seconds.1.is_some());
        record.density = Some(mask.as_ref().map_or(1.0, |mask| mask.density()));
        if let Some((rounds, target)) = &rounds {
            record.chosen(rounds, *target).iter().for_each(|text| tracing::info!("{text}"));
        }
        let choosing: f64 = record.rounds.iter().map(|round| round.chosen).sum();
        let rendered = seconds.0 - choosing;
        record.rendered = Some(rendered);
        record.filled = seconds.1;
        if let Some(report) = &told {
            super::fill::tell(report, record);
            clamped += report.clamped_halves;
        }
        record.clamped(clamped);
        if let Some(filled) = seconds.1 {
            let chosen = if choosing > 0.0 { format!("chosen in {choosing:.2} s, ") } else { String::new() };
            tracing::info!("rendered in {rendered:.2} s, {chosen}filled in {filled:.2} s");
        }
        if !sources.is_empty() {
            frame.parts.iter_mut().for_each(|part| part.attributes.set_text(SOURCES, &sources));
        }
        outputs::check_unchanged(&seen, &self.sums)?;
        outputs::write(&frame, item, (self.job.existing, self.job.level), stage, record)
    }

    fn end(&self, heading: &Heading, records: &[Record]) -> Result<(), String> {
        self.page.write(heading, records)
    }
}

impl Render<'_> {
    /// The volume and what is made from it, once: other frames wait for it.
    fn ready(&self, item: &Item, stage: &Stage<'_>) -> Ready {
        // The volume has what a frame leaves.
        let frame = self.need(item).least;
        let bytes = self.job.run.memory.map_or(u64::MAX, |bound| bound.saturating_sub(frame));
        let limits = lacuna_volume::Limits { bytes, outside: self.job.allow_outside };
        let make = || {
            let seen = Seen::new(volume_files(item));
            let ready = lacuna_volume::prepare(&self.scene, &self.folder, &limits);
            if let Ok(ready) = &ready {
                ready.notes.iter().for_each(|note| tracing::warn!("{note}"));
                stage.share().keep(bytes_of(&ready.renderer));
            }
            ready.map(|ready| (Arc::new(ready), seen)).map_err(|error| error.to_string())
        };
        self.volume.get_or_init(make).clone()
    }

    /// That the system has memory for a frame beside the volume.
    fn is_room(&self, item: &Item) -> Result<(), Failure> {
        let bytes = self.need(item).least;
        if lacuna_volume::is_there(bytes) {
            return Ok(());
        }
        let needed = lacuna_exr::Amount::at_most(bytes);
        let why = format!(
            "the frame needs about {needed} of memory, which the system does not give; make it smaller (--size)"
        );
        Err(Failure::at(&item.output, why))
    }

    /// Why an output is not what this run would make, if it is not. What the scene's own file says is in the settings.
    fn stale(&self, item: &Item) -> Option<String> {
        let settings = self.settings.of(item.number);
        let other = |part: &PartHeader| {
            let text = |name| part.attributes.text(name);
            let version = text("lacuna/version").unwrap_or_default();
            match () {
                () if version != env!("CARGO_PKG_VERSION") => {
                    Some(format!("it was made by lacuna {version}"))
                }
                () if part.compression != self.job.wanted.compression => {
                    Some("its compression differs".into())
                }
                () if text(RENDER).as_deref() != Some(&settings) => Some("scene or settings differ".into()),
                () => None,
            }
        };
        let sources = volume_files(item).chain(mask_file(item));
        existing::stale(&item.output, sources, &self.sums, |parts| parts.iter().find_map(other))
    }

    fn mask(&self, item: &Item, ready: &lacuna_volume::Stage) -> Result<Option<Arc<Mask>>, Failure> {
        let size = ready.size();
        match &self.job.pixels {
            Pixels::All | Pixels::Adaptive(_) => Ok(None),
            Pixels::Shuffle(density) => {
                let (field, seed) = (Field { x: 0, y: 0, size }, self.scene.image.seed);
                let number = item.number.unwrap_or(0);
                let pattern = sampling::Pattern::Shuffle;
                let mask = sampling::mask(pattern, field, *density, seed, Temporal::Complementary, number);
                let mask = mask.map_err(|error| Failure::at(&item.input, error))?;
                mask::check_any(&mask).map_err(|why| Failure::at(&item.input, why))?;
                Ok(Some(Arc::new(mask)))
            }
            Pixels::Mask(source) => {
                let Some(path) = &item.mask else { return Ok(None) };
                let file = self.masks.get(path, lacuna_exr::Limits::default());
                let file = file.map_err(|error| Failure::at(&item.input, error))?;
                let canvas = picture::canvas(size);
                let found =
                    mask::find(&canvas, source, Some(&file)).map_err(|error| Failure::at(path, error))?;
                let Some(mask) = found.get(0, 0).cloned() else {
                    return Err(Failure::at(path, "the mask does not cover the picture"));
                };
                mask::check_any(&mask).map_err(|why| Failure::at(path, why))?;
                Ok(Some(mask))
            }
        }
    }

    fn picture(
        &self,
        item: &Item,
        ready: &lacuna_volume::Stage,
        mask: Option<&Mask>,
        stage: &Stage<'_>,
    ) -> Result<(Frame, usize), Failure> {
        let camera = camera(item, ready)?;
        let shader = ready.shader(&camera);
        let shot = self.shot(ready, (&camera, shader.as_ref()), mask);
        let picture = lacuna_volume::render(&ready.renderer, &shot, &Advance::new(&shot, 1, stage).told());
        self.composed(picture, &shot, mask, ready, (item, stage))
    }

    fn shot<'a>(
        &self,
        ready: &lacuna_volume::Stage,
        (camera, shader): (&'a Camera, Option<&'a Shader>),
        mask: Option<&'a Mask>,
    ) -> Shot<'a> {
        Shot {
            camera,
            shader,
            size: ready.size(),
            mask: mask.map(Mask::as_slice),
            samples: self.scene.image.samples,
            seed: self.scene.image.seed,
            normals: self.job.wanted.normals,
            depth: self.job.wanted.depth,
            gradients: self.job.wanted.gradients,
        }
    }

    /// The frame of a picture, with what a coarse march tells of every pixel if that is wanted, and how many values became the
    /// largest half.
    fn composed(
        &self,
        picture: Picture,
        shot: &Shot<'_>,
        mask: Option<&Mask>,
        ready: &lacuna_volume::Stage,
        (item, stage): (&Item, &Stage<'_>),
    ) -> Result<(Frame, usize), Failure> {
        if stage.stopped() {
            return Err(Failure::at(&item.output, STOPPED));
        }
        let pattern = self.job.pixels.pattern();
        let story = Story {
            scene: &self.scene.line(),
            render: &self.settings.of(item.number),
            camera: shot.camera,
            seed: shot.seed,
            samples: shot.samples,
            pattern: pattern.as_deref(),
        };
        let wanted = &self.job.wanted;
        let (mut frame, mut clamped) = picture::frame(picture, ready.size(), mask, *wanted, &story);
        let coarse = |samples: u32, normals: bool| {
            let dense = Shot { normals, ..lacuna_volume::dense_shot(shot.camera, shot, samples) };
            lacuna_volume::render(&ready.coarse(), &dense, &|| !stage.stopped())
        };
        let samples = self.scene.march.dense_samples.min(shot.samples);
        let dense = (wanted.dense || wanted.motion && samples == 1).then(|| coarse(samples, wanted.dense));
        // What moves is what a pixel's centre shows.
        let centre = (wanted.motion && samples > 1).then(|| coarse(1, false));
        if let Some(seen) = centre.as_ref().or(dense.as_ref()).filter(|_| wanted.motion) {
            let next = ready.camera(item.number.unwrap_or(0).saturating_add(1));
            let next = next.map_err(|error| Failure::at(&item.input, error))?;
            motion::add(&mut frame, &seen.depth, (shot.camera, &next))
                .map_err(|error| Failure::at(&item.input, error))?;
        }
        if let Some(dense) = dense.filter(|_| wanted.dense) {
            clamped += picture::add_dense(&mut frame, dense, wanted.kind);
        }
        if stage.stopped() { Err(Failure::at(&item.output, STOPPED)) } else { Ok((frame, clamped)) }
    }

    /// What fills, if pixels are missing.
    fn filler(&self) -> Option<&Method> {
        self.job.fill.as_ref().filter(|_| self.job.pixels != Pixels::All)
    }

    /// Bytes that a frame needs with any mask.
    fn most(&self) -> u64 {
        self.bytes(memory::Fill::most(self.job.estimate, 0))
    }

    /// Bytes that a frame needs by what is known of its fill.
    fn bytes(&self, fill: memory::Fill) -> u64 {
        let [width, height] = self.scene.image.size;
        let size = Size::new(height, width);
        let wanted = &self.job.wanted;
        let planes = 6
            + 3 * u64::from(wanted.normals)
            + u64::from(wanted.depth)
            + 8 * u64::from(wanted.gradients)
            + 8 * u64::from(wanted.dense || wanted.motion)
            // Motion has a march of its own where dense AOVs have several samples.
            + 5 * u64::from(wanted.dense && wanted.motion && self.scene.march.dense_samples > 1)
            + 2 * u64::from(wanted.motion);
        // Tiles, planes and what is written.
        let pixel = planes * 4 * size_of::<f32>() as u64;
        let rendered = (width as u64).saturating_mul(height as u64).saturating_mul(pixel);
        let colours = rounds::COLOURS as u64;
        let chosen = match self.job.pixels {
            Pixels::Adaptive(_) => memory::to_choose(size, colours),
            _ => 0,
        };
        let filled =
            self.filler().map_or(0, |method| memory::to_fill_in_place(size, (planes, colours), method, fill));
        rendered.saturating_add(chosen.max(filled))
    }

    /// The frame with its missing pixels filled, and what was done.
    fn fill(
        &self,
        frame: Frame,
        method: &Method,
        item: &Item,
        stage: &Stage<'_>,
    ) -> Result<(Frame, Report), Failure> {
        let failed = |error: &dyn std::fmt::Display| Failure::at(&item.output, error);
        let mut what = reconstruct::Job::new(method.clone());
        what.estimate = if self.job.estimate { Estimate::Figure } else { Estimate::No };
        let interrupt = || stage.stopped().then_some(Stop::Cancelled);
        let run = Run { interrupt: Some(&interrupt) };
        let masks = mask::find(&frame, &what.mask, None).map_err(|error| failed(&error))?;
        let choices = channels::choose(&frame, &masks.mask_channels, &what.overrides);
        let done = reconstruct::fill(frame, &masks, &choices, &what, &self.plans, &run);
        let (mut frame, report) = done.map_err(|error| failed(&error))?;
        let settings = self.settings.of(item.number);
        frame.parts.iter_mut().for_each(|part| part.attributes.set_text(RENDER, &settings));
        Ok((frame, report))
    }
}

/// Bytes that a volume takes as long as frames are rendered: voxels with their border of three along each axis, and what is known of
/// blocks of 2 x 2 x 2.
fn bytes_of(renderer: &lacuna_volume::Renderer) -> u64 {
    let (grid, block) = (&renderer.grid, if renderer.look == Look::Mip { 5 } else { 1 });
    let voxels: u64 = grid.size().iter().map(|&n| n as u64 + 3).product();
    let blocks: u64 = grid.size().iter().map(|n| n.div_ceil(2) as u64).product();
    voxels * grid.voxel_bytes() + renderer.blocks.as_ref().map_or(0, |_| blocks * block)
}

/// The camera of a frame.
fn camera(item: &Item, ready: &lacuna_volume::Stage) -> Result<Camera, Failure> {
    ready.camera(item.number.unwrap_or(0)).map_err(|error| Failure::at(&item.input, error))
}
