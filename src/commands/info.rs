//! Describing frames on standard output.

use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::channels::{self, Override, visible};
use crate::files::error::PlanError;
use crate::files::inputs::{Selection, resolve};
use crate::files::reports;
use crate::guides::{self, Asked};
use crate::info::{self, Info};
use crate::mask::{self, MaskFile, Masks, Source};
use crate::reconstruct::blank;
use crate::run::batch::Failure;
use crate::run::memory;

/// Frames to be described.
#[derive(Clone, Debug, PartialEq)]
pub struct InfoJob {
    /// Their files, patterns and globs.
    pub frames: Vec<PathBuf>,
    /// Where the mask comes from.
    pub mask: Source,
    /// Rules before the defaults.
    pub overrides: Vec<Override>,
    /// The guides that are looked for.
    pub guides: Asked,
    /// The file that they come from, if it is another one.
    pub guides_from: Option<String>,
    /// Bytes that reading the frame may take, if not the default.
    pub memory: Option<u64>,
    /// Whether the rules are printed, as a file.
    pub print_rules: bool,
    /// Whether JSON is printed.
    pub json: bool,
}

/// Describes the frames, each as soon as it was read; the exit status.
pub fn info(job: &InfoJob) -> Result<u8, PlanError> {
    let selection = Selection { inputs: job.frames.clone(), ..Selection::default() };
    let inputs = resolve(&selection)?;
    if let (false, [input]) = (inputs.is_set, &*inputs.frames) {
        let described = describe(job, &input.path)?;
        print(&described.text(job, None)?)?;
        return described.mask.map_or(Ok(0), Err);
    }
    if job.print_rules {
        return Err(PlanError::Usage("--rules prints those of one frame: name one".into()));
    }
    let (mut status, mut all) = (0, Vec::new());
    for input in &inputs.frames {
        let described = describe(job, &input.path).and_then(|described| {
            let text = described.text(job, Some(&input.path))?;
            if job.json {
                all.push(text);
            } else {
                print(&text)?;
            }
            described.mask.map_or(Ok(()), Err)
        });
        if let Err(error) = described {
            // Nobody is left to tell if the stream is closed.
            drop(writeln!(std::io::stderr().lock(), "lacuna: error: {error}"));
            status = 1;
        }
    }
    if job.json {
        print(&format!("[\n{}\n]", all.join(",\n")))?;
    }
    Ok(status)
}

/// Writes to standard output.
fn print(text: &str) -> Result<(), PlanError> {
    reports::print(&format!("{}\n", text.trim_end()))
}

/// What there is to say of a frame.
struct Described {
    info: Info,
    /// As a file.
    rules: String,
    /// Why the mask that was asked for is none; `auto` that finds nothing is an answer.
    mask: Option<PlanError>,
}

/// The same of one of several.
#[derive(Serialize)]
struct Named<'a> {
    file: &'a Path,
    #[serde(flatten)]
    info: &'a Info,
}

impl Described {
    /// As it is asked for, with its name if it is one of several.
    fn text(&self, job: &InfoJob, name: Option<&Path>) -> Result<String, PlanError> {
        let json =
            |made: serde_json::Result<String>| made.map_err(|error| PlanError::Failed(error.to_string()));
        match name {
            _ if job.print_rules => Ok(self.rules.clone()),
            Some(file) if job.json => json(serde_json::to_string_pretty(&Named { file, info: &self.info })),
            None if job.json => json(serde_json::to_string_pretty(&self.info)),
            Some(file) => Ok(format!("{}:\n{}", visible(&file.to_string_lossy()), self.info)),
            None => Ok(self.info.to_string()),
        }
    }
}

/// Reads a frame, and says what it holds and what filling it would do.
fn describe(job: &InfoJob, path: &Path) -> Result<Described, PlanError> {
    let failed =
        |failure: Failure| PlanError::Failed(format!("{}: {}", failure.file.display(), failure.text));
    let limits = memory::reading(job.memory);
    let frame = lacuna_exr::read(path, &limits).map_err(|error| failed(Failure::at(path, error)))?;
    let file = match &job.mask {
        Source::File { pattern, .. } => {
            let read = MaskFile::read(pattern.as_ref(), limits);
            Some(read.map_err(|error| failed(Failure::at(path, error)))?)
        }
        _ => None,
    };
    let found = mask::find(&frame, &job.mask, file.as_ref());
    let none = Masks::default();
    let masks = found.as_ref().unwrap_or(&none);
    let mut choices = channels::choose(&frame, &masks.mask_channels, &job.overrides);
    // A channel that was filled is none that was complete.
    let sparse = mask::filled_before(&frame, masks).map(|_| {
        let mut sparse = frame.clone();
        blank(&mut sparse, masks, &choices);
        sparse
    });
    let judged = sparse.as_ref().unwrap_or(&frame);
    if sparse.is_some() {
        choices = channels::choose(judged, &masks.mask_channels, &job.overrides);
    }
    let second = job.guides_from.as_ref().map(|path| {
        let path = Path::new(path);
        lacuna_exr::read(path, &limits).map_err(|error| failed(Failure::at(path, error)))
    });
    let guided = guides::find(judged, masks, &mut choices, &job.guides, second.transpose()?.as_ref());
    let from = job.guides_from.as_ref().map(Path::new);
    let guided = guided.map_err(|error| failed(Failure::at(error.file(path, from), error)))?;
    let mut info = info::describe(&frame, found.as_ref(), &choices);
    for (index, part) in info.parts.iter_mut().enumerate() {
        part.guides = guided.names(index);
    }
    info.notes.extend(channels::unheeded(&frame, &masks.mask_channels, &job.overrides, &choices));
    let mask = found.err().filter(|_| job.mask != Source::Auto);
    Ok(Described {
        rules: channels::print_rules(&frame, &choices),
        info,
        mask: mask.map(|error| failed(Failure::at(path, error))),
    })
}
