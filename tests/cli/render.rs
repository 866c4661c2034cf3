//! `lacuna render` through the binary: sparse pictures, resuming, filling, refusals.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, SystemTime};

use lacuna_exr::{Frame, Limits, read};

fn lacuna(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lacuna")).current_dir(folder).args(arguments).output().unwrap()
}

fn done(folder: &Path, arguments: &[&str]) -> String {
    let output = lacuna(folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{arguments:?}: {said}");
    said
}

fn frame(path: &Path) -> Frame {
    read(path, &Limits::default()).unwrap()
}

fn channel(frame: &Frame, name: &str) -> Vec<f32> {
    let channel = frame.parts[0].channels.iter().find(|channel| channel.name == name.as_bytes()).unwrap();
    channel.samples.as_f32()
}

const HEAD: &str = "procedural:head:24";

#[test]
fn a_sparse_picture_has_the_bits_of_the_full_one() {
    let room = tempfile::tempdir().unwrap();
    let size = ["--size", "50x40", "-q"];
    done(room.path(), &[&["render", HEAD, "-o", "full.exr", "--threads", "1"][..], &size].concat());
    let more = ["--density", "0.3", "--seed", "7", "--depth", "--normals", "--count", "--gradients"];
    done(room.path(), &[&["render", HEAD, "-o", "some.exr", "--threads", "3"][..], &size, &more].concat());
    let (full, some) = (frame(&room.path().join("full.exr")), frame(&room.path().join("some.exr")));
    let mask = channel(&some, "mask");
    let measured = mask.iter().filter(|flag| **flag == 1.0).count();
    assert!((550..650).contains(&measured), "{measured}");
    for name in ["R", "G", "B", "A"] {
        let (full, some) = (channel(&full, name), channel(&some, name));
        for (at, flag) in mask.iter().enumerate() {
            let expected = if *flag == 1.0 { full[at].to_bits() } else { 0 };
            assert_eq!(some[at].to_bits(), expected, "{name} {at}");
        }
    }
    assert!(channel(&some, "samples").iter().zip(&mask).all(|(count, flag)| count == flag));
    assert!(channel(&some, "dx.R").iter().any(|slope| *slope != 0.0));
    let normals = ["N.X", "N.Y", "N.Z"].map(|name| channel(&some, name));
    let lengths = (0..mask.len()).map(|at| normals.iter().map(|part| part[at] * part[at]).sum::<f32>());
    assert!(lengths.into_iter().all(|square| square == 0.0 || (square - 1.0).abs() < 1e-5));
    let attributes = &some.parts[0].attributes;
    assert_eq!(attributes.text("lacuna/seed").as_deref(), Some("7"));
    assert_eq!(attributes.get("worldToCamera").unwrap().value.len(), 64);
    assert_eq!(attributes.get("worldToNDC").unwrap().kind, b"m44f");
    assert_eq!(attributes.text("lacuna/mask").as_deref(), Some("mask"));

    // The sparse picture as the mask of another: the same pixels.
    done(room.path(), &[&["render", HEAD, "-o", "same.exr", "--mask", "some.exr"][..], &size].concat());
    assert_eq!(channel(&frame(&room.path().join("same.exr")), "R"), channel(&some, "R"));
}

#[test]
fn rendering_and_filling_in_one_go_is_rendering_then_filling() {
    let room = tempfile::tempdir().unwrap();
    let common = ["--size", "64x64", "--density", "0.4"];
    let said = done(
        room.path(),
        &[&["render", HEAD, "-o", "one.exr", "--fill", "auto", "--json", "r.json"][..], &common].concat(),
    );
    assert!(said.contains("rendered in") && said.contains("filled in"), "{said}");
    done(room.path(), &[&["render", HEAD, "-o", "sparse.exr", "-q"][..], &common].concat());
    done(room.path(), &["fill", "sparse.exr", "-o", "two.exr", "-q"]);
    let (one, two) = (frame(&room.path().join("one.exr")), frame(&room.path().join("two.exr")));
    for name in ["R", "A", "mask"] {
        assert_eq!(channel(&one, name), channel(&two, name), "{name}");
    }
    let report = std::fs::read_to_string(room.path().join("r.json")).unwrap();
    assert!(report.contains("\"rendered\"") && report.contains("\"filled\""));
}

#[test]
fn dense_aovs_are_complete_and_guide_the_filling() {
    let room = tempfile::tempdir().unwrap();
    let sparse = ["render", HEAD, "--size", "60x50", "--density", "0.2", "-q"];
    done(room.path(), &[&sparse[..], &["-o", "some.exr"]].concat());
    done(room.path(), &[&sparse[..], &["--dense-aovs", "-o", "dense.exr"]].concat());
    done(room.path(), &[&sparse[..], &["--dense-aovs", "--fill", "auto", "-o", "filled.exr"]].concat());
    done(room.path(), &["fill", "dense.exr", "-o", "later.exr", "-q"]);
    let [some, dense, filled, later] =
        ["some.exr", "dense.exr", "filled.exr", "later.exr"].map(|name| frame(&room.path().join(name)));
    let names = [
        "dense.albedo.R",
        "dense.albedo.G",
        "dense.albedo.B",
        "dense.A",
        "dense.N.X",
        "dense.N.Y",
        "dense.N.Z",
        "dense.Z",
    ];
    assert_eq!(dense.parts[0].attributes.text("lacuna/dense"), Some(names.join(",")));
    for name in ["R", "G", "B", "A", "mask"] {
        assert_eq!(channel(&some, name), channel(&dense, name), "{name}");
    }
    let (alpha, mask) = (channel(&dense, "dense.A"), channel(&dense, "mask"));
    let seen = alpha.iter().filter(|alpha| **alpha > 0.5).count();
    let missing = alpha.iter().zip(&mask).filter(|(alpha, mask)| **alpha > 0.5 && **mask == 0.0).count();
    assert!(seen > 100 && 4 * missing > 3 * seen, "{missing} of {seen}");
    for (at, depth) in channel(&dense, "dense.Z").iter().enumerate() {
        assert_eq!(depth.is_finite(), alpha[at] > 0.0, "{at}");
    }
    for name in names {
        assert_eq!(channel(&filled, name), channel(&dense, name), "{name}");
    }
    for name in ["R", "G", "B", "A"] {
        assert_eq!(channel(&filled, name), channel(&later, name), "{name}");
    }
    let guides = filled.parts[0].attributes.text("lacuna/guides").unwrap_or_default();
    assert!(guides.contains("dense.A"), "{guides}");
}

#[test]
fn frames_in_a_folder_are_called_after_the_scene() {
    let room = tempfile::tempdir().unwrap();
    std::fs::write(room.path().join("far.v2.toml"), format!("volume = \"{HEAD}\"\n")).unwrap();
    let small = ["--size", "8x6", "-q", "--create-dir"];
    done(room.path(), &[&["render", "far.v2.toml", "-o", "new/"][..], &small].concat());
    done(room.path(), &[&["render", HEAD, "-o", "new"][..], &small].concat());
    let frames = ["--frames", "-1,7,12345"];
    done(room.path(), &[&["render", "far.v2.toml", "-o", "new"][..], &frames, &small].concat());
    let entries = std::fs::read_dir(room.path().join("new")).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    let numbered = ["far.v2.-001.exr", "far.v2.0007.exr", "far.v2.12345.exr"];
    assert_eq!(names, [&numbered[..], &["far.v2.exr", "head.exr"]].concat());
}

#[test]
fn a_sequence_orbits_and_resumes() {
    let room = tempfile::tempdir().unwrap();
    let scene = "volume = \"procedural:vessels:16\"\n[camera]\norbit = 40.0\n[image]\nsize = [20, 20]\n";
    std::fs::write(room.path().join("s.toml"), scene).unwrap();
    let sequence = ["render", "s.toml", "-o", "o.###.exr", "--frames", "1-3", "-u"];
    done(room.path(), &sequence);
    let first = frame(&room.path().join("o.001.exr"));
    assert_ne!(channel(&first, "A"), channel(&frame(&room.path().join("o.002.exr")), "A"));
    std::fs::remove_file(room.path().join("o.002.exr")).unwrap();
    let said = done(room.path(), &sequence);
    assert!(said.contains("2 skipped"), "{said}");
    // The flag's former name.
    let said = done(room.path(), &[&sequence[..6], &["--resume"]].concat());
    assert!(said.contains("3 skipped"), "{said}");
    // Another setting makes every frame anew.
    let said = done(room.path(), &[&sequence[..], &["--set", "camera.zoom=1.5"]].concat());
    assert!(said.contains("3 of 3 frames rendered"), "{said}");
    let left = std::fs::read_dir(room.path()).unwrap().count();
    assert_eq!(left, 4, "no temporary file stays");
}

#[test]
fn an_update_makes_anew_what_is_another_frame_or_another_kind_of_file() {
    let room = tempfile::tempdir().unwrap();
    let path = |name: &str| room.path().join(name);
    let base = ["render", HEAD, "--size", "20x16", "--set", "camera.orbit=30"];
    let to = |output: &str, more: &[&str]| done(room.path(), &[&base[..], &["-o", output], more].concat());
    let frames =
        |numbers: &str, more: &[&str]| to("a.####.exr", &[&["--frames", numbers, "-u"][..], more].concat());
    to("a.0003.exr", &[]);
    assert!(frames("3", &[]).contains("1 of 1 frame rendered"), "an unnumbered frame is frame 0");
    std::fs::rename(path("a.0003.exr"), path("a.0005.exr")).unwrap();
    assert!(frames("5", &[]).contains("1 of 1 frame rendered"));
    assert!(frames("5", &[]).contains("1 skipped"));
    assert!(frames("5", &["--compression", "rle"]).contains("1 of 1 frame rendered"));
    assert!(frames("5", &["--compression", "rle"]).contains("1 skipped"));

    let fill = ["--density", "0.5", "--fill", "nearest", "-u"];
    to("f.exr", &[&fill[..], &["--no-estimate"]].concat());
    assert!(to("f.exr", &[&fill[..], &["--no-estimate"]].concat()).contains("1 skipped"));
    assert!(to("f.exr", &fill).contains("1 of 1 frame rendered"), "an estimate is wanted now");
}

#[test]
fn what_was_made_of_a_render_is_no_render() {
    let room = tempfile::tempdir().unwrap();
    let path = |name: &str| room.path().join(name);
    let base = ["render", HEAD, "--size", "40x30"];
    let sparse = [&base[..], &["--density", "0.2", "--adaptive"]].concat();
    done(room.path(), &[&base[..], &["-o", "full.exr"]].concat());
    done(room.path(), &[&sparse[..], &["-o", "some.exr"]].concat());
    let said = done(room.path(), &["sparsify", "full.exr", "-o", "tenth.exr", "--density", "0.1"]);
    assert!(!said.contains("dropped"), "{said}");
    let said = done(room.path(), &["fill", "some.exr", "-o", "filled.exr"]);
    assert!(!said.contains("dropped"), "{said}");
    done(room.path(), &["verify", "some.exr", "filled.exr"]);
    done(room.path(), &["mask", "--after", "some.exr", "--add", "0.05", "-o", "next.exr"]);
    done(room.path(), &[&base[..], &["--mask", "next.exr", "-o", "more.exr"]].concat());
    done(room.path(), &["mask", "--merge", "some.exr", "more.exr", "-o", "merged.exr"]);
    for (made, words) in [("tenth.exr", &base[..]), ("filled.exr", &sparse), ("merged.exr", &sparse)] {
        std::fs::rename(path(made), path("again.exr")).unwrap();
        let said = done(room.path(), &[words, &["-o", "again.exr", "-u"]].concat());
        assert!(said.contains("1 of 1 frame rendered"), "{made}: {said}");
        let said = done(room.path(), &[words, &["-o", "again.exr", "-u"]].concat());
        assert!(said.contains("1 skipped"), "{said}");
    }
    let fill = [&sparse[..], &["-o", "one.exr", "--fill", "ss", "-u"]].concat();
    done(room.path(), &fill);
    assert!(done(room.path(), &fill).contains("1 skipped"));
    done(room.path(), &["verify", "some.exr", "one.exr"]);
}

#[test]
fn rounds_are_told_of_by_frame_and_to_their_end() {
    let room = tempfile::tempdir().unwrap();
    let rounds = ["--size", "40x30", "--density", "0.3", "--adaptive", "--progress", "plain"];
    let base = [&["render", HEAD, "-o", "a.#.exr", "--frames", "3"][..], &rounds].concat();
    let said = done(room.path(), &[&base[..], &["--target-error", "0.9", "--fill", "ss"]].concat());
    assert!(said.contains("Progress: 100%"), "{said}");
    for told in ["the target error of 0.9 is reached", "rendered in"] {
        let line = said.lines().find(|line| line.contains(told)).unwrap();
        assert!(line.contains("(frame 3): "), "{line}");
    }
    done(room.path(), &[&base[..], &["--fill", "ss", "--json", "r.json"]].concat());
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(room.path().join("r.json")).unwrap()).unwrap();
    let seconds = |value: &serde_json::Value| value.as_f64().unwrap();
    let frame = &report["frames"][0];
    let chosen: f64 = frame["rounds"].as_array().unwrap().iter().map(|round| seconds(&round["chosen"])).sum();
    let [rendered, filled] = ["rendered", "filled"].map(|name| seconds(&frame[name]));
    assert!(chosen > 0.0 && rendered + chosen + filled <= seconds(&frame["seconds"]["solve"]), "{frame}");

    let output = lacuna(room.path(), &[&base[..], &["--rounds", "1000000", "--volume", "no.nrrd"]].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.code() == Some(2) && said.contains("1 to 360, the pixels that are measured"),
        "{said}"
    );
}

/// A volume of that many bytes, its header apart.
fn detached_volume(folder: &Path, value: u8) {
    let header = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 8 8 8\nencoding: raw\ndata file: v.raw\n";
    std::fs::write(folder.join("v.nhdr"), header).unwrap();
    let voxels: Vec<u8> = (0..512).map(|at| if at % 8 > 2 { value } else { 0 }).collect();
    std::fs::write(folder.join("v.raw"), voxels).unwrap();
}

const MAP: &str = r#"[{"RGBPoints": [0, 0, 0, 0, 1, 1, 1, 1], "Points": [0, 0, 0.5, 0, 1, 1, 0.5, 0]}]"#;

/// A scene with a file for whatever may have one, and a mask.
fn scene_of_files(folder: &Path) {
    detached_volume(folder, 200);
    std::fs::write(folder.join("map.json"), MAP).unwrap();
    let scene = "volume = \"v.nhdr\"\n[transfer]\nparaview = \"map.json\"\n";
    std::fs::write(folder.join("s.toml"), scene).unwrap();
    done(folder, &["render", "s.toml", "-o", "mask.exr", "--size", "8x8", "--density", "0.5", "-q"]);
}

#[test]
fn no_file_of_the_scene_is_written() {
    let room = tempfile::tempdir().unwrap();
    let path = |name: &str| room.path().join(name);
    scene_of_files(room.path());
    for (name, what) in [
        ("s.toml", "input"),
        ("v.nhdr", "volume"),
        ("v.raw", "volume"),
        ("map.json", "colour map"),
        ("mask.exr", "mask"),
    ] {
        std::fs::hard_link(path(name), path("hard.exr")).unwrap();
        let before = std::fs::read(path(name)).unwrap();
        for more in [&["-o", "hard.exr"][..], &["-o", "o.exr", "--json", "hard.exr"]] {
            let words = [&["render", "s.toml", "--size", "8x8", "--mask", "mask.exr"][..], more].concat();
            let output = lacuna(room.path(), &words);
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(2), "{name}: {said}");
            // A report does not replace what is no report, whatever it is; input and mask are looked at first.
            let same = format!("hard.exr: the output is the same file as the {what}");
            let file = more.contains(&"--json") && !matches!(what, "input" | "mask");
            let wanted = if file { "--json hard.exr: there is a file" } else { &same };
            assert!(said.contains(wanted), "{name}: {said}");
        }
        assert!(std::fs::read(path(name)).unwrap() == before);
        std::fs::remove_file(path("hard.exr")).unwrap();
    }
}

/// Sets a file's time of last change to that many seconds ago.
fn age(path: &Path, seconds: u64) {
    let time = SystemTime::now() - Duration::from_secs(seconds);
    std::fs::File::options().write(true).open(path).unwrap().set_modified(time).unwrap();
}

#[test]
fn frames_are_made_anew_when_a_file_of_the_scene_changed() {
    let room = tempfile::tempdir().unwrap();
    let path = |name: &str| room.path().join(name);
    scene_of_files(room.path());
    let sources = ["v.nhdr", "v.raw", "map.json", "mask.exr"];
    for name in sources {
        age(&path(name), 200);
    }
    let words = ["render", "s.toml", "-o", "o.exr", "--size", "8x8", "--mask", "mask.exr", "-u"];
    done(room.path(), &words);
    for name in sources {
        assert!(done(room.path(), &words).contains("1 skipped"), "{name}");
        age(&path(name), 0);
        age(&path("o.exr"), 100);
        assert!(done(room.path(), &words).contains("1 skipped"), "{name}: a time is no content");
        // Something that says the same: a space, another value, another attribute.
        let mut bytes = std::fs::read(path(name)).unwrap();
        match name {
            "v.raw" => bytes[0] ^= 1,
            "mask.exr" => bytes.push(0),
            "v.nhdr" => bytes.extend(b"\n"),
            _ => bytes.push(b' '),
        }
        std::fs::write(path(name), bytes).unwrap();
        age(&path(name), 200);
        assert!(done(room.path(), &words).contains("1 of 1 frame"), "{name}");
    }
    // What the scene's own file says is in the settings, not what it was before.
    age(&path("o.exr"), 100);
    assert!(done(room.path(), &words).contains("1 skipped"));
    // A volume without a scene.
    let words = ["render", "v.nhdr", "-o", "w.exr", "--size", "8x8", "-u"];
    done(room.path(), &words);
    age(&path("w.exr"), 100);
    assert!(done(room.path(), &words).contains("1 skipped"));
    assert!(done(room.path(), &[&words[..], &["--compression", "zip:9"]].concat()).contains("1 of 1 frame"));
    done(room.path(), &words);
    detached_volume(room.path(), 90);
    assert!(done(room.path(), &words).contains("1 of 1 frame"));
}

#[cfg(unix)]
#[test]
fn an_output_that_cannot_be_written_is_seen_before_anything_is_rendered() {
    let room = tempfile::tempdir().unwrap();
    assert!(Command::new("mkfifo").arg(room.path().join("o.exr")).status().unwrap().success());
    for (more, file) in
        [(&["-o", "o.exr"][..], "o.exr"), (&["-o", "p.exr", "--mask", "missing.exr"], "missing.exr")]
    {
        for dry in [&["-n"][..], &[]] {
            // The volume is not there either, which rendering would find first.
            let output = lacuna(room.path(), &[&["render", "none.nrrd"][..], more, dry].concat());
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(1), "{more:?} {dry:?}: {said}");
            assert!(said.contains(&format!("error: {file}")) && !said.contains("none.nrrd:"), "{said}");
        }
    }
}

#[test]
fn an_output_that_appears_meanwhile_is_passed_over() {
    let room = tempfile::tempdir().unwrap();
    let words = ["render", HEAD, "-o", "o.exr", "--size", "100x100", "--step", "0.02", "--no-clobber"];
    let mut process = Command::new(env!("CARGO_BIN_EXE_lacuna"))
        .current_dir(room.path())
        .args(words)
        .args(["--threads", "1", "--progress", "plain"])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(process.stderr.take().unwrap());
    let mut line = String::new();
    while !line.contains("Progress:") {
        line.clear();
        assert_ne!(said.read_line(&mut line).unwrap(), 0, "it ended without a word");
    }
    std::fs::write(room.path().join("o.exr"), "mine").unwrap();
    let mut rest = String::new();
    said.read_to_string(&mut rest).unwrap();
    assert!(process.wait().unwrap().success() && rest.contains("1 skipped"), "{rest}");
    assert_eq!(std::fs::read(room.path().join("o.exr")).unwrap(), b"mine");
    assert_eq!(std::fs::read_dir(room.path()).unwrap().count(), 1);
}

#[test]
fn what_cannot_be_rendered_is_one_line() {
    let room = tempfile::tempdir().unwrap();
    std::fs::write(room.path().join("bad.toml"), "[march]\nstep = \"x\"\n").unwrap();
    std::fs::write(
        room.path().join("short.nrrd"),
        "NRRD0004\ntype: uchar\nsizes: 9 9 9\nencoding: raw\n\nabc",
    )
    .unwrap();
    std::fs::write(room.path().join("lost.toml"), "volume = \"none.nrrd\"\n").unwrap();
    for (arguments, status, part) in [
        (&["render", "none.nrrd", "-o", "o.exr"][..], 1, "none.nrrd"),
        (&["render", "lost.toml", "-o", "o.exr"], 1, "none.nrrd: there is no such file: --volume"),
        (&["render", "short.nrrd", "-o", "o.exr"], 1, "truncated"),
        (
            &["render", "short.nrrd", "-o", "o.exr", "--raw", "6x7x1:u8"],
            1,
            "short.nrrd: 52 bytes where 6x7x1 voxels have 42",
        ),
        (&["render", "bad.toml", "-o", "o.exr"], 1, "line 2"),
        (&["render", "procedural:cat", "-o", "o.exr"], 1, "marschner-lobb"),
        (&["render", HEAD, "-o", "o.exr", "--frames", "1-2"], 2, "pattern"),
        (&["render", HEAD, "-o", "o.####.exr"], 2, "--frames"),
        (&["render", HEAD, "-o", "o.exr", "--fill", "auto"], 2, "--density"),
        (&["render", HEAD, "-o", "o.exr", "--set", "march.stop=1"], 2, "unknown field"),
        (&["render", HEAD, "-o", "o.exr", "--set", "camera.angle=180"], 2, "below 180"),
        (&["render", "short.nrrd", "-o", "o.exr", "--set", "shading.ambient=-1"], 2, "ambient"),
        (&["render", "bad.toml", "-o", "o.exr", "--set", "camera.angle=30"], 1, "march.step"),
        (&["render", HEAD, "-o", "o.exr", "--density", "2"], 2, "above 0 and at most 1"),
    ] {
        let output = lacuna(room.path(), &[arguments, &["-q"]].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {said}");
        assert!(said.contains(part), "{arguments:?}: {said}");
        // A file is named once, whoever names it.
        assert!(said.matches(&format!("{}: ", arguments[1])).count() <= 1, "{arguments:?}: {said}");
        assert!(!room.path().join("o.exr").exists());
    }
}
