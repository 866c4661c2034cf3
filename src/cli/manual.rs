//! `lacuna completions` and `lacuna manual`: what shells and `man` know of the command line, made of it.

use std::path::PathBuf;

use clap::{Args, CommandFactory, ValueEnum};

use super::Cli;
use super::help::command;
use crate::commands::ManualJob;

/// A shell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Shell {
    /// Bash
    Bash,
    /// Zsh
    Zsh,
    /// Fish
    Fish,
}

impl Shell {
    /// What completes in it.
    fn script(self) -> Vec<u8> {
        let shell = match self {
            Self::Bash => clap_complete::Shell::Bash,
            Self::Zsh => clap_complete::Shell::Zsh,
            Self::Fish => clap_complete::Shell::Fish,
        };
        let mut script = Vec::new();
        clap_complete::generate(shell, &mut command(), "lacuna", &mut script);
        script
    }

    /// Where its scripts lie below a prefix.
    const fn place(self) -> &'static str {
        match self {
            Self::Bash => "share/bash-completion/completions/lacuna",
            Self::Zsh => "share/zsh/site-functions/_lacuna",
            Self::Fish => "share/fish/vendor_completions.d/lacuna.fish",
        }
    }
}

/// Print the completions of a shell
#[derive(Args, Clone, Debug)]
#[command(
    after_help = "Example:\n  source <(lacuna completions bash)\n\nlacuna manual installs those of all shells."
)]
pub struct CompletionsArgs {
    /// The shell
    #[arg(help_heading = "Output")]
    shell: Shell,
}

impl CompletionsArgs {
    /// The script.
    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.shell.script()).into_owned()
    }
}

/// Install man pages, and completions for bash, zsh and fish
///
/// Writes them to share/ below the folder, where man and the shells look for them if it is one of theirs: ~/.local for one user,
/// /usr/local for all. zsh finds its own if FOLDER/share/zsh/site-functions is in its fpath.
#[derive(Args, Clone, Debug)]
#[command(after_help = "Examples:\n  lacuna manual ~/.local\n  man lacuna-fill")]
pub struct ManualArgs {
    /// The folder; share/man and others are made below it
    #[arg(value_name = "FOLDER", help_heading = "Output")]
    prefix: PathBuf,
}

impl ManualArgs {
    /// The files.
    pub fn job(&self) -> ManualJob {
        let scripts = Shell::value_variants().iter().map(|shell| (shell.place(), shell.script()));
        // Not the command with a short help: pages would leave out what `-h` does.
        ManualJob { prefix: self.prefix.clone(), pages: Cli::command(), scripts: scripts.collect() }
    }
}
