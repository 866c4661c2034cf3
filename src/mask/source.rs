//! What `--mask` says, read from and written as text.

use std::path::Path;
use std::str::FromStr;

/// What `--mask` asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// Find the mask in the frame: the attribute `lacuna/mask`, a channel `mask`, or `LAYER.mask`.
    Auto,
    /// The channel of that name.
    Channel(String),
    /// A file (EXR or PNG), or a pattern that goes frame by frame; `channel` if not the obvious one.
    File {
        /// Path or pattern.
        pattern: String,
        /// The channel to take.
        channel: Option<String>,
    },
    /// Measured where alpha is above 0.
    Alpha,
    /// Measured where every colour channel is finite.
    Finite,
    /// Measured where a sample-count channel is at least this.
    Count {
        /// The channel that counts samples.
        channel: String,
        /// The least count of a measured pixel.
        at_least: f64,
    },
}

/// Why a text is not a mask source.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SourceError {
    /// Nothing, or nothing behind the colon.
    #[error(
        "'{0}' names no mask: write auto, channel:NAME, file:PATTERN[:CHANNEL], alpha, nan or count:CHANNEL:N"
    )]
    Nothing(String),
    /// `count:` without a usable number.
    #[error("'{0}' is not count:CHANNEL:N with a number N above 0")]
    Count(String),
}

impl FromStr for Source {
    type Err = SourceError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let nothing = || SourceError::Nothing(text.into());
        match text {
            "" => return Err(nothing()),
            "auto" => return Ok(Self::Auto),
            "alpha" => return Ok(Self::Alpha),
            "nan" => return Ok(Self::Finite),
            _ => {}
        }
        if let Some(name) = text.strip_prefix("channel:") {
            return if name.is_empty() { Err(nothing()) } else { Ok(Self::Channel(name.into())) };
        }
        if let Some(rest) = text.strip_prefix("count:") {
            let wrong = || SourceError::Count(text.into());
            let (channel, number) = rest.rsplit_once(':').ok_or_else(wrong)?;
            let at_least: f64 = number.parse().map_err(|_| wrong())?;
            let usable = at_least.is_finite() && at_least > 0.0 && !channel.is_empty();
            return if usable { Ok(Self::Count { channel: channel.into(), at_least }) } else { Err(wrong()) };
        }
        let path = text.strip_prefix("file:").unwrap_or(text);
        if path.is_empty() {
            return Err(nothing());
        }
        Ok(file(path))
    }
}

impl Source {
    /// The file or pattern, if it is one.
    pub fn path(&self) -> Option<&Path> {
        match self {
            Self::File { pattern, .. } => Some(pattern.as_ref()),
            _ => None,
        }
    }
}

impl std::fmt::Display for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Channel(name) => write!(f, "channel:{name}"),
            Self::File { pattern, channel: Some(channel) } => write!(f, "file:{pattern}:{channel}"),
            Self::File { pattern, channel: None } => write!(f, "file:{pattern}"),
            Self::Alpha => f.write_str("alpha"),
            Self::Finite => f.write_str("nan"),
            Self::Count { channel, at_least } => write!(f, "count:{channel}:{at_least}"),
        }
    }
}

/// A path may hold colons itself: what follows the last one is a channel only if the rest ends like an image's name.
fn file(path: &str) -> Source {
    let split = path.rsplit_once(':').filter(|(rest, channel)| {
        let ending = rest.len().checked_sub(4).and_then(|at| rest.get(at..)).unwrap_or_default();
        let image = [".exr", ".png"].iter().any(|image| ending.eq_ignore_ascii_case(image));
        !channel.is_empty() && image
    });
    match split {
        Some((pattern, channel)) => Source::File { pattern: pattern.into(), channel: Some(channel.into()) },
        None => Source::File { pattern: path.into(), channel: None },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(pattern: &str, channel: Option<&str>) -> Source {
        Source::File { pattern: pattern.into(), channel: channel.map(Into::into) }
    }

    #[test]
    fn texts_become_sources_and_come_back() {
        let count = Source::Count { channel: "a:b".into(), at_least: 2.5 };
        for (text, source) in [
            ("auto", Source::Auto),
            ("alpha", Source::Alpha),
            ("nan", Source::Finite),
            ("channel:my.mask", Source::Channel("my.mask".into())),
            ("count:a:b:2.5", count),
            ("file:m.####.exr", file("m.####.exr", None)),
            ("file:shot:1.exr", file("shot:1.exr", None)),
            ("file:shot:1.EXR:a.b", file("shot:1.EXR", Some("a.b"))),
            ("file:m.png:R", file("m.png", Some("R"))),
            ("file:odd:name", file("odd:name", None)),
        ] {
            assert_eq!(text.parse(), Ok(source.clone()), "{text}");
            assert_eq!(source.to_string(), text);
        }
        assert_eq!("dir/m.exr".parse(), Ok(file("dir/m.exr", None)));
        assert_eq!("mask".parse(), Ok(file("mask", None)));
    }

    #[test]
    fn nonsense_is_refused() {
        for text in ["", "channel:", "file:", "count:", "count:n", "count:n:", "count:n:x", "count::3"] {
            assert!(text.parse::<Source>().is_err(), "{text}");
        }
        for text in ["count:n:0", "count:n:-1", "count:n:nan", "count:n:inf"] {
            assert_eq!(text.parse::<Source>(), Err(SourceError::Count(text.into())));
        }
    }
}
