//! Flags that say where frames go and how their files are made.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::{Args, ValueEnum};
use lacuna_exr::{Compression, SampleType};

use super::Usage;
use super::words::Words;
use crate::reconstruct::Kind;
use crate::run::Existing;

/// What pictures to look at are called.
const PICTURES: &[&str] = &["png", "jpg", "jpeg", "tif", "tiff"];

/// What `--compression` takes.
pub const PACKINGS: &[&str] = &["none", "rle", "zips", "zip", "piz"];

/// Where outputs go.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Output")]
pub struct OutputArgs {
    /// A file, a pattern or a folder; a folder ends in / unless it exists, and numbers and names follow the input
    // A list, so that a second one is noticed and not taken for the first.
    #[arg(short, long, value_name = "OUTPUT", required = true)]
    pub output: Vec<PathBuf>,

    /// Make the output's folder where it is missing
    #[arg(long)]
    pub create_dir: bool,

    /// Pass over frames whose output exists
    #[arg(long)]
    pub no_clobber: bool,

    /// Replace outputs that are read-only, too
    #[arg(long, conflicts_with = "no_clobber")]
    pub force: bool,
}

impl OutputArgs {
    /// What happens to outputs that exist; `update` passes over those that are up to date.
    pub fn existing(&self, update: bool) -> Existing {
        match (update, self.no_clobber) {
            (true, _) => Existing::Update,
            (_, true) => Existing::Keep,
            _ if self.force => Existing::Force,
            _ => Existing::Replace,
        }
    }

    /// The only output. `has_page`: whether the command has `--report`.
    ///
    /// # Errors
    /// For several outputs, and for a file that is not called .exr.
    pub fn checked(&self, has_page: bool) -> Result<PathBuf, Usage> {
        let [output] = self.output.as_slice() else {
            let all: Vec<_> = self.output.iter().map(|path| path.display().to_string()).collect();
            return Err(Usage(format!("-o is given more than once ({}): one is needed", all.join(", "))));
        };
        let text = output.to_string_lossy();
        if ends_in(output, "exr")
            || text.is_empty()
            || text.ends_with(std::path::is_separator)
            || output.is_dir()
        {
            return Ok(output.clone());
        }
        let is_picture = PICTURES.iter().any(|ending| ends_in(output, ending));
        let way = match (is_picture, has_page) {
            (true, true) => "--report page.html shows it in a browser",
            _ => "a folder that is not there yet ends in /",
        };
        Err(Usage(format!("-o {text}: an output file ends in .exr; {way}")))
    }
}

/// Whether a file is called as what is written into it.
fn ends_in(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|own| own.eq_ignore_ascii_case(ending))
}

/// The file that a flag names, if it is called as what is written into it.
///
/// # Errors
/// For any other name.
pub fn called(flag: &str, path: &Path, ending: &str) -> Result<PathBuf, Usage> {
    let wrong = || Usage(format!("{flag} {}: the file that is written ends in .{ending}", path.display()));
    ends_in(path, ending).then(|| path.to_path_buf()).ok_or_else(wrong)
}

/// How files are made.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Output")]
pub struct FormatArgs {
    /// Lossless compression: none, rle, zips, zip or piz; LEVEL is for zips and zip, 1 (fast) to 12 (small)
    /// [default: the input's where it is lossless, else zip; no level: twice as fast as 4, files about 3 % larger]
    #[arg(long, value_name = "NAME[:LEVEL]", hide_possible_values = true)]
    #[arg(value_parser = Words::<Packing>::new(PACKINGS))]
    pub compression: Option<Packing>,
}

/// What only outputs with reconstructed channels have.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Output")]
pub struct MoreOutput {
    /// Type of the reconstructed channels: half rounds their measured pixels too and clamps what would overflow, both
    /// are counted; depths, identifiers and kept channels never become half [default: the input's]
    #[arg(short = 'd', long, value_name = "TYPE")]
    pub data_type: Option<Depth>,

    /// Leave the mask's channels out (counts of samples stay)
    #[arg(long)]
    pub drop_mask: bool,

    /// Pass over frames whose output was made by this version of the very input and other files that are there, with the same
    /// settings, or is the copy of a complete frame; -n says why others are not
    #[arg(short, long, conflicts_with_all = ["no_clobber", "force"])]
    pub update: bool,
}

impl MoreOutput {
    /// The type of reconstructed channels.
    pub fn kind(&self) -> Option<Kind> {
        self.data_type.map(|depth| match depth {
            Depth::Half => Kind::Half,
            Depth::Float => Kind::Float,
        })
    }
}

/// A lossless compression with its level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packing {
    /// The compression.
    pub compression: Compression,
    /// 1 to 12, for `zips` and `zip`.
    pub level: Option<u8>,
}

impl FromStr for Packing {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, level) = match text.split_once(':') {
            Some((name, level)) => (name, Some(level)),
            None => (text, None),
        };
        let Some(compression) = Compression::from_name(&name.to_ascii_lowercase()) else {
            return Err("not a compression; choose none, rle, zips, zip or piz".into());
        };
        if !compression.is_lossless() {
            return Err(format!(
                "{name} would change measured pixels; write zip and convert afterwards: \
                 oiiotool OUTPUT --compression {name} -o FILE"
            ));
        }
        let level = level.map(|level| match level.parse() {
            Ok(level @ 1..=12) if matches!(compression, Compression::Zip | Compression::Zips) => Ok(level),
            Ok(1..=12) => Err(format!("{name} has no levels")),
            _ => Err("the level is not a number from 1 to 12".into()),
        });
        Ok(Self { compression, level: level.transpose()? })
    }
}

/// The type of written colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Depth {
    /// 16-bit floats.
    Half,
    /// 32-bit floats.
    Float,
}

impl From<Depth> for SampleType {
    fn from(depth: Depth) -> Self {
        match depth {
            Depth::Half => Self::Half,
            Depth::Float => Self::Float,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn compressions_are_lossless_ones() {
        let zip = |level| Ok(Packing { compression: Compression::Zip, level });
        assert_eq!("zip".parse(), zip(None));
        assert_eq!("ZIP:9".parse(), zip(Some(9)));
        for (text, reason) in [
            ("dwaa", "convert afterwards"),
            ("dwab:45", "convert afterwards"),
            ("pxr24", "change measured pixels"),
            ("piz:3", "no levels"),
            ("zip:0", "1 to 12"),
            ("zip:", "1 to 12"),
            ("zip:x", "1 to 12"),
            ("htj2k", "not a compression"),
            ("", "not a compression"),
        ] {
            let error = text.parse::<Packing>().unwrap_err();
            assert!(error.contains(reason), "{text}: {error}");
        }
    }
}
