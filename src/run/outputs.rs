//! What is settled about each frame before it is opened: missing, there already, or to be done.

use std::io::{BufWriter, ErrorKind, Write};
use std::path::Path;

use lacuna_exr::{Frame, Over, WriteOptions};

use crate::files::content::{Seen, Sums};
use crate::files::error::PlanError;
use crate::files::identity::leads_nowhere;
use crate::files::plan::{Item, Plan};
use crate::run::batch::{Decision, Failure, Stage, Work};
use crate::run::console::{Console, label};
use crate::run::existing::Existing;
use crate::run::record::Record;

/// What is to be done with a frame that is read.
pub fn decide(item: &Item, skip_missing: bool) -> Result<Decision, Failure> {
    if let Some(text) = leads_nowhere(&item.input) {
        return Err(Failure::at(&item.input, text));
    }
    match item.input.metadata() {
        Err(error) if error.kind() == ErrorKind::NotFound && skip_missing => {
            Ok(Decision::Skip("the frame does not exist".into()))
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let text = "the frame does not exist (--missing-frame skip passes over it)";
            Err(Failure::at(&item.input, text))
        }
        Ok(found) if !found.is_file() => {
            Err(Failure::at(&item.input, "cannot open: it is not a regular file"))
        }
        _ => Ok(Decision::Do),
    }
}

/// The same for one from which another is made.
pub fn decide_to_write(
    item: &Item,
    skip_missing: bool,
    existing: Existing,
    stale: impl Fn(&Item) -> Option<String>,
) -> Result<Decision, Failure> {
    match decide(item, skip_missing)? {
        Decision::Do => decide_to_make(item, existing, stale),
        other => Ok(other),
    }
}

/// What is to be done with an output, `stale` telling why one that exists is not what would be made: what is to be done can be
/// done, as far as names, kinds and rights of files tell.
pub fn decide_to_make(
    item: &Item,
    existing: Existing,
    stale: impl Fn(&Item) -> Option<String>,
) -> Result<Decision, Failure> {
    let mut decision = Decision::Do;
    let skip = |reason: &str| Ok(Decision::Skip(reason.into()));
    match existing {
        // A folder in the output's place is no output.
        Existing::Keep if item.output.symlink_metadata().is_ok_and(|found| !found.is_dir()) => {
            return match leads_nowhere(&item.output) {
                Some(text) => Err(Failure::at(&item.output, text)),
                None => skip("the output exists"),
            };
        }
        Existing::Update if item.output.exists() => match stale(item) {
            None => return skip("the output is up to date"),
            Some(why) => decision = Decision::Again(why),
        },
        _ => {}
    }
    item.added().try_for_each(check_added)?;
    let over = if existing == Existing::Force { Over::Force } else { Over::Replace };
    lacuna_exr::check_destination(&item.output, over)
        .map_err(|error| refused(&item.output, existing, &error))?;
    Ok(decision)
}

/// Why an output cannot be written, with what the commands that take `--force` can do about it, which goes with no other flag of
/// that kind.
fn refused(output: &Path, existing: Existing, error: &lacuna_exr::Error) -> Failure {
    let takes_force = existing == Existing::Replace && matches!(error, lacuna_exr::Error::ReadOnly);
    let hint = if takes_force { ", or replace it with --force" } else { "" };
    Failure::at(output, format!("{error}{hint}"))
}

/// That a file which is read with the input is there.
fn check_added((path, what): (&Path, &'static str)) -> Result<(), Failure> {
    let why = match path.metadata() {
        Ok(found) if found.is_file() => return Ok(()),
        Ok(_) => "it is not a regular file".into(),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            leads_nowhere(path).unwrap_or_else(|| "the file is missing".into())
        }
        Err(error) => error.to_string(),
    };
    let flag = match what {
        "guides" => " (--guides-from)",
        "layer" => " (--layers)",
        _ => "",
    };
    let is_name = what == "mask" && path.extension().is_none() && path.components().count() == 1;
    let is_name = is_name && !path.exists();
    let hint =
        if is_name { format!("; a channel is named channel:{}", path.display()) } else { String::new() };
    Err(Failure::at(path, format!("cannot read the {what}{flag}: {why}{hint}")))
}

/// That what a frame was made from is still there as it was read: nothing else would tell that the output is of other files.
pub fn check_unchanged(seen: &Seen, sums: &Sums) -> Result<(), Failure> {
    let text = |what| format!("the {what} changed while the frame was made, which is not written; run again");
    seen.changed(sums).map_or(Ok(()), |(path, what)| Err(Failure::at(path, text(what))))
}

/// Writes a frame. An output that came into being since the decision is passed over like one that was there.
pub fn write(
    frame: &Frame,
    item: &Item,
    (existing, compression_level): (Existing, Option<u8>),
    stage: &Stage<'_>,
    record: &mut Record,
) -> Result<(), Failure> {
    let options = WriteOptions { compression_level, over: existing.over() };
    match stage.write(record, || lacuna_exr::write(frame, &item.output, &options)) {
        Err(lacuna_exr::Error::Exists) if existing == Existing::Keep => {
            record.pass_over("the output appeared during the run".into());
            Ok(())
        }
        result => result.map_err(|error| refused(&item.output, existing, &error)),
    }
}

/// Makes the folders that the plan wants.
pub fn make_folders(plan: &Plan) -> Result<(), PlanError> {
    plan.new_folders.iter().try_for_each(|folder| {
        std::fs::create_dir_all(folder).map_err(|error| {
            PlanError::Failed(format!("{}: cannot make the folder: {error}", folder.display()))
        })
    })
}

/// Prints the plan of a dry run; the exit status is 1 if a frame would fail at once or the plan cannot be printed.
pub fn print(plan: &Plan, work: &dyn Work, console: &Console) -> u8 {
    let mut failed = false;
    let mut out = BufWriter::new(std::io::stdout().lock());
    let printed = print_to(&mut out, plan, work, |text| {
        failed = true;
        console.error(&text);
    });
    if let Err(error) = printed.and_then(|()| out.flush())
        // A reader that went away needs no plan.
        && error.kind() != ErrorKind::BrokenPipe
    {
        console.error(&format!("cannot write the plan to standard output: {error}"));
        failed = true;
    }
    u8::from(failed)
}

fn print_to(
    out: &mut impl Write,
    plan: &Plan,
    work: &dyn Work,
    mut fail: impl FnMut(String),
) -> std::io::Result<()> {
    for folder in &plan.new_folders {
        writeln!(out, "make folder  {}", folder.display())?;
    }
    for item in &plan.items {
        let arrow = format!("{} -> {}", label(&item.input, item.number), item.output.display());
        match work.decide(item) {
            Ok(decision @ (Decision::Do | Decision::Again(_))) => {
                let mask =
                    item.mask.as_ref().map(|mask| format!(" (mask {})", mask.display())).unwrap_or_default();
                let why =
                    if let Decision::Again(why) = decision { format!(": {why}") } else { String::new() };
                writeln!(out, "{}  {arrow}{mask}{why}", work.words().0)?;
            }
            Ok(Decision::Skip(reason)) => writeln!(out, "skip  {arrow}: {reason}")?,
            Err(failure) => {
                writeln!(out, "fail  {arrow}")?;
                fail(format!("{}: {}", label(&failure.file, item.number), failure.text));
            }
        }
    }
    Ok(())
}
