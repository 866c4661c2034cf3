//! Work beside Python: without the interpreter's lock, in threads of its own, and with an ear for Ctrl-C.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use lacuna_filters::{Error, Run, Stop};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// How often Python is asked for signals.
const LISTEN: Duration = Duration::from_millis(20);

/// The threads of a call, 0 for one a processor. Each call has its own: a pool that outlives a call would be lost in a child after `fork`.
pub fn pool(threads: usize) -> PyResult<ThreadPool> {
    let available = thread::available_parallelism().map_or(1, std::num::NonZero::get);
    // More on a few processors wait for each other without an end.
    let threads = if threads == 0 { available } else { threads.min((4 * available).max(64)) };
    let made = ThreadPoolBuilder::new().num_threads(threads).thread_name(|index| format!("lacuna-{index}"));
    made.build().map_err(|error| PyRuntimeError::new_err(format!("threads: cannot start {threads}: {error}")))
}

/// Does a task in a pool. A signal that Python raises for ends it, and is what the call raises.
#[expect(
    clippy::redundant_closure_for_method_calls,
    reason = "the method is not general enough in its lifetime"
)]
pub fn run<T: Send>(
    py: Python<'_>,
    pool: &ThreadPool,
    task: impl FnOnce(&Run<'_>) -> Result<T, Error> + Send,
) -> PyResult<T> {
    let cancelled = AtomicBool::new(false);
    let stop = || cancelled.load(Ordering::Relaxed).then_some(Stop::Cancelled);
    py.detach(|| {
        thread::scope(|scope| {
            let (ended, end) = mpsc::channel::<()>();
            let work = scope.spawn(|| {
                let _ended = ended;
                pool.install(|| task(&Run { interrupt: Some(&stop) }))
            });
            let mut raised = None;
            while let Err(mpsc::RecvTimeoutError::Timeout) = end.recv_timeout(LISTEN) {
                if raised.is_none() {
                    raised = Python::try_attach(|py| py.check_signals()).and_then(Result::err);
                    cancelled.store(raised.is_some(), Ordering::Relaxed);
                }
            }
            let result = work.join();
            match (raised, result) {
                (Some(error), _) => Err(error),
                (None, Ok(Ok(value))) => Ok(value),
                (None, Ok(Err(error))) => Err(refusal(&error)),
                (None, Err(_)) => Err(PyRuntimeError::new_err("an error in lacuna itself; please report it")),
            }
        })
    })
}

/// What Python raises, the name of the argument first.
pub fn refusal(error: &Error) -> PyErr {
    let argument = match error {
        Error::EmptyMask => "mask",
        Error::NoPairs => {
            let line = "mask: cs-gradient needs measured pixels side by side, and there are none: add some, or take another filter";
            return PyValueError::new_err(line);
        }
        Error::NothingWeighs => "weights",
        Error::SparseGuide { .. } => "guides",
        Error::NoMethod { .. } | Error::NoDictionary => "filter",
        Error::NoSetting { .. } => "settings",
        Error::Setting { name, .. } => {
            return PyValueError::new_err(match *name {
                "density" | "temporal" => error.to_string(),
                // Sizes are checked before; what is left is what a grid asks for.
                "scale" | "gaussian" => format!("sampling: {error}"),
                _ => format!("settings: {error}"),
            });
        }
        Error::NothingFinite { plane } => {
            let line = format!("image: channel {plane} (from 0) has no measured value that is finite");
            return PyValueError::new_err(line);
        }
        _ => "image",
    };
    PyValueError::new_err(format!("{argument}: {error}"))
}
