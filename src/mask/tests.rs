//! Masks found in hand-built frames.

use lacuna_exr::{Frame, Part};
use lacuna_filters::Size;

use super::*;
use crate::raster::{self, BitDepth, ColorType, Compression};
use crate::testing::{float, frame, half, named, part, uint, window};

const R4: [f32; 4] = [1.0, 2.0, 3.0, 4.0];

fn four(channels: Vec<lacuna_exr::Channel>) -> Part {
    part(window(0, 0, 2, 2), channels)
}

fn auto(frame: &Frame) -> Result<Masks, Error> {
    find(frame, &Source::Auto, None)
}

/// The mask of a channel as zeros and ones; `-` where none serves it.
fn shown(frame: &Frame, masks: &Masks, part: usize, name: &str) -> String {
    let at = frame.parts[part].channels.iter().position(|channel| channel.name == name.as_bytes()).unwrap();
    let Some(mask) = masks.get(part, at) else { return "-".into() };
    mask.as_slice().iter().map(|&flag| if flag { '1' } else { '0' }).collect()
}

#[test]
fn auto_prefers_the_attribute_then_mask_then_layers() {
    let channels = || {
        vec![
            float("R", &R4),
            half("MASK", &[1.0, 0.0, 0.0, 0.0]),
            half("other", &[0.0, 1.0, 0.0, 0.0]),
            half("spec.mask", &[0.0, 0.0, 1.0, 0.0]),
            half("spec.R", &R4),
        ]
    };
    let mut with_attribute = frame(vec![four(channels())]);
    with_attribute.parts[0].attributes.set_text(ATTRIBUTE, "other");
    let masks = auto(&with_attribute).unwrap();
    assert_eq!(shown(&with_attribute, &masks, 0, "spec.R"), "0100");
    assert_eq!(masks.origin, "other");
    let plain = frame(vec![four(channels())]);
    let masks = auto(&plain).unwrap();
    assert_eq!((masks.origin.as_str(), shown(&plain, &masks, 0, "spec.R").as_str()), ("MASK", "1000"));
    assert_eq!(masks.density(), Some(0.25));
    let mut absent = frame(vec![four(channels())]);
    absent.parts[0].attributes.set_text(ATTRIBUTE, "file:m.png");
    let masks = auto(&absent).unwrap();
    assert_eq!(masks.origin, "MASK");
    assert_eq!(masks.notes, ["the attribute lacuna/mask names 'file:m.png', which is no channel here"]);
    let layered = frame(vec![four(channels().into_iter().filter(|c| c.name != b"MASK").collect())]);
    let masks = auto(&layered).unwrap();
    assert_eq!(shown(&layered, &masks, 0, "spec.R"), "0010");
    assert_eq!(shown(&layered, &masks, 0, "R"), "-");
    assert!(masks.why_none[0][0].is_some());
}

#[test]
fn the_exact_name_goes_before_another_case() {
    let two = |other: &str| {
        let channels =
            vec![float("R", &R4), half("MASK", &[1.0, 0.0, 0.0, 0.0]), half(other, &[0.0, 1.0, 0.0, 0.0])];
        frame(vec![four(channels)])
    };
    let exact = two("mask");
    let masks = auto(&exact).unwrap();
    assert_eq!((masks.origin.as_str(), shown(&exact, &masks, 0, "R").as_str()), ("mask", "0100"));
    assert!(!masks.is_mask_channel(0, 0));
    assert_eq!(auto(&two("Mask")).unwrap_err(), Error::Several { names: "MASK, Mask".into() });
    let source = "file:m.exr".parse().unwrap();
    let other = frame(vec![four(vec![float("R", &R4)])]);
    let found = |file: Frame| find(&other, &source, Some(&MaskFile::from_frame("m.exr".into(), file)));
    assert_eq!(shown(&other, &found(exact).unwrap(), 0, "R"), "0100");
    assert!(found(two("Mask")).unwrap_err().to_string().contains("several channels"));
}

#[test]
fn a_matte_is_not_a_sampling_mask() {
    let alone = frame(vec![four(vec![float("R", &R4), half("whitebarmask.mask", &[0.0, 1.0, 1.0, 0.0])])]);
    let error = auto(&alone).unwrap_err().to_string();
    assert!(error.contains("R, whitebarmask.mask"), "{error}");
    // A complete noisy frame has none and needs none.
    assert!(error.contains("--mask, nan where all finite pixels were measured"), "{error}");
    let grey = frame(vec![four(vec![half("hair.R", &R4), half("hair.mask", &[0.0, 0.5, 1.0, 0.0])])]);
    assert!(matches!(auto(&grey), Err(Error::NotFound { .. })));
}

#[test]
fn layers_have_their_own_masks() {
    let frame = frame(vec![four(vec![
        half("a.R", &R4),
        half("a.b.R", &R4),
        half("ab.R", &R4),
        half("a.mask", &[1.0, 0.0, 0.0, 0.0]),
        half("a.b.mask", &[0.0, 1.0, 0.0, 0.0]),
    ])]);
    let masks = auto(&frame).unwrap();
    let shown = |name| shown(&frame, &masks, 0, name);
    assert_eq!((shown("a.R"), shown("a.b.R"), shown("ab.R")), ("1000".into(), "0100".into(), "-".into()));
    assert_eq!(masks.origin, "auto");
    assert_eq!(masks.mask_channels[0].len(), 2);
}

#[test]
fn values_count_from_one_half_on_and_nan_is_missing() {
    let values = [0.49, 0.5, f32::NAN, 7.0];
    let frame = frame(vec![four(vec![float("R", &R4), float("mask", &values)])]);
    let masks = auto(&frame).unwrap();
    assert_eq!(shown(&frame, &masks, 0, "R"), "0101");
    assert_eq!(masks.notes.len(), 1);
}

#[test]
fn a_mask_serves_its_view_by_absolute_pixels() {
    let left =
        part(window(-1, 5, 3, 2), vec![half("mask", &[1.0, 0.0, 0.0, 0.0, 1.0, 1.0]), half("R", &[0.0; 6])]);
    let inside = part(window(0, 5, 2, 2), vec![half("Z", &R4)]);
    let outside = part(window(1, 5, 2, 2), vec![half("Z", &R4)]);
    let frame = frame(vec![
        named("rgba", "left", left),
        named("depth", "left", inside.clone()),
        named("wide", "left", outside),
        named("other", "right", inside),
    ]);
    let masks = auto(&frame).unwrap();
    assert_eq!(shown(&frame, &masks, 0, "R"), "100011");
    assert_eq!(shown(&frame, &masks, 1, "Z"), "0011");
    assert_eq!(shown(&frame, &masks, 2, "Z"), "-");
    assert_eq!(masks.why_none[2][0].as_deref(), Some("the mask does not cover pixel (2, 5)"));
    assert_eq!(shown(&frame, &masks, 3, "Z"), "-");
    assert_eq!(masks.why_none[3][0].as_deref(), Some("no mask of its view or layer"));
}

#[test]
fn equal_masks_are_one() {
    let make = || four(vec![half("R", &R4), half("mask", &[1.0, 0.0, 0.0, 1.0])]);
    let frame = frame(vec![make(), make()]);
    let masks = auto(&frame).unwrap();
    assert!(Arc::ptr_eq(masks.get(0, 0).unwrap(), masks.get(1, 1).unwrap()));
    assert_eq!((masks.part_counts(0), masks.density()), ((2, 4), Some(0.5)));
}

#[test]
fn views_of_one_part_have_their_own_masks() {
    let mut part = four(vec![
        half("R", &R4),
        half("left.R", &R4),
        half("left.spec.R", &R4),
        half("spec.left.R", &R4),
        half("mask", &[1.0, 0.0, 0.0, 0.0]),
        half("left.mask", &[0.0, 1.0, 0.0, 0.0]),
    ]);
    let views =
        ["right", "left"].map(|view| [&(view.len() as u32).to_le_bytes()[..], view.as_bytes()].concat());
    part.attributes.set("multiView", "stringvector", views.concat());
    let frame = frame(vec![part]);
    let masks = auto(&frame).unwrap();
    let shown = |name| shown(&frame, &masks, 0, name);
    assert_eq!(
        (shown("R"), shown("left.R"), shown("spec.left.R")),
        ("1000".into(), "0100".into(), "0100".into())
    );
    // The view comes second last, OpenEXR says; some write it first.
    assert_eq!(shown("left.spec.R"), "0100");
    assert_eq!(masks.origin, "auto");
}

#[test]
fn a_mask_without_a_view_serves_the_views_that_have_none() {
    let mut part = four(vec![
        half("R", &R4),
        half("left.R", &R4),
        half("middle.R", &R4),
        half("mask", &[1.0, 0.0, 0.0, 1.0]),
        half("middle.mask", &[0.0, 1.0, 0.0, 0.0]),
    ]);
    let views = ["right", "left", "middle"]
        .map(|view| [&(view.len() as u32).to_le_bytes()[..], view.as_bytes()].concat());
    part.attributes.set("multiView", "stringvector", views.concat());
    let stereo = frame(vec![part.clone()]);
    let mut bare = frame(vec![part.clone()]);
    bare.parts[0].channels.retain(|channel| !channel.name.ends_with(b"mask"));
    part.channels.retain(|channel| channel.name == b"mask");
    let file = MaskFile::from_frame("m.exr".into(), frame(vec![part]));
    let from_file = Source::File { pattern: "m.exr".into(), channel: None };
    for (frame, source, middle) in [
        (&stereo, Source::Auto, "0100"),
        (&stereo, Source::Channel("mask".into()), "1001"),
        (&bare, from_file, "1001"),
    ] {
        let masks = find(frame, &source, Some(&file)).unwrap();
        let names = ["R", "left.R", "middle.R"];
        assert_eq!(names.map(|name| shown(frame, &masks, 0, name)), ["1001", "1001", middle], "{source}");
    }
}

#[test]
fn alpha_counts_above_zero() {
    let first = frame(vec![four(vec![half("R", &R4), half("A", &[0.0, 0.1, 1.0, f32::NAN])])]);
    let masks = find(&first, &Source::Alpha, None).unwrap();
    assert_eq!(shown(&first, &masks, 0, "R"), "0110");
    assert!(masks.mask_channels[0].is_empty());
    let blender = frame(vec![
        four(vec![half("V.Combined.A", &[0.0, 0.1, 1.0, 0.0]), half("V.Combined.R", &R4)]),
        four(vec![half("V.Depth.Z", &R4)]),
    ]);
    let masks = find(&blender, &Source::Alpha, None).unwrap();
    assert_eq!(shown(&blender, &masks, 1, "V.Depth.Z"), "0110");
    let none = frame(vec![four(vec![half("R", &R4)])]);
    assert!(matches!(find(&none, &Source::Alpha, None), Err(Error::NoAlpha { .. })));
}

#[test]
fn nan_means_missing_but_an_infinite_depth_does_not() {
    let (nan, inf) = (f32::NAN, f32::INFINITY);
    let first = frame(vec![
        four(vec![
            float("R", &[1.0, nan, inf, 1.0]),
            float("Z", &[inf, 1.0, 1.0, nan]),
            float("CryptoObject00.r", &[nan; 4]),
            float("samples", &[nan; 4]),
            uint("id", &[0; 4]),
        ]),
        four(vec![uint("id", &[0; 4])]),
    ]);
    let masks = find(&first, &Source::Finite, None).unwrap();
    assert_eq!(shown(&first, &masks, 0, "R"), "1000");
    assert_eq!(shown(&first, &masks, 1, "id"), "1000");
    let none = frame(vec![four(vec![uint("id", &[0; 4])])]);
    assert!(matches!(find(&none, &Source::Finite, None), Err(Error::NoFloat { .. })));
}

#[test]
fn counts_have_a_threshold() {
    let frame = frame(vec![four(vec![half("R", &R4), uint("n", &[0, 3, 4, 9])])]);
    let masks = find(&frame, &"count:n:4".parse().unwrap(), None).unwrap();
    assert_eq!(shown(&frame, &masks, 0, "R"), "0011");
    let error = find(&frame, &"count:m:4".parse().unwrap(), None).unwrap_err().to_string();
    assert!(error.contains("'m'") && error.contains("R, n"), "{error}");
}

#[test]
fn files_fit_by_window_or_by_size() {
    let target = {
        let mut part = part(window(4, 4, 2, 2), vec![half("R", &R4)]);
        part.display_window = window(0, 0, 6, 6);
        frame(vec![part])
    };
    let any = Source::File { pattern: "m".into(), channel: None };
    let grey = |size: Size, values: Vec<u16>| MaskFile::from_grey("m.png".into(), size, values, 255);
    let data = find(&target, &any, Some(&grey(Size::new(2, 2), vec![0, 127, 128, 255]))).unwrap();
    assert_eq!(shown(&target, &data, 0, "R"), "0011");
    assert_eq!(data.origin, "file:m.png");
    let mut display = vec![0; 36];
    display[4 * 6 + 5] = 1;
    let display = find(&target, &any, Some(&grey(Size::new(6, 6), display))).unwrap();
    assert_eq!(shown(&target, &display, 0, "R"), "0100");
    let error = find(&target, &any, Some(&grey(Size::new(1, 2), vec![0, 0]))).unwrap_err().to_string();
    assert!(error.contains("2x1") && error.contains("2x2, 6x6"), "{error}");
    assert_eq!(find(&target, &any, None).unwrap_err(), Error::FileNotRead);

    let exr =
        |channels| MaskFile::from_frame("m.exr".into(), frame(vec![part(window(4, 3, 2, 4), channels)]));
    let column = [9.0, 9.0, 1.0, 0.0, 0.0, 1.0, 9.0, 9.0];
    let one = find(&target, &any, Some(&exr(vec![half("whatever", &column)]))).unwrap();
    assert_eq!(shown(&target, &one, 0, "R"), "1001");
    let two = exr(vec![half("a", &column), half("b", &[0.0; 8])]);
    assert!(find(&target, &any, Some(&two)).unwrap_err().to_string().contains("channels are a, b"));
    let named = Source::File { pattern: "m".into(), channel: Some("b".into()) };
    let masks = find(&target, &named, Some(&two)).unwrap();
    assert_eq!((shown(&target, &masks, 0, "R").as_str(), masks.origin.as_str()), ("0000", "file:m.exr:b"));
    assert!(masks.is_empty());
}

#[test]
fn own_windows_go_before_those_of_other_parts() {
    let first = part(window(0, 0, 2, 2), vec![half("R", &R4)]);
    let second = part(window(1, 0, 2, 2), vec![half("R", &R4)]);
    let frame = frame(vec![first, second]);
    let file = MaskFile::from_grey("m.png".into(), Size::new(2, 2), vec![1, 0, 0, 0], 255);
    let masks = find(&frame, &Source::File { pattern: "m".into(), channel: None }, Some(&file)).unwrap();
    assert_eq!(
        (shown(&frame, &masks, 0, "R"), shown(&frame, &masks, 1, "R")),
        ("1000".into(), "1000".into())
    );
}

/// Writes a PNG image of 2 x 2 pixels.
fn save(path: &std::path::Path, kind: (ColorType, BitDepth), bytes: &[u8]) {
    std::fs::write(path, raster::png((2, 2), kind, Compression::Fast, bytes).unwrap()).unwrap();
}

#[test]
fn png_files_are_read_by_brightness() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let target = frame(vec![four(vec![half("R", &R4)])]);
    let found = |name: &str| {
        let file = MaskFile::read_png(&path(name), lacuna_exr::Limits::default()).unwrap();
        let masks = find(&target, &Source::File { pattern: "m".into(), channel: None }, Some(&file)).unwrap();
        shown(&target, &masks, 0, "R")
    };
    save(path("grey.png").as_ref(), (ColorType::Grayscale, BitDepth::Eight), &[0, 127, 128, 255]);
    assert_eq!(found("grey.png"), "0011");
    save(path("unscaled.png").as_ref(), (ColorType::Grayscale, BitDepth::Eight), &[0, 1, 1, 0]);
    assert_eq!(found("unscaled.png"), "0110");
    let deep: Vec<u8> = [0_u16, 32767, 32768, 65535].into_iter().flat_map(u16::to_be_bytes).collect();
    save(&path("deep.png"), (ColorType::Grayscale, BitDepth::Sixteen), &deep);
    assert_eq!(found("deep.png"), "0011");
    let colour = vec![255, 255, 255, 0, 0, 0, 200, 200, 200, 0, 0, 20];
    save(&path("colour.png"), (ColorType::Rgb, BitDepth::Eight), &colour);
    assert_eq!(found("colour.png"), "1010");

    std::fs::write(path("broken.png"), b"\x89PNG\r\n\x1a\nnothing").unwrap();
    for name in ["broken.png", "absent.png"] {
        let error = MaskFile::read_png(&path(name), lacuna_exr::Limits::default()).unwrap_err().to_string();
        assert!(error.contains(name) && !error.contains('\n'), "{error}");
    }
    let grey = MaskFile::read_png(&path("grey.png"), lacuna_exr::Limits::default()).unwrap();
    let named = Source::File { pattern: "m".into(), channel: Some("R".into()) };
    assert!(find(&target, &named, Some(&grey)).unwrap_err().to_string().contains("no channel 'R'"));
}

#[test]
fn masks_are_measured_as_they_serve_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let load = |name: &str, channel| generate::load(&path(name), channel, lacuna_exr::Limits::default());
    save(path("unscaled.png").as_ref(), (ColorType::Grayscale, BitDepth::Eight), &[0, 1, 1, 0]);
    assert_eq!(load("unscaled.png", None).unwrap().as_slice(), [false, true, true, false]);
    // The content says what a file is, not its name.
    std::fs::copy(path("unscaled.png"), path("named.exr")).unwrap();
    assert_eq!(load("named.exr", None).unwrap().count(), 2);
    let limits = lacuna_exr::Limits::default();
    let region = generate::region(&path("named.exr"), None, window(7, 7, 2, 2), limits).unwrap();
    assert_eq!(region.as_slice(), [false, true, true, false]);
    let write = |name: &str, channels| {
        let options = lacuna_exr::WriteOptions::default();
        lacuna_exr::write(&frame(vec![four(channels)]), path(name).as_ref(), &options).unwrap();
    };
    write("m.exr", vec![half("A", &R4), half("mask", &[0.4, 0.5, 1.0, f32::NAN])]);
    assert_eq!(load("m.exr", None).unwrap().as_slice(), [false, true, true, false]);
    // What fill would not take for a mask is not measured as one.
    write("a.exr", vec![half("A", &R4), half("R", &R4)]);
    assert!(load("a.exr", None).unwrap_err().to_string().contains("channels are A, R"));
    assert!(load("a.exr", Some("A")).is_ok());
    for (name, channel, reason) in
        [("unscaled.png", Some("R"), "no channel 'R'"), ("absent.png", None, "No such file")]
    {
        assert!(load(name, channel).unwrap_err().to_string().contains(reason), "{name}");
        let error =
            generate::region(&path(name), channel, window(0, 0, 2, 2), limits).unwrap_err().to_string();
        assert!(error.contains(reason) && error.contains(name), "{error}");
    }
}

/// What a channel holds at a row and a column.
type Held<'a> = &'a dyn Fn(usize, usize) -> f32;

/// A frame of 12 x 12 pixels, of channels whose values are told by row and column.
fn square(channels: &[(&str, Held<'_>)]) -> Frame {
    let plane = |value: Held<'_>| -> Vec<f32> { (0..144).map(|at| value(at / 12, at % 12)).collect() };
    let channels = channels.iter().map(|(name, value)| float(name, &plane(value))).collect();
    frame(vec![part(window(0, 0, 12, 12), channels)])
}

fn disc(y: usize, x: usize) -> f32 {
    f32::from((3..9).contains(&y) && (3..9).contains(&x))
}

fn ramp(y: usize, x: usize) -> f32 {
    0.3 + 0.01 * (12 * y + x) as f32
}

fn scattered(y: usize, x: usize) -> f32 {
    if (5 * y + 3 * x) % 7 < 2 { 0.5 + ramp(y, x) } else { 0.0 }
}

fn is_taken_for_a_matte(frame: &Frame) -> bool {
    auto(frame).unwrap().notes.iter().any(|note| note.contains("is taken for a matte"))
}

#[test]
fn a_matte_is_one_in_whatever_compression() {
    use lacuna_exr::Compression::{Dwaa, Pxr24, Zip};
    // What the compression makes of the black outside of a region is no colour.
    let residue = |y, x| if disc(y, x) > 0.0 { ramp(y, x) } else { 1e-3 * ramp(y, x) };
    let [mut complete, mut region] =
        [&ramp as Held<'_>, &residue].map(|colour| square(&[("R", colour), ("mask", &disc)]));
    for compression in [Zip, Pxr24, Dwaa] {
        complete.parts[0].compression = compression;
        assert!(is_taken_for_a_matte(&complete), "{compression:?}");
    }
    region.parts[0].compression = Dwaa;
    assert!(!is_taken_for_a_matte(&region));
}

#[test]
fn a_wrong_mask_of_sparse_colour_is_no_matte() {
    let none = |_, _| 0.0;
    for mask in [&disc as Held<'_>, &none] {
        assert!(!is_taken_for_a_matte(&square(&[("R", &scattered), ("mask", mask)])));
    }
    // That of an element which is not in this frame.
    assert!(is_taken_for_a_matte(&square(&[("R", &ramp), ("mask", &none)])));
    // A complete layer beside it does not make it complete, nor a sparse one complete colour sparse.
    assert!(!is_taken_for_a_matte(&square(&[("R", &scattered), ("spec.R", &ramp), ("mask", &disc)])));
    assert!(is_taken_for_a_matte(&square(&[("R", &ramp), ("spec.R", &scattered), ("mask", &disc)])));
}

#[test]
fn regions_that_may_be_a_matte_over_black_are_told() {
    let element = |y, x| disc(y, x) * ramp(y, x);
    let holes = |y, x| if disc(y, x) > 0.0 { ramp(y, x) } else { f32::NAN };
    let told = |frame: &Frame| {
        let masks = auto(frame).unwrap();
        assert!(!masks.is_full());
        let told = masks.notes.iter().any(|note| note.contains("--mask nan takes the frame as complete"));
        (told, beside_element(frame, &masks).is_some_and(|masks| masks.is_full()))
    };
    let mut frame = square(&[("A", &disc), ("R", &element), ("mask", &disc)]);
    assert_eq!(told(&frame), (true, true));
    frame.parts[0].attributes.set_text(SEED, "1");
    assert_eq!(told(&frame), (false, false));
    assert_eq!(
        told(&square(&[("A", &|y, x| 0.4 * disc(y, x)), ("R", &element), ("mask", &disc)])),
        (true, false)
    );
    assert_eq!(told(&square(&[("R", &element), ("mask", &disc)])), (true, false));
    assert_eq!(told(&square(&[("R", &holes), ("mask", &disc)])), (false, false));
    assert_eq!(told(&square(&[("R", &scattered), ("mask", &scattered)])), (false, false));
}
