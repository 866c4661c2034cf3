//! `lacuna mask` through the binary: patterns, ranks, frames, two passes, measures, refusals.

use std::collections::HashSet;

use crate::room::{Room, part_of, values};
use lacuna_exr::{Frame, Samples, Window};

/// The `x y` lines of a list.
fn points(room: &Room, name: &str) -> Vec<(i64, i64)> {
    let text = std::fs::read_to_string(room.path(name)).unwrap();
    let point = |line: &str| {
        let (x, y) = line.split_once(' ').unwrap();
        (x.parse().unwrap(), y.parse().unwrap())
    };
    text.lines().map(point).collect()
}

#[test]
fn every_pattern_has_every_form() {
    let room = Room::new();
    for pattern in ["random", "shuffle", "poisson", "blue-noise", "grid"] {
        for name in ["m.exr", "m.png", "m.txt", "m.json"] {
            let words = ["mask", "-o", name, "--size", "61x47-5+9", "--density", "0.2", "--pattern", pattern];
            let done = room.ok(&words);
            assert!(done.err.contains("density"), "{}", done.err);
        }
        let frame = room.read("m.exr");
        let window = frame.parts[0].data_window;
        assert_eq!((window.x_min, window.y_min, window.x_max, window.y_max), (-5, 9, 55, 55));
        let mask = values(&frame, "mask");
        let count = mask.iter().filter(|&&value| value == 1.0).count();
        assert_eq!(mask.iter().filter(|&&value| value == 0.0).count(), 61 * 47 - count);
        let list = points(&room, "m.txt");
        assert_eq!(list.len(), count);
        assert!(list.iter().all(|&(x, y)| mask[((y - 9) * 61 + x + 5) as usize] == 1.0));
        if matches!(pattern, "random" | "poisson") {
            assert_eq!(count, 573, "round(0.2 * 61 * 47)");
        }
    }
}

#[test]
fn a_list_of_a_smaller_density_begins_that_of_a_larger() {
    let room = Room::new();
    for pattern in ["random", "shuffle", "blue-noise"] {
        for (name, density) in [("a.txt", "0.1"), ("b.txt", "0.3")] {
            room.ok(&["mask", "-o", name, "--size", "40x40", "--density", density, "--pattern", pattern]);
        }
        let (small, large) = (points(&room, "a.txt"), points(&room, "b.txt"));
        assert_eq!(small, large[..small.len()], "{pattern}");
    }
}

#[test]
fn threads_and_repetition_change_no_byte() {
    let room = Room::new();
    for pattern in ["random", "shuffle", "poisson", "blue-noise"] {
        let bytes = |threads: &str| {
            let words = ["mask", "-o", "m.exr", "--size", "90x70", "--density", "0.15", "--pattern", pattern];
            room.ok(&[&words[..], &["--threads", threads]].concat());
            std::fs::read(room.path("m.exr")).unwrap()
        };
        let one = bytes("1");
        assert_eq!(one, bytes("2"), "{pattern}");
        assert_eq!(one, bytes("5"), "{pattern}");
    }
}

#[test]
fn complementary_frames_cover_every_pixel() {
    let room = Room::new();
    let words = ["mask", "-o", "m.####.txt", "--size", "32x20", "--density", "0.25"];
    room.ok(&[&words[..], &["--frames", "7-10"]].concat());
    let all = (7..=10).flat_map(|frame| points(&room, &format!("m.{frame:04}.txt")));
    let all: Vec<_> = all.collect();
    assert_eq!(all.len(), 640);
    assert_eq!(all.into_iter().collect::<HashSet<_>>().len(), 640);
    // What made each of them stands in it.
    let words = ["mask", "-o", "m.#.exr", "--size", "8x8", "--density", "0.25", "--frames", "3-4"];
    room.ok(&[&words[..], &["--temporal", "offset"]].concat());
    let pattern = room.read("m.0004.exr").parts[0].attributes.text("lacuna/pattern");
    assert_eq!(pattern.as_deref(), Some("shuffle density=0.25 temporal=offset frame=4"));
}

#[test]
fn ranks_are_floats() {
    let room = Room::new();
    room.ok(&["mask", "-o", "r.exr", "--size", "20x10", "--rank"]);
    let frame = room.read("r.exr");
    assert!(matches!(frame.parts[0].channels[0].samples, Samples::Float(_)));
    assert!(values(&frame, "rank").iter().all(|rank| (0.0..1.0).contains(rank)));
    let done = room.run(&["mask", "-o", "r.exr", "--size", "20x10", "--rank", "--pattern", "poisson"]);
    assert_eq!(done.status, 2);
    assert!(done.err.contains("not progressive"), "{}", done.err);
}

#[test]
fn a_second_pass_is_chosen_computed_and_united() {
    let room = Room::new();
    let full = |room: &Room, name: &str| {
        let mut frame = crate::room::sparse(40, 30);
        frame.parts[0].channels.retain(|channel| channel.name != b"mask");
        for (index, channel) in frame.parts[0].channels.iter_mut().enumerate() {
            let step = |pixel: usize| if pixel % 40 > 18 { 0.9_f32 } else { 0.1 } + index as f32 * 0.01;
            channel.samples = Samples::Float((0..1200).map(step).collect());
        }
        room.add(name, &frame);
    };
    full(&room, "full.exr");
    room.ok(&["mask", "-o", "first.exr", "--size", "40x30", "--density", "0.15"]);
    room.ok(&["sparsify", "full.exr", "-o", "a.exr", "--mask", "first.exr"]);
    room.ok(&["fill", "a.exr", "-o", "filled.exr"]);
    let words = ["mask", "--after", "filled.exr", "-o", "next.exr", "--add", "0.05"];
    room.ok(&[&words[..], &["--error-estimate", "error.exr"]].concat());
    room.ok(&["mask", "--after", "a.exr", "-o", "same.txt", "--add", "0.05"]);
    let (first, next) = (values(&room.read("first.exr"), "mask"), values(&room.read("next.exr"), "mask"));
    assert_eq!(next.iter().filter(|&&value| value == 1.0).count(), 60);
    assert!(first.iter().zip(&next).all(|(first, next)| *first == 0.0 || *next == 0.0));
    let listed = points(&room, "same.txt");
    assert!(listed.len() == 60 && listed.iter().all(|(x, y)| next[(y * 40 + x) as usize] == 1.0));
    let near_edge = listed.iter().filter(|(x, _)| (13..=25).contains(x)).count();
    assert!(near_edge > 45, "{near_edge} of 60 near the edge");
    let error = values(&room.read("error.exr"), "error");
    assert!(
        error.iter().zip(&first).all(|(error, first)| error.is_finite() && (*first == 0.0 || *error == 0.0))
    );

    room.ok(&["sparsify", "full.exr", "-o", "b.exr", "--mask", "next.exr"]);
    room.ok(&["mask", "--merge", "a.exr", "b.exr", "-o", "c.exr"]);
    let (full, c) = (room.read("full.exr"), room.read("c.exr"));
    let union = values(&c, "mask");
    assert!(union.iter().zip(first.iter().zip(&next)).all(|(u, (a, b))| *u == a + b));
    for name in ["R", "G", "B"] {
        let measured = values(&full, name).into_iter().zip(values(&c, name)).zip(&union);
        for ((full, united), measured) in measured {
            assert_eq!(united.to_bits(), if *measured == 1.0 { full.to_bits() } else { 0 });
        }
    }
    room.ok(&["fill", "c.exr", "-o", "done.exr"]);
    room.ok(&["verify", "c.exr", "done.exr"]);
}

#[test]
fn the_next_pixels_of_a_frame_are_those_of_all_its_parts() {
    let room = Room::new();
    let cropped = |name: &str, x_min: i32, x_max: i32, channels: [&str; 2]| {
        let mut part = part_of(Window { x_min, y_min: 5, x_max, y_max: 24 }, |_| true);
        part.channels.retain(|channel| channels.contains(&channel.name.escape_ascii().to_string().as_str()));
        part.display_window = Window { x_min: 0, y_min: 0, x_max: 59, y_max: 29 };
        part.attributes.set_text("name", name);
        part.attributes.set_text("type", "scanlineimage");
        part
    };
    let parts = vec![cropped("depth", 3, 40, ["Z", "Z"]), cropped("colour", 10, 55, ["G", "R"])];
    room.add("full.exr", &Frame { parts });
    room.ok(&["sparsify", "full.exr", "-o", "a.exr", "--density", "0.2", "--adaptive"]);
    room.ok(&["mask", "--after", "a.exr", "-o", "next.exr", "--add", "0.1"]);
    let window = room.read("next.exr").parts[0].data_window;
    assert_eq!((window.x_min, window.y_min, window.x_max, window.y_max), (3, 5, 55, 24));
    room.ok(&["sparsify", "full.exr", "-o", "b.exr", "--mask", "next.exr"]);
    room.ok(&["mask", "--merge", "a.exr", "b.exr", "-o", "c.exr"]);
    let count = |name: &str| {
        let parts = room.read(name).parts;
        let colour = Frame { parts: parts.into_iter().skip(1).collect() };
        values(&colour, "mask").iter().filter(|value| **value > 0.0).count()
    };
    assert_eq!(count("b.exr"), 92);
    assert_eq!(count("c.exr"), count("a.exr") + count("b.exr"));
}

#[test]
fn what_the_bounds_force_is_measured_next_as_well() {
    let room = Room::with(&["a.exr"]);
    room.ok(&["fill", "a.exr", "-o", "filled.exr"]);
    let mask = values(&room.read("a.exr"), "mask");
    let width = room.read("a.exr").parts[0].size().width as i64;
    let height = mask.len() as i64 / width;
    let is_border = |x: i64, y: i64| x.min(width - 1 - x).min(y).min(height - 1 - y) < 2;
    let words = ["mask", "--after", "filled.exr", "--add", "0.05"];
    room.ok(&[&words[..], &["-o", "plain.txt"]].concat());
    room.ok(&[&words[..], &["-o", "border.txt", "--border", "2"]].concat());
    room.ok(&["mask", "--size", &format!("{width}x{height}"), "--density", "0.1", "-o", "some.png"]);
    room.ok(&[&words[..], &["-o", "always.txt", "--always", "some.png"]].concat());
    room.ok(&["mask", "--size", &format!("{width}x{height}"), "--density", "0.1", "-o", "some.txt"]);
    let always = points(&room, "some.txt");
    let (plain, bordered, forced) =
        (points(&room, "plain.txt"), points(&room, "border.txt"), points(&room, "always.txt"));
    let all = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let missing: Vec<(i64, i64)> = all.filter(|(x, y)| mask[(y * width + x) as usize] < 0.5).collect();
    let border: Vec<_> = missing.iter().filter(|(x, y)| is_border(*x, *y)).collect();
    assert!(!border.is_empty() && border.iter().all(|pixel| bordered.contains(pixel)));
    assert_eq!(bordered.len(), (border.len() + plain.len()).min(missing.len()));
    let due: Vec<_> = always.iter().filter(|pixel| missing.contains(pixel)).collect();
    assert!(!due.is_empty() && due.iter().all(|pixel| forced.contains(pixel)));
    assert_eq!(forced.len(), (due.len() + plain.len()).min(missing.len()));
}

#[test]
fn the_union_of_a_fill_and_a_second_pass_is_sparse_and_can_be_filled() {
    let room = Room::with(&["a.exr", "b.exr"]);
    room.ok(&["fill", "a.exr", "-o", "filled.exr", "--error-channel"]);
    room.ok(&["mask", "--merge", "filled.exr", "b.exr", "-o", "both.exr"]);
    let both = room.read("both.exr");
    let told = ["filter", "settings", "density", "estimate"].map(|name| format!("lacuna/{name}"));
    assert!(told.iter().all(|name| both.parts[0].attributes.get(name).is_none()));
    room.ok(&["fill", "both.exr", "-o", "again.exr"]);
    room.ok(&["verify", "both.exr", "again.exr"]);
}

#[test]
fn second_passes_go_frame_by_frame() {
    let room = Room::with(&["a.0001.exr", "a.0003.exr", "b.0001.exr", "b.0003.exr"]);
    let words = ["mask", "--after", "a.####.exr", "-o", "next.####.txt", "--add", "0.1"];
    room.ok(&[&words[..], &["--error-estimate", "error.####.png", "--frames", "3"]].concat());
    assert!(room.path("next.0003.txt").exists() && room.path("error.0003.png").exists());
    assert!(!room.path("next.0001.txt").exists());
    room.ok(&words);
    let (first, third) = (points(&room, "next.0001.txt"), points(&room, "next.0003.txt"));
    assert!(!first.is_empty() && first.len() == third.len());
    room.ok(&["mask", "--merge", "a.####.exr", "b.####.exr", "-o", "both.####.exr"]);
    assert!(room.path("both.0001.exr").exists() && room.path("both.0003.exr").exists());
    // A frame that either render lacks fails, in either order; neither that nor others stop the rest.
    std::fs::remove_file(room.path("a.0003.exr")).unwrap();
    for (first, second) in
        [("a.####.exr", "b.####.exr"), ("b.####.exr", "a.####.exr"), ("a.*.exr", "b.#.exr")]
    {
        let done = room.run(&["mask", "--merge", first, second, "-o", "again.##.exr", "-q"]);
        let errors = done.errors();
        let told = if first == "a.*.exr" {
            "a.*.exr: no file of frame 3 matches"
        } else {
            "a.0003.exr: cannot open"
        };
        assert!(done.status == 1 && errors.len() == 1 && errors[0].contains(told), "{}", done.err);
        assert!(room.path("again.01.exr").exists() && !room.path("again.03.exr").exists());
        std::fs::remove_file(room.path("again.01.exr")).unwrap();
    }
    room.add("a.0003.exr", &room.read("b.0003.exr"));
    let done =
        room.run(&["mask", "--after", "a.####.exr", "-o", "n.#.png", "--add", "0.1", "--frames", "1-3"]);
    assert!(done.status == 1 && done.err.contains("a.0002.exr"), "{}", done.err);
    assert!(room.path("n.0001.png").exists() && room.path("n.0003.png").exists());
    let done = room.run(&["mask", "--after", "a.####.exr", "-o", "next.txt", "--add", "0.1"]);
    assert!(done.status == 2 && done.err.contains("pattern"), "{}", done.err);
}

#[test]
fn an_input_is_never_written_over() {
    let room = Room::with(&["a.exr"]);
    room.ok(&["mask", "-o", "m.png", "--size", "20x10", "--density", "0.5"]);
    for (name, other) in [("a.exr", "hard.exr"), ("m.png", "hard.png")] {
        std::fs::hard_link(room.path(name), room.path(other)).unwrap();
    }
    let bytes = |name: &str| std::fs::read(room.path(name)).unwrap();
    let (frame, mask) = (bytes("a.exr"), bytes("m.png"));
    for words in [
        &["--after", "a.exr", "--add", "0.1", "-o", "a.exr"][..],
        &["--after", "a.exr", "--add", "0.1", "-o", "n.exr", "--error-estimate", "a.exr"],
        &["--after", "a.exr", "--add", "0.1", "-o", "hard.exr"],
        &["--merge", "a.exr", "a.exr", "-o", "hard.exr"],
        &["--after", "a.exr", "--add", "0.1", "--mask", "m.png", "-o", "hard.png"],
        &["--size", "20x10", "--density", "0.2", "--inside", "m.png", "-o", "m.png"],
        &["m.png", "-o", "m.png"],
        &["m.png", "-o", "hard.png"],
    ] {
        let command = if words[0].starts_with("--") { "mask" } else { "analyze" };
        let done = room.run(&[&[command][..], words].concat());
        assert_eq!(done.status, 2, "{words:?}: {}", done.err);
        assert!(done.err.contains("the output is the same file as the"), "{words:?}: {}", done.err);
    }
    for estimate in ["n.exr", "./n.exr"] {
        let words = ["mask", "--after", "a.exr", "--add", "0.1", "-o", "n.exr", "--error-estimate", estimate];
        let done = room.run(&words);
        assert!(done.status == 2 && done.err.contains("written twice"), "{}", done.err);
    }
    assert!(bytes("a.exr") == frame && bytes("m.png") == mask);
}

#[test]
fn a_mask_of_no_pixel_is_not_made() {
    let room = Room::with(&["a.exr"]);
    let none = ["--size", "20x10", "--density", "0.001"];
    for pattern in ["random", "poisson", "blue-noise"] {
        let done = room.run(&[&["mask", "-o", "m.png", "--pattern", pattern], &none[..]].concat());
        assert!(done.status == 1 && done.err.contains("none of 20 x 10 pixels"), "{}", done.err);
        assert!(!room.path("m.png").exists());
    }
    std::fs::write(room.path("scene.toml"), "volume = \"procedural:marschner-lobb:8\"").unwrap();
    let scene = ["render", "scene.toml", "-o", "r.exr", "--size", "9x9", "--density", "0.0001"];
    let done = room.run(&[&scene, &["--set", "image.seed=1"][..]].concat());
    assert!(done.status == 1 && done.err.contains("none of 9 x 9 pixels"), "{}", done.err);
}

#[test]
fn the_overhead_of_crops_is_for_rectangles() {
    let room = Room::new();
    let done =
        room.run(&["mask", "-o", "m.png", "--size", "9x9", "--density", "0.5", "--crop-overhead", "9"]);
    assert!(done.status == 2 && done.err.contains("goes with an output in .json"), "{}", done.err);
}

#[test]
fn a_read_only_output_is_refused_without_flags_that_are_not_there() {
    let room = Room::with(&["a.exr"]);
    std::fs::write(room.path("ro.exr"), "old").unwrap();
    let mut mode = room.path("ro.exr").metadata().unwrap().permissions();
    mode.set_readonly(true);
    std::fs::set_permissions(room.path("ro.exr"), mode).unwrap();
    let done = room.run(&["mask", "-o", "ro.exr", "--size", "20x10", "--density", "0.5"]);
    assert!(
        done.status == 1 && done.err.contains("is read-only") && !done.err.contains("--"),
        "{}",
        done.err
    );
    let done = room.run(&["fill", "a.exr", "-o", "ro.exr"]);
    assert!(done.status == 1 && done.err.contains("replace it with --force"), "{}", done.err);
    let done = room.run(&["analyze", "a.exr:nothing"]);
    assert!(done.status == 1 && done.err.contains("name one as a.exr:CHANNEL"), "{}", done.err);
}

#[test]
fn outputs_that_are_to_stay_are_passed_over() {
    let room = Room::with(&["a.0001.exr", "a.0002.exr"]);
    let old = b"of another run";
    let stays = ["m.0002.txt", "next.0001.txt", "error.0002.exr", "both.exr", "plot.png"];
    for name in stays {
        std::fs::write(room.path(name), old).unwrap();
    }
    room.ok(&["mask", "-o", "m.exr", "--size", "20x10", "--density", "0.5"]);
    let (first, after) = (["--merge", "a.0001.exr", "a.0002.exr"], ["--after", "a.####.exr", "--add", "0.1"]);
    for (words, passed, made) in [
        (
            &["-o", "m.#.txt", "--size", "8x8", "--density", "0.5", "--frames", "1-3"][..],
            &["m.0002.txt"][..],
            &["m.0001.txt", "m.0003.txt"][..],
        ),
        (
            &[&after[..], &["-o", "next.####.txt", "--error-estimate", "error.####.exr"]].concat(),
            &["next.0001.txt", "error.0002.exr"],
            &["next.0002.txt", "error.0001.exr"],
        ),
        (&[&first[..], &["-o", "both.exr"]].concat(), &["both.exr"], &[]),
        (&["m.exr", "-o", "plot.png"], &["plot.png"], &[]),
    ] {
        let command = if words[0].starts_with('-') { "mask" } else { "analyze" };
        let done = room.ok(&[&[command, "--no-clobber"][..], words].concat());
        for name in passed {
            assert!(
                done.err.contains(&format!("{name}: skipped: the output exists")),
                "{name}: {}",
                done.err
            );
        }
        assert!(made.iter().all(|name| room.path(name).exists()), "{words:?}");
    }
    assert!(stays.iter().all(|name| std::fs::read(room.path(name)).unwrap() == old));
}

#[test]
fn masks_are_measured() {
    let room = Room::new();
    room.ok(&["mask", "-o", "m.png", "--size", "64x64", "--density", "0.25", "--pattern", "grid"]);
    let done = room.ok(&["analyze", "m.png", "-o", "plot.png", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&done.out).unwrap();
    assert_eq!(json["density"], 0.25);
    assert_eq!(json["nearest"]["minimum"], 2.0);
    assert!((json["largest_hole"].as_f64().unwrap() - std::f64::consts::SQRT_2).abs() < 1e-12);
    assert!((json["fourier_coherence"].as_f64().unwrap() - 1.0).abs() < 1e-12, "a grid aliases");
    assert!(room.path("plot.png").exists());
    let done = room.ok(&["analyze", "m.png"]);
    assert!(done.out.contains("star discrepancy"), "{}", done.out);
}

#[test]
fn nonsense_is_refused_in_one_line() {
    let room = Room::with(&["a.exr"]);
    for (words, status, reason) in [
        (&["--size", "10x10", "--density", "1.5", "-o", "m.exr"][..], 2, "above 0 and at most 1"),
        (&["--size", "0x10", "--density", "0.5", "-o", "m.exr"], 2, "from 1 to 32768"),
        (&["--size", "10x10", "--density", "0.5", "-o", "m.tif"], 2, "does not end in"),
        (&["--after", "missing.exr", "--add", "0.1", "-o", "m.exr"], 1, "missing.exr"),
        (&["--merge", "a.exr", "a.exr", "-o", "a.exr"], 2, "the same file as the first render"),
        (
            &["--size", "10x10", "--density", "0.5", "-o", "m.exr", "--inside", "missing.exr"],
            1,
            "missing.exr",
        ),
    ] {
        let done = room.run(&[&["mask"][..], words].concat());
        assert_eq!(done.status, status, "{words:?}: {}", done.err);
        let first = done.err.lines().next().unwrap();
        assert!(first.starts_with("lacuna: error: ") && first.contains(reason), "{words:?}: {}", done.err);
    }
    assert_eq!(room.names("."), ["a.exr"]);
}
