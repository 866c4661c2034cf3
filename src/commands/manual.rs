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
    clap_mangen::generate_to(job.pages.clone(), &pages).map_err(|error| failed(&pages, &error))?;
    for (place, script) in &job.scripts {
        let path = job.prefix.join(place);
        make(path.parent().unwrap_or(&path))?;
        lacuna_exr::write_whole(&path, script).map_err(|error| failed(&path, &error))?;
    }
    Ok(0)
}

fn make(folder: &Path) -> Result<(), PlanError> {
    fs::create_dir_all(folder).map_err(|error| failed(folder, &error))
}

fn failed(path: &Path, error: &dyn std::fmt::Display) -> PlanError {
    PlanError::Failed(format!("{}: {error}", path.display()))
}
