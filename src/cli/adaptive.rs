//! The flags of pixels that are chosen in rounds.

use clap::Args;
use lacuna_filters::sampling::adaptive::Settings;

use super::Usage;
use super::numbers::{density, one_or_more, zero_or_more};

/// In which rounds pixels are chosen.
#[derive(Args, Clone, Debug)]
pub struct AdaptiveArgs {
    /// Choose the pixels in rounds: after the first, where the estimated error of the fill so far is largest; frames in a row choose different ones
    #[arg(long, requires = "density", conflicts_with = "mask")]
    adaptive: bool,

    /// Rounds in all, of which the first is spread evenly [default: 8, fewer where fewer pixels are measured]
    #[arg(long, value_name = "N", requires = "adaptive", value_parser = one_or_more)]
    rounds: Option<u32>,

    /// Density of the first round [default: 0.2 of --density]
    #[arg(long, value_name = "D", requires = "adaptive", value_parser = density, allow_hyphen_values = true)]
    first: Option<f64>,

    /// Stop when the estimated error (RMSE over the measured range, logarithmic above 1) is at most this; --density is then the most
    #[arg(long, value_name = "E", requires = "adaptive", value_parser = zero_or_more, allow_hyphen_values = true)]
    target_error: Option<f64>,
}

impl AdaptiveArgs {
    /// The settings, where rounds are asked for.
    pub fn settings(&self, density: f64, seed: u64) -> Result<Option<Settings>, Usage> {
        if let Some(first) = self.first.filter(|first| *first > density) {
            return Err(Usage(format!(
                "--first {first} is more than --density {density}, which counts all rounds"
            )));
        }
        if let (Some(1), Some(first)) = (self.rounds, self.first) {
            return Err(Usage(format!("--first {first}: the only round of --rounds 1 takes all pixels")));
        }
        let rounds = self.rounds.map(|rounds| rounds as usize);
        let (first, target) = (self.first, self.target_error);
        Ok(self.adaptive.then_some(Settings { density, rounds, first, target, seed, frame: None }))
    }
}
