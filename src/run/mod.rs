//! How the frames of a plan are worked through: schedule, threads, memory, signals, what is said and recorded on the way.
//!
//! ```text
//! plan ─> batch (schedule, memory, signals) ─> console, record, ledger
//!            └─ a command's `Work`: one frame each
//! ```

pub(crate) mod batch;
pub(crate) mod console;
pub(crate) mod existing;
pub(crate) mod ledger;
pub(crate) mod memory;
pub(crate) mod outputs;
pub(crate) mod record;
pub(crate) mod schedule;
pub(crate) mod signals;
pub(crate) mod threads;

pub use batch::RunOptions;
pub use console::{Meter, Verbosity, openjd_fail};
pub use existing::{CUT_SHORT, Existing};
pub use memory::granted as granted_memory;
pub use schedule::message as panic_message;
pub use signals::survive_size_limit;
