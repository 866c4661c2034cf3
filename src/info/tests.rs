//! The model and the table of hand-built frames.
