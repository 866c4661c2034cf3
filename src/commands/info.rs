//! Describing one frame on standard output.

use std::io::Write;
use std::path::{Path, PathBuf};

use crate::channels::{self, Override};
use crate::files::error::PlanError;
use crate::guides::{self, Asked};
use crate::info;
use crate::mask::{self, MaskFile, Masks, Source};
use crate::run::batch::Failure;
use crate::run::memory;

/// The frame to be described.
#[derive(Clone, Debug, PartialEq)]
pub struct InfoJob {
    /// Its file.
    pub frame: PathBuf,
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

/// Describes the frame; the exit status.
pub fn info(job: &InfoJob) -> Result<u8, PlanError> {
    let failed =
        |failure: Failure| PlanError::Failed(format!("{}: {}", failure.file.display(), failure.text));
    let limits = memory::reading(job.memory);
    let frame =
        lacuna_exr::read(&job.frame, &limits).map_err(|error| failed(Failure::at(&job.frame, error)))?;
    let file = match &job.mask {
        Source::File { pattern, .. } => {
            let read = MaskFile::read(pattern.as_ref(), limits);
            Some(read.map_err(|error| failed(Failure::at(&job.frame, error)))?)
        }
        _ => None,
    };
    let found = mask::find(&frame, &job.mask, file.as_ref());
    let none = Masks::default();
    let mut choices =
        channels::choose(&frame, &found.as_ref().unwrap_or(&none).mask_channels, &job.overrides);
    let second = job.guides_from.as_ref().map(|path| {
        let path = Path::new(path);
        lacuna_exr::read(path, &limits).map_err(|error| failed(Failure::at(path, error)))
    });
    let guided = guides::find(
        &frame,
        found.as_ref().unwrap_or(&none),
        &mut choices,
        &job.guides,
        second.transpose()?.as_ref(),
    );
    let guided = guided.map_err(|error| failed(Failure::at(&job.frame, error)))?;
    let mut info = info::describe(&frame, found.as_ref(), &choices);
    for (index, part) in info.parts.iter_mut().enumerate() {
        part.guides = guided.names(index);
    }
    info.notes.extend(channels::unheeded(
        &frame,
        &found.as_ref().unwrap_or(&none).mask_channels,
        &job.overrides,
        &choices,
    ));
    let text = if job.print_rules {
        channels::print_rules(&frame, &choices)
    } else if job.json {
        serde_json::to_string_pretty(&info).map_err(|error| PlanError::Failed(error.to_string()))?
    } else {
        info.to_string()
    };
    let written = writeln!(std::io::stdout().lock(), "{}", text.trim_end());
    match written {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(PlanError::Failed(format!("cannot write to standard output: {error}")))
        }
        _ => match found {
            // `auto` that finds nothing is an answer; a mask that was asked for and is none is not.
            Err(error) if job.mask != Source::Auto => Err(failed(Failure::at(&job.frame, error))),
            _ => Ok(0),
        },
    }
}
