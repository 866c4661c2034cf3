//! The model and the table of hand-built frames.

use super::*;
use crate::channels::choose;
use crate::mask::{Source, find};
use crate::testing::{float, frame, half, named, part, uint, window};

fn sample() -> Frame {
    let channels = vec![half("R", &[0.0; 4]), half("mask", &[1.0, 0.0, 0.0, 0.0]), uint("objectId", &[0; 4])];
    let mut first = named("rgba", "left", part(window(-1, 2, 2, 2), channels));
    first.display_window = window(0, 0, 6, 4);
    first.layout = Layout::Tiles { width: 32, height: 16 };
    first.had_levels = true;
    let second = named("depth", "right", part(window(0, 0, 1, 1), vec![float("Z", &[0.0])]));
    frame(vec![first, second])
}

#[test]
fn the_table_says_what_would_be_done_and_why() {
    let frame = sample();
    let masks = find(&frame, &Source::Auto, None).unwrap();
    let info = describe(&frame, Ok(&masks), &choose(&frame, &masks.mask_channels, &[]));
    let expected = "\
mask: mask, density 25.00 %
part 0 'rgba', view left, data 2x2 at (-1, 2), display 6x4 at (0, 0), zip, tiles of 32x16, with levels, density 25.00 %
  R         half   fill     colour
  mask      half   keep     the sampling mask
  objectId  uint   nearest  whole numbers
part 1 'depth', view right, data 1x1 at (0, 0), zip, scan lines, no mask
  Z  float  depth    a depth, by its name; NO MASK: no mask of its view or layer
";
    assert_eq!(info.to_string(), expected);
    let json = serde_json::to_value(&info).unwrap();
    assert_eq!(json["parts"][0]["channels"][2]["type"], "uint");
    assert_eq!(json["parts"][0]["channels"][2]["rule"], "nearest");
    assert_eq!(json["parts"][0]["data_window"], serde_json::json!([-1, 2, 0, 3]));
    assert_eq!(json["density"], 0.25);
}

#[test]
fn the_mask_channels_are_named_and_control_characters_shown() {
    let channels = vec![half("a.R", &[0.0]), half("a.mask", &[1.0]), half("x\x1b[2J\ny", &[0.0])];
    let frame = frame(vec![part(window(0, 0, 1, 1), channels)]);
    let masks = find(&frame, &Source::Auto, None).unwrap();
    let text = describe(&frame, Ok(&masks), &choose(&frame, &masks.mask_channels, &[])).to_string();
    assert!(text.starts_with("mask: auto (channel a.mask), density 100.00 %\n"), "{text}");
    assert!(text.contains("\n  x\\u{1b}[2J\\ny  half"), "{text}");
    assert!(!text.contains('\x1b'), "{text}");
}

#[test]
fn without_a_mask_the_rules_are_still_told() {
    let frame = frame(vec![part(window(0, 0, 1, 1), vec![half("R", &[0.0])])]);
    let error = find(&frame, &Source::Auto, None).unwrap_err();
    let choices = choose(&frame, &Masks::default().mask_channels, &[]);
    let text = describe(&frame, Err(&error), &choices).to_string();
    assert!(
        text.starts_with("mask: none: the frame is taken for complete")
            && text.ends_with("  R  half   fill     colour\n"),
        "{text}"
    );
}

#[test]
fn a_frame_that_may_be_sparse_gets_the_hint() {
    let text = |frame: &Frame| {
        let error = find(frame, &Source::Auto, None).unwrap_err();
        describe(frame, Err(&error), &choose(frame, &Masks::default().mask_channels, &[])).to_string()
    };
    let scattered: Vec<f32> = (0..64).map(|at| if at % 3 == 0 { 1.0 } else { f32::NAN }).collect();
    let scattered = frame(vec![part(window(0, 0, 8, 8), vec![float("R", &scattered)])]);
    assert!(text(&scattered).contains("--mask nan"), "{}", text(&scattered));
    let mut named = frame(vec![part(window(0, 0, 1, 1), vec![half("R", &[0.0])])]);
    named.parts[0].attributes.set_text(crate::mask::ATTRIBUTE, "file:m.png");
    assert!(text(&named).starts_with("mask: no sampling mask found"), "{}", text(&named));
}

#[test]
fn values_that_should_be_numbers_and_are_none_are_counted() {
    let text = |frame: &Frame| {
        let found = find(frame, &Source::Auto, None);
        let none = Masks::default();
        let masks = found.as_ref().unwrap_or(&none);
        let info = describe(frame, found.as_ref(), &choose(frame, &masks.mask_channels, &[]));
        info.to_string()
    };
    let nan = [f32::NAN; 4];
    let blank =
        frame(vec![part(window(0, 0, 2, 2), vec![half("G", &nan), half("R", &nan), float("Z", &nan)])]);
    assert!(text(&blank).contains("\nnote: 8 values are not finite: G 4, R 4\n"), "{}", text(&blank));
    let light = half("R", &[f32::NAN, f32::INFINITY, 1.0, f32::NAN]);
    let sparse = frame(vec![part(window(0, 0, 2, 2), vec![light, half("mask", &[0.0, 1.0, 1.0, 0.0])])]);
    assert!(text(&sparse).contains("\nnote: 1 measured value is not finite: R 1\n"), "{}", text(&sparse));
    assert!(!text(&sample()).contains("finite"), "{}", text(&sample()));
}
