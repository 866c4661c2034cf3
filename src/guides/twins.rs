//! Which guide may hold the very values of a channel that is to be filled: its twin, told by the name. Whether it does, its values tell.

use lacuna_exr::{Frame, Samples};

use super::{Guide, Kind};
use crate::channels::{Choice, DecidedBy, Rule, view_of};

/// A channel and a complete one of its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Twin {
    /// The channel's place in the part that is filled.
    pub channel: usize,
    /// The full name of the complete one.
    pub name: String,
    /// Whether that stands in the second frame.
    pub second: bool,
    /// Its part.
    pub part: usize,
    /// Its place there.
    pub at: usize,
}

impl Twin {
    /// The complete values.
    pub fn samples<'a>(&self, frame: &'a Frame, second: Option<&'a Frame>) -> Option<&'a Samples> {
        let frame = if self.second { second? } else { frame };
        Some(&frame.parts.get(self.part)?.channels.get(self.at)?.samples)
    }
}

/// The twins of a part's channels among its guides: those of the same name, or with a layer before it (`dense.A` of `A`) or one less. Of several the
/// shorter names go first. A rule that was asked for goes before.
pub fn twins(
    frame: &Frame,
    index: usize,
    choices: &[Choice],
    guides: &[Guide],
    second: Option<&Frame>,
) -> Vec<Twin> {
    let part = &frame.parts[index];
    let is_float = |samples: &Samples| !matches!(samples, Samples::Uint(_));
    let mut found = Vec::new();
    for (channel, (own, choice)) in part.channels.iter().zip(choices).enumerate() {
        let fills = matches!(choice.rule, Rule::Fill | Rule::Normal | Rule::Depth);
        if !fills || choice.by == DecidedBy::Override || !is_float(&own.samples) {
            continue;
        }
        let name = own.display_name();
        let values = guides.iter().filter(|guide| guide.kind == Kind::Values);
        let all = values.flat_map(|guide| guide.channels.iter().map(move |&at| (guide, at)));
        let twin = |(guide, at): (&Guide, usize)| {
            let source = &if guide.second { second? } else { frame }.parts[guide.part];
            let other = &source.channels[at];
            let full = other.display_name();
            let same_view = guide.serves(view_of(part, &name).as_deref());
            let fits = same_view && is_float(&other.samples) && are_twins(&name, &full);
            let (name, second, part) = (full.into_owned(), guide.second, guide.part);
            fits.then_some(Twin { channel, name, second, part, at })
        };
        let mut own: Vec<Twin> = all.filter_map(twin).collect();
        own.sort_by_key(|twin| twin.name.len());
        found.extend(own);
    }
    found
}

/// Whether two names are the same but for layers before one of them.
fn are_twins(one: &str, other: &str) -> bool {
    let (long, short) = if one.len() < other.len() { (other, one) } else { (one, other) };
    let (long, short) = (long.to_ascii_lowercase(), short.to_ascii_lowercase());
    long.strip_suffix(&short).is_some_and(|before| before.is_empty() || before.ends_with('.'))
}

#[cfg(test)]
mod tests {
    use super::are_twins;

    #[test]
    fn twins_have_one_name_but_for_layers() {
        for (one, other, expected) in [
            ("A", "dense.A", true),
            ("N.X", "dense.N.x", true),
            ("beauty.A", "A", true),
            ("A", "A", true),
            ("A", "alpha", false),
            ("A", "dense.BA", false),
            ("beauty.A", "dense.A", false),
            ("", "", true),
        ] {
            assert_eq!(are_twins(one, other), expected, "{one} {other}");
            assert_eq!(are_twins(other, one), expected, "{other} {one}");
        }
    }
}
