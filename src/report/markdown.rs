//! The comparison as Markdown: for pull requests, logs and terminals.

use std::fmt::Write;

use super::groups::Kind;
use super::measure::Measure;
use super::model::{Comparison, FrameReport, GroupReport, Mean, Measures};

/// Frames of a sequence that get a line each; the rest is in the sum.
const MOST_LINES: usize = 200;
/// Frames that a note names.
const MOST_NAMED: usize = 5;

/// The text: a table a region, a line a frame and group.
pub fn markdown(comparison: &Comparison) -> String {
    let mut text = String::new();
    for region in ["all", "missing", "alpha"] {
        table(comparison, region, &mut text);
    }
    let problems = comparison.frames.iter().filter_map(|frame| Some((frame, frame.error.as_ref()?)));
    for (frame, error) in problems {
        let _ = writeln!(text, "- **{}** was not compared: {}", escape(&frame.label()), escape(error));
    }
    for frame in &comparison.frames {
        for failure in &frame.failures {
            let _ = writeln!(text, "- **{}** fails: {}", escape(&frame.label()), escape(failure));
        }
    }
    if let Some((most, different)) = comparison.measured() {
        let most = cell(Measure::Max, Some(most));
        let _ =
            writeln!(text, "- measured pixels: largest error {most}, {different} values whose bits differ");
    }
    notes(comparison, &mut text);
    let _ = writeln!(text, "\n{}", settings(comparison));
    text
}

/// How values were taken, on one line.
pub fn settings(comparison: &Comparison) -> String {
    let settings = &comparison.settings;
    let values = if settings.display {
        "colours after the sRGB curve, clipped to 0 to 1, peak 1".to_owned()
    } else {
        let clip = if settings.clip { "clipped to 0 to peak" } else { "not clipped" };
        format!("linear values, peak {}, {clip}", settings.peak)
    };
    let gate = if comparison.gate.is_empty() {
        String::new()
    } else {
        format!("; gate {}", comparison.gate.join(", "))
    };
    format!("lacuna {}: {values}{gate}", comparison.lacuna)
}

/// Measures that a table shows.
fn columns(comparison: &Comparison, region: &str) -> Vec<Measure> {
    let quiet = |measure: &Measure| match measure {
        Measure::Pixels | Measure::Mse => false,
        measure if measure.is_count() && *measure != Measure::Different => {
            let groups = comparison.frames.iter().flat_map(|frame| &frame.groups);
            groups.filter_map(|group| group.region(region)?.measures.get(*measure)).any(|count| count > 0.0)
        }
        _ => true,
    };
    comparison.measures_in(region).into_iter().filter(quiet).collect()
}

fn table(comparison: &Comparison, region: &str, text: &mut String) {
    let columns = columns(comparison, region);
    let lines: Vec<(&FrameReport, &GroupReport, &Measures)> = comparison
        .frames
        .iter()
        .flat_map(|frame| frame.groups.iter().map(move |group| (frame, group)))
        .filter_map(|(frame, group)| Some((frame, group, &group.region(region)?.measures)))
        .collect();
    let whole = |(_, group, measures): &(_, &GroupReport, &Measures)| {
        group.region("all").is_some_and(|all| all.measures == **measures)
    };
    // Alpha that is above 0 everywhere would repeat the first table.
    if lines.is_empty() || (region == "alpha" && lines.iter().all(whole)) {
        return;
    }
    let title = match region {
        "all" => "Whole image",
        "missing" => "Missing pixels only",
        _ => "Where alpha is above 0",
    };
    let names = columns.iter().map(|measure| match measure.unit() {
        "" => measure.name().to_owned(),
        unit => format!("{} ({unit})", measure.name()),
    });
    let _ = writeln!(text, "### {title}\n\n| frame | channels | {} |", names.collect::<Vec<_>>().join(" | "));
    let _ = writeln!(text, "|---|---|{}", "---:|".repeat(columns.len()));
    for (frame, group, measures) in lines.iter().take(MOST_LINES) {
        let cells = columns.iter().map(|&measure| cell(measure, measures.get(measure)));
        let label = escape(&group.label());
        let _ = writeln!(
            text,
            "| {} | {label} | {} |",
            escape(&frame.label()),
            cells.collect::<Vec<_>>().join(" | ")
        );
    }
    if lines.len() > MOST_LINES {
        let _ = writeln!(text, "\n{} more lines are in the CSV and JSON formats.", lines.len() - MOST_LINES);
    }
    means(&lines, &columns, text);
    text.push('\n');
}

/// The mean over the frames of each group of colours, where there are several frames.
fn means(lines: &[(&FrameReport, &GroupReport, &Measures)], columns: &[Measure], text: &mut String) {
    let mut colours: Vec<(String, Vec<&Measures>)> = Vec::new();
    for (_, group, measures) in lines.iter().filter(|line| line.1.kind == Kind::Colour) {
        let label = group.label();
        match colours.iter_mut().find(|(known, _)| *known == label) {
            Some((_, all)) => all.push(measures),
            None => colours.push((label, vec![measures])),
        }
    }
    for (label, frames) in colours.iter().filter(|(_, frames)| frames.len() > 1).take(MOST_LINES) {
        let cell = |measure: Measure| {
            let mean = Mean::of(frames.iter().filter_map(|measures| measures.get(measure)));
            let mean = mean.filter(|_| !measure.is_count());
            mean.map_or_else(String::new, |mean| cell(measure, Some(mean.value)) + &mean.left_out())
        };
        let cells = columns.iter().map(|&measure| cell(measure)).collect::<Vec<_>>().join(" | ");
        let _ = writeln!(text, "| **mean** | {} | {cells} |", escape(label));
    }
}

/// Each note once, with the frames that it is of.
fn notes(comparison: &Comparison, text: &mut String) {
    let mut notes: Vec<(&str, Vec<String>)> = Vec::new();
    for (frame, note) in
        comparison.frames.iter().flat_map(|frame| frame.notes.iter().map(move |note| (frame, note)))
    {
        match notes.iter_mut().find(|(known, _)| known == note) {
            Some((_, frames)) => frames.push(frame.label()),
            None => notes.push((note, vec![frame.label()])),
        }
    }
    let all = comparison.frames.len();
    for (note, frames) in notes {
        let named = frames.iter().take(MOST_NAMED).cloned().collect::<Vec<_>>().join(", ");
        let more = if frames.len() > MOST_NAMED { ", ..." } else { "" };
        let of = format!(" ({} of {all} frames: {}{more})", frames.len(), escape(&named));
        let _ = writeln!(text, "- note: {}{}", escape(note), if all == 1 { "" } else { &of });
    }
}

/// A value for people.
pub fn cell(measure: Measure, value: Option<f64>) -> String {
    let Some(value) = value else { return String::new() };
    match measure {
        _ if measure.is_count() => format!("{value:.0}"),
        _ if !value.is_finite() => value.to_string(),
        Measure::Psnr | Measure::LogPsnr => format!("{value:.2}"),
        Measure::Ssim => format!("{value:.5}"),
        Measure::Cieluv | Measure::Flip | Measure::HdrFlip => format!("{value:.4}"),
        _ if value == 0.0 => "0".into(),
        _ => format!("{value:.3e}"),
    }
}

/// Signs that Markdown would take for its own.
pub fn escape(text: &str) -> String {
    let mut out = String::new();
    for sign in text.chars() {
        if matches!(sign, '|' | '*' | '_' | '`' | '<' | '[' | '\\') {
            out.push('\\');
        }
        out.push(if sign.is_control() { ' ' } else { sign });
    }
    out
}
