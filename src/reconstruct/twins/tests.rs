//! Frames with complete channels that hold the values of sparse ones, or nearly do.

use half::f16;
use lacuna_exr::{Channel, Frame, Samples};
use lacuna_filters::fill::Estimate;
use lacuna_filters::{Method, Plans, Run};

use crate::channels::{DENSE, choose};
use crate::mask::{Source, find};
use crate::reconstruct::{Beside, Estimated, Gate, Job, Kind, PartReport, Report, fill_with};
use crate::testing::{float, frame, half, part, values, window};
use crate::verify::{self, Claims};

const WIDTH: usize = 48;
const HEIGHT: usize = 40;

fn all(value: impl Fn(usize, usize) -> f32) -> Vec<f32> {
    (0..WIDTH * HEIGHT).map(|at| value(at / WIDTH, at % WIDTH)).collect()
}

fn measured(y: usize, x: usize) -> bool {
    (y * 7919 + x * 104_729 + y * x * 31) % 10 < 3
}

fn seen(full: &[f32]) -> Vec<f32> {
    all(|y, x| if measured(y, x) { full[y * WIDTH + x] } else { 0.0 })
}

/// Thin lines with soft rims over nothing.
fn alpha() -> Vec<f32> {
    all(|y, x| match (x + y / 2) % 11 {
        0 => 0.3 + (y % 7) as f32 / 10.1,
        1 | 2 => 1.0,
        _ => 0.0,
    })
}

/// How far away they are; infinitely beside them.
fn depth() -> Vec<f32> {
    let alpha = alpha();
    all(|y, x| if alpha[y * WIDTH + x] > 0.0 { 3.0 + (y * x) as f32 / 97.0 } else { f32::INFINITY })
}

fn normal(axis: usize) -> Vec<f32> {
    all(|y, x| {
        let (u, v) = ((x as f32 / 5.0).sin() * 0.6, (y as f32 / 7.0).cos() * 0.6);
        [u, v, (1.0 - u * u - v * v).sqrt()][axis]
    })
}

/// Colour, alpha, depth and normals at a third of the pixels.
fn sparse(twins: Vec<Channel>, listed: &str) -> Frame {
    let alpha = alpha();
    let light = all(|y, x| alpha[y * WIDTH + x] * (0.4 + 0.3 * (y as f32 / 9.0).sin()));
    let mut channels = vec![half("A", &seen(&alpha)), float("R", &seen(&light)), float("Z", &seen(&depth()))];
    channels
        .extend(["N.X", "N.Y", "N.Z"].into_iter().zip(0..).map(|(n, axis)| float(n, &seen(&normal(axis)))));
    channels.push(half("mask", &all(|y, x| f32::from(u8::from(measured(y, x))))));
    channels.extend(twins);
    let mut part = part(window(-2, 5, WIDTH as i32, HEIGHT as i32), channels);
    part.attributes.set_text(DENSE, listed);
    frame(vec![part])
}

fn twins() -> Vec<Channel> {
    let normals = ["dense.N.X", "dense.N.Y", "dense.N.Z"].into_iter().zip(0..);
    let mut channels = vec![float("dense.A", &alpha()), float("dense.Z", &depth())];
    channels.extend(normals.map(|(name, axis)| float(name, &normal(axis))));
    channels
}

const LISTED: &str = "dense.A, dense.N.X, dense.N.Y, dense.N.Z, dense.Z";

fn job(guides: &str) -> Job {
    let mut job = Job::new(Method::named("ss", &[]).unwrap());
    job.guides = guides.parse().unwrap();
    job
}

fn filled(sparse: &Frame, job: &Job, second: Option<&Frame>) -> (Frame, Report) {
    let masks = find(sparse, &Source::Auto, None).unwrap();
    let choices = choose(sparse, &masks.mask_channels, &job.overrides);
    let beside = Beside { guides: second, neighbours: None, sources: None };
    let (plans, run) = (Plans::new(), Run::default());
    fill_with(sparse.clone(), &masks, &choices, beside, job, &plans, &run).unwrap()
}

fn wrong(sparse: &Frame, filled: &Frame) -> Vec<String> {
    let claims = Claims::read(filled);
    let masks = find(sparse, &claims.mask, None).unwrap();
    let mut choices = choose(sparse, &masks.mask_channels, &claims.overrides);
    crate::guides::find(sparse, &masks, &mut choices, &claims.guides, None).unwrap();
    verify::compare(sparse, filled, &masks, &choices).iter().map(ToString::to_string).collect()
}

fn rounded(values: Vec<f32>) -> Vec<f32> {
    values.into_iter().map(|value| f16::from_f32(value).to_f32()).collect()
}

#[test]
fn what_a_complete_channel_holds_is_copied_and_told() {
    let sparse = sparse(twins(), LISTED);
    let (filled, report) = filled(&sparse, &job("auto"), None);
    let part = &filled.parts[0];
    assert!(values(part, "A") == rounded(alpha()));
    assert!(values(part, "Z") == depth());
    assert!((0..3).all(|axis| values(part, ["N.X", "N.Y", "N.Z"][axis]) == normal(axis)));
    let line = "A from dense.A, N.X from dense.N.X, N.Y from dense.N.Y, N.Z from dense.N.Z, Z from dense.Z";
    assert_eq!(super::line(&report.parts[0].copied).as_deref(), Some(line));
    assert_eq!(crate::guides::copied(&part.attributes), report.parts[0].copied);
    assert_eq!(wrong(&sparse, &filled), Vec::<String>::new());
    // No light where the alpha that is known has none.
    let light = values(part, "R").into_iter().zip(alpha());
    assert!(light.clone().all(|(light, alpha)| alpha > 0.0 || light == 0.0));
    assert!(light.filter(|(light, _)| *light > 0.1).count() > 300);
}

#[test]
fn verifying_sees_a_copy_that_is_none() {
    let sparse = sparse(twins(), LISTED);
    let (mut filled, _) = filled(&sparse, &job("auto"), None);
    let at = (0..WIDTH * HEIGHT).find(|at| !measured(at / WIDTH, at % WIDTH)).unwrap();
    let channel = filled.parts[0].channels.iter_mut().find(|channel| channel.name == b"Z").unwrap();
    let Samples::Float(depths) = &mut channel.samples else { panic!("no floats") };
    depths[at] = 1.0;
    let wrong = wrong(&sparse, &filled);
    assert!(wrong.len() == 1 && wrong[0].contains("is not that of dense.Z"), "{wrong:?}");
}

#[test]
fn other_values_names_and_wishes_copy_nothing() {
    let first = (0..WIDTH * HEIGHT).find(|at| measured(at / WIDTH, at % WIDTH)).unwrap();
    let mut jittered = alpha();
    jittered[first] += 0.01;
    let other = sparse(vec![float("dense.A", &jittered)], "dense.A");
    let renamed = sparse(vec![float("dense.cover", &jittered)], "dense.cover");
    let (one, report) = filled(&other, &job("auto"), None);
    assert!(report.parts[0].copied.is_empty());
    assert!(one.parts[0].attributes.text(crate::guides::COPIED).is_none());
    // As if its name said nothing.
    let (two, _) = filled(&renamed, &job("auto"), None);
    assert!(["A", "R", "Z"].iter().all(|name| values(&one.parts[0], name) == values(&two.parts[0], name)));
    let equal = sparse(vec![float("dense.cover", &alpha())], "dense.cover");
    assert!(filled(&equal, &job("auto"), None).1.parts[0].copied.is_empty());
    let known = sparse(twins(), LISTED);
    assert!(filled(&known, &job("none"), None).1.parts[0].copied.is_empty());
    let mut asked = job("auto");
    asked.overrides = vec!["A=fill".parse().unwrap()];
    let copied = filled(&known, &asked, None).1.parts[0].copied.clone();
    assert!(copied.len() == 4 && copied.iter().all(|copied| copied.channel != "A"), "{copied:?}");
    let mut smooth = job("auto");
    smooth.method = Method::named("ss", &[("lambda", "0.1")]).unwrap();
    assert!(filled(&known, &smooth, None).1.parts[0].copied.is_empty());
}

#[test]
fn the_guides_of_another_file_are_copied_as_well() {
    let sparse = sparse(Vec::new(), "");
    let second = vec![float("A", &alpha()), float("Z", &depth())];
    let second = part(window(-2, 5, WIDTH as i32, HEIGHT as i32), second);
    let (mut filled, report) = filled(&sparse, &job("auto"), Some(&frame(vec![second])));
    assert!(values(&filled.parts[0], "A") == rounded(alpha()));
    let line = "A from A of the guides' file, Z from Z of the guides' file";
    assert_eq!(super::line(&report.parts[0].copied).as_deref(), Some(line));
    assert_eq!(wrong(&sparse, &filled), Vec::<String>::new());
    let note = "A, Z: copied pixels were not compared: the file says that they are those of another one";
    assert_eq!(Claims::read(&filled).not_compared(), [note]);
    let at = (0..WIDTH * HEIGHT).find(|at| !measured(at / WIDTH, at % WIDTH)).unwrap();
    let channel = filled.parts[0].channels.iter_mut().find(|channel| channel.name == b"Z").unwrap();
    let Samples::Float(depths) = &mut channel.samples else { panic!("no floats") };
    depths[at] = f32::NAN;
    let wrong = wrong(&sparse, &filled);
    assert!(wrong.len() == 1 && wrong[0].contains("not finite"), "{wrong:?}");
}

#[test]
fn one_that_differs_does_not_hide_one_that_holds_the_values() {
    let sparse = sparse(Vec::new(), "");
    let mut jittered = alpha();
    jittered.rotate_right(1);
    let second = vec![float("A", &jittered), float("dense.A", &alpha())];
    let mut second = part(window(-2, 5, WIDTH as i32, HEIGHT as i32), second);
    second.attributes.set_text(DENSE, "dense.A");
    let (filled, report) = filled(&sparse, &job("auto"), Some(&frame(vec![second])));
    assert!(values(&filled.parts[0], "A") == rounded(alpha()));
    assert_eq!(super::line(&report.parts[0].copied).as_deref(), Some("A from dense.A of the guides' file"));
}

#[test]
fn a_twin_that_no_fill_may_leave_is_none() {
    let missing = (0..WIDTH * HEIGHT).find(|at| !measured(at / WIDTH, at % WIDTH)).unwrap();
    for (value, name) in [(1.5, "A"), (-0.25, "A"), (f32::NAN, "Z"), (f32::NEG_INFINITY, "Z")] {
        let mut twin = if name == "A" { alpha() } else { depth() };
        twin[missing] = value;
        let dense = format!("dense.{name}");
        let sparse = sparse(vec![float(&dense, &twin)], &dense);
        let (filled, report) = filled(&sparse, &job("auto"), None);
        assert!(report.parts[0].copied.is_empty(), "{name} {value}");
        assert_eq!(wrong(&sparse, &filled), Vec::<String>::new());
    }
    // Beyond the largest half, where the result is one.
    let mut light = all(|y, x| 0.1 + ((y * 3 + x) % 19) as f32 / 20.0);
    let seen = seen(&light);
    light[missing] = 1e6;
    let mut sparse = sparse(vec![float("dense.G", &light)], "dense.G");
    sparse.parts[0].channels.push(float("G", &seen));
    let halves = Job { kind: Some(Kind::Half), ..job("auto") };
    assert!(filled(&sparse, &halves, None).1.parts[0].copied.is_empty());
    assert!(!filled(&sparse, &job("auto"), None).1.parts[0].copied.is_empty());
}

#[test]
fn any_names_of_channels_and_parts_are_told() {
    let odd = "x from a, b; c";
    let mut one = sparse(vec![float(&format!("{odd}.A"), &alpha())], "");
    one.parts[0].attributes.set_text(DENSE, "");
    let (one_filled, report) = filled(&one, &job("x from*"), None);
    let line = format!("A from {odd}.A");
    assert_eq!(super::line(&report.parts[0].copied).as_deref(), Some(line.as_str()));
    assert_eq!(crate::guides::copied(&one_filled.parts[0].attributes), report.parts[0].copied);
    assert_eq!(wrong(&one, &one_filled), Vec::<String>::new());

    let mut two = sparse(Vec::new(), "");
    two.parts[0].attributes.set_text("name", "beauty");
    let mut dense = part(window(-2, 5, WIDTH as i32, HEIGHT as i32), vec![float("A", &alpha())]);
    dense.attributes.set_text("name", odd);
    dense.attributes.set_text(DENSE, "A");
    two.parts.push(dense);
    let (mut two_filled, report) = filled(&two, &job("auto"), None);
    let line = format!("A from A of part {odd}");
    assert_eq!(super::line(&report.parts[0].copied).as_deref(), Some(line.as_str()));
    assert_eq!(wrong(&two, &two_filled), Vec::<String>::new());
    // Looked up in that part, which has to be there.
    let mut claim = report.parts[0].copied.clone();
    claim[0].place = super::Place::Part { index: 7, name: None };
    crate::guides::write_copied(&mut two_filled.parts[0].attributes, &claim);
    let wrong = wrong(&two, &two_filled);
    assert!(wrong.len() == 1 && wrong[0].contains("A of part 7, which is not there"), "{wrong:?}");
}

#[test]
fn a_part_that_nothing_filled_stays_when_the_others_are_made_sparse_again() {
    let mut sparse = sparse(Vec::new(), "");
    sparse.parts[0].attributes.set_text("name", "beauty");
    sparse.parts[0].channels.retain(|channel| !channel.display_name().starts_with("N."));
    let normals = ["N.X", "N.Y", "N.Z"].into_iter().zip(0..).map(|(name, axis)| float(name, &normal(axis)));
    let dense = [float("A", &alpha())].into_iter().chain(normals).collect();
    let mut dense = part(window(-2, 5, WIDTH as i32, HEIGHT as i32), dense);
    dense.attributes.set_text("name", "dense");
    sparse.parts.push(dense);
    let (mut again, report) = filled(&sparse, &job("auto"), None);
    assert_eq!(super::line(&report.parts[0].copied).as_deref(), Some("A from A of part dense"));
    let masks = find(&again, &Source::Auto, None).unwrap();
    let choices = choose(&again, &masks.mask_channels, &[]);
    crate::reconstruct::blank(&mut again, &masks, &choices);
    assert!(values(&again.parts[1], "A") == alpha() && values(&again.parts[1], "N.X") == normal(0));
    assert!(values(&again.parts[0], "R") == values(&sparse.parts[0], "R"));
}

#[test]
fn copied_light_stays_where_alpha_is_0() {
    let alpha_ = alpha();
    let glow = (0..WIDTH * HEIGHT)
        .filter(|at| !measured(at / WIDTH, at % WIDTH))
        .find(|&at| alpha_[at] == 0.0)
        .unwrap();
    let mut sparse = sparse(Vec::new(), "");
    let mut light = all(|y, x| alpha_[y * WIDTH + x] * (0.4 + 0.3 * (y as f32 / 9.0).sin()));
    light[glow] = 4.0;
    sparse.parts[0].channels.push(float("dense.A", &alpha_));
    sparse.parts[0].channels.push(float("dense.R", &light));
    sparse.parts[0].attributes.set_text(DENSE, "dense.A, dense.R");
    let (filled, _) = filled(&sparse, &job("auto"), None);
    assert!(values(&filled.parts[0], "R") == light);
    assert_eq!(wrong(&sparse, &filled), Vec::<String>::new());
}

#[test]
fn copied_light_has_no_errors_to_write() {
    let light = all(|y, x| 0.1 + ((y * 3 + x) % 19) as f32 / 20.0);
    let mut sparse = sparse(vec![float("dense.G", &light)], "dense.G");
    sparse.parts[0].channels.push(float("G", &seen(&light)));
    let job = Job { estimate: Estimate::Pixels, error_channel: Some("error".into()), ..job("auto") };
    let (filled, report) = filled(&sparse, &job, None);
    assert!(values(&filled.parts[0], "G") == light);
    let said = "G: no estimated errors: they are copied";
    assert!(report.notes.iter().any(|note| note == said), "{:?}", report.notes);
    let group = report.parts[0].groups.iter().find(|group| group.channels == ["G"]).unwrap();
    let equal_pixels = (0..WIDTH * HEIGHT).filter(|at| measured(at / WIDTH, at % WIDTH)).count();
    let told = Estimated::Copied { copied_from: vec!["dense.G".into()], equal_pixels };
    assert_eq!(group.estimate, Some(told));
    let gate = Gate { min_psnr: Some(300.0), max_rmse: Some(0.0) };
    let only = Report {
        parts: vec![PartReport { groups: vec![group.clone()], ..report.parts[0].clone() }],
        ..report.clone()
    };
    assert_eq!(gate.doubt(&only), None);
}

#[test]
fn a_known_alpha_blackens_only_what_the_samples_show_to_be_black() {
    let lit = |flaw: f32| {
        let mut frame = sparse(vec![float("dense.A", &alpha())], "dense.A");
        let alpha = alpha();
        let empty = (0..WIDTH * HEIGHT).find(|&at| measured(at / WIDTH, at % WIDTH) && alpha[at] == 0.0);
        let channel = frame.parts[0].channels.iter_mut().find(|channel| channel.name == b"R").unwrap();
        let Samples::Float(light) = &mut channel.samples else { panic!("no floats") };
        light[empty.unwrap()] = flaw;
        let (filled, _) = filled(&frame, &job("auto"), None);
        let light = values(&filled.parts[0], "R").into_iter().zip(alpha).enumerate();
        light.filter(|(at, (l, a))| !measured(at / WIDTH, at % WIDTH) && *a == 0.0 && *l != 0.0).count()
    };
    assert_eq!(lit(0.0), 0);
    assert!(lit(0.25) > 0);
}
