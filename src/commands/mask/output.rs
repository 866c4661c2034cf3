//! Where masks go, and which files bound them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use lacuna_exr::{Limits, Window};
use lacuna_filters::Mask;

use crate::files::error::PlanError;
use crate::files::identity::leads_nowhere;
use crate::files::names::folder_of;
use crate::files::patterns::Pattern;
use crate::files::plan::check_folder;
use crate::mask::generate::{self, Bounds};
use crate::mask::output::Writing;
use crate::mask::{MakeError, Source};
use crate::run::console::Console;

/// Where an output goes.
#[derive(Clone, Debug, PartialEq)]
pub struct MaskOutput {
    /// The file, or a pattern.
    pub path: PathBuf,
    /// Make its folder where it is missing.
    pub create_dir: bool,
    /// Leave files that exist.
    pub no_clobber: bool,
    /// Pixels that starting a crop costs, for rectangles.
    pub overhead: usize,
}

/// The files of [`Bounds`]; patterns go frame by frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoundFiles {
    /// Only where this image is above 0.
    pub inside: Option<Source>,
    /// Also where this image is above 0.
    pub always: Option<Source>,
    /// Outermost pixels.
    pub border: usize,
}

/// The file of a frame that is read, where the path is a pattern.
pub fn of_frame(path: &Path, number: Option<i64>) -> PathBuf {
    numbered(path, number).map_or_else(|| path.into(), |(pattern, number)| pattern.file(number))
}

/// The file that is written for a frame, where the path is a pattern: its number is spelt as in the frame's own name.
pub fn output_of_frame(path: &Path, frame: &Path, number: Option<i64>) -> PathBuf {
    numbered(path, number).map_or_else(|| path.into(), |(pattern, number)| pattern.spelt_as(number, frame))
}

fn numbered(path: &Path, number: Option<i64>) -> Option<(Pattern, i64)> {
    Some((Pattern::of(path).ok()??, number?))
}

/// The source of a frame, where it is the pattern of files.
pub fn source_of_frame(source: &Source, number: Option<i64>) -> Source {
    match source {
        Source::File { pattern, channel } => {
            let pattern = of_frame(pattern.as_ref(), number).display().to_string();
            Source::File { pattern, channel: channel.clone() }
        }
        other => other.clone(),
    }
}

impl MaskOutput {
    /// That of one frame.
    #[must_use]
    pub fn of_frame(&self, frame: &Path, number: Option<i64>) -> Self {
        Self { path: output_of_frame(&self.path, frame, number), ..self.clone() }
    }

    /// Whether a file is to be written; one that is there and stays is passed over.
    pub fn wants(&self, path: &Path, console: &Console) -> Result<bool, PlanError> {
        if !self.no_clobber || path.symlink_metadata().is_err() {
            return Ok(true);
        }
        if let Some(text) = leads_nowhere(path) {
            return Err(PlanError::Failed(format!("{}: {text}", path.display())));
        }
        console.note(&format!("{}: skipped: the output exists", path.display()));
        Ok(false)
    }

    /// Whether a file was written; one that came into being meanwhile is passed over like one that was there.
    pub fn wrote(
        &self,
        path: &Path,
        written: Result<(), MakeError>,
        console: &Console,
    ) -> Result<bool, PlanError> {
        match written {
            Err(MakeError::Frame(lacuna_exr::Error::Exists)) if self.no_clobber => {
                console.note(&format!("{}: skipped: the output appeared during the run", path.display()));
                Ok(false)
            }
            written => written.map(|()| true).map_err(failed(path)),
        }
    }

    /// How it is written.
    pub fn writing(&self) -> Writing {
        Writing { no_clobber: self.no_clobber, overhead: self.overhead, attributes: Vec::new() }
    }

    /// Makes the folder of an output, that of a frame where they have folders of their own, if that was asked for; else it is to be there.
    pub fn make_folder(&self, path: &Path) -> Result<(), PlanError> {
        let folder = folder_of(path);
        check_folder(path, self.create_dir, &mut BTreeSet::new())?;
        std::fs::create_dir_all(&folder).map_err(|error| {
            PlanError::Failed(format!("{}: cannot make the folder: {error}", folder.display()))
        })
    }
}

impl BoundFiles {
    /// The images, and what they are.
    pub fn files(&self) -> impl Iterator<Item = (&Path, &'static str)> {
        let all = [(&self.inside, "image of --inside"), (&self.always, "image of --always")];
        all.into_iter().filter_map(|(source, what)| Some((source.as_ref()?.path()?, what)))
    }

    /// The files of one frame.
    #[must_use]
    pub fn of_frame(&self, number: Option<i64>) -> Self {
        let numbered =
            |source: &Option<Source>| source.as_ref().map(|source| source_of_frame(source, number));
        Self { inside: numbered(&self.inside), always: numbered(&self.always), border: self.border }
    }

    /// Reads the images that bound a mask over this window.
    pub fn read(&self, window: Window, limits: Limits) -> Result<Bounds, MakeError> {
        let region = |source: &Option<Source>| match source {
            Some(Source::File { pattern, channel }) => {
                generate::region(pattern, channel.as_deref(), window, limits).map(Some)
            }
            _ => Ok(None),
        };
        let inside = region(&self.inside)?;
        if let (Some(Source::File { pattern, .. }), Some(mask)) = (&self.inside, &inside)
            && mask.is_empty()
        {
            let text =
                format!("--inside {pattern}: it is above 0 at none of the mask's pixels; see their windows");
            return Err(MakeError::Other(text));
        }
        Ok(Bounds { inside, always: region(&self.always)?, border: self.border })
    }
}

pub fn failed(path: &Path) -> impl Fn(MakeError) -> PlanError + '_ {
    move |error| PlanError::Failed(format!("{}: {error}", path.display()))
}

pub fn report(path: &Path, mask: &Mask, console: &Console) {
    let (count, density) = (mask.count(), 100.0 * mask.density());
    console.note(&format!("{}: {count} pixels, density {density:.3} %", path.display()));
}
