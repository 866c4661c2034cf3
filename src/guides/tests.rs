//! Which channels of hand-built frames guide, and what becomes of their rules.

use lacuna_exr::{Channel, Compression, Frame, Part};

use super::*;
use crate::channels::{Choice, Rule, choose};
use crate::mask::{Masks, Source};
use crate::testing::{float, frame, half, named, part, uint, window};

const PIXELS: usize = 64;

fn measured(at: usize) -> bool {
    at.is_multiple_of(3)
}

fn board(channels: Vec<Channel>) -> Part {
    let flags: Vec<f32> = (0..PIXELS).map(|at| f32::from(u8::from(measured(at)))).collect();
    let mut channels = channels;
    channels.push(half("mask", &flags));
    part(window(2, -1, 8, 8), channels)
}

fn ramp(offset: usize) -> Vec<f32> {
    (0..PIXELS).map(|at| ((at * 7 + offset) % 11) as f32 / 10.0).collect()
}

/// The same, zero where pixels are missing.
fn sparse(offset: usize) -> Vec<f32> {
    ramp(offset).iter().enumerate().map(|(at, value)| if measured(at) { *value } else { 0.0 }).collect()
}

fn colour() -> Vec<Channel> {
    vec![half("R", &sparse(1)), half("G", &sparse(2)), half("B", &sparse(3))]
}

fn normals(values: impl Fn(usize) -> Vec<f32>) -> Vec<Channel> {
    vec![half("N.X", &values(4)), half("N.Y", &values(5)), half("N.Z", &values(6))]
}

fn search(frame: &Frame, asked: &str, second: Option<&Frame>) -> Result<(Found, Vec<Vec<Choice>>), Error> {
    let masks: Masks = crate::mask::find(frame, &Source::Auto, None).unwrap();
    let mut choices = choose(frame, &masks.mask_channels, &[]);
    let found = find(frame, &masks, &mut choices, &asked.parse().unwrap(), second)?;
    Ok((found, choices))
}

fn rule(frame: &Frame, choices: &[Vec<Choice>], name: &str) -> Rule {
    let at = frame.parts[0].channels.iter().position(|channel| channel.name == name.as_bytes()).unwrap();
    choices[0][at].rule
}

#[test]
fn auto_takes_what_is_complete_and_keeps_it() {
    let channels = [
        colour(),
        normals(ramp),
        vec![float("Z", &ramp(1)), half("albedo.R", &sparse(2)), half("A", &ramp(9))],
    ];
    let labels: Vec<u32> = (0..PIXELS).map(|at| u32::from(at > 20)).collect();
    let frame = frame(vec![board([channels.concat(), vec![uint("objectId", &labels)]].concat())]);
    let (found, choices) = search(&frame, "auto", None).unwrap();
    assert_eq!(found.names(0), ["A", "N", "Z", "objectId"]);
    let kinds: Vec<Kind> = found.parts[0].iter().map(|guide| guide.kind).collect();
    assert_eq!(kinds, [Kind::Values, Kind::Values, Kind::Values, Kind::Labels]);
    for (name, expected) in [
        ("A", Rule::Keep),
        ("N.X", Rule::Keep),
        ("Z", Rule::Keep),
        ("objectId", Rule::Keep),
        ("R", Rule::Fill),
        ("albedo.R", Rule::Fill),
    ] {
        assert_eq!(rule(&frame, &choices, name), expected, "{name}");
    }
    let (found, choices) = search(&frame, "none", None).unwrap();
    assert!(found.names(0).is_empty());
    assert_eq!(rule(&frame, &choices, "N.X"), Rule::Normal);
    let (found, choices) = search(&frame, "Z,N.*", None).unwrap();
    assert_eq!(found.names(0), ["N", "Z"]);
    // What is complete is kept, whether it guides or not.
    assert_eq!((rule(&frame, &choices, "A"), rule(&frame, &choices, "N.Y")), (Rule::Keep, Rule::Keep));
}

#[test]
fn channels_that_were_left_out_of_a_layer_are_filled() {
    let part_of = |x: Vec<f32>, y: Vec<f32>| {
        board([colour(), vec![half("N.X", &x), half("N.Y", &y), half("N.Z", &ramp(6))]].concat())
    };
    let alone = frame(vec![part_of(sparse(4), sparse(5))]);
    let (found, choices) = search(&alone, "auto", None).unwrap();
    assert_eq!(found.names(0), ["N.Z"]);
    assert_eq!((rule(&alone, &choices, "N.X"), rule(&alone, &choices, "N.Z")), (Rule::Fill, Rule::Keep));
    assert_eq!(search(&alone, "N.*", None), Err(Error::Sparse { channel: "N".into() }));
    let mut listed = part_of(sparse(4), ramp(5));
    listed.attributes.set_text(crate::channels::DENSE, "N.Z,N.Y");
    let listed = frame(vec![listed]);
    let (found, choices) = search(&listed, "auto", None).unwrap();
    assert_eq!(found.parts[0][0].channels.len(), 2);
    assert_eq!((rule(&listed, &choices, "N.X"), rule(&listed, &choices, "N.Z")), (Rule::Fill, Rule::Keep));
    let masks = crate::mask::find(&alone, &Source::Auto, None).unwrap();
    let mut choices = choose(&alone, &masks.mask_channels, &["N.Z=keep".parse().unwrap()]);
    find(&alone, &masks, &mut choices, &Asked::Auto, None).unwrap();
    assert_eq!((rule(&alone, &choices, "N.X"), rule(&alone, &choices, "N.Z")), (Rule::Fill, Rule::Keep));
}

#[test]
fn views_are_guided_by_their_own() {
    let right = |channels: Vec<Channel>| -> Vec<Channel> {
        let named = |channel: Channel| {
            let name = [b"right.".as_slice(), &channel.name].concat();
            Channel { name, ..channel }
        };
        channels.into_iter().map(named).collect()
    };
    let stereo = |channels: Vec<Channel>| {
        let mut part = part(window(2, -1, 8, 8), channels);
        let views: Vec<u8> = ["left", "right"]
            .iter()
            .flat_map(|view| [&(view.len() as u32).to_le_bytes(), view.as_bytes()].concat())
            .collect();
        part.attributes.set("multiView", "stringvector", views);
        part
    };
    let alpha = || vec![half("A", &ramp(9))];
    let mut own = board([colour(), alpha(), right(colour()), right(alpha())].concat()).channels;
    own.push(half("RGBA.A", &ramp(3)));
    let own = frame(vec![stereo(own)]);
    let (found, choices) = search(&own, "auto", None).unwrap();
    assert_eq!(found.names(0), ["A", "RGBA.A", "right.A"]);
    let served = |view: &str| found.parts[0].iter().filter(|guide| guide.serves(Some(view))).count();
    assert_eq!((served("left"), served("right")), (2, 1));
    assert_eq!(rule(&own, &choices, "right.A"), Rule::Keep);
    let of = |view: Option<&str>, channels: Vec<Channel>| {
        named("", view.unwrap_or_default(), part(window(2, -1, 8, 8), channels))
    };
    let views = frame(vec![of(Some("left"), normals(ramp)), of(Some("right"), normals(ramp))]);
    let (found, _) = search(&own, "auto", Some(&views)).unwrap();
    let seen: Vec<_> = found.parts[0].iter().map(|guide| guide.view.as_deref()).collect();
    assert_eq!(seen, [Some("left"), Some("right")]);
    let plain = frame(vec![of(None, normals(ramp)), of(None, vec![float("Z", &ramp(1))])]);
    assert!(search(&own, "auto", Some(&plain)).unwrap().0.parts[0].iter().all(|guide| guide.view.is_none()));
    let other = frame(vec![of(Some("top"), normals(ramp)), of(Some("side"), normals(ramp))]);
    let error = search(&own, "auto", Some(&other)).unwrap_err().to_string();
    assert!(error.contains("no part has the view left or right and the data window 8x8"), "{error}");
}

#[test]
fn sparse_channels_are_no_guides() {
    let cleared = |clear: f32| {
        let values = move |offset| {
            ramp(offset)
                .iter()
                .enumerate()
                .map(|(at, v)| if measured(at) { *v } else { clear })
                .collect::<Vec<_>>()
        };
        frame(vec![board([colour(), normals(values)].concat())])
    };
    for clear in [0.0, 1.0, f32::NAN, -1.0] {
        let frame = cleared(clear);
        let (found, choices) = search(&frame, "auto", None).unwrap();
        assert!(found.names(0).is_empty(), "{clear}");
        assert_eq!(rule(&frame, &choices, "N.X"), Rule::Normal);
        assert_eq!(search(&frame, "N.*", None), Err(Error::Sparse { channel: "N".into() }), "{clear}");
    }
    let frame = cleared(0.0);
    assert!(matches!(search(&frame, "N.*,depth", None), Err(Error::Sparse { .. })));
    assert!(matches!(search(&frame, "depth", None), Err(Error::NoChannel { asked, .. }) if asked == "depth"));
}

#[test]
fn what_a_lossy_compression_made_of_zeros_is_no_guide() {
    let changed = |most: f32| {
        let values = move |offset| {
            let noise = (0..PIXELS).map(move |at| most * ((at * 5 + offset) % 13) as f32 / 12.0);
            sparse(offset).into_iter().zip(noise).map(|(value, noise)| value + noise).collect::<Vec<_>>()
        };
        board([colour(), normals(values)].concat())
    };
    for (compression, most, guides) in [
        (Compression::Dwaa, 1.4e-4, false),
        (Compression::Dwab, 2e-3, false),
        (Compression::B44, 6e-5, false),
        (Compression::B44a, 6e-5, false),
        (Compression::Zip, 6e-5, true),
        (Compression::Dwaa, 0.5, true),
    ] {
        let own = frame(vec![Part { compression, ..changed(most) }]);
        let (found, choices) = search(&own, "auto", None).unwrap();
        assert_eq!(!found.names(0).is_empty(), guides, "{compression:?}");
        assert_eq!(rule(&own, &choices, "N.X") == Rule::Keep, guides);
        assert_eq!(found.notes.iter().any(|note| note.starts_with("N: sparse")), !guides);
        // What is complete stays so.
        let whole = frame(vec![Part { compression, ..board([colour(), normals(ramp)].concat()) }]);
        assert_eq!(search(&whole, "auto", None).unwrap().0.names(0), ["N"]);
    }
}

#[test]
fn a_background_of_zeros_does_no_harm() {
    let values =
        |offset| (0..PIXELS).map(|at| if at < 32 { 0.0 } else { ramp(offset)[at] + 0.1 }).collect::<Vec<_>>();
    let frame = frame(vec![board([colour(), normals(values)].concat())]);
    assert_eq!(search(&frame, "auto", None).unwrap().0.names(0), ["N"]);
}

#[test]
fn the_list_in_the_attribute_is_believed() {
    let mut own = board([colour(), vec![half("light.R", &ramp(2))], normals(sparse)].concat());
    own.attributes.set_text(crate::channels::DENSE, "light.R, N.X, N.Y, N.Z");
    let frame = frame(vec![own]);
    assert_eq!(search(&frame, "auto", None).unwrap().0.names(0), ["N", "light"]);
}

#[test]
fn parts_with_the_same_pixels_help_each_other() {
    let aovs = part(window(2, -1, 8, 8), normals(ramp));
    let elsewhere = part(window(0, 0, 8, 8), vec![float("Z", &ramp(3))]);
    let frame = frame(vec![
        named("beauty", "", board(colour())),
        named("aov", "", aovs),
        named("other", "", elsewhere),
    ]);
    let masks = crate::mask::find(&frame, &Source::Auto, None).unwrap();
    let mut choices = choose(&frame, &masks.mask_channels, &[]);
    let found = find(&frame, &masks, &mut choices, &Asked::Auto, None).unwrap();
    assert_eq!(found.names(0), ["N"]);
    assert!(choices[1].iter().all(|choice| choice.rule == Rule::Keep));
}

#[test]
fn a_second_file_must_show_the_same_pixels() {
    let own = frame(vec![board(colour())]);
    let guides = frame(vec![part(window(2, -1, 8, 8), normals(ramp))]);
    let (found, _) = search(&own, "auto", Some(&guides)).unwrap();
    assert_eq!(found.names(0), ["N"]);
    assert!(found.parts[0][0].second);
    let other = frame(vec![part(window(0, 0, 8, 8), normals(ramp))]);
    assert!(matches!(search(&own, "auto", Some(&other)), Err(Error::Window { .. })));
}

#[test]
fn a_second_file_is_held_to_the_same_test() {
    let own = frame(vec![board(colour())]);
    let of = |channels: Vec<Channel>| frame(vec![part(window(2, -1, 8, 8), channels)]);
    let refused = |second: &Frame, asked: &str| search(&own, asked, Some(second)).unwrap_err();
    let sparse_file = |channels: &str| Error::SparseFile { channels: channels.into() };
    assert_eq!(refused(&of(normals(sparse)), "auto"), sparse_file("N"));
    let mixed = of([normals(sparse), vec![float("Z", &ramp(1)), half("A", &sparse(2))]].concat());
    let (found, _) = search(&own, "auto", Some(&mixed)).unwrap();
    assert_eq!((found.names(0), found.notes.len()), (vec!["Z".to_owned()], 1));
    assert!(found.notes[0].starts_with("A, N: sparse in the guides' file"), "{}", found.notes[0]);
    assert_eq!(refused(&mixed, "N.*,Z"), sparse_file("N"));
    let mut listed = normals(sparse);
    listed.push(float("Z", &sparse(1)));
    let mut listed = of(listed);
    listed.parts[0].attributes.set_text(crate::channels::DENSE, "N.X, N.Y, N.Z");
    assert_eq!(search(&own, "auto", Some(&listed)).unwrap().0.names(0), ["N"]);
}

#[test]
fn a_second_file_with_a_mask_is_judged_by_it() {
    let own = frame(vec![board(colour())]);
    let flags: Vec<f32> = (0..PIXELS).map(|at| f32::from(u8::from(at % 4 < 2))).collect();
    let ones = [1.0; PIXELS];
    let kept = |offset| ramp(offset).iter().zip(&flags).map(|(v, flag)| v * flag).collect::<Vec<_>>();
    for name in ["mask", "Mask", "N.mask", "flags"] {
        let of = |values: &dyn Fn(usize) -> Vec<f32>, flags: &[f32]| {
            let channels = [normals(values), vec![half(name, flags)]].concat();
            let mut part = part(window(2, -1, 8, 8), channels);
            if name == "flags" {
                part.attributes.set_text(crate::mask::ATTRIBUTE, name);
            }
            frame(vec![part])
        };
        assert!(matches!(search(&own, "auto", Some(&of(&kept, &flags))), Err(Error::SparseFile { .. })));
        assert_eq!(search(&own, "auto", Some(&of(&ramp, &flags))).unwrap().0.names(0), ["N"], "{name}");
        assert_eq!(search(&own, "auto", Some(&of(&kept, &ones))).unwrap().0.names(0), ["N"], "{name}");
        let larger = |frame: &Frame| {
            let second = Second::new(frame);
            of_larger(&own.parts[0], window(2, -1, 8, 8), &second, &Asked::Auto, &mut Vec::new())
        };
        assert!(matches!(larger(&of(&kept, &flags)), Err(Error::SparseFile { .. })), "{name}");
        assert_eq!(larger(&of(&ramp, &flags)).unwrap().len(), 1, "{name}");
    }
    let nan = |offset| kept(offset).iter().zip(&flags).map(|(v, flag)| v / flag).collect::<Vec<_>>();
    let second = frame(vec![part(window(2, -1, 8, 8), normals(nan))]);
    assert!(!Second::new(&second).is_complete(0, 0));
}

#[test]
fn what_a_fill_made_is_no_guide() {
    let own = frame(vec![board(colour())]);
    let second = |density: f32, guides: &str| {
        let mut part = part(window(2, -1, 8, 8), [normals(ramp), vec![float("Z", &ramp(1))]].concat());
        part.attributes.set_text(crate::mask::FILTER, "auto");
        part.attributes.set_text(ATTRIBUTE, guides);
        part.attributes.set("lacuna/density", "float", density.to_le_bytes().to_vec());
        let found = search(&own, "auto", Some(&frame(vec![part])));
        found.map(|(found, _)| found.names(0))
    };
    assert_eq!(second(0.2, ""), Err(Error::SparseFile { channels: "N, Z".into() }));
    assert_eq!(second(0.2, "Z").unwrap(), ["Z"]);
    assert_eq!(second(1.0, "").unwrap(), ["N", "Z"]);
}

#[test]
fn each_candidate_is_judged_by_its_own_mask() {
    let other = |at: usize| (at * 5 + at / 8).is_multiple_of(3);
    let flags = half("mask", &(0..PIXELS).map(|at| f32::from(u8::from(other(at)))).collect::<Vec<_>>());
    let kept = |offset| {
        ramp(offset).iter().enumerate().map(|(at, v)| if other(at) { *v } else { 0.0 }).collect::<Vec<_>>()
    };
    let parts = |values: &dyn Fn(usize) -> Vec<f32>| {
        let aov = part(window(2, -1, 8, 8), [normals(values), vec![flags.clone()]].concat());
        frame(vec![named("beauty", "", board(colour())), named("aov", "", aov)])
    };
    let (found, choices) = search(&parts(&kept), "auto", None).unwrap();
    assert!(found.names(0).is_empty() && choices[1][0].rule == Rule::Normal);
    assert_eq!(search(&parts(&ramp), "auto", None).unwrap().0.names(0), ["N"]);
    let right = |name: &str| Channel { name: format!("right.{name}").into_bytes(), ..flags.clone() };
    let mut own =
        board([colour(), vec![right("mask"), half("right.Z", &kept(3)), half("Z", &ramp(1))]].concat());
    let views = [&4_u32.to_le_bytes()[..], b"left", &5_u32.to_le_bytes(), b"right"];
    own.attributes.set("multiView", "stringvector", views.concat());
    let stereo = frame(vec![own]);
    let (found, choices) = search(&stereo, "auto", None).unwrap();
    assert_eq!(found.names(0), ["Z"]);
    assert_eq!(rule(&stereo, &choices, "right.Z"), Rule::Depth);
}

#[test]
fn guides_have_the_order_of_their_names() {
    let extra = vec![float("albedo.R", &ramp(3)), float("Z", &ramp(1))];
    let mut channels = [colour(), normals(ramp), extra].concat();
    let names = |channels: &[Channel]| {
        search(&frame(vec![board(channels.to_vec())]), "auto", None).unwrap().0.names(0)
    };
    let sorted = names(&channels);
    assert!(sorted.len() == 3, "{sorted:?}");
    channels.reverse();
    assert_eq!(names(&channels), sorted);
}

#[test]
fn what_was_found_becomes_planes() {
    let mut depth = ramp(1);
    depth[5] = f32::INFINITY;
    depth[6] = f32::NAN;
    let own = frame(vec![board([colour(), vec![float("Z", &depth)]].concat())]);
    let (found, _) = search(&own, "Z", None).unwrap();
    let guides = collect(&found.parts[0], &own, None, own.parts[0].size()).unwrap();
    assert!(!guides.is_empty());
    assert_eq!(guides.unknown(), 1);
    // A constant says nothing.
    let own = frame(vec![board([colour(), normals(ramp)].concat())]);
    let guide =
        Guide { name: "R".into(), second: true, part: 0, channels: vec![0], kind: Kind::Values, view: None };
    let flat = frame(vec![part(window(2, -1, 8, 8), vec![float("R", &[0.5; PIXELS])])]);
    assert!(collect(&[guide], &own, Some(&flat), own.parts[0].size()).unwrap().is_empty());
}
