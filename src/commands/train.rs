//! Learning a dictionary from frames: read, blocks, iterations, file.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use lacuna_exr::Limits;
use lacuna_filters::dictionary::{Dictionary, ksvd};
use lacuna_filters::{Run, Stop};

use crate::dictionary::file::hash_of;
use crate::dictionary::training::{self, Blocks};
use crate::dictionary::{Stored, Trained};
use crate::files::error::PlanError;
use crate::files::identity::Sources;
use crate::files::inputs::{Selection, resolve};
use crate::run::console::{Console, Verbosity};
use crate::run::{signals, threads};
use crate::sparsify;

/// How often the dictionary so far is written.
const CHECKPOINT: Duration = Duration::from_secs(30);
/// How often a line says how far it is.
const LINE: Duration = Duration::from_secs(10);

/// A dictionary to be learned.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainJob {
    /// The frames.
    pub selection: Selection,
    /// Whether frames that do not exist are passed over.
    pub skip_missing: bool,
    /// Where the dictionary goes.
    pub output: PathBuf,
    /// What is learned; `channels` is 1 for grey and 3 for colour.
    pub settings: ksvd::Settings,
    /// Pixels from block to block.
    pub stride: usize,
    /// Blocks at most; 0 takes all.
    pub blocks_max: usize,
    /// Whether a dictionary of the same settings is continued, unfinished or with fewer iterations.
    pub resume: bool,
    /// Make the output's folder where it is missing.
    pub create_dir: bool,
    /// Threads in all; 0 takes what there is.
    pub threads: usize,
    /// How much is said.
    pub verbosity: Verbosity,
}

/// Learns; the exit status.
pub fn train(job: &TrainJob) -> Result<u8, PlanError> {
    threads::start(job.threads).map_err(PlanError::Failed)?;
    let console = Console::new(job.verbosity);
    console.listen();
    signals::watch(lacuna_exr::remove_temporaries)
        .map_err(|error| PlanError::Failed(format!("cannot watch for signals: {error}")))?;
    let mut frames = resolve(&job.selection)?.frames;
    if job.skip_missing {
        let all = frames.len();
        let lacks = |path: &PathBuf| {
            path.symlink_metadata().is_err_and(|error| error.kind() == std::io::ErrorKind::NotFound)
        };
        frames.retain(|frame| !lacks(&frame.path));
        match all - frames.len() {
            0 => {}
            passed if passed == all => return Err(PlanError::Failed("none of the frames exists".into())),
            passed => console.note(&format!("{passed} of {all} frames do not exist and are passed over")),
        }
    }
    let output =
        |error: &dyn std::fmt::Display| PlanError::Failed(format!("{}: {error}", job.output.display()));
    if let Some(folder) = job.output.parent().filter(|_| job.create_dir) {
        std::fs::create_dir_all(folder).map_err(|error| output(&error))?;
    }
    if let Some(folder) = job.output.parent().filter(|folder| *folder != Path::new("") && !folder.is_dir()) {
        let text = format!("the folder {} does not exist (--create-dir makes it)", folder.display());
        return Err(output(&text));
    }
    Sources::new(frames.iter().map(|frame| (&*frame.path, "frame"))).check(&job.output)?;
    lacuna_exr::check_destination(&job.output, lacuna_exr::Over::Replace).map_err(|error| output(&error))?;
    let paths: Vec<PathBuf> = frames.into_iter().map(|frame| frame.path).collect();
    let values = blocks(job, &paths, &console)?;
    let blank = Trained {
        sparsity: job.settings.sparsity as u32,
        stride: job.stride as u32,
        frames: paths.len() as u32,
        signals: (values.len() / dimension(&job.settings)) as u32,
        iterations: job.settings.iterations as u32,
        seed: job.settings.seed,
        blocks_max: job.blocks_max as u64,
        approximate: job.settings.approximate,
        data_hash: hash_of(&values),
        ..Trained::default()
    };
    let found = if job.resume { earlier(job, &blank)? } else { None };
    let stored = match found {
        // Nothing is left to be done, and the file stays as it is.
        Some(found) if found.is_finished() && found.trained.iterations == blank.iterations => found,
        found => {
            let start = found.map(|found| state(job, found, &console)).transpose()?;
            let stored = stored(job, &blank, &learn(job, &values, &blank, start, &console)?)?;
            stored.write(&job.output).map_err(|error| output(&error))?;
            stored
        }
    };
    let errors = &stored.trained.errors;
    let error = errors.last().copied().unwrap_or(0.0);
    console.note(&format!(
        "{}: dictionary {} of {} x {} from {} blocks, {} iterations, error {error:.6}",
        job.output.display(),
        stored.name(),
        stored.dictionary.dimension(),
        stored.dictionary.len(),
        blank.signals,
        errors.len(),
    ));
    Ok(0)
}

const fn dimension(settings: &ksvd::Settings) -> usize {
    settings.channels * settings.block * settings.block
}

/// The blocks of the frames.
fn blocks(job: &TrainJob, paths: &[PathBuf], console: &Console) -> Result<Vec<f32>, PlanError> {
    let mut blocks = Blocks::new(job.settings.block, job.stride, job.blocks_max, job.settings.seed);
    for path in paths {
        let failed =
            |error: &dyn std::fmt::Display| PlanError::Failed(format!("{}: {error}", path.display()));
        let frame = lacuna_exr::read(path, &Limits::default()).map_err(|error| failed(&error))?;
        sparsify::check_complete(&frame).map_err(|error| failed(&error))?;
        let (part, channels) = training::colour(&frame).map_err(|error| failed(&error))?;
        if let Some(note) = training::non_finite(&frame.parts[part], &channels) {
            console.warning(&format!("{}: {note}", path.display()));
        }
        let (planes, _) = training::planes(&frame.parts[part], &channels).map_err(|error| failed(&error))?;
        let planes = if job.settings.channels == 1 { training::grey(&planes) } else { planes };
        blocks.add(&planes).map_err(|error| failed(&error))?;
    }
    Ok(blocks.into_values())
}

fn failed(job: &TrainJob, why: &dyn std::fmt::Display) -> PlanError {
    PlanError::Failed(format!("{}: {why}", job.output.display()))
}

/// An earlier training of the same blocks and settings, of no more iterations.
fn earlier(job: &TrainJob, blank: &Trained) -> Result<Option<Stored>, PlanError> {
    if !job.output.exists() {
        return Ok(None);
    }
    let stored = Stored::read(&job.output, u64::MAX).map_err(|error| failed(job, &error))?;
    let found = &stored.trained;
    let alike = Trained {
        errors: Vec::new(),
        usage: Vec::new(),
        codes: None,
        iterations: blank.iterations,
        ..found.clone()
    };
    let settings = &job.settings;
    let shape = (stored.dictionary.block(), stored.dictionary.channels(), stored.dictionary.len());
    if alike != *blank || shape != (settings.block, settings.channels, settings.atoms) {
        let text = "is of other frames or settings, so it cannot be continued; drop --resume to replace it";
        return Err(failed(job, &text));
    }
    let done = found.errors.len();
    if done > settings.iterations {
        let text = format!(
            "has {done} iterations already: give --iterations {done} or more, or drop --resume to replace it"
        );
        return Err(failed(job, &text));
    }
    Ok(Some(stored))
}

/// What an earlier training goes on from.
fn state(job: &TrainJob, stored: Stored, console: &Console) -> Result<ksvd::State, PlanError> {
    let Trained { codes, errors, .. } = stored.trained;
    // Other codes would lead to other atoms: an iteration keeps those that it finds no better ones for.
    let codes = codes.ok_or_else(|| {
        let text = "keeps no codes of its blocks, so it cannot be continued; drop --resume to replace it";
        failed(job, &text)
    })?;
    console.note(&format!("{}: continues after {} iterations", job.output.display(), errors.len()));
    Ok(ksvd::State { atoms: stored.dictionary.atoms().clone(), codes, errors, stop: Stop::Cancelled })
}

/// The iterations, with lines and checkpoints on the way.
fn learn(
    job: &TrainJob,
    values: &[f32],
    blank: &Trained,
    start: Option<ksvd::State>,
    console: &Console,
) -> Result<ksvd::State, PlanError> {
    let first = start.as_ref().map_or(0, |state| state.errors.len());
    let all = job.settings.iterations;
    let begun = Instant::now();
    let (mut said, mut saved) = (begun, begun);
    let mut warned = false;
    let state = ksvd::learn(values, &job.settings, start, &Run::default(), |state| {
        let done = state.errors.len();
        // Begun here, as settings may be refused before.
        if done == first + 1 {
            console.begin(all as u64);
            console.advance(first as u64);
        }
        console.advance(1);
        let left = begun.elapsed().as_secs_f64() / (done - first) as f64 * all.saturating_sub(done) as f64;
        let error = state.errors.last().copied().unwrap_or(0.0);
        let line = format!("iteration {done} of {all}: error {error:.6}, {left:.0} s left");
        if said.elapsed() >= LINE || done == first + 1 {
            said = Instant::now();
            console.note(&line);
        } else {
            console.detail(&line);
        }
        if saved.elapsed() >= CHECKPOINT && done < all {
            saved = Instant::now();
            let written = stored(job, blank, state).and_then(|stored| {
                stored.write(&job.output).map_err(|error| PlanError::Failed(error.to_string()))
            });
            if let Some(error) = written.err().filter(|_| !warned) {
                let text = "the dictionary so far cannot be written, and is lost unless it can be written by the end of training";
                console.warning(&format!("{}: {text}: {error}", job.output.display()));
                warned = true;
            }
        }
    });
    console.end();
    state.map_err(|error| PlanError::Failed(error.to_string()))
}

/// A state as a file.
fn stored(job: &TrainJob, blank: &Trained, state: &ksvd::State) -> Result<Stored, PlanError> {
    let ksvd::Settings { block, channels, atoms, .. } = job.settings;
    let dictionary = Dictionary::new(block, channels, state.atoms.clone());
    let dictionary = dictionary.map_err(|error| PlanError::Failed(error.to_string()))?;
    let usage = ksvd::usage(&state.codes, atoms).into_iter().map(|count| count as u64).collect();
    let (errors, codes) = (state.errors.clone(), Some(state.codes.clone()));
    let trained = Trained { errors, usage, codes, ..blank.clone() };
    Ok(Stored { dictionary, trained })
}
