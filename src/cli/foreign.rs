//! Spellings of other tools: each says the one here.

use clap::Command;

/// A flag, and what other tools call it. The first row counts whose flag the command has.
const SPELLINGS: &[(&str, &[&str])] = &[
    ("filter", &["--method", "--algorithm", "--interpolation"]),
    ("fill", &["--method", "--algorithm", "--filter"]),
    ("scale", &["--factor", "--ratio", "--zoom"]),
    ("density", &["--ratio", "--fraction", "--percent", "--rate"]),
    ("size", &["--resolution", "--res", "--resize", "--dimensions", "--width", "--height"]),
    ("output", &["--out", "--outfile", "--output-file", "--dest", "--destination"]),
    ("frames", &["--range", "--frame-range"]),
    ("threads", &["--jobs", "-j", "--cores", "--num-threads", "--nthreads"]),
    ("data-type", &["--type", "--bit-depth", "--depth"]),
    ("compression", &["--compress", "--codec"]),
    ("guides-from", &["--aov", "--aovs", "--albedo", "--normal", "--normals"]),
    ("samples", &["--spp"]),
    ("measures", &["--metric", "--metrics"]),
    ("report", &["--html"]),
    ("html", &["--report"]),
    ("time-limit", &["--timeout"]),
];

/// Flags that name an input, which stands without one here.
const INPUTS: &[&str] = &["--input", "--in", "-i"];

/// What a flag that the command does not have is called here.
pub fn hint(flag: &str, command: &Command) -> Option<String> {
    if INPUTS.contains(&flag) && command.get_positionals().next().is_some() {
        return Some("inputs stand without a flag".into());
    }
    let rows = SPELLINGS.iter().filter(|(_, theirs)| theirs.contains(&flag));
    let mut args =
        rows.filter_map(|(ours, _)| command.get_arguments().find(|arg| arg.get_long() == Some(ours)));
    let arg = args.next()?;
    let long = arg.get_long().map(|long| format!("--{long}"));
    Some(format!("here it is {}", arg.get_short().map(|short| format!("-{short}")).or(long)?))
}
