//! Flags that say what steers the colour.

use clap::Args;
use lacuna_filters::METHODS;

use super::Usage;
use crate::guides::Asked;
use crate::reconstruct::Job;

/// Guides.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Guides")]
pub struct GuideArgs {
    /// Complete channels that steer colour between its samples: auto, none, or full names separated by commas, globs
    /// allowed (N.*,Z)
    ///
    /// auto: what the attribute lacuna/dense lists, and normals, positions, albedo, depth, alpha and identifiers if every
    /// pixel holds them. Guides that do not predict the colour count for nothing. Only with filters that take guides: auto and ss.
    #[arg(long, value_name = "GUIDES", default_value = "auto")]
    pub guides: Asked,

    /// Take the guides from this file, or pattern that goes frame by frame, instead of the frame itself
    #[arg(long, value_name = "PATTERN")]
    pub guides_from: Option<String>,
}

impl GuideArgs {
    /// Guides that were asked for must be of use to the filter.
    pub fn check(&self, job: &Job) -> Result<(), Usage> {
        let takes = job.enlarge.as_ref().is_some_and(|enlarge| enlarge.take_guides);
        if self.guides == Asked::None && self.guides_from.is_some() && !takes {
            return Err(Usage("--guides none leaves nothing to do for the file of --guides-from".into()));
        }
        let named = matches!(self.guides, Asked::Channels(_)) || self.guides_from.is_some();
        if named && self.guides != Asked::None && *job.wanted() == Asked::None {
            let (filters, kept) = takers();
            let why =
                format!("only {filters} takes guides, and only where measured pixels are kept ({kept})");
            return Err(Usage(format!("--guides, --guides-from: {why}")));
        }
        Ok(())
    }
}

/// The filters that take guides, and the flags with which they keep measured pixels.
fn takers() -> (String, String) {
    let takers = METHODS.iter().filter(|method| method.takes.guides);
    let names: Vec<_> = takers.clone().map(|method| format!("--filter {}", method.name)).collect();
    let smooths = takers.flat_map(|method| method.settings).filter(|setting| setting.smooths);
    let kept: Vec<_> = smooths.map(|setting| format!("--{} 0", setting.flag)).collect();
    (names.join(" or "), kept.join(", "))
}
