//! Variational methods: the image that minimises an energy and passes through (or near) the samples.

pub mod edge;
pub mod guided;
pub mod ss;
pub mod tv;
