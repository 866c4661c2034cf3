//! Makes a dual variable nearly free of divergence at missing pixels, so that its bound is close.
//!
//! Projected descent on `|M grad* q|^2 / 2` (`M` keeps the missing pixels), `q <- clip(q - alpha_k grad (M grad* q))`: about the work
//! of a sweep, blocked in time like it ([`State::repair`]). Without the clip, Chebyshev's step sizes on the
//! eigenvalues `lowest..8` of `M grad* grad M` are the best; in cycles of four, whose product stays harmless, they do
//! well with it, too. Any step sizes give a valid bound.
//!
//! A few exact projections on the divergence-free fields (conjugate gradients on the Poisson problem between two clips) need
//! as much work for a gap twice as large: it is the number of clips that counts. So do accelerated steps (FISTA), which overshoot.
//!
//! [`State::repair`]: crate::solver::primal_dual::State::repair

use std::f64::consts::PI;

/// Steps at the usual density; they grow with the samples' distance.
const STEPS: f64 = 16.0;
/// And no more than these.
const MOST_STEPS: f64 = 64.0;
/// Chebyshev's roots in an order in which no few in a row are all small: `cos(pi (k + 1/2) / 4)`.
const CYCLE: [f64; 4] = [0.5, 3.5, 1.5, 2.5];
/// Eigenvalues that are to be damped, at the usual density.
const LOWEST: f64 = 1.0;
/// Above the largest eigenvalue.
const HIGHEST: f64 = 8.0;

/// The step sizes for samples so many times as sparse as usual.
pub fn step_sizes(sparsity: f64) -> Vec<f32> {
    let count = (STEPS * sparsity.sqrt()).clamp(STEPS, MOST_STEPS) as usize;
    // An eigenvalue falls with the square of the samples' distance, that is, with their density.
    let lowest = LOWEST / sparsity.clamp(1.0, 16.0);
    let (middle, half) = (0.5 * (HIGHEST + lowest), 0.5 * (HIGHEST - lowest));
    let cycle = CYCLE.map(|root| (1.0 / (middle + half * (PI * root / 4.0).cos())) as f32);
    cycle.into_iter().cycle().take(count.next_multiple_of(CYCLE.len())).collect()
}
