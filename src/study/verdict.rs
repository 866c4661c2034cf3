//! What the results come to, class by class: how many pixels may be missing, by fixed thresholds of PSNR.

use std::fmt::Write;

use super::definition::Thresholds;
use super::figures::{distinct, points};
use super::rows::Row;
use super::selection::HALF;

/// The verdict on one filter, or on the best of all, for the frames of one class.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// The class.
    pub class: String,
    /// Its frames.
    pub frames: Vec<String>,
    /// The filter; `None` for the best one at each density.
    pub filter: Option<String>,
    /// In words.
    pub text: String,
}

/// The pattern that verdicts are about: `shuffle` if the study has it, else its first one with filters to choose from.
fn pattern(rows: &[Row]) -> &str {
    let all = distinct(rows.iter().map(|row| row.pattern.as_str()));
    let has_filters = |name: &&&str| **name != HALF;
    let found = all.iter().find(|name| **name == "shuffle").or_else(|| all.iter().find(has_filters));
    found.or(all.first()).copied().unwrap_or_default()
}

/// Verdicts class by class: one a filter, and one on the best.
pub fn verdicts(rows: &[Row], thresholds: Thresholds) -> Vec<Verdict> {
    let pattern = pattern(rows);
    let filters = distinct(rows.iter().filter(|row| row.pattern == pattern).map(|row| row.filter.as_str()));
    let mut all = Vec::new();
    for class in distinct(rows.iter().map(|row| row.class.as_str())) {
        let own: Vec<&Row> = rows.iter().filter(|row| row.class == class && row.error.is_none()).collect();
        let frames = distinct(own.iter().map(|row| row.frame.as_str()));
        let curves: Vec<_> = filters.iter().map(|filter| worst(&own, &frames, filter, pattern)).collect();
        let best = best(&curves);
        let named = filters.iter().map(|filter| Some(filter.to_string())).chain([None]);
        for (filter, curve) in named.zip(curves.iter().chain([&best])) {
            all.push(Verdict {
                class: class.into(),
                frames: frames.iter().map(ToString::to_string).collect(),
                filter,
                text: judge(curve, thresholds),
            });
        }
    }
    all
}

/// Per density, fewest missing first: missing pixels in percent, and the PSNR of the worst frame.
type Curve = Vec<(f64, f64)>;

fn worst(rows: &[&Row], frames: &[&str], filter: &str, pattern: &str) -> Curve {
    let mut all: Curve = Vec::new();
    for frame in frames {
        let own = rows.iter().copied().filter(|row| row.filter == filter && row.frame == *frame);
        for [missing, psnr, ..] in points(own, pattern, &Row::psnr) {
            match all.iter_mut().find(|point| point.0.round() == missing.round()) {
                Some(point) => point.1 = point.1.min(psnr),
                None => all.push((missing, psnr)),
            }
        }
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all
}

fn best(curves: &[Curve]) -> Curve {
    let mut all: Curve = Vec::new();
    for &(missing, psnr) in curves.iter().flatten() {
        match all.iter_mut().find(|point| point.0.round() == missing.round()) {
            Some(point) => point.1 = point.1.max(psnr),
            None => all.push((missing, psnr)),
        }
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all
}

/// Up to how many missing pixels the PSNR keeps a threshold.
fn up_to(curve: &Curve, threshold: f64) -> Option<f64> {
    curve.iter().take_while(|point| point.1 >= threshold).last().map(|point| point.0)
}

fn judge(curve: &Curve, Thresholds { good, acceptable }: Thresholds) -> String {
    let (Some(first), Some(last)) = (curve.first(), curve.last()) else { return "no result".into() };
    let (good, acceptable) = (up_to(curve, good), up_to(curve, acceptable));
    match (good, acceptable) {
        (Some(most), _) if most == last.0 => format!("good throughout, to {most:.0} % missing"),
        (Some(most), Some(limit)) if limit == last.0 => {
            format!("good to {most:.0} % missing, acceptable beyond")
        }
        (Some(most), limit) => {
            let limit = limit.unwrap_or(most);
            format!("good to {most:.0} % missing, acceptable to {limit:.0} %")
        }
        (None, Some(most)) if most == last.0 => format!("acceptable throughout, to {most:.0} % missing"),
        (None, Some(most)) => format!("acceptable to {most:.0} % missing"),
        (None, None) => format!("not acceptable, even with {:.0} % missing", first.0),
    }
}

/// Verdicts and PSNR as Markdown.
pub fn tables(rows: &[Row], thresholds: Thresholds) -> String {
    let pattern = pattern(rows);
    let filters = distinct(rows.iter().filter(|row| row.pattern == pattern).map(|row| row.filter.as_str()));
    let mut text = format!(
        "Verdict (worst frame of the class, `{pattern}`; good from {} dB, acceptable from {} dB):\n\n",
        thresholds.good, thresholds.acceptable
    );
    let _ = writeln!(text, "| class | frames | best filter each time | {} |", filters.join(" | "));
    let _ = writeln!(text, "|---|---|---|{}", "---|".repeat(filters.len()));
    let verdicts = verdicts(rows, thresholds);
    for class in verdicts.chunk_by(|a, b| a.class == b.class) {
        let cells: Vec<&str> = class.iter().filter(|v| v.filter.is_some()).map(|v| v.text.as_str()).collect();
        let best = class.iter().find(|verdict| verdict.filter.is_none()).map_or("", |verdict| &verdict.text);
        let (name, frames) = (&class[0].class, class[0].frames.join(", "));
        let _ = writeln!(text, "| {name} | {frames} | **{best}** | {} |", cells.join(" | "));
    }
    for (what, digits, value) in [
        ("PSNR in dB", 2, &Row::psnr as Value<'_>),
        ("Flicker", 5, &|row| row.flicker),
        ("Processor seconds", 2, &|row| Some(row.seconds)),
    ] {
        for pattern in distinct(rows.iter().map(|row| row.pattern.as_str())) {
            let shown = |row: &&Row| row.pattern == pattern && (value(row).is_some() || row.error.is_some());
            let own: Vec<Row> = rows.iter().filter(shown).cloned().collect();
            if own.iter().any(|row| value(row).is_some()) {
                let _ = writeln!(text, "\n{what}, `{pattern}`, by missing pixels:\n");
                table(&own, (digits, value), &mut text);
            }
        }
    }
    text
}

/// What a table shows of a row.
type Value<'a> = &'a dyn Fn(&Row) -> Option<f64>;

/// The share of missing pixels that was asked for by a density, and that which came where it is another.
fn missing(rows: &[Row], density: f64) -> String {
    let own = rows.iter().filter(|row| row.density.to_bits() == density.to_bits() && row.error.is_none());
    let (sum, count) = own.fold((0.0, 0_usize), |(sum, count), row| (sum + row.missing, count + 1));
    let asked = 1.0 - density;
    let came = if count == 0 { asked } else { sum / count as f64 };
    let is_other = (came - asked).abs() > 0.01;
    format!("{:.0} %", 100.0 * asked)
        + &if is_other { format!(" ({:.0} %)", 100.0 * came) } else { String::new() }
}

/// A line a frame and filter, a column a density, of one pattern's rows.
fn table(rows: &[Row], (digits, value): (usize, Value<'_>), text: &mut String) {
    let filters = distinct(rows.iter().map(|row| row.filter.as_str()));
    let mut densities: Vec<f64> = rows.iter().map(|row| row.density).collect();
    densities.sort_by(|a, b| b.total_cmp(a));
    densities.dedup();
    let head: Vec<String> = densities.iter().map(|&density| missing(rows, density)).collect();
    let _ = writeln!(text, "| frame | filter | {} |", head.join(" | "));
    let _ = writeln!(text, "|---|---|{}", "---:|".repeat(head.len()));
    for frame in distinct(rows.iter().map(|row| row.frame.as_str())) {
        for filter in &filters {
            let cells: Vec<String> = densities
                .iter()
                .map(|density| {
                    let own = rows.iter().filter(|row| {
                        row.frame == frame
                            && row.filter == *filter
                            && row.density == *density
                            && row.error.is_none()
                    });
                    let found = points(own, &rows[0].pattern, value).first().map(|point| point[1]);
                    found.map_or_else(String::new, |value| format!("{value:.digits$}"))
                })
                .collect();
            let _ = writeln!(text, "| {frame} | {filter} | {} |", cells.join(" | "));
        }
    }
}
