//! Sparse frames from hand-built full ones.

use lacuna_exr::{Channel, Compression};
use lacuna_filters::Size;

use super::*;
use crate::mask::Source;
use crate::reconstruct::Job;
use crate::testing::{float, frame, half, named, part, uint, values, window};

const SHUFFLE: Pattern<'_> = Pattern::Shuffle { density: 0.3, seed: 7, frame: 0 };

fn ones(x: i32, y: i32, width: i32, height: i32) -> Part {
    let pixels = (width * height) as usize;
    let channels: Vec<Channel> = vec![
        half("R", &vec![f32::NAN; pixels]),
        float("Z", &vec![-1.0; pixels]),
        uint("id", &vec![5; pixels]),
        half("z", &vec![1.0; pixels]),
    ];
    part(window(x, y, width, height), channels)
}

#[test]
fn missing_pixels_are_zero_in_every_channel_and_the_mask_is_in_its_place() {
    let full = frame(vec![ones(-4, -2, 12, 9)]);
    let sparse = sparsify(full, SHUFFLE).unwrap();
    let part = &sparse.frame.parts[0];
    let names: Vec<_> = part.channels.iter().map(|channel| channel.display_name()).collect();
    assert_eq!(names, ["R", "Z", "id", "mask", "z"]);
    let mask = values(part, "mask");
    assert!(mask.contains(&1.0) && mask.contains(&0.0));
    for (at, &flag) in mask.iter().enumerate() {
        let zero = |name| values(part, name)[at].to_bits() == 0;
        assert_eq!([zero("R"), zero("Z"), zero("id"), zero("z")], [flag == 0.0; 4]);
    }
    let count = mask.iter().filter(|flag| **flag > 0.0).count();
    assert!((sparse.density - count as f64 / 108.0).abs() < 1e-12);
    assert_eq!(part.attributes.text(SEED).as_deref(), Some("7"));
    assert_eq!(part.attributes.text(PATTERN).as_deref(), Some("shuffle density=0.3"));
    assert!(matches!(part.channels[3].samples, Samples::Half(_)));
    let found = mask::find(&sparse.frame, &Source::Auto, None).unwrap();
    assert_eq!(found.get(0, 0).unwrap().count(), count);
}

#[test]
fn errors_that_an_earlier_fill_was_estimated_to_have_are_dropped() {
    let mut full = ones(0, 0, 8, 8);
    full.channels.push(float("error", &[0.1; 64]));
    let names = |part: &Part| part.channels.iter().any(|channel| channel.name == b"error");
    let own = sparsify(frame(vec![full.clone()]), SHUFFLE).unwrap();
    assert!(names(&own.frame.parts[0]) && own.notes.is_empty(), "one of the renderer's own");
    full.attributes.set("lacuna/density", "float", 0_f32.to_le_bytes().into());
    full.attributes.set_text("lacuna/settings", "error-channel=error");
    let sparse = sparsify(frame(vec![full]), SHUFFLE).unwrap();
    assert!(!names(&sparse.frame.parts[0]));
    assert!(sparse.notes[0].starts_with("dropped error: "), "{:?}", sparse.notes);
}

#[test]
fn channels_stay_complete_as_asked_and_are_listed() {
    let full = frame(vec![ones(0, 0, 8, 8)]);
    let globs = ["[Zz]", "albedo.*"].map(|glob| glob::Pattern::new(glob).unwrap());
    let sparse = sparsify_but(full.clone(), SHUFFLE, &globs).unwrap();
    let part = &sparse.frame.parts[0];
    let same = |name| values(part, name) == values(&full.parts[0], name);
    assert_eq!([same("Z"), same("z"), same("id")], [true, true, false]);
    assert_eq!(crate::channels::dense(part), ["Z", "z"]);
    assert_eq!(sparse.notes, ["--channels 'albedo.*=keep': no channel matches"]);
}

#[test]
fn a_frame_in_which_nothing_would_be_missing_is_told_and_an_empty_one_refused() {
    let full = frame(vec![ones(0, 0, 8, 8)]);
    let all = glob::Pattern::new("*").unwrap();
    let sparse = sparsify_but(full.clone(), SHUFFLE, &[all]).unwrap();
    assert_eq!(sparse.notes, ["every channel stays complete: nothing is missing in this frame"]);
    let few = Pattern::Shuffle { density: 1e-4, seed: 1, frame: 0 };
    let error = sparsify(full, few).unwrap_err().to_string();
    assert!(error.starts_with("none of 8 x 8 pixels would be measured"), "{error}");
}

#[test]
fn parts_agree_on_absolute_pixels() {
    let sparse = sparsify(frame(vec![ones(0, 0, 16, 16), ones(5, -3, 16, 16)]), SHUFFLE).unwrap().frame;
    let at = |part: usize, x: i32, y: i32| {
        let window = sparse.parts[part].data_window;
        values(&sparse.parts[part], "mask")[((y - window.y_min) * 16 + x - window.x_min) as usize]
    };
    for (x, y) in (5..16).flat_map(|x| (0..13).map(move |y| (x, y))) {
        assert_eq!(at(0, x, y).to_bits(), at(1, x, y).to_bits(), "({x}, {y})");
    }
}

#[test]
fn what_a_frame_says_of_its_filling_goes() {
    let mut full = ones(0, 0, 8, 8);
    let told = [
        "lacuna/filter",
        "lacuna/settings",
        "lacuna/density",
        "lacuna/stop",
        "lacuna/guides",
        "lacuna/kept",
        "lacuna/dense",
    ];
    for name in told.iter().chain(&["preview", "lacuna/mask", "lacuna/version", "lacuna/scene", "owner"]) {
        full.attributes.set_text(name, "x");
    }
    let sparse = sparsify(frame(vec![full]), SHUFFLE).unwrap();
    let attributes = &sparse.frame.parts[0].attributes;
    assert!(told.iter().chain(&["preview"]).all(|name| attributes.get(name).is_none()));
    assert!(["lacuna/version", "lacuna/scene", "owner"].iter().all(|name| attributes.get(name).is_some()));
    assert_eq!(attributes.text(mask::ATTRIBUTE).as_deref(), Some("mask"));
    assert!(sparse.notes[0].starts_with("dropped preview, lacuna/filter, "), "{:?}", sparse.notes);
}

#[test]
fn a_frame_with_a_mask_is_refused() {
    let mut part = ones(0, 0, 2, 2);
    part.channels.push(half("Mask", &[1.0; 4]));
    let error = sparsify(frame(vec![part]), SHUFFLE).unwrap_err().to_string();
    assert!(error.starts_with("the frame has a channel 'Mask': the frame looks sparse; fill it"), "{error}");
    let out_of_range = Pattern::Shuffle { density: 1.5, seed: 0, frame: 0 };
    assert!(sparsify(frame(vec![ones(0, 0, 2, 2)]), out_of_range).is_err());
}

#[test]
fn a_frame_is_complete_without_a_mask_with_a_full_one_and_once_it_is_filled() {
    let stamped = |mut part: Part| {
        let job = Job::new(lacuna_filters::Method::from(lacuna_filters::baseline::nearest::Settings));
        Stamp::new(&job, CHANNEL, None).write(&mut part.attributes, 0.5, lacuna_filters::Stop::Converged);
        part
    };
    let with = |name: &str, flags: [f32; 4]| {
        let mut part = ones(0, 0, 2, 2);
        part.channels.push(half(name, &flags));
        part
    };
    let holes = [1.0, 0.0, 1.0, 1.0];
    let other = || ones(9, 9, 3, 3);
    for complete in [
        vec![other()],
        vec![with("mask", [1.0; 4])],
        vec![stamped(with("mask", holes))],
        vec![with("object", holes)],
    ] {
        assert_eq!(check_complete(&frame(complete)), Ok(()));
    }
    for (sparse, named) in [
        (vec![with("mask", holes)], "the frame has a channel 'mask'"),
        (vec![stamped(other()), with("MASK", holes)], "part 1 has a channel 'MASK'"),
        (vec![with("beauty.mask", holes), other()], "part 0 has a channel 'beauty.mask'"),
    ] {
        let mut sparse = frame(sparse);
        if let Some(channel) = sparse.parts[0].channels.first_mut() {
            channel.name = b"beauty.R".into();
        }
        let error = check_complete(&sparse).unwrap_err().to_string();
        assert!(
            error.starts_with(named) && error.contains("the frame looks sparse; fill it first"),
            "{error}"
        );
    }
    // What was filled and made sparse again is not filled any more.
    let again = sparsify(frame(vec![stamped(other())]), SHUFFLE).unwrap();
    assert!(check_complete(&again.frame).is_err());
    assert!(
        again.notes[0].starts_with("dropped lacuna/filter, lacuna/settings, lacuna/density: "),
        "{:?}",
        again.notes
    );
}

#[test]
fn masks_from_files_and_lossy_input() {
    let file = MaskFile::from_grey("m.png".into(), Size::new(2, 2), vec![255, 0, 0, 255], 255);
    let mut part = ones(0, 0, 2, 2);
    part.compression = Compression::B44;
    part.attributes.set_text(mask::ATTRIBUTE, "other");
    let sparse = sparsify(frame(vec![part.clone()]), Pattern::File { file: &file, channel: None }).unwrap();
    assert_eq!(values(&sparse.frame.parts[0], "mask"), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(sparse.frame.parts[0].compression, Compression::Zip);
    assert_eq!(sparse.notes, ["b44 would change measured pixels: written as zip"]);
    assert_eq!(sparse.frame.parts[0].attributes.text(mask::ATTRIBUTE).as_deref(), Some("mask"));
    let uncovered = frame(vec![part, ones(9, 9, 3, 3)]);
    let error = sparsify(uncovered, Pattern::File { file: &file, channel: None }).unwrap_err().to_string();
    assert_eq!(error, "part 1: the mask does not cover pixel (9, 9): give a mask that covers every part");
}

/// Chooses a part of the pixels in four rounds.
fn in_rounds(frame: Frame, target: Option<f64>) -> Result<Sparse, Error> {
    let (first, seed, frame_number) = (None, 3, None);
    let settings =
        adaptive::Settings { density: 0.2, rounds: Some(4), first, target, seed, frame: frame_number };
    sparsify(frame, Pattern::Adaptive { settings: &settings, run: &Run::default() })
}

/// A part of one view with a disc in its colours, or without.
fn view(name: &str, is_even: bool) -> Part {
    let disc = |at: usize| ((at % 60) as f32 - 30.0).hypot((at / 60) as f32 - 20.0) < 12.0;
    let values: Vec<f32> = (0..2400).map(|at| f32::from(u8::from(!is_even && disc(at)))).collect();
    named(
        name,
        name,
        part(window(0, 0, 60, 40), vec![half("B", &values), half("G", &values), half("R", &values)]),
    )
}

#[test]
fn a_layer_of_colour_chooses_whatever_stands_beside_it() {
    let plain = view("", false);
    let mut layer = plain.clone();
    for channel in &mut layer.channels {
        channel.name.splice(0..0, *b"RGBA.");
    }
    let depth: Vec<f32> = (0..2400).map(|at| if at % 7 < 3 { f32::INFINITY } else { at as f32 }).collect();
    layer
        .channels
        .extend([float("Z", &depth), half("albedo.R", &depth.iter().map(|z| z % 2.0).collect::<Vec<_>>())]);
    let pixels =
        |part: Part| values(&in_rounds(frame(vec![part]), None).unwrap().frame.parts[0], "mask").clone();
    assert_eq!(pixels(plain), pixels(layer));
}

#[test]
fn every_view_has_its_say_in_which_pixels_are_chosen() {
    let both = in_rounds(frame(vec![view("left", true), view("right", false)]), Some(0.001)).unwrap();
    let alone = in_rounds(frame(vec![view("right", false)]), Some(0.001)).unwrap();
    assert!(both.rounds.unwrap().rounds.len() > 1);
    let edge = |part: &Part| {
        let is_near =
            |at: usize| (((at % 60) as f32 - 30.0).hypot((at / 60) as f32 - 20.0) - 12.0).abs() < 2.0;
        values(part, "mask").iter().enumerate().filter(|(at, flag)| **flag > 0.0 && is_near(*at)).count()
    };
    assert_eq!(values(&both.frame.parts[0], "mask"), values(&both.frame.parts[1], "mask"));
    let [both, alone] = [&both.frame.parts[1], &alone.frame.parts[0]].map(edge);
    assert!(4 * both > 3 * alone, "{both} of {alone}");
}

#[test]
fn parts_of_other_windows_share_the_rounds_by_absolute_pixels() {
    let mut small = view("a", false);
    small.data_window = window(10, 10, 60, 40);
    let large = named("b", "", part(window(0, 0, 90, 70), vec![half("Z", &[0.5; 6300])]));
    let sparse = in_rounds(frame(vec![small, large]), None).unwrap();
    let [small, large] = [0, 1].map(|at| values(&sparse.frame.parts[at], "mask"));
    for (at, flag) in small.iter().enumerate() {
        assert!((flag - large[(at / 60 + 10) * 90 + at % 60 + 10]).abs() < 1e-6);
    }
    assert_eq!(large.iter().filter(|flag| **flag > 0.0).count(), 1260);
    let mut far = view("b", false);
    far.data_window = window(1_000_000, 1_000_000, 60, 40);
    assert_eq!(in_rounds(frame(vec![view("a", false), far]), None).unwrap_err(), Error::FarApart);
}

#[test]
fn what_lies_between_parts_gives_them_no_more_pixels() {
    let [disc, mut flat] = [view("a", false), view("b", true)];
    flat.data_window = window(160, 30, 60, 40);
    let sparse = in_rounds(frame(vec![disc, flat]), None).unwrap();
    assert!((sparse.density - 0.2).abs() < 1e-3, "{}", sparse.density);
}

#[test]
fn chosen_pixels_without_a_value_are_counted() {
    let mut part = view("", false);
    let Samples::Half(values) = &mut part.channels[0].samples else { unreachable!() };
    values.iter_mut().step_by(2).for_each(|value| *value = f16::NAN);
    let sparse = in_rounds(frame(vec![part]), None).unwrap();
    assert!(sparse.notes[0].contains("not finite"), "{:?}", sparse.notes);
    assert!(in_rounds(frame(vec![view("", false)]), None).unwrap().notes.is_empty());
}

#[test]
fn the_list_of_complete_channels_is_not_said_to_be_dropped() {
    let mut part = ones(0, 0, 8, 8);
    part.attributes.set_text(DENSE, "Z");
    let sparse =
        sparsify_but(frame(vec![part.clone()]), SHUFFLE, &[glob::Pattern::new("Z").unwrap()]).unwrap();
    assert!(sparse.notes.is_empty(), "{:?}", sparse.notes);
    assert!(sparsify(frame(vec![part]), SHUFFLE).unwrap().notes[0].contains(DENSE));
}
