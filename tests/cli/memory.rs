//! `--memory` bounds what a process really takes.

use std::time::Duration;

use crate::room::{Room, part_from};
use lacuna_exr::{Frame, Window};

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
