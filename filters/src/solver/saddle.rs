//! The second opinion on l1 problems: primal-dual steps on the norm itself, nothing smoothed.
//!
//! For `min_x max_{|q|_inf <= 1} <U x, q>` subject to `|S x - y|_2 <= epsilon`, with `tau sigma |U|^2 < 1` and `P` the projection,
//!
//! ```text
//! x' = P(x - tau U^T q),  q' = clip(q + sigma U (2 x' - x))
//! ```
//!
//! until the objective settles over ten iterations, as in [`super::nesta`]. That bounds no distance from the minimum: at a tolerance of
//! 1e-2 the objective may be twice as large.
//!
//! Cost: an iteration is one `U` and one `U^T`. Memory: two images and a set of entries beside `x`, and the operator's buffers.
//!
//! Source: A. Chambolle, T. Pock, "A First-Order Primal-Dual Algorithm for Convex Problems with Applications to Imaging",
//! JMIV 40, 2011 (algorithm 1).

use lacuna_core::parallel::prelude::*;

use super::nesta::{Goal, project};
use super::sparsity::{Ending, Entry, ROW, Samples, Settling, Sparsity};
use crate::{Run, Stop};

/// `tau sigma |U|^2`.
const PRODUCT: f64 = 0.99;
/// Primal step for entries of size 1: images move by thousandths of their range, dual variables by units.
const STEP: f64 = 0.05;

/// Improves `x`, whose entries are of about the size `scale`. `goal.mu` is not used.
pub fn solve<S: Sparsity>(
    operator: &S,
    samples: Samples<'_>,
    goal: Goal,
    scale: f64,
    x: &mut [f32],
    run: &Run<'_>,
) -> Ending {
    let mut work = operator.work();
    project(samples, x);
    let tau = STEP * scale / operator.bound().sqrt();
    let sigma = PRODUCT / (tau * operator.bound());
    operator.analyse(x, &mut work);
    let mut dual: Vec<S::Entry> = operator.entries(&mut work).iter().map(|entry| entry.times(0.0)).collect();
    let (mut gradient, mut over) = (vec![0.0; x.len()], vec![0.0; x.len()]);
    let mut settling = Settling::default();
    let (mut stop, mut iterations) = (Stop::IterationLimit, 0);
    while iterations < goal.iterations {
        if let Some(ended) = run.interrupted() {
            stop = ended;
            break;
        }
        operator.entries(&mut work).copy_from_slice(&dual);
        operator.adjoint(&mut work, &mut gradient);
        over.copy_from_slice(x);
        let step = tau as f32;
        x.par_iter_mut().zip(&gradient).with_min_len(ROW).for_each(|(x, g)| *x -= step * g);
        project(samples, x);
        over.par_iter_mut().zip(&*x).with_min_len(ROW).for_each(|(over, x)| *over = 2.0 * x - *over);
        operator.analyse(&over, &mut work);
        let objective = operator.norm(&mut work);
        let entries = operator.entries(&mut work).par_iter();
        dual.par_iter_mut().zip(entries).with_min_len(ROW).for_each(|(dual, entry)| {
            *dual = dual.plus(*entry, sigma as f32).clip();
        });
        iterations += 1;
        if settling.enter(objective, goal.tolerance) {
            stop = Stop::Converged;
            break;
        }
    }
    operator.analyse(x, &mut work);
    let objective = operator.norm(&mut work);
    Ending { stop, iterations, objective, distance: samples.distance(|i| x[i]) }
}
