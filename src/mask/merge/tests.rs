//! Tests of uniting two renders.

use super::*;
use crate::mask::{self, Source};
use crate::testing::{float, frame, half, part, uint, values, window};

fn render(values: [f32; 4], id: [u32; 4], measured: [f32; 4]) -> Frame {
    let (colour, id, mask) = (half("R", &values), uint("id", &id), half("mask", &measured));
    frame(vec![part(window(0, 0, 4, 1), vec![colour, id, mask])])
}

fn of(a: &Frame, b: &Frame) -> Result<Merged, MakeError> {
    let find = |frame: &Frame| mask::find(frame, &Source::Auto, None).unwrap();
    let forget = |attributes: &mut Attributes| attributes.remove("lacuna/filter").then(|| "forgotten".into());
    merge((a.clone(), &find(a)), (b, &find(b)), forget)
}

#[test]
fn either_measured_is_measured_and_the_first_goes_first() {
    let a = render([1.0, 2.0, 0.0, 0.0], [1, 2, 0, 0], [1.0, 1.0, 0.0, 0.0]);
    let b = render([0.0, 5.0, 6.0, 0.0], [0, 5, 6, 0], [0.0, 1.0, 1.0, 0.0]);
    let merged = of(&a, &b).unwrap();
    let part = &merged.frame.parts[0];
    assert_eq!(values(part, "R"), [1.0, 2.0, 6.0, 0.0]);
    assert_eq!(part.channels[1].samples, Samples::Uint(vec![1, 2, 6, 0]));
    assert_eq!(values(part, "mask"), [1.0, 1.0, 1.0, 0.0]);
    assert!((merged.density - 0.75).abs() < 1e-12);
    assert!(merged.notes[0].contains("differ in 1 pixel that both"), "{:?}", merged.notes);
    assert!(of(&a, &a).unwrap().notes.is_empty());
}

#[test]
fn what_is_said_of_the_pattern_of_one_goes() {
    let mut a = render([1.0; 4], [1; 4], [1.0, 1.0, 0.0, 0.0]);
    a.parts[0].attributes.set_text("lacuna/filter", "ss");
    a.parts[0].attributes.set_text(SEED, "3");
    let merged = of(&a, &a).unwrap();
    assert_eq!(merged.notes, ["filled by ss: what no render measured is missing again", "forgotten"]);
    let part = &merged.frame.parts[0];
    assert_eq!(values(part, "R"), [1.0, 1.0, 0.0, 0.0]);
    assert_eq!(["lacuna/filter", SEED].map(|name| part.attributes.text(name)), [None, None]);
}

#[test]
fn what_was_filled_is_missing_again_in_either_order() {
    let mut filled = render([1.0, 2.0, 3.0, 4.0], [1; 4], [1.0, 0.0, 0.0, 0.0]);
    filled.parts[0].attributes.set_text("lacuna/filter", "ss");
    let sparse = render([0.0, 5.0, 0.0, 0.0], [0, 1, 0, 0], [0.0, 1.0, 0.0, 0.0]);
    for merged in [of(&filled, &sparse).unwrap(), of(&sparse, &filled).unwrap()] {
        assert_eq!(values(&merged.frame.parts[0], "R"), [1.0, 5.0, 0.0, 0.0]);
        assert_eq!(merged.frame.parts[0].channels[1].samples, Samples::Uint(vec![1, 1, 0, 0]));
    }
}

#[test]
fn bits_survive() {
    // A NaN with a payload, a denormal and a negative zero.
    let bits = [0x7e01_u16, 0x0001, 0x8000, 0x3c00];
    let with = |measured: [f32; 4]| {
        let mut frame = render([0.0; 4], [0; 4], measured);
        frame.parts[0].channels[0].samples = Samples::Half(bits.map(f16::from_bits).to_vec());
        frame
    };
    let merged = of(&with([1.0, 0.0, 1.0, 0.0]), &with([0.0, 1.0, 0.0, 1.0])).unwrap();
    let Samples::Half(found) = &merged.frame.parts[0].channels[0].samples else { panic!() };
    assert_eq!(found.iter().map(|value| value.to_bits()).collect::<Vec<_>>(), bits);
}

#[test]
fn renders_of_other_forms_are_refused() {
    let a = render([0.0; 4], [0; 4], [1.0, 0.0, 0.0, 0.0]);
    let mut shifted = a.clone();
    shifted.parts[0].data_window = window(1, 0, 4, 1);
    assert!(of(&a, &shifted).unwrap_err().to_string().contains("data windows"));
    let mut other = a.clone();
    other.parts[0].channels[0] = float("R", &[0.0; 4]);
    assert!(of(&a, &other).unwrap_err().to_string().contains("channel R is of another type"));
    other.parts[0].channels.remove(0);
    for (first, second, which) in [(&a, &other, "second"), (&other, &a, "first")] {
        let error = of(first, second).unwrap_err().to_string();
        assert!(error.contains(&format!("the {which} render has no channel R")), "{error}");
    }
    let two = frame(vec![a.parts[0].clone(), a.parts[0].clone()]);
    assert!(of(&a, &two).unwrap_err().to_string().contains("parts"));
}

#[test]
fn a_mask_that_serves_several_parts_stays_the_only_one() {
    let parts = |measured: [f32; 4]| {
        let colour = part(window(0, 0, 4, 1), vec![half("R", &measured.map(|flag| 3.0 * flag))]);
        let mask = part(window(0, 0, 4, 1), vec![half("mask", &measured)]);
        frame(vec![colour, mask])
    };
    let first = of(&parts([1.0, 0.0, 0.0, 0.0]), &parts([0.0, 1.0, 0.0, 0.0])).unwrap().frame;
    let second = of(&first, &parts([0.0, 0.0, 1.0, 0.0])).unwrap().frame;
    assert_eq!(second.parts[0].channels.len(), 1);
    assert_eq!(values(&second.parts[0], "R"), [3.0, 3.0, 3.0, 0.0]);
    assert_eq!(values(&second.parts[1], "mask"), [1.0, 1.0, 1.0, 0.0]);
}

#[test]
fn complete_channels_of_a_filled_render_stay() {
    let with = |colour: [f32; 4], measured: [f32; 4], z: [f32; 4]| {
        let channels =
            vec![half("N.X", &z), half("R", &colour), half("dense.Z", &z), half("mask", &measured)];
        let mut one = frame(vec![part(window(0, 0, 4, 1), channels)]);
        one.parts[0].attributes.set_text(crate::channels::DENSE, "dense.Z");
        one
    };
    let z = [0.5, 0.25, 2.0, 4.0];
    let mut filled = with([1.0, 2.0, 3.0, 4.0], [1.0, 0.0, 0.0, 0.0], z);
    filled.parts[0].attributes.set_text("lacuna/filter", "ss");
    // By the attribute, and where both renders hold the same.
    let complete = with([0.0, 5.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], z);
    let merged = of(&filled, &complete).unwrap();
    let part = &merged.frame.parts[0];
    assert_eq!(
        ["R", "N.X", "dense.Z"].map(|name| values(part, name)),
        [vec![1.0, 5.0, 0.0, 0.0], z.to_vec(), z.to_vec()]
    );
    // What the second has at its own pixels alone was filled in the first.
    let sparse = with([0.0, 5.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.25, 0.0, 0.0]);
    let merged = of(&filled, &sparse).unwrap();
    assert_eq!(values(&merged.frame.parts[0], "N.X"), [0.5, 0.25, 0.0, 0.0]);
}

#[test]
fn counts_are_values_of_their_pixels() {
    let with = |colour: [f32; 4], counts: [u32; 4]| {
        frame(vec![part(window(0, 0, 4, 1), vec![half("R", &colour), uint("samples", &counts)])])
    };
    let (a, b) = (with([1.0, 2.0, 0.0, 0.0], [4, 1, 0, 0]), with([0.0, 6.0, 7.0, 0.0], [0, 16, 8, 0]));
    let source = Source::Count { channel: "samples".into(), at_least: 2.0 };
    let [first, second] = [&a, &b].map(|frame| mask::find(frame, &source, None).unwrap());
    let merged = merge((a, &first), (&b, &second), |_| None).unwrap();
    let part = &merged.frame.parts[0];
    assert_eq!(part.channels[1].samples, Samples::Uint(vec![4, 16, 8, 0]));
    assert_eq!(values(part, "R"), [1.0, 6.0, 7.0, 0.0]);
}

fn layers(colour: [f32; 4], own: [f32; 4], other: [f32; 4]) -> Frame {
    let channels = vec![half("A", &own), half("R", &colour), half("d.A", &other), half("d.R", &colour)];
    frame(vec![part(window(0, 0, 4, 1), channels)])
}

#[test]
fn masks_that_one_channel_cannot_hold_are_refused() {
    let merged = |a: &Frame, b: &Frame| {
        let [first, second] = [a, b].map(|frame| mask::find(frame, &Source::Alpha, None).unwrap());
        merge((a.clone(), &first), (b, &second), |_| None)
    };
    let a = layers([1.0; 4], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]);
    let error = merged(&a, &layers([1.0; 4], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 1.0, 0.0])).unwrap_err();
    assert!(error.to_string().starts_with("A and d.A have masks of their own"), "{error}");
    // What either measured may be the same.
    let both = merged(&a, &layers([1.0; 4], [0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])).unwrap();
    assert_eq!(values(&both.frame.parts[0], "mask"), [1.0, 1.0, 0.0, 0.0]);
    // A layer whose own alpha is full lacks nothing, and goes on lacking nothing.
    let of = |own: [f32; 4]| layers(own, own, [1.0; 4]);
    let both = merged(&of([1.0, 0.0, 0.0, 0.0]), &of([0.0, 1.0, 0.0, 0.0])).unwrap().frame;
    assert_eq!(values(&both.parts[0], "mask"), [1.0, 1.0, 0.0, 0.0]);
    assert_eq!(dense(&both.parts[0]), ["d.A", "d.R"]);
}

#[test]
fn every_mask_of_a_part_counts_for_the_density() {
    let with = |own: [f32; 4], other: [f32; 4]| {
        let masks = [half("a.mask", &own), half("b.mask", &other)];
        let [own, other] = masks;
        let channels = vec![half("a.R", &[1.0; 4]), own, half("b.R", &[1.0; 4]), other];
        frame(vec![part(window(0, 0, 4, 1), channels)])
    };
    let (a, b) = (with([1.0, 0.0, 0.0, 0.0], [1.0; 4]), with([0.0, 1.0, 0.0, 0.0], [1.0; 4]));
    let merged = of(&a, &b).unwrap();
    assert!((merged.density - 0.75).abs() < 1e-12, "{}", merged.density);
    assert_eq!(values(&merged.frame.parts[0], "a.mask"), [1.0, 1.0, 0.0, 0.0]);
}

#[test]
fn a_channel_called_mask_that_is_none_stays() {
    let with = |alpha: [f32; 4]| {
        let channels = vec![half("A", &alpha), half("R", &alpha), half("mask", &alpha.map(|a| 0.25 * a))];
        frame(vec![part(window(0, 0, 4, 1), channels)])
    };
    let (a, b) = (with([1.0, 0.0, 0.0, 0.0]), with([0.0, 1.0, 0.0, 0.0]));
    let [first, second] = [&a, &b].map(|frame| mask::find(frame, &Source::Alpha, None).unwrap());
    let merged = merge((a, &first), (&b, &second), |_| None).unwrap().frame;
    let part = &merged.parts[0];
    assert_eq!(values(part, "mask"), [0.25, 0.25, 0.0, 0.0]);
    assert_eq!(values(part, "mask2"), [1.0, 1.0, 0.0, 0.0]);
    assert_eq!(part.attributes.text(ATTRIBUTE).as_deref(), Some("mask2"));
    assert_eq!(mask::find(&merged, &Source::Auto, None).unwrap().origin, "mask2");
}

#[test]
fn masks_in_other_channels_are_refused() {
    let with = |name: &str| {
        let channels = vec![half("R", &[1.0; 4]), half("m", &[1.0; 4]), half("n", &[1.0; 4])];
        let mut one = frame(vec![part(window(0, 0, 4, 1), channels)]);
        one.parts[0].attributes.set_text(ATTRIBUTE, name);
        one
    };
    let error = of(&with("m"), &with("n")).unwrap_err().to_string();
    assert!(error.contains("first render is m, of the second n: name one"), "{error}");
}
