//! Holding filled frames against the sparse ones: what is done with each, and with all of them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use lacuna_exr::{Frame, Limits, Part};

use crate::files::error::PlanError;
use crate::files::inputs::Selection;
use crate::files::plan::{Item, Plan, check_reports, pair};
use crate::mask::shared::MaskFiles;
use crate::mask::{self, Masks, Source};
use crate::reconstruct::{Stamp, blank, drop_errors, is_enlarged, made_by};
use crate::run::batch::{Decision, Failure, RunOptions, Stage, Work};
use crate::run::record::{Heading, Record};
use crate::run::schedule::Need;
use crate::run::{batch, memory, outputs};
use crate::verify::{Claims, Difference, compare};
use crate::{channels, guides};

/// How many differences of a frame are named; the rest is counted.
const NAMED: usize = 8;

/// What is said of a copy that no mask was needed for.
const COMPLETE: &str = "no mask was found, and the frame equals its input: it was taken for complete; --mask names what says otherwise";

/// Filled frames to be verified.
#[derive(Clone, Debug, PartialEq)]
pub struct VerifyJob {
    /// The sparse frames.
    pub selection: Selection,
    /// Whether sparse frames that do not exist are passed over.
    pub skip_missing: bool,
    /// File, pattern or folder of the filled frames.
    pub filled: PathBuf,
    /// Where the mask comes from; what the filled frame's attributes say if `None`.
    pub mask: Option<Source>,
    /// How to run.
    pub run: RunOptions,
}

/// Verifies the frames; the exit status.
pub fn verify(job: &VerifyJob) -> Result<u8, PlanError> {
    let mask = match &job.mask {
        Some(Source::File { pattern, .. }) => Some(pattern.as_str()),
        _ => None,
    };
    let items = pair(&job.selection, &job.filled, mask)?;
    check_reports(&items, [&job.run.json, &job.run.log].into_iter().flatten().map(PathBuf::as_path))?;
    let work = Verify { job, masks: MaskFiles::default() };
    let console = job.run.console()?;
    if job.run.dry_run {
        return Ok(outputs::print(&Plan { items, new_folders: BTreeSet::new() }, &work, &console));
    }
    console.listen();
    let heading =
        Heading { lacuna: env!("CARGO_PKG_VERSION"), command: "verify", filter: None, settings: None };
    batch::run(heading, &items, &job.run, &work, &console).map_err(PlanError::Failed)
}

struct Verify<'a> {
    job: &'a VerifyJob,
    masks: MaskFiles,
}

impl Work for Verify<'_> {
    fn words(&self) -> (&'static str, &'static str) {
        ("verify", "verified")
    }

    fn is_gate(&self) -> bool {
        true
    }

    fn decide(&self, item: &Item) -> Result<Decision, Failure> {
        outputs::decide(item, self.job.skip_missing)
    }

    fn need(&self, item: &Item) -> Need {
        memory::to_copy(&item.input).saturating_add(memory::to_copy(&item.output)).into()
    }

    fn frame(&self, item: &Item, stage: &Stage<'_>, record: &mut Record) -> Result<(), Failure> {
        let limits = memory::limits(self.job.run.memory, self.need(item).most);
        let (mut sparse, filled) = stage.read(record, || {
            let read = |path| lacuna_exr::read(path, &limits).map_err(|error| Failure::at(path, error));
            Ok((read(&item.input)?, read(&item.output)?))
        })?;
        if let Some(made) = enlarged_by(&sparse, &filled) {
            let line = "verify checks fills, not enlarged frames; lacuna compare checks them against a frame rendered at their size";
            return Err(Failure::at(&item.output, format!("{made}: {line}")));
        }
        // What filled it again has dropped them.
        let stamp = |part: &Part| Stamp::read(&part.attributes);
        let again = |index: usize, part: &Part| {
            filled.parts.get(index).is_some_and(|filled| stamp(filled) != stamp(part))
        };
        drop_errors(&mut sparse, again);
        let anew = sparse.parts.iter().enumerate().any(|(index, part)| again(index, part));
        let claims = Claims::read(&filled);
        let (masks, unmasked) = self.masks_of(item, (&sparse, &claims), limits)?;
        record.mask = Some(masks.origin.clone());
        record.density = masks.density();
        record.warn(&claims.not_compared());
        let differences = stage.solve(record, || {
            let mut choices = channels::choose(&sparse, &masks.mask_channels, &claims.overrides);
            if anew && mask::filled_before(&sparse, &masks).is_some() {
                blank(&mut sparse, &masks, &choices);
            }
            // Guides that cannot be found leave the rules as they are, and what was kept shows as a difference.
            drop(guides::find(&sparse, &masks, &mut choices, &claims.guides, None));
            compare(&sparse, &filled, &masks, &choices)
        });
        match unmasked {
            Some(failure) if !differences.is_empty() => return Err(failure),
            Some(_) => record.warn(&[COMPLETE.into()]),
            None => {}
        }
        if differences.is_empty() {
            return Ok(());
        }
        let are_swapped = Claims::are_swapped(&sparse, &filled);
        let hint = if are_swapped { "are the two swapped? The sparse frame comes first: " } else { "" };
        Err(Failure::at(&item.output, format!("{hint}{}", list(&differences))))
    }
}

impl Verify<'_> {
    /// The masks to go by. A frame without one that shows no missing pixel may be complete, and its output a copy; what is to be said if it is not.
    fn masks_of(
        &self,
        item: &Item,
        (sparse, claims): (&Frame, &Claims),
        limits: Limits,
    ) -> Result<(Masks, Option<Failure>), Failure> {
        let source = self.job.mask.as_ref().unwrap_or(&claims.mask);
        let path = match (&item.mask, source) {
            (Some(path), _) => Some(path.as_path()),
            (None, Source::File { pattern, .. }) => Some(Path::new(pattern)),
            _ => None,
        };
        let hint = match (&self.job.mask, source) {
            (None, Source::File { .. }) => {
                " (the path is from the attribute lacuna/mask; verify --mask overrides it)"
            }
            _ => "",
        };
        let file = path.map(|path| self.masks.get(path, limits)).transpose();
        let file = file.map_err(|error| Failure::at(&item.output, format!("{error}{hint}")))?;
        let says_nothing = self.job.mask.is_none() && claims.filter.is_empty();
        mask::find(sparse, source, file.as_deref()).map(|masks| (masks, None)).or_else(|error| {
            let failure = Failure::at(&item.input, &error);
            match error {
                mask::Error::NotFound { hint: None, .. } if says_nothing && mask::seems_complete(sparse) => {
                    Ok((Masks::complete(sparse), Some(failure)))
                }
                _ => Err(failure),
            }
        })
    }
}

/// What enlarged the second frame, if the first was not enlarged as well.
fn enlarged_by(sparse: &Frame, filled: &Frame) -> Option<String> {
    let by = |frame: &Frame| frame.parts.iter().find(|part| is_enlarged(part)).and_then(made_by);
    by(filled).filter(|_| by(sparse).is_none())
}

/// The differences on one line.
fn list(differences: &[Difference]) -> String {
    let named: Vec<String> = differences.iter().take(NAMED).map(ToString::to_string).collect();
    let more = differences.len().saturating_sub(NAMED);
    let rest = if more > 0 { format!("; and {more} more differences") } else { String::new() };
    format!("not as promised: {}{rest}", named.join("; "))
}
