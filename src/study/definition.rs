//! What a study's TOML file says, checked as far as no frame has to be opened for it.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::figures::KINDS;
use super::selection::Selection;
use crate::channels::problem;
use crate::files::ranges::Frames;

/// A study as its file has it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Definition {
    /// What the report is called.
    #[serde(default = "untitled")]
    pub title: String,
    /// The frames.
    pub frames: Vec<SubjectDefinition>,
    /// Names of patterns, as `mask --pattern` has them, or `adaptive` with its settings ([`Selection`]).
    pub patterns: Vec<String>,
    /// Measured pixels over all pixels, above 0, at most 1.
    pub densities: Vec<f64>,
    /// One mask a seed.
    #[serde(default = "one_seed")]
    pub seeds: Vec<u64>,
    /// Filters, each as it follows `--filter` on `fill`'s command line; `all` is each filter that needs no file, with its defaults.
    pub filters: Vec<String>,
    /// Compare as a display shows it: clipped to 0 to 1, after the sRGB curve.
    #[serde(default)]
    pub display: bool,
    /// What a verdict calls good.
    #[serde(default)]
    pub verdict: Thresholds,
    /// Pictures of some cells.
    #[serde(default)]
    pub sheets: Vec<SheetDefinition>,
}

/// A frame of a study.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SubjectDefinition {
    /// What plots call it; a file name too.
    pub name: String,
    /// The EXR file, complete, or the pattern of a sequence; relative to the study's file.
    pub file: String,
    /// The frames of the pattern that are filled and measured, such as `3-7`.
    pub frames: Option<Frames>,
    /// What kind of picture it is; frames of a class share a verdict.
    #[serde(default = "unclassed")]
    pub class: String,
    /// First column and row (absolute), width and height of what is taken; all if nothing.
    pub crop: Option<[i32; 4]>,
}

/// PSNR that a verdict asks for, in dB.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Thresholds {
    /// At least this is good.
    pub good: f64,
    /// At least this is acceptable.
    pub acceptable: f64,
}

impl Default for Thresholds {
    fn default() -> Self {
        Self { good: 40.0, acceptable: 30.0 }
    }
}

impl Thresholds {
    fn check(self) -> Result<(), String> {
        let Self { good, acceptable } = self;
        // NaN is none either.
        let ordered = good.partial_cmp(&acceptable).is_some_and(std::cmp::Ordering::is_ge);
        let why =
            || format!("verdict: acceptable = {acceptable} is above good = {good}, or one is no number");
        ordered.then_some(()).ok_or_else(why)
    }
}

/// Results and error maps side by side: a column a filter, a row a density and map.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SheetDefinition {
    /// The file's name.
    pub name: String,
    /// The frame.
    pub frame: String,
    /// The pattern.
    pub pattern: String,
    /// The densities.
    pub densities: Vec<f64>,
    /// Filters as in the study's list; all of them if empty.
    #[serde(default)]
    pub filters: Vec<String>,
    /// First column and row (absolute), width and height of what is shown; all if nothing.
    pub window: Option<[i32; 4]>,
    /// Width of a tile in pixels at most, 16 to 1024: nothing is enlarged.
    #[serde(default = "tile")]
    pub tile: usize,
}

/// The most bytes that a definition may have.
const MOST: u64 = 16 << 20;

fn untitled() -> String {
    "Study".into()
}

fn unclassed() -> String {
    "frames".into()
}

fn one_seed() -> Vec<u64> {
    vec![0]
}

fn tile() -> usize {
    128
}

/// What is wrong with a definition.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct DefinitionError(pub String);

/// Refuses what is in a list twice.
fn twice<T: PartialEq + std::fmt::Display>(what: &str, list: &[T]) -> Result<(), String> {
    let second = list.iter().enumerate().find(|(at, value)| list[..*at].contains(value));
    second.map_or(Ok(()), |(_, value)| Err(format!("{what} '{value}' is there twice")))
}

impl Definition {
    /// Reads a definition.
    ///
    /// # Errors
    /// A file that cannot be read, is no TOML or contradicts itself.
    pub fn read(path: &Path) -> Result<Self, DefinitionError> {
        let fail = |error: &dyn std::fmt::Display| DefinitionError(format!("cannot read: {error}"));
        let bytes = lacuna_exr::read_small(path, MOST).map_err(|error| fail(&error))?;
        let text = String::from_utf8(bytes).map_err(|error| fail(&error))?;
        Self::parse(&text)
    }

    /// Reads a definition from text.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(text: &str) -> Result<Self, DefinitionError> {
        let mut found: Self = toml::from_str(text).map_err(|error| DefinitionError(problem(text, &error)))?;
        found.spell().and_then(|()| found.check()).map_err(DefinitionError)?;
        Ok(found)
    }

    /// Spells patterns and filters one way, so that the same is not there twice.
    fn spell(&mut self) -> Result<(), String> {
        let sheets = self.sheets.iter_mut().map(|sheet| &mut sheet.pattern);
        for name in self.patterns.iter_mut().chain(sheets) {
            *name = Selection::parse(name)?.to_string();
        }
        let sheets = self.sheets.iter_mut().flat_map(|sheet| &mut sheet.filters);
        for label in self.filters.iter_mut().chain(sheets) {
            *label = label.split_whitespace().collect::<Vec<_>>().join(" ");
        }
        Ok(())
    }

    fn check(&self) -> Result<(), String> {
        for (what, empty) in [
            ("frames", self.frames.is_empty()),
            ("patterns", self.patterns.is_empty()),
            ("densities", self.densities.is_empty()),
            ("seeds", self.seeds.is_empty()),
            ("filters", self.filters.is_empty()),
        ] {
            if empty {
                return Err(format!("{what} is empty: nothing would be done"));
            }
        }
        let sheets = self.sheets.iter();
        let densities = self.densities.iter().chain(sheets.clone().flat_map(|sheet| &sheet.densities));
        if let Some(density) = densities.into_iter().find(|density| !(**density > 0.0 && **density <= 1.0)) {
            return Err(format!("density {density}: it must be above 0 and at most 1"));
        }
        self.verdict.check()?;
        twice("density", &self.densities)?;
        twice("seed", &self.seeds)?;
        twice("pattern", &self.patterns)?;
        twice("filter", &self.filters)?;
        let names = self.frames.iter().map(|frame| &frame.name);
        for (index, name) in names.clone().chain(sheets.clone().map(|sheet| &sheet.name)).enumerate() {
            let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
            if name.is_empty() || name.starts_with('.') || !name.chars().all(plain) {
                return Err(format!(
                    "name '{name}': letters, digits, '-', '_' and '.' only, as files are called so"
                ));
            }
            if names
                .clone()
                .chain(sheets.clone().map(|sheet| &sheet.name))
                .skip(index + 1)
                .any(|other| other == name)
            {
                return Err(format!("name '{name}' is there twice"));
            }
        }
        let mut wrong = sheets.filter_map(|sheet| Some((sheet, self.check_sheet(sheet).err()?)));
        wrong.next().map_or(Ok(()), |(sheet, why)| Err(format!("sheet '{}': {why}", sheet.name)))
    }

    fn check_sheet(&self, sheet: &SheetDefinition) -> Result<(), String> {
        if !self.frames.iter().any(|frame| frame.name == sheet.frame) {
            return Err(format!("there is no frame '{}'", sheet.frame));
        }
        if sheet.densities.is_empty() {
            return Err("densities is empty: nothing would be shown".into());
        }
        twice("density", &sheet.densities)?;
        // Figures are called so.
        if KINDS.iter().any(|kind| sheet.name.starts_with(&format!("{kind}-"))) {
            return Err("a figure may be called so; choose another name".into());
        }
        if !(16..=1024).contains(&sheet.tile) {
            return Err(format!("tile = {} is not from 16 to 1024", sheet.tile));
        }
        Ok(())
    }
}
