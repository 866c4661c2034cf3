//! Flags of what stands around a filter: the value domain and the limiter.

use clap::{Args, ValueEnum};

use crate::reconstruct::Domain;

/// The value domain and the limiter.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Filter")]
pub struct AroundArgs {
    /// Where colours are reconstructed: as they are, through a reversible logarithm (for highlights), or as their range
    /// asks for
    #[arg(long, value_name = "DOMAIN", default_value = "auto")]
    pub domain: DomainName,

    /// on or off: hold overshoot beside highlights and edges back to what the samples around allow
    #[arg(long, value_name = "SWITCH", default_value = "on", hide_possible_values = true)]
    pub limit: Switch,
}

/// Where colours are reconstructed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DomainName {
    /// Linear, or logarithmic where the measured range asks for it
    Auto,
    /// As they are
    Linear,
    /// Through a reversible logarithm, defined for zero and negative values
    Log,
}

/// On or off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Switch {
    /// Yes
    On,
    /// No
    Off,
}

impl AroundArgs {
    /// Whether overshoot is limited.
    pub fn limits(&self) -> bool {
        self.limit == Switch::On
    }

    /// The domain.
    pub fn domain(&self) -> Domain {
        match self.domain {
            DomainName::Auto => Domain::Auto,
            DomainName::Linear => Domain::Linear,
            DomainName::Log => Domain::Log,
        }
    }
}
