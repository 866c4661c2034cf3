//! Frames that were filled before, mattes that are called as masks are, and NaN where no mask is.

use half::f16;
use lacuna_exr::{Frame, Samples};

use crate::room::{Room, sparse};

/// A frame without a mask, whose colour has values everywhere but where `nan` says.
fn complete(nan: impl Fn(usize) -> bool) -> Frame {
    let mut frame = sparse(40, 30);
    frame.parts[0].channels.retain(|channel| channel.name != b"mask");
    for channel in &mut frame.parts[0].channels {
        let value = |at: usize| if nan(at) { f32::NAN } else { 0.2 + (at % 40) as f32 / 50.0 };
        channel.samples = Samples::Float((0..1200).map(value).collect());
    }
    frame
}

/// The same beside a channel `mask`.
fn with_mask(measured: impl Fn(usize) -> bool) -> Frame {
    let mut frame = complete(|_| false);
    let mask = sparse(40, 30).parts[0].channels.iter().find(|channel| channel.name == b"mask").cloned();
    let mut mask = mask.unwrap();
    mask.samples = Samples::Half((0..1200).map(|at| f16::from_f32(f32::from(measured(at)))).collect());
    frame.parts[0].channels.push(mask);
    frame
}

#[test]
fn a_filled_frame_is_recognised() {
    let room = Room::with(&["in.exr"]);
    room.ok(&["fill", "in.exr", "-o", "full.exr", "--filter", "ss"]);
    let info = room.ok(&["info", "full.exr"]).out;
    assert!(info.contains("filled by ss\n") && info.contains("missing pixels by estimate: "), "{info}");
    assert!(!room.ok(&["info", "in.exr"]).out.contains("filled"));

    let done = room.run(&["fill", "full.exr", "-o", "twice.exr"]);
    let errors = done.errors();
    assert!(done.status == 1 && errors.len() == 1 && !room.path("twice.exr").exists(), "{}", done.err);
    assert!(errors[0].contains("filled by ss already") && errors[0].contains("--again"), "{}", errors[0]);
    room.ok(&["fill", "full.exr", "-o", "twice.exr", "--again", "--filter", "ss"]);
    let pixels = |name: &str| room.read(name).parts.remove(0).channels;
    assert_eq!(pixels("twice.exr"), pixels("full.exr"));

    room.ok(&["fill", "in.exr", "-o", "dropped.exr", "--drop-mask", "--filter", "ss"]);
    let done = room.run(&["fill", "dropped.exr", "-o", "twice.exr"]);
    assert!(
        done.status == 1 && done.err.contains("filled by ss already, and without a mask"),
        "{}",
        done.err
    );

    // Enlarged as a frame that says nothing of masks.
    let words = ["upscale", "full.exr", "-o", "large.exr", "--scale", "2"];
    let said = room.ok(&words).err;
    assert!(said.contains("filled by ss already: taken as complete") && !said.contains("warning"), "{said}");
    let info = room.ok(&["info", "large.exr"]).out;
    assert!(info.contains("  enlarged by ss\n") && !info.contains("by estimate"), "{info}");
    assert!(info.contains("mask: mask, density 100.00 %"), "{info}");
    let swapped = "are the two swapped?";
    assert!(room.run(&["compare", "full.exr", "in.exr"]).err.contains(swapped));
    assert!(!room.run(&["compare", "in.exr", "full.exr"]).err.contains(swapped));
    let mut plain = room.read("full.exr");
    plain.parts[0].attributes = lacuna_exr::Attributes::default();
    plain.parts[0].channels.retain(|channel| channel.name != b"mask");
    room.add("plain.exr", &plain);
    room.ok(&["upscale", "plain.exr", "-o", "expected.exr", "--scale", "2"]);
    let mut large = pixels("large.exr");
    large.retain(|channel| channel.name != b"mask");
    assert_eq!(large, pixels("expected.exr"));
    let named = [&words[..], &["--mask", "channel:mask"]].concat();
    assert!(!room.ok(&named).err.contains("taken as complete"));
}

#[test]
fn a_matte_beside_complete_colour_is_no_sampling_mask() {
    let room = Room::new();
    room.add("matte.exr", &with_mask(|at| (10..25).contains(&(at % 40)) && at > 200));
    room.add("nowhere.exr", &with_mask(|_| false));
    room.add("scattered.exr", &with_mask(|at| at * 7 % 5 == 0));
    let note = "is taken for a matte";
    for name in ["matte.exr", "nowhere.exr"] {
        let said = room.ok(&["fill", name, "-o", "out.exr"]).err;
        assert!(said.matches(note).count() == 1 && said.contains("--mask channel:mask"), "{said}");
        assert_eq!(room.read("out.exr"), room.read(name), "{name}");
        assert!(room.ok(&["info", name]).out.contains(note));
        assert!(room.ok(&["upscale", name, "-o", "large.exr", "--scale", "2"]).err.contains(note));
    }
    let words = ["fill", "matte.exr", "-o", "out.exr", "--mask", "channel:mask"];
    assert!(!room.ok(&words).err.contains(note));
    assert!(!room.ok(&["fill", "scattered.exr", "-o", "out.exr"]).err.contains(note));

    // Where colour is blank outside of the region, that was not rendered.
    let mut lost = with_mask(|at| at % 40 < 25);
    for channel in lost.parts[0].channels.iter_mut().filter(|channel| channel.name != b"mask") {
        let Samples::Float(values) = &mut channel.samples else { continue };
        (0..1200).filter(|at| at % 40 >= 25).for_each(|at| values[at] = 0.0);
    }
    room.add("lost.exr", &lost);
    assert!(!room.ok(&["fill", "lost.exr", "-o", "out.exr"]).err.contains(note));
}

#[test]
fn scattered_nan_without_a_mask_is_pointed_out() {
    let room = Room::new();
    room.add("nan.exr", &complete(|at| at % 3 != 0));
    room.add("fault.exr", &complete(|at| at == 600));
    let hint = "--mask nan takes them as missing";
    let done = room.run(&["fill", "nan.exr", "-o", "out.exr"]);
    assert!(done.status == 1 && done.errors()[0].contains(hint), "{}", done.err);
    assert!(room.ok(&["info", "nan.exr"]).out.contains(hint));
    assert!(room.ok(&["upscale", "nan.exr", "-o", "out.exr", "--scale", "2"]).err.contains(hint));
    assert!(!room.run(&["fill", "fault.exr", "-o", "out.exr"]).err.contains(hint));
    room.ok(&["fill", "nan.exr", "-o", "out.exr", "--mask", "nan"]);
}

#[test]
fn a_frame_filled_by_a_mask_that_it_does_not_hold_says_which_to_give() {
    let room = Room::new();
    let third = |at: usize| at.is_multiple_of(3);
    room.add("full.exr", &complete(|_| false));
    room.add("in.exr", &complete(|at| !third(at)));
    room.add("mask.exr", &with_mask(third));
    room.ok(&["fill", "in.exr", "-o", "out.exr", "--mask", "mask.exr", "--filter", "ss"]);
    for command in [
        &["fill", "out.exr", "-o", "b.exr", "--again"][..],
        &["mask", "--after", "out.exr", "-o", "b.exr", "--add", "0.1"],
    ] {
        let done = room.run(command);
        assert!(done.status == 1 && done.err.contains("give it with --mask mask.exr"), "{}", done.err);
    }
    let apart = "nothing is said of the missing pixels alone";
    assert!(!room.ok(&["compare", "full.exr", "out.exr"]).err.contains(apart));
    std::fs::rename(room.path("mask.exr"), room.path("gone.exr")).unwrap();
    let said = room.ok(&["compare", "full.exr", "out.exr"]).err;
    assert!(said.contains(apart) && said.contains("name it with --mask"), "{said}");
    assert!(!room.ok(&["compare", "full.exr", "out.exr", "--mask", "gone.exr"]).err.contains(apart));

    // What the values said before they were filled.
    room.ok(&["fill", "in.exr", "-o", "nan.exr", "--mask", "nan", "--filter", "ss"]);
    let done = room.ok(&["compare", "full.exr", "nan.exr"]);
    assert!(
        done.err.contains(apart) && done.err.contains("'nan'") && !done.err.contains("density"),
        "{}",
        done.err
    );
    assert!(room.run(&["fill", "nan.exr", "-o", "b.exr", "--again"]).err.contains("before they were filled"));
    // Nor is it found where someone asks for it by name.
    let done = room.run(&["compare", "full.exr", "nan.exr", "--mask", "nan"]);
    assert!(done.status == 1 && done.err.contains("--mask file:IMAGE"), "{}", done.err);
}

#[test]
fn a_mask_that_seems_inverted_is_refused() {
    let room = Room::new();
    let right = with_mask(|at| at.is_multiple_of(3));
    let changed = |change: fn(usize, &mut f32)| {
        let mut frame = right.clone();
        for channel in &mut frame.parts[0].channels {
            if let Samples::Float(values) = &mut channel.samples {
                values.iter_mut().enumerate().for_each(|(at, value)| change(at, value));
            }
        }
        frame
    };
    room.add("right.exr", &right);
    room.add("black.exr", &changed(|_, value| *value = 0.0));
    room.add("cleared.exr", &changed(|at, value| *value = if at.is_multiple_of(3) { 0.0 } else { 1.0 }));
    room.add("wrong.exr", &changed(|at, value| *value = if at.is_multiple_of(3) { 0.0 } else { *value }));
    for name in ["right.exr", "black.exr", "cleared.exr"] {
        room.ok(&["fill", name, "-o", "out.exr", "--force", "--filter", "ss"]);
    }
    let done = room.run(&["fill", "wrong.exr", "-o", "wrong.out.exr", "-q", "--filter", "ss"]);
    assert!(done.status == 1 && done.errors()[0].contains("the mask seems inverted"), "{}", done.err);
    assert!(!room.path("wrong.out.exr").exists());
    // Of another frame: it measures as few pixels, but others.
    let other = with_mask(|at| at % 3 == 1).parts.remove(0);
    let mask = lacuna_exr::Part { channels: vec![other.channels.last().unwrap().clone()], ..other };
    room.add("mask.exr", &Frame { parts: vec![mask] });
    room.add("bare.exr", &changed(|at, value| *value = if at.is_multiple_of(3) { *value } else { 0.0 }));
    let done = room.run(&[
        "fill",
        "bare.exr",
        "--mask",
        "file:mask.exr",
        "-o",
        "wrong.out.exr",
        "-q",
        "--filter",
        "ss",
    ]);
    assert!(
        done.status == 1 && done.errors()[0].contains("the mask seems that of another frame or seed"),
        "{}",
        done.err
    );
}
