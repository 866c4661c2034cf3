//! The page of a run that has no reference (`--report`): pictures are taken while frames are there, the rest is the records'.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use lacuna_exr::Frame;
use lacuna_filters::Mask;
use serde_json::Value;

use crate::channels::{is_albedo, is_light, rgb_place};
use crate::files::plan::Item;
use crate::files::reports;
use crate::reconstruct::{Estimated, Interval, behind, named, parse_settings};
use crate::report::{Filled, FilledPictures, MOST_PIXELS, filled};
use crate::run::record::{Estimate, Heading, Record, told_residual};

/// Pictures by output, until the run ends.
pub struct Page {
    path: Option<PathBuf>,
    width: usize,
    /// How many pixels the page can still hold.
    room: AtomicUsize,
    pictures: Mutex<BTreeMap<PathBuf, FilledPictures>>,
}

impl Page {
    /// A page for so many frames; nothing is done without a path.
    pub fn new(path: Option<&PathBuf>, frames: usize) -> Self {
        let width = if frames <= 50 { 180 } else { 96 };
        Self { path: path.cloned(), width, room: MOST_PIXELS.into(), pictures: Mutex::default() }
    }

    /// Takes the pictures of a frame, filled or sparse still; `mask` is that of a part and channel.
    pub fn look<'a>(
        &self,
        item: &Item,
        frame: &Frame,
        mask: impl Fn(usize, usize) -> Option<&'a Mask>,
        filled: bool,
    ) {
        if self.path.is_none() {
            return;
        }
        let room = self.room.load(Ordering::Relaxed);
        if let Some(pictures) = FilledPictures::new(frame, mask, filled, (self.width, room)) {
            let taken = pictures.pixels.as_ref().map_or(0, |pixels| pixels.width * pixels.height);
            let less = |room: usize| Some(room.saturating_sub(taken));
            let _ = self.room.fetch_update(Ordering::Relaxed, Ordering::Relaxed, less);
            let mut all = self.pictures.lock().unwrap_or_else(PoisonError::into_inner);
            all.insert(item.output.clone(), pictures);
        }
    }

    /// Writes the page, if one was asked for.
    pub fn write(&self, heading: &Heading, records: &[Record]) -> Result<(), String> {
        let Some(path) = &self.path else { return Ok(()) };
        let mut pictures = self.pictures.lock().unwrap_or_else(PoisonError::into_inner);
        let frames: Vec<Filled> =
            records.iter().map(|record| shown(record, pictures.remove(Path::new(&record.output)))).collect();
        let mut about = vec![("lacuna".to_owned(), format!("{} {}", heading.lacuna, heading.command))];
        about.extend(heading.filter.iter().map(|filter| ("filter".to_owned(), filter.clone())));
        about.extend(heading.settings.iter().flat_map(|settings| listed(settings)));
        let page = filled(&title(heading, records), &about, &frames);
        reports::write(path, page.as_bytes())
    }
}

/// The settings of a line one by one; what is a JSON object has a name for each of its values.
fn listed(line: &str) -> Vec<(String, String)> {
    let mut all = Vec::new();
    for (name, text) in parse_settings(line) {
        match serde_json::from_str(&text) {
            Ok(value @ Value::Object(_)) => flatten(&name, &value, &mut all),
            _ => all.push((name, text)),
        }
    }
    all.retain(|(_, text)| !text.is_empty());
    all
}

fn flatten(name: &str, value: &Value, all: &mut Vec<(String, String)>) {
    match value {
        Value::Object(inner) => {
            for (key, value) in inner {
                flatten(&format!("{name}.{key}"), value, all);
            }
        }
        Value::Null => {}
        Value::String(text) => all.push((name.to_owned(), text.clone())),
        _ => all.push((name.to_owned(), value.to_string())),
    }
}

fn title(heading: &Heading, records: &[Record]) -> String {
    let name = |record: &Record| {
        Path::new(&record.output).file_name().map(|name| name.display().to_string()).unwrap_or_default()
    };
    let what = if heading.command == "render" { "rendered" } else { "filled" };
    match records {
        [one] => format!("{} {what}", name(one)),
        // How many were done stands below.
        [first, .., last] => format!("{} to {}, {what}", name(first), name(last)),
        [] => "No frames".into(),
    }
}

fn shown(record: &Record, pictures: Option<FilledPictures>) -> Filled {
    let name = Path::new(&record.output).file_name().map(|name| name.display().to_string());
    let mut words = Vec::new();
    words.extend(record.mask.iter().map(|mask| ("mask", mask.clone())));
    words.extend(record.rules.iter().map(|rules| ("channels", rules.clone())));
    words.extend(record.chosen.iter().map(|chosen| ("filters", chosen.clone())));
    let estimate = |of: &Estimate| {
        let line = format!("{}: {}", named(&of.channels).join(", "), of.error);
        ("estimate", behind(of.part.as_deref(), &line))
    };
    words.extend(record.estimates.iter().map(estimate));
    if let Some(outcome) = record.outcome {
        let mut text = format!("{} iterations", outcome.iterations);
        text +=
            &told_residual(outcome).map_or_else(String::new, |residual| format!(", residual {residual:.1e}"));
        text += &outcome.gap.map_or_else(String::new, |gap| format!(", relative gap {gap:.1e}"));
        words.push(("solver", text));
    }
    let most = record.largest_move.unwrap_or_default();
    let limited = record.limited.filter(|count| *count > 0);
    words.extend(limited.map(|count| ("limited values", format!("{count}, by at most {most:.2e}"))));
    for (what, count) in
        [("values that are not finite", record.non_finite), ("clamped halves", record.clamped_halves)]
    {
        words.extend(count.filter(|count| *count > 0).map(|count| (what, count.to_string())));
    }
    let seconds = record.seconds;
    let stages = match (record.rendered, record.filled) {
        (Some(rendered), filled) => {
            // A volume may be made rather than read, and is made ready for rays.
            let before = [("volume", seconds.read), ("render", rendered)].into_iter();
            before.chain(filled.map(|filled| ("fill", filled))).chain([("write", seconds.write)]).collect()
        }
        // Nothing was done, and the stages of this command are not known.
        _ if record.steps_done() == 0 => Vec::new(),
        _ => vec![("read", seconds.read), ("solve", seconds.solve), ("write", seconds.write)],
    };
    let state = serde_json::to_value(record.state).ok().and_then(|state| Some(state.as_str()?.to_owned()));
    Filled {
        label: record.frame.map(|number| number.to_string()).or(name).unwrap_or_default(),
        files: [record.input.clone(), record.output.clone()],
        state: state.unwrap_or_default(),
        messages: record.message.iter().chain(&record.warnings).cloned().collect(),
        density: record.density,
        psnr: worst(&record.estimates),
        untold: record.estimates.iter().any(is_untold),
        words,
        seconds: stages,
        pictures,
    }
}

fn is_colour(estimate: &Estimate) -> bool {
    estimate.channels.iter().all(|name| is_light(name) && !is_albedo(name))
        && estimate.channels.iter().any(|name| rgb_place(name).is_some())
}

fn is_untold(estimate: &Estimate) -> bool {
    is_colour(estimate) && !matches!(estimate.error, Estimated::Error { .. } | Estimated::Copied { .. })
}

/// The channels whose estimate is the worst, and it: of colour, which people look at; of others where there is none.
fn worst(estimates: &[Estimate]) -> Option<(String, Interval)> {
    let has_colour = estimates.iter().any(is_colour);
    let known = estimates.iter().filter(|of| is_colour(of) || !has_colour).filter_map(|of| match of.error {
        Estimated::Error { psnr, .. } => Some((of, psnr?)),
        _ => None,
    });
    let (of, psnr) = known.min_by(|a, b| a.1.estimate.total_cmp(&b.1.estimate))?;
    Some((behind(of.part.as_deref(), &named(&of.channels).join(", ")), psnr))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_estimate_that_is_told_is_that_of_the_worst_colour() {
        let of = |channels: &[&str], error: Estimated| Estimate {
            part: None,
            channels: channels.iter().map(|name| (*name).to_owned()).collect(),
            error,
            exponent: None,
        };
        let at = |estimate: f64| {
            let interval = Interval { estimate, low: estimate - 1.0, high: estimate + 1.0 };
            Estimated::Error { rmse: interval, psnr: Some(interval), unclipped_rmse: None }
        };
        let told = |estimates: Vec<Estimate>| {
            let frame = shown(&Record { estimates, ..Record::default() }, None);
            (frame.psnr.map(|(names, psnr)| (names, psnr.estimate)), frame.untold)
        };
        let colours =
            |error| vec![of(&["A"], at(20.0)), of(&["B", "G", "R"], at(30.0)), of(&["direct.R"], error)];
        assert_eq!(told(colours(at(35.0))), (Some(("R, G, B".into(), 30.0)), false));
        assert_eq!(told(colours(at(25.0))), (Some(("direct.R".into(), 25.0)), false));
        let bound = Estimated::Bound { rmse_at_most: 0.1, psnr_at_least: 20.0 };
        assert_eq!(told(colours(bound)), (Some(("R, G, B".into(), 30.0)), true));
        assert_eq!(told(vec![of(&["A"], at(20.0))]), (Some(("A".into(), 20.0)), false));
    }

    #[test]
    fn settings_are_told_one_by_one() {
        let line = r#"lambda=0 mask="" channels="a:fill b:keep" scene={"camera":{"orbit":1.5},"volume":"a b.nrrd","raw":null} fill=ss"#;
        let found = listed(line);
        let found: Vec<_> = found.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
        assert_eq!(
            found,
            [
                ("lambda", "0"),
                ("channels", "a:fill b:keep"),
                ("scene.camera.orbit", "1.5"),
                ("scene.volume", "a b.nrrd"),
                ("fill", "ss"),
            ]
        );
    }
}
