//! Interrupt, termination and hang-up: the run ends within a moment and leaves no temporary file.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::iterator::Signals;

/// Waits for a signal in a thread of its own. When one comes, the flag that is returned turns true, `clean` runs, and
/// the process ends with status 128 + the signal's number.
///
/// The signal of a file that grows past the limit of file sizes is caught and ignored, so that the write fails like one on
/// a full disk.
pub fn watch(clean: impl FnOnce() + Send + 'static) -> std::io::Result<Arc<AtomicBool>> {
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])?;
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)))?;
    let stopped = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stopped);
    std::thread::Builder::new().name("lacuna-signals".into()).spawn(move || {
        if let Some(signal) = signals.forever().next() {
            flag.store(true, Ordering::SeqCst);
            clean();
            std::process::exit(128 + signal);
        }
    })?;
    Ok(stopped)
}
