//! Making frames sparse: what is done with each, and with all of them.

use lacuna_exr::Compression;
use lacuna_filters::sampling::adaptive;
use lacuna_filters::{Run, Stop};

use crate::files::error::PlanError;
use crate::files::inputs::Selection;
use crate::files::patterns::{beside, number_in_name};
use crate::files::plan::{Item, Targets, plan};
use crate::mask::shared::MaskFiles;
use crate::mask::{Source, rounds};
use crate::run::batch::{Decision, Failure, RunOptions, Stage, Work};
use crate::run::existing::Existing;
use crate::run::record::{Heading, Record};
use crate::run::schedule::Need;
use crate::run::{batch, memory, outputs};
use crate::sparsify::{self, Pattern};

/// Frames to be made sparse, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct SparsifyJob {
    /// The frames.
    pub selection: Selection,
    /// Whether frames that do not exist are passed over.
    pub skip_missing: bool,
    /// Where outputs go.
    pub targets: Targets,
    /// Which pixels stay.
    pub pattern: SparsifyPattern,
    /// Channels that stay complete.
    pub complete: Vec<glob::Pattern>,
    /// The outputs' compression; the input's where it is lossless, else ZIP, if `None`.
    pub compression: Option<Compression>,
    /// Its level.
    pub level: Option<u8>,
    /// What happens to outputs that exist.
    pub existing: Existing,
    /// How to run.
    pub run: RunOptions,
}

/// Which pixels stay.
#[derive(Clone, Debug, PartialEq)]
pub enum SparsifyPattern {
    /// A nested low-discrepancy pattern.
    Shuffle {
        /// Measured pixels over all pixels, 0 to 1.
        density: f64,
        /// Which pattern.
        seed: u64,
    },
    /// Chosen in rounds.
    Adaptive(adaptive::Settings),
    /// Those of a mask file.
    Mask(Source),
}

/// Makes the frames sparse; the exit status.
pub fn sparsify(job: &SparsifyJob) -> Result<u8, PlanError> {
    let plan = plan(&job.selection, &job.targets)?;
    let work = Sparsify { job, masks: MaskFiles::default() };
    let console = job.run.console()?;
    if job.run.dry_run {
        return Ok(outputs::print(&plan, &work, &console));
    }
    console.listen();
    if let Some(warning) = alone(job, &plan.items) {
        console.warning(&warning);
    }
    outputs::make_folders(&plan)?;
    let settings = match &job.pattern {
        SparsifyPattern::Shuffle { density, seed } => format!("shuffle density={density} seed={seed}"),
        SparsifyPattern::Adaptive(settings) => {
            format!("{} seed={}", rounds::pattern(settings), settings.seed)
        }
        SparsifyPattern::Mask(source) => source.to_string(),
    };
    let heading = Heading {
        lacuna: env!("CARGO_PKG_VERSION"),
        command: "sparsify",
        filter: None,
        settings: Some(settings),
    };
    batch::run(heading, &plan.items, &job.run, &work, &console).map_err(PlanError::Failed)
}

/// That a frame of a sequence is named alone, which gives it the mask of every other that is: masks go by the number of the frame, and
/// a file that nothing asks for by its number has none.
fn alone(job: &SparsifyJob, items: &[Item]) -> Option<String> {
    let [item] = items else { return None };
    let goes_by_number = item.number.is_none() && !matches!(job.pattern, SparsifyPattern::Mask(_));
    let number = number_in_name(&item.input).filter(|_| goes_by_number)?;
    let next = |step| number.checked_add(step).map(|number| beside(&item.input, number)).unwrap_or_default();
    [-1, 1].into_iter().flat_map(next).any(|path| path.exists()).then(|| {
        format!(
            "{}: a file that is named alone has the same mask whatever its number; a pattern with --frames {number} gives \
             it that of frame {number}",
            item.input.display()
        )
    })
}

struct Sparsify<'a> {
    job: &'a SparsifyJob,
    masks: MaskFiles,
}

impl Work for Sparsify<'_> {
    fn words(&self) -> (&'static str, &'static str) {
        ("sparsify", "made sparse")
    }

    fn decide(&self, item: &Item) -> Result<Decision, Failure> {
        outputs::decide_to_write(item, self.job.skip_missing, self.job.existing, |_| None)
    }

    fn need(&self, item: &Item) -> Need {
        let mask = item.mask.as_deref().map_or(0, memory::to_copy);
        let rounds = match &self.job.pattern {
            SparsifyPattern::Adaptive(_) => memory::to_choose_of(&item.input),
            _ => 0,
        };
        memory::to_copy(&item.input).saturating_add(mask).saturating_add(rounds).into()
    }

    fn frame(&self, item: &Item, stage: &Stage<'_>, record: &mut Record) -> Result<(), Failure> {
        let limits = memory::limits(self.job.run.memory, self.need(item).most);
        let (frame, file) = stage.read(record, || {
            let frame =
                lacuna_exr::read(&item.input, &limits).map_err(|error| Failure::at(&item.input, error))?;
            let file = item.mask.as_deref().map(|path| self.masks.get(path, limits)).transpose();
            let file = file.map_err(|error| Failure::at(&item.input, error))?;
            Ok((frame, file))
        })?;
        let interrupt = || stage.stopped().then_some(Stop::Cancelled);
        let run = Run { interrupt: Some(&interrupt) };
        let chosen;
        let pattern = match (&self.job.pattern, &file) {
            (SparsifyPattern::Adaptive(settings), _) => {
                chosen = adaptive::Settings { frame: item.number, ..*settings };
                Pattern::Adaptive { settings: &chosen, run: &run }
            }
            (SparsifyPattern::Mask(Source::File { channel, .. }), Some(file)) => {
                Pattern::File { file, channel: channel.as_deref() }
            }
            (SparsifyPattern::Shuffle { density, seed }, _) => {
                Pattern::Shuffle { density: *density, seed: *seed, frame: item.number.unwrap_or(0) }
            }
            _ => return Err(Failure::at(&item.input, "no mask file was given")),
        };
        let sparse = stage
            .solve(record, || sparsify::sparsify_but(frame, pattern, &self.job.complete))
            .map_err(|error| Failure::at(&item.input, error))?;
        record.density = Some(sparse.density);
        if stage.stopped() {
            return Err(Failure::at(&item.output, "stopped by a signal"));
        }
        record.warn(&sparse.notes);
        if let (Some(rounds), SparsifyPattern::Adaptive(settings)) = (&sparse.rounds, &self.job.pattern) {
            record.chosen(rounds, settings.target).iter().for_each(|text| tracing::info!("{text}"));
        }
        let mut frame = sparse.frame;
        if let Some(compression) = self.job.compression {
            frame.parts.iter_mut().for_each(|part| part.compression = compression);
        }
        outputs::write(&frame, item, (self.job.existing, self.job.level), stage, record)
    }
}
