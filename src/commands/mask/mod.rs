//! Making, uniting and measuring masks: files in, files out.

mod output;
mod passes;

use std::path::{Path, PathBuf};

use lacuna_exr::Frame;
use lacuna_filters::Plane;
use lacuna_filters::sampling::Temporal;
pub use output::{BoundFiles, MaskOutput};
pub use passes::{NextPass, Union};

use self::output::{failed, report};
use crate::channels;
use crate::files::error::PlanError;
use crate::files::identity::Sources;
use crate::files::patterns::Pattern;
use crate::files::plan::check_apart;
use crate::files::reports;
use crate::mask::generate::{self, Bounds, Request};
use crate::mask::judge::{self, Judgement};
use crate::mask::output::{Listing, write_floats, write_mask};
use crate::mask::{MakeError, PATTERN, SEED, Source};
use crate::run::console::{Console, Verbosity};
use crate::run::{memory, signals, threads};

/// What `lacuna mask` and `lacuna analyze` do.
#[derive(Clone, Debug, PartialEq)]
pub struct MaskJob {
    /// Which of its tasks.
    pub task: MaskTask,
    /// Threads in all; 0 takes what there is.
    pub threads: usize,
    /// Bytes of memory that the work may take, if there is a bound.
    pub memory: Option<u64>,
    /// How much is said.
    pub verbosity: Verbosity,
}

impl MaskJob {
    /// The subcommand that asks for it.
    pub const fn command(&self) -> &'static str {
        if let MaskTask::Measure { .. } = self.task { "analyze" } else { "mask" }
    }
}

/// A task.
#[derive(Clone, Debug, PartialEq)]
pub enum MaskTask {
    /// Make masks from a pattern.
    Generate {
        /// The mask.
        request: Request,
        /// Write the rank image instead.
        rank: bool,
        /// The frames, if there are several; then the output is a pattern.
        frames: Option<Vec<i64>>,
        /// What the pattern does not decide.
        bounds: BoundFiles,
        /// Where to.
        output: MaskOutput,
    },
    /// Choose the pixels to compute after a first pass.
    Next(NextPass),
    /// Unite two sparse renders.
    Merge(Union),
    /// Say how good a mask is.
    Measure {
        /// The mask, `FILE[:CHANNEL]`.
        mask: Option<Source>,
        /// Densities at which the coherences of figure 3.1 are computed.
        coherence: Vec<f64>,
        /// A frame whose DFT magnitudes are wanted.
        spectrum: Option<PathBuf>,
        /// The seed of the masks of the coherences.
        seed: u64,
        /// Where the plot goes.
        plot: Option<MaskOutput>,
        /// Whether JSON is printed.
        json: bool,
    },
}

/// Does the task; the exit status.
pub fn mask(job: &MaskJob) -> Result<u8, PlanError> {
    threads::start(job.threads).map_err(PlanError::Failed)?;
    let console = Console::new(job.verbosity);
    console.listen();
    signals::watch(lacuna_exr::remove_temporaries)
        .map_err(|error| PlanError::Failed(format!("cannot watch for signals: {error}")))?;
    match &job.task {
        MaskTask::Generate { request, rank, frames, bounds, output } => {
            generate((request, job.memory), *rank, frames.as_deref(), bounds, output, &console)
        }
        MaskTask::Next(task) => passes::next(task, job.memory, &console),
        MaskTask::Merge(task) => passes::unite(task, job.memory, &console),
        MaskTask::Measure { mask, coherence, spectrum, seed, plot, json } => {
            if let Some(plot) = plot {
                let mask = mask.iter().filter_map(Source::path).map(|path| (path, "mask"));
                let frame = spectrum.iter().map(|path| (&**path, "frame"));
                Sources::new(mask.chain(frame)).check(&plot.path)?;
            }
            let images = (mask.as_ref(), spectrum.as_deref());
            let judgement = measure(images, coherence, *seed, job.memory)?;
            tell(&judgement, plot.as_ref(), *json, &console)
        }
    }
}

/// Bytes a pixel that a mask takes to be made and written, as measured.
const MAKING: u64 = 8;
/// Bytes a pixel that its figures take.
const MEASURING: u64 = 24;

/// One mask per frame; a frame that fails does not stop the others.
fn generate(
    (request, memory): (&Request, Option<u64>),
    rank: bool,
    frames: Option<&[i64]>,
    bounds: &BoundFiles,
    output: &MaskOutput,
    console: &Console,
) -> Result<u8, PlanError> {
    let text = output.path.display();
    let pattern = Pattern::of(&output.path).map_err(|error| PlanError::Usage(format!("{text}: {error}")))?;
    let Some(frames) = frames else {
        if pattern.is_some() {
            return Err(PlanError::Usage(format!("{text}: a pattern needs --frames, such as 1-100")));
        }
        Sources::new(bounds.files()).check(&output.path)?;
        return one((request, memory), rank, 0, bounds, &output.path, output, console).map(|()| 0);
    };
    let Some(pattern) = pattern else {
        return Err(PlanError::Usage(format!(
            "{text}: --frames needs a pattern to write to, such as mask.####.exr"
        )));
    };
    let of = |&number: &i64| (number, bounds.of_frame(Some(number)), pattern.path(number));
    let masks: Vec<_> = frames.iter().map(of).collect();
    let made = masks.iter().map(|(_, _, path)| (output.path.as_path(), path.as_path()));
    check_apart(made, masks.iter().flat_map(|(_, bounds, _)| bounds.files()))?;
    let mut status = 0;
    console.begin(frames.len() as u64);
    for (number, bounds, path) in &masks {
        let done = one((request, memory), rank, *number, bounds, path, output, console);
        if let Err(error) = done {
            console.error(&error.to_string());
            status = 1;
        }
        console.advance(1);
    }
    console.end();
    Ok(status)
}

fn one(
    (request, memory): (&Request, Option<u64>),
    rank: bool,
    frame: i64,
    bounds: &BoundFiles,
    path: &Path,
    output: &MaskOutput,
    console: &Console,
) -> Result<(), PlanError> {
    let fail = failed(path);
    if !output.wants(path, console)? {
        return Ok(());
    }
    output.make_folder(path)?;
    memory::afford(memory, MAKING.saturating_mul(request.window.size().pixels() as u64))
        .map_err(|error| fail(error.into()))?;
    let bounds = bounds.read(request.window, memory::reading(memory)).map_err(&fail)?;
    let mut how = output.writing();
    how.attributes = vec![(SEED, request.seed.to_string())];
    let pattern = request.pattern.name();
    if rank {
        let ranks = generate::ranks(request, frame, &bounds).map_err(&fail)?;
        how.attributes.push((PATTERN, format!("{pattern}{}", of_frame(request.temporal, frame))));
        let written = write_floats(path, "rank", ranks, 1.0, request.window, &how);
        return output.wrote(path, written, console).map(drop);
    }
    let mask = generate::generate(request, frame, &bounds).map_err(&fail)?;
    let paired = if request.paired { " paired" } else { "" };
    let of_frame = of_frame(request.temporal, frame);
    how.attributes.push((PATTERN, format!("{pattern} density={}{paired}{of_frame}", request.density)));
    let listing = Listing::Rank(order_within(request, frame, &bounds));
    if output.wrote(path, write_mask(path, &mask, request.window, &listing, &how), console)? {
        report(path, &mask, console);
    }
    Ok(())
}

/// Which of the masks of a sequence it is.
fn of_frame(temporal: Temporal, frame: i64) -> String {
    match temporal {
        Temporal::Fixed => String::new(),
        Temporal::Offset => format!(" temporal=offset frame={frame}"),
        Temporal::Complementary => format!(" temporal=complementary frame={frame}"),
    }
}

/// The order of a list: forced pixels first.
fn order_within<'a>(request: &Request, frame: i64, bounds: &'a Bounds) -> generate::Rank<'a> {
    let (rank, size) = (generate::order(request, frame), request.window.size());
    Box::new(move |row, column| if bounds.forces(size, row, column) { 0.0 } else { rank(row, column) })
}

fn measure(
    (mask, spectrum): (Option<&Source>, Option<&Path>),
    coherence: &[f64],
    seed: u64,
    memory: Option<u64>,
) -> Result<Judgement, PlanError> {
    let mut judgement = Judgement::default();
    let limits = memory::reading(memory);
    if let Some(Source::File { pattern, channel }) = mask {
        let fail = failed(pattern.as_ref());
        let mask = generate::load(pattern, channel.as_deref(), limits).map_err(&fail)?;
        memory::afford(memory, MEASURING.saturating_mul(mask.size().pixels() as u64))
            .map_err(|error| fail(error.into()))?;
        judgement = judge::judge(&mask).map_err(&fail)?;
    }
    if !coherence.is_empty() {
        judgement.coherence =
            judge::coherences(coherence, seed).map_err(|error| PlanError::Failed(error.to_string()))?;
    }
    if let Some(path) = spectrum {
        let fail = failed(path);
        let frame = lacuna_exr::read(path, &limits).map_err(|error| fail(error.into()))?;
        judgement.magnitudes = Some(judge::magnitudes(&luminance(&frame).map_err(fail)?));
    }
    Ok(judgement)
}

/// The luminance of the first part with `R`, `G`, `B` (Rec. 709 weights), else its first channel; it must be finite somewhere.
fn luminance(frame: &Frame) -> Result<Plane, MakeError> {
    let none = || MakeError::Other("the frame has no channels".into());
    let part = frame.parts.first().ok_or_else(none)?;
    let plane = |name: &str| part.channels.iter().find(|channel| channel.name == name.as_bytes());
    let rgb = plane("R").zip(plane("G")).zip(plane("B"));
    let (name, pixels): (_, Vec<f32>) = if let Some(((r, g), b)) = rgb {
        let (r, g, b) = (r.samples.as_f32(), g.samples.as_f32(), b.samples.as_f32());
        let weighted = |((r, g), b): ((&f32, &f32), &f32)| 0.2126 * r + 0.7152 * g + 0.0722 * b;
        ("R, G, B".into(), r.iter().zip(&g).zip(&b).map(weighted).collect())
    } else {
        let first = part.channels.first().ok_or_else(none)?;
        (first.display_name().into_owned(), first.samples.as_f32())
    };
    if !pixels.iter().any(|value| value.is_finite()) {
        let why = "no pixel is finite, and there is no spectrum: render the frame again";
        return Err(MakeError::Other(format!("{}: {why}", channels::visible(&name))));
    }
    Ok(Plane::new(part.size(), pixels)?)
}

fn tell(
    judgement: &Judgement,
    plot: Option<&MaskOutput>,
    json: bool,
    console: &Console,
) -> Result<u8, PlanError> {
    if let (Some(output), Some(plot)) = (plot, judgement.plot())
        && output.wants(&output.path, console)?
    {
        output.make_folder(&output.path)?;
        output.wrote(&output.path, plot.write(&output.path, output.no_clobber), console)?;
    }
    let text = if json {
        serde_json::to_string_pretty(judgement).map_err(|error| PlanError::Failed(error.to_string()))?
    } else {
        judgement.to_string()
    };
    reports::print(&format!("{}\n", text.trim_end())).map(|()| 0)
}
