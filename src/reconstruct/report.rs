//! What was done to a frame, for the log and for `--json`.

use lacuna_filters::Outcome;
use lacuna_filters::limiter::Moved;
use serde::Serialize;

use super::estimate::Estimated;
use super::{Energy, Stamp};
use crate::channels::{self, Name, Rule, visible};
use crate::guides::Copied;

/// What was done to one frame. Times are the caller's to add.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// The filter's name.
    pub filter: String,
    /// The line of settings.
    pub settings: String,
    /// Where the mask was found.
    pub mask: String,
    /// Measured pixels over all pixels, 0 to 1; nothing where every part is kept.
    pub density: Option<f64>,
    /// Whether nothing was missing, so that the pixels are those of the input.
    pub copied: bool,
    /// Measured values, over all channels, that no missing one was made from because they are NaN or infinite.
    pub non_finite: usize,
    /// Values, over all channels, that the limiter or a bound (no negative light, alpha within 0 and 1) moved.
    pub limited: usize,
    /// The farthest that one of them was moved.
    pub largest_move: f32,
    /// Values that would have overflowed a half and became the largest one.
    pub clamped_halves: usize,
    /// The worst outcome of all groups; nothing where no filter ran.
    pub outcome: Option<Outcome>,
    /// The parts, in file order.
    pub parts: Vec<PartReport>,
    /// What a reader of the log should know, one line each.
    pub notes: Vec<String>,
    /// What was done as asked, for the log alone.
    #[serde(skip)]
    pub remarks: Vec<String>,
}

/// What was done to one part.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PartReport {
    /// Its name, if it has one.
    pub name: Option<String>,
    /// The channels, in file order.
    pub channels: Vec<ChannelReport>,
    /// The groups that the filter ran on.
    pub groups: Vec<GroupReport>,
    /// Channels whose missing pixels were copied from a complete one that holds their values.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub copied: Vec<Copied>,
    /// The frames beside it whose samples it was filled with, and what their motion is known from.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub neighbours: Vec<(i64, String)>,
}

/// What was done to one channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelReport {
    /// Its full name.
    pub name: String,
    /// The rule.
    pub rule: Rule,
    /// Why that rule.
    pub why: String,
    /// Values that were filled in.
    pub filled: usize,
    /// Measured values that no missing one was made from because they are NaN or infinite.
    pub non_finite: usize,
    /// Values that the limiter or a bound moved.
    pub limited: usize,
    /// The farthest that one of them was moved.
    pub largest_move: f32,
    /// Values that would have overflowed a half.
    pub clamped_halves: usize,
}

impl ChannelReport {
    /// Counts values that were moved.
    pub(super) fn limit(&mut self, moved: Moved) {
        self.limited += moved.values;
        self.largest_move = self.largest_move.max(moved.most);
    }
}

/// How the filter ended on a group of channels.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GroupReport {
    /// The channels' full names.
    pub channels: Vec<String>,
    /// The domain that it was reconstructed in: `linear` or `log`.
    pub domain: &'static str,
    /// The guides that steered it; none where none were there, or none predicted.
    pub guides: Vec<String>,
    /// The part of the squared error that they took away, estimated by leaving measured pixels out.
    pub guides_gain: Option<f64>,
    /// The part of the squared error that samples of frames beside it took away, by held-out samples.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub neighbours_gain: Option<f64>,
    /// Where the filter chose: the methods that it chose, and the mean weight of each at missing pixels.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub chosen: Vec<(String, f64)>,
    /// Settings that the samples chose, each as `name=value by what`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub settled: Vec<String>,
    /// How wrong the missing pixels are by estimate; nothing where that was not asked for, or would take too long.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimate: Option<Estimated>,
    /// The power by which squared errors grow with the variance of pixels given the samples; near 0 where noise decides.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exponent: Option<f64>,
    /// Light that filled pixels have too little or too much of; nothing where chance explains it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub energy: Option<Energy>,
    /// How the solver ended.
    pub outcome: Outcome,
    /// Noise was looked for, and held-out samples showed none.
    #[serde(skip)]
    pub noiseless: bool,
}

impl PartReport {
    /// Takes the estimate of the group of a channel back.
    pub(super) fn estimate_none(&mut self, channel: usize) {
        let name = &self.channels[channel].name;
        for group in self.groups.iter_mut().filter(|group| group.channels.contains(name)) {
            (group.estimate, group.exponent) = (None, None);
        }
    }
}

impl GroupReport {
    /// What the samples chose for them, if they did: `R, G, B: lambda=3.1 by known noise`.
    pub fn settled(&self) -> Option<String> {
        (!self.settled.is_empty()).then(|| format!("{}: {}", self.names(), self.settled.join(", ")))
    }

    /// Its channels, as people name them.
    pub fn names(&self) -> String {
        named(&self.channels).join(", ")
    }
}

/// What is said of a part, behind its name if it needs one.
pub fn behind(part: Option<&str>, line: &str) -> String {
    part.map_or_else(|| line.to_owned(), |part| format!("{part}: {line}"))
}

/// Names as people order them: files have red after blue.
pub fn named(channels: &[String]) -> Vec<String> {
    let rank = |name: &String| "RGBA".find(Name::new(name).component).unwrap_or(usize::MAX);
    let mut names = channels.to_vec();
    names.sort_by_key(rank);
    names
}

impl PartReport {
    /// What the log should say of measured values that are not finite.
    pub(super) fn non_finite(&self) -> Vec<String> {
        let note = |copied: bool, said: [&str; 2]| {
            let channels = self.channels.iter().filter(|channel| (channel.rule == Rule::Nearest) == copied);
            channels::non_finite_note(said, channels.map(|channel| (&channel.name, channel.non_finite)))
        };
        let computed = [
            "measured value is not finite and counts as missing",
            "measured values are not finite and count as missing",
        ];
        let copied = [
            "measured value is not finite and stays; missing pixels take others where there are any",
            "measured values are not finite and stay; missing pixels take others where there are any",
        ];
        let (computed, copied) = (note(false, computed), note(true, copied));
        computed.into_iter().chain(copied).collect()
    }
}

impl Report {
    /// A report without parts, with what the stamp tells.
    pub(super) fn new(stamp: &Stamp, density: Option<f64>, notes: Vec<String>) -> Self {
        Self {
            filter: stamp.filter.clone(),
            settings: stamp.settings.clone(),
            mask: stamp.mask.clone(),
            density,
            notes,
            ..Self::default()
        }
    }

    /// The parts, each with what people call it where there are several.
    pub fn every_part(&self) -> impl Iterator<Item = (Option<String>, &PartReport)> {
        let several = self.parts.len() > 1;
        self.parts.iter().enumerate().map(move |(at, part)| {
            let name = || match part.name.as_deref() {
                Some(name) if !name.is_empty() => visible(name).into_owned(),
                _ => format!("part {at}"),
            };
            (several.then(name), part)
        })
    }

    /// The parts, each with its name where a filter ran on several: lines of one part alone need none.
    pub fn named_parts(&self) -> impl Iterator<Item = (Option<String>, &PartReport)> {
        let several = self.parts.iter().filter(|part| !part.groups.is_empty()).count() > 1;
        self.every_part().map(move |(name, part)| (name.filter(|_| several), part))
    }

    /// A line of each part that has something to say, behind its name where a filter ran on several.
    pub fn lines<'a>(
        &'a self,
        line: impl Fn(&'a PartReport) -> Option<String> + 'a,
    ) -> impl Iterator<Item = String> + 'a {
        self.named_parts().filter_map(move |(name, part)| Some(behind(name.as_deref(), &line(part)?)))
    }

    /// Adds up the channels and groups.
    pub(super) fn total(&mut self) {
        let channels = || self.parts.iter().flat_map(|part| &part.channels);
        self.non_finite = channels().map(|channel| channel.non_finite).sum();
        self.limited = channels().map(|channel| channel.limited).sum();
        self.largest_move = channels().map(|channel| channel.largest_move).fold(0.0, f32::max);
        self.clamped_halves = channels().map(|channel| channel.clamped_halves).sum();
        let outcomes = self.parts.iter().flat_map(|part| &part.groups).map(|group| group.outcome);
        self.outcome = outcomes.reduce(Outcome::worst);
    }
}
