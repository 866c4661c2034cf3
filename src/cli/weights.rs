//! The flag that says how much each measured pixel counts.

use clap::Args;
use lacuna_filters::METHODS;
use lacuna_filters::descriptor::Setting;

use super::Usage;
use crate::reconstruct::{Job, Weights};

/// Weights of the samples.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Filter")]
pub struct WeightArgs {
    /// Where measured pixels are smoothed, let each count by its number of samples: count:CHANNEL
    #[arg(long, value_name = "SOURCE", long_help = help())]
    pub weights: Option<Weights>,
}

impl WeightArgs {
    /// Weights must be of use to the filter.
    pub fn check(job: &Job) -> Result<(), Usage> {
        let setting = match job.method.weighs() {
            _ if job.weights.is_none() => return Ok(()),
            Ok(()) => return Ok(()),
            Err(name) => job.method.descriptor().setting(name),
        };
        let why = match setting {
            Some(setting) => {
                let value = job.method.get(setting.name).unwrap_or_default();
                format!("not with --{} {value}", setting.flag)
            }
            None => format!("only where measured pixels are smoothed, by {}", smoothing()),
        };
        Err(Usage(format!("--weights: {why}")))
    }
}

fn help() -> String {
    let flags: Vec<_> = smooths().map(|(_, setting)| format!("--{}", setting.flag)).collect();
    format!(
        "Where measured pixels are smoothed, let each count by its number of samples: count:CHANNEL\n\nA pixel with four times the \
         samples has a quarter of the variance, and weighs four times as much. Only with {} above 0.",
        flags.join(" or ")
    )
}

/// The settings that smooth by weights, with their filters.
fn smooths() -> impl Iterator<Item = (&'static str, &'static Setting)> {
    let weighs = METHODS.iter().filter(|method| method.takes.weights);
    let flags = weighs.flat_map(|method| method.settings.iter().map(|setting| (method.name, setting)));
    flags.filter(|(_, setting)| setting.smooths)
}

/// The flags that smooth by weights.
fn smoothing() -> String {
    let smooths = smooths();
    let flags =
        smooths.map(|(name, setting)| format!("--filter {name} --{} {}", setting.flag, &setting.value[..1]));
    flags.collect::<Vec<_>>().join(" or ")
}
