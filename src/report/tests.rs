//! The model and its formats, from frames built by hand.

use std::collections::BTreeSet;

use lacuna_exr::Frame;

use super::*;
use crate::mask::{self, Source};
use crate::testing::{float, frame, half, part, uint, window};

/// 4 x 1 pixels: two measured, one wrong missing one, one NaN.
fn pair() -> (Frame, Frame) {
    let window = window(10, -2, 4, 1);
    let reference = part(
        window,
        vec![
            float("R", &[0.0, 0.5, 1.0, 0.25]),
            float("G", &[0.0, 0.5, 1.0, 0.25]),
            float("B", &[0.0, 0.5, 1.0, 0.25]),
            half("A", &[0.0, 1.0, 1.0, 0.0]),
            uint("id", &[1, 2, 3, 4]),
        ],
    );
    let test = part(
        window,
        vec![
            float("R", &[0.0, 0.5, 0.8, 0.25]),
            float("G", &[0.0, 0.5, 1.0, f32::NAN]),
            float("B", &[0.0, 0.5, 1.0, 0.25]),
            half("A", &[0.0, 1.0, 1.0, 0.0]),
            uint("id", &[1, 9, 3, 4]),
            half("mask", &[1.0, 1.0, 0.0, 0.0]),
        ],
    );
    (frame(vec![reference]), frame(vec![test]))
}

fn compared(settings: &Settings) -> FrameReport {
    let (reference, test) = pair();
    let masks = mask::find(&test, &Source::Auto, None).unwrap();
    compare(&reference, &test, Some(&masks), settings, &mut |_| {}).unwrap()
}

fn whole(frames: Vec<FrameReport>) -> Comparison {
    Comparison { lacuna: "1", settings: Settings::default(), gate: Vec::new(), frames }
}

fn gate(below: &str, above: &str) -> Gate {
    let of = |text: &str| text.split(',').filter(|t| !t.is_empty()).map(|t| t.parse().unwrap()).collect();
    Gate { below: of(below), above: of(above) }
}

#[test]
fn regions_and_groups_are_what_they_say() {
    let report = compared(&Settings::default());
    let labels: Vec<_> = report.groups.iter().map(GroupReport::label).collect();
    assert_eq!(labels, ["RGB", "A", "id"]);
    let colour = report.main_group().unwrap();
    assert_eq!(
        (colour.density, colour.measured_max, colour.measured_different),
        (Some(0.5), Some(0.0), Some(0))
    );
    let get = |region: &str, measure| colour.region(region).unwrap().measures.get(measure).unwrap();
    let error = f64::from(1.0 - 0.8_f32);
    // Eleven finite values of twelve.
    assert!((get("all", Measure::Mse) - error * error / 11.0).abs() < 1e-15);
    assert!((get("missing", Measure::Mse) - error * error / 5.0).abs() < 1e-15);
    assert!((get("alpha", Measure::Mse) - error * error / 6.0).abs() < 1e-15);
    assert_eq!((get("all", Measure::Nan), get("all", Measure::Different)), (1.0, 2.0));
    assert_eq!(colour.region("all").unwrap().largest_at, Some((12, -2)));
    let codes = report.groups[2].region("all").unwrap();
    assert_eq!(codes.measures.get(Measure::Different), Some(1.0));
    assert_eq!((codes.measures.get(Measure::Psnr), report.groups[2].measured_different), (None, Some(1)));
    assert_eq!(report.groups[1].region("all").unwrap().measures.get(Measure::Psnr), Some(f64::INFINITY));
}

#[test]
fn a_view_takes_no_alpha_of_another() {
    let pixels = |names: &[&str]| {
        let value = |name: &&str| float(name, if *name == "right.A" { &[1.0, 1.0] } else { &[0.0, 1.0] });
        let mut part = part(window(0, 0, 2, 1), names.iter().map(value).collect());
        part.attributes.set("multiView", "stringvector", b"\x04\0\0\0left\x05\0\0\0right".to_vec());
        let frame = frame(vec![part]);
        let report = compare(&frame, &frame, None, &Settings::default(), &mut |_| {}).unwrap();
        let of = |group: &GroupReport| group.region("alpha")?.measures.get(Measure::Pixels);
        report.groups.iter().filter(|group| group.kind == Kind::Colour).map(of).collect::<Vec<_>>()
    };
    assert_eq!(pixels(&["A", "R", "right.R"]), [Some(1.0), None]);
    assert_eq!(pixels(&["A", "R", "right.A", "right.R", "right.key.R"]), [Some(1.0), Some(2.0), Some(2.0)]);
}

#[test]
fn dear_measures_are_there_only_if_wanted() {
    let plain = compared(&Settings::default());
    let all = compared(&Settings { wanted: Wanted::all(), ..Settings::default() });
    for measure in [Measure::Cieluv, Measure::Flip, Measure::HdrFlip] {
        let of = |report: &FrameReport| report.groups[0].region("all").unwrap().measures.get(measure);
        assert_eq!(of(&plain), None);
        assert!(of(&all).is_some_and(|value| value > 0.0), "{measure:?}");
    }
}

#[test]
fn what_cannot_be_compared_is_like_nothing() {
    let flat = |value: f32| {
        frame(vec![part(window(0, 0, 2, 1), ["R", "G", "B"].map(|n| float(n, &[value; 2])).into())])
    };
    let settings = Settings { wanted: Wanted::all(), ..Settings::default() };
    let report = compare(&flat(0.5), &flat(f32::NAN), None, &settings, &mut |_| {}).unwrap();
    for measure in [Measure::Psnr, Measure::Ssim, Measure::Cieluv, Measure::Flip, Measure::HdrFlip] {
        assert_eq!(report.groups[0].region("all").unwrap().measures.get(measure), None, "{measure:?}");
    }
}

#[test]
fn what_clipping_hides_is_told_and_no_gate_lets_it_pass() {
    let flat = |values: [f32; 2]| {
        frame(vec![part(window(0, 0, 2, 1), ["R", "G", "B"].map(|n| float(n, &values)).into())])
    };
    let found = |test: [f32; 2], settings: &Settings| {
        let report = compare(&flat([5.0, 0.5]), &flat(test), None, settings, &mut |_| {}).unwrap();
        let failures = gate("psnr=1", "").failures(&report, false, &BTreeSet::new()).len();
        // A bound that tells those values apart judges them itself.
        assert!(gate("psnr=1", "relative-mse=1e9").failures(&report, false, &BTreeSet::new()).is_empty());
        (report.groups[0].hidden, report.notes.len(), failures)
    };
    let settings = Settings::default();
    assert_eq!(found([100.0, 0.5], &settings), (Some(0.5), 1, 1));
    assert_eq!(found([100.0, 0.4], &settings), (Some(0.5), 1, 0));
    assert_eq!(found([5.0, 0.4], &settings), (None, 0, 0));
    assert_eq!(found([100.0, 0.5], &Settings { peak: 200.0, ..Settings::default() }), (None, 0, 0));
}

#[test]
fn channels_without_a_partner_are_told_in_one_line() {
    let (reference, mut test) = pair();
    let spare: Vec<_> = ["a.X", "a.Y", "b"].map(|name| float(name, &[0.0; 4])).into();
    test.parts[0].channels.extend(spare);
    let notes = |a: &Frame, b: &Frame| compare(a, b, None, &Settings::default(), &mut |_| {}).unwrap().notes;
    assert_eq!(notes(&reference, &test), ["channels a.X, a.Y, b are in the test image only"]);
    assert_eq!(notes(&test, &reference), ["channels a.X, a.Y, b are in the reference only"]);
    test.parts[0].channels.truncate(reference.parts[0].channels.len() + 2);
    assert_eq!(notes(&reference, &test), ["channel a.X is in the test image only"]);
}

/// One row of a frame of 9 pixels, from this column on.
fn row(from: i32, values: &[f32]) -> Frame {
    let own = part(window(from, 0, values.len() as i32, 1), vec![float("R", values)]);
    frame(vec![lacuna_exr::Part { display_window: window(0, 0, 9, 1), ..own }])
}

#[test]
fn pixels_are_compared_by_absolute_coordinates() {
    let of = |a: &Frame, b: &Frame| compare(a, b, None, &Settings::default(), &mut |_| {});
    let (reference, test) = (row(1, &[0.5, 0.25, 0.75]), row(2, &[0.25, 0.75, 0.5]));
    let report = of(&reference, &test).unwrap();
    let all = report.groups[0].region("all").unwrap();
    let get = |measure| all.measures.get(measure).unwrap();
    // Column 1 is the reference's alone, column 4 the test image's.
    assert_eq!((get(Measure::Pixels), get(Measure::Different), get(Measure::Mse)), (4.0, 2.0, 0.125));
    assert_eq!((report.groups[0].beyond, all.largest_at), (Some(2), Some((1, 0))));
    assert!(
        report.notes[0].contains("(1, 0) to (3, 0) in the reference and (2, 0) to (4, 0)"),
        "{:?}",
        report.notes
    );
    assert!(report.notes[0].contains("(1 in the reference, 1 in the test image)"), "{:?}", report.notes);
    // Pixels that neither has are none.
    let apart = of(&row(0, &[0.5]), &row(4, &[0.5])).unwrap();
    assert_eq!(apart.groups[0].region("all").unwrap().measures.get(Measure::Pixels), Some(2.0));
    // A background of 0 is none that is lost.
    let cropped = of(&row(0, &[0.0, 0.5, 0.25, 0.0]), &row(1, &[0.5, 0.25])).unwrap();
    assert_eq!(cropped.groups[0].region("all").unwrap().measures.get(Measure::Psnr), Some(f64::INFINITY));
    assert_eq!((cropped.groups[0].beyond, cropped.notes.len()), (None, 1));
}

#[test]
fn windows_of_different_images_are_not_compared() {
    let (reference, mut test) = pair();
    test.parts[0].data_window.x_min += 1;
    test.parts[0].data_window.x_max += 1;
    test.parts[0].display_window.x_max += 1;
    let error = compare(&reference, &test, None, &Settings::default(), &mut |_| {}).unwrap_err();
    assert!(error.to_string().contains("(10, -2) to (13, -2)"), "{error}");
}

#[test]
fn no_gate_passes_what_lies_beyond_a_window_unseen() {
    let failures = |lost: f32, bound: &str| {
        let report =
            compare(&row(0, &[lost, 0.5]), &row(1, &[0.5]), None, &Settings::default(), &mut |_| {}).unwrap();
        gate(bound, "").failures(&report, false, &BTreeSet::new())
    };
    let beyond = |failures: &[String]| failures.iter().filter(|text| text.contains("data windows")).count();
    assert_eq!(beyond(&failures(0.5, "missing.psnr=1")), 1);
    // The error itself is seen over the whole image.
    assert_eq!((beyond(&failures(0.5, "psnr=90")), failures(0.5, "psnr=90").len()), (0, 1));
    // Clipping leaves nothing of it.
    assert_eq!(beyond(&failures(-0.5, "psnr=90")), 1);
    assert_eq!(beyond(&failures(0.0, "psnr=90,missing.psnr=1")), 0);
}

#[test]
fn the_gate_lets_nothing_pass_by_absence() {
    let report = compared(&Settings::default());
    assert_eq!(Gate::default().failures(&report, false, &BTreeSet::new()), Vec::<String>::new());
    let failures = gate("psnr=20", "").failures(&report, false, &BTreeSet::new());
    assert_eq!(failures, ["RGB: 1 value is not finite that should be"]);
    // A depth that is infinite where a neighbour's was; a colour or a depth without background must not be.
    let depth = |values: &[f32]| frame(vec![part(pair().0.parts[0].data_window, vec![float("Z", values)])]);
    let far = f32::INFINITY;
    for (reference, test, failures) in [
        ([1.0, 2.0, far, far], [1.0, far, far, far], 0),
        ([1.0, 2.0, far, far], [1.0, f32::NAN, far, far], 1),
        ([1.0, 2.0, 3.0, 4.0], [1.0, far, 3.0, 4.0], 1),
        // As many as in the reference, elsewhere.
        ([1.0, f32::NAN, 3.0, 4.0], [f32::NAN, 2.0, 3.0, 4.0], 1),
        ([1.0, f32::NAN, 3.0, 4.0], [1.0, f32::NAN, 3.0, 4.0], 0),
    ] {
        let report =
            compare(&depth(&reference), &depth(&test), None, &Settings::default(), &mut |_| {}).unwrap();
        assert_eq!(gate("psnr=1", "").failures(&report, false, &BTreeSet::new()).len(), failures, "{test:?}");
    }
    let failures = gate("psnr=60,missing.ssim=2", "flip=0.1").failures(&report, false, &BTreeSet::new());
    assert_eq!(failures.len(), 4, "{failures:?}");
    assert!(failures[1].starts_with("RGB: psnr 24.39"), "{failures:?}");
    assert_eq!(failures[3], "RGB: no flip");
    let failures = gate("", "different=0").failures(&report, false, &BTreeSet::new());
    assert!(failures.contains(&"id: different 1 is above 0".to_owned()), "{failures:?}");
    let without = FrameReport { notes: vec!["channel A is in the reference only".into()], ..report };
    assert!(gate("psnr=1", "").failures(&without, false, &BTreeSet::new()).contains(&without.notes[0]));
}

#[test]
fn bounds_on_changes_hold_of_missing_pixels_and_take_a_sequence() {
    let mut later = compared(&Settings::default());
    let regions = &mut later.groups[0].regions;
    let missing = regions.iter_mut().find(|region| region.region == "missing").unwrap();
    missing.measures.set(Measure::FlickerAlong, 0.5);
    let first = compared(&Settings::default());
    for (above, fails) in
        [("flicker-along=0.4", true), ("missing.flicker-along=0.4", true), ("flicker-along=1", false)]
    {
        let gate = gate("", above);
        assert!(gate.unknown(&[&first, &later]).is_empty());
        let failures = gate.failures(&later, true, &BTreeSet::new());
        assert_eq!(failures.iter().any(|text| text.contains("flicker-along")), fails, "{failures:?}");
        // Of one frame nothing is known, which is told once.
        let unknown = gate.unknown(&[&first]);
        assert_eq!(unknown, BTreeSet::from([Measure::FlickerAlong]));
        assert!(why_unknown(Measure::FlickerAlong).contains("takes a sequence"));
        let failures = gate.failures(&first, true, &unknown);
        assert!(!failures.iter().any(|text| text.contains("flicker-along")), "{failures:?}");
    }
    // That one measure is unknown lets no other pass.
    let gate = gate("", "flicker-along=1,flicker=1");
    let unknown = gate.unknown(&[&first, &later]);
    assert_eq!(unknown, BTreeSet::from([Measure::Flicker]));
    assert!(gate.failures(&first, true, &unknown).iter().any(|text| text.contains("no flicker-along")));
}

#[test]
fn json_has_numbers_and_names_infinities() {
    let json = serde_json::to_value(whole(vec![compared(&Settings::default())])).unwrap();
    let group = &json["frames"][0]["groups"][0];
    assert_eq!(group["kind"], "colour");
    assert_eq!(group["regions"][0]["measures"]["nan"], 1);
    assert!(group["regions"][0]["measures"]["psnr"].is_f64());
    assert_eq!(json["frames"][0]["groups"][1]["regions"][0]["measures"]["psnr"], "inf");
}

#[test]
fn csv_has_as_many_cells_in_every_line() {
    let failed = FrameReport { error: Some("broken, \"really\"".into()), ..FrameReport::default() };
    let text = csv(&whole(vec![compared(&Settings::default()), failed]));
    let lines: Vec<&str> = text.lines().collect();
    // RGB with three channels, A and id, each in three regions; the failed frame; the head.
    assert_eq!(lines.len(), 1 + 3 * (4 + 1 + 1) + 1);
    let cells = |line: &str| line.matches(',').count();
    assert!(lines[..lines.len() - 1].iter().all(|line| cells(line) == cells(lines[0])));
    assert!(lines[lines.len() - 1].ends_with("\"broken, \"\"really\"\"\""));
    let wanting = |report| FrameReport { failures: vec!["psnr, low".into(), "no flip".into()], ..report };
    let text = csv(&whole(vec![wanting(compared(&Settings::default())), wanting(FrameReport::default())]));
    assert!(text.lines().skip(1).all(|line| line.ends_with(",\"psnr, low; no flip\",")), "{text}");
    assert_eq!(text.lines().count(), lines.len());
    // Of the codes one measured value differs, whose error is none.
    assert!(text.lines().any(|line| line.starts_with(",,,,,id,all,0.5,,1,")), "{text}");
}

#[test]
fn markdown_has_a_table_a_region() {
    let mut report = compared(&Settings::default());
    report.failures.push("RGB: psnr 1 is below 2 | x".into());
    let text = markdown(&whole(vec![report.clone(), report]));
    for expected in [
        "### Whole image",
        "### Missing pixels only",
        "### Where alpha",
        "| **mean** |",
        "2 \\| x",
        "peak 1",
        "- measured pixels: largest error 0, 2 values whose bits differ",
    ] {
        assert!(text.contains(expected), "{expected}\n{text}");
    }
}
