//! Filled frames with one thing wrong.
