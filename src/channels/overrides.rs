//! What `--channels 'GLOB=RULE'` says.

use std::str::FromStr;

use super::Rule;

/// A rule for the channels whose full name matches a pattern; `*`, `?` and `[...]` as in a shell, case matters; an `=`
/// in a name is written `[=]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Override {
    /// The channels.
    pub glob: glob::Pattern,
    /// What is done with them.
    pub rule: Rule,
    /// Why, of a rule from a file.
    pub reason: Option<String>,
}

/// Why a text is not an override.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OverrideError {
    /// There is no `=` with something before it.
    #[error("'{0}' is not GLOB=RULE: write for instance 'diffuse.*=fill'")]
    Shape(String),
    /// There is more than one `=`.
    #[error("'{0}' has more than one =: give each rule its own --channels; in a channel's name write [=]")]
    Doubled(String),
    /// The rule's name is unknown.
    #[error("'{0}' is not a rule: choose fill, normal, depth, nearest or keep")]
    Rule(String),
    /// The pattern is not one.
    #[error("'{glob}' is not a pattern: {why}")]
    Glob {
        /// The pattern.
        glob: String,
        /// What is wrong with it.
        why: String,
    },
}

impl Override {
    /// Keeps the channel of that very name.
    pub fn keeping(name: &str) -> Option<Self> {
        let glob = glob::Pattern::new(&glob::Pattern::escape(name).replace('=', "[=]")).ok()?;
        Some(Self { glob, rule: Rule::Keep, reason: None })
    }

    /// Whether the override is for the channel of that full name.
    pub fn matches(&self, name: &str) -> bool {
        self.glob.matches(name)
    }
}

impl FromStr for Override {
    type Err = OverrideError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (glob, rule) = text
            .rsplit_once('=')
            .filter(|(glob, _)| !glob.is_empty())
            .ok_or_else(|| OverrideError::Shape(text.into()))?;
        if glob.replace("[=]", "").contains('=') {
            return Err(OverrideError::Doubled(text.into()));
        }
        let rule = [Rule::Fill, Rule::Normal, Rule::Depth, Rule::Nearest, Rule::Keep]
            .into_iter()
            .find(|candidate| candidate.name() == rule)
            .ok_or_else(|| OverrideError::Rule(rule.into()))?;
        let pattern = glob::Pattern::new(glob)
            .map_err(|error| OverrideError::Glob { glob: glob.into(), why: error.msg.into() })?;
        Ok(Self { glob: pattern, rule, reason: None })
    }
}

impl std::fmt::Display for Override {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}={}", self.glob, self.rule.name())
    }
}
