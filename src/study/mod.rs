//! Studies: every filter on every frame, pattern and density that a definition names; measured, plotted, judged.
//!
//! ```text
//! definition (TOML) ─> cells ─> run (sparse, fill, compare: the tool's own way) ─> rows (a line a cell, continued)
//!                                                                                   └─> figures, verdicts, page
//! sheets (pictures of a few cells) ─────────────────────────────────────────────────────────┘
//! ```
//!
//! A filter is named as on `fill`'s command line and goes through the same code, so that whatever `fill` can do a study can.

mod cell;
mod chart;
mod clock;
mod definition;
mod figures;
mod half;
mod page;
mod rows;
mod selection;
mod sheet;
mod subject;
#[cfg(test)]
mod tests;
mod verdict;

pub use cell::{Cell, Entry, cells, run};
pub use definition::{Definition, DefinitionError, SheetDefinition, SubjectDefinition, Thresholds};
pub use figures::{Figure, figures};
pub use page::page;
pub use rows::{Row, csv, journal, json, read_journal};
pub use selection::Selection;
pub use sheet::{Sheet, Tile, meets, sheet};
pub use subject::{Shot, Subject};
pub use verdict::{Verdict, tables, verdicts};
