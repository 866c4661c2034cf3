//! `lacuna fill` on sequences: names and numbers, partial failure, repeated runs, reports, refusals.

use crate::room::{Room, age, bytes, part, sparse, values};
use lacuna_exr::{Frame, Window};

const SHOT: &[&str] = &["s.0001.exr", "s.0002.exr", "s.0003.exr"];

fn numbered(numbers: &[i64]) -> Vec<String> {
    numbers.iter().map(|number| format!("s.{number:04}.exr")).collect()
}

#[test]
fn a_frame_is_filled_and_its_measured_pixels_are_kept() {
    let room = Room::with(&["in.exr"]);
    let done = room.ok(&["fill", "in.exr", "-o", "out.exr"]);
    assert!(done.err.contains("density 20.00 %"), "{}", done.err);
    assert!(done.err.contains("Progress: 100%"), "{}", done.err);
    assert_eq!(done.out, "");
    let (before, after) = (room.read("in.exr"), room.read("out.exr"));
    for name in ["R", "G", "B"] {
        for (at, (old, new)) in values(&before, name).into_iter().zip(values(&after, name)).enumerate() {
            assert!(
                if at % 5 == 0 { old.to_bits() == new.to_bits() } else { new > 0.05 },
                "{name} {at}: {old} {new}"
            );
        }
    }
    room.ok(&["verify", "in.exr", "out.exr"]);
}

#[test]
fn every_spelling_of_a_pattern_works() {
    for spelling in ["s.####.exr", "s.#.exr", "s.%04d.exr", "s.@@@@.exr", "s.$F4.exr"] {
        let room = Room::with(SHOT);
        room.folder("out");
        room.ok(&["fill", spelling, "-o", &format!("out/{spelling}"), "--filter", "nearest"]);
        assert_eq!(room.names("out"), numbered(&[1, 2, 3]), "{spelling}");
    }
}

#[test]
fn globs_lists_and_several_inputs_go_into_a_folder_or_pattern() {
    let room = Room::with(SHOT);
    room.ok(&["fill", "s.*.exr", "-o", "glob/", "--create-dir", "--filter", "nearest"]);
    assert_eq!(room.names("glob"), numbered(&[1, 2, 3]));
    room.ok(&[
        "fill",
        "s.0001.exr",
        "s.0003.exr",
        "-o",
        "two/o.%d.exr",
        "--create-dir",
        "--filter",
        "nearest",
    ]);
    assert_eq!(room.names("two"), ["o.1.exr", "o.3.exr"]);
    std::fs::write(room.path("list"), "s.0002.exr\n").unwrap();
    room.ok(&["fill", "--files-from", "list", "-o", "listed/", "--create-dir", "--filter", "nearest"]);
}

#[test]
fn frames_are_chosen_by_range() {
    for (range, expected) in [("2-3", &[2, 3][..]), ("1-3x2", &[1, 3]), ("3-1:2", &[1, 3]), ("3,1", &[1, 3])]
    {
        let room = Room::with(SHOT);
        room.ok(&[
            "fill",
            "s.#.exr",
            "-o",
            "o/s.#.exr",
            "--create-dir",
            "--frames",
            range,
            "--filter",
            "nearest",
        ]);
        assert_eq!(room.names("o"), numbered(expected), "{range}");
    }
    let room = Room::with(&["s.-002.exr", "s.0000.exr"]);
    room.ok(&[
        "fill",
        "s.#.exr",
        "-o",
        "o/s.#.exr",
        "--create-dir",
        "--frames",
        "-2-0x2",
        "--filter",
        "nearest",
    ]);
    assert_eq!(room.names("o"), ["s.-002.exr", "s.0000.exr"]);
}

#[test]
fn one_bad_frame_does_not_stop_the_others() {
    let room = Room::with(&["s.0001.exr", "s.0002.exr", "s.0005.exr"]);
    let whole = bytes(&room.path("s.0002.exr"));
    std::fs::write(room.path("s.0002.exr"), &whole[..whole.len() / 2]).unwrap();
    std::fs::write(room.path("s.0004.exr"), "no frame").unwrap();
    room.folder("o");
    let done = room.run(&["fill", "s.#.exr", "-o", "o/s.#.exr", "--frames", "1-5", "-q", "--json", "r.json"]);
    assert_eq!(done.status, 1);
    assert_eq!(room.names("o"), numbered(&[1, 5]));
    assert_eq!(done.err.lines().count(), 3, "{}", done.err);
    for number in [2, 3, 4] {
        let place = format!("s.{number:04}.exr (frame {number}): ");
        assert_eq!(done.errors().iter().filter(|line| line.contains(&place)).count(), 1, "{}", done.err);
    }
    let report: serde_json::Value = serde_json::from_slice(&bytes(&room.path("r.json"))).unwrap();
    let states: Vec<_> = (0..5).map(|at| report["frames"][at]["state"].as_str().unwrap()).collect();
    assert_eq!(states, ["done", "failed", "failed", "failed", "done"]);
    assert!(report["frames"][2]["message"].as_str().unwrap().contains("does not exist"));
    let skipped =
        room.run(&["fill", "s.#.exr", "-o", "o/s.#.exr", "--frames", "1,3", "--missing-frame", "skip"]);
    assert_eq!(skipped.status, 0, "{}", skipped.err);
}

#[test]
fn what_has_no_estimate_passes_no_gate_and_has_no_error_channel() {
    let room = Room::with(&["in.exr"]);
    for words in [["--filter", "dct"], ["--filter", "cs-wavelet"], ["--time-limit", "0.000001"]] {
        let fill = |more: &[&str]| {
            room.run(&[&["fill", "in.exr", "-o", "out.exr", "--force"], &words[..], more].concat())
        };
        let done = fill(&["--min-psnr", "1"]);
        assert!(done.status == 1 && done.errors()[0].contains("R, G, B cannot be told: "), "{}", done.err);
        let done = fill(&["--error-channel"]);
        let said = done.err.lines().filter(|line| line.contains("no estimated errors: "));
        assert!(done.status == 0 && said.count() == 1, "{}", done.err);
    }
}

#[test]
fn estimates_name_their_part() {
    let room = Room::new();
    let window = Window { x_min: 0, y_min: 0, x_max: 39, y_max: 29 };
    let named = ["left", "right"].map(|name| {
        let mut part = part(window);
        part.attributes.set_text("name", name);
        part
    });
    let mut frame = Frame { parts: named.into() };
    room.add("in.exr", &frame);
    let done = room.run(&["fill", "in.exr", "-o", "out.exr", "--min-psnr", "300", "--json", "r.json"]);
    for name in ["left", "right"] {
        let doubt = format!("{name}: the error of R, G, B cannot be told");
        assert!(done.errors()[0].contains(&doubt), "{}", done.err);
        assert!(done.err.lines().any(|line| line.contains("chosen") && line.contains(&format!("{name}: R"))));
    }
    let report: serde_json::Value = serde_json::from_slice(&bytes(&room.path("r.json"))).unwrap();
    let told = report["frames"][0]["estimates"].as_array().unwrap();
    let parts: Vec<_> = told.iter().map(|estimate| estimate["part"].as_str().unwrap()).collect();
    assert!(parts.contains(&"left") && parts.contains(&"right"), "{parts:?}");
    // One part alone is filled: programs look it up all the same.
    frame.parts[1].attributes.set_text("lacuna/dense", "R,G,B,Z");
    room.add("in.exr", &frame);
    room.ok(&["fill", "in.exr", "-o", "out.exr", "--force", "--json", "r.json"]);
    let report: serde_json::Value = serde_json::from_slice(&bytes(&room.path("r.json"))).unwrap();
    assert_eq!(report["frames"][0]["estimates"][0]["part"], "left");
}

#[test]
fn the_report_says_what_was_done() {
    let room = Room::with(SHOT);
    room.ok(&["fill", "s.#.exr", "-o", "o/", "--create-dir", "--filter", "tv", "--json", "r.json"]);
    let report: serde_json::Value = serde_json::from_slice(&bytes(&room.path("r.json"))).unwrap();
    assert_eq!(report["filter"], "tv");
    assert!(report["settings"].as_str().unwrap().contains("epsilon=0"));
    assert_eq!(report["frames"].as_array().unwrap().len(), 3);
    for frame in report["frames"].as_array().unwrap() {
        assert_eq!(frame["state"], "done");
        assert_eq!(frame["density"], 0.2);
        assert_eq!(frame["mask"], "mask");
        assert_eq!(frame["non_finite"], 0);
        assert!(frame["iterations"].as_u64().is_some() && frame["gap"].as_f64().is_some(), "{frame}");
        for stage in ["read", "solve", "write"] {
            assert!(frame["seconds"][stage].as_f64().unwrap() > 0.0, "{frame}");
        }
    }
}

#[test]
fn update_does_only_what_is_stale() {
    let room = Room::with(SHOT);
    let base = ["fill", "s.#.exr", "-o", "o/", "--create-dir", "--filter", "pushpull", "-u"];
    let run = |more: &[&str]| {
        for number in [1, 2, 3] {
            let output = room.path(&format!("o/s.{number:04}.exr"));
            if output.exists() {
                age(&output, 100);
            }
        }
        room.ok(&[&base[..], more].concat());
        let fresh = |number: &i64| {
            let output = room.path(&format!("o/s.{number:04}.exr"));
            output.metadata().unwrap().modified().unwrap().elapsed().unwrap().as_secs() < 50
        };
        [1, 2, 3].into_iter().filter(fresh).collect::<Vec<_>>()
    };
    for name in SHOT {
        age(&room.path(name), 1000);
    }
    assert_eq!(run(&[]), [1, 2, 3]);
    assert_eq!(run(&[]), [0; 0]);
    // A newer time is no other content.
    age(&room.path("s.0002.exr"), 10);
    assert_eq!(run(&[]), [0; 0]);
    age(&room.path("s.0002.exr"), 1000);
    assert_eq!(run(&["--filter", "nearest"]), [1, 2, 3]);
    assert_eq!(run(&[]), [1, 2, 3]);
    assert_eq!(run(&["--limit", "off"]), [1, 2, 3]);
    assert_eq!(run(&["--limit", "off"]), [0; 0]);
    assert_eq!(run(&["--channels", "R=nearest"]), [1, 2, 3]);
    // What is no whole file is not up to date, whatever its header says.
    let output = room.path("o/s.0003.exr");
    let whole = bytes(&output);
    std::fs::write(&output, &whole[..whole.len() - 10]).unwrap();
    assert_eq!(run(&["--channels", "R=nearest"]), [3]);
    // An older render of other windows was put in the place of the input.
    let before = room.read("s.0002.exr");
    let mut moved = before.clone();
    moved.parts[0].display_window.x_max += 1;
    room.add("s.0002.exr", &moved);
    age(&room.path("s.0002.exr"), 1000);
    assert_eq!(run(&["--channels", "R=nearest"]), [2]);
    assert_eq!(run(&["--channels", "R=nearest"]), [0; 0]);
    moved.parts[0].data_window.y_min += 5;
    moved.parts[0].data_window.y_max += 5;
    room.add("s.0002.exr", &moved);
    age(&room.path("s.0002.exr"), 1000);
    assert_eq!(run(&["--channels", "R=nearest"]), [2]);
    room.add("s.0002.exr", &before);
    age(&room.path("s.0002.exr"), 1000);
    assert_eq!(run(&["--channels", "R=nearest"]), [2]);
    // The mask's file counts as an input, by its content, whatever its name.
    std::fs::copy(room.path("s.0001.exr"), room.path("m1.exr")).unwrap();
    std::fs::copy(room.path("s.0001.exr"), room.path("m2.exr")).unwrap();
    age(&room.path("m1.exr"), 1000);
    age(&room.path("m2.exr"), 1000);
    assert_eq!(run(&["--mask", "m1.exr"]), [1, 2, 3]);
    assert_eq!(run(&["--mask", "m1.exr"]), [0; 0]);
    assert_eq!(run(&["--mask", "m2.exr"]), [0; 0]);
    age(&room.path("m2.exr"), 10);
    assert_eq!(run(&["--mask", "m2.exr"]), [0; 0]);
    std::fs::write(room.path("m2.exr"), [bytes(&room.path("m2.exr")), vec![0]].concat()).unwrap();
    age(&room.path("m2.exr"), 1000);
    assert_eq!(run(&["--mask", "m2.exr"]), [1, 2, 3]);
}

#[test]
fn no_clobber_leaves_what_is_there() {
    let room = Room::with(SHOT);
    room.folder("o");
    std::fs::write(room.path("o/s.0002.exr"), "mine").unwrap();
    let done = room.ok(&["fill", "s.#.exr", "-o", "o/", "--no-clobber", "--filter", "nearest"]);
    assert_eq!(bytes(&room.path("o/s.0002.exr")), b"mine");
    assert_eq!(room.names("o"), numbered(&[1, 2, 3]));
    assert!(done.err.contains("1 skipped"), "{}", done.err);
}

#[test]
fn a_dry_run_prints_the_plan_and_changes_nothing() {
    let room = Room::with(SHOT);
    let done = room.ok(&["fill", "s.#.exr", "-o", "new/o.##.exr", "--create-dir", "-n", "--json", "r.json"]);
    let expected = "make folder  new\n\
                    fill  s.0001.exr (frame 1) -> new/o.01.exr\n\
                    fill  s.0002.exr (frame 2) -> new/o.02.exr\n\
                    fill  s.0003.exr (frame 3) -> new/o.03.exr\n";
    assert_eq!((done.out.as_str(), done.err.as_str()), (expected, ""));
    assert_eq!(room.names("."), SHOT);
}

#[test]
fn nothing_is_overwritten_in_place() {
    let room = Room::with(SHOT);
    std::fs::hard_link(room.path("s.0001.exr"), room.path("hard.exr")).unwrap();
    let before = bytes(&room.path("s.0001.exr"));
    for output in ["s.0001.exr", "./s.0001.exr", "hard.exr", "."] {
        let done = room.run(&["fill", "s.0001.exr", "-o", output]);
        assert_eq!(done.status, 2, "{output}: {}", done.err);
        assert!(done.err.contains("in place"), "{}", done.err);
    }
    assert_eq!(room.run(&["fill", "s.#.exr", "-o", "s.#.exr"]).status, 2);
    assert_eq!(room.run(&["fill", "s.0001.exr", "-o", "o.exr", "--json", "s.0001.exr"]).status, 2);
    assert_eq!(bytes(&room.path("s.0001.exr")), before);
    assert!(!room.path("o.exr").exists());
}

#[test]
fn usage_errors_are_one_line_and_status_2() {
    let room = Room::with(SHOT);
    for words in [
        &["fill", "s.#.exr", "-o", "o.exr"][..],
        &["fill", "s.0001.exr", "-o", "no/o.exr"],
        &["fill", "s.0001.exr", "-o", "o.####.exr", "--frames", "1-2"],
        &["fill", "s.0001.exr", "s.0002.exr", "-o", "o.exr"],
        &["fill", ".", "-o", "o/"],
        &["fill", "s.%4d.exr", "-o", "o.%4d.exr"],
        &["fill", "s.0001.exr", "-o", "o.exr", "--filter", "ss", "--tv-norm", "isotropic"],
        &["fill", "s.0001.exr", "-o", "o.exr", "--compression", "dwaa:45"],
        &["fill", "s.0001.exr", "-o", "o.exr", "--what"],
    ] {
        let done = room.run(words);
        assert_eq!(done.status, 2, "{words:?}: {}", done.err);
        assert_eq!(done.errors().len(), 1, "{words:?}: {}", done.err);
        assert!(done.err.starts_with("lacuna: error: ") && done.err.contains("--help"), "{}", done.err);
    }
    assert_eq!(room.names("."), SHOT);
}

#[test]
fn what_is_not_there_is_status_1() {
    let room = Room::with(SHOT);
    for (words, place) in [
        (&["fill", "t.exr", "-o", "o.exr", "-q"][..], "t.exr"),
        (&["fill", "t.#.exr", "-o", "o.#.exr", "-q"], "t.#.exr"),
        (&["fill", "t*.exr", "-o", "o.#.exr", "-q"], "t*.exr"),
        (&["fill", "s.0001.exr", "-o", "o.exr", "--mask", "m.png", "-q"], "m.png"),
        (&["fill", "s.0001.exr", "-o", "o.exr", "--mask", "channel:m", "-q"], "mask"),
        (&["fill", "--files-from", "none", "-o", "o.#.exr", "-q"], "none"),
        (&["fill", "s.0001.exr", "-o", "s.0002.exr/o.exr", "-q"], "s.0002.exr"),
        (&["info", "t.exr"], "t.exr"),
    ] {
        let done = room.run(words);
        assert_eq!(done.status, 1, "{words:?}: {}", done.err);
        assert_eq!(done.err.lines().count(), 1, "{words:?}: {}", done.err);
        assert!(done.errors()[0].contains(place), "{words:?}: {}", done.err);
    }
}

#[test]
fn unusual_names_are_names() {
    let names = [
        "with space.exr",
        "größe 填充.exr",
        "100%.exr",
        "a'b;c&d.exr",
        "odd[1]*.exr",
        "at@2x.exr",
        "é.####.exr",
    ];
    let room = Room::with(&names);
    for name in names {
        room.folder("o");
        room.ok(&["fill", name, "-o", "o", "--filter", "nearest"]);
        assert_eq!(room.names("o"), [name]);
        std::fs::remove_dir_all(room.path("o")).unwrap();
    }
    room.add("-dash.exr", &sparse(4, 4));
    room.ok(&["fill", "-o", "o.exr", "--", "-dash.exr"]);
}

#[test]
fn small_frames_and_negative_windows() {
    let room = Room::new();
    room.add("1.exr", &sparse(1, 1));
    room.add("2.exr", &sparse(7, 1));
    room.add("3.exr", &sparse(1, 7));
    let window = Window { x_min: -13, y_min: -7, x_max: 5, y_max: 9 };
    let mut overscan = part(window);
    overscan.display_window = Window { x_min: 0, y_min: 0, x_max: 3, y_max: 3 };
    room.add("4.exr", &Frame { parts: vec![overscan] });
    for filter in ["ss", "tv", "pushpull", "nearest", "linear", "cubic"] {
        room.ok(&["fill", "[0-9].exr", "-o", "o/", "--create-dir", "--filter", filter]);
        room.ok(&["verify", "[0-9].exr", "o/"]);
    }
    assert_eq!(room.read("o/4.exr").parts[0].data_window, window);
}

#[test]
fn sparsify_and_verify_go_frame_by_frame() {
    let room = Room::new();
    let mut full = sparse(40, 30);
    full.parts[0].channels.retain(|channel| channel.name != b"mask");
    for name in ["f.1.exr", "f.2.exr"] {
        room.add(name, &full);
    }
    let done = room.ok(&["sparsify", "f.%d.exr", "-o", "s.%d.exr", "--density", "0.3", "--seed", "5"]);
    assert!(done.err.contains("2 of 2 frames made sparse"), "{}", done.err);
    room.ok(&["fill", "s.%d.exr", "-o", "o.%d.exr"]);
    room.ok(&["verify", "s.%d.exr", "o.%d.exr"]);
    let swapped = room.run(&["verify", "o.1.exr", "s.1.exr", "-q"]);
    assert!(swapped.status == 1 && swapped.err.contains("are the two swapped?"), "{}", swapped.err);
    for read in ["s.1.exr", "o.2.exr"] {
        assert_eq!(room.run(&["verify", "s.%d.exr", "o.%d.exr", "--json", read]).status, 2);
    }
    // Frame 2 is held against another frame.
    std::fs::copy(room.path("f.1.exr"), room.path("o.2.exr")).unwrap();
    let done = room.run(&["verify", "s.%d.exr", "o.%d.exr", "-q"]);
    assert_eq!((done.status, done.errors().len()), (1, 1), "{}", done.err);
    assert!(done.errors()[0].contains("o.2.exr (frame 2)") && !done.err.contains("swapped"), "{}", done.err);
}
