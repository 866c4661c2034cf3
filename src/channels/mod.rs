//! Which rule each channel gets: colour, scalar, normal, identifier.
//!
//! First match wins: the sampling mask itself is kept; then the caller's overrides; then the channels that the
//! attribute `lacuna/dense` lists, which are complete; then the names and types in `rules`.

mod file;
mod finite;
mod geometry;
mod names;
mod overrides;
mod picture;
#[cfg(test)]
mod renderers;
mod rules;
#[cfg(test)]
mod tests;
mod unheeded;

pub use file::{print_rules, problem, read_rules};
pub use finite::{non_finite, non_finite_among, non_finite_note};
pub use geometry::{is_albedo, is_coordinate, is_position};
use lacuna_exr::{Frame, Part, Samples};
pub use names::{
    Name, channel_label, full_names, list_channels, names_view, part_label, rgb_place, view_of, views,
    visible, without_view, words,
};
pub use overrides::{Override, OverrideError};
pub use picture::{MAIN, Shown, shown};
pub use rules::{
    by_default, is_alpha, is_bits, is_chroma, is_code, is_colour, is_label, is_light, is_main_alpha,
    is_matte, meaning, motion_axis,
};
use serde::Serialize;
pub use unheeded::unheeded;

/// The attribute that lists channels which are complete already, separated by commas or lines.
pub const DENSE: &str = "lacuna/dense";

/// Why a normal is none.
const INCOMPLETE: &str = "not all three siblings are there";

/// What happens to a channel's missing pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rule {
    /// Reconstructed by the filter.
    Fill,
    /// Reconstructed by the filter, then made unit length with its two siblings.
    Normal,
    /// Only values that a measured neighbour had.
    Depth,
    /// Bits copied from the nearest measured pixel.
    Nearest,
    /// Untouched.
    Keep,
}

impl Rule {
    /// The name that `--channels` takes.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fill => "fill",
            Self::Normal => "normal",
            Self::Depth => "depth",
            Self::Nearest => "nearest",
            Self::Keep => "keep",
        }
    }
}

impl std::fmt::Display for Rule {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// What decided a channel's rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecidedBy {
    /// It is the sampling mask.
    SamplingMask,
    /// An override.
    Override,
    /// The attribute [`DENSE`].
    Dense,
    /// Its name and type.
    Name,
    /// Its name, but its siblings are not all there.
    IncompleteNormal,
    /// It is complete, and may guide others.
    Guide,
}

/// A rule and why it was chosen, for people.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Choice {
    /// What is done.
    pub rule: Rule,
    /// What decided it.
    #[serde(skip)]
    pub by: DecidedBy,
    /// Why: the option, attribute or name that decided.
    pub why: String,
}

/// The rule of every channel, per part in file order; `mask_channels` are the sampling masks in use, per part.
pub fn choose(frame: &Frame, mask_channels: &[Vec<usize>], overrides: &[Override]) -> Vec<Vec<Choice>> {
    let one = |(index, part): (usize, &Part)| {
        let dense = dense(part);
        let mut choices: Vec<_> = (0..part.channels.len())
            .map(|channel| {
                if is_mask_channel(mask_channels, index, channel) {
                    return Choice::new(Rule::Keep, DecidedBy::SamplingMask, "the sampling mask");
                }
                choose_one((frame, part, channel), overrides, &dense)
            })
            .collect();
        demote_incomplete_normals(part, &mut choices);
        choices
    };
    frame.parts.iter().enumerate().map(one).collect()
}

impl Choice {
    fn new(rule: Rule, by: DecidedBy, why: impl Into<String>) -> Self {
        Self { rule, by, why: why.into() }
    }

    /// Keeps a channel that is complete, and may guide others.
    pub fn complete(&mut self, guides: bool) {
        let why = if guides { "complete: a guide" } else { "complete" };
        *self = Self::new(Rule::Keep, DecidedBy::Guide, format!("{}, {why}", self.why));
    }
}

/// Whether a channel is a sampling mask in use.
fn is_mask_channel(mask_channels: &[Vec<usize>], part: usize, channel: usize) -> bool {
    mask_channels.get(part).is_some_and(|channels| channels.contains(&channel))
}

/// The three channels of the normal that a channel with [`Rule::Normal`] belongs to, in the order of the axes.
pub fn normal_triple(part: &Part, choices: &[Choice], channel: usize) -> Option<[usize; 3]> {
    let normal = |index: &usize| choices.get(*index).is_some_and(|choice| choice.rule == Rule::Normal);
    if let Some(triple) = rules::normal_siblings(part, channel).filter(|triple| triple.iter().all(normal)) {
        return Some(triple);
    }
    let full = part.channels.get(channel)?.display_name().into_owned();
    rules::siblings(part, Name::new(&full).layer).into_iter().find_map(|triple| {
        let [Some(x), Some(y), Some(z)] = triple else { return None };
        let triple = [x, y, z];
        (triple.contains(&channel) && triple.iter().all(normal)).then_some(triple)
    })
}

fn choose_one(
    (frame, part, channel): (&Frame, &Part, usize),
    overrides: &[Override],
    dense: &[String],
) -> Choice {
    let name = part.channels[channel].display_name();
    let uint = matches!(part.channels[channel].samples, Samples::Uint(_));
    if let Some(found) = overrides.iter().find(|candidate| candidate.matches(&name)) {
        return match found.rule {
            Rule::Fill | Rule::Normal | Rule::Depth if uint => Choice::new(
                Rule::Nearest,
                DecidedBy::Override,
                format!("whole numbers, which {found} cannot be for"),
            ),
            rule => {
                let why = match &found.reason {
                    Some(reason) => format!("{reason} (--rules)"),
                    None => format!("--channels {found}"),
                };
                Choice::new(rule, DecidedBy::Override, why)
            }
        };
    }
    if dense.iter().any(|listed| listed == &*name) {
        return Choice::new(Rule::Keep, DecidedBy::Dense, format!("listed in {DENSE}"));
    }
    let (mut rule, mut why) = by_default(part, channel);
    if !matches!(rule, Rule::Keep | Rule::Nearest) && rules::is_cryptomatte_in(frame, part, channel) {
        (rule, why) = (Rule::Nearest, "Cryptomatte, by the attributes of another part");
    }
    Choice::new(rule, DecidedBy::Name, why)
}

/// The channels that the attribute [`DENSE`] of a part lists: by lines, those that are no channel by commas too.
pub fn dense(part: &Part) -> Vec<String> {
    let text = part.attributes.text(DENSE).unwrap_or_default();
    let is = |name: &str| part.channels.iter().any(|channel| channel.display_name() == name);
    let names = text.lines().flat_map(|line| {
        let whole = is(line.trim());
        line.split(move |c: char| c == ',' && !whole)
    });
    names.map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).collect()
}

/// Adds channels to those that the attribute [`DENSE`] of a part lists: with commas between, as other tools read it, on lines of
/// their own if a name has one.
pub fn list_dense<'a>(part: &mut Part, names: impl IntoIterator<Item = &'a str>) {
    let mut all = dense(part);
    all.extend(names.into_iter().map(str::to_owned));
    let between = if all.iter().any(|name| name.contains(',')) { "\n" } else { "," };
    part.attributes.set_text(DENSE, &all.join(between));
}

/// Fills normals by themselves whose siblings are none, or are kept.
pub fn demote_incomplete_normals(part: &Part, choices: &mut [Choice]) {
    let incomplete: Vec<_> = (0..choices.len())
        .filter(|&i| choices[i].rule == Rule::Normal && normal_triple(part, choices, i).is_none())
        .collect();
    for index in incomplete {
        let why = format!("{}, but {INCOMPLETE}", choices[index].why);
        choices[index] = Choice::new(Rule::Fill, DecidedBy::IncompleteNormal, why);
    }
}
