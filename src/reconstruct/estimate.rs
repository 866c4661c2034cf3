//! How wrong a fill is by its own estimate: in words for the log and the attribute, as numbers for the report, and held to a bound.

use lacuna_exr::{Channel, Part, Samples};
use lacuna_filters::Plane;
use lacuna_filters::estimate::{Rmse, Verdict};
use lacuna_filters::fill::{Estimate, Set};
use serde::Serialize;

use super::{GroupReport, Report};
use crate::channels::is_coordinate;

/// The attribute that says how wrong the missing pixels of a part are by estimate.
pub const ATTRIBUTE: &str = "lacuna/estimate";

/// An estimate with the interval that holds the truth nine times of ten.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Interval {
    /// The estimate.
    pub estimate: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// The error of the missing pixels of a group of channels, colours clipped to 0 and the peak as `lacuna compare` does.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Estimated {
    /// It is about this.
    Error {
        /// Root mean square error.
        rmse: Interval,
        /// Peak signal-to-noise ratio in decibels; nothing where the error is 0, and of coordinates, which have no peak.
        psnr: Option<Interval>,
        /// Root mean square error without clipping, where measured values are beyond 0 or the peak.
        #[serde(skip_serializing_if = "Option::is_none")]
        unclipped_rmse: Option<Interval>,
    },
    /// It is not larger than this, nine times of ten.
    Bound {
        /// Root mean square error.
        rmse_at_most: f64,
        /// Peak signal-to-noise ratio in decibels.
        psnr_at_least: f64,
    },
    /// It was not made but copied.
    Copied {
        /// From what.
        copied_from: Vec<String>,
        /// How many measured pixels were compared, all of which are equal.
        equal_pixels: usize,
    },
    /// It cannot be told.
    Unknown {
        /// Why not.
        unknown: String,
        /// As of an error that can.
        #[serde(skip_serializing_if = "Option::is_none")]
        unclipped_rmse: Option<Interval>,
    },
}

impl From<Rmse> for Interval {
    fn from(found: Rmse) -> Self {
        Self { estimate: found.rmse, low: found.low, high: found.high }
    }
}

impl Estimated {
    /// What is told of values of which `peak` counts as white.
    pub fn new(verdict: Verdict, peak: f32) -> Self {
        let peak = f64::from(peak);
        match verdict {
            Verdict::Estimate(found) => {
                let rmse = found.into();
                let [estimate, low, high] = found.psnr(peak);
                let psnr = (found.low > 0.0).then_some(Interval { estimate, low, high });
                Self::Error { rmse, psnr, unclipped_rmse: None }
            }
            Verdict::AtMost(rmse) => {
                Self::Bound { rmse_at_most: rmse, psnr_at_least: 20.0 * (peak.log10() - rmse.log10()) }
            }
            Verdict::CannotTell(why) => Self::Unknown { unknown: why.to_string(), unclipped_rmse: None },
        }
    }

    /// The error of a set, where it was asked for.
    pub fn of_set(set: &Set, (asked, peak): (Estimate, f32), coordinates: bool) -> Option<Self> {
        match untold(set) {
            Some(_) if asked == Estimate::No || coordinates => None,
            Some(unknown) => Some(Self::Unknown { unknown, unclipped_rmse: None }),
            None => Self::of(set.estimate?, peak, coordinates).map(|told| told.beside(set.unclipped)),
        }
    }

    /// With the error of values that are not clipped.
    fn beside(mut self, unclipped: Option<Verdict>) -> Self {
        if let (
            Self::Error { unclipped_rmse, .. } | Self::Unknown { unclipped_rmse, .. },
            Some(Verdict::Estimate(found)),
        ) = (&mut self, unclipped)
        {
            *unclipped_rmse = Some(found.into());
        }
        self
    }

    /// What is told of a group of channels; of coordinates only an error in their own unit.
    pub fn of(verdict: Verdict, peak: f32, coordinates: bool) -> Option<Self> {
        match Self::new(verdict, peak) {
            Self::Error { rmse, .. } if coordinates => {
                Some(Self::Error { rmse, psnr: None, unclipped_rmse: None })
            }
            other => (!coordinates).then_some(other),
        }
    }
}

/// Why nothing is known of the error of a set whose error was asked for; nothing where something is.
pub fn untold(set: &Set) -> Option<String> {
    if set.smoothed || !set.method.keeps_measured() {
        return Some("measured pixels are smoothed".into());
    }
    let name = set.method.name();
    let why = match set.method.descriptor().held_out {
        None => format!("{name} has no estimate"),
        Some(_) => "the fill was stopped before its estimate".into(),
    };
    set.estimate.is_none().then_some(why)
}

/// Ends what is said of what was copied.
const EQUAL: &str = " measured pixels";

/// Begins what is said of an error of which nothing is known.
const UNTOLD: &str = "cannot be told: ";

/// What is said where nothing errs, which is no promise of places that no sample has met.
const NO_ERROR: &str = "no error at held-out samples";

impl std::fmt::Display for Estimated {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Error { rmse, psnr: Some(psnr), .. } => {
                let Interval { estimate, low, high } = psnr;
                write!(f, "{estimate:.1} dB ({low:.1} to {high:.1}), RMSE {:.2e}", rmse.estimate)
            }
            Self::Error { rmse, .. } if rmse.high > 0.0 => {
                let Interval { estimate, low, high } = rmse;
                write!(f, "RMSE {estimate:.2e} ({low:.2e} to {high:.2e})")
            }
            Self::Error { .. } => f.write_str(NO_ERROR),
            Self::Bound { rmse_at_most, psnr_at_least } => {
                write!(f, "at least {psnr_at_least:.1} dB, RMSE at most {rmse_at_most:.2e}")
            }
            Self::Copied { copied_from, equal_pixels } => {
                write!(f, "copied from {}, equal at all {equal_pixels}{EQUAL}", copied_from.join(", "))
            }
            Self::Unknown { unknown, .. } => write!(f, "{UNTOLD}{unknown}"),
        }
    }
}

/// The least that a fill must reach by its estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gate {
    /// Peak signal-to-noise ratio in decibels.
    pub min_psnr: Option<f64>,
    /// Root mean square error.
    pub max_rmse: Option<f64>,
}

impl Gate {
    /// Whether it asks for anything.
    pub fn is_set(&self) -> bool {
        self.min_psnr.is_some() || self.max_rmse.is_some()
    }

    /// Why a group is doubtful, if it is; an error that cannot be told is, one with a bound if that is beyond the gate's. Coordinates
    /// are not: their unit is not that of light. Nor is what was copied.
    fn refuses(&self, group: &GroupReport) -> Option<String> {
        if group.channels.iter().any(|name| is_coordinate(name)) {
            return None;
        }
        self.refuses_said(&group.names(), &group.estimate.as_ref()?.to_string())
    }

    /// Why what is said of the error of these channels is doubtful. Figures count as they are said, rounded, so that an output that is
    /// there already gets the verdict that it got when it was filled.
    fn refuses_said(&self, names: &str, said: &str) -> Option<String> {
        if said == NO_ERROR || said.ends_with(EQUAL) {
            return None;
        }
        let untold = |why: &str| Some(format!("the error of {names} cannot be told: {why}"));
        if let Some(why) = said.strip_prefix(UNTOLD) {
            return untold(why);
        }
        let figure = |text: &str| text.parse::<f64>().ok();
        let (figures, [least, most]) = match said.strip_prefix("at least ") {
            Some(bound) => (bound.split_once(" dB, RMSE at most "), ["at least", "at most"]),
            None => (said.split_once(" dB (").map(|(psnr, rest)| (psnr, last_word(rest))), ["about"; 2]),
        };
        // An error that has no ratio: it may be 0.
        let alone = said.strip_prefix("RMSE ").and_then(|rest| rest.split(' ').next());
        let figures = figures.or(alone.map(|rmse| ("inf", rmse)));
        let figures = figures.and_then(|(psnr, rmse)| Some((figure(psnr)?, figure(rmse)?)));
        let Some((psnr, rmse)) = figures else { return untold(said) };
        let low = self.min_psnr.filter(|&bound| psnr < bound);
        let high = self.max_rmse.filter(|&bound| rmse > bound);
        let low =
            low.map(|bound| format!("{names}: {least} {psnr:.1} dB by estimate, below --min-psnr {bound}"));
        low.or_else(|| {
            high.map(|bound| format!("{names}: RMSE {most} {rmse:.2e} by estimate, above --max-rmse {bound}"))
        })
    }

    /// Why a filled part is doubtful whose attribute says this of its estimates, if it is.
    pub fn doubt_of(&self, line: &str) -> Option<String> {
        let doubt = |group: &str| {
            let (names, said) = group.split_once(": ").unwrap_or((group, ""));
            let coordinates = names.split(", ").any(is_coordinate);
            if coordinates { None } else { self.refuses_said(names, said) }
        };
        joined(line.split("; ").filter_map(doubt))
    }

    /// Why a filled frame is doubtful, if it is.
    pub fn doubt(&self, report: &Report) -> Option<String> {
        joined(report.lines(|part| joined(part.groups.iter().filter_map(|group| self.refuses(group)))))
    }
}

fn last_word(text: &str) -> &str {
    text.rsplit(' ').next().unwrap_or_default()
}

/// All that is said in one line, if anything is.
pub fn joined(lines: impl Iterator<Item = String>) -> Option<String> {
    let all: Vec<String> = lines.collect();
    (!all.is_empty()).then(|| all.join("; "))
}

/// What groups of channels are worth by estimate: `R, G, B: 58.1 dB (56.2 to 60.1), RMSE 1.24e-3; ...`.
pub fn line<'a>(groups: impl Iterator<Item = &'a GroupReport>) -> Option<String> {
    joined(groups.filter_map(|group| Some(format!("{}: {}", group.names(), group.estimate.as_ref()?))))
}

/// The first group of such a line whose figures cannot be those of one error: not numbers, out of order, or a ratio that is not that of the
/// error beside it, by that peak or by 1, the white of what is no light. What holds no figures says nothing that could be wrong.
pub fn contradiction(line: &str, peak: f64) -> Option<&str> {
    line.split("; ").find(|group| figures(group, peak).is_some_and(|holds| !holds))
}

/// Whether the figures of a group hold together; nothing where there are none.
fn figures(group: &str, peak: f64) -> Option<bool> {
    let number = |text: &str| text.parse::<f64>().unwrap_or(f64::NAN);
    let last = |text: &str| number(last_word(text));
    // Both are rounded: decibels to a tenth, errors to three digits.
    let by = |white: f64, psnr: f64, rmse: f64| (psnr - 20.0 * (white / rmse).log10()).abs() < 0.1;
    let agree = |psnr: f64, rmse: f64| rmse > 0.0 && [peak, 1.0].iter().any(|white| by(*white, psnr, rmse));
    let within = |estimate: f64, interval: &str| {
        interval.split_once(" to ").is_some_and(|(low, high)| {
            number(low) <= estimate && estimate <= number(high) && number(high).is_finite()
        })
    };
    if let Some((before, rmse)) = group.rsplit_once("), RMSE ") {
        let (before, interval) = before.rsplit_once(" dB (")?;
        return Some(within(last(before), interval) && agree(last(before), number(rmse)));
    }
    if let Some((before, rmse)) = group.rsplit_once(" dB, RMSE at most ") {
        return Some(agree(last(before), number(rmse)));
    }
    let (before, interval) = group.strip_suffix(')')?.rsplit_once(" (")?;
    let rmse = number(before.rsplit_once(": RMSE ")?.1);
    Some(rmse >= 0.0 && within(rmse, interval))
}

/// What is said of channels without estimated errors, a line for each reason: `B, G, R: no estimated errors: dct has no estimate`.
pub fn without_errors(untold: &[(Vec<String>, String)]) -> Vec<String> {
    let mut reasons: Vec<(&str, Vec<String>)> = Vec::new();
    for (names, why) in untold {
        match reasons.iter_mut().find(|(known, _)| known == why) {
            Some((_, all)) => all.extend(names.clone()),
            None => reasons.push((why, names.clone())),
        }
    }
    let line = |(why, names): (&str, Vec<String>)| {
        format!("{}: no estimated errors: {why}", super::report::named(&names).join(", "))
    };
    reasons.into_iter().map(line).collect()
}

/// Adds the estimated error of each layer to a part as a channel of that name; the first group of a layer speaks for it. Returns what to tell.
pub fn add_channels(part: &mut Part, name: &str, errors: Vec<(String, Plane)>) -> Vec<String> {
    let mut notes = Vec::new();
    let own = part.channels.len();
    for (first, error) in errors {
        let full =
            first.rsplit_once('.').map_or_else(|| name.to_owned(), |(layer, _)| format!("{layer}.{name}"));
        if let Some(at) = part.channels.iter().position(|channel| channel.name == full.as_bytes()) {
            if at >= own {
                continue;
            }
            notes.push(format!("no channel {full} of estimated errors: there is one of that name"));
            continue;
        }
        let samples = Samples::Float(error.into_pixels());
        part.channels.push(Channel { name: full.into(), perceptually_linear: false, samples });
    }
    notes
}

/// What a blend is made of: `R, G, B: edge 81 %, tv 19 %; ...`.
pub fn chosen<'a>(groups: impl Iterator<Item = &'a GroupReport>) -> Option<String> {
    let one = |group: &GroupReport| {
        let shares = group.chosen.iter().map(|(name, share)| (name, format!("{:.0}", 100.0 * share)));
        let shares =
            shares.filter(|(_, share)| share != "0").map(|(name, share)| format!("{name} {share} %"));
        format!("{}: {}", group.names(), shares.collect::<Vec<_>>().join(", "))
    };
    joined(groups.filter(|group| !group.chosen.is_empty()).map(one))
}

#[cfg(test)]
mod tests {
    use lacuna_filters::Outcome;
    use lacuna_filters::estimate::Why;

    use super::*;

    fn group(verdict: Verdict) -> GroupReport {
        GroupReport {
            channels: vec!["R".into(), "G".into()],
            domain: "linear",
            guides: Vec::new(),
            guides_gain: None,
            neighbours_gain: None,
            chosen: vec![("edge".into(), 0.8), ("tv".into(), 0.2)],
            settled: Vec::new(),
            estimate: Some(Estimated::new(verdict, 1.0)),
            exponent: None,
            energy: None,
            outcome: Outcome::direct(),
            noiseless: false,
        }
    }

    #[test]
    fn an_estimate_is_said_in_words_and_held_to_bounds() {
        let good = group(Verdict::Estimate(Rmse { rmse: 0.001, low: 0.0005, high: 0.002 }));
        let unknown = group(Verdict::CannotTell(Why::FewSamples));
        let bound = group(Verdict::AtMost(0.01));
        assert_eq!(line([&bound].into_iter()).unwrap(), "R, G: at least 40.0 dB, RMSE at most 1.00e-2");
        let exact = group(Verdict::Estimate(Rmse { rmse: 0.0, low: 0.0, high: 0.0 }));
        let (from, equal_pixels) = (vec!["x.R".into(), "x.G".into()], 120);
        let copied = Some(Estimated::Copied { copied_from: from, equal_pixels });
        let copied = GroupReport { estimate: copied, ..exact.clone() };
        let said = "R, G: copied from x.R, x.G, equal at all 120 measured pixels";
        assert_eq!(line([&copied].into_iter()).unwrap(), said);
        assert_eq!(
            line([&good, &unknown].into_iter()).unwrap(),
            "R, G: 60.0 dB (54.0 to 66.0), RMSE 1.00e-3; R, G: cannot be told: there are too few samples"
        );
        assert_eq!(chosen([&good].into_iter()).unwrap(), "R, G: edge 80 %, tv 20 %");
        let most = GroupReport { chosen: vec![("edge".into(), 0.996), ("tv".into(), 0.004)], ..good.clone() };
        assert_eq!(chosen([&most].into_iter()).unwrap(), "R, G: edge 100 %");
        assert_eq!(line([&exact].into_iter()).unwrap(), "R, G: no error at held-out samples");
        for told in [&good, &unknown, &bound, &exact, &copied] {
            assert_eq!(contradiction(&line([told].into_iter()).unwrap(), 1.0), None);
        }
        let gate = |min_psnr, max_rmse| Gate { min_psnr, max_rmse };
        for (gate, group, refused) in [
            (gate(Some(59.9), None), &good, false),
            (gate(Some(60.1), None), &good, true),
            (gate(None, Some(0.0011)), &good, false),
            (gate(None, Some(0.0009)), &good, true),
            (gate(Some(1.0), None), &unknown, true),
            (gate(Some(39.9), None), &bound, false),
            (gate(Some(40.1), None), &bound, true),
            (gate(None, Some(0.011)), &bound, false),
            (gate(None, Some(0.009)), &bound, true),
            (gate(Some(300.0), Some(0.0)), &exact, false),
            (gate(Some(300.0), Some(0.0)), &copied, false),
        ] {
            assert_eq!(gate.refuses(group).is_some(), refused, "{gate:?} {group:?}");
            // What the attribute says of it tells as much.
            let line = line([group].into_iter()).unwrap();
            assert_eq!(gate.doubt_of(&line), gate.refuses(group), "{gate:?} {line:?}");
        }
    }

    #[test]
    fn decibels_are_relative_to_the_peak() {
        let found = Verdict::Estimate(Rmse { rmse: 0.01, low: 0.005, high: 0.02 });
        for (verdict, said) in [
            (found, "60.0 dB (54.0 to 66.0), RMSE 1.00e-2"),
            (Verdict::AtMost(0.01), "at least 60.0 dB, RMSE at most 1.00e-2"),
        ] {
            let told = Estimated::new(verdict, 10.0).to_string();
            assert_eq!(told, said);
            let line = format!("R: {told}");
            assert_eq!((contradiction(&line, 10.0), contradiction(&line, 1.0)), (None, Some(&*line)));
            let alpha = format!("A: {}", Estimated::new(verdict, 1.0));
            assert_eq!(contradiction(&alpha, 10.0), None);
        }
    }

    #[test]
    fn figures_that_cannot_be_are_found() {
        for (line, holds) in [
            ("A: 39.7 dB (36.1 to 43.3), RMSE 1.04e-2; R, G: 45.4 dB (42.0 to 48.8), RMSE 5.37e-3", true),
            ("A: 39.7 dB (36.1 to 43.3), RMSE 1.04e-2; R, G: 65.4 dB (62.0 to 68.8), RMSE 5.37e-3", false),
            ("A: 39.7 dB (36.1 to 43.3), RMSE 0.00e0", false),
            ("A: 39.7 dB (40.1 to 43.3), RMSE 1.04e-2", false),
            ("A: 39.7 dB (36.1 to inf), RMSE 1.04e-2", false),
            ("A: nan dB (36.1 to 43.3), RMSE nan", false),
            ("P.X: RMSE 1.00e-2 (9.00e-3 to 1.10e-2)", true),
            ("P.X: RMSE -1.00e-2 (-2.00e-2 to 1.10e-2)", false),
            ("P.X: RMSE 1.00e-2 (2.00e-2 to 3.00e-2)", false),
            ("R: at least 40.0 dB, RMSE at most 1.00e-2", true),
            ("R: at least 60.0 dB, RMSE at most 1.00e-2", false),
            ("R: no error at held-out samples; G: cannot be told: there are too few samples", true),
            ("a (b): cannot be told: why (why not)", true),
        ] {
            assert_eq!(contradiction(line, 1.0).is_none(), holds, "{line}");
        }
    }
}
