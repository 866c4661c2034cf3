//! Frames one after another: names and numbers, the plan, the schedule, what is said on the way.

mod destination;
mod inputs;
pub mod pattern;
mod plan;
pub mod range;
pub mod schedule;

pub use inputs::Selection;
pub use plan::{Item, Plan, PlanError, Targets, pair, plan};
