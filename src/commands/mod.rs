//! The subcommands: one short job each, run over the frames of a plan.

mod compare;
mod dictionary;
mod fill;
mod info;
mod manual;
mod mask;
mod page;
mod render;
mod sparsify;
mod study;
mod train;
mod verify;

pub use compare::{CompareJob, CompareOutputs, compare};
pub use dictionary::{DictionaryJob, DictionaryTask, dictionary};
pub use fill::{FillJob, fill};
pub use info::{InfoJob, info};
pub use manual::{ManualJob, manual};
pub use mask::{BoundFiles, MaskJob, MaskOutput, MaskTask, NextPass, Union, mask};
pub use render::{Pixels, RenderJob, Wanted, render};
pub use sparsify::{SparsifyJob, SparsifyPattern, sparsify};
pub use study::{StudyJob, study};
pub use train::{TrainJob, train};
pub use verify::{VerifyJob, verify};
