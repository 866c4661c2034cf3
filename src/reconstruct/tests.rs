//! Whole fills of hand-built frames.

use half::f16;
use lacuna_exr::{Compression, Frame, Samples};
use lacuna_filters::Method;
use lacuna_filters::baseline::{nearest, push_pull};

use super::*;
use crate::channels::choose;
use crate::mask::{Source, find};
use crate::testing::{float, frame, half, named, part, uint, values, window};

const INF: f32 = f32::INFINITY;
const NAN: f32 = f32::NAN;

fn job() -> Job {
    // Frames of tests hold values at missing pixels, and are not complete for it.
    Job { guides: crate::guides::Asked::None, ..Job::new(Method::from(push_pull::Settings)) }
}

/// Fills with the masks and rules that the job asks for.
fn filled(frame: &Frame, job: &Job) -> Result<(Frame, Report), Error> {
    let masks = find(frame, &job.mask, None).unwrap();
    let choices = choose(frame, &masks.mask_channels, &job.overrides);
    fill(frame.clone(), &masks, &choices, job, &Plans::new(), &Run::default())
}

/// A part of 8 x 4 pixels of which every second one was measured, in a checkerboard.
fn board(channels: Vec<lacuna_exr::Channel>) -> lacuna_exr::Part {
    let mut channels = channels;
    let flags: Vec<f32> = (0..32).map(|at| ((at / 8 + at) % 2) as f32).collect();
    channels.push(half("mask", &flags));
    part(window(-3, 7, 8, 4), channels)
}

fn ramp(scale: f32) -> Vec<f32> {
    (0..32).map(|at| (at % 8) as f32 * scale + 1.0).collect()
}

fn measured(at: usize) -> bool {
    (at / 8 + at) % 2 == 1
}

#[test]
fn measured_bits_and_kept_channels_stay() {
    let mut colour: Vec<f32> = ramp(0.37);
    colour[1] = -0.0;
    colour[3] = 1e-41;
    let before =
        frame(vec![board(vec![half("R", &ramp(0.1)), float("G", &colour), float("samples", &ramp(1.0))])]);
    let (after, report) = filled(&before, &job()).unwrap();
    let (old, new) = (&before.parts[0], &after.parts[0]);
    for (old, new) in old.channels.iter().zip(&new.channels) {
        assert_eq!(old.name, new.name);
        match (&old.samples, &new.samples) {
            (Samples::Half(old), Samples::Half(new)) => {
                assert!((0..32).filter(|&at| measured(at)).all(|at| old[at].to_bits() == new[at].to_bits()));
            }
            (Samples::Float(old), Samples::Float(new)) => {
                assert!((0..32).filter(|&at| measured(at)).all(|at| old[at].to_bits() == new[at].to_bits()));
            }
            _ => panic!("a type has changed"),
        }
    }
    assert_eq!(values(old, "samples"), values(new, "samples"));
    assert_eq!(values(old, "mask"), values(new, "mask"));
    assert!(values(new, "R")[2] > 1.0 && values(new, "R")[2] < 1.6);
    let filled: Vec<_> = report.parts[0].channels.iter().map(|c| (c.name.as_str(), c.filled)).collect();
    assert_eq!(filled, [("G", 16), ("R", 16), ("mask", 0), ("samples", 0)]);
    assert_eq!(report.density, Some(0.5));
    assert!(!report.copied && report.outcome.is_some());
    assert_eq!(report.parts[0].groups.len(), 1);
}

#[test]
fn what_is_not_finite_counts_as_missing_and_is_counted() {
    let mut colour = ramp(0.1);
    colour[1] = NAN;
    colour[3] = -INF;
    let mut depth = ramp(1.0);
    depth[5] = INF;
    depth[7] = NAN;
    let before = frame(vec![board(vec![float("R", &colour), float("G", &ramp(0.1)), float("Z", &depth)])]);
    let (after, report) = filled(&before, &job()).unwrap();
    let part = &after.parts[0];
    assert!(values(part, "R").iter().all(|value| value.is_finite()));
    assert!(values(part, "Z").iter().all(|value| !value.is_nan()));
    assert!(values(part, "Z")[5].is_infinite());
    assert_eq!(values(part, "G")[1].to_bits(), ramp(0.1)[1].to_bits());
    let counts: Vec<_> = report.parts[0].channels.iter().map(|c| (c.name.as_str(), c.non_finite)).collect();
    assert_eq!(counts, [("G", 0), ("R", 2), ("Z", 1), ("mask", 0)]);
    assert_eq!((report.non_finite, report.parts[0].groups.len()), (3, 2));
    let hopeless = frame(vec![board(vec![float("R", &[NAN; 32])])]);
    let error = filled(&hopeless, &job()).unwrap_err().to_string();
    assert!(error.starts_with("channel R: ") && error.contains("'R=keep'"), "{error}");
}

#[test]
fn a_nan_is_not_copied_unless_it_is_all_bits() {
    let (mut u, v) = (ramp(1.0), ramp(2.0));
    (u[5], u[7]) = (NAN, INF);
    let hash = vec![NAN; 32];
    let channels = vec![float("forward.u", &u), float("forward.v", &v), float("crypto00.r", &hash)];
    let before = frame(vec![board(channels)]);
    let mut job = job();
    job.overrides = vec!["forward.*=nearest".parse().unwrap()];
    let (after, report) = filled(&before, &job).unwrap();
    let part = &after.parts[0];
    let (new_u, new_v) = (values(part, "forward.u"), values(part, "forward.v"));
    for at in (0..32).filter(|&at| !measured(at)) {
        // Both components come from one pixel.
        assert_eq!(2.0 * new_u[at] - 1.0, new_v[at], "{at}");
    }
    assert!(new_u[5].is_nan() && new_v[5] == v[5]);
    assert!(values(part, "crypto00.r").iter().all(|value| value.is_nan()));
    assert_eq!(report.non_finite, 2);
    let told = "2 measured values are not finite and stay; missing pixels take others where there are any: forward.u 2";
    assert!(report.notes.iter().any(|note| note == told), "{:?}", report.notes);
    let (after, report) = filled(&frame(vec![board(vec![float("objectId", &u)])]), &job).unwrap();
    let unmeasured = (0..32).filter(|&at| !measured(at));
    assert_eq!(report.non_finite, 2);
    assert!({ unmeasured }.all(|at| values(&after.parts[0], "objectId")[at].is_finite()));
    // Where there is no other value, the NaN is copied.
    let alone = frame(vec![board(vec![float("forward.u", &[NAN; 32])])]);
    assert!(
        values(&filled(&alone, &job).unwrap().0.parts[0], "forward.u").iter().all(|value| value.is_nan())
    );
}

#[test]
fn identifiers_and_depths_have_only_measured_values() {
    let ids: Vec<u32> =
        (0..32).map(|at| if measured(at) { 0xffff_fff0 + at as u32 / 2 } else { 0 }).collect();
    let hash: Vec<f32> = (0..32).map(|at| f32::from_bits(0x7f80_0001 + at as u32)).collect();
    let depth: Vec<f32> =
        (0..32).map(|at| if measured(at) { if at % 8 < 4 { 2.0 } else { INF } } else { 0.0 }).collect();
    let before =
        frame(vec![board(vec![uint("id", &ids), float("CryptoAsset00.R", &hash), half("Z", &depth)])]);
    let (after, _) = filled(&before, &job()).unwrap();
    let part = &after.parts[0];
    let Samples::Uint(new) = &part.channels.iter().find(|c| c.name == b"id").unwrap().samples else {
        panic!()
    };
    assert!(new.iter().all(|id| *id >= 0xffff_fff0));
    let known = |value: &f32| (0..32).any(|at| measured(at) && hash[at].to_bits() == value.to_bits());
    assert!(values(part, "CryptoAsset00.R").iter().all(known));
    assert!(values(part, "Z").iter().all(|depth| [2.0, INF].contains(depth)));
    assert!((0..4).all(|row| values(part, "Z")[row * 8] <= 2.0 && values(part, "Z")[row * 8 + 7] >= 3.0));
}

#[test]
fn normals_are_units_and_the_background_is_empty() {
    let tilt = |at: usize| if at % 8 < 4 { (at % 8) as f32 * 0.3 } else { 0.0 };
    let x: Vec<f32> = (0..32).map(|at| tilt(at).sin()).collect();
    let z: Vec<f32> = (0..32).map(|at| if at % 8 < 4 { tilt(at).cos() } else { 0.0 }).collect();
    let before = frame(vec![board(vec![float("N.X", &x), float("N.Y", &[0.0; 32]), float("N.Z", &z)])]);
    let (after, report) = filled(&before, &job()).unwrap();
    let plane = |name| values(&after.parts[0], name);
    let (x, y, z) = (plane("N.X"), plane("N.Y"), plane("N.Z"));
    for at in 0..32 {
        let length = (x[at] * x[at] + y[at] * y[at] + z[at] * z[at]).sqrt();
        assert!((length - 1.0).abs() < 1e-6 || length == 0.0, "{at}: {length}");
        assert!(at % 8 < 5 || length == 0.0, "{at}: {length}");
    }
    assert_eq!(report.parts[0].groups[0].channels, ["N.X", "N.Y", "N.Z"]);
    let coded = vec![float("N.X", &[0.5; 32]), float("N.Y", &[0.5; 32]), float("N.Z", &ramp(0.05))];
    let (after, report) = filled(&frame(vec![board(coded)]), &job()).unwrap();
    assert!(values(&after.parts[0], "N.X").iter().all(|value| (value - 0.5).abs() < 1e-6));
    assert!(report.notes.iter().any(|note| note.contains("not of unit length")), "{:?}", report.notes);
}

#[test]
fn normals_beside_shorter_ones_are_no_units() {
    // A silhouette whose pixels are means of a normal and the background.
    let z: Vec<f32> = (0..32).map(|at| [1.0, 1.0, 1.0, 0.7, 0.3, 0.0, 0.0, 0.0][at % 8]).collect();
    let none = [0.0; 32];
    let before = frame(vec![board(vec![float("N.X", &none), float("N.Y", &none), float("N.Z", &z)])]);
    let (after, _) = filled(&before, &job()).unwrap();
    let filled = values(&after.parts[0], "N.Z");
    for at in (0..32).filter(|at| !measured(*at)) {
        let whole = at % 8 < 2;
        assert!(if whole { filled[at] > 1.0 - 1e-6 } else { filled[at] < 1.0 }, "{at}: {}", filled[at]);
        assert!(filled[at] <= 1.0 + 1e-6 && (at % 8 < 7 || filled[at] == 0.0), "{at}: {}", filled[at]);
    }
    let wrong: f32 = filled.iter().zip(&z).map(|(filled, z)| (filled - z).abs()).fold(0.0, f32::max);
    assert!(wrong < 0.4, "{wrong}");
}

#[test]
fn samples_of_a_gradient_that_are_not_finite_do_not_leave() {
    let mut slopes = ramp(0.01);
    (slopes[1], slopes[2], slopes[10]) = (NAN, NAN, INF);
    let before =
        frame(vec![board(vec![float("G", &ramp(0.1)), float("dx.G", &slopes), float("dy.G", &ramp(0.01))])]);
    let job =
        Job { method: Method::from(lacuna_filters::sensing::cs_gradient::Settings::default()), ..job() };
    let (after, report) = filled(&before, &job).unwrap();
    let new = values(&after.parts[0], "dx.G");
    for at in 0..32 {
        assert!(new[at].is_finite() && (!slopes[at].is_finite() || slopes.contains(&new[at])), "{at}");
        assert!(!slopes[at].is_finite() || new[at].to_bits() == slopes[at].to_bits(), "{at}");
    }
    let channel = report.parts[0].channels.iter().find(|channel| channel.name == "dx.G").unwrap();
    assert_eq!((channel.rule, channel.non_finite), (crate::channels::Rule::Keep, 2));
}

#[test]
fn the_parts_say_how_they_were_filled_and_lies_are_dropped() {
    let mut sparse = named("a", "", board(vec![half("R", &ramp(0.1))]));
    sparse.attributes.set("preview", "preview", vec![0; 8]);
    sparse.attributes.set_text("oiio:SHA-1", "abc");
    sparse.attributes.set_text("owner", "somebody");
    let mut dense = named("b", "", board(vec![half("keepme", &ramp(0.1))]));
    dense.attributes.set_text("oiio:SHA-1", "abc");
    let mut job = job();
    job.overrides = vec!["keepme=keep".parse().unwrap()];
    let (after, report) = filled(&frame(vec![sparse, dense.clone()]), &job).unwrap();
    let attributes = &after.parts[0].attributes;
    let names: Vec<_> = attributes.iter().map(|a| String::from_utf8_lossy(&a.name).into_owned()).collect();
    let added = ["version", "filter", "settings", "density", "mask", "kept"];
    let added = added.map(|name| format!("lacuna/{name}"));
    assert_eq!(names, [&["name", "owner"].map(String::from)[..], &added].concat());
    let stamp = Stamp::read(attributes).unwrap();
    assert!(stamp.is_of(&job) && !stamp.is_of(&Job { limit: false, ..job.clone() }));
    assert_eq!((stamp.filter.as_str(), stamp.mask.as_str()), ("pushpull", "mask"));
    assert_eq!(attributes.get("lacuna/density").unwrap().value, 0.5_f32.to_le_bytes());
    assert_eq!(stamp.source(), Some(Source::Auto));
    assert_eq!(stamp.overrides(), job.overrides);
    assert_eq!(after.parts[1], dense);
    assert!(
        report
            .notes
            .iter()
            .any(|note| note == "part 0 (a): dropped preview, oiio:SHA-1: the pixels are others now"),
        "{:?}",
        report.notes
    );
}

#[test]
fn a_full_mask_copies_and_an_empty_one_is_refused() {
    let make = |flag: f32, colour: [f32; 4]| {
        let mut part = part(window(0, 0, 2, 2), vec![float("R", &colour), half("mask", &[flag; 4])]);
        part.attributes.set_text("oiio:SHA-1", "abc");
        part
    };
    let full = frame(vec![make(1.0, [1.0, NAN, 2.0, INF])]);
    let (after, report) = filled(&full, &job()).unwrap();
    assert_eq!(after.parts[0].attributes, full.parts[0].attributes);
    let bits = |frame: &Frame| values(&frame.parts[0], "R").iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&after), bits(&full));
    assert!(report.copied);
    assert!(
        report.notes.iter().any(|note| note.starts_with("2 values are not finite")),
        "{:?}",
        report.notes
    );
    let error = filled(&frame(vec![make(0.0, [0.0; 4])]), &job()).unwrap_err();
    assert!(matches!(&error, Error::EmptyMask { origin, .. } if origin == "mask"), "{error:?}");
    assert!(
        error
            .to_string()
            .contains("has no measured pixel, so nothing says what the image is: check --mask (nan,")
    );
    // What is the matter is in the values, not in the choice of the mask.
    let error = filled(&frame(vec![make(f32::NAN, [0.0; 4])]), &job()).unwrap_err().to_string();
    assert!(error.contains("(mask) has no measured pixel, as no value of mask is finite: render"), "{error}");
    let by_values = Job { mask: Source::Finite, ..job() };
    let hole = |values: [&[f32]; 2]| {
        let channels = vec![float("G", values[0]), float("R", values[1])];
        filled(&frame(vec![part(window(0, 0, 2, 1), channels)]), &by_values).unwrap_err().to_string()
    };
    assert!(hole([&[NAN; 2]; 2]).contains("as no value of G, R is finite: render the frame again"));
    assert!(hole([&[NAN; 2], &[1.0; 2]]).contains("as no value of G is finite"));
    assert!(hole([&[NAN, 1.0], &[1.0, INF]]).contains("as every pixel has a value that is not finite"));
}

#[test]
fn a_part_without_a_mask_must_be_kept() {
    let other = named("right", "right", part(window(0, 0, 1, 1), vec![half("R", &[0.0])]));
    let before = frame(vec![named("left", "left", board(vec![half("R", &ramp(0.1))])), other.clone()]);
    let error = filled(&before, &job()).unwrap_err().to_string();
    assert!(error.starts_with("part 1 (right), channel R: no mask of its view"), "{error}");
    let masks = find(&before, &Source::Auto, None).unwrap();
    let mut choices = choose(&before, &masks.mask_channels, &[]);
    choices[1][0].rule = crate::channels::Rule::Keep;
    let (after, _) = fill(before, &masks, &choices, &job(), &Plans::new(), &Run::default()).unwrap();
    assert_eq!(after.parts[1], other);
    assert_eq!(
        fill(after, &masks, &choices[..1], &job(), &Plans::new(), &Run::default()).unwrap_err(),
        Error::OtherFrame
    );
}

#[test]
fn types_compression_levels_and_the_mask_channel_as_asked() {
    let mut before = board(vec![
        float("R", &ramp(1e5)),
        float("Z", &ramp(1e6)),
        float("id", &ramp(1.1)),
        half("G", &ramp(0.1)),
    ]);
    before.compression = Compression::Dwaa;
    before.had_levels = true;
    let before = frame(vec![before]);
    let mut job = job();
    (job.kind, job.drop_mask) = (Some(Kind::Half), true);
    let (after, report) = filled(&before, &job).unwrap();
    let part = &after.parts[0];
    assert_eq!((part.compression, part.had_levels), (Compression::Zip, false));
    let names: Vec<_> = part.channels.iter().map(|channel| channel.display_name()).collect();
    assert_eq!(names, ["G", "R", "Z", "id"]);
    assert!(matches!(part.channels[1].samples, Samples::Half(_)));
    assert!(part.channels[2..].iter().all(|channel| matches!(channel.samples, Samples::Float(_))));
    assert_eq!(values(part, "Z")[1].to_bits(), values(&before.parts[0], "Z")[1].to_bits());
    assert_eq!(values(part, "R")[1].to_bits(), f16::MAX.to_f32().to_bits());
    assert!(values(part, "R").iter().all(|value| value.is_finite()));
    assert!(report.clamped_halves > 16, "{}", report.clamped_halves);
    assert!(
        report.notes.iter().any(|note| note.starts_with("dwaa would change measured pixels: written as zip"))
    );
    assert!(report.notes.iter().any(|note| note.contains("levels")));
    job.kind = Some(Kind::Float);
    job.compression = Some(Compression::Piz);
    let (after, _) = filled(&before, &job).unwrap();
    assert!(matches!(after.parts[0].channels[0].samples, Samples::Float(_)));
    assert_eq!(values(&after.parts[0], "G")[1].to_bits(), f16::from_f32(1.1).to_f32().to_bits());
    assert_eq!(after.parts[0].compression, Compression::Piz);
}

#[test]
fn light_stays_light_and_alpha_within_one() {
    let edge: Vec<f32> = (0..32).map(|at| if at % 8 < 4 { 0.0 } else { 1.0 }).collect();
    let before = frame(vec![board(vec![half("R", &edge), half("A", &edge)])]);
    for method in [Method::from(push_pull::Settings), Method::from(nearest::Settings)] {
        let (after, _) = filled(&before, &Job::new(method)).unwrap();
        for name in ["R", "A"] {
            assert!(values(&after.parts[0], name).iter().all(|value| (0.0..=1.0).contains(value)), "{name}");
        }
    }
}

#[test]
fn a_highlight_leaves_no_darkness() {
    let light: Vec<f32> = (0..32).map(|at| if at == 10 { 1000.0 } else { 0.1 }).collect();
    let before = frame(vec![board(vec![float("R", &light)])]);
    let (after, report) = filled(&before, &job()).unwrap();
    assert!(values(&after.parts[0], "R").iter().all(|value| (0.05..=2000.0).contains(value)));
    assert_eq!(report.parts[0].groups[0].domain, "log");
    let mut linear = job();
    linear.domain = Domain::Linear;
    let (_, report) = filled(&before, &linear).unwrap();
    assert_eq!(report.parts[0].groups[0].domain, "linear");
}

#[test]
fn parts_and_frames_with_an_equal_mask_share_plans() {
    let before = frame(vec![board(vec![half("R", &ramp(0.1))]), board(vec![half("R", &ramp(0.2))])]);
    let (plans, run) = (Plans::new(), Run::default());
    let masks = find(&before, &Source::Auto, None).unwrap();
    let choices = choose(&before, &masks.mask_channels, &[]);
    let (first, _) = fill(before.clone(), &masks, &choices, &job(), &plans, &run).unwrap();
    let mask = masks.get(0, 0).unwrap();
    let plan = plans.filter(&job().method, mask, None, &run).unwrap();
    let again = find(&before, &Source::Auto, None).unwrap();
    let (second, _) = fill(before, &again, &choices, &job(), &plans, &run).unwrap();
    assert_eq!(first, second);
    let same = plans.filter(&job().method, again.get(1, 0).unwrap(), None, &run).unwrap();
    assert!(std::sync::Arc::ptr_eq(&plan, &same));
}

#[test]
fn only_light_tells_that_a_mask_is_wrong() {
    let black = [0.0; 32];
    let kept: Vec<f32> =
        ramp(0.1).iter().enumerate().map(|(at, v)| if measured(at) { 0.0 } else { *v }).collect();
    let told = |channels: Vec<lacuna_exr::Channel>, dense: &str, overrides: &[&str]| {
        let mut part = board(channels);
        part.attributes.set_text(crate::channels::DENSE, dense);
        let frame = frame(vec![part]);
        let masks = find(&frame, &Source::Auto, None).unwrap();
        let overrides: Vec<_> = overrides.iter().map(|text| text.parse().unwrap()).collect();
        wrong_mask(&frame, &masks, &choose(&frame, &masks.mask_channels, &overrides)).is_some()
    };
    let layer = |names: &str| {
        let others = names.split(' ').map(|name| float(name, &kept));
        std::iter::once(half("R", &black)).chain(others).collect::<Vec<_>>()
    };
    assert!(told(vec![half("R", &kept)], "", &[]));
    assert!(told(layer("direct.R"), "", &[]));
    // An object that no sample hit, in guides that are complete.
    for guide in ["N.X N.Y N.Z", "Z", "A", "albedo.R", "P.X"] {
        assert!(!told(layer(guide), "", &[]), "{guide}");
    }
    assert!(!told(layer("direct.R"), "direct.R", &[]));
    assert!(!told(layer("direct.R"), "", &["direct.*=keep"]));
}

#[test]
fn each_frame_says_whether_logarithms_suit_it() {
    use lacuna_filters::upscale::plain::Kernel;
    let enlarged = |method, scene: &str| {
        let asked = Enlarge {
            target: Target::Scale { x: 2.0, y: 2.0 },
            method,
            sampling: None,
            take_guides: false,
            keep_vectors: false,
        };
        let mut low = part(window(0, 0, 8, 4), vec![float("R", &ramp(10.0))]);
        low.attributes.set_text(stamp::SCENE, scene);
        let low = frame(vec![low]);
        let job = Job { domain: Domain::Log, enlarge: Some(asked), ..Job::new(Method::default()) };
        let (masks, plans, run) = (Masks::complete(&low), Plans::new(), Run::default());
        let choices = choose(&low, &masks.mask_channels, &[]);
        let done = enlarge(low, &masks, &choices, Beside::default(), (&job, &asked), &plans, &run);
        done.map(|(_, report)| report.parts[0].groups[0].domain).map_err(|error| error.to_string())
    };
    let spline = lacuna_filters::upscale::Method::Ss;
    let one_ray = r#"{"image":{"size":[8,4],"samples":1}}"#;
    assert!(enlarged(spline, "").unwrap_err().contains("point and grid, not box"));
    assert_eq!(enlarged(spline, one_ray), Ok("log"));
    assert_eq!(enlarged(lacuna_filters::upscale::Method::Plain(Kernel::Linear), ""), Ok("log"));
}

#[test]
fn a_report_names_parts_as_people_may_see_them() {
    let parts =
        ["a\u{1b}[2J", ""].map(|name| PartReport { name: Some(name.into()), ..PartReport::default() });
    let report = Report { parts: parts.into(), ..Report::default() };
    let names: Vec<_> = report.every_part().filter_map(|(name, _)| name).collect();
    assert_eq!(names, ["a\\u{1b}[2J", "part 1"]);
    assert!(report.named_parts().all(|(name, _)| name.is_none()));
}

#[test]
fn scalars_beside_colours_are_groups_of_their_own() {
    let colours = || [("B", 0.01), ("G", 0.02), ("R", 0.1)].map(|(name, scale)| float(name, &ramp(scale)));
    let names = |report: &Report| -> Vec<String> {
        report.parts[0].groups.iter().map(|group| group.channels.join(" ")).collect()
    };
    let (alone, _) = filled(&frame(vec![board(colours().into())]), &job()).unwrap();
    let long: Vec<f32> = ramp(0.1).iter().map(|&value| if value == 1.2 { 1e6 } else { value }).collect();
    let scalars =
        ["AO", "cputime", "lit.R", "lit.cost", "spectrum.450", "spectrum.550"].map(|name| float(name, &long));
    let beside = frame(vec![board(colours().into_iter().chain(scalars).collect())]);
    let (after, report) = filled(&beside, &job()).unwrap();
    let expected = ["AO", "B G R", "cputime", "lit.R", "lit.cost", "spectrum.450 spectrum.550"];
    assert_eq!(names(&report), expected);
    for name in ["B", "G", "R"] {
        assert_eq!(values(&after.parts[0], name), values(&alone.parts[0], name), "{name}");
    }
    assert_eq!(report.parts[0].groups.iter().filter(|group| group.domain == "linear").count(), 1);
}

#[test]
fn chroma_is_a_group_of_its_own_of_any_sign() {
    let below: Vec<f32> = ramp(0.1).iter().map(|value| value - 9.0).collect();
    let channels =
        [("BY", &below), ("RY", &below), ("Y", &ramp(0.1))].map(|(name, values)| float(name, values));
    let (after, report) = filled(&frame(vec![board(channels.into())]), &job()).unwrap();
    let groups: Vec<_> = report.parts[0].groups.iter().map(|group| group.channels.join(" ")).collect();
    assert_eq!(groups, ["BY RY", "Y"]);
    assert!(values(&after.parts[0], "BY").iter().all(|&value| value < 0.0));
}

#[test]
fn light_is_0_where_the_filled_alpha_is() {
    let at = |at: usize| ((at % 32) as f32, (at / 32) as f32);
    let alpha = |i: usize| ((9.0 - (at(i).0 - 15.5).hypot(at(i).1 - 15.5)) / 2.0).clamp(0.0, 1.0);
    let plane = |of: &dyn Fn(usize) -> f32| (0..1024).map(of).collect::<Vec<_>>();
    let mask = plane(&|i| f32::from(u8::from((i * 7 + i / 32 * 3) % 5 < 2)));
    let light = plane(&|i| alpha(i) * (0.3 + 0.3 * (at(i).0 / 5.0).sin().powi(2)));
    let channels = |light: &[f32]| {
        let planes = [("A", plane(&alpha)), ("R", light.to_vec()), ("mask", mask.clone())];
        planes.map(|(name, values)| float(name, &values)).into()
    };
    let dark = |light: &[f32]| {
        let before = frame(vec![part(window(0, 0, 32, 32), channels(light))]);
        let (after, _) = filled(&before, &Job::new(Method::default())).unwrap();
        let [alpha, light] = ["A", "R"].map(|name| values(&after.parts[0], name));
        (0..1024).filter(|&at| alpha[at] == 0.0).all(|at| light[at] == 0.0)
    };
    assert!(dark(&light));
    // A glow has light without alpha.
    assert!(!dark(&plane(&|i| light[i] + 0.01)));
}
