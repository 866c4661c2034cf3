//! What the results come to, class by class: how many pixels may be missing, by fixed thresholds of PSNR.

use std::fmt::Write;

use super::definition::Thresholds;
use super::figures::{densities, distinct, points};
use super::rows::Row;
use super::selection::HALF;
use crate::report::{Mean, escape_markdown as escape};

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
    let judged: Vec<&Row> = rows.iter().filter(|row| row.pattern == pattern).collect();
    let filters = distinct(judged.iter().map(|row| row.filter.as_str()));
    let mut all = Vec::new();
    for class in distinct(rows.iter().map(|row| row.class.as_str())) {
        let own: Vec<&Row> = judged.iter().copied().filter(|row| row.class == class).collect();
        let frames = distinct(own.iter().map(|row| row.frame.as_str()));
        let densities = densities(own.iter().copied());
        let missing: Vec<f64> = densities.iter().map(|&density| came(own.iter().copied(), density)).collect();
        let missing = percents(&missing);
        let worst = |filter: &&str, density: f64| {
            let at = own.iter().copied().filter(|row| row.filter == **filter && row.density == density);
            frames
                .iter()
                .filter_map(|frame| psnr(at.clone().filter(|row| row.frame == *frame)))
                .reduce(f64::min)
        };
        let curve = |filter| densities.iter().map(|&density| worst(filter, density)).collect();
        let curves: Vec<Curve> = filters.iter().map(curve).collect();
        let best = |at: usize| curves.iter().filter_map(|curve| curve[at]).reduce(f64::max);
        let best: Curve = (0..densities.len()).map(best).collect();
        let named = filters.iter().map(|filter| Some(filter.to_string())).chain([None]);
        for (filter, curve) in named.zip(curves.iter().chain([&best])) {
            all.push(Verdict {
                class: class.into(),
                frames: frames.iter().map(ToString::to_string).collect(),
                filter,
                text: judge(&missing, curve, thresholds),
            });
        }
    }
    all
}

/// Per density, fewest missing first, the PSNR of the worst frame, if any is known.
type Curve = Vec<Option<f64>>;

/// The mean of seeds; less than any number if one failed.
fn psnr<'a>(rows: impl Iterator<Item = &'a Row>) -> Option<f64> {
    let value = |row: &Row| if row.error.is_some() { Some(f64::NEG_INFINITY) } else { row.psnr() };
    Mean::of(rows.filter_map(value).filter(|psnr| !psnr.is_nan())).map(|mean| mean.value)
}

/// The share of missing pixels that came with a density; what was asked for where none did.
fn came<'a>(rows: impl Iterator<Item = &'a Row>, density: f64) -> f64 {
    let own = rows.filter(|row| row.density.to_bits() == density.to_bits() && row.error.is_none());
    let (sum, count) = own.fold((0.0, 0_usize), |(sum, count), row| (sum + row.missing, count + 1));
    if count == 0 { 1.0 - density } else { sum / count as f64 }
}

/// Shares in percent, with as many digits as tell them apart, if a few do.
pub fn percents(shares: &[f64]) -> Vec<String> {
    let told = |digits| shares.iter().map(|share| format!("{:.digits$} %", 100.0 * share)).collect();
    let is_apart = |told: &Vec<String>| distinct(told.iter().map(String::as_str)).len() == told.len();
    (0..4).map(told).find(is_apart).unwrap_or_else(|| told(0))
}

fn judge(missing: &[String], curve: &Curve, Thresholds { good, acceptable }: Thresholds) -> String {
    if curve.iter().all(Option::is_none) {
        return "no result".into();
    }
    let up_to = |threshold: f64| {
        let holds = |psnr: &&Option<f64>| psnr.is_some_and(|psnr| psnr >= threshold);
        curve.iter().take_while(holds).count()
    };
    let told = |count: usize| missing.get(count.wrapping_sub(1)).map_or("", String::as_str);
    let (good, acceptable, all) = (up_to(good), up_to(acceptable), curve.len());
    let failed = curve.iter().zip(missing).find(|(psnr, _)| **psnr == Some(f64::NEG_INFINITY));
    let fails = failed.map(|(_, missing)| format!("fails at {missing}"));
    let kept = match (good, acceptable) {
        (0, 0) if curve[0] == Some(f64::NEG_INFINITY) => return fails.unwrap_or_default() + " missing",
        (0, 0) => format!("not acceptable, even with {} missing", missing[0]),
        (0, most) if most == all => format!("acceptable throughout, to {} missing", told(most)),
        (0, most) => format!("acceptable to {} missing", told(most)),
        (most, _) if most == all => format!("good throughout, to {} missing", told(most)),
        (most, limit) if limit == all => format!("good to {} missing, acceptable beyond", told(most)),
        (most, limit) if limit == most && fails.is_some() => format!("good to {} missing", told(most)),
        (most, limit) => format!("good to {} missing, acceptable to {}", told(most), told(limit)),
    };
    [Some(kept), fails].into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// Verdicts and PSNR as Markdown.
pub fn tables(rows: &[Row], thresholds: Thresholds) -> String {
    let pattern = pattern(rows);
    let filters = distinct(rows.iter().filter(|row| row.pattern == pattern).map(|row| row.filter.as_str()));
    let mut text = format!(
        "Verdict (worst frame of the class, `{pattern}`; good from {} dB, acceptable from {} dB):\n\n",
        thresholds.good, thresholds.acceptable
    );
    let heads: Vec<String> = filters.iter().map(|filter| escape(filter)).collect();
    let _ = writeln!(text, "| class | frames | best filter each time | {} |", heads.join(" | "));
    let _ = writeln!(text, "|---|---|---|{}", "---|".repeat(filters.len()));
    let verdicts = verdicts(rows, thresholds);
    for class in verdicts.chunk_by(|a, b| a.class == b.class) {
        let cells: Vec<&str> = class.iter().filter(|v| v.filter.is_some()).map(|v| v.text.as_str()).collect();
        let best = class.iter().find(|verdict| verdict.filter.is_none()).map_or("", |verdict| &verdict.text);
        let (name, frames) = (escape(&class[0].class), escape(&class[0].frames.join(", ")));
        let _ = writeln!(text, "| {name} | {frames} | **{best}** | {} |", cells.join(" | "));
    }
    for (what, digits, value) in [
        ("PSNR in dB", 2, &Row::psnr as Value<'_>),
        ("Frames equal to their references", 0, &|row| (row.equal > 0).then_some(row.equal as f64)),
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

/// The shares of missing pixels that were asked for by densities, each with that which came where it is another.
fn heads(rows: &[Row], densities: &[f64]) -> Vec<String> {
    let asked: Vec<f64> = densities.iter().map(|density| 1.0 - density).collect();
    let came = |(asked, density): (&f64, &f64)| {
        let came = came(rows.iter(), *density);
        if (came - asked).abs() > 0.01 { format!(" ({:.0} %)", 100.0 * came) } else { String::new() }
    };
    percents(&asked).into_iter().zip(asked.iter().zip(densities).map(came)).map(|(a, b)| a + &b).collect()
}

/// A line a frame and filter, a column a density, of one pattern's rows.
fn table(rows: &[Row], (digits, value): (usize, Value<'_>), text: &mut String) {
    let filters = distinct(rows.iter().map(|row| row.filter.as_str()));
    let densities = densities(rows.iter());
    let head = heads(rows, &densities);
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
            let _ = writeln!(text, "| {} | {} | {} |", escape(frame), escape(filter), cells.join(" | "));
        }
    }
}
