//! What is settled about each frame before it is opened: missing, there already, or to be done.

use std::io::Write;

use super::batch::{Decision, Failure, Work};
use super::console::{Console, label};
use super::plan::{Item, Plan, PlanError};
use super::update::Existing;

/// What is to be done with a frame; `is_current` tells whether its output would only be made again.
pub fn decide(
    item: &Item,
    skip_missing: bool,
    existing: Existing,
    is_current: impl Fn(&Item) -> bool,
) -> Result<Decision, Failure> {
    let skip = |reason: &str| Ok(Decision::Skip(reason.into()));
    if item.input.symlink_metadata().is_err_and(|error| error.kind() == std::io::ErrorKind::NotFound) {
        return if skip_missing {
            skip("the frame does not exist")
        } else {
            Err(Failure::at(&item.input, "the frame does not exist (--missing-frame skip passes over it)"))
        };
    }
    match existing {
        Existing::Keep if item.output.symlink_metadata().is_ok() => skip("the output exists"),
        Existing::Update if is_current(item) => skip("the output is up to date"),
        _ => Ok(Decision::Do),
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

/// Prints the plan of a dry run; the exit status is 1 if a frame would fail at once.
pub fn print(plan: &Plan, work: &dyn Work, console: &Console) -> u8 {
    let mut out = std::io::stdout().lock();
    let mut status = 0;
    let mut say = |text: String| {
        // A reader that went away needs no plan.
        drop(writeln!(out, "{text}"));
    };
    for folder in &plan.new_folders {
        say(format!("make folder  {}", folder.display()));
    }
    for item in &plan.items {
        let arrow = format!("{} -> {}", label(&item.input, item.number), item.output.display());
        match work.decide(item) {
            Ok(Decision::Do) => {
                let mask =
                    item.mask.as_ref().map(|mask| format!(" (mask {})", mask.display())).unwrap_or_default();
                say(format!("{}  {arrow}{mask}", work.words().0));
            }
            Ok(Decision::Skip(reason)) => say(format!("skip  {arrow}: {reason}")),
            Err(failure) => {
                say(format!("fail  {arrow}"));
                console.error(&format!("{}: {}", label(&failure.file, item.number), failure.text));
                status = 1;
            }
        }
    }
    status
}
