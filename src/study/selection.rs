//! How a study chooses the pixels that stay: by a pattern, or in rounds.

use std::fmt;

use lacuna_filters::sampling::Pattern;

/// What stands in a study's list of patterns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Selection {
    /// A pattern, as `mask --pattern` has them.
    Pattern(Pattern),
    /// In rounds, as `sparsify --adaptive` does with its defaults or these.
    Rounds {
        /// Rounds in all.
        rounds: Option<usize>,
        /// Share of the pixels that the first round takes, 0 to 1.
        first: Option<f64>,
    },
    /// None: the frame at half its resolution, enlarged (`half.rs`).
    Half,
}

/// What rounds are called.
const ADAPTIVE: &str = "adaptive";
/// What the frame at half its resolution is called.
pub(super) const HALF: &str = "half";

impl Selection {
    /// A pattern's name, `half`, or `adaptive`, which `rounds=N` and `first=SHARE` may follow.
    ///
    /// # Errors
    /// What it is not.
    pub fn parse(text: &str) -> Result<Self, String> {
        let all = [Pattern::Random, Pattern::Shuffle, Pattern::Poisson, Pattern::BlueNoise, Pattern::Grid];
        if let Some(pattern) = all.into_iter().find(|pattern| pattern.name() == text) {
            return Ok(Self::Pattern(pattern));
        }
        if text == HALF {
            return Ok(Self::Half);
        }
        let mut words = text.split_whitespace();
        if words.next() != Some(ADAPTIVE) {
            let names = all.map(Pattern::name).join(", ");
            return Err(format!(
                "pattern '{text}': there are {names}, {HALF} and {ADAPTIVE} [rounds=N] [first=SHARE]"
            ));
        }
        let (mut rounds, mut first) = (None, None);
        for word in words {
            match word.split_once('=') {
                Some(("rounds", n)) if n.parse().is_ok_and(|n: usize| n > 0) => rounds = n.parse().ok(),
                Some(("first", share)) if share.parse().is_ok_and(|s: f64| s > 0.0 && s <= 1.0) => {
                    first = share.parse().ok();
                }
                _ => {
                    let known = "rounds=N, 1 or more, and first=SHARE, above 0 to 1";
                    return Err(format!("pattern '{text}': '{word}' is none of {known}"));
                }
            }
        }
        Ok(Self::Rounds { rounds, first })
    }
}

impl fmt::Display for Selection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pattern(pattern) => f.write_str(pattern.name()),
            Self::Half => f.write_str(HALF),
            Self::Rounds { rounds, first } => {
                f.write_str(ADAPTIVE)?;
                rounds.map_or(Ok(()), |rounds| write!(f, " rounds={rounds}"))?;
                first.map_or(Ok(()), |first| write!(f, " first={first}"))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_study_may_name_is_said_as_it_was_named() {
        for text in
            ["grid", "blue-noise", "half", "adaptive", "adaptive rounds=4", "adaptive rounds=12 first=0.3"]
        {
            assert_eq!(Selection::parse(text).unwrap().to_string(), text);
        }
        for text in ["", "grids", "adaptive first=0", "adaptive first=2", "adaptive rounds=0", "adaptive 5"] {
            let error = Selection::parse(text).unwrap_err();
            assert!(error.contains("first=SHARE"), "{error}");
        }
    }
}
