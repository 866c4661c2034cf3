//! The figures of a study: PSNR and time against missing pixels, and what an even pattern is worth beside a random one.

use super::chart::{Chart, Line};
use super::rows::Row;
use crate::report::Mean;

/// What figures show, as their names begin.
pub(super) const KINDS: [&str; 3] = [PSNR, SECONDS, GAIN];
const PSNR: &str = "psnr";
const SECONDS: &str = "seconds";
const GAIN: &str = "gain";
const MISSING: &str = "missing pixels (%)";

/// A figure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Figure {
    /// The file's name without its ending.
    pub name: String,
    /// What it shows.
    pub title: String,
    /// The picture.
    pub svg: String,
}

/// Values in the order in which they come first.
pub fn distinct<'a>(values: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut all = Vec::new();
    for value in values {
        if !all.contains(&value) {
            all.push(value);
        }
    }
    all
}

/// The densities that were asked for, the largest first.
pub fn densities<'a>(rows: impl Iterator<Item = &'a Row>) -> Vec<f64> {
    let mut all: Vec<f64> = rows.map(|row| row.density).collect();
    all.sort_by(|a, b| b.total_cmp(a));
    all.dedup();
    all
}

/// The figures of all frames: for each PSNR, time, and the gain over random samples where there are any.
///
/// # Errors
/// A chart that cannot be drawn.
pub fn figures(rows: &[Row]) -> Result<Vec<Figure>, String> {
    let mut all = Vec::new();
    for frame in distinct(rows.iter().map(|row| row.frame.as_str())) {
        let own: Vec<&Row> = rows.iter().filter(|row| row.frame == frame && row.error.is_none()).collect();
        if own.is_empty() {
            continue;
        }
        all.extend(figure(frame, PSNR, &own)?);
        all.extend(figure(frame, SECONDS, &own)?);
        if own.iter().any(|row| row.pattern == "random") && own.iter().any(|row| row.pattern != "random") {
            all.extend(figure(frame, GAIN, &own)?);
        }
    }
    Ok(all)
}

/// Nothing where no line has a point, as PSNR of frames that every filter matches to the bit.
fn figure(frame: &str, kind: &'static str, rows: &[&Row]) -> Result<Option<Figure>, String> {
    let filters = distinct(rows.iter().map(|row| row.filter.as_str()));
    let mut patterns = distinct(rows.iter().map(|row| row.pattern.as_str()));
    // The even patterns in solid lines, the random one dashed.
    patterns.sort_by_key(|pattern| *pattern == "random");
    if kind == GAIN {
        patterns.retain(|pattern| *pattern != "random");
    }
    let mut lines = Vec::new();
    for (style, pattern) in patterns.iter().enumerate() {
        for (name, filter) in filters.iter().enumerate() {
            let own = rows.iter().copied().filter(|row| row.filter == *filter);
            let points = match kind {
                GAIN => gain(&own, pattern),
                SECONDS => points(own, pattern, &|row| Some(row.seconds)),
                _ => points(own, pattern, &plotted),
            };
            if !points.is_empty() {
                lines.push(Line { name, style, points });
            }
        }
    }
    if lines.is_empty() {
        return Ok(None);
    }
    let (title, y) = match kind {
        GAIN => (format!("{frame}: gain over random samples"), "PSNR less that of random (dB)"),
        SECONDS => (format!("{frame}: time of filling"), "processor time, one thread (s)"),
        _ => (format!("{frame}: quality"), "PSNR (dB)"),
    };
    let chart = Chart {
        title: title.clone(),
        x: MISSING,
        y,
        log: kind == SECONDS,
        span: (0.0, 100.0),
        names: filters.iter().map(ToString::to_string).collect(),
        styles: patterns.iter().map(ToString::to_string).collect(),
        lines,
    };
    Ok(Some(Figure { name: format!("{kind}-{frame}"), title, svg: chart.svg()? }))
}

/// The PSNR that an axis has: equal images have an infinite one.
fn plotted(row: &Row) -> Option<f64> {
    row.psnr().filter(|psnr| psnr.is_finite())
}

/// Per density, by growing share of missing pixels: that share in percent; mean ([`Mean`]), least and largest value of the seeds.
pub fn points<'a>(
    rows: impl Iterator<Item = &'a Row>,
    pattern: &str,
    value: &dyn Fn(&Row) -> Option<f64>,
) -> Vec<[f64; 4]> {
    let mut found: Vec<(f64, f64, Vec<f64>)> = Vec::new();
    for row in rows.filter(|row| row.pattern == pattern) {
        let Some(value) = value(row).filter(|value| !value.is_nan()) else { continue };
        match found.iter_mut().find(|(density, ..)| *density == row.density) {
            Some((_, missing, values)) => {
                *missing += row.missing;
                values.push(value);
            }
            None => found.push((row.density, row.missing, vec![value])),
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let point = |(_, missing, values): &(f64, f64, Vec<f64>)| {
        let mean = Mean::of(values.iter().copied()).map_or(f64::NAN, |mean| mean.value);
        let (low, high) =
            values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
        [100.0 * missing / values.len() as f64, mean, low, high]
    };
    found.iter().map(point).collect()
}

/// PSNR of a pattern less that of random samples, density by density.
fn gain<'a>(rows: &(impl Iterator<Item = &'a Row> + Clone), pattern: &str) -> Vec<[f64; 4]> {
    let mut found = Vec::new();
    for density in densities(rows.clone().filter(|row| row.pattern == pattern)) {
        let at = |pattern: &str| {
            let own = rows.clone().filter(|row| row.density == density);
            points(own, pattern, &plotted).first().copied()
        };
        if let (Some(even), Some(random)) = (at(pattern), at("random")) {
            let by = even[1] - random[1];
            found.push([even[0], by, by, by]);
        }
    }
    found
}
