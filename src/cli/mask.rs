//! `lacuna mask`: flags to a checked job.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};
use lacuna_exr::Window;
use lacuna_filters::sampling::{Pattern, Temporal};

use super::Usage;
use super::numbers::{density, fraction};
use super::run::{Bytes, SpeechArgs};
use crate::commands::{BoundFiles, MaskJob, MaskOutput, MaskTask, NextPass, Union};
use crate::files::ranges::Frames;
use crate::mask::Source;
use crate::mask::generate::Request;
use crate::mask::output::{Format, check_image};
use crate::run::granted_memory;

const EXAMPLES: &str = "\
Examples:
  lacuna mask -o mask.exr --size 1920x1080 --density 0.2
  lacuna mask -o 'm.####.png' --size 1920x1080 --density 0.1 --frames 1-10
  lacuna mask -o rank.exr --size 1920x1080 --rank --pattern blue-noise
  lacuna mask --after filled.exr -o next.txt --add 0.05 --error-estimate e.exr
  lacuna mask --merge first.exr second.exr -o both.exr
  lacuna mask --after 'filled.####.exr' -o 'next.####.exr' --add 0.05

Exit status: 0 all done, 1 something failed, 2 usage, 128 + n on signal n.";

/// Pixels that starting a crop costs if nothing is said.
pub(super) const CROP_OVERHEAD: usize = 256;

/// Make masks: which pixels a renderer should compute, in a first pass and after it
///
/// The output's extension says the form: .exr (channel mask), .png (white is measured), .txt (one x y a line, in the order
/// in which they should be computed), .json (rectangles, for renderers that can only crop).
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct MakeMaskArgs {
    #[command(flatten)]
    pattern: PatternArgs,

    #[command(flatten)]
    after: AfterArgs,

    #[command(flatten)]
    output: OutputArgs,

    /// Threads in all; 0 takes what the machine, a cgroup limit and the batch system allow
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Run")]
    threads: usize,

    /// Memory that the work may take: bytes, or with K, M, G, T (powers of 1024), for example 4G [default: what Slurm granted;
    /// elsewhere reading one image takes 1.5G at most]
    #[arg(long, value_name = "SIZE", allow_hyphen_values = true, help_heading = "Run")]
    memory: Option<Bytes>,

    #[command(flatten)]
    speech: SpeechArgs,
}

/// A mask from a pattern.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "From a pattern")]
struct PatternArgs {
    /// Columns and rows, and the first column and row if they are not 0: 1920x1080, 2020x1180-50-50
    #[arg(long, value_name = "WxH[+X+Y]")]
    size: Option<Geometry>,

    /// Measured pixels over all pixels (of the region), above 0 to 1
    #[arg(long, value_name = "D", value_parser = density, allow_negative_numbers = true)]
    density: Option<f64>,

    /// How the pixels lie [default: shuffle]
    #[arg(long, value_name = "PATTERN")]
    pattern: Option<PatternName>,

    /// Another pattern of the same kind, of which a grid has n^2; after a first pass, the seed of that [default: 0]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,

    /// Each pixel with its right and its lower neighbour, which all count for the density: for --filter cs-gradient. --inside
    /// cuts such a mask, so that pixels at its edge may have no neighbour
    #[arg(long, conflicts_with = "rank")]
    paired: bool,

    /// Write the rank of each pixel instead: rank < D is the mask of density D (shuffle, blue-noise, random)
    #[arg(long)]
    rank: bool,

    /// A mask for each of these frames; the output is a pattern such as mask.####.exr. With --after and --merge the
    /// frames to take from patterns, all that exist if it is not given
    #[arg(long, value_name = "RANGE", allow_hyphen_values = true)]
    frames: Option<Frames>,

    /// How the masks of frames are related [default: complementary; offset for poisson, --paired and --rank without --density]
    #[arg(long, value_name = "HOW")]
    temporal: Option<TemporalName>,

    /// Only pixels where this image is above 0: an EXR file's channel (mask, A or the only one if not named), by absolute
    /// coordinates, or a PNG of the mask's size; a pattern goes frame by frame
    #[arg(long, value_name = "IMAGE[:CHANNEL]")]
    inside: Option<Source>,

    /// Also pixels where this image is above 0, as for --inside; after a first pass those that are missing, beside --add
    #[arg(long, value_name = "IMAGE[:CHANNEL]")]
    always: Option<Source>,

    /// Also the outermost N pixels; after a first pass those that are missing, beside --add [default: 0]
    #[arg(long, value_name = "N")]
    border: Option<usize>,
}

/// A mask from a frame, and two renders united.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "After a first pass")]
struct AfterArgs {
    /// Choose the pixels to compute next: a frame that was filled, or is still sparse, or a pattern of such frames
    #[arg(long, value_name = "FRAME", requires = "add", conflicts_with = "merge")]
    after: Option<PathBuf>,

    /// Pixels to compute next over all pixels, 0 to 1; those of --always and --border come on top
    #[arg(long, value_name = "D", value_parser = fraction, allow_negative_numbers = true)]
    add: Option<f64>,

    /// Write the estimated error of the fill as an image, .exr (channel error) or .png
    #[arg(long, value_name = "FILE")]
    error_estimate: Option<PathBuf>,

    /// Unite two sparse renders of a frame, or of frames, bit for bit: what either measured is measured
    #[arg(long, value_names = ["A", "B"], num_args = 2)]
    merge: Option<Vec<PathBuf>>,

    /// Where the masks of these frames come from, as in fill [default: auto]
    #[arg(long, value_name = "SOURCE")]
    mask: Option<Source>,
}

/// Where the result goes.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Output")]
struct OutputArgs {
    /// A file, or a pattern with --frames
    #[arg(short, long, value_name = "OUTPUT")]
    output: Option<PathBuf>,

    /// Make the output's folder where it is missing
    #[arg(long, requires = "output")]
    create_dir: bool,

    /// Pass over outputs that exist
    #[arg(long, requires = "output")]
    no_clobber: bool,

    /// For .json: what starting a crop costs, in pixels; larger makes fewer and larger rectangles [default: 256]
    #[arg(long, value_name = "PIXELS")]
    crop_overhead: Option<usize>,
}

/// A pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PatternName {
    /// Uniform, without replacement; progressive
    Random,
    /// Linear pixel shuffling, of low discrepancy; progressive
    Shuffle,
    /// Poisson disk; not progressive
    Poisson,
    /// Void and cluster, period 128; progressive
    BlueNoise,
    /// Every n-th pixel of every n-th row, 1 / n^2 being nearest to the density
    Grid,
}

/// How masks of frames are related.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum TemporalName {
    /// The same mask
    Fixed,
    /// Independent masks
    Offset,
    /// Masks that together cover every pixel as early and evenly as possible
    Complementary,
}

/// What is to be done, which decides the flags that mean something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Task {
    Generate,
    After,
    Merge,
}

impl Task {
    /// The flag that asks for it.
    const fn flag(self) -> &'static str {
        match self {
            Self::Generate => "--size",
            Self::After => "--after",
            Self::Merge => "--merge",
        }
    }
}

impl MakeMaskArgs {
    /// The checked job.
    pub fn job(&self) -> Result<MaskJob, Usage> {
        self.check_tasks()?;
        let task = match self.task() {
            Task::Generate => self.generating()?,
            Task::After => self.choosing()?,
            Task::Merge => self.uniting()?,
        };
        let memory = self.memory.map(|bytes| bytes.0).or_else(granted_memory);
        Ok(MaskJob { task, threads: self.threads, memory, verbosity: self.speech.verbosity() })
    }

    fn task(&self) -> Task {
        match (&self.after.after, &self.after.merge) {
            (Some(_), _) => Task::After,
            (None, Some(_)) => Task::Merge,
            (None, None) => Task::Generate,
        }
    }

    /// A flag that the task does not use is an error.
    fn check_tasks(&self) -> Result<(), Usage> {
        use Task::{After, Generate, Merge};
        let (pattern, after) = (&self.pattern, &self.after);
        let flags: [(&str, bool, &[Task]); 15] = [
            ("--size", pattern.size.is_some(), &[Generate]),
            ("--density", pattern.density.is_some(), &[Generate]),
            ("--pattern", pattern.pattern.is_some(), &[Generate]),
            ("--seed", pattern.seed.is_some(), &[Generate, After]),
            ("--paired", pattern.paired, &[Generate]),
            ("--rank", pattern.rank, &[Generate]),
            ("--frames", pattern.frames.is_some(), &[Generate, After, Merge]),
            ("--temporal", pattern.temporal.is_some(), &[Generate]),
            ("--inside", pattern.inside.is_some(), &[Generate, After]),
            ("--always", pattern.always.is_some(), &[Generate, After]),
            ("--border", pattern.border.is_some(), &[Generate, After]),
            ("--add", after.add.is_some(), &[After]),
            ("--error-estimate", after.error_estimate.is_some(), &[After]),
            ("--mask", after.mask.is_some(), &[After, Merge]),
            ("--crop-overhead", self.output.crop_overhead.is_some(), &[Generate, After]),
        ];
        let task = self.task();
        let unused = flags.iter().find(|(_, given, tasks)| *given && !tasks.contains(&task));
        unused.map_or(Ok(()), |(flag, _, tasks)| {
            if *flag == Generate.flag() {
                return Err(Usage(format!("{} takes its frames' size: drop {flag}", task.flag())));
            }
            let owners: Vec<&str> = tasks.iter().map(|task| task.flag()).collect();
            let owners = owners.join(" or ");
            Err(Usage(match task {
                // No flag asked for it.
                Generate if self.pattern.size.is_none() => format!("{flag} goes with {owners}"),
                _ => format!("{flag} goes with {owners}; {} does not use it, drop it", task.flag()),
            }))
        })
    }

    fn choosing(&self) -> Result<MaskTask, Usage> {
        let needed = || Usage("--after FRAME with --add D is needed".into());
        if let Some(path) = &self.after.error_estimate {
            check_image(path, "error").map_err(|error| Usage(format!("--error-estimate {error}")))?;
        }
        Ok(MaskTask::Next(NextPass {
            number: None,
            frame: self.after.after.clone().ok_or_else(needed)?,
            frames: self.pattern.frames.clone(),
            source: self.after.source(),
            add: self.after.add.ok_or_else(needed)?,
            seed: self.pattern.seed(),
            error_estimate: self.after.error_estimate.clone(),
            bounds: self.pattern.bounds()?,
            output: self.output.needed()?,
        }))
    }

    fn uniting(&self) -> Result<MaskTask, Usage> {
        let Some([first, second]) = self.after.merge.as_deref() else {
            return Err(Usage("--merge takes two frames".into()));
        };
        let output = self.output.needed()?;
        if !matches!(Format::of(&output.path), Ok(Format::Exr)) {
            let path = output.path.display();
            return Err(Usage(format!("--merge writes a frame, and '{path}' does not end in .exr")));
        }
        Ok(MaskTask::Merge(Union {
            first: first.clone(),
            second: second.clone(),
            frames: self.pattern.frames.clone(),
            source: self.after.source(),
            output,
        }))
    }

    fn generating(&self) -> Result<MaskTask, Usage> {
        let size =
            self.pattern.size.ok_or_else(|| Usage("--size WxH is needed (or --after, --merge)".into()))?;
        let temporal = self.pattern.temporal();
        let density = match (self.pattern.density, self.pattern.rank) {
            (Some(_), true) if temporal != Temporal::Complementary => {
                return Err(Usage("--rank is the order for every density: leave --density away".into()));
            }
            (None, true) if temporal == Temporal::Complementary => {
                return Err(Usage(
                    "--rank with --temporal complementary needs --density D of a frame".into(),
                ));
            }
            (Some(density), _) => density,
            (None, true) => 1.0,
            (None, false) => return Err(Usage("--density D or --rank is needed".into())),
        };
        let request = Request {
            window: size.0,
            pattern: self.pattern.pattern.map_or(Pattern::Shuffle, Pattern::from),
            density,
            seed: self.pattern.seed(),
            temporal,
            paired: self.pattern.paired,
        };
        if request.temporal != Temporal::Fixed && self.pattern.frames.is_none() {
            return Err(Usage("--temporal needs --frames".into()));
        }
        if request.temporal == Temporal::Complementary && request.pattern == Pattern::Poisson {
            return Err(Usage("--temporal complementary: the masks of poisson do not complete each other: use another --pattern".into()));
        }
        if request.temporal == Temporal::Complementary && request.paired {
            return Err(Usage("--temporal complementary: masks of --paired do not complete each other: use --temporal offset".into()));
        }
        let (rank, output) = (self.pattern.rank, self.output.needed()?);
        let refused = |error| Usage(format!("{}: {error}", if rank { "--rank" } else { "--paired" }));
        request.check(rank).map_err(refused)?;
        if rank {
            check_image(&output.path, "rank").map_err(|error| Usage(format!("-o {error}")))?;
        }
        Ok(MaskTask::Generate {
            request,
            rank,
            frames: self.pattern.frames.as_ref().map(|frames| frames.numbers().to_vec()),
            bounds: self.pattern.bounds()?,
            output,
        })
    }
}

impl PatternArgs {
    /// Frames that may have other masks have them, which complete each other where they can.
    fn temporal(&self) -> Temporal {
        let has_none = self.paired || self.density.is_none() || self.pattern == Some(PatternName::Poisson);
        match self.temporal {
            Some(name) => name.into(),
            None if self.frames.is_none() => Temporal::Fixed,
            None if has_none => Temporal::Offset,
            None => Temporal::Complementary,
        }
    }

    fn seed(&self) -> u64 {
        self.seed.unwrap_or(0)
    }

    fn bounds(&self) -> Result<BoundFiles, Usage> {
        Ok(BoundFiles {
            inside: self.inside.as_ref().map(|source| file("--inside", source)).transpose()?,
            always: self.always.as_ref().map(|source| file("--always", source)).transpose()?,
            border: self.border.unwrap_or(0),
        })
    }
}

impl AfterArgs {
    fn source(&self) -> Source {
        self.mask.clone().unwrap_or(Source::Auto)
    }
}

impl OutputArgs {
    fn needed(&self) -> Result<MaskOutput, Usage> {
        let path = self.output.clone().ok_or_else(|| Usage("-o OUTPUT is needed".into()))?;
        let (create_dir, no_clobber) = (self.create_dir, self.no_clobber);
        let format = Format::of(&path).map_err(|error| Usage(format!("-o {error}")))?;
        if self.crop_overhead.is_some() && format != Format::Json {
            return Err(Usage("--crop-overhead goes with an output in .json; drop it".into()));
        }
        let overhead = self.crop_overhead.unwrap_or(CROP_OVERHEAD);
        Ok(MaskOutput { path, create_dir, no_clobber, overhead })
    }
}

impl From<PatternName> for Pattern {
    fn from(name: PatternName) -> Self {
        match name {
            PatternName::Random => Self::Random,
            PatternName::Shuffle => Self::Shuffle,
            PatternName::Poisson => Self::Poisson,
            PatternName::BlueNoise => Self::BlueNoise,
            PatternName::Grid => Self::Grid,
        }
    }
}

impl From<TemporalName> for Temporal {
    fn from(name: TemporalName) -> Self {
        match name {
            TemporalName::Fixed => Self::Fixed,
            TemporalName::Offset => Self::Offset,
            TemporalName::Complementary => Self::Complementary,
        }
    }
}

/// A source that is a file.
pub(super) fn file(flag: &str, source: &Source) -> Result<Source, Usage> {
    match source {
        Source::File { .. } => Ok(source.clone()),
        other => Err(Usage(format!("{flag} {other}: give an image file"))),
    }
}

/// A window as text: `WxH`, `WxH+X+Y`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Geometry(Window);

impl FromStr for Geometry {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || "not a size such as 1920x1080 or 2020x1180-50-50".to_string();
        let (size, offset) = match text.find(['+', '-']) {
            Some(at) => text.split_at(at),
            None => (text, "+0+0"),
        };
        let (width, height) = size.split_once('x').ok_or_else(wrong)?;
        let second = offset.rfind(['+', '-']).filter(|&at| at > 0).ok_or_else(wrong)?;
        let number = |text: &str| text.parse::<i32>().map_err(|_| wrong());
        let (x, y) = (number(&offset[..second])?, number(&offset[second..])?);
        let (width, height) = (number(width)?, number(height)?);
        if !(1..=32768).contains(&width) || !(1..=32768).contains(&height) {
            return Err("width and height must be from 1 to 32768".into());
        }
        // What OpenEXR opens.
        let most = i32::MAX / 2;
        let end = |first: i32, count: i32| -> Result<i32, String> {
            let end = first.checked_add(count - 1).filter(|end| first >= -most && *end <= most);
            end.ok_or_else(|| format!("all pixels must lie within -{most} and {most}"))
        };
        Ok(Self(Window { x_min: x, y_min: y, x_max: end(x, width)?, y_max: end(y, height)? }))
    }
}

#[cfg(test)]
mod tests;
