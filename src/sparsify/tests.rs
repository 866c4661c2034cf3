//! Sparse frames from hand-built full ones.
