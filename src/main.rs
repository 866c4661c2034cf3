//! The `lacuna` command: reads the command line, runs the job, turns the end into an exit status.

use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

use lacuna::cli::{self, Ending, Job};
use lacuna::commands;
use lacuna::files::{PlanError, print};
use lacuna::run::{openjd_fail, panic_message, survive_size_limit};
use lacuna::submit;

fn main() -> ExitCode {
    // A panic is a defect; it becomes one line, of the frame where it happened or at the end of `run`.
    std::panic::set_hook(Box::new(|_| {}));
    survive_size_limit();
    let words: Vec<_> = std::env::args_os().collect();
    let openjd = cli::tells_openjd(&words);
    let job = match cli::parse(words) {
        Ok(job) => job,
        Err(ending) => return end(&ending, openjd),
    };
    match catch_unwind(AssertUnwindSafe(|| run(&job))) {
        Ok(Ok(status)) => status.into(),
        Ok(Err((_, PlanError::Failed(text)))) => fail(&text, openjd),
        Ok(Err((subcommand, PlanError::Usage(text)))) => end(&Ending::usage(subcommand, &text), openjd),
        Err(panic) => {
            let text = panic_message(panic.as_ref());
            fail(&format!("internal error ({text}); please report it"), openjd)
        }
    }
}

fn run(job: &Job) -> Result<u8, (&'static str, PlanError)> {
    match job {
        Job::Fill(job) => job.run.report(job.command(), commands::fill(job)),
        Job::Info(job) => commands::info(job).map_err(|error| ("info", error)),
        Job::Verify(job) => job.run.report("verify", commands::verify(job)),
        Job::Mask(job) => commands::mask(job).map_err(|error| (job.command(), error)),
        Job::Compare(job) => job.run.report("compare", commands::compare(job)),
        Job::Study(job) => commands::study(job).map_err(|error| ("study", error)),
        Job::Sparsify(job) => job.run.report("sparsify", commands::sparsify(job)),
        Job::Submit(job) => submit::submit(job).map_err(|error| ("submit slurm", error)),
        Job::Train(job) => commands::train(job).map_err(|error| ("dictionary train", error)),
        Job::Dictionary(name, job) => commands::dictionary(job).map_err(|error| (*name, error)),
        Job::Manual(job) => commands::manual(job).map_err(|error| ("manual", error)),
        Job::Render(job) => job.run.report("render", commands::render(job)),
    }
}

/// Says why there is no job.
fn end(ending: &Ending, openjd: bool) -> ExitCode {
    if let (Ending::Usage(text), true) = (ending, openjd) {
        openjd_fail(text.trim_start_matches("lacuna: error: "));
    }
    // Nobody is left to tell if the stream is closed.
    match ending {
        Ending::Shown(text) => match print(text) {
            Ok(()) => {}
            Err(error) => return fail(&error.to_string(), openjd),
        },
        Ending::Usage(text) => drop(write!(std::io::stderr().lock(), "{text}")),
    }
    ending.status().into()
}

fn fail(text: &str, openjd: bool) -> ExitCode {
    if openjd {
        openjd_fail(text);
    }
    let line = text.replace(|c: char| c.is_control(), " ");
    // Nobody is left to tell if standard error is closed.
    drop(writeln!(std::io::stderr().lock(), "lacuna: error: {line}"));
    ExitCode::FAILURE
}
