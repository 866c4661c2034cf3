//! What a run made, as one page without a reference: mask, sparse input and result of each frame, density and timings.

use std::fmt::Write;

use lacuna_exr::{Channel, Frame};
use lacuna_filters::{Mask, Plane};

use super::picture::{Pixels, filled_pictures};
use super::plot::{Series, plot};
use super::shell::shell;
use super::{element, escape};
use crate::reconstruct::{Interval, estimated_errors};
use crate::report::groups::{Kind, pair};
use crate::report::model::Settings;
use crate::report::values::Values;

/// A frame of the page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filled {
    /// The frame number, or the file's name.
    pub label: String,
    /// What was read and what was written.
    pub files: [String; 2],
    /// `done`, `skipped`, `failed`, `stopped` or `pending`.
    pub state: String,
    /// Why it is not done, and what the log warned of.
    pub messages: Vec<String>,
    /// Measured pixels over all pixels.
    pub density: Option<f64>,
    /// How good the fill is by estimate: channels, and their PSNR in decibels with the interval that holds it nine times of ten.
    pub psnr: Option<(String, Interval)>,
    /// Whether the error of some colour cannot be told, or has only a bound.
    pub untold: bool,
    /// Where the mask was found, what became of the channels, how the solver ended.
    pub words: Vec<(&'static str, String)>,
    /// Seconds by stage, in their order.
    pub seconds: Vec<(&'static str, f64)>,
    /// The pictures, if the frame has colours.
    pub pictures: Option<Pictures>,
}

/// Mask, sparse input and result, as PNG in base64.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pictures {
    /// The channels shown.
    pub label: String,
    /// Columns and rows of each.
    pub size: (usize, usize),
    /// Name and picture.
    pub all: Vec<(&'static str, String)>,
    /// Every pixel, for the viewer, as far as the page holds them.
    pub pixels: Option<Pixels>,
}

impl Pictures {
    /// The pictures of a frame, filled or sparse still, with every pixel if it has at most `most`; `mask` is that of a part and channel.
    /// Nothing if there are no floats.
    pub fn new<'a>(
        frame: &Frame,
        mask: impl Fn(usize, usize) -> Option<&'a Mask>,
        filled: bool,
        (width, most): (usize, usize),
    ) -> Option<Self> {
        let pairing = pair(frame, frame);
        let group = pairing.groups.get(pairing.main(frame)?).filter(|group| group.kind != Kind::Codes)?;
        let part = frame.parts.get(group.parts.0)?;
        let plane = |&(at, _): &(usize, usize)| {
            let Channel { samples, .. } = &part.channels[at];
            Plane::new(part.size(), samples.to_floats()?).ok()
        };
        let planes: Vec<Plane> = group.channels.iter().map(plane).collect::<Option<_>>()?;
        let mask = mask(group.parts.0, group.channels.first()?.0);
        let white = Values::new(group.kind, &Settings::default(), &planes).options.peak;
        let (size, all) = filled_pictures(part, &planes, mask, filled, (width, white))?;
        let names = group.channels.iter().map(|&(at, _)| part.channels[at].display_name().into_owned());
        let every = || {
            let estimate = estimated_errors(part, &group.layer);
            // A frame that is sparse still is its own sparse input.
            let mask = mask.filter(|_| filled);
            Pixels::filled(part, &planes, mask, estimate.as_ref(), white)
        };
        let pixels = (part.size().pixels() <= most).then(every).flatten();
        Some(Self { label: names.collect::<Vec<_>>().join(" "), size, all, pixels })
    }
}

/// The page. `title` is text; `about` says what was done, by name and text.
pub fn filled(title: &str, about: &[(String, String)], frames: &[Filled]) -> String {
    let title = escape(title);
    let mut body = format!("<header><h1>{title}</h1>{}</header>\n<main>\n", summary(frames));
    let mut packed = String::new();
    for (index, frame) in frames.iter().enumerate() {
        if let Some((pictures, pixels)) = frame.pictures.as_ref().and_then(|p| Some((p, p.pixels.as_ref()?)))
        {
            element(index, &format!("frame {}, {}", frame.label, pictures.label), pixels, &mut packed);
        }
    }
    if !packed.is_empty() {
        body.push_str("<section id=\"viewer\" hidden aria-label=\"Viewer\"></section>\n");
    }
    table(frames, &mut body);
    plots(frames, &mut body);
    body.push_str("<section><h2>What was done</h2>\n<dl class=\"measures\">");
    for (name, text) in about {
        let _ = write!(body, "<dt>{}</dt><dd>{}</dd>", escape(name), escape(text));
    }
    body.push_str(
        "</dl>\n<p>Nothing was compared: there is no reference. Mask: white is measured. Pictures are smaller than the frames, \
         clipped to 0 to 1 (without colours to their largest value), after the sRGB curve; what is not finite is cyan.</p></section>\n</main>\n",
    );
    shell(&title, &body, &packed, true)
}

fn summary(frames: &[Filled]) -> String {
    let count = |state: &str| frames.iter().filter(|frame| frame.state == state).count();
    let class = if count("failed") > 0 { "bad" } else { "good" };
    let mut words = vec![format!("{} of {} frames done", count("done"), frames.len())];
    for state in ["skipped", "failed", "stopped", "pending"] {
        if count(state) > 0 {
            words.push(format!("{} {state}", count(state)));
        }
    }
    let densities: Vec<f64> = frames.iter().filter_map(|frame| frame.density).collect();
    let (low, high) = densities.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), &v| (a.min(v), b.max(v)));
    let percent = |value: f64| format!("{:.2}", 100.0 * value);
    let mut sum = String::new();
    if !densities.is_empty() {
        let range = if percent(low) == percent(high) {
            percent(low)
        } else {
            format!("{} to {}", percent(low), percent(high))
        };
        let _ = write!(sum, "<span><b>{range} %</b> measured</span> ");
    }
    sum.push_str(&estimated(frames));
    for name in stages(frames) {
        let all = frames.iter().flat_map(|frame| &frame.seconds).filter(|(other, _)| *other == name);
        let _ =
            write!(sum, "<span><b>{:.2} s</b> {name}</span> ", all.map(|(_, seconds)| seconds).sum::<f64>());
    }
    format!("<p class=\"verdict {class}\">{}</p><p class=\"sum\">{sum}</p>", words.join(", "))
}

/// The estimate of the frame, or of the worst of several, and how many have none.
fn estimated(frames: &[Filled]) -> String {
    let mut text = String::new();
    let known = frames.iter().filter_map(|frame| Some((frame, frame.psnr.as_ref()?)));
    let worst = known.min_by(|a, b| a.1.1.estimate.total_cmp(&b.1.1.estimate));
    if let Some((frame, (channels, Interval { estimate, low, high }))) = worst {
        let channels = escape(channels);
        let worst = match frames {
            [_] => String::new(),
            _ => format!(" of the worst frame, {}", escape(&frame.label)),
        };
        let _ = write!(
            text,
            "<span><b>{estimate:.1} dB</b> estimated PSNR of {channels}{worst} ({low:.1} to {high:.1})</span> "
        );
    }
    let untold = frames.iter().filter(|frame| frame.untold).count();
    if untold > 0 {
        let all = frames.len();
        let _ =
            write!(text, "<span>error untold, or only bounded, in <b>{untold}</b> of {all} frames</span> ");
    }
    text
}

fn table(frames: &[Filled], body: &mut String) {
    let stages = stages(frames);
    let is_estimated = frames.iter().any(|frame| frame.psnr.is_some());
    body.push_str("<section><h2>Frames</h2>\n<div class=\"scroll\"><table id=\"frames\"><thead><tr>");
    body.push_str("<th scope=\"col\" data-sort=\"number\">frame</th><th scope=\"col\">pictures</th>");
    body.push_str("<th scope=\"col\" data-sort=\"number\">measured</th>");
    if is_estimated {
        body.push_str("<th scope=\"col\" data-sort=\"number\">estimated PSNR (dB)</th>");
    }
    for stage in &stages {
        let _ = write!(body, "<th scope=\"col\" data-sort=\"number\">{stage} (s)</th>");
    }
    body.push_str("<th scope=\"col\" class=\"words\">notes</th></tr></thead>\n<tbody>\n");
    for (index, frame) in frames.iter().enumerate() {
        let class = if frame.state == "failed" { " class=\"bad\"" } else { "" };
        let _ = write!(
            body,
            "<tr{class}><th scope=\"row\" data-value=\"{index}\" title=\"{} to {}\">{}</th><td class=\"thumbs\">",
            escape(&frame.files[0]),
            escape(&frame.files[1]),
            escape(&frame.label)
        );
        pictures(frame, body);
        let percent = frame.density.map_or_else(|| "–".into(), |density| format!("{:.2} %", 100.0 * density));
        let _ = write!(body, "</td><td data-value=\"{}\">{percent}</td>", frame.density.unwrap_or(-1.0));
        if is_estimated {
            let _ = match &frame.psnr {
                Some((_, psnr)) => {
                    write!(body, "<td data-value=\"{}\">{:.1}</td>", psnr.estimate, psnr.estimate)
                }
                None => write!(body, "<td>–</td>"),
            };
        }
        for stage in &stages {
            let found = frame.seconds.iter().find(|(name, _)| name == stage).map(|(_, seconds)| *seconds);
            let _ = match found {
                Some(seconds) => write!(body, "<td data-value=\"{seconds}\">{seconds:.3}</td>"),
                None => write!(body, "<td>–</td>"),
            };
        }
        body.push_str("<td class=\"notes\">");
        if frame.state != "done" {
            let _ = write!(body, "<b>{}</b><br>", escape(&frame.state));
        }
        for (name, text) in &frame.words {
            let _ = write!(body, "{name}: {}<br>", escape(text));
        }
        for message in &frame.messages {
            let _ = write!(body, "<span class=\"bad\">{}</span><br>", escape(message));
        }
        body.push_str("</td></tr>\n");
    }
    body.push_str("</tbody></table></div></section>\n");
}

fn pictures(frame: &Filled, body: &mut String) {
    let Some(pictures) = &frame.pictures else { return };
    for (name, png) in &pictures.all {
        let what = format!("{name} of frame {}, {}", frame.label, pictures.label);
        let _ = write!(
            body,
            "<figure><img width=\"{}\" height=\"{}\" alt=\"{}\" src=\"data:image/png;base64,{png}\"><figcaption>{name}</figcaption></figure>",
            pictures.size.0,
            pictures.size.1,
            escape(&what)
        );
    }
}

/// The stages that any frame has, in their order.
fn stages(frames: &[Filled]) -> Vec<&'static str> {
    let mut names: Vec<&'static str> = Vec::new();
    frames.iter().flat_map(|frame| &frame.seconds).for_each(|(name, _)| {
        if !names.contains(name) {
            names.push(name);
        }
    });
    names
}

fn plots(frames: &[Filled], body: &mut String) {
    if frames.len() < 2 {
        return;
    }
    let labels: Vec<String> = frames.iter().map(|frame| frame.label.clone()).collect();
    let cell = |value: f64| format!("{value:.3}");
    body.push_str("<section><h2>Over the frames</h2>\n<div class=\"plots\">\n");
    let density: Vec<Option<f64>> = frames.iter().map(|frame| frame.density.map(|d| 100.0 * d)).collect();
    if density.iter().flatten().count() > 1 {
        let line = Series { name: "measured", class: "all", values: density };
        body.push_str(&plot("measured pixels (%)", &cell, &labels, &[line]));
    }
    let psnr: Vec<Option<f64>> =
        frames.iter().map(|frame| frame.psnr.as_ref().map(|(_, psnr)| psnr.estimate)).collect();
    if psnr.iter().flatten().count() > 1 {
        let line = Series { name: "estimated", class: "all", values: psnr };
        body.push_str(&plot("estimated PSNR (dB)", &cell, &labels, &[line]));
    }
    let stages = stages(frames);
    let lines: Vec<Series<'_>> = stages
        .iter()
        .zip(["all", "missing", "alpha"].into_iter().cycle())
        .map(|(name, class)| {
            let of = |frame: &Filled| frame.seconds.iter().find(|(other, _)| other == name).map(|(_, s)| *s);
            Series { name, class, values: frames.iter().map(of).collect() }
        })
        .collect();
    if lines.iter().any(|line| line.values.iter().flatten().count() > 1) {
        body.push_str(&plot("time (s)", &cell, &labels, &lines));
    }
    body.push_str("</div></section>\n");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_lines_tell_every_stage_state_and_estimate() {
        let frame = |label: &str, state: &str, seconds: Vec<(&'static str, f64)>| Filled {
            label: label.into(),
            state: state.into(),
            seconds,
            ..Filled::default()
        };
        let rendered = vec![("volume", 1.0), ("render", 2.0), ("write", 3.0)];
        let mut frames = vec![
            frame("1", "done", rendered),
            frame("2", "failed", vec![("read", 1.0), ("solve", 0.0), ("write", 0.0)]),
            frame("3", "stopped", Vec::new()),
        ];
        assert_eq!(stages(&frames), ["volume", "render", "write", "read", "solve"]);
        assert!(summary(&frames).contains("1 failed, 1 stopped"));
        assert!(!summary(&frames).contains("untold"));
        let interval = Interval { estimate: 30.0, low: 28.0, high: 33.0 };
        frames[0].psnr = Some(("R, G, B".into(), interval));
        frames[1].untold = true;
        let told = summary(&frames);
        assert!(
            told.contains("</b> estimated PSNR of R, G, B of the worst frame, 1 (28.0 to 33.0)"),
            "{told}"
        );
        assert!(told.contains("error untold, or only bounded, in <b>1</b> of 3 frames"), "{told}");
    }
}
