//! Single files of dictionaries: frames encoded and decoded, dictionaries described.

use std::path::{Path, PathBuf};

use lacuna_exr::WriteOptions;
use lacuna_filters::dictionary::Dictionary;
use lacuna_filters::metric::error::{self, Options, Statistics};
use lacuna_filters::{Plane, Size};

use crate::dictionary::code::{self, Encoded, Fineness};
use crate::dictionary::file::hex;
use crate::dictionary::{Stored, picture};
use crate::files::error::PlanError;
use crate::files::identity::Sources;
use crate::files::reports;
use crate::run::console::{Console, Verbosity};
use crate::run::{memory, signals, threads};
use crate::sparsify;

/// The most bytes of an encoded frame that are read.
const MOST_BYTES: u64 = 1 << 28;

/// The factor of a stop: by less, bright light that decodes to other values is no news.
const STOP: f32 = 2.0;

/// What is done with a dictionary.
#[derive(Clone, Debug, PartialEq)]
pub struct DictionaryJob {
    /// The dictionary.
    pub dictionary: PathBuf,
    /// Which of the tasks.
    pub task: DictionaryTask,
    /// Threads in all; 0 takes what there is.
    pub threads: usize,
    /// Bytes of memory that what is read may take, if there is a bound.
    pub memory: Option<u64>,
    /// How much is said.
    pub verbosity: Verbosity,
}

/// A task.
#[derive(Clone, Debug, PartialEq)]
pub enum DictionaryTask {
    /// A frame becomes a file of atoms.
    Encode {
        /// The frame.
        input: PathBuf,
        /// The file.
        output: PathBuf,
        /// How.
        how: Fineness,
    },
    /// And back.
    Decode {
        /// The file.
        input: PathBuf,
        /// The frame.
        output: PathBuf,
    },
    /// The dictionary is described.
    Info {
        /// Where a picture of its atoms goes.
        png: Option<PathBuf>,
    },
}

/// Does it; the exit status.
pub fn dictionary(job: &DictionaryJob) -> Result<u8, PlanError> {
    threads::start(job.threads).map_err(PlanError::Failed)?;
    let console = Console::new(job.verbosity);
    console.listen();
    signals::watch(lacuna_exr::remove_temporaries)
        .map_err(|error| PlanError::Failed(format!("cannot watch for signals: {error}")))?;
    let stored = Stored::read(&job.dictionary, job.memory.unwrap_or(u64::MAX))
        .map_err(|error| failed(&job.dictionary, &error))?;
    let dictionary = (&*job.dictionary, "dictionary");
    match &job.task {
        DictionaryTask::Encode { input, output, how } => {
            Sources::new([(&**input, "input"), dictionary]).check(output)?;
            encode((input, output), &stored.dictionary, *how, job.memory, &console)?;
        }
        DictionaryTask::Decode { input, output } => {
            Sources::new([(&**input, "input"), dictionary]).check(output)?;
            decode(input, output, &stored.dictionary, job.memory)?;
        }
        DictionaryTask::Info { png } => {
            if let Some(path) = png {
                Sources::new([dictionary]).check(path)?;
                let bytes = picture::png(&stored.dictionary).map_err(|error| failed(path, &error))?;
                lacuna_exr::write_whole(path, &bytes).map_err(|error| failed(path, &error))?;
            }
            reports::print(&describe(&stored))?;
        }
    }
    Ok(0)
}

fn failed(path: &Path, error: &dyn std::fmt::Display) -> PlanError {
    PlanError::Failed(format!("{}: {error}", path.display()))
}

/// Whether light above 1 of this largest value is another once it is decoded.
fn is_lost(before: f32, after: f32) -> bool {
    before > 1.0 && !(before / STOP..=before * STOP).contains(&after)
}

fn encode(
    (input, output): (&Path, &Path),
    dictionary: &Dictionary,
    how: Fineness,
    memory: Option<u64>,
    console: &Console,
) -> Result<(), PlanError> {
    let frame = lacuna_exr::read(input, &memory::reading(memory)).map_err(|error| failed(input, &error))?;
    sparsify::check_complete(&frame).map_err(|error| failed(input, &error))?;
    let encoded = code::encode(&frame, dictionary, how).map_err(|error| failed(input, &error))?;
    lacuna_exr::write_whole(output, &encoded.bytes).map_err(|error| failed(output, &error))?;
    if let Some(note) = &encoded.non_finite {
        console.warning(&format!("{}: {note}", input.display()));
    }
    if !encoded.left_out.is_empty() {
        let names = encoded.left_out.join(", ");
        console.warning(&format!("{}: not encoded: {names}", input.display()));
    }
    if !encoded.renamed.is_empty() {
        let (names, as_) = (encoded.renamed.join(", "), code::COMPONENTS.join(", "));
        console.warning(&format!("{}: {names}: decoded as {as_}, as names are not kept", input.display()));
    }
    let (statistics, [before, after]) = compared(&encoded).map_err(|error| failed(input, &error))?;
    if is_lost(before, after) {
        console.warning(&format!(
            "{}: light above 1 is not kept: the largest value is {before} and decodes to {after}; PSNR clips both to 1",
            input.display()
        ));
    }
    let psnr = statistics.psnr(1.0);
    let pixels = encoded.colour.first().map_or(1, Vec::len).max(1);
    reports::print(&format!(
        "{} bytes, {:.3} bits per pixel, PSNR {} dB, {:.1} atoms per block\n",
        encoded.bytes.len(),
        8.0 * encoded.bytes.len() as f64 / pixels as f64,
        psnr.map_or_else(|| "unknown".into(), |psnr| format!("{psnr:.2}")),
        encoded.atoms as f64 / encoded.blocks.max(1) as f64,
    ))
}

/// How far the decoded colours are from those of the frame, as `compare` has it, and the largest value of each.
fn compared(encoded: &Encoded) -> Result<(Statistics, [f32; 2]), lacuna_filters::Error> {
    let (mut sum, mut largest) = (Statistics::default(), [0.0_f32; 2]);
    for (values, name) in encoded.colour.iter().zip(code::COMPONENTS) {
        let channels = encoded.frame.parts.iter().flat_map(|part| &part.channels);
        let mut found = channels.filter(|channel| {
            let full = channel.display_name();
            crate::channels::Name::new(&full).component == name
        });
        let Some(back) = found.next().and_then(|channel| channel.samples.to_floats()) else { continue };
        let plane = |values: &[f32]| Plane::new(Size::new(1, values.len()), values.to_vec());
        let (before, after) = (plane(values)?, plane(&back)?);
        sum = sum.and(error::compare(&before, &after, None, Options::default())?);
        for (largest, plane) in largest.iter_mut().zip([&before, &after]) {
            *largest =
                plane.pixels().iter().filter(|value| value.is_finite()).fold(*largest, |a, b| a.max(*b));
        }
    }
    Ok((sum, largest))
}

fn decode(
    input: &Path,
    output: &Path,
    dictionary: &Dictionary,
    memory: Option<u64>,
) -> Result<(), PlanError> {
    let most = memory.unwrap_or(u64::MAX);
    let read = || -> std::io::Result<Vec<u8>> {
        use std::io::Read;
        let mut bytes = Vec::new();
        let file = lacuna_exr::open_regular(input)?;
        if file.metadata()?.len() > most {
            return Err(std::io::Error::other("it has more bytes than --memory grants"));
        }
        file.take(MOST_BYTES + 1).read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    let bytes = read().map_err(|error| failed(input, &format!("cannot read: {error}")))?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(failed(input, &"larger than any frame that lacuna encodes; check the path"));
    }
    let frame = code::decode(&bytes, dictionary, most).map_err(|error| failed(input, &error))?;
    lacuna_exr::write(&frame, output, &WriteOptions::default()).map_err(|error| failed(output, &error))
}

/// What a dictionary is, a line each.
fn describe(stored: &Stored) -> String {
    let (dictionary, trained) = (&stored.dictionary, &stored.trained);
    let mut coherences = dictionary.coherences();
    coherences.sort_by(f32::total_cmp);
    let mut usage = trained.usage.clone();
    usage.sort_unstable();
    let middle = |count: usize| count / 2;
    let (lowest, median, highest) =
        (usage.first().copied().unwrap_or(0), usage[middle(usage.len())], usage.last().copied().unwrap_or(0));
    let unused = usage.iter().filter(|count| **count == 0).count();
    let colour = if dictionary.channels() == 1 { "grey" } else { "R, G, B" };
    let seed = trained.seed;
    let variant = if trained.approximate { "approximate" } else { "exact" };
    let mut lines = vec![
        format!("dictionary   {}", stored.name()),
        format!("atoms        {} of {} numbers", dictionary.len(), dictionary.dimension()),
        format!("block        {0} x {0}, {colour}", dictionary.block()),
        format!(
            "training     {} of {} iterations ({variant}), sparsity {}, seed {seed}",
            trained.errors.len(),
            trained.iterations,
            trained.sparsity
        ),
        format!(
            "data         {} blocks of {} frames, stride {}",
            trained.signals, trained.frames, trained.stride
        ),
        format!("data hash    {}", hex(&trained.data_hash)),
        format!("usage        {lowest} to {highest} blocks an atom, median {median}, {unused} unused"),
        format!(
            "coherence    {:.4} at most, median {:.4} (largest product of an atom with another)",
            coherences.last().copied().unwrap_or(0.0),
            coherences[middle(coherences.len())],
        ),
    ];
    if let (Some(first), Some(last)) = (trained.errors.first(), trained.errors.last()) {
        lines.push(format!("error        {first:.6} after the first iteration, {last:.6} after the last"));
    }
    if !stored.is_finished() {
        lines.push("unfinished   train with the same settings and --resume continues it".into());
    }
    lines.join("\n") + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_light_above_1_can_be_lost() {
        assert!(is_lost(40.0, 3.0) && is_lost(2.0, 40.0));
        assert!(!is_lost(40.0, 39.0) && !is_lost(0.4, 1.05));
    }
}
