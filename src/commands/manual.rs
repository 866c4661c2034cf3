//! Man pages and completions, written where systems look for them.

use std::fs;
use std::path::{Path, PathBuf};

use crate::files::PlanError;

/// Files to install.
#[derive(Clone, Debug)]
pub struct ManualJob {
    /// The folder that `share` lies in.
    pub prefix: PathBuf,
    /// What the pages describe, one each subcommand.
    pub pages: clap::Command,
    /// Scripts, and where each goes.
    pub scripts: Vec<(&'static str, Vec<u8>)>,
}

/// Equal where the same files go to the same place.
impl PartialEq for ManualJob {
    fn eq(&self, other: &Self) -> bool {
        self.prefix == other.prefix && self.scripts == other.scripts
    }
}

/// Writes them.
pub fn manual(job: &ManualJob) -> Result<u8, PlanError> {
    let pages = job.prefix.join("share/man/man1");
    make(&pages)?;
    let mut command = job.pages.clone().disable_help_subcommand(true);
    command.build();
    write_pages(&command, &pages)?;
    for (place, script) in &job.scripts {
        let path = job.prefix.join(place);
        make(path.parent().unwrap_or(&path))?;
        lacuna_exr::write_whole(&path, script).map_err(|error| failed(&path, &error))?;
    }
    Ok(0)
}

/// Writes the page of a command and those of its subcommands.
fn write_pages(command: &clap::Command, folder: &Path) -> Result<(), PlanError> {
    for subcommand in command.get_subcommands().filter(|subcommand| !subcommand.is_hide_set()) {
        write_pages(subcommand, folder)?;
    }
    let man = clap_mangen::Man::new(command.clone())
        .source(concat!("lacuna ", env!("CARGO_PKG_VERSION")))
        .manual("lacuna")
        .date(released());
    let path = folder.join(man.get_filename());
    let mut page = Vec::new();
    man.render(&mut page).map_err(|error| failed(&path, &error))?;
    lacuna_exr::write_whole(&path, &tidy(&page)).map_err(|error| failed(&path, &error))
}

/// The day of the newest release.
fn released() -> &'static str {
    let heading = include_str!("../../CHANGELOG.md").lines().find(|line| line.starts_with("## ["));
    heading.and_then(|line| line.rsplit_once(' ')).map_or("", |(_, day)| day)
}

/// Leaves out breaks beside vertical space (empty lines, too), which `mandoc` complains of.
fn tidy(page: &[u8]) -> Vec<u8> {
    let lines: Vec<&[u8]> = page.split(|&byte| byte == b'\n').collect();
    let is_space =
        |at: Option<usize>| at.and_then(|at| lines.get(at)).is_some_and(|line| matches!(*line, b"" | b".sp"));
    let is_idle = |at: usize| lines[at] == b".br" && (is_space(at.checked_sub(1)) || is_space(Some(at + 1)));
    let kept: Vec<&[u8]> = (0..lines.len()).filter(|&at| !is_idle(at)).map(|at| lines[at]).collect();
    kept.join(&b'\n')
}

fn make(folder: &Path) -> Result<(), PlanError> {
    fs::create_dir_all(folder).map_err(|error| failed(folder, &error))
}

fn failed(path: &Path, error: &dyn std::fmt::Display) -> PlanError {
    PlanError::Failed(format!("{}: {error}", path.display()))
}
