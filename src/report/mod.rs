//! The comparison of frames with their references: a model first, then its formats.
//!
//! ```text
//! two frames ─> groups (what belongs together) ─> compare (measures, maps) ─> model ─> json | csv | markdown | html
//!                                                                              └────> gate (exit status)
//! ```
//!
//! Every format and the gate read the same [`Comparison`]: one set of numbers.

mod compare;
mod csv;
mod flicker;
mod gate;
mod groups;
mod html;
mod images;
mod maps;
mod markdown;
mod measure;
mod model;
#[cfg(test)]
mod tests;
mod values;
mod windows;

pub use compare::{Error, compare};
pub use csv::csv;
pub(crate) use csv::csv_line;
pub use flicker::{Changed, Colours, Flicker, Pair};
pub use gate::{Bound, Gate, GateError, why_unknown};
pub use groups::Kind;
pub(crate) use html::{Filled, FilledPictures, base64, escape, filled, shell};
pub use html::{MOST_PIXELS, Picture, html};
pub use images::Images;
pub use maps::Maps;
pub(crate) use markdown::escape as escape_markdown;
pub use markdown::markdown;
pub use measure::{Measure, Wanted};
pub use model::{Comparison, FrameReport, GroupReport, Mean, Measures, RegionReport, Settings};
pub use windows::of_headers;
