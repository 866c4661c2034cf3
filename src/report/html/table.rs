//! The tables of the page: a row a frame that sorts, and all measures of each frame.

use std::fmt::Write;

use super::escape;
use super::picture::{ERROR_GAIN, LEAST_SHOWN, Picture};
use crate::report::markdown;
use crate::report::measure::Measure;
use crate::report::model::{Comparison, FrameReport, GroupReport};

/// Measures of the main table that are always there, each over the whole image and over the missing pixels; those on request follow.
const ALWAYS: [Measure; 3] = [Measure::Psnr, Measure::Ssim, Measure::Max];

/// Counts that have a column where any is above 0: such values count in no other measure.
const NEW: [Measure; 2] = [Measure::NewNan, Measure::NewInfinite];

/// The head of a measure's column.
pub fn heading(measure: Measure) -> String {
    match measure.unit() {
        "" => measure.name().into(),
        unit => format!("{} ({unit})", measure.name()),
    }
}

/// A value, as in every other table.
pub fn cell(measure: Measure, value: Option<f64>) -> String {
    match value {
        None => "–".into(),
        value => markdown::cell(measure, value),
    }
}

fn columns(comparison: &Comparison) -> Vec<(&'static str, Measure)> {
    let has = |region: &str, measure: Measure| {
        let main = comparison.frames.iter().filter_map(FrameReport::main_group);
        let value = |group: &GroupReport| group.region(region)?.measures.get(measure);
        main.filter_map(value).any(|value| value > 0.0 || !NEW.contains(&measure))
    };
    let measures = || ALWAYS.into_iter().chain(NEW).chain(Measure::on_request());
    let of = |region: &'static str| measures().map(move |measure| (region, measure));
    of("all").chain(of("missing")).filter(|&(region, measure)| has(region, measure)).collect()
}

/// A row a frame, with thumbnails.
pub fn summary(comparison: &Comparison, pictures: &[Option<Picture>], page: &mut String) {
    let columns = columns(comparison);
    page.push_str("<section><h2>Frames</h2>\n<div class=\"scroll\"><table id=\"frames\">\n<thead><tr>");
    page.push_str("<th scope=\"col\" data-sort=\"number\">frame</th><th scope=\"col\">pictures</th>");
    page.push_str("<th scope=\"col\" data-sort=\"number\">density</th>");
    for (region, measure) in &columns {
        let region = if *region == "all" { "" } else { "<small>missing pixels</small> " };
        let _ = write!(
            page,
            "<th scope=\"col\" data-sort=\"number\" title=\"{}\">{region}{}</th>",
            escape(measure.explanation()),
            heading(*measure)
        );
    }
    page.push_str("</tr></thead>\n<tbody>\n");
    for (index, frame) in comparison.frames.iter().enumerate() {
        row(index, frame, pictures.get(index).and_then(Option::as_ref), &columns, page);
    }
    page.push_str("</tbody></table></div></section>\n");
}

fn row(
    index: usize,
    frame: &FrameReport,
    picture: Option<&Picture>,
    columns: &[(&'static str, Measure)],
    page: &mut String,
) {
    let label = escape(&frame.label());
    let order = frame.frame.unwrap_or(index as i64);
    let class = if frame.failures.is_empty() && frame.error.is_none() { "" } else { " class=\"bad\"" };
    let _ = write!(page, "<tr data-index=\"{index}\"{class}><th scope=\"row\" data-value=\"{order}\">");
    let _ = write!(page, "<a href=\"#frame-{index}\">{label}</a></th><td class=\"thumbs\">");
    if let Some(picture) = picture {
        thumbnails(picture, &label, page);
    }
    let density = frame.main_group().and_then(|group| group.density);
    let percent = density.map_or_else(|| "–".into(), |density| format!("{:.1} %", density * 100.0));
    let _ = write!(page, "</td><td data-value=\"{}\">{percent}</td>", density.unwrap_or(-1.0));
    if let Some(why) = frame.error.as_ref().or(frame.skipped.as_ref()) {
        let _ = write!(page, "<td colspan=\"{}\">{}</td>", columns.len().max(1), escape(why));
    } else {
        for &(region, measure) in columns {
            let value = frame.main_group().and_then(|group| group.region(region)?.measures.get(measure));
            let data = value.map_or_else(String::new, |value| format!(" data-value=\"{value:e}\""));
            let _ = write!(page, "<td{data}>{}</td>", cell(measure, value));
        }
    }
    page.push_str("</tr>\n");
}

fn thumbnails(picture: &Picture, label: &str, page: &mut String) {
    let (width, height) = picture.thumbnail_size;
    let width_shown = width.min(96);
    let height_shown = (height * width_shown / width.max(1)).max(LEAST_SHOWN);
    for (name, png) in &picture.thumbnails {
        let what = if *name == "error" { format!("error x {ERROR_GAIN}") } else { (*name).into() };
        let _ = write!(
            page,
            "<figure><img width=\"{width_shown}\" height=\"{height_shown}\" alt=\"{what} of frame {label}\" \
             src=\"data:image/png;base64,{png}\"><figcaption>{what}</figcaption></figure>"
        );
    }
}

/// Everything about each frame.
pub fn details(comparison: &Comparison, pictures: &[Option<Picture>], page: &mut String) {
    page.push_str("<section><h2>Every measure</h2>\n");
    let open = if comparison.frames.len() == 1 { " open" } else { "" };
    for (index, frame) in comparison.frames.iter().enumerate() {
        let _ = writeln!(
            page,
            "<details id=\"frame-{index}\"{open}><summary>Frame {}</summary>\n<p class=\"files\">{}<br>{}</p>",
            escape(&frame.label()),
            escape(&frame.reference),
            escape(&frame.test)
        );
        for text in frame.failures.iter().chain(&frame.error) {
            let _ = writeln!(page, "<p class=\"bad\">{}</p>", escape(text));
        }
        for note in &frame.notes {
            let _ = writeln!(page, "<p>{}</p>", escape(note));
        }
        if let Some(pixels) = pictures.get(index).and_then(Option::as_ref).filter(|p| p.pixels.is_some()) {
            let _ = writeln!(
                page,
                "<p class=\"script\"><button type=\"button\" class=\"show\" data-index=\"{index}\">Show {} in the viewer</button></p>",
                escape(&pixels.label)
            );
        }
        for group in &frame.groups {
            measures(group, page);
        }
        page.push_str("</details>\n");
    }
    page.push_str("</section>\n");
}

fn measures(group: &GroupReport, page: &mut String) {
    let all: Vec<Measure> = Measure::all()
        .filter(|&measure| group.regions.iter().any(|region| region.measures.get(measure).is_some()))
        .collect();
    let _ = write!(
        page,
        "<div class=\"scroll\"><table><caption>{} <small>{} x {} pixels{}</small></caption><thead><tr><th scope=\"col\">region</th><th scope=\"col\">channel</th>",
        escape(&group.label()),
        group.size.1,
        group.size.0,
        group.measured_different.map_or_else(String::new, |count| {
            let most = group.measured_max.map(|most| cell(Measure::Max, Some(most)));
            let most = most.map_or_else(String::new, |most| format!("largest error {most}, "));
            format!(", on measured pixels: {most}{count} values whose bits differ")
        }),
    );
    for measure in &all {
        let _ = write!(
            page,
            "<th scope=\"col\" title=\"{}\">{}</th>",
            escape(measure.explanation()),
            heading(*measure)
        );
    }
    page.push_str("</tr></thead><tbody>");
    for region in &group.regions {
        let rows = std::iter::once((None, &region.measures))
            .chain(region.channels.iter().map(|(name, measures)| (Some(name), measures)));
        for (channel, values) in rows {
            let name = channel.map_or_else(|| "together".into(), |name| escape(name));
            let label = if region.region == "alpha" { "where alpha is above 0" } else { region.region };
            let _ = write!(page, "<tr><th scope=\"row\">{label}</th><td>{name}</td>");
            for &measure in &all {
                let _ = write!(page, "<td>{}</td>", cell(measure, values.get(measure)));
            }
            page.push_str("</tr>");
        }
    }
    page.push_str("</tbody></table></div>\n");
}
