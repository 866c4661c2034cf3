//! The flag that says how noisy measured pixels are.

use clap::Args;

use super::Usage;
use crate::reconstruct::{Job, NoiseSource};

/// Noise of the samples.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Filter")]
pub struct NoiseArgs {
    /// Smooth noisy pixels, measured ones as well, as far as their noise asks for it: auto, halves:A,B, variance:LAYER, count:CHANNEL
    ///
    /// none: measured pixels keep their bits. auto: half buffers (half1, half2) or a variance of the frame where there are any, else
    /// held-out samples say how noisy colours are; a colour without noise is left alone. halves:A,B: the layers of two independent half buffers whose
    /// mean is the colour. variance:LAYER: the variance of each measured pixel. count:CHANNEL: the number of samples of each. Complete
    /// guides steer it as they steer filling.
    /// Unless given, none; auto where --ss-lambda or --tv-epsilon is auto.
    #[arg(long, value_name = "SOURCE")]
    pub noise: Option<NoiseSource>,
}

impl NoiseArgs {
    /// One way to smooth is enough.
    pub fn check(job: &Job) -> Result<(), Usage> {
        if job.noise != NoiseSource::None && !job.method.keeps_measured() && !job.method.is_open() {
            let why = format!(
                "chooses how much to smooth: leave out what --filter {} smooths by",
                job.method.name()
            );
            return Err(Usage(format!("--noise {why}")));
        }
        if matches!(job.noise, NoiseSource::Count(_)) && job.weights.is_some() {
            return Err(Usage("--noise count: says what --weights says: leave --weights out".into()));
        }
        Ok(())
    }
}
