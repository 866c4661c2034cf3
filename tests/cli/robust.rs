//! Runs that are stopped, that run out of disk, memory or rights, and that must not depend on threads.

use std::process::Command;
use std::time::{Duration, Instant};

use crate::room::{Done, LACUNA, Room, at_work, bytes, send, sparse, status};

/// Work without an end in sight.
const ENDLESS: &[&str] = &["--filter", "tv", "--tv-gap", "1e-300", "--tv-iterations", "4000000000"];

#[test]
fn a_signal_ends_the_run_within_a_moment() {
    let room = Room::new();
    room.add("big.exr", &sparse(300, 300));
    room.folder("o");
    for (signal, number) in [("-INT", 2), ("-TERM", 15), ("-HUP", 1)] {
        if is_ignored("self", number) {
            println!(
                "left out {signal}: the tests were started with that signal ignored, which lacuna keeps so"
            );
            continue;
        }
        let expected = 128 + number;
        let words = [&["fill", "big.exr", "-o", "o/", "--json", "r.json"], ENDLESS].concat();
        let mut process = room.command(&words).spawn().unwrap();
        let _said = at_work(&mut process);
        assert!(process.try_wait().unwrap().is_none(), "ended before the signal");
        send(signal, process.id());
        let start = Instant::now();
        let ended = process.wait().unwrap();
        assert!(start.elapsed() < Duration::from_secs(5), "{:?}", start.elapsed());
        assert_eq!(status(ended), expected);
        assert_eq!(room.names("o"), [""; 0]);
        let report: serde_json::Value = serde_json::from_slice(&bytes(&room.path("r.json"))).unwrap();
        assert_eq!(report["frames"][0]["state"], "stopped");
    }
}

/// Whether a process ignores that signal: this one and so every child of it, if it was started so (`nohup` does that).
fn is_ignored(process: &str, signal: i32) -> bool {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).unwrap_or("0").trim();
    u64::from_str_radix(mask, 16).is_ok_and(|mask| mask >> (signal - 1) & 1 == 1)
}

#[test]
fn whenever_a_run_is_killed_no_partial_frame_has_the_final_name() {
    let names: Vec<String> = (1..=20).map(|number| format!("s.{number:04}.exr")).collect();
    let room = Room::with(&names.iter().map(String::as_str).collect::<Vec<_>>());
    let whole = {
        room.ok(&["fill", "s.0001.exr", "-o", "whole.exr", "--filter", "pushpull"]);
        bytes(&room.path("whole.exr"))
    };
    let mut cut_short = 0;
    for (round, signal) in ["-KILL", "-TERM", "-KILL", "-TERM", "-KILL", "-TERM"].into_iter().enumerate() {
        let out = format!("o{round}");
        room.folder(&out);
        let words = ["fill", "s.####.exr", "-o", &out, "--filter", "pushpull"];
        let mut process = room.command(&words).spawn().unwrap();
        while room.names(&out).len() < 2 * round && process.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        if process.try_wait().unwrap().is_none() {
            send(signal, process.id());
        }
        let ended = status(process.wait().unwrap());
        cut_short += usize::from(ended != 0);
        for name in room.names(&out).iter().filter(|name| !name.starts_with('.')) {
            assert_eq!(bytes(&room.path(&format!("{out}/{name}"))), whole, "{name}");
        }
        if ended == 143 {
            let hidden = |name: &&String| name.starts_with('.');
            assert_eq!(room.names(&out).iter().filter(hidden).count(), 0, "temporary files were left");
        }
    }
    assert!(cut_short > 0, "every run ended before its signal");
}

#[test]
fn a_full_disk_is_one_line_and_leaves_nothing() {
    let room = Room::new();
    room.add("big.exr", &sparse(400, 400));
    room.folder("o");
    let script =
        format!("ulimit -f 8; exec {LACUNA} fill big.exr -o o/ -q --filter nearest --compression none");
    let output = Command::new("sh").args(["-c", &script]).current_dir(room.path(".")).output().unwrap();
    let done = Done::from(output);
    assert_eq!(done.status, 1, "{}", done.err);
    assert_eq!(done.err.lines().count(), 1, "{}", done.err);
    assert!(done.errors()[0].contains("o/big.exr: cannot write"), "{}", done.err);
    assert_eq!(room.names("o"), [""; 0]);
}

#[test]
fn what_cannot_be_printed_or_installed_is_one_line_and_leaves_nothing() {
    let room = Room::with(&["in.exr"]);
    room.folder("o");
    for words in ["filters", "filters ss", "completions bash", "--help", "--version", "info in.exr"] {
        let script = format!("exec {LACUNA} {words} > /dev/full");
        let output = Command::new("sh").args(["-c", &script]).current_dir(room.path(".")).output().unwrap();
        let done = Done::from(output);
        assert!(done.status == 1 && done.err.lines().count() == 1, "{words}: {}", done.err);
        assert!(done.errors()[0].contains("cannot write to standard output"), "{words}: {}", done.err);
    }
    for words in ["manual o", "completions bash > o/bash"] {
        let script = format!("ulimit -f 1; exec {LACUNA} {words}");
        let output = Command::new("sh").args(["-c", &script]).current_dir(room.path(".")).output().unwrap();
        let done = Done::from(output);
        assert!(done.status == 1 && done.errors().len() == 1, "{words}: {} {}", done.status, done.err);
    }
    let pages = room.path("o/share/man/man1");
    assert!(std::fs::read_dir(pages).unwrap().all(|page| !page.unwrap().path().ends_with(".tmp")));
}

#[test]
fn a_folder_that_cannot_be_written_is_one_line() {
    use std::os::unix::fs::PermissionsExt;
    let room = Room::with(&["in.exr"]);
    room.folder("o");
    std::fs::set_permissions(room.path("o"), std::fs::Permissions::from_mode(0o555)).unwrap();
    // Root may write there all the same; then a folder in which nobody can make a file stands in.
    let root = std::fs::write(room.path("o/probe"), "").is_ok();
    let output = if root { "/proc/self/out.exr" } else { "o/out.exr" };
    let done = room.run(&["fill", "in.exr", "-o", output, "-q", "--filter", "nearest"]);
    assert_eq!(done.status, 1, "{}", done.err);
    assert_eq!(done.err.lines().count(), 1, "{}", done.err);
    assert!(done.errors()[0].contains("out.exr: cannot create"), "{}", done.err);
    std::fs::set_permissions(room.path("o"), std::fs::Permissions::from_mode(0o755)).unwrap();
}

#[test]
fn outputs_obey_the_umask() {
    use std::os::unix::fs::PermissionsExt;
    let room = Room::with(&["in.exr"]);
    let script = format!("umask 027; exec {LACUNA} fill in.exr -o out.exr --json r.json -q --filter nearest");
    let output = Command::new("sh").args(["-c", &script]).current_dir(room.path(".")).output().unwrap();
    assert_eq!(Done::from(output).status, 0);
    for name in ["out.exr", "r.json"] {
        assert_eq!(room.path(name).metadata().unwrap().permissions().mode() & 0o777, 0o640, "{name}");
    }
}

#[test]
fn threads_and_memory_change_no_byte() {
    let names = ["s.1.exr", "s.2.exr", "s.3.exr", "s.4.exr"];
    let room = Room::with(&names);
    for filter in ["ss", "tv", "pushpull", "nearest"] {
        let mut first: Option<Vec<Vec<u8>>> = None;
        for (round, how) in [
            &["--threads", "1"][..],
            &["--threads", "2"],
            &["--threads", "5", "--parallel-frames", "3"],
            &["--threads", "2", "--memory", "8M", "--parallel-frames", "4"],
        ]
        .into_iter()
        .enumerate()
        {
            let out = format!("{filter}{round}/");
            room.ok(&[&["fill", "s.%d.exr", "-o", &out, "--create-dir", "--filter", filter], how].concat());
            let files = names.map(|name| bytes(&room.path(&format!("{out}{name}")))).to_vec();
            assert!(first.get_or_insert_with(|| files.clone()) == &files, "{filter} {how:?}");
        }
    }
}

#[test]
fn a_frame_beyond_the_memory_bound_is_refused_and_the_others_done() {
    let room = Room::with(&["s.1.exr", "s.3.exr"]);
    room.add("s.2.exr", &sparse(600, 600));
    let done = room.run(&[
        "fill",
        "s.%d.exr",
        "-o",
        "o/",
        "--create-dir",
        "--memory",
        "4M",
        "-q",
        "--filter",
        "nearest",
    ]);
    assert_eq!(done.status, 1);
    assert_eq!(room.names("o"), ["s.1.exr", "s.3.exr"]);
    assert_eq!(done.errors().len(), 1, "{}", done.err);
    assert!(
        done.errors()[0].contains("s.2.exr (frame 2)") && done.errors()[0].contains("--memory"),
        "{}",
        done.err
    );
}

#[test]
fn a_time_limit_ends_the_solver_with_an_image() {
    let room = Room::new();
    room.add("big.exr", &sparse(200, 200));
    let words =
        [&["fill", "big.exr", "-o", "o.exr", "--time-limit", "0.2", "--json", "r.json"], ENDLESS].concat();
    room.ok(&words);
    let report: serde_json::Value = serde_json::from_slice(&bytes(&room.path("r.json"))).unwrap();
    assert_eq!(report["frames"][0]["stop"], "time-limit");
    let warned = |warnings: &serde_json::Value| {
        warnings.as_array().unwrap().iter().any(|text| text.as_str().unwrap().contains("--time-limit"))
    };
    assert!(warned(&report["frames"][0]["warnings"]), "{report}");
    assert_eq!(room.read("o.exr").parts[0].attributes.text("lacuna/stop").as_deref(), Some("time-limit"));
    room.ok(&["verify", "big.exr", "o.exr"]);
    let again = room.ok(&[&words[..], &["-u"]].concat());
    assert!(again.err.contains("1 of 1 frame filled") && again.err.contains("gap"), "{}", again.err);
}

#[test]
fn a_limit_of_iterations_is_said_but_does_not_make_a_frame_stale() {
    let room = Room::with(&["in.exr"]);
    let words = ["fill", "in.exr", "-o", "o.exr", "-u", "--filter", "tv", "--tv-gap", "1e-300"];
    let words = [&words[..], &["--tv-iterations", "20"]].concat();
    let done = room.ok(&words);
    assert!(done.err.contains("stopped by the limit of iterations after 20 iterations"), "{}", done.err);
    assert_eq!(
        room.read("o.exr").parts[0].attributes.text("lacuna/stop").as_deref(),
        Some("iteration-limit")
    );
    room.ok(&["verify", "in.exr", "o.exr"]);
    assert!(room.ok(&words).err.contains("1 skipped"));
    // Converged: the attribute of the input's own making goes.
    let again = ["fill", "o.exr", "-o", "p.exr", "--again", "--filter", "pushpull"];
    room.ok(&again);
    assert_eq!(room.read("p.exr").parts[0].attributes.text("lacuna/stop"), None);
    room.ok(&["verify", "o.exr", "p.exr"]);
}

#[test]
fn pipes_are_refused_at_once() {
    let room = Room::with(&["in.exr"]);
    assert!(Command::new("mkfifo").arg(room.path("pipe.exr")).status().unwrap().success());
    for words in [
        &["fill", "pipe.exr", "-o", "o.exr"][..],
        &["fill", "in.exr", "-o", "o.exr", "--mask", "pipe.exr"],
        &["fill", "in.exr", "-o", "pipe.exr", "-u"],
        &["fill", "in.exr", "-o", "pipe.exr"],
        &["verify", "in.exr", "pipe.exr"],
        &["info", "pipe.exr"],
    ] {
        let done = room.run(words);
        assert_eq!((done.status, done.errors().len()), (1, 1), "{words:?}: {}", done.err);
        assert!(done.err.contains("pipe.exr: ") && done.err.contains("not a regular file"), "{}", done.err);
    }
    assert_eq!(room.names("."), ["in.exr", "pipe.exr"]);
}

#[test]
fn a_signal_that_was_ignored_stays_ignored() {
    let room = Room::new();
    room.add("big.exr", &sparse(300, 300));
    let words = [&["fill", "big.exr", "-o", "o.exr"], ENDLESS].concat().join(" ");
    let script = format!("trap '' HUP; exec {LACUNA} {words}");
    let mut process = Command::new("sh")
        .args(["-c", &script])
        .current_dir(room.path("."))
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let _said = at_work(&mut process);
    // The kernel drops what is ignored when it is sent: nothing is left that could still end the run.
    assert!(!cfg!(target_os = "linux") || is_ignored(&process.id().to_string(), 1));
    send("-HUP", process.id());
    assert!(process.try_wait().unwrap().is_none(), "the signal ended the run");
    send("-TERM", process.id());
    assert_eq!(status(process.wait().unwrap()), 143);
}

#[test]
fn too_many_threads_are_cut_down_with_a_warning() {
    let room = Room::with(&["in.exr"]);
    let done = room.ok(&["fill", "in.exr", "-o", "o.exr", "--threads", "50000", "--filter", "nearest"]);
    assert!(done.err.contains("warning: --threads 50000"), "{}", done.err);
}

#[test]
fn reports_go_where_they_are_sent() {
    let room = Room::with(&["in.exr"]);
    std::os::unix::fs::symlink("there.json", room.path("link.json")).unwrap();
    let run =
        |report: &str| room.ok(&["fill", "in.exr", "-o", "o.exr", "--filter", "nearest", "--json", report]);
    for report in ["-", "/proc/self/fd/1"] {
        let json: serde_json::Value = serde_json::from_str(&run(report).out).unwrap();
        assert_eq!(json["frames"][0]["state"], "done");
    }
    run("link.json");
    assert!(room.path("link.json").symlink_metadata().unwrap().is_symlink());
    assert_eq!(room.names("."), ["in.exr", "link.json", "o.exr", "there.json"]);
}

#[test]
fn a_dry_run_sees_what_cannot_work() {
    let room = Room::with(&["in.exr"]);
    assert!(Command::new("mkfifo").arg(room.path("pipe.exr")).status().unwrap().success());
    for (words, place) in [
        (&["in.exr", "-o", "o.exr", "--mask", "m.png"][..], "m.png: cannot read the mask"),
        (&["in.exr", "-o", "o.exr", "--mask", "mask"], "; a channel is named channel:mask"),
        (&["in.exr", "-o", "o.exr", "--mask", "pipe.exr"], "pipe.exr: cannot read the mask"),
        (&["in.exr", "-o", "pipe.exr"], "pipe.exr: cannot write"),
        (&["pipe.exr", "-o", "o.exr"], "pipe.exr: cannot open"),
    ] {
        let done = room.run(&[&["fill", "-n"], words].concat());
        assert_eq!((done.status, done.errors().len()), (1, 1), "{words:?}: {}", done.err);
        assert!(done.out.starts_with("fail  ") && done.err.contains(place), "{words:?}: {}", done.err);
    }
}

#[test]
fn an_output_that_appears_meanwhile_is_passed_over() {
    let room = Room::new();
    room.add("big.exr", &sparse(100, 100));
    let words = [&["fill", "big.exr", "-o", "o.exr", "--no-clobber", "--time-limit", "2"], ENDLESS].concat();
    let mut process = room.command(&words).spawn().unwrap();
    let said = at_work(&mut process);
    std::fs::write(room.path("o.exr"), "mine").unwrap();
    let err = std::io::read_to_string(said).unwrap();
    assert_eq!(status(process.wait().unwrap()), 0, "{err}");
    assert!(err.contains("1 skipped"), "{err}");
    assert_eq!(bytes(&room.path("o.exr")), b"mine");
    assert_eq!(room.names("."), ["big.exr", "o.exr"]);
}
