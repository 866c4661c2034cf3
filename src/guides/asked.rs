//! What `--guides` says, read from and written as text.

use std::str::FromStr;

use glob::Pattern;

/// What `--guides` asks for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Asked {
    /// Every channel that is known to guide and is complete.
    #[default]
    Auto,
    /// None.
    None,
    /// Those whose full names match; each must match one.
    Channels(Vec<Pattern>),
}

/// Why a text names no guides.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "'{0}' names no guides: write auto, none, or full names of channels separated by commas, such as N.*,Z,albedo.*"
)]
pub struct AskedError(String);

impl FromStr for Asked {
    type Err = AskedError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "auto" => return Ok(Self::Auto),
            "none" => return Ok(Self::None),
            _ => {}
        }
        let wrong = || AskedError(text.into());
        let names = text.split(',').map(str::trim);
        let pattern =
            |name: &str| if name.is_empty() { Err(wrong()) } else { Pattern::new(name).map_err(|_| wrong()) };
        names.map(pattern).collect::<Result<_, _>>().map(Self::Channels)
    }
}

impl std::fmt::Display for Asked {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::None => f.write_str("none"),
            Self::Channels(names) => {
                let names: Vec<&str> = names.iter().map(Pattern::as_str).collect();
                f.write_str(&names.join(","))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_become_guides_and_come_back() {
        for text in ["auto", "none", "N.*,Z", "a[.]b"] {
            assert_eq!(text.parse::<Asked>().unwrap().to_string(), text);
        }
        assert!(matches!("Z".parse(), Ok(Asked::Channels(names)) if names.len() == 1));
        for text in ["", ",", "Z,", "[", " "] {
            assert!(text.parse::<Asked>().is_err(), "{text}");
        }
    }
}
