//! Frames one after another: names and numbers, the plan, the schedule, what is said on the way.
//!
//! ```text
//! inputs (pattern, range, glob, list) ─┐
//! destination ─────────────────────────┴─> plan ─> batch (schedule, memory, signals) ─> console, record
//!                                         └─ fill | render | sparsify | verify | compare: one frame each
//! ```

mod batch;
mod compare;
mod console;
mod destination;
mod encode;
mod fill;
mod globs;
mod identity;
mod info;
mod inputs;
mod layers;
mod ledger;
mod mask;
mod mask_passes;
mod masks;
mod memory;
mod names;
mod page;
pub mod pattern;
mod plan;
mod plans;
mod prepare;
pub mod range;
mod record;
mod render;
mod reports;
mod schedule;
mod signals;
mod sparsify;
mod study;
mod threads;
mod train;
mod update;
mod verify;

pub use batch::RunOptions;
pub use compare::{CompareJob, CompareOutputs, compare};
pub use console::{Meter, Verbosity, openjd_fail};
pub use encode::{DictionaryJob, DictionaryTask, dictionary};
pub use fill::{FillJob, fill};
pub use info::{InfoJob, info};
pub use inputs::{Selection, frame_numbers};
pub use layers::LayerSource;
pub use mask::{BoundFiles, MaskJob, MaskOutput, MaskTask, mask};
pub use mask_passes::{NextPass, Union};
pub use memory::granted as granted_memory;
pub use plan::{PlanError, Targets};
pub use render::{Pixels, RenderJob, render};
pub use schedule::message as panic_message;
pub use sparsify::{SparsifyJob, SparsifyPattern, sparsify};
pub use study::{StudyJob, study};
pub use train::{TrainJob, train};
pub use update::Existing;
pub use verify::{VerifyJob, verify};
