//! Interrupt, termination, hang-up, and what managers of farms send before they kill: the run ends within a moment and leaves no temporary file.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGUSR1, SIGUSR2, SIGXCPU, SIGXFSZ};
use signal_hook::iterator::Signals;

/// All of them end a process that does nothing about it. Slurm, SGE and LSF let users choose one that warns of the time's end.
const ENDING: [i32; 7] = [SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGUSR1, SIGUSR2, SIGXCPU];
/// How long cleaning up may take. A pipe that nobody reads would hold it up for ever.
const PATIENCE: Duration = Duration::from_secs(4);

/// Waits for a signal in a thread of its own. When one comes, the flag that is returned turns true, `clean` runs, and
/// the process ends with status 128 + the signal's number, within `PATIENCE` whatever `clean` waits for.
///
/// A signal that the parent had ignored (`nohup` does so with hang-ups, a shell with the interrupts of what it runs in
/// the background) stays ignored.
pub fn watch(clean: impl FnOnce() + Send + 'static) -> std::io::Result<Arc<AtomicBool>> {
    let process = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mut signals = Signals::new(ENDING.into_iter().filter(|&signal| !is_ignored(signal, &process)))?;
    let stopped = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stopped);
    std::thread::Builder::new().name("lacuna-signals".into()).spawn(move || {
        if let Some(signal) = signals.forever().next() {
            flag.store(true, Ordering::SeqCst);
            let end = move || std::process::exit(128 + signal);
            let deadline = std::thread::Builder::new().name("lacuna-deadline".into());
            // Where there are no more threads, it takes as long as it takes.
            drop(deadline.spawn(move || {
                std::thread::sleep(PATIENCE);
                end();
            }));
            clean();
            end();
        }
    })?;
    Ok(stopped)
}

/// From now on a write past the limit of file sizes fails like one on a full disk, and does not end the process by a signal.
pub fn survive_size_limit() {
    // Where it cannot be caught, the signal does what it did.
    drop(signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false))));
}

/// Whether a process ignores a signal, by Linux's description of it; where there is none, not.
fn is_ignored(signal: i32, process: &str) -> bool {
    let ignored = process.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let bits = ignored.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok()).unwrap_or(0);
    bits >> (signal - 1) & 1 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ignored_signals_are_bits_of_the_process() {
        let process = "Name:\tlacuna\nSigBlk:\t0000000000000003\nSigIgn:\t0000000000001001\n";
        assert!(is_ignored(SIGHUP, process));
        assert!(!is_ignored(SIGINT, process) && !is_ignored(SIGTERM, process) && !is_ignored(SIGHUP, ""));
    }
}
