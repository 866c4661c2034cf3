use lacuna_exr::Compression;
use lacuna_filters::Method;
use lacuna_filters::variational::tv;

use super::*;
use crate::commands::{MaskTask, SparsifyPattern};
use crate::mask::Source;
use crate::reconstruct::{Domain, Kind};
use crate::report::Measure;
use crate::run::{Existing, Meter, Verbosity};

fn words(line: &str) -> Vec<OsString> {
    std::iter::once("lacuna").chain(line.split_whitespace()).map(OsString::from).collect()
}

fn fill(line: &str) -> FillJob {
    match parse(words(&format!("fill {line}"))) {
        Ok(Job::Fill(job)) => *job,
        other => panic!("{line}: {other:?}"),
    }
}

fn usage(line: &str) -> String {
    match parse(words(line)) {
        Err(Ending::Usage(text)) => text,
        other => panic!("{line}: {other:?}"),
    }
}

#[test]
fn compare_takes_bounds_and_computes_what_they_need() {
    let job = |line: &str| match parse(words(&format!("compare a.exr b.exr {line}"))) {
        Ok(Job::Compare(job)) => *job,
        other => panic!("{line}: {other:?}"),
    };
    let plain = job("");
    assert_eq!((plain.settings.peak, plain.settings.clip, plain.settings.display), (1.0, true, false));
    assert!(!plain.settings.wanted.has(Measure::Flip) && plain.gate.is_empty());
    let gated = job("--fail-below psnr=40,missing.ssim=0.98 --fail-above flip=0.05 --no-clip --peak 2");
    assert_eq!(gated.gate.texts(), ["psnr >= 40", "missing.ssim >= 0.98", "flip <= 0.05"]);
    assert!(gated.settings.wanted.has(Measure::Flip) && !gated.settings.wanted.has(Measure::HdrFlip));
    assert_eq!((gated.settings.peak, gated.settings.clip), (2.0, false));
    assert!(job("--html r.html").settings.wanted.has(Measure::Cieluv));
    let ranged = job("--hdr-range 0.18,2").settings;
    assert!(ranged.hdr_range == Some((0.18, 2.0)) && ranged.wanted.has(Measure::HdrFlip));
    for wrong in ["--peak 0", "--fail-below x=1", "--measures x", "--display --no-clip", "--hdr-range 2,1"] {
        assert!(usage(&format!("compare a.exr b.exr {wrong}")).contains("lacuna: error: "), "{wrong}");
    }
}

/// All commands, each with the words that lead to it.
fn commands(of: &clap::Command, path: &[String]) -> Vec<Vec<String>> {
    let mut all = vec![path.to_vec()];
    for inner in of.get_subcommands().filter(|inner| inner.get_name() != "help") {
        all.extend(commands(inner, &[path, &[inner.get_name().to_owned()]].concat()));
    }
    all
}

fn shown(line: &str) -> String {
    match parse(words(line)) {
        Err(Ending::Shown(text)) => text,
        other => panic!("{line}: {other:?}"),
    }
}

#[test]
fn the_short_help_fits_a_screen_and_the_long_one_has_every_flag() {
    let whole = help::command();
    let all = commands(&whole, &[]);
    assert!(all.len() > 18 && all.contains(&vec!["dictionary".to_owned(), "train".to_owned()]));
    for path in all {
        let mut command = whole.clone().term_width(100);
        for name in &path {
            command = command.find_subcommand(name).unwrap().clone().term_width(100);
        }
        let short = command.render_help().to_string();
        let widest = short.lines().map(|line| line.chars().count()).max();
        assert!(short.lines().count() <= 45 && widest <= Some(100), "{path:?}: {short}");
        let after = command.get_after_long_help().or(command.get_after_help());
        let after = after.map(ToString::to_string).unwrap_or_default();
        let wide = after.lines().find(|line| line.starts_with("  ") && line.chars().count() > 80);
        assert_eq!(wide, None, "{path:?}: an example that a terminal wraps runs cut off");
        let long = command.render_long_help().to_string();
        for arg in command.get_arguments() {
            let flag = arg.get_long().map_or_else(|| arg.get_id().to_string(), |long| format!("--{long}"));
            assert!(arg.get_long().is_none() || long.contains(&flag), "{path:?}: {flag}");
            assert!(arg.get_help().is_some(), "{path:?}: {flag} says nothing");
        }
        if path.first().is_some_and(|name| name == "fill") {
            assert!(short.contains("lacuna fill --help") && !short.contains("--csw-blur"), "{short}");
            let (usual, baselines) = long.split_once("Settings of baselines:").unwrap();
            assert!(usual.contains("--tv-gap") && usual.contains("--report"), "{long}");
            assert!(baselines.contains("--csw-blur") && !baselines.contains("--tv-gap <"), "{long}");
        }
    }
}

#[test]
fn flags_of_the_short_help_exist() {
    let whole = help::command();
    let all = commands(&whole, &[]);
    for (name, flags) in help::SHORT {
        let path = all.iter().find(|path| path.last().is_some_and(|last| last == name)).unwrap();
        let command = path.iter().fold(whole.clone(), |at, name| at.find_subcommand(name).unwrap().clone());
        for flag in *flags {
            let found = command.get_arguments().any(|arg| arg.get_long() == Some(flag));
            assert!(found, "{name}: no --{flag}");
        }
    }
}

#[test]
fn filters_are_listed_and_each_has_a_page() {
    let list = shown("filters");
    for method in lacuna_filters::METHODS {
        assert!(list.lines().any(|line| line.starts_with(&format!("{} ", method.name))), "{list}");
        let page = shown(&format!("filters {}", method.name));
        assert!(page.starts_with(&format!("{}: {}", method.name, method.help)), "{page}");
        for setting in method.settings.iter().filter(|setting| !setting.flag.is_empty()) {
            assert!(page.contains(&format!("--{}", setting.flag)) && page.contains(setting.help), "{page}");
        }
    }
    assert!(usage("filters magic").contains("magic"));
}

#[test]
fn old_spellings_say_the_new_ones() {
    for (old, new) in [
        ("train a.exr -o b.npz", "'lacuna dictionary train'"),
        ("encode a.exr", "'lacuna dictionary encode'"),
        ("decode", "'lacuna dictionary decode'"),
        ("dictionary-info a.npz", "'lacuna dictionary info'"),
        ("mask --measure m.exr", "'lacuna analyze MASK'"),
        ("mask --measure=m.exr", "'lacuna analyze MASK'"),
        ("mask -o p.png --spectrum a.exr", "'lacuna analyze --spectrum'"),
        ("mask --coherence", "'lacuna analyze --coherence'"),
    ] {
        let text = usage(old);
        assert!(text.starts_with("lacuna: error: ") && text.contains(new), "{text}");
        assert_eq!(text.lines().count(), 1, "{text}");
    }
}

#[test]
fn spellings_of_other_tools_say_the_one_here() {
    for (line, here) in [
        ("fill a.exr --method ss", "here it is --filter"),
        ("fill a.exr --method=ss", "here it is --filter"),
        ("render a.toml --method ss", "here it is --fill"),
        ("upscale a.exr --factor 2", "here it is --scale"),
        ("upscale a.exr --res 64x64", "here it is --size"),
        ("sparsify a.exr --ratio 0.2", "here it is --density"),
        ("fill a.exr --out b.exr", "here it is -o"),
        ("fill -i a.exr", "inputs stand without a flag"),
        ("dictionary train a.exr -j8", "here it is --threads"),
    ] {
        let text = usage(line);
        assert!(
            text.contains(&format!("; {here} (see 'lacuna ")) && !text.contains("tip:"),
            "{line}: {text}"
        );
        assert_eq!(text.lines().count(), 1, "{text}");
    }
    assert!(usage("fill a.exr --fliter ss").contains("; a similar argument exists: '--filter'"));
    assert!(usage("submit slurm --frames 1-4 -- fill a.exr -o b/").contains("stand behind --"));
    for line in ["fill -x", "verify a.exr b.exr --factor 2", "slrum", "submit -- fill a.exr"] {
        assert!(!usage(line).contains("to pass"), "{line}: {}", usage(line));
    }
}

#[test]
fn completions_have_every_flag() {
    for shell in ["bash", "zsh", "fish"] {
        let script = shown(&format!("completions {shell}"));
        let whole = help::command();
        for path in commands(&whole, &[]) {
            let command =
                path.iter().fold(whole.clone(), |at, name| at.find_subcommand(name).unwrap().clone());
            for long in command.get_arguments().filter_map(clap::Arg::get_long) {
                let found = match shell {
                    "fish" => script.contains(&format!("-l {long}")),
                    _ => script.contains(&format!("--{long}")),
                };
                assert!(found, "{shell}: {path:?} --{long}");
            }
        }
    }
    assert!(usage("completions tcsh").contains("tcsh"));
}

#[test]
fn a_wrong_command_line_is_one_line() {
    for (line, help) in [
        ("mask -o m.exr --size 0x0 --density 0.2", "lacuna mask --help"),
        ("mask -o m.exr --size 8x8 --density 1.5", "lacuna mask --help"),
        ("mask -o m.exr --density 0.2", "lacuna mask --help"),
        ("fill a.exr", "lacuna fill --help"),
        ("fill a.exr -o b.exr --fliter ss", "lacuna fill --help"),
        ("fill a.exr -o b.exr --filter ss --tv-gap 0.1", "lacuna fill --help"),
        ("submit slurm --chunk 0 -- fill", "lacuna submit slurm --help"),
        ("submit slrum", "lacuna submit --help"),
        ("frobnicate", "lacuna --help"),
    ] {
        let text = usage(line);
        assert!(
            text.starts_with("lacuna: error: ") && text.ends_with(&format!("(see '{help}')\n")),
            "{text}"
        );
        assert_eq!(text.lines().count(), 1, "{text}");
    }
}

#[test]
fn a_wrong_command_line_may_ask_for_lines_of_openjd() {
    for (line, asks) in [
        ("fill --progress openjd --frames x", true),
        ("fill --fliter ss --progress=openjd", true),
        ("fill --progress plain", false),
        ("fill --progress", false),
        ("submit slurm -- fill --progress openjd", false),
    ] {
        assert_eq!(tells_openjd(&words(line)), asks, "{line}");
    }
}

#[test]
fn the_commands_are_sound() {
    help::command().debug_assert();
}

#[test]
fn the_defaults_are_the_documented_ones() {
    let job = fill("a.exr -o b.exr");
    assert_eq!(job.what.method.name(), "auto");
    assert!(job.what.method.keeps_measured());
    assert_eq!(job.what.mask, Source::Auto);
    assert_eq!((job.what.domain, job.what.limit, job.what.drop_mask), (Domain::Auto, true, false));
    assert_eq!((job.what.kind, job.what.compression, job.what.level), (None, None, None));
    assert_eq!((job.existing, job.skip_missing, job.targets.create_dir), (Existing::Replace, false, false));
    assert_eq!((job.run.threads, job.run.parallel_frames, job.run.memory), (0, 1, None));
    assert_eq!((job.run.verbosity, job.run.dry_run), (Verbosity::Normal, false));
}

#[test]
fn every_flag_reaches_the_job() {
    let job = fill(
        "a.####.exr b.exr -o out/ --frames -2-2x2 --missing-frame skip --files-from list --mask m.##.png \
         --channels beauty.*=keep --channels Z*=depth --filter tv --tv-epsilon 0.5 --domain log --limit off -d half \
         --compression zips:7 --drop-mask -u --create-dir -n --threads 3 --parallel-frames 2 --memory 2G \
         --time-limit 1.5 -v --json r.json --log l.jsonl --progress openjd",
    );
    assert_eq!(job.selection.inputs.len(), 2);
    assert_eq!(job.selection.frames.unwrap().numbers(), [-2, 0, 2]);
    assert_eq!(job.selection.files_from, Some("list".into()));
    assert!(job.skip_missing);
    assert_eq!(job.targets.mask, Some("m.##.png".into()));
    assert_eq!(job.what.overrides.len(), 2);
    assert_eq!(job.what.method, Method::from(tv::Settings { epsilon: 0.5, ..tv::Settings::default() }));
    assert_eq!((job.what.domain, job.what.limit, job.what.drop_mask), (Domain::Log, false, true));
    assert_eq!(
        (job.what.kind, job.what.compression, job.what.level),
        (Some(Kind::Half), Some(Compression::Zips), Some(7))
    );
    assert_eq!(job.existing, Existing::Update);
    assert!(job.targets.create_dir && job.run.dry_run);
    assert_eq!((job.run.threads, job.run.parallel_frames, job.run.memory), (3, 2, Some(2 << 30)));
    assert_eq!(job.run.time_limit, Some(std::time::Duration::from_millis(1500)));
    assert_eq!(job.run.verbosity, Verbosity::Verbose);
    assert_eq!((job.run.log, job.run.meter), (Some("l.jsonl".into()), Meter::OpenJd));
    assert_eq!(job.targets.also_written, ["r.json", "l.jsonl"].map(std::path::PathBuf::from));
}

#[test]
fn only_what_can_stop_early_takes_a_time_limit() {
    for line in ["fill a.exr -o b.exr", "upscale a.exr -o b.exr --scale 2"] {
        let Ok(Job::Fill(job)) = parse(words(&format!("{line} --time-limit 2"))) else { panic!("{line}") };
        assert_eq!(job.run.time_limit, Some(std::time::Duration::from_secs(2)), "{line}");
    }
    for line in [
        "render a.nrrd -o b.exr --density 0.5 --fill ss",
        "sparsify a.exr -o b.exr --density 0.5",
        "verify a.exr b.exr",
        "compare a.exr b.exr",
    ] {
        assert!(usage(&format!("{line} --time-limit 2")).contains("'--time-limit'"), "{line}");
    }
}

#[test]
fn settings_of_another_filter_are_refused() {
    for (line, flag) in [
        ("--filter auto --tv-norm isotropic", "--tv-norm"),
        ("--filter tv --ss-lambda 0.1", "--ss-lambda"),
        ("--filter pushpull --tv-gap 0.1", "--tv-gap"),
        ("--filter nearest --ss-order 2", "--ss-order"),
    ] {
        let text = usage(&format!("fill a.exr -o b.exr {line}"));
        assert!(text.starts_with(&format!("lacuna: error: {flag} is a setting of")), "{text}");
        assert_eq!(text.lines().count(), 1, "{text}");
    }
}

#[test]
fn analyze_measures_masks_and_frames() {
    let task = |line: &str| match parse(words(&format!("analyze {line}"))) {
        Ok(Job::Mask(job)) => job.task,
        other => panic!("{line}: {other:?}"),
    };
    let plain = task("m.png --json --spectrum a.exr");
    assert!(matches!(plain, MaskTask::Measure { json: true, mask: Some(_), spectrum: Some(_), .. }));
    let plotted = task("--spectrum a.exr -o p.png --no-clobber");
    assert!(matches!(plotted, MaskTask::Measure { plot: Some(_), .. }));
    let MaskTask::Measure { coherence, seed, .. } = task("--coherence --densities 0.1,0.5 --seed 3") else {
        panic!("another task");
    };
    assert_eq!((coherence, seed), (vec![0.1, 0.5], 3));
    for (line, reason) in [
        ("", "give a mask, --coherence or --spectrum"),
        ("alpha", "image file"),
        ("m.exr -o plot.exr", "PNG"),
        ("--coherence -o plot.png", "--coherence prints"),
        ("m.exr --seed 1", "--coherence"),
        ("m.exr --spectrum a.exr -o plot.png", "not with both"),
        ("--coherence --densities 0.1,0", "above 0 and at most 1"),
    ] {
        let text = usage(&format!("analyze {line}"));
        assert!(text.contains(reason) && text.ends_with("(see 'lacuna analyze --help')\n"), "{text}");
    }
}

#[test]
fn nonsense_is_a_usage_error() {
    for line in [
        "",
        "fill",
        "fill a.exr",
        "fill -o b.exr",
        "fill a.exr -o b.exr --frames 1-",
        "fill a.exr -o b.exr --filter what",
        "fill a.exr -o b.exr --compression dwaa",
        "fill a.exr -o b.exr --channels beauty",
        "fill a.exr -o b.exr --mask count:n",
        "fill a.exr -o b.exr --ss-lambda -1",
        "fill a.exr -o b.exr --ss-lambda nan",
        "fill a.exr -o b.exr --ss-order 4",
        "fill a.exr -o b.exr --filter tv --tv-gap 0",
        "fill a.exr -o b.exr --parallel-frames 0",
        "fill a.exr -o b.exr --memory 0",
        "fill a.exr -o b.exr --time-limit 0",
        "fill a.exr -o b.exr -u --no-clobber",
        "fill a.exr -o b.exr -q -v",
        "sparsify a.exr -o b.exr",
        "fill a.exr -o b.exr --memory -1G",
        "fill a.exr -o b.exr -o c.exr",
        "fill a.exr -o b.txt",
        "fill a.exr -o b",
        "sparsify a.exr -o b.png --density 0.1",
        "sparsify a.exr -o b.exr --density 1.5",
        "sparsify a.exr -o b.exr --density 0.5 --mask m.exr",
        "sparsify a.exr -o b.exr --mask alpha",
        "verify a.exr",
        "verify a.exr b.exr --time-limit 1",
        "compare a.exr b.exr --time-limit 1",
        "sparsify a.exr -o b.exr --density 0.5 --time-limit 1",
        "render a.toml -o b.exr --time-limit 1",
        "info",
        "info a.exr --rules --json",
        "info a.exr --json a.json",
        "what",
    ] {
        let text = usage(line);
        assert!(text.starts_with("lacuna: error: ") || line.is_empty(), "{line}: {text}");
    }
}

#[test]
fn numbers_out_of_range_get_the_range() {
    for (line, reason) in [
        ("--ss-lambda -1", "it must be a number of 0 or more"),
        ("--ss-tension -0.5", "it must be a number of 0 or more"),
        ("--filter tv --tv-epsilon -1", "it must be a number of 0 or more"),
        ("--filter tv --tv-gap -1e-3", "it must be a number above 0"),
        ("--filter tv --tv-iterations -3", "it must be a number of 1 or more"),
        ("--threads -1", "it must be a whole number: 0 for all"),
        ("--threads=-1", "it must be a whole number: 0 for all"),
        ("--parallel-frames 0", "it must be a whole number from 1"),
        ("--memory 0", "it must be a size above 0"),
        ("--memory -1G", "it must be a size above 0"),
        ("--time-limit inf", "it must be a number of seconds above 0"),
        ("--time-limit -1", "it must be a number of seconds above 0"),
        ("-o c.exr", "-o is given more than once (b.exr, c.exr)"),
    ] {
        let text = usage(&format!("fill a.exr -o b.exr {line}"));
        assert!(text.contains(reason), "{line}: {text}");
    }
    assert!(usage("sparsify a.exr -o b.exr --density -0.5").contains("above 0 and at most 1"));
    let neither = usage("upscale a.exr -o b.exr");
    assert!(neither.contains("--scale") && neither.contains("--size"), "{neither}");
    for scale in ["1.5", "2x1.5"] {
        let text = usage(&format!("upscale a.exr -o b.exr --sampling grid --scale {scale}"));
        assert!(text.contains("--sampling grid needs whole factors"), "{text}");
    }
    let log = "upscale a.exr -o b.exr --scale 2 --domain log";
    let means = usage(&format!("{log} --sampling mitchell"));
    assert!(means.contains("--sampling point and grid, not mitchell"), "{means}");
    for more in ["", "--sampling point", "--filter linear", "--filter tv"] {
        assert!(parse(words(&format!("{log} {more}"))).is_ok(), "{more}");
    }
    let guides = usage("upscale a.exr -o b.exr --scale 2 --filter tv --guides-from c.exr --take-guides");
    assert!(guides.contains("--guides none with --take-guides"), "{guides}");
    let neither = usage("sparsify a.exr -o b.exr");
    assert!(neither.contains("--density") && neither.contains("--mask"), "{neither}");
    assert!(usage("fill a.exr -o b.txt").contains("a folder that is not there yet ends in /"));
    for line in ["fill a.exr -o b.png", "render a.toml -o b.JPG"] {
        assert!(usage(line).contains("ends in .exr; --report page.html shows it in a browser"), "{line}");
    }
    assert!(!usage("upscale a.exr -o b.png --scale 2").contains("--report"));
    assert_eq!(fill("a.exr -o new/").targets.output, std::path::PathBuf::from("new/"));
    assert_eq!(fill("a.exr -o b.EXR").targets.output, std::path::PathBuf::from("b.EXR"));
}

#[test]
fn help_and_version_are_shown() {
    for line in [
        "help",
        "help fill",
        "--help",
        "--version",
        "fill --help",
        "fill -h",
        "info -h",
        "verify -h",
        "sparsify --help",
    ] {
        assert!(matches!(parse(words(line)), Err(Ending::Shown(_))), "{line}");
    }
}

#[test]
fn frames_come_before_their_flags() {
    for (line, names) in [
        ("fill --help", &["[INPUT]", "--files-from", "--frames", "--missing-frame"][..]),
        ("verify --help", &["<SPARSE>", "<FILLED>", "--frames", "--missing-frame"]),
        ("compare --help", &["<REFERENCE>", "<TEST>", "--frames", "--missing-frame"]),
    ] {
        let Err(Ending::Shown(text)) = parse(words(line)) else { panic!("no help") };
        let list = &text[text.find("Input and frames").unwrap()..];
        let places: Vec<_> = names.iter().map(|name| list.find(name).unwrap()).collect();
        assert!(places.is_sorted(), "{places:?} {text}");
    }
}

#[test]
fn every_flag_has_help_and_a_heading() {
    for subcommand in help::command().get_subcommands() {
        for argument in subcommand.get_arguments() {
            let id = argument.get_id();
            assert!(argument.get_help().is_some(), "{} {id}", subcommand.get_name());
            assert!(argument.get_help_heading().is_some(), "{} {id}", subcommand.get_name());
        }
    }
}

#[test]
fn sparsify_takes_a_density_or_a_mask() {
    let pattern = |line: &str| match parse(words(&format!("sparsify a.exr -o b.exr {line}"))) {
        Ok(Job::Sparsify(job)) => (job.pattern, job.targets.mask),
        other => panic!("{line}: {other:?}"),
    };
    assert_eq!(pattern("--density 0.2"), (SparsifyPattern::Shuffle { density: 0.2, seed: 0 }, None));
    assert_eq!(pattern("--density 1 --seed 9"), (SparsifyPattern::Shuffle { density: 1.0, seed: 9 }, None));
    let (mask, file) = pattern("--mask file:m.exr:R");
    assert_eq!(file, Some("m.exr".into()));
    assert_eq!(mask, SparsifyPattern::Mask("m.exr:R".parse().unwrap()));
    assert!(usage("sparsify a.exr -o b.exr --density 0").contains("above 0 and at most 1"));
    assert!(usage("sparsify a.exr -o b.exr --density 20%").contains("20 % is 0.2"));
    let told = usage("sparsify a.exr -o b.exr --density 1.1%");
    assert!(told.contains("1.1 % is 0.011") && !told.contains("0.0110"), "{told}");
    for (words, why) in [
        ("--seed 18446744073709551615", "from 0 to 9223372036854775807"),
        ("--step nan", "from 0.001 to 1000"),
        ("--step -1", "from 0.001 to 1000"),
        ("--density 0.1 --adaptive --first 0", "above 0 and at most 1"),
    ] {
        let told = usage(&format!("render a.toml -o b.exr {words}"));
        assert!(told.contains(why), "{words}: {told}");
    }
}

#[test]
fn a_command_to_submit_wants_a_manager_before_it() {
    assert!(usage("submit -- fill a.exr -o b.exr").contains("lacuna submit slurm -- fill"));
}
