//! The tool as a process, module by module: one binary, so that one thing is linked.

#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    clippy::missing_panics_doc,
    clippy::print_stdout,
    reason = "tests fail by panicking, mean equal bits, and show counts"
)]

mod fill;
mod filled;
mod mask;
#[cfg(target_os = "linux")]
mod memory;
mod render;
#[cfg(unix)]
mod robust;
mod room;
