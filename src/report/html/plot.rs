//! A measure over the frames as an inline SVG, readable in print and in both colour schemes.

use std::fmt::Write;

use super::escape;
use crate::report::Measure;

const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 220.0;
/// Left, right, top, bottom of the axes.
const FRAME: [f64; 4] = [58.0, 448.0, 30.0, 178.0];

/// A region's name and its value in each frame.
type Line<'a> = (&'a str, Vec<Option<f64>>);

/// The plot, as HTML.
pub fn plot(measure: Measure, labels: &[String], lines: &[Line<'_>]) -> String {
    let values = || lines.iter().flat_map(|(_, values)| values.iter().flatten().copied());
    let (low, high) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    let ticks = ticks(low, high);
    let (low, high) = (ticks[0].min(low), ticks[ticks.len() - 1].max(high));
    let [left, right, top, bottom] = FRAME;
    let last = (labels.len().max(2) - 1) as f64;
    let at_x = |index: usize| left + (right - left) * index as f64 / last;
    let at_y = |value: f64| bottom - (bottom - top) * (value - low) / (high - low);
    let name = super::table::heading(measure);
    let mut svg = format!(
        "<figure class=\"plot\"><svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{name} over the frames\">\
         <text class=\"title\" x=\"{left}\" y=\"16\">{name}</text>"
    );
    for &tick in &ticks {
        let y = at_y(tick);
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{left}\" x2=\"{right}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>\
             <text class=\"tick\" text-anchor=\"end\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            left - 6.0,
            y + 4.0,
            number(tick, ticks[1] - ticks[0])
        );
    }
    let step = labels.len().div_ceil(8).max(1);
    for (index, label) in labels.iter().enumerate().step_by(step) {
        let short: String = label.chars().take(8).collect();
        let _ = write!(
            svg,
            "<text class=\"tick\" text-anchor=\"middle\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            at_x(index),
            bottom + 16.0,
            escape(&short)
        );
    }
    let _ = write!(
        svg,
        "<text class=\"tick\" text-anchor=\"middle\" x=\"{:.1}\" y=\"{:.1}\">frame</text>",
        f64::midpoint(left, right),
        bottom + 34.0
    );
    for (number, (region, values)) in lines.iter().enumerate() {
        let mut path = String::new();
        let mut pen = 'M';
        for (index, value) in values.iter().enumerate() {
            match value {
                Some(value) => {
                    let _ = write!(path, "{pen}{:.1} {:.1}", at_x(index), at_y(*value));
                    pen = 'L';
                }
                None => pen = 'M',
            }
        }
        let key = right - 70.0 * (lines.len() - number) as f64 + 70.0;
        let _ = write!(
            svg,
            "<path class=\"line {region}\" d=\"{path}\"/><text class=\"key {region}\" text-anchor=\"end\" x=\"{key:.1}\" y=\"16\">{region}</text>"
        );
        for (index, value) in values.iter().enumerate().filter_map(|(index, value)| Some((index, (*value)?)))
        {
            let _ = write!(
                svg,
                "<circle class=\"{region}\" r=\"2.5\" cx=\"{:.1}\" cy=\"{:.1}\"><title>frame {}: {}</title></circle>",
                at_x(index),
                at_y(value),
                escape(&labels[index]),
                super::table::cell(measure, Some(value))
            );
        }
    }
    svg.push_str("</svg></figure>\n");
    svg
}

/// Three to seven round numbers that span a range.
fn ticks(low: f64, high: f64) -> Vec<f64> {
    let span = (high - low).max(high.abs() * 1e-6).max(1e-12);
    let rough = span / 4.0;
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|k| k * power).find(|&step| step >= rough);
    let step = step.unwrap_or(10.0 * power);
    let first = (low / step).floor() as i64;
    let last = ((high / step).ceil() as i64).max(first + 1);
    (first..=last).map(|k| k as f64 * step).collect()
}

/// A tick with as many digits as its step needs.
fn number(value: f64, step: f64) -> String {
    let digits = (-step.log10().floor()).clamp(0.0, 12.0) as usize;
    if digits > 5 { format!("{value:.1e}") } else { format!("{value:.digits$}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_span_the_range() {
        assert_eq!(ticks(41.2, 48.9), [40.0, 42.0, 44.0, 46.0, 48.0, 50.0]);
        for (low, high) in [(0.0, 0.0), (1.0, 1.0), (-3.0, 5.0), (0.97, 0.9701), (1e-9, 2e-9)] {
            let ticks = ticks(low, high);
            assert!((2..=8).contains(&ticks.len()), "{ticks:?}");
            assert!(ticks[0] <= low && ticks[ticks.len() - 1] >= high, "{ticks:?}");
        }
    }

    #[test]
    fn a_plot_has_a_line_a_region_and_skips_gaps() {
        let labels: Vec<String> = (1..=4).map(|k| k.to_string()).collect();
        let lines =
            [("all", vec![Some(40.0), None, Some(42.0), Some(41.0)]), ("missing", vec![Some(39.0); 4])];
        let svg = plot(Measure::Psnr, &labels, &lines);
        assert_eq!(svg.matches("<path").count(), 2);
        assert_eq!(svg.matches("<circle").count(), 7);
        assert_eq!(svg.matches('M').count(), 3);
        assert!(svg.contains("psnr (dB)"));
    }
}
