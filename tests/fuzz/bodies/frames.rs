//! The tool's way of a frame, on tiny frames of oddly named channels: mask, rules, filling or enlarging, written and verified.

use half::f16;
use lacuna::guides::Asked;
use lacuna::mask::Source;
use lacuna::reconstruct::{self, Beside, Enlarge, Job, Kind, NoiseSource, Plans, Target};
use lacuna::{channels, mask, verify};
use lacuna_exr::{Channel, Frame, Part, Samples, Window};
use lacuna_filters::Run;
use lacuna_filters::domain::Domain;
use lacuna_filters::fill::Estimate;
use lacuna_filters::upscale::{Method, Sampling};

use super::draw::Draw;

const NAMES: [&str; 40] = [
    "R",
    "G",
    "B",
    "A",
    "Z",
    "N.X",
    "N.Y",
    "N.Z",
    "P.X",
    "P.Y",
    "P.Z",
    "uv.U",
    "uv.V",
    "id",
    "motion.X",
    "motion.Y",
    "mask",
    "diffuse.mask",
    "diffuse.R",
    "diffuse.G",
    "diffuse.B",
    "right.R",
    "right.mask",
    "albedo.R",
    "albedo.G",
    "albedo.B",
    "crypto00.R",
    "crypto00.G",
    "dx.R",
    "dy.R",
    "dx.G",
    "dy.G",
    "variance.R",
    "R.half0",
    "label",
    "Mist",
    "sampleCount",
    "depth.Z",
    "Combined.R",
    "",
];

/// The bytes say what the frame holds, and what is done with it.
pub fn body(data: &[u8]) {
    let mut draw = Draw(data);
    let frame = frame(&mut draw);
    let mut job = Job::new(draw.method());
    job.domain = draw.one_of(&[Domain::Auto, Domain::Linear, Domain::Log]);
    job.limit = !draw.flag();
    job.kind = draw.one_of(&[None, None, Some(Kind::Half), Some(Kind::Float)]);
    job.drop_mask = draw.flag();
    job.guides = draw.one_of(&[Asked::Auto, Asked::Auto, Asked::None]);
    job.estimate = draw.one_of(&[Estimate::No, Estimate::Figure, Estimate::Pixels]);
    job.error_channel = (job.estimate == Estimate::Pixels).then(|| "error".into());
    job.mask = draw.one_of(&[Source::Auto, Source::Auto, Source::Finite, Source::Alpha]);
    job.noise = draw.one_of(&["none", "none", "auto"]).parse().unwrap_or(NoiseSource::None);
    for rule in ["*=fill", "R=nearest", "N.*=fill", "?=depth", "P.*=normal"] {
        if draw.byte() == 255 {
            job.overrides.extend(rule.parse().ok());
        }
    }
    let Ok(masks) = mask::find(&frame, &job.mask, None) else { return };
    let choices = channels::choose(&frame, &masks.mask_channels, &job.overrides);
    let (plans, run) = (Plans::new(), Run::default());
    if draw.byte() > 180 {
        let asked = Enlarge {
            target: Target::Scale {
                x: [1.0, 1.5, 2.0, 3.0][draw.below(4)],
                y: [1.0, 1.5, 2.0, 3.0][draw.below(4)],
            },
            method: draw.one_of(&[
                Method::Ss,
                Method::Tv(lacuna_filters::variational::tv::Settings {
                    max_iterations: 60,
                    ..Default::default()
                }),
            ]),
            sampling: Some(draw.one_of(&[
                Sampling::Box,
                Sampling::Point,
                Sampling::Grid,
                Sampling::Gaussian(1.0),
            ])),
            take_guides: false,
            keep_vectors: draw.flag(),
        };
        let _ =
            reconstruct::enlarge(frame, &masks, &choices, Beside::default(), (&job, &asked), &plans, &run);
        return;
    }
    let before = frame.clone();
    let Ok((after, report)) = reconstruct::fill(frame, &masks, &choices, &job, &plans, &run) else { return };
    assert_eq!(report.parts.len(), before.parts.len());
    // Measured pixels keep their bits, what was filled is finite: as verify sees it.
    // Guides stay as they are, which verify reads in the file.
    let plain = job.kind.is_none() && job.error_channel.is_none() && job.guides == Asked::None;
    if job.keeps_measured() && plain {
        // What is copied from no number is none.
        let without_numbers = |part: usize, channel: usize| {
            let (Some(mask), channel) = (masks.get(part, channel), &before.parts[part].channels[channel])
            else {
                return false;
            };
            let values = channel.samples.as_f32();
            values.iter().zip(mask.as_slice()).all(|(value, &flag)| !flag || !value.is_finite())
        };
        let any = choices.iter().enumerate().any(|(part, all)| {
            (0..all.len()).any(|at| all[at].rule == channels::Rule::Nearest && without_numbers(part, at))
        });
        let found = verify::compare(&before, &after, &masks, &choices);
        assert!(any || found.is_empty(), "{found:?}");
    }
}

fn frame(draw: &mut Draw<'_>) -> Frame {
    let parts = 1 + draw.below(4) / 3;
    let frame = (0..parts).map(|index| {
        let (width, height) = (1 + draw.below(12) as i32, 1 + draw.below(12) as i32);
        let (x, y) = (i32::from(draw.byte()) - 128, i32::from(draw.byte()) - 128);
        let window = Window { x_min: x, y_min: y, x_max: x + width - 1, y_max: y + height - 1 };
        let mut names: Vec<&str> = (0..=draw.below(8)).map(|_| draw.one_of(&NAMES)).collect();
        if draw.byte() < 230 {
            names.extend(["mask", "R", "G", "B"]);
        }
        names.sort_unstable();
        names.dedup();
        let pixels = (width * height) as usize;
        let channels = names.into_iter().map(|name| channel(draw, name, pixels)).collect();
        let mut part = Part::new(window, channels);
        if parts > 1 {
            part.attributes.set_text("name", &format!("part{index}"));
            part.attributes.set_text("view", ["left", "right"][index]);
        }
        part
    });
    Frame { parts: frame.collect() }
}

fn channel(draw: &mut Draw<'_>, name: &str, pixels: usize) -> Channel {
    let samples = if name.ends_with("mask") && draw.byte() < 240 {
        let share = draw.byte();
        Samples::Half((0..pixels).map(|_| f16::from_f32(f32::from(u8::from(draw.byte() <= share)))).collect())
    } else {
        match draw.below(8) {
            0 => Samples::Uint((0..pixels).map(|_| u32::from(draw.byte())).collect()),
            1..=4 => Samples::Half((0..pixels).map(|_| f16::from_f32(draw.value())).collect()),
            _ => Samples::Float((0..pixels).map(|_| draw.value()).collect()),
        }
    };
    Channel { name: name.into(), perceptually_linear: false, samples }
}
