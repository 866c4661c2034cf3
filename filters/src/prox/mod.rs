//! Proximal maps: the point that minimises a simple convex function plus half the squared distance from here.
//!
//! Written for one point or one factor at a time, in f64; fast loops over rows stand in the kernels and are
//! compared with these.

mod gradient_norm;
mod l2_ball;

pub use gradient_norm::Norm;
pub use l2_ball::L2Ball;
