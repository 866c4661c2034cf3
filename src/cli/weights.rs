//! The flag that says how much each measured pixel counts.

use clap::Args;
use lacuna_filters::Method;
use lacuna_filters::sensing::Solver;

use super::Usage;
use crate::reconstruct::{Job, Weights};

/// Weights of the samples.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Filter")]
pub struct WeightArgs {
    /// Where measured pixels are smoothed, let each count by its number of samples: count:CHANNEL
    ///
    /// A pixel with four times the samples has a quarter of the variance, and weighs four times as much. Only with
    /// --ss-lambda or --tv-epsilon above 0.
    #[arg(long, value_name = "SOURCE")]
    pub weights: Option<Weights>,
}

impl WeightArgs {
    /// Weights must be of use to the filter.
    pub fn check(job: &Job) -> Result<(), Usage> {
        let why = match &job.method {
            _ if job.weights.is_none() => return Ok(()),
            Method::Tv(settings) if settings.solver == Solver::Nesta => "not with --tv-solver nesta",
            Method::Ss(_) | Method::Tv(_) if !job.method.keeps_measured() => return Ok(()),
            _ => {
                "only where measured pixels are smoothed, by --filter ss --ss-lambda L or --filter tv --tv-epsilon E"
            }
        };
        Err(Usage(format!("--weights: {why}")))
    }
}
