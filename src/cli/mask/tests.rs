//! Tests of the flags of `lacuna mask`.

use super::*;
use crate::cli::{Ending, Job, parse};

fn job(words: &str) -> Result<MaskJob, String> {
    let words = ["lacuna", "mask"].into_iter().chain(words.split_whitespace());
    match parse(words.map(Into::into)) {
        Ok(Job::Mask(job)) => Ok(*job),
        Ok(other) => Err(format!("{other:?}")),
        Err(Ending::Usage(text) | Ending::Shown(text)) => Err(text),
    }
}

#[test]
fn sizes_are_read_with_their_origin() {
    let window = |text: &str| text.parse::<Geometry>().map(|geometry| geometry.0);
    assert_eq!(window("20x10"), Ok(Window { x_min: 0, y_min: 0, x_max: 19, y_max: 9 }));
    assert_eq!(window("20x10-3+4"), Ok(Window { x_min: -3, y_min: 4, x_max: 16, y_max: 13 }));
    assert_eq!(window("1x1+5-6"), Ok(Window { x_min: 5, y_min: -6, x_max: 5, y_max: -6 }));
    for nonsense in [
        "",
        "20",
        "0x10",
        "10x0",
        "10x",
        "axb",
        "10x10+3",
        "10x10+",
        "40000x1",
        "2x2+2147483647+0",
        "2x2+1073741823+0",
        "2x2+0-1073741824",
        "-3x4",
    ] {
        assert!(window(nonsense).is_err(), "{nonsense}");
    }
}

#[test]
fn a_mask_from_a_pattern() {
    let job = job(
        "-o m.exr --size 64x32 --density 0.2 --pattern blue-noise --seed 4 --border 1 --inside a.exr:id.A",
    )
    .unwrap();
    let MaskTask::Generate { request, rank, frames, bounds, output } = job.task else { panic!("{job:?}") };
    assert_eq!((request.pattern, request.density, request.seed), (Pattern::BlueNoise, 0.2, 4));
    assert_eq!((rank, frames, bounds.border, output.overhead), (false, None, 1, 256));
    let inside = Source::File { pattern: "a.exr".into(), channel: Some("id.A".into()) };
    assert_eq!(bounds.inside, Some(inside));
}

#[test]
fn nonsense_is_refused_in_one_line() {
    for (words, reason) in [
        ("-o m.exr --size 64x32 --density 1.5", "above 0 and at most 1"),
        ("-o m.exr --size 64x32 --density -0.1", "above 0 and at most 1"),
        ("-o m.exr --size 64x32 --density nan", "above 0 and at most 1"),
        ("-o m.exr --size 0x32 --density 0.5", "from 1 to 32768"),
        ("-o m.exr --size 64x32", "--density D or --rank"),
        ("-o m.foo --size 64x32 --density 0.5", "-o 'm.foo' does not end in .exr, .png, .txt or .json"),
        ("-o m.#### --after a.####.exr --add 0.1 --frames 1-2", "does not end in .exr"),
        ("-o m.exr --density 0.2", "--size"),
        ("--size 64x32 --density 0.2", "-o OUTPUT"),
        ("-o m.exr --size 64x32 --density 0.2 --temporal offset", "--frames"),
        ("-o m.exr --size 64x32 --density 0.2 --add 0.1", "--after"),
        ("-o m.exr --size 64x32 --density 0.2 --error-estimate e.exr", "--after"),
        ("-o m.exr --size 64x32 --density 0.2 --rank", "leave --density away"),
        ("-o m.#.exr --size 64x32 --rank --frames 1-2 --temporal complementary", "needs --density"),
        (
            "-o m.#.exr --size 64x32 --density 0.1 --frames 1-2 --temporal complementary --pattern poisson",
            "do not complete each other",
        ),
        ("-o m.exr --after f.exr", "--add"),
        ("-o m.exr --size 4x4 --density 0.1 --pattern halton", "halton"),
        (
            "-o n.exr --after f.exr --add 0.1 --error-estimate e.txt",
            "--error-estimate 'e.txt': error is an image",
        ),
        ("-o n.txt --size 4x4 --rank", "-o 'n.txt': rank is an image"),
        ("-o n.exr --size 4x4 --rank --pattern grid", "--rank: the pattern grid is not progressive"),
        ("-o n.exr --size 4x4 --density 0.1 --paired --pattern poisson", "it has no pairs"),
        ("-o m.exr --merge a.exr", "2 values"),
        ("-o m.png --merge a.exr b.exr", "'m.png' does not end in .exr"),
        ("-o m --merge a.exr b.exr", "'m' does not end in .exr"),
        ("-o m.exr --size 4x4 --after f.exr --add 0.1", "--after takes its frames' size: drop --size"),
    ] {
        let error = job(words).unwrap_err();
        assert!(error.contains(reason), "{words}: {error}");
        let line = error.lines().next().unwrap_or_default();
        assert!(line.starts_with("lacuna: error: "), "{error}");
    }
}

#[test]
fn the_other_tasks() {
    let task = |words| job(words).unwrap().task;
    assert!(matches!(task("--after f.exr --add 0.05 -o n.txt"), MaskTask::Next(NextPass { add: 0.05, .. })));
    assert!(matches!(task("--merge a.exr b.exr -o c.exr"), MaskTask::Merge(_)));
}

#[test]
fn a_flag_that_the_task_of_mask_does_not_use_is_refused() {
    let generate = "--size 8x8 --density 0.5 -o m.exr";
    let (after, merge) = ("--after a.exr --add 0.1 -o m.exr", "--merge a.exr b.exr -o m.exr");
    for (task, flag, owners) in [
        (generate, "--add 0.1", "--after"),
        (generate, "--error-estimate e.exr", "--after"),
        (generate, "--mask alpha", "--after or --merge"),
        (after, "--pattern grid", "--size"),
        (after, "--temporal offset", "--size"),
        (after, "--density 0.1", "--size"),
        (merge, "--inside i.png", "--size or --after"),
        (merge, "--always i.png", "--size or --after"),
        (merge, "--border 1", "--size or --after"),
        (merge, "--pattern shuffle", "--size"),
        (merge, "--temporal fixed", "--size"),
        (merge, "--seed 0", "--size or --after"),
        (merge, "--crop-overhead 9", "--size or --after"),
        (merge, "--rank", "--size"),
    ] {
        let text = job(&format!("{task} {flag}")).unwrap_err();
        let name = flag.split(' ').next().unwrap();
        assert!(text.starts_with(&format!("lacuna: error: {name} goes with {owners}; --")), "{text}");
        assert!(text.contains("does not use it") && text.lines().count() == 1, "{text}");
    }
    for (task, flags) in [
        (
            generate,
            "--pattern grid --seed 1 --frames 1-2 --temporal offset --inside i.png --border 1 --threads 2",
        ),
        (after, "--seed 1 --frames 1-2 --always i.png --border 1 --mask alpha --error-estimate e.exr"),
        (merge, "--frames 1-2 --mask alpha --create-dir -q"),
    ] {
        assert!(job(&format!("{task} {flags}")).is_ok(), "{task} {flags}");
    }
}

#[test]
fn masks_of_frames_differ_unless_asked_otherwise() {
    for (words, temporal) in [
        ("--density 0.2", Temporal::Fixed),
        ("--density 0.2 --frames 1-2", Temporal::Complementary),
        ("--density 0.2 --frames 1-2 --pattern grid", Temporal::Complementary),
        ("--density 0.2 --frames 1-2 --pattern poisson", Temporal::Offset),
        ("--density 0.2 --frames 1-2 --paired", Temporal::Offset),
        ("--rank --frames 1-2", Temporal::Offset),
        ("--density 0.2 --frames 1-2 --temporal fixed", Temporal::Fixed),
    ] {
        let MaskTask::Generate { request, .. } = job(&format!("-o m.#.exr --size 8x8 {words}")).unwrap().task
        else {
            panic!("{words}")
        };
        assert_eq!(request.temporal, temporal, "{words}");
    }
}
