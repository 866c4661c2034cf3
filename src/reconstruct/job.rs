//! What is to be done to a frame, and the line of text that says so in the output.

use lacuna_exr::{Compression, Part};
use lacuna_filters::Method;
use lacuna_filters::domain::Domain;
use lacuna_filters::fill::Estimate;
use serde::Serialize;
use serde_json::Value;

use super::{Enlarge, NoiseSource, Weights};
use crate::channels::Override;
use crate::guides::Asked;
use crate::mask::Source;
use crate::temporal::{Temporal, Window};

/// A float type that channels can be written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// 16 bits.
    Half,
    /// 32 bits.
    Float,
}

/// Everything that changes the result.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// The filter with its settings.
    pub method: Method,
    /// Where colours are reconstructed.
    pub domain: Domain,
    /// Whether overshoot is limited.
    pub limit: bool,
    /// The type of the filled, normal and depth channels; nothing leaves each its own. Identifiers, kept channels
    /// and whole numbers always keep theirs, and depths do not become halves.
    pub kind: Option<Kind>,
    /// Whether the sampling mask's channels are left out of the output.
    pub drop_mask: bool,
    /// The output's compression; nothing takes the input's where it is lossless, else ZIP.
    pub compression: Option<Compression>,
    /// How hard it tries, where that is said.
    pub level: Option<u8>,
    /// The mask as it was asked for (not as it was found).
    pub mask: Source,
    /// The channel rules that were asked for.
    pub overrides: Vec<Override>,
    /// The file that some of them are from.
    pub rules: Option<String>,
    /// How the filled frame is enlarged, if it is.
    pub enlarge: Option<Enlarge>,
    /// The guides that were asked for; few methods take any.
    pub guides: Asked,
    /// Path or pattern of the file that they come from, if it is another one.
    pub guides_from: Option<String>,
    /// How much each measured pixel counts where the method smooths; nothing weighs all alike.
    pub weights: Option<Weights>,
    /// What the noise of measured pixels is known from, which then are smoothed.
    pub noise: NoiseSource,
    /// The frames beside it that a frame takes samples of.
    pub temporal: Temporal,
    /// The layers that come from other files, each as `NAME=PATTERN`.
    pub layers: Vec<String>,
    /// What is to be said of the error of missing pixels.
    pub estimate: Estimate,
    /// The value of light that counts as white in what is said of the error; that of all else is 1.
    pub peak: f32,
    /// The name of the channel that holds the estimated error of each pixel, if there is to be one.
    pub error_channel: Option<String>,
}

impl Job {
    /// A job with everything but the method as `lacuna fill` has it by default.
    pub fn new(method: Method) -> Self {
        Self {
            method,
            domain: Domain::Auto,
            limit: true,
            kind: None,
            drop_mask: false,
            compression: None,
            level: None,
            mask: Source::Auto,
            overrides: Vec::new(),
            rules: None,
            enlarge: None,
            guides: Asked::Auto,
            guides_from: None,
            weights: None,
            noise: NoiseSource::None,
            temporal: Temporal::default(),
            layers: Vec::new(),
            estimate: Estimate::No,
            peak: 1.0,
            error_channel: None,
        }
    }

    /// The name of the filter that makes the pixels.
    pub fn filter_name(&self) -> &'static str {
        self.enlarge.as_ref().map_or_else(|| self.method.name(), Enlarge::name)
    }

    /// Whether measured pixels keep their bits.
    pub fn keeps_measured(&self) -> bool {
        self.noise == NoiseSource::None && self.method.keeps_measured()
    }

    /// Whether something is said of the error.
    pub fn estimates(&self) -> bool {
        self.estimate != Estimate::No && self.enlarge.is_none()
    }

    /// The guides that are looked for: none where the filter takes none, or measured pixels are smoothed.
    pub fn wanted(&self) -> &Asked {
        let larger = |enlarge: &Enlarge| {
            enlarge.method == lacuna_filters::upscale::Method::Ss && self.guides_from.is_some()
        };
        let takes = self.method.descriptor().takes.guides && self.method.keeps_measured();
        let takes = takes && self.enlarge.as_ref().is_none_or(larger);
        if takes { &self.guides } else { &Asked::None }
    }

    /// The channel that counts samples, if weights or noise go by one.
    pub fn counts(&self) -> Option<&str> {
        let by_noise = if let NoiseSource::Count(weights) = &self.noise { Some(weights) } else { None };
        self.weights.as_ref().or(by_noise).map(|weights| weights.channel.as_str())
    }

    /// Everything that changes the result on one line, `name=value` separated by spaces: equal lines, versions,
    /// inputs and masks mean equal outputs. This is the attribute `lacuna/settings`.
    pub fn settings(&self) -> String {
        let kind = match self.kind {
            None => "input",
            Some(Kind::Half) => "half",
            Some(Kind::Float) => "float",
        };
        let compression = self.compression.map_or("input", Compression::name);
        let overrides: Vec<String> = self.overrides.iter().map(ToString::to_string).collect();
        let mask = self.mask.to_string();
        // What is complete is kept by every filter.
        let guides = if self.enlarge.is_some() { self.wanted() } else { &self.guides }.to_string();
        let mut line = self.method.settings();
        if let Some(enlarge) = &self.enlarge {
            line = format!("{} fill={} {line}", enlarge.settings(), self.method.name());
        }
        for (name, value) in [
            ("domain", domain_name(self.domain)),
            ("limit", if self.limit { "on" } else { "off" }),
            ("measured", if self.keeps_measured() { "kept" } else { "smoothed" }),
            ("type", kind),
            ("compression", compression),
            ("mask-channel", if self.drop_mask { "dropped" } else { "kept" }),
            ("mask", mask.as_str()),
            ("channels", overrides.join("\n").as_str()),
            ("guides", guides.as_str()),
            ("guides-from", self.guides_from.as_deref().unwrap_or("frame")),
        ] {
            let gap = if line.is_empty() { "" } else { " " };
            line = format!("{line}{gap}{name}={}", quote(value));
        }
        if let Some(weights) = &self.weights {
            line = format!("{line} weights={}", quote(&weights.to_string()));
        }
        if self.noise != NoiseSource::None || self.method.is_open() {
            line = format!("{line} noise={}", quote(&self.noise.to_string()));
        }
        if self.temporal.window != Window::None {
            line = format!("{line} temporal={} motion={}", self.temporal.window, self.temporal.motion);
        }
        if let Some(level) = self.level {
            line = format!("{line} compression-level={level}");
        }
        // Of enlarged frames nothing is estimated.
        if self.estimate == Estimate::No && self.enlarge.is_none() {
            line += " estimate=none";
        }
        if self.peak != 1.0 {
            line = format!("{line} peak={}", self.peak);
        }
        if let Some(name) = &self.error_channel {
            line = format!("{line} error-channel={}", quote(name));
        }
        if let Some(rules) = &self.rules {
            line = format!("{line} rules={}", quote(rules));
        }
        if !self.layers.is_empty() {
            line = format!("{line} layers={}", quote(&self.layers.join("\n")));
        }
        line
    }
}

const fn domain_name(domain: Domain) -> &'static str {
    match domain {
        Domain::Auto => "auto",
        Domain::Linear => "linear",
        Domain::Log => "log",
    }
}

/// The compression that a part is written with.
pub fn output_compression(input: Compression, asked: Option<Compression>) -> Compression {
    asked.unwrap_or(if input.is_lossless() { input } else { Compression::Zip })
}

/// Gives a part the form that it is written in: a compression that keeps measured pixels, and one level. Returns what to tell.
pub fn make_writable(part: &mut Part, asked: Option<Compression>) -> Vec<String> {
    let mut notes = Vec::new();
    let compression = output_compression(part.compression, asked);
    if asked.is_none() && compression != part.compression {
        let (old, new) = (part.compression.name(), compression.name());
        notes.push(format!("{old} would change measured pixels: written as {new}"));
    }
    part.compression = compression;
    if std::mem::take(&mut part.had_levels) {
        notes.push("the file had mip or rip levels: only the full one is read and written".into());
    }
    notes
}

/// A value as it stands in a line of settings: quoted like JSON where it would not be one word.
fn quote(value: &str) -> String {
    let plain = |letter: char| !letter.is_whitespace() && !letter.is_control() && letter != '"';
    // What begins like an object of JSON would be read as one.
    let is_word = !value.is_empty() && !value.starts_with('{') && value.chars().all(plain);
    if is_word { value.into() } else { Value::from(value).to_string() }
}

/// Reads a line of settings back into names and values, objects of JSON as their text; what cannot be read ends it.
pub fn parse_settings(line: &str) -> Vec<(String, String)> {
    let mut pairs = Vec::new();
    let mut rest = line.trim_start();
    while let Some((name, tail)) = rest.split_once('=') {
        let (value, tail) = if tail.starts_with(['"', '{']) {
            let mut values = serde_json::Deserializer::from_str(tail).into_iter::<Value>();
            let value = match values.next() {
                Some(Ok(Value::String(text))) => text,
                Some(Ok(object)) => object.to_string(),
                _ => break,
            };
            (value, &tail[values.byte_offset()..])
        } else {
            let end = tail.find(' ').unwrap_or(tail.len());
            (tail[..end].to_owned(), &tail[end..])
        };
        pairs.push((name.to_owned(), value));
        rest = tail.trim_start();
    }
    pairs
}

#[cfg(test)]
mod tests {
    use lacuna_filters::baseline::push_pull;

    use super::*;

    #[test]
    fn settings_come_back() {
        let mut job = Job::new(Method::from(push_pull::Settings));
        job.mask = Source::File { pattern: "my dir/a \"b\".exr".into(), channel: None };
        job.overrides = vec!["Diffuse Direct.*=keep".parse().unwrap(), "[=]x=fill".parse().unwrap()];
        job.kind = Some(Kind::Half);
        job.guides_from = Some("{a}.exr".into());
        job.rules = Some("rules.toml".into());
        let line = job.settings();
        let pairs = parse_settings(&line);
        let get = |name: &str| pairs.iter().find(|pair| pair.0 == name).map(|pair| pair.1.as_str());
        assert_eq!(get("type"), Some("half"));
        assert_eq!(get("measured"), Some("kept"));
        assert_eq!(get("mask"), Some("file:my dir/a \"b\".exr"));
        assert_eq!(get("channels"), Some("Diffuse Direct.*=keep\n[=]x=fill"));
        assert_eq!((get("guides-from"), get("rules")), (Some("{a}.exr"), Some("rules.toml")));
        assert_ne!(line, Job { limit: false, ..job.clone() }.settings());
    }

    #[test]
    fn damaged_settings_end_quietly() {
        assert_eq!(parse_settings("a=1 b=\"unclosed"), vec![("a".to_owned(), "1".to_owned())]);
        assert!(parse_settings("nothing").is_empty());
    }
}
