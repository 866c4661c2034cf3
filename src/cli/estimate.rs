//! Flags about the error that a fill is estimated to have.

use clap::Args;
use lacuna_filters::fill::Estimate;

use super::numbers::peak;
use crate::channels;
use crate::reconstruct::{Gate, NoiseSource};

/// The estimated error.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Estimated error")]
pub struct EstimateArgs {
    /// Do not estimate how wrong the missing pixels are, which takes fills of a part of the samples
    #[arg(long, conflicts_with_all = ["error_channel", "min_psnr", "max_rmse"])]
    pub no_estimate: bool,

    /// Write the estimated error of every pixel as a channel of each layer that is filled: root mean square over its colours, 0 at
    /// measured pixels
    #[arg(long, value_name = "NAME", num_args = 0..=1, require_equals = true, default_missing_value = "error", value_parser = name)]
    pub error_channel: Option<String>,

    /// The value of colours that counts as white, above 0, as in compare (that of alphas is 1): errors are estimated of light clipped to
    /// 0 and this, and decibels are relative to it
    #[arg(long, value_name = "VALUE", default_value = "1", value_parser = peak, conflicts_with = "no_estimate")]
    pub peak: f32,

    /// A frame whose missing pixels are estimated below DB decibels (PSNR) is written, but counts as failed
    #[arg(long, value_name = "DB", value_parser = decibels)]
    pub min_psnr: Option<f64>,

    /// The same above a root mean square error of E
    #[arg(long, value_name = "E", value_parser = bound)]
    pub max_rmse: Option<f64>,
}

fn name(text: &str) -> Result<String, String> {
    let plain = !text.is_empty() && text.chars().all(|c| c.is_alphanumeric() || "_-.".contains(c));
    if !plain {
        return Err("must be letters, digits, '_', '-' or '.'".into());
    }
    match channels::meaning(text).or(NoiseSource::is_variance(text).then_some("a variance")) {
        Some(what) => Err(format!("would be read as {what}: choose another name, such as error")),
        None => Ok(text.into()),
    }
}

fn decibels(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| "must be a finite number".into())
}

fn bound(text: &str) -> Result<f64, String> {
    let usable = |value: &f64| value.is_finite() && *value >= 0.0;
    text.parse().ok().filter(usable).ok_or_else(|| "must be a number of 0 or more".into())
}

impl EstimateArgs {
    /// What is to be said of the error.
    pub fn estimate(&self) -> Estimate {
        match (self.no_estimate, &self.error_channel) {
            (true, _) => Estimate::No,
            (false, None) => Estimate::Figure,
            (false, Some(_)) => Estimate::Pixels,
        }
    }

    /// What the fill must reach.
    pub fn gate(&self) -> Gate {
        Gate { min_psnr: self.min_psnr, max_rmse: self.max_rmse }
    }
}

#[cfg(test)]
mod tests {
    use crate::cli::{Ending, Job, parse};

    #[test]
    fn a_channel_of_errors_is_named_so_that_it_is_read_as_one() {
        let of = |name: &str| {
            parse(format!("lacuna fill a.exr -o b.exr --error-channel={name}").split(' ').map(Into::into))
        };
        for name in ["error", "sigma", "rms", "my.error", "stddev"] {
            assert!(matches!(of(name), Ok(Job::Fill(_))), "{name}");
        }
        for (name, what) in [
            ("mask", "a mask"),
            ("MASK", "a mask"),
            ("A", "alpha"),
            ("err.Y", "colour"),
            ("Z", "a depth"),
            ("samples", "a count"),
            ("id", "an identifier"),
            ("variance", "a variance"),
        ] {
            let refused =
                matches!(of(name), Err(Ending::Usage(text)) if text.contains(&format!("read as {what}")));
            assert!(refused, "{name}");
        }
    }

    #[test]
    fn the_peak_is_named_where_it_is_another_than_1() {
        let fill = |line: &str| {
            let line = format!("lacuna fill a.exr -o b.exr {line}");
            parse(line.split_whitespace().map(Into::into))
        };
        let white = |line: &str| match fill(line) {
            Ok(Job::Fill(job)) => (job.what.peak, job.what.settings().contains(" peak=")),
            other => panic!("{line}: {other:?}"),
        };
        assert_eq!(
            (white(""), white("--peak 1"), white("--peak 4")),
            ((1.0, false), (1.0, false), (4.0, true))
        );
        for wrong in ["--peak 0", "--peak nan", "--peak 2 --no-estimate"] {
            assert!(matches!(fill(wrong), Err(Ending::Usage(text)) if text.contains("--peak")), "{wrong}");
        }
    }
}
