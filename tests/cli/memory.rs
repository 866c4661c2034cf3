//! `--memory` bounds what a process really takes.

use std::time::Duration;

use crate::room::{Room, part_from, part_of};
use half::f16;
use lacuna_exr::{Channel, Frame, Part, Samples, Window};

/// What a process takes besides frames: program, threads, allocator.
const BASE: u64 = 32 << 20;

/// The most memory that a run of lacuna had, in bytes, looked up until it ended.
fn peak(room: &Room, words: &[&str]) -> u64 {
    let mut process = room.command(words).spawn().unwrap();
    let status = format!("/proc/{}/status", process.id());
    let mut peak = 0;
    while process.try_wait().unwrap().is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kilobytes = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
        peak = kilobytes.map_or(peak, |kilobytes| kilobytes << 10);
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(process.wait().unwrap().success());
    peak
}

#[test]
fn frames_in_flight_stay_within_the_bound() {
    let names = ["s.1.exr", "s.2.exr", "s.3.exr", "s.4.exr", "s.5.exr"];
    let room = Room::new();
    let window = Window { x_min: 0, y_min: 0, x_max: 511, y_max: 511 };
    for (first, name) in names.into_iter().enumerate() {
        // Each with another mask, so that each has plans of its own.
        room.add(name, &Frame { parts: vec![part_from(window, first)] });
    }
    let bound = 100 << 20;
    for filter in [&["ss"][..], &["tv", "--tv-iterations", "16"], &["pushpull"]] {
        let base =
            ["fill", "s.%d.exr", "-o", "o/", "--create-dir", "--parallel-frames", "5", "-q", "--filter"];
        let held = peak(&room, &[&base[..], filter, &["--memory", "100M"]].concat());
        println!("{filter:?}: {} MiB", held >> 20);
        assert!(held <= bound + BASE, "{filter:?}: {} MiB", held >> 20);
    }
}

/// What a run with that filter is said to need, in bytes: by the header, and if that is granted by the mask.
fn estimate(room: &Room, words: &[&str]) -> u64 {
    let mut bound = 1;
    for _ in 0..2 {
        let memory = format!("{bound}M");
        let done = room.run(&[words, &["--memory", &memory]].concat());
        let Some((_, needed)) = done.err.split_once("needs ") else { break };
        let needed: f64 = needed.trim_start_matches("about ").split(' ').next().unwrap().parse().unwrap();
        // A volume of 2 MiB comes besides.
        bound = needed.ceil() as u64 + 3;
    }
    bound << 20
}

#[test]
fn frames_need_what_they_are_said_to_need_with_any_mask() {
    let window = Window { x_min: 0, y_min: 0, x_max: 999, y_max: 799 };
    // A lattice: where samples lie unevenly, what the estimate may take besides is counted, taken or not.
    let everywhere = |at: usize| (at % 1000 + 2 * (at / 1000)).is_multiple_of(5);
    let with_holes = |at: usize| everywhere(at) && (at / 24).is_multiple_of(8);
    let masks: [(&str, &dyn Fn(usize) -> bool); 2] = [("even.exr", &everywhere), ("holes.exr", &with_holes)];
    let room = Room::new();
    for (name, measured) in masks {
        let mut part = part_of(window, measured);
        part.channels.retain(|channel| channel.name != b"Z");
        room.add(name, &Frame { parts: vec![part] });
    }
    let mut said = Vec::new();
    for (name, _) in masks {
        let words = ["fill", name, "-o", "out.exr", "--force", "-q", "--filter", "ss"];
        let needed = estimate(&room, &words);
        let held = peak(&room, &[&words[..], &["--memory", &format!("{}M", needed >> 20)]].concat());
        println!("{name}: {} MiB, said {}", held >> 20, needed >> 20);
        assert!(held <= needed + BASE, "{name}: {} MiB, said {}", held >> 20, needed >> 20);
        let most = if name == "even.exr" { 13 } else { 20 };
        assert!(needed * 10 <= held * most, "{name}: {} MiB, said {}", held >> 20, needed >> 20);
        said.push(needed);
    }
    assert!(said[1] > said[0], "{said:?}");
}

#[test]
fn frames_have_what_their_volume_leaves() {
    let room = Room::new();
    // More than is needed before the mask is known, with the voxels as they are read; less than is needed then.
    let needed = |edge: usize| -> f64 {
        let header = format!(
            "NRRD0004\ntype: float\nendian: little\ndimension: 3\nsizes: {edge} {edge} {edge}\nencoding: raw\n\n"
        );
        let values = (0..edge.pow(3)).flat_map(|at| ((at % edge) as f32).to_le_bytes());
        let bytes: Vec<u8> = header.into_bytes().into_iter().chain(values).collect();
        std::fs::write(room.path("v.nrrd"), bytes).unwrap();
        let words = ["render", "v.nrrd", "-o", "out.exr", "-q", "--size", "400x300", "--density", "0.05"];
        let done = room.run(&[&words[..], &["--fill", "ss", "--memory", "34M"]].concat());
        let told = done.err.split_once("needs about ").unwrap_or_else(|| panic!("{}", done.err)).1;
        told.split(' ').next().unwrap().parse().unwrap()
    };
    // Voxels with a border of three, and a byte for each block of eight.
    let kept = (103_f64.powi(3) * 4.0 + 50_f64.powi(3)) / f64::from(1 << 20);
    let more = needed(100) - needed(4);
    assert!((more - kept).abs() < 1.1, "{more} MiB, {kept} are kept");
}

/// A number from 0 to 1 that looks like chance.
fn random(seed: u64, at: usize) -> f64 {
    let mixed = (at as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(seed << 32);
    let mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((mixed ^ (mixed >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A frame of random pixels, with noise where they stand close together, as if errors had chosen them: so the estimate repeats the rounds.
fn chosen(window: Window, density: f64, guides: bool) -> Part {
    let size = window.size();
    let measured = |at: usize| random(1, at) < density;
    let shaded = |at: usize, scale: f64| 0.5 + 0.3 * (at % size.width) as f64 * scale / 1000.0;
    let value = |at: usize, scale: f64| {
        let around = (0..5).flat_map(|row| (0..5).map(move |column| row * size.width + column));
        let close = around.filter(|step| measured((at + step).saturating_sub(2 * size.width + 2))).count();
        let noise = 0.2 * (close as f64 / (25.0 * density)).powi(4) * (random(2, at) - 0.5);
        f16::from_f64(if measured(at) { shaded(at, scale) + noise } else { 0.0 })
    };
    let halves = |of: &dyn Fn(usize) -> f16| Samples::Half((0..size.pixels()).map(of).collect());
    let mut part = part_of(window, measured);
    part.channels.retain(|channel| channel.name != b"Z");
    for (channel, scale) in part.channels.iter_mut().zip([0.3, 0.6, 1.0]) {
        channel.samples = halves(&|at| value(at, scale));
    }
    let guides = ["albedo.B", "albedo.G", "albedo.R"].into_iter().filter(|_| guides);
    let guide = |name: &str| Channel {
        name: name.into(),
        perceptually_linear: false,
        samples: halves(&|at| f16::from_f64(shaded(at, 2.0))),
    };
    part.channels.splice(3..3, guides.map(guide));
    part
}

#[test]
fn random_pixels_and_guides_need_what_they_are_said_to_need() {
    let window = Window { x_min: 0, y_min: 0, x_max: 1199, y_max: 1199 };
    let room = Room::new();
    for (name, density, guides) in
        [("tenth.exr", 0.1, false), ("more.exr", 0.4, false), ("guided.exr", 0.1, true)]
    {
        room.add(name, &Frame { parts: vec![chosen(window, density, guides)] });
        let words = ["fill", name, "-o", "out.exr", "--force", "-q", "--filter", "ss"];
        let needed = estimate(&room, &words);
        let held = peak(&room, &[&words[..], &["--memory", &format!("{}M", needed >> 20)]].concat());
        println!("{name}: {} MiB, said {}", held >> 20, needed >> 20);
        assert!(held <= needed + BASE, "{name}: {} MiB, said {}", held >> 20, needed >> 20);
        assert!(needed * 10 <= held * 13, "{name}: {} MiB, said {}", held >> 20, needed >> 20);
    }
}

#[test]
fn choosing_pixels_and_filling_a_render_need_what_they_are_said_to_need() {
    let window = Window { x_min: 0, y_min: 0, x_max: 999, y_max: 799 };
    let room = Room::new();
    let mut part = part_of(window, |_| true);
    part.channels.retain(|channel| !matches!(&channel.name[..], b"Z" | b"mask"));
    room.add("full.exr", &Frame { parts: vec![part] });
    room.run(&["sparsify", "full.exr", "-o", "sparse.exr", "--density", "0.15", "-q"]);
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/scenes/marschner-lobb.toml");
    let adaptive = ["--density", "0.1", "--adaptive", "--force", "-q"];
    let render = ["render", scene, "--size", "1000x800", "--set", "march.step=4", "-o", "out.exr"];
    let all: [Vec<&str>; 3] = [
        [&["sparsify", "full.exr", "-o", "chosen.exr"], &adaptive[..]].concat(),
        vec!["mask", "--after", "sparse.exr", "-o", "next.exr", "--add", "0.05", "-q"],
        [&render[..], &adaptive, &["--fill", "ss"]].concat(),
    ];
    for words in all {
        let needed = estimate(&room, &words);
        let held = peak(&room, &[&words[..], &["--memory", &format!("{}M", needed >> 20)]].concat());
        println!("{words:?}: {} MiB, said {}", held >> 20, needed >> 20);
        assert!(held <= needed + BASE, "{words:?}: {} MiB, said {}", held >> 20, needed >> 20);
    }
}
