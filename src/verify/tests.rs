//! Filled frames with one thing wrong.

use half::f16;
use lacuna_exr::{Layout, Samples};
use lacuna_filters::baseline::push_pull;
use lacuna_filters::variational::tv;
use lacuna_filters::{Method, Run};

use super::*;
use crate::channels::choose;
use crate::mask::find;
use crate::reconstruct::{Job, Plans, fill};
use crate::sparsify::{Pattern, sparsify};
use crate::testing::{float, frame, half, named, part, uint, window};

const SETTINGS: &str = "lacuna/settings";

fn job() -> Job {
    Job::new(Method::from(push_pull::Settings))
}

fn sparse() -> Frame {
    let light: Vec<f32> = (0..48).map(|at| (at % 8) as f32 / 8.0).collect();
    let ids: Vec<u32> = (0..48).map(|at| 10 + at / 8).collect();
    let channels = || {
        vec![
            half("R", &light),
            half("A", &light),
            float("Z", &[f32::INFINITY; 48]),
            uint("id", &ids),
            half("samples", &light),
        ]
    };
    let mut first = named("a", "", part(window(3, -2, 8, 6), channels()));
    first.attributes.set_text("owner", "somebody");
    first.attributes.set("preview", "preview", vec![0; 8]);
    first.compression = Compression::Pxr24;
    let full = frame(vec![first, named("b", "", part(window(3, -2, 8, 6), channels()))]);
    let mut sparse = sparsify(full, Pattern::Shuffle { density: 0.4, seed: 1, frame: 0 }).unwrap().frame;
    sparse.parts[0].attributes.set("preview", "preview", vec![0; 8]);
    sparse
}

fn filled(sparse: &Frame, job: &Job) -> Frame {
    let masks = find(sparse, &job.mask, None).unwrap();
    let choices = choose(sparse, &masks.mask_channels, &job.overrides);
    fill(sparse.clone(), &masks, &choices, job, &Plans::new(), &Run::default()).unwrap().0
}

/// The differences as `lacuna verify` finds them, one line each.
fn lines(sparse: &Frame, filled: &Frame) -> Vec<String> {
    let claims = Claims::read(filled);
    let masks = find(sparse, &claims.mask, None).unwrap();
    let mut choices = choose(sparse, &masks.mask_channels, &claims.overrides);
    crate::guides::find(sparse, &masks, &mut choices, &claims.guides, None).unwrap();
    compare(sparse, filled, &masks, &choices).iter().map(ToString::to_string).collect()
}

/// The differences after one change.
fn after(change: impl Fn(&mut Frame)) -> Vec<String> {
    let sparse = sparse();
    let mut filled = filled(&sparse, &job());
    change(&mut filled);
    lines(&sparse, &filled)
}

fn channel<'a>(frame: &'a mut Frame, part: usize, name: &str) -> &'a mut Samples {
    let found = frame.parts[part].channels.iter_mut().find(|channel| channel.name == name.as_bytes());
    &mut found.unwrap().samples
}

fn halves<'a>(frame: &'a mut Frame, part: usize, name: &str) -> &'a mut Vec<f16> {
    let Samples::Half(values) = channel(frame, part, name) else { panic!("not halves") };
    values
}

/// A change and what is to be said about it.
type Case<'a> = (&'a dyn Fn(&mut Frame), &'a str);

/// The first pixel that was measured, or that is missing.
fn first(wanted: bool) -> usize {
    let sparse = sparse();
    let masks = find(&sparse, &Source::Auto, None).unwrap();
    masks.get(0, 0).unwrap().as_slice().iter().position(|&flag| flag == wanted).unwrap()
}

fn place(at: usize) -> String {
    format!("pixel ({}, {})", 3 + at % 8, at as i64 / 8 - 2)
}

#[test]
fn what_fill_makes_is_as_promised() {
    assert_eq!(after(|_| {}), [""; 0]);
    let sparse = sparse();
    let mut other = job();
    other.kind = Some(Kind::Float);
    other.drop_mask = true;
    other.compression = Some(Compression::Piz);
    other.overrides = vec!["A=keep".parse().unwrap(), "R=nearest".parse().unwrap()];
    assert_eq!(lines(&sparse, &filled(&sparse, &other)), [""; 0]);
    other.kind = Some(Kind::Half);
    other.overrides.clear();
    other.mask = "channel:mask".parse().unwrap();
    assert_eq!(lines(&sparse, &filled(&sparse, &other)), [""; 0]);
    assert_eq!(Claims::read(&filled(&sparse, &other)).mask, other.mask);
}

#[test]
fn one_bit_of_one_measured_half_is_found() {
    let at = first(true);
    let found = after(|frame| {
        let value = &mut halves(frame, 1, "R")[at];
        *value = f16::from_bits(value.to_bits() ^ 1);
    });
    assert_eq!(found, [format!("part 1 (b), channel R, {}: a measured pixel has changed", place(at))]);
}

#[test]
fn kept_channels_must_be_equal_everywhere() {
    let at = first(false);
    let found = after(|frame| {
        halves(frame, 0, "samples")[at] = f16::from_bits(0x8000);
        halves(frame, 0, "samples")[at + 1] = f16::NAN;
    });
    assert_eq!(
        found,
        [format!("part 0 (a), channel samples, {}: a kept pixel has changed (2 pixels in all)", place(at))]
    );
}

#[test]
fn filled_pixels_must_be_finite_bounded_or_copied() {
    let at = first(false);
    let cases: [Case<'_>; 5] = [
        (&|frame| halves(frame, 0, "R")[at] = f16::INFINITY, "channel R, @: a filled pixel is not finite"),
        (
            &|frame| halves(frame, 0, "R")[at] = f16::NEG_ONE,
            "channel R, @: a filled pixel leaves the bounds that all measured ones keep",
        ),
        (
            &|frame| halves(frame, 0, "A")[at] = f16::from_f32(1.01),
            "channel A, @: a filled pixel leaves the bounds that all measured ones keep",
        ),
        (
            &|frame| *channel(frame, 0, "id") = Samples::Uint((0..48).map(|_| 99).collect()),
            "channel id, @: a measured pixel has changed",
        ),
        (
            &|frame| {
                let Samples::Float(depth) = channel(frame, 0, "Z") else { panic!("not floats") };
                depth[at] = 4.0;
            },
            "channel Z, @: a filled pixel has a value that was measured nowhere",
        ),
    ];
    for (change, expected) in cases {
        let found = after(change);
        let pixel = if expected.contains("id") { place(first(true)) } else { place(at) };
        let expected = format!("part 0 (a), {}", expected.replace('@', &pixel));
        assert!(found[0].starts_with(&expected), "{found:?}");
        assert_eq!(found.len(), 1, "{found:?}");
    }
}

#[test]
fn headers_must_be_as_before() {
    let cases: [Case<'_>; 11] = [
        (
            &|frame| frame.parts[0].data_window.x_min -= 1,
            "the data window is (2, -2)-(10, 3), not (3, -2)-(10, 3)",
        ),
        (&|frame| frame.parts[0].display_window.y_max = 9, "the display window is"),
        (&|frame| frame.parts[0].compression = Compression::Pxr24, "the compression is pxr24, not zip"),
        (&|frame| frame.parts[0].layout = Layout::Tiles { width: 8, height: 8 }, "the layout is"),
        (&|frame| frame.parts[0].attributes.set_text("owner", "me"), "the attribute owner has changed"),
        (&|frame| assert!(frame.parts[0].attributes.remove("owner")), "the attribute owner is lost"),
        (&|frame| frame.parts[0].attributes.set_text("more", ""), "the attribute more is new"),
        (
            &|frame| frame.parts[0].attributes.set("preview", "preview", vec![0; 8]),
            "the attribute preview was made from other pixels",
        ),
        (
            &|frame| assert!(frame.parts[0].attributes.remove("lacuna/settings")),
            "the attributes lacuna/version",
        ),
        (
            &|frame| {
                frame.parts[0].channels.remove(1);
            },
            "channel R: the channel is lost",
        ),
        (
            &|frame| *channel(frame, 0, "R") = Samples::Float(vec![0.0; 48]),
            "channel R: the type is float, not half",
        ),
    ];
    for (change, expected) in cases {
        let found = after(change);
        assert!(found.iter().any(|line| line.contains(expected)), "{expected}: {found:?}");
        assert!(found.iter().all(|line| line.starts_with("part 0 (a)")), "{found:?}");
    }
    let found = after(|frame| frame.parts[1].channels.push(half("new", &[0.0; 48])));
    assert_eq!(found, ["part 1 (b), channel new: the channel is new"]);
    let found = after(|frame| frame.parts.truncate(1));
    assert_eq!(found, ["the number of parts is 1, not 2"]);
}

#[test]
fn stamps_must_agree_with_the_mask() {
    let cases: [Case<'_>; 4] = [
        (
            &|frame| frame.parts[0].attributes.set("lacuna/density", "float", 0.9_f32.to_le_bytes().to_vec()),
            "the attribute lacuna/density is 0.9, but the mask's is 0.",
        ),
        (
            &|frame| assert!(frame.parts[0].attributes.remove("lacuna/density")),
            "the attribute lacuna/density is not there",
        ),
        (
            &|frame| frame.parts[0].attributes.set_text("lacuna/mask", "gone"),
            "the attribute lacuna/mask names 'gone', which is not there; found: mask",
        ),
        (
            &|frame| frame.parts[0].attributes.set_text("lacuna/filter", "best"),
            "the attribute lacuna/filter is 'best', which is no filter",
        ),
    ];
    for (change, expected) in cases {
        let found = after(change);
        assert!(found[0].starts_with(&format!("part 0 (a): {expected}")), "{expected}: {found:?}");
        assert_eq!(found.len(), 1, "{found:?}");
    }
}

#[test]
fn filled_normals_must_be_of_unit_length() {
    let axis = |add: f32| (0..48).map(|at| add + (at % 8) as f32 / 8.0).collect::<Vec<_>>();
    let (x, y, z) = (axis(-0.5), axis(-1.0), axis(0.25));
    let length = |at: usize| (x[at].powi(2) + y[at].powi(2) + z[at].powi(2)).sqrt();
    let unit = |axis: &[f32]| (0..48).map(|at| axis[at] / length(at)).collect::<Vec<_>>();
    let channels = |scale: f32| {
        let scaled = |axis: &[f32]| unit(axis).into_iter().map(|v| v * scale).collect::<Vec<_>>();
        vec![float("N.X", &scaled(&x)), half("N.Y", &scaled(&y)), float("N.Z", &scaled(&z))]
    };
    for (scale, complains) in [(1.0, true), (0.5, false)] {
        let full = frame(vec![part(window(0, 0, 8, 6), channels(scale))]);
        let sparse = sparsify(full, Pattern::Shuffle { density: 0.4, seed: 1, frame: 0 }).unwrap().frame;
        let mut filled = filled(&sparse, &job());
        assert_eq!(lines(&sparse, &filled), [""; 0]);
        let masks = find(&sparse, &Source::Auto, None).unwrap();
        let at = masks.get(0, 0).unwrap().as_slice().iter().position(|flag| !flag).unwrap();
        let Samples::Float(values) = channel(&mut filled, 0, "N.X") else { panic!("not floats") };
        values[at] += 0.01_f32.copysign(values[at]);
        let found = lines(&sparse, &filled);
        assert_eq!(found.len(), usize::from(complains), "{found:?}");
        assert!(found.iter().all(|line| line.contains("a filled normal is not of unit length")), "{found:?}");
    }
}

#[test]
fn filled_normals_are_no_longer_than_those_around() {
    let lengths: Vec<f32> = (0..48).map(|at| [1.0, 1.0, 0.7, 0.3, 0.7, 1.0, 1.0, 1.0][at % 8]).collect();
    let none = [0.0; 48];
    let channels = vec![float("N.X", &none), float("N.Y", &none), float("N.Z", &lengths)];
    let full = frame(vec![part(window(0, 0, 8, 6), channels)]);
    let sparse = sparsify(full, Pattern::Shuffle { density: 0.5, seed: 1, frame: 0 }).unwrap().frame;
    let mut filled = filled(&sparse, &job());
    assert_eq!(lines(&sparse, &filled), [""; 0]);
    let masks = find(&sparse, &Source::Auto, None).unwrap();
    let at = masks.get(0, 0).unwrap().as_slice().iter().position(|flag| !flag).unwrap();
    let Samples::Float(values) = channel(&mut filled, 0, "N.Z") else { panic!("not floats") };
    values[at] = 1.01;
    let found = lines(&sparse, &filled);
    assert!(found.len() == 1 && found[0].contains("longer or shorter"), "{found:?}");
}

#[test]
fn measured_normals_keep_their_length_where_noise_is_smoothed() {
    let lengths: Vec<f32> = (0..48).map(|at| [1.0, 1.001, 0.7, 0.3, 0.7, 1.0, 1.001, 1.0][at % 8]).collect();
    let none = [0.0; 48];
    let channels = vec![float("N.X", &none), float("N.Y", &none), float("N.Z", &lengths)];
    let full = frame(vec![part(window(0, 0, 8, 6), channels)]);
    let sparse = sparsify(full, Pattern::Shuffle { density: 0.5, seed: 1, frame: 0 }).unwrap().frame;
    let noisy = Job { noise: "auto".parse().unwrap(), ..job() };
    let filled = filled(&sparse, &noisy);
    assert!(Claims::read(&filled).smoothed);
    assert_eq!(lines(&sparse, &filled), [""; 0]);
}

#[test]
fn long_normals_are_held_to_their_own_rounding() {
    let planes = [[0.0, 0.57, 1.0], [0.0, 0.0, 0.283], [0.0, 65504.0, 0.0]];
    let mut channels: Vec<_> =
        ["N.X", "N.Y", "N.Z"].iter().zip(&planes).map(|(name, plane)| half(name, plane)).collect();
    channels.push(half("mask", &[0.0, 1.0, 1.0]));
    let sparse = frame(vec![part(window(-4, 2, 3, 1), channels)]);
    let job = Job { limit: false, kind: Some(Kind::Float), ..Job::new(push_pull::Settings.into()) };
    assert_eq!(lines(&sparse, &filled(&sparse, &job)), [""; 0]);
}

#[test]
fn required_attributes_of_a_wrong_type_may_be_repaired() {
    let mut sparse = sparse();
    for part in &mut sparse.parts {
        part.attributes.set("lineOrder", "string", b"decreasing".to_vec());
    }
    let mut filled = filled(&sparse, &job());
    for part in &mut filled.parts {
        part.attributes.set("lineOrder", "lineOrder", vec![0]);
    }
    assert_eq!(lines(&sparse, &filled), [""; 0]);
    filled.parts[0].attributes.set("lineOrder", "int", vec![0; 4]);
    assert_eq!(lines(&sparse, &filled).len(), 1);
}

#[test]
fn what_filled_a_render_is_no_other_render() {
    let mut sparse = sparse();
    let says = |frame: &mut Frame, text: &str| frame.parts[0].attributes.set_text(RENDER, text);
    says(&mut sparse, "scene={} pixels=all fill=none");
    let mut filled = filled(&sparse, &job());
    says(&mut filled, "scene={} pixels=all fill=ss");
    assert_eq!(lines(&sparse, &filled), [""; 0]);
    says(&mut filled, "scene={} pixels=some fill=none");
    assert!(lines(&sparse, &filled)[0].contains("lacuna/render has changed"));
}

#[test]
fn an_unfilled_frame_is_not_a_filled_one() {
    let sparse = sparse();
    let found = lines(&sparse, &sparse);
    assert!(found.iter().any(|line| line.contains("not filled by lacuna")), "{found:?}");
}

#[test]
fn smoothing_may_change_measured_light_and_nothing_else() {
    let mut sparse = sparse();
    for at in 0..48 {
        let value = &mut halves(&mut sparse, 0, "R")[at];
        *value = f16::from_f32(value.to_f32() + if at % 3 == 0 { 0.25 } else { 0.0 });
    }
    let masks = find(&sparse, &Source::Auto, None).unwrap();
    for at in (0..48).filter(|&at| !masks.get(0, 0).unwrap().as_slice()[at]) {
        halves(&mut sparse, 0, "R")[at] = f16::ZERO;
    }
    let job = Job::new(Method::from(tv::Settings { epsilon: 0.3, ..tv::Settings::default() }));
    assert!(!job.method.keeps_measured());
    let mut filled = filled(&sparse, &job);
    let note = "measured pixels were not compared: the file says that they were smoothed by tv";
    assert_eq!(Claims::read(&filled).not_compared(), [note]);
    let old = halves(&mut sparse, 0, "R").clone();
    let new = halves(&mut filled, 0, "R").clone();
    assert!((0..48).any(|at| masks.get(0, 0).unwrap().as_slice()[at] && old[at] != new[at]));
    assert_eq!(lines(&sparse, &filled), [""; 0]);
    let at = first(true);
    let Samples::Uint(ids) = channel(&mut filled, 0, "id") else { panic!("not whole numbers") };
    ids[at] += 1;
    assert!(lines(&sparse, &filled)[0].contains("channel id"), "{:?}", lines(&sparse, &filled));
}

#[test]
fn smoothing_that_nothing_did_excuses_no_measured_pixel() {
    let sparse = sparse();
    let forged = |filled: &mut Frame, settings: &dyn Fn(String) -> String| {
        for part in &mut filled.parts {
            let line = part.attributes.text(SETTINGS).unwrap();
            let line = line.replace("measured=kept", "measured=smoothed");
            part.attributes.set_text(SETTINGS, &settings(line));
        }
    };
    let found = after(|filled| forged(filled, &|line| line));
    assert!(found.len() == 2 && found[0].contains("but pushpull as it is set there keeps them"), "{found:?}");
    assert_eq!(after(|filled| forged(filled, &|line| line + " noise=auto")), [""; 0]);
    let mut unsmoothed = filled(&sparse, &Job::new(Method::from(tv::Settings::default())));
    forged(&mut unsmoothed, &|line| line);
    assert!(lines(&sparse, &unsmoothed)[0].contains("but tv as it is set there keeps them"));
    forged(&mut unsmoothed, &|line| line.replace("epsilon=0", "epsilon=auto"));
    assert_eq!(lines(&sparse, &unsmoothed), [""; 0]);
}

#[test]
fn estimates_that_cannot_be_are_found() {
    let told = |line: &'static str| {
        after(move |filled| filled.parts[0].attributes.set_text("lacuna/estimate", line))
    };
    assert_eq!(told("R: 40.0 dB (38.0 to 42.0), RMSE 1.00e-2"), [""; 0]);
    let found = told("R: 60.0 dB (58.0 to 62.0), RMSE 1.00e-2");
    assert!(found.len() == 1 && found[0].contains("contradicts itself"), "{found:?}");
    let (measured, missing) = (first(true), first(false));
    let with = |at: usize, error: f32, noise: &'static str| {
        after(move |filled| {
            let part = &mut filled.parts[0];
            let line = part.attributes.text(SETTINGS).unwrap();
            let line = if noise == "none" { line } else { line.replace("=kept type", "=smoothed type") };
            part.attributes.set_text(SETTINGS, &format!("{line} noise={noise} error-channel=error"));
            let mut values = [0.0; 48];
            values[at] = error;
            part.channels.push(float("error", &values));
        })
    };
    let errors = |at: usize, error: f32| with(at, error, "none");
    assert_eq!(errors(missing, 0.5), [""; 0]);
    assert_eq!(with(measured, 0.5, "count:samples"), [""; 0]);
    for (at, error) in [(measured, 0.5), (missing, -0.5), (missing, f32::NAN), (missing, f32::INFINITY)] {
        let found = errors(at, error);
        assert!(found.len() == 1 && found[0].contains("channel error"), "{found:?}");
    }
}
