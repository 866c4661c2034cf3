//! Whole fills of hand-built frames.
