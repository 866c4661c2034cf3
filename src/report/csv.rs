//! The comparison as CSV: one line a frame, group, channel and region (RFC 4180, a head line, `\n` at the ends).

use super::measure::Measure;
use super::model::{Comparison, FrameReport, GroupReport, Measures};

/// The text.
pub fn csv(comparison: &Comparison) -> String {
    let mut head = vec!["frame", "reference", "test", "part", "layer", "channels", "region", "density"];
    head.extend(["measured_max", "measured_different"]);
    head.extend(Measure::all().map(Measure::name));
    head.extend(["failures", "error"]);
    let mut text = csv_line(head.iter().map(|&name| name.to_owned()));
    for frame in &comparison.frames {
        for group in &frame.groups {
            for region in &group.regions {
                text.push_str(&row(frame, group, &group.channels.join(" "), region.region, &region.measures));
                for (channel, measures) in &region.channels {
                    text.push_str(&row(frame, group, channel, region.region, measures));
                }
            }
        }
        let why = frame.error.as_ref().or(frame.skipped.as_ref());
        if frame.groups.is_empty() {
            let mut cells = start(frame);
            cells.resize(head.len() - 2, String::new());
            cells.extend([failures(frame), why.cloned().unwrap_or_default()]);
            text.push_str(&csv_line(cells.into_iter()));
        }
    }
    text
}

fn start(frame: &FrameReport) -> Vec<String> {
    let number = frame.frame.map_or_else(String::new, |number| number.to_string());
    vec![number, frame.reference.clone(), frame.test.clone()]
}

/// What the gate found wanting, in one cell: in every line of the frame, as its name is.
fn failures(frame: &FrameReport) -> String {
    frame.failures.join("; ")
}

fn row(
    frame: &FrameReport,
    group: &GroupReport,
    channels: &str,
    region: &str,
    measures: &Measures,
) -> String {
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    let mut cells = start(frame);
    cells.push(group.part_name.clone().unwrap_or_default());
    cells.push(group.layer.clone());
    cells.push(channels.to_owned());
    cells.push(region.to_owned());
    cells.push(number(group.density));
    cells.push(number(group.measured_max));
    cells.push(group.measured_different.map_or_else(String::new, |count| count.to_string()));
    cells.extend(Measure::all().map(|measure| number(measures.get(measure))));
    cells.extend([failures(frame), String::new()]);
    csv_line(cells.into_iter())
}

/// Cells as a line, quoted where they must be.
pub fn csv_line(cells: impl Iterator<Item = String>) -> String {
    let quoted = cells.map(|cell| {
        if cell.contains([',', '"', '\n', '\r']) {
            format!("\"{}\"", cell.replace('"', "\"\""))
        } else {
            cell
        }
    });
    let mut line = quoted.collect::<Vec<_>>().join(",");
    line.push('\n');
    line
}
