//! Flags that say which frames beside a frame it takes samples of.

use clap::Args;

use super::Usage;
use crate::reconstruct::{Job, NoiseSource};
use crate::temporal::{Motion, Temporal, Window};

/// Frames beside a frame.
#[derive(Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Sequences")]
pub struct TemporalArgs {
    /// Take samples of the frames before and after, carried along the motion: auto, none or so many on either side
    ///
    /// Only where held-out samples show that they help, so that a cut or a wrong motion costs a few tenths of a decibel at most. The frames are those beside the frame's
    /// file, by the number in its name, whether this run fills them or not; their measured pixels are used, not their fills. One that is missing, broken or of
    /// another size is left out. 16 on either side at most.
    #[arg(long, value_name = "FRAMES", default_value = "none")]
    pub temporal: Window,

    /// What motion is known from [default: auto]
    #[arg(long, value_name = "SOURCE")]
    pub motion: Option<Motion>,
}

impl TemporalArgs {
    /// What is asked for.
    pub fn temporal(&self) -> Result<Temporal, Usage> {
        if self.temporal == Window::None && self.motion.is_some() {
            return Err(Usage("--motion goes with --temporal auto or a number of frames".into()));
        }
        Ok(Temporal { window: self.temporal, motion: self.motion.unwrap_or_default() })
    }

    /// Only a filter that chooses by held-out samples takes them.
    pub fn check(job: &Job) -> Result<(), Usage> {
        if job.temporal.window == Window::None {
            return Ok(());
        }
        if job.method.name() != "auto" {
            let what = format!(
                "--temporal goes with --filter auto, which chooses by held-out samples, not with {}",
                job.method.name()
            );
            return Err(Usage(what));
        }
        if job.noise != NoiseSource::None {
            return Err(Usage("--temporal keeps measured pixels as they are: leave --noise out".into()));
        }
        Ok(())
    }
}
