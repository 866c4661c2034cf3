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
        .manual("lacuna");
    let path = folder.join(man.get_filename());
    let mut page = Vec::new();
    man.render(&mut page).map_err(|error| failed(&path, &error))?;
    lacuna_exr::write_whole(&path, &page).map_err(|error| failed(&path, &error))
}

fn make(folder: &Path) -> Result<(), PlanError> {
    fs::create_dir_all(folder).map_err(|error| failed(folder, &error))
}

fn failed(path: &Path, error: &dyn std::fmt::Display) -> PlanError {
    PlanError::Failed(format!("{}: {error}", path.display()))
}
