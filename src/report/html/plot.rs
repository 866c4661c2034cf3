//! A measure over the frames as an inline SVG, readable in print and in both colour schemes.

use std::fmt::Write;

use super::escape;

const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 220.0;
/// Left, right, top, bottom of the axes.
const FRAME: [f64; 4] = [58.0, 448.0, 30.0, 178.0];

/// A line: its name, the class that gives it its colour, and its value in each frame.
pub struct Series<'a> {
    /// What the key calls it.
    pub name: &'a str,
    /// A class of the style sheet: `all`, `missing` or `alpha`.
    pub class: &'a str,
    /// Per frame.
    pub values: Vec<Option<f64>>,
}

/// How a value reads.
type Cell<'a> = &'a dyn Fn(f64) -> String;

/// Where values and frames lie.
struct Axes {
    low: f64,
    high: f64,
    last: f64,
}

impl Axes {
    fn x(&self, index: usize) -> f64 {
        FRAME[0] + (FRAME[1] - FRAME[0]) * index as f64 / self.last
    }

    fn y(&self, value: f64) -> f64 {
        FRAME[3] - (FRAME[3] - FRAME[2]) * (value - self.low) / (self.high - self.low)
    }
}

/// The plot, as HTML; `name` is HTML, with its unit.
pub fn plot(name: &str, cell: Cell<'_>, labels: &[String], lines: &[Series<'_>]) -> String {
    let values = || lines.iter().flat_map(|line| line.values.iter().flatten().copied());
    let (low, high) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    let ticks = ticks(low, high);
    let last = (labels.len().max(2) - 1) as f64;
    let axes = Axes { low: ticks[0].min(low), high: ticks[ticks.len() - 1].max(high), last };
    let mut svg = format!(
        "<figure class=\"plot\"><svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{name} over the frames\">\
         <text class=\"title\" x=\"{}\" y=\"16\">{name}</text>",
        FRAME[0]
    );
    grid(&axes, &ticks, labels, &mut svg);
    for (number, line) in lines.iter().enumerate() {
        let key = FRAME[1] - 70.0 * (lines.len() - 1 - number) as f64;
        draw(cell, &axes, labels, line, key, &mut svg);
    }
    svg.push_str("</svg></figure>\n");
    svg
}

/// Grid lines, ticks and the name of the axis.
fn grid(axes: &Axes, ticks: &[f64], labels: &[String], svg: &mut String) {
    let [left, right, _, bottom] = FRAME;
    for &tick in ticks {
        let y = axes.y(tick);
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
    let short = short(labels);
    let anchor = |index: usize| if index > 0 && index + 1 == labels.len() { "end" } else { "middle" };
    let named = (0..labels.len()).step_by(step).map(|at| (axes.x(at), 16.0, short[at].as_str(), anchor(at)));
    for (x, below, label, anchor) in named.chain([(f64::midpoint(left, right), 34.0, "frame", "middle")]) {
        let _ = write!(
            svg,
            "<text class=\"tick\" text-anchor=\"{anchor}\" x=\"{x:.1}\" y=\"{:.1}\">{}</text>",
            bottom + below,
            escape(label)
        );
    }
}

/// Labels that fit below an axis: long ones without what all of them begin with, cut.
fn short(labels: &[String]) -> Vec<String> {
    const MOST: usize = 8;
    if labels.iter().all(|label| label.chars().count() <= MOST) {
        return labels.to_vec();
    }
    let alike = |a: &String, b: &String| a.chars().zip(b.chars()).take_while(|(a, b)| a == b).count();
    let common = labels.iter().map(|label| alike(label, &labels[0])).min().unwrap_or(0);
    let common = if labels.len() > 1 { common } else { 0 };
    labels.iter().map(|label| label.chars().skip(common).take(MOST).collect()).collect()
}

/// One line, with gaps where there is no value, its points and its name.
fn draw(
    cell: Cell<'_>,
    axes: &Axes,
    labels: &[String],
    Series { name, class, values }: &Series<'_>,
    key: f64,
    svg: &mut String,
) {
    let mut path = String::new();
    let mut pen = 'M';
    for (index, value) in values.iter().enumerate() {
        pen = match value {
            Some(value) => {
                let _ = write!(path, "{pen}{:.1} {:.1}", axes.x(index), axes.y(*value));
                'L'
            }
            None => 'M',
        };
    }
    let _ = write!(
        svg,
        "<path class=\"line {class}\" d=\"{path}\"/>\
         <text class=\"key {class}\" text-anchor=\"end\" x=\"{key:.1}\" y=\"16\">{name}</text>"
    );
    for (index, value) in values.iter().enumerate().filter_map(|(index, value)| Some((index, (*value)?))) {
        let _ = write!(
            svg,
            "<circle class=\"{class}\" r=\"2.5\" cx=\"{:.1}\" cy=\"{:.1}\"><title>frame {}: {}</title></circle>",
            axes.x(index),
            axes.y(value),
            escape(&labels[index]),
            cell(value)
        );
    }
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
            // Multiples of a step are rounded.
            let slack = 4.0 * f64::EPSILON * high.abs();
            assert!(ticks[0] <= low + slack && ticks[ticks.len() - 1] >= high - slack, "{ticks:?}");
        }
    }

    #[test]
    fn long_labels_keep_what_tells_them_apart() {
        let of = |labels: &[&str]| short(&labels.iter().map(ToString::to_string).collect::<Vec<_>>());
        assert_eq!(of(&["10", "11", "12"]), ["10", "11", "12"]);
        assert_eq!(of(&["scene_alpha_a.exr", "scene_alpha_b.exr"]), ["a.exr", "b.exr"]);
    }

    #[test]
    fn a_plot_has_a_line_a_region_and_skips_gaps() {
        let labels: Vec<String> = (1..=4).map(|k| k.to_string()).collect();
        let series = |name: &'static str, values| Series { name, class: name, values };
        let lines = [
            series("all", vec![Some(40.0), None, Some(42.0), Some(41.0)]),
            series("missing", vec![Some(39.0); 4]),
        ];
        let svg = plot("psnr (dB)", &|value| value.to_string(), &labels, &lines);
        assert_eq!(svg.matches("<path").count(), 2);
        assert_eq!(svg.matches("<circle").count(), 7);
        assert_eq!(svg.matches('M').count(), 3);
        assert!(svg.contains("psnr (dB)"));
    }
}
