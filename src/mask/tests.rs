//! Masks found in hand-built frames.
