//! The attributes that say how a part was filled, and those that are no longer true of it.

use lacuna_exr::{Attributes, Part};
use lacuna_filters::{METHODS, Method, Plane, Stop};

use super::job::{Job, parse_settings};
use super::{GroupReport, NoiseSource, PartReport, estimate};
use crate::channels::{Override, Rule};
use crate::guides;
use crate::mask::Source;
use crate::mask::rounds::ROUNDS;
use crate::temporal::{self, Neighbours};

/// The version that made the part.
pub const VERSION: &str = "lacuna/version";
/// The filter's name.
pub const FILTER: &str = crate::mask::FILTER;
/// Everything else that changes the result.
pub const SETTINGS: &str = "lacuna/settings";
/// Settings that the samples chose, by group of channels.
pub const SETTLED: &str = "lacuna/settled";
/// Measured pixels over all pixels, before non-finite values were counted out.
pub const DENSITY: &str = crate::mask::DENSITY;
/// Where the mask was found.
pub const MASK: &str = crate::mask::ATTRIBUTE;

/// The files that the part was made from, each by sums of its bytes.
pub const SOURCES: &str = "lacuna/sources";

/// Why the solver stopped before it converged; parts that converged have no such attribute.
pub const STOP: &str = "lacuna/stop";

/// The scene that `lacuna render` made the part of, in JSON.
pub const SCENE: &str = temporal::SCENE;
/// All that the rendered pixels of such a part depend on, on one line.
pub const RENDER: &str = "lacuna/render";
/// Stands in it before what filled the others.
pub const FILLED_BY: &str = " fill=";

/// All attributes that filling adds.
pub const ADDED: &[&str] = &[
    VERSION,
    FILTER,
    SETTINGS,
    DENSITY,
    MASK,
    SOURCES,
    STOP,
    SETTLED,
    guides::ATTRIBUTE,
    guides::COPIED,
    guides::KEPT,
    estimate::ATTRIBUTE,
    temporal::ATTRIBUTE,
];

/// Those of them that say how the pixels were filled, which would lie once pixels are missing again.
pub const FILLING: &[&str] = &[
    FILTER,
    SETTINGS,
    SETTLED,
    DENSITY,
    SOURCES,
    STOP,
    guides::ATTRIBUTE,
    guides::COPIED,
    guides::KEPT,
    estimate::ATTRIBUTE,
    temporal::ATTRIBUTE,
];

/// Attributes derived from pixels, which would lie once the pixels differ.
pub const DERIVED: &[&str] = &["preview", "oiio:SHA-1", "oiio:AverageColor", "oiio:ConstantColor", RENDER];

/// Attributes that would lie about a part once other pixels of it are the measured ones.
pub fn of_other_pixels() -> impl Iterator<Item = &'static str> {
    DERIVED.iter().chain(FILLING).copied().chain([ROUNDS])
}

/// Removes attributes. Returns those that people may miss: what programs know their own files by is none of them.
pub fn remove(attributes: &mut Attributes, names: impl Iterator<Item = &'static str>) -> Vec<&'static str> {
    names.filter(|name| attributes.remove(name)).filter(|name| ![RENDER, SOURCES].contains(name)).collect()
}

/// What is told of attributes that were removed, if any were.
pub fn dropped_note(names: &[&str]) -> Option<String> {
    (!names.is_empty()).then(|| format!("dropped {}: the pixels are others now", names.join(", ")))
}

/// What a filled part says about its making.
#[derive(Clone, Debug, PartialEq)]
pub struct Stamp {
    /// The version of lacuna.
    pub version: String,
    /// The filter's name.
    pub filter: String,
    /// The line of [`Job::settings`].
    pub settings: String,
    /// Where the mask was found.
    pub mask: String,
    /// The files that it was made from, where those are known.
    pub sources: Option<String>,
}

impl Stamp {
    /// The stamp of what a job makes with this version of these sources; `mask` is where the mask was found.
    pub fn new(job: &Job, mask: &str, sources: Option<&str>) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            filter: job.filter_name().into(),
            settings: job.settings(),
            mask: mask.into(),
            sources: sources.map(Into::into),
        }
    }

    /// The same with another origin of the mask.
    #[must_use]
    pub fn with_mask(&self, mask: String) -> Self {
        Self { mask, ..self.clone() }
    }

    /// The stamp of a part, if it has a whole one.
    pub fn read(attributes: &Attributes) -> Option<Self> {
        let text = |name| attributes.text(name);
        Some(Self {
            version: text(VERSION)?,
            filter: text(FILTER)?,
            settings: text(SETTINGS)?,
            mask: text(MASK)?,
            sources: text(SOURCES),
        })
    }

    /// Writes the stamp, the density of the part and, unless it converged, why the solver stopped.
    pub fn write(&self, attributes: &mut Attributes, density: f64, stop: Stop) {
        attributes.set_text(VERSION, &self.version);
        attributes.set_text(FILTER, &self.filter);
        attributes.set_text(SETTINGS, &self.settings);
        attributes.set(DENSITY, "float", (density as f32).to_le_bytes().to_vec());
        attributes.set_text(MASK, &self.mask);
        match &self.sources {
            Some(line) => attributes.set_text(SOURCES, line),
            None => drop(attributes.remove(SOURCES)),
        }
        match stop_name(stop) {
            Some(name) => attributes.set_text(STOP, name),
            None => drop(attributes.remove(STOP)),
        }
    }

    /// Writes how a part was made: the stamp, the guides, what was copied or kept, and what the samples chose.
    pub fn sign(&self, attributes: &mut Attributes, density: Option<f64>, report: &PartReport) {
        let stop = report.groups.iter().map(|group| group.outcome.stop).max();
        self.write(attributes, density.unwrap_or(1.0), stop.unwrap_or(Stop::Converged));
        write_guides(attributes, report);
        guides::write_copied(attributes, &report.copied);
        write_kept(attributes, report);
        write_settled(attributes, report);
    }

    /// Whether a file with this stamp is what `job` would make again, as far as the settings tell.
    pub fn is_of(&self, job: &Job) -> bool {
        *self == Self::new(job, &self.mask, self.sources.as_deref())
    }

    /// What this stamp says else than `job` would; nothing if it is of it. Names of files do not count where their sums are known.
    pub fn differs(&self, job: &Job) -> Option<String> {
        let new = Self::new(job, &self.mask, self.sources.as_deref());
        if self.version != new.version {
            return Some(format!("it was made by lacuna {}", self.version));
        }
        if self.filter != new.filter {
            return Some(format!("the filter was {}", self.filter));
        }
        if self.settings == new.settings {
            return None;
        }
        let known = self.sources.is_some();
        let pairs = |line| if known { without_names(line) } else { parse_settings(line) };
        let (old, now) = (pairs(&self.settings), pairs(&new.settings));
        let other =
            now.iter().find(|pair| !old.contains(pair)).or(old.iter().find(|pair| !now.contains(pair)));
        let other = other.map_or("settings", |(name, _)| name);
        (!known || old != now).then(|| format!("{other} was set otherwise"))
    }

    /// The value of one setting.
    pub fn setting(&self, name: &str) -> Option<String> {
        parse_settings(&self.settings).into_iter().rev().find(|pair| pair.0 == name).map(|pair| pair.1)
    }

    /// Whether the settings say that measured pixels were smoothed.
    pub fn says_smoothed(&self) -> bool {
        self.setting("measured").is_some_and(|measured| measured == "smoothed")
    }

    /// Whether something that the settings name smooths measured pixels: known noise, or a setting of the filter.
    pub fn smooths(&self) -> bool {
        let by_noise = self.setting("noise").is_some_and(|noise| noise != NoiseSource::None.to_string());
        by_noise || self.filter_smooths()
    }

    /// Whether a setting of the filter does.
    fn filter_smooths(&self) -> bool {
        METHODS.iter().find(|method| method.name == self.filter).is_some_and(|method| {
            let smoothing = method.settings.iter().filter(|setting| setting.smooths);
            let given = smoothing.filter_map(|setting| Some((setting.name, self.setting(setting.name)?)));
            let given: Vec<_> = given.collect();
            let given: Vec<_> = given.iter().map(|(name, value)| (*name, value.as_str())).collect();
            Method::of(method, &given).is_ok_and(|method| !method.keeps_measured())
        })
    }

    /// The mask source to find the same mask again: what was asked for, with a file's path as it was resolved.
    pub fn source(&self) -> Option<Source> {
        let asked: Source = self.setting("mask")?.parse().ok()?;
        match asked {
            Source::File { .. } => self.mask.parse().ok(),
            other => Some(other),
        }
    }

    /// The channel rules that were asked for.
    pub fn overrides(&self) -> Vec<Override> {
        let text = self.setting("channels").unwrap_or_default();
        text.lines().filter_map(|line| line.parse().ok()).collect()
    }
}

/// The settings of a line with what was asked of files, but not what these are called. The channels have what rules say.
fn without_names(line: &str) -> Vec<(String, String)> {
    let kind = |(name, value): (String, String)| {
        let value = match (name.as_str(), value.parse()) {
            ("mask", Ok(Source::File { channel, .. })) => {
                Source::File { pattern: "FILE".into(), channel }.to_string()
            }
            ("guides-from", _) if value != "frame" => "FILE".into(),
            ("rules", _) => "FILE".into(),
            ("layers", _) => {
                let names = value.lines().map(|layer| layer.split_once('=').map_or(layer, |(name, _)| name));
                names.collect::<Vec<_>>().join("\n")
            }
            _ => value,
        };
        (name, value)
    };
    parse_settings(line).into_iter().map(kind).collect()
}

/// Writes which guides a part was filled with; parts filled without have no such attribute.
fn write_guides(attributes: &mut Attributes, report: &PartReport) {
    let mut names: Vec<&str> = Vec::new();
    for name in report.groups.iter().flat_map(|group| &group.guides) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    if names.is_empty() {
        attributes.remove(guides::ATTRIBUTE);
    } else {
        attributes.set_text(guides::ATTRIBUTE, &names.join(", "));
    }
}

/// Writes which channels of a part are as they came.
pub fn write_kept(attributes: &mut Attributes, report: &PartReport) {
    let kept = report.channels.iter().filter(|channel| channel.rule == Rule::Keep);
    guides::write_kept(attributes, &kept.map(|channel| channel.name.as_str()).collect::<Vec<_>>());
}

/// Writes which settings the samples chose; parts for which all were said have no such attribute.
fn write_settled(attributes: &mut Attributes, report: &PartReport) {
    let lines: Vec<String> = report.groups.iter().filter_map(GroupReport::settled).collect();
    if lines.is_empty() {
        attributes.remove(SETTLED);
    } else {
        attributes.set_text(SETTLED, &lines.join("; "));
    }
}

/// Writes how wrong a part's missing pixels are by estimate; parts that were not judged have no such attribute.
pub fn write_estimate(attributes: &mut Attributes, report: &PartReport) {
    match estimate::line(report.groups.iter()) {
        Some(line) => attributes.set_text(estimate::ATTRIBUTE, &line),
        None => drop(attributes.remove(estimate::ATTRIBUTE)),
    }
}

/// Writes which frames were looked at beside a part's own, and by what motion each was used; parts filled alone have no such attribute.
pub fn write_neighbours(attributes: &mut Attributes, report: &PartReport, neighbours: Option<&Neighbours>) {
    match neighbours.filter(|found| !found.looked_at.is_empty()) {
        Some(found) => attributes.set_text(temporal::ATTRIBUTE, &found.line(&report.neighbours)),
        None => drop(attributes.remove(temporal::ATTRIBUTE)),
    }
}

/// What the channels of estimated errors of a part are called, if the fill wrote some.
pub fn error_channel(part: &Part) -> Option<String> {
    let settings = parse_settings(&part.attributes.text(SETTINGS)?);
    settings.into_iter().find(|(name, _)| name == "error-channel").map(|(_, name)| name)
}

/// The estimated errors of a layer's pixels, if the fill wrote them.
pub fn estimated_errors(part: &Part, layer: &str) -> Option<Plane> {
    let name = error_channel(part)?;
    let full = if layer.is_empty() { name } else { format!("{layer}.{name}") };
    let channel = part.channels.iter().find(|channel| channel.name == full.as_bytes())?;
    Plane::new(part.size(), channel.samples.to_floats()?).ok()
}

const fn stop_name(stop: Stop) -> Option<&'static str> {
    match stop {
        Stop::Converged => None,
        Stop::IterationLimit => Some("iteration-limit"),
        Stop::TimeLimit => Some("time-limit"),
        Stop::Cancelled => Some("cancelled"),
    }
}

/// Whether the part was cut short by something that no setting says, so that another run may do better.
pub fn was_cut_short(attributes: &Attributes) -> bool {
    let of_the_run = [Stop::TimeLimit, Stop::Cancelled].map(stop_name);
    attributes.text(STOP).is_some_and(|stop| of_the_run.contains(&Some(stop.as_str())))
}

#[cfg(test)]
mod tests {
    use lacuna_filters::baseline::push_pull;

    use super::*;

    #[test]
    fn a_part_that_was_cut_short_says_so_until_it_converges() {
        let job = Job::new(lacuna_filters::Method::from(push_pull::Settings));
        let stamp = Stamp::new(&job, "mask", Some("input=1:2"));
        let mut attributes = Attributes::default();
        for (stop, name, cut) in [
            (Stop::TimeLimit, Some("time-limit"), true),
            (Stop::IterationLimit, Some("iteration-limit"), false),
            (Stop::Cancelled, Some("cancelled"), true),
            (Stop::Converged, None, false),
        ] {
            stamp.write(&mut attributes, 0.5, stop);
            assert_eq!(attributes.text(STOP).as_deref(), name);
            assert_eq!(was_cut_short(&attributes), cut, "{stop:?}");
            assert_eq!(Stamp::read(&attributes), Some(stamp.clone()));
        }
    }
}
