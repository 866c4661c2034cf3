//! The comparison as one HTML file: no network, no other file, readable without JavaScript.
//!
//! Tables, thumbnails and plots are plain HTML and SVG. The script reads the packed pixels of the worst frames and adds
//! sorting and a viewer (slider, linked zoom, exposure, curve, error maps).

mod codes;
mod filled;
mod picture;
mod plot;
mod shell;
mod table;

use std::fmt::Write;

pub use codes::base64;
pub use filled::{Filled, Pictures as FilledPictures, filled};
pub use picture::{Picture, Pixels};
pub use shell::shell;

use super::markdown::settings;
use super::measure::Measure;
use super::model::{Comparison, FrameReport, GroupReport, Mean};

/// The pixels that a page holds, so that a browser opens it at once: ten frames of 1200 x 1200, or a shot of smaller ones.
pub const MOST_PIXELS: usize = 15 << 20;

/// The page; one picture a frame, where there is one.
pub fn html(comparison: &Comparison, pictures: &[Option<Picture>]) -> String {
    let title = title(comparison);
    let mut body = String::new();
    let _ = writeln!(body, "<header><h1>{title}</h1>{}</header>\n<main>", verdict(comparison));
    viewer(pictures, &mut body);
    table::summary(comparison, pictures, &mut body);
    plots(comparison, &mut body);
    table::details(comparison, pictures, &mut body);
    about(comparison, pictures, &mut body);
    body.push_str("</main>\n");
    let mut packed = String::new();
    data(comparison, pictures, &mut packed);
    shell(&title, &body, &packed, true)
}

fn title(comparison: &Comparison) -> String {
    let name = |path: &str| {
        std::path::Path::new(path).file_name().map(|name| name.display().to_string()).unwrap_or_default()
    };
    match comparison.frames.as_slice() {
        [one] => format!("{} against {}", escape(&name(&one.test)), escape(&name(&one.reference))),
        [first, .., last] => format!(
            "{} to {}: {} frames against their references",
            escape(&name(&first.test)),
            escape(&name(&last.test)),
            comparison.frames.len()
        ),
        [] => "No frames".into(),
    }
}

/// One line that says how it went.
fn verdict(comparison: &Comparison) -> String {
    let frames = &comparison.frames;
    let broken = frames.iter().filter(|frame| frame.error.is_some()).count();
    let failing = frames.iter().filter(|frame| !frame.failures.is_empty()).count();
    let mut parts = Vec::new();
    if broken > 0 {
        parts.push(format!("{broken} of {} frames could not be compared", frames.len()));
    }
    if failing > 0 {
        parts.push(format!("{failing} of {} frames fail: {}", frames.len(), comparison.gate.join(", ")));
    } else if !comparison.gate.is_empty() && broken == 0 {
        let skipped = frames.iter().filter(|frame| frame.skipped.is_some()).count();
        let which = match (frames.len() - skipped, skipped) {
            (_, 0) => "all frames pass".into(),
            (1, _) => format!("1 frame passes, {skipped} skipped"),
            (passed, _) => format!("{passed} frames pass, {skipped} skipped"),
        };
        parts.push(format!("{which}: {}", comparison.gate.join(", ")));
    }
    let class = if broken + failing > 0 { "bad" } else { "good" };
    let sum = [Measure::Psnr, Measure::Ssim, Measure::Flip]
        .into_iter()
        .filter_map(|measure| mean(frames, measure).map(|mean| (measure, mean)))
        .map(|(measure, mean)| {
            let (name, left_out) = (table::heading(measure), mean.left_out());
            format!("<span><b>{}</b> {name}{left_out}</span>", table::cell(measure, Some(mean.value)))
        });
    let sum: Vec<_> = sum.collect();
    let text = if parts.is_empty() {
        String::new()
    } else {
        format!("<p class=\"verdict {class}\">{}</p>", escape(&parts.join("; ")))
    };
    let mut groups: Vec<String> =
        frames.iter().filter_map(FrameReport::main_group).map(GroupReport::label).collect();
    groups.dedup();
    let mean = if frames.len() > 1 { "mean of the frames, " } else { "" };
    let note = format!("{}: {mean}whole image", escape(&groups.join(", ")));
    format!("{text}<p class=\"sum\">{} <small>{note}</small></p>", sum.join(" "))
}

/// The mean over the frames' main groups.
fn mean(frames: &[FrameReport], measure: Measure) -> Option<Mean> {
    let value = |frame: &FrameReport| frame.main_group()?.region("all")?.measures.get(measure);
    Mean::of(frames.iter().filter_map(value))
}

/// The place of the viewer; the script fills it.
fn viewer(pictures: &[Option<Picture>], page: &mut String) {
    if pictures.iter().flatten().any(|picture| picture.pixels.is_some()) {
        page.push_str("<section id=\"viewer\" hidden aria-label=\"Viewer\"></section>\n");
    }
}

fn plots(comparison: &Comparison, page: &mut String) {
    if comparison.frames.len() < 2 {
        return;
    }
    page.push_str("<section><h2>Over the frames</h2>\n<div class=\"plots\">\n");
    let always = [Measure::Psnr, Measure::Ssim, Measure::Rmse, Measure::Max, Measure::LogPsnr];
    for measure in always.into_iter().chain(Measure::on_request()) {
        let lines: Vec<_> = ["all", "missing", "alpha"]
            .into_iter()
            .map(|region| {
                let value = |frame: &FrameReport| {
                    let value = frame.main_group()?.region(region)?.measures.get(measure)?;
                    value.is_finite().then_some(value)
                };
                let values = comparison.frames.iter().map(value).collect();
                plot::Series { name: region, class: region, values }
            })
            .filter(|line| line.values.iter().flatten().count() > 1)
            .collect();
        if !lines.is_empty() {
            let labels: Vec<_> = comparison.frames.iter().map(FrameReport::label).collect();
            let cell = |value: f64| table::cell(measure, Some(value));
            page.push_str(&plot::plot(&table::heading(measure), &cell, &labels, &lines));
        }
    }
    page.push_str("</div></section>\n");
}

/// How the numbers came about.
fn about(comparison: &Comparison, pictures: &[Option<Picture>], page: &mut String) {
    let _ = write!(
        page,
        "<section><h2>Settings and measures</h2>\n<p>{}.</p>\n<dl class=\"measures\">",
        escape(&settings(comparison))
    );
    let changes = Measure::all().filter(|measure| measure.is_change());
    for measure in comparison.measures_in("all").into_iter().chain(changes) {
        let _ = write!(page, "<dt>{}</dt><dd>{}</dd>", measure.name(), escape(measure.explanation()));
    }
    page.push_str("</dl>\n");
    let shown: Vec<_> = pictures.iter().flatten().filter_map(|picture| picture.pixels.as_ref()).collect();
    if let Some(pixels) = shown.first() {
        let (dark, bright) = pixels.codes.steps();
        let _ = writeln!(
            page,
            "<p>Regions: <b>all</b> the whole image, <b>missing</b> pixels only, where the reference's <b>alpha</b> is \
             above 0. The numbers in the tables come from the files. The viewer holds every pixel of {} in \
             {} logarithmic levels: bright values to within {:.2} %, dark ones to within {:.0e}; the maps of SSIM and FLIP \
             have 32 levels, and for large frames half the resolution (the worst of four pixels). What is not finite is cyan.</p>",
            match shown.len() {
                1 => "one frame".into(),
                some if some == pictures.iter().flatten().count() => format!("all {some} frames"),
                some => format!("{some} frames, the worst ones"),
            },
            pixels.codes.levels,
            100.0 * bright,
            dark,
        );
    }
    page.push_str("</section>\n");
}

/// The packed pixels, a script element a frame, and what the script must know of each.
fn data(comparison: &Comparison, pictures: &[Option<Picture>], page: &mut String) {
    for (index, (picture, frame)) in pictures.iter().zip(&comparison.frames).enumerate() {
        let Some((picture, pixels)) = picture.as_ref().and_then(|p| Some((p, p.pixels.as_ref()?))) else {
            continue;
        };
        element(index, &format!("frame {}, {}", frame.label(), picture.label), pixels, page);
    }
}

/// The packed pixels of a frame for the script.
fn element(index: usize, label: &str, pixels: &Pixels, page: &mut String) {
    if let Ok(json) = serde_json::to_string(pixels) {
        let _ = writeln!(
            page,
            "<script type=\"application/json\" class=\"pixels\" data-index=\"{index}\" data-label=\"{}\">{json}</script>",
            escape(label)
        );
    }
}

/// Text as HTML, for attributes as well.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for sign in text.chars() {
        match sign {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            sign if sign.is_control() => out.push(' '),
            sign => out.push(sign),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    #[test]
    fn markup_in_names_is_text() {
        assert_eq!(super::escape("a<b>&\"c\"\n"), "a&lt;b&gt;&amp;&quot;c&quot; ");
    }
}
