//! The gate: bounds on measures that decide the exit status.
//!
//! A bound holds for the colours of a frame (for every group of floats where there is no colour), over the whole image (missing pixels
//! where a measure is of these only); `REGION.MEASURE` names another region. Counts hold for every group. A frame that has not what is bounded fails, and so
//! does one in which channels are missing or values are not finite where the reference's are: nothing passes by absence. Where
//! the reference has infinities of its own, as the depth of a background, more of them pass: a depth is copied from a neighbour.

use std::collections::BTreeSet;
use std::str::FromStr;

use super::groups::Kind;
use super::measure::Measure;
use super::model::{FrameReport, GroupReport};

/// One bound.
#[derive(Clone, Debug, PartialEq)]
pub struct Bound {
    /// What is bounded.
    pub measure: Measure,
    /// `all`, `missing` or `alpha`.
    pub region: &'static str,
    /// The bound.
    pub value: f64,
}

/// Why a text is no bound.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is not MEASURE=NUMBER or REGION.MEASURE=NUMBER; regions are all, missing and alpha, measures are {names}", names = names())]
pub struct GateError(String);

fn names() -> String {
    Measure::all().map(Measure::name).collect::<Vec<_>>().join(", ")
}

impl FromStr for Bound {
    type Err = GateError;

    fn from_str(text: &str) -> Result<Self, GateError> {
        let wrong = || GateError(text.into());
        let (name, number) = text.split_once('=').ok_or_else(wrong)?;
        let (region, name) = name.trim().split_once('.').unwrap_or(("all", name.trim()));
        let region = ["all", "missing", "alpha"].into_iter().find(|&known| known == region);
        let measure = Measure::from_name(name).ok_or_else(wrong)?;
        let value: f64 = number.trim().parse().map_err(|_| wrong())?;
        match region {
            Some(region) if !value.is_nan() => Ok(Self { measure, region, value }),
            _ => Err(wrong()),
        }
    }
}

/// All bounds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gate {
    /// A value below fails.
    pub below: Vec<Bound>,
    /// A value above fails.
    pub above: Vec<Bound>,
}

impl Gate {
    /// Whether nothing is bounded.
    pub fn is_empty(&self) -> bool {
        self.below.is_empty() && self.above.is_empty()
    }

    /// The measures that are bounded.
    pub fn measures(&self) -> impl Iterator<Item = Measure> + '_ {
        self.below.iter().chain(&self.above).map(|bound| bound.measure)
    }

    /// The bounds as they are written: `psnr >= 40`.
    pub fn texts(&self) -> Vec<String> {
        let text = |bound: &Bound, sign: &str| {
            let region = if bound.region == "all" { String::new() } else { format!("{}.", bound.region) };
            format!("{region}{} {sign} {}", bound.measure.name(), bound.value)
        };
        let below = self.below.iter().map(|bound| text(bound, ">="));
        below.chain(self.above.iter().map(|bound| text(bound, "<="))).collect()
    }

    /// The measures of changes from frame to frame that are bounded and that none of these frames has.
    pub fn unknown(&self, frames: &[&FrameReport]) -> BTreeSet<Measure> {
        let knows = |frame: &&FrameReport, bound: &Bound| {
            bounded(frame, bound).iter().any(|group| value(group, bound).is_some())
        };
        let bounds = self.below.iter().chain(&self.above).filter(|bound| bound.measure.is_change());
        let unknown = bounds.filter(|bound| !frames.iter().any(|frame| knows(frame, bound)));
        unknown.map(|bound| bound.measure).collect()
    }

    /// What a frame fails by; it has a flicker only if it `follows` another by its number. What is unknown of all frames has been told.
    pub fn failures(&self, frame: &FrameReport, follows: bool, unknown: &BTreeSet<Measure>) -> Vec<String> {
        if self.is_empty() {
            return Vec::new();
        }
        let known = |bound: &Bound| follows || !bound.measure.is_change();
        let due = |bound: &&Bound| known(bound) && !unknown.contains(&bound.measure);
        let mut failures: Vec<String> =
            frame.notes.iter().filter(|note| note.ends_with("in the reference only")).cloned().collect();
        failures.extend(frame.groups.iter().filter_map(not_finite));
        let sees = |bound: &Bound| bound.measure.sees_all();
        if !self.below.iter().chain(&self.above).any(sees) {
            failures.extend(frame.groups.iter().filter_map(hidden));
        }
        let whole = |bound: &Bound| bound.region == "all" && !bound.measure.is_change();
        let sees = self.below.iter().chain(&self.above).any(whole);
        failures.extend(judged(frame).into_iter().filter_map(|group| beyond(group, sees)));
        for (bounds, below) in [(&self.below, true), (&self.above, false)] {
            for bound in bounds.iter().filter(due) {
                let groups = bounded(frame, bound);
                if groups.is_empty() {
                    failures.push(format!("there is nothing to tell {} of", bound.measure.name()));
                }
                failures.extend(groups.iter().filter_map(|group| broken(group, bound, below)));
            }
        }
        failures
    }
}

/// What is said of a measure of changes that none of the frames that were compared has.
pub fn why_unknown(measure: Measure) -> String {
    let motion = if measure.follows_motion() { " whose motion is known" } else { "" };
    format!(
        "no frame has {}: it takes a sequence, frames whose numbers follow each other{motion}",
        measure.name()
    )
}

/// The groups that a bound is for.
fn bounded<'a>(frame: &'a FrameReport, bound: &Bound) -> Vec<&'a GroupReport> {
    let counts = |group: &&GroupReport| {
        group.kind != Kind::Codes || matches!(bound.measure, Measure::Different | Measure::Pixels)
    };
    if bound.measure.is_count() { frame.groups.iter().filter(counts).collect() } else { judged(frame) }
}

/// The colours of a frame, else its groups of floats.
fn judged(frame: &FrameReport) -> Vec<&GroupReport> {
    let of = |keep: &dyn Fn(Kind) -> bool| -> Vec<_> {
        frame.groups.iter().filter(|group| keep(group.kind)).collect()
    };
    let colours = of(&|kind| kind == Kind::Colour);
    if colours.is_empty() { of(&|kind| kind != Kind::Codes) } else { colours }
}

fn not_finite(group: &GroupReport) -> Option<String> {
    let all = group.region("all")?;
    let count = |measure: Measure| all.measures.get(measure).unwrap_or(0.0);
    let copied = group.kind != Kind::Colour && count(Measure::ReferenceInfinite) > 0.0;
    let infinite = if copied { 0.0 } else { count(Measure::NewInfinite) };
    let bad = count(Measure::NewNan) + infinite;
    let are = if bad == 1.0 { "value is" } else { "values are" };
    (bad > 0.0).then(|| format!("{}: {bad} {are} not finite that should be", group.label()))
}

/// Where all that is wrong is beyond what clipping leaves, measures call the images equal.
fn hidden(group: &GroupReport) -> Option<String> {
    group.hidden?;
    let largest = group.region("all")?.measures.get(Measure::Max)?;
    let why = "differs only where values are clipped, which no bound sees";
    (largest == 0.0).then(|| format!("{} {why}: {}", group.label(), group.remedy()))
}

/// Values beyond one of the data windows, where no bound is over the whole image, or clipping leaves nothing of them.
fn beyond(group: &GroupReport, sees: bool) -> Option<String> {
    let count = group.beyond?;
    let largest = group.region("all")?.measures.get(Measure::Max);
    let why = "values that are not 0 lie in one of the data windows only, which no bound sees: give one over the whole image";
    (!sees || largest == Some(0.0)).then(|| format!("{}: {count} {why}", group.label()))
}

/// The value that a bound is for. Changes are known of missing pixels alone where there is a mask, and need not be called so.
fn value(group: &GroupReport, bound: &Bound) -> Option<f64> {
    let of = |region: &str| group.region(region).and_then(|region| region.measures.get(bound.measure));
    let missing = bound.region == "all" && bound.measure.is_change();
    of(bound.region).or_else(|| of("missing").filter(|_| missing))
}

fn broken(group: &GroupReport, bound: &Bound, below: bool) -> Option<String> {
    let name = bound.measure.name();
    let of = if bound.region == "all" { String::new() } else { format!(" over {}", bound.region) };
    match value(group, bound) {
        None => {
            let moves = bound.measure.follows_motion();
            let why =
                if moves { ": the motion since the frame before is not known, as beyond a cut" } else { "" };
            Some(format!("{}: no {name}{of}{why}", group.label()))
        }
        Some(value) if below && (value < bound.value || value.is_nan()) => {
            Some(format!("{}: {name}{of} {} is below {}", group.label(), short(value), bound.value))
        }
        Some(value) if !below && (value > bound.value || value.is_nan()) => {
            Some(format!("{}: {name}{of} {} is above {}", group.label(), short(value), bound.value))
        }
        Some(_) => None,
    }
}

/// A value with enough digits to see on which side of a bound it is; counts are whole.
fn short(value: f64) -> String {
    if value == value.trunc() {
        format!("{value}")
    } else if value.abs() >= 1e-3 {
        format!("{value:.6}")
    } else {
        format!("{value:.4e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_read_and_nonsense_refused() {
        let bound: Bound = "missing.psnr=38.5".parse().unwrap();
        assert_eq!(bound, Bound { measure: Measure::Psnr, region: "missing", value: 38.5 });
        assert_eq!("ssim=0.98".parse::<Bound>().unwrap().region, "all");
        for text in ["", "psnr", "psnr=", "psnr=x", "psnr=nan", "PSNR=3", "hole.psnr=3", "=3"] {
            assert!(text.parse::<Bound>().is_err(), "{text}");
        }
    }
}
