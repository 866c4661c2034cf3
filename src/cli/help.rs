//! The command line as help, man pages and completions show it: `-h` has the flags that people use, `--help` all.

use clap::{Arg, Command, CommandFactory};

use super::Cli;

/// The flags that `-h` shows, by subcommand; of others all. Arguments without a flag are always shown.
pub(super) const SHORT: &[(&str, &[&str])] = &[
    ("fill", &["frames", "mask", "filter", "guides", "output", "create-dir", "update", "threads", "report"]),
    (
        "upscale",
        &["frames", "scale", "size", "sampling", "filter", "output", "create-dir", "update", "threads"],
    ),
    ("info", &["mask", "channels", "rules", "json"]),
    ("verify", &["frames", "mask", "threads", "json"]),
    ("compare", &["frames", "mask", "measures", "fail-below", "csv", "html", "threads"]),
    ("sparsify", &["frames", "density", "seed", "mask", "adaptive", "channels", "output", "create-dir"]),
    ("render", &["frames", "volume", "size", "set", "density", "adaptive", "fill", "output", "create-dir"]),
    ("mask", &["size", "density", "pattern", "seed", "frames", "after", "add", "merge", "output"]),
    ("analyze", &["coherence", "spectrum", "json", "output"]),
    ("slurm", &["chunk", "cpus", "mem", "time", "partition", "at-once", "dry-run", "reference"]),
    ("train", &["frames", "block", "atoms", "sparsity", "grey", "iterations", "output", "resume"]),
];

/// Examples in the help of `-h`.
const EXAMPLES: usize = 3;
/// Characters of a flag's help there; what is longer is cut at the end of a clause.
const CLAUSE: usize = 90;

/// The whole command line.
pub fn command() -> Command {
    shortened(Cli::command(), "lacuna")
}

/// A command with a short help beside the long one, and so its subcommands.
fn shortened(command: Command, path: &str) -> Command {
    let shown = SHORT.iter().find(|(name, _)| *name == command.get_name()).map(|(_, shown)| *shown);
    let names: Vec<String> = command.get_subcommands().map(|inner| inner.get_name().to_owned()).collect();
    let mut command = match shown {
        Some(shown) => with_short_help(command, path, shown),
        None => command,
    };
    for name in names {
        let path = format!("{path} {name}");
        command = command.mut_subcommand(name, |inner| shortened(inner, &path));
    }
    command
}

fn with_short_help(command: Command, path: &str, shown: &[&str]) -> Command {
    let is_shown = |arg: &Arg| arg.get_long().is_none_or(|long| shown.contains(&long));
    let command = command.mut_args(|arg| if is_shown(&arg) { brief(arg) } else { arg.hide_short_help(true) });
    let Some(after) = command.get_after_help().cloned() else { return command };
    let text = after.to_string();
    let examples = text.lines().skip(1).take_while(|line| line.starts_with("  ")).take(EXAMPLES);
    let examples: Vec<&str> = examples.collect();
    let short = format!("Examples:\n{}\n\nAll flags: {path} --help", examples.join("\n"));
    command.after_long_help(after).after_help(short)
}

/// The first clause of a long help, where only a little is shown.
fn brief(arg: Arg) -> Arg {
    let Some(help) = arg.get_help().map(ToString::to_string).filter(|help| help.len() > CLAUSE) else {
        return arg;
    };
    let end = ["; ", ": ", ", for example", ". ", " (", ", "]
        .iter()
        .filter_map(|end| help.find(end))
        .filter(|at| *at > 12);
    let clause = end.min().map_or(help.as_str(), |end| &help[..end]).to_owned();
    let long = arg.get_long_help().cloned().unwrap_or_else(|| help.clone().into());
    arg.long_help(long).help(clause)
}
