//! The measures by name: what a gate, a table head and a plot call them.

use std::collections::BTreeSet;

use serde::Serialize;

/// A measure of how far a test image is from its reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Measure {
    /// Pixels of the region.
    Pixels,
    /// Mean squared error.
    Mse,
    /// Root of the mean squared error.
    Rmse,
    /// Largest absolute error.
    Max,
    /// Peak signal-to-noise ratio in dB.
    Psnr,
    /// Mean squared error over the squared reference.
    RelativeMse,
    /// PSNR of logarithms in dB.
    LogPsnr,
    /// Mean structural similarity.
    Ssim,
    /// Mean distance in CIELUV.
    Cieluv,
    /// Mean LDR-FLIP.
    Flip,
    /// Mean HDR-FLIP.
    HdrFlip,
    /// Root mean square of the change of the error since the frame before.
    Flicker,
    /// The same of the reference itself.
    Change,
    /// Root mean square of the change of the error along the motion since the frame before.
    FlickerAlong,
    /// The same of the reference itself.
    ChangeAlong,
    /// Values whose bits differ.
    Different,
    /// NaNs in the test image.
    Nan,
    /// Infinities in the test image.
    Infinite,
    /// NaNs in the reference.
    ReferenceNan,
    /// Infinities in the reference.
    ReferenceInfinite,
    /// NaNs in the test image where the reference has none.
    NewNan,
    /// Infinities in the test image where the reference has another value.
    NewInfinite,
}

/// A measure with what is said about it.
struct Row(Measure, &'static str, &'static str, &'static str, bool);

/// Name, unit, explanation, and whether more is better.
const TABLE: &[Row] = &[
    Row(Measure::Pixels, "pixels", "", "pixels of the region", true),
    Row(Measure::Mse, "mse", "", "mean squared error", false),
    Row(Measure::Rmse, "rmse", "", "root of the mean squared error", false),
    Row(Measure::Max, "max", "", "largest absolute error", false),
    Row(Measure::Psnr, "psnr", "dB", "peak signal-to-noise ratio", true),
    Row(Measure::RelativeMse, "relative-mse", "", "mean of squared error over squared reference", false),
    Row(Measure::LogPsnr, "log-psnr", "dB", "PSNR of logarithms, for HDR", true),
    Row(Measure::Ssim, "ssim", "", "mean structural similarity", true),
    Row(Measure::Cieluv, "cieluv", "", "mean distance of colours in CIELUV; 1 is about just visible", false),
    Row(Measure::Flip, "flip", "", "mean LDR-FLIP, the difference seen when alternating", false),
    Row(Measure::HdrFlip, "hdr-flip", "", "mean HDR-FLIP, over the exposures of the reference", false),
    Row(Measure::Flicker, "flicker", "", "RMS change of the error since the frame before", false),
    Row(
        Measure::Change,
        "change",
        "",
        "RMS change of the reference since the frame before, beside flicker",
        false,
    ),
    Row(
        Measure::FlickerAlong,
        "flicker-along",
        "",
        "RMS change of the error along the motion since the frame before",
        false,
    ),
    Row(
        Measure::ChangeAlong,
        "change-along",
        "",
        "RMS change of the reference along the motion since the frame before, beside flicker-along",
        false,
    ),
    Row(Measure::Different, "different", "", "values whose bits differ", false),
    Row(Measure::Nan, "nan", "", "NaNs in the test image", false),
    Row(Measure::Infinite, "inf", "", "infinities in the test image", false),
    Row(Measure::ReferenceNan, "reference-nan", "", "NaNs in the reference", false),
    Row(Measure::ReferenceInfinite, "reference-inf", "", "infinities in the reference", false),
    Row(Measure::NewNan, "new-nan", "", "NaNs in the test image where the reference has none", false),
    Row(
        Measure::NewInfinite,
        "new-inf",
        "",
        "infinities in the test image where the reference has another value",
        false,
    ),
];

impl Measure {
    /// All measures, in the order of tables.
    pub fn all() -> impl Iterator<Item = Self> {
        TABLE.iter().map(|row| row.0)
    }

    fn row(self) -> &'static Row {
        TABLE.iter().find(|row| row.0 == self).unwrap_or(&TABLE[0])
    }

    /// What options, columns and keys call it.
    pub fn name(self) -> &'static str {
        self.row().1
    }

    /// Its unit; empty for none.
    pub fn unit(self) -> &'static str {
        self.row().2
    }

    /// What it is, in words.
    pub fn explanation(self) -> &'static str {
        self.row().3
    }

    /// Whether a larger value is a better image.
    pub fn more_is_better(self) -> bool {
        self.row().4
    }

    /// The measure of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        TABLE.iter().find(|row| row.1 == name).map(|row| row.0)
    }

    /// Those that cost much and are computed only where something asks for them, in the order of tables.
    pub fn on_request() -> impl Iterator<Item = Self> {
        Self::all().filter(|measure| {
            matches!(measure, Self::Cieluv | Self::Flip | Self::HdrFlip) || measure.is_change()
        })
    }

    /// Whether it tells values apart that clipping makes equal.
    pub fn sees_all(self) -> bool {
        matches!(self, Self::RelativeMse | Self::LogPsnr | Self::HdrFlip | Self::Different)
    }

    /// Whether it is of a frame and the one before.
    pub fn is_change(self) -> bool {
        matches!(self, Self::Flicker | Self::Change | Self::FlickerAlong | Self::ChangeAlong)
    }

    /// Whether it is of a frame and the one before along the motion.
    pub fn follows_motion(self) -> bool {
        matches!(self, Self::FlickerAlong | Self::ChangeAlong)
    }

    /// Whether it counts things.
    pub fn is_count(self) -> bool {
        matches!(
            self,
            Self::Pixels
                | Self::Different
                | Self::Nan
                | Self::Infinite
                | Self::ReferenceNan
                | Self::ReferenceInfinite
                | Self::NewNan
                | Self::NewInfinite
        )
    }
}

/// Which of the measures on request are asked for.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Wanted(BTreeSet<Measure>);

impl Wanted {
    /// All of them.
    pub fn all() -> Self {
        Self(Measure::on_request().collect())
    }

    /// Asks for a measure as well; nothing changes for one that is always computed.
    pub fn add(&mut self, measure: Measure) {
        if Measure::on_request().any(|one| one == measure) {
            self.0.insert(measure);
        }
    }

    /// Whether anything is wanted of frames in a row.
    pub fn has_changes(&self) -> bool {
        self.0.iter().any(|measure| measure.is_change())
    }

    /// Whether motion is to be followed.
    pub fn has_motion(&self) -> bool {
        self.0.iter().any(|measure| measure.follows_motion())
    }

    /// Whether a measure on request is wanted.
    pub fn has(&self, measure: Measure) -> bool {
        self.0.contains(&measure)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_measure_has_one_row_and_is_found_by_its_name() {
        for measure in Measure::all() {
            assert_eq!(Measure::from_name(measure.name()), Some(measure));
            assert_eq!(TABLE.iter().filter(|row| row.0 == measure).count(), 1);
            // The name in JSON keys is the one in options.
            assert!(!measure.explanation().is_empty());
        }
        assert_eq!(Measure::from_name("PSNR"), None);
    }
}
