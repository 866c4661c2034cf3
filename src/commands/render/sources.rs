//! What frames are rendered from: a scene, and the files that it names.

use std::path::{Path, PathBuf};

use lacuna_volume::Scene;

use super::{Pixels, RenderJob};
use crate::files::error::PlanError;
use crate::files::plan::Item;
use crate::run::batch::Failure;

/// The scene, and the folder that its paths are relative to; its picture has pixels for all rounds.
pub fn scene(job: &RenderJob) -> Result<(Scene, PathBuf), PlanError> {
    let (scene, folder) = read_scene(job)?;
    if let Pixels::Adaptive(settings) = &job.pixels {
        let [width, height] = scene.image.size;
        settings.check(width * height).map_err(|error| PlanError::Usage(format!("--adaptive: {error}")))?;
    }
    Ok((scene, folder))
}

fn read_scene(job: &RenderJob) -> Result<(Scene, PathBuf), PlanError> {
    let failed = |error: lacuna_volume::Error| PlanError::Failed(error.to_string());
    if job.scene.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
        let folder = job.scene.parent().unwrap_or_else(|| Path::new("")).to_path_buf();
        let scene = Scene::read(&job.scene, &job.overrides).map_err(|error| match error {
            // The file is named already.
            lacuna_volume::Error::Io { .. } | lacuna_volume::Error::File { .. } => failed(error),
            lacuna_volume::Error::Set(_) => PlanError::Usage(format!("{}: {error}", job.scene.display())),
            _ => PlanError::Failed(format!("{}: {error}", job.scene.display())),
        });
        return Ok((scene?, folder));
    }
    let mut scene = Scene::parse("", &job.overrides).map_err(|error| PlanError::Usage(error.to_string()))?;
    if scene.volume.is_empty() {
        let volume = job.scene.to_str().ok_or_else(|| {
            PlanError::Usage(format!("{}: the volume's path is not UTF-8: rename it", job.scene.display()))
        })?;
        volume.clone_into(&mut scene.volume);
    }
    Ok((scene, PathBuf::new()))
}

/// What frames of a scene are called in a folder: as its file, or as its kind if the tool makes it itself.
pub fn name(scene: &Path) -> String {
    let text = scene.to_string_lossy();
    if let Some(kind) = text.strip_prefix(lacuna_volume::PROCEDURAL) {
        return kind.split(':').next().unwrap_or_default().into();
    }
    scene.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// The files that the scene names.
pub fn volume_files(item: &Item) -> impl Iterator<Item = (&Path, &'static str)> {
    item.made_from.iter().map(|(what, path)| (&**path, *what))
}

/// The mask's file, if there is one.
pub fn mask_file(item: &Item) -> impl Iterator<Item = (&Path, &'static str)> {
    item.mask.iter().map(|mask| (&**mask, "mask"))
}

/// Whether the files that the scene names are there.
pub fn check_files(item: &Item) -> Result<(), Failure> {
    let lost = item.made_from.iter().find(|(_, path)| !path.exists());
    lost.map_or(Ok(()), |(what, path)| {
        let flag = if *what == "volume" { ": --volume FILE names another one" } else { "" };
        Err(Failure::at(path, format!("there is no such file{flag}")))
    })
}
