//! NESTA for total variation: the same objective, by smoothing instead of a saddle point; as the thesis solved it.
//!
//! Each step of the continuation lowers the smoothing to a third and the tolerance to a twentieth, and ends when the smoothed
//! objective settles within that. Its dual
//! point `clip(grad x / mu)` then gives the same certificate as the primal-dual sweeps', so that the gap means the same.
//!
//! Cost: an iteration is two passes over the image and four vectors beside it. Memory: five planes a channel more.
//!
//! Source: S. Becker, J. Bobin, E. Candes, "NESTA: A Fast and Accurate First-Order Method for Sparse Recovery", SIAM Journal
//! on Imaging Sciences 4(1), 2011, section 6.1 (total variation).

use std::marker::PhantomData;

use lacuna_core::parallel::prelude::*;

use crate::kernel::tv::DualBall;
use crate::solver::nesta::{Buffers, Step};
use crate::solver::primal_dual::State;
use crate::solver::sparsity::{Entry, Samples, Sparsity};
use crate::{Run, Size, Stop};

/// What the smoothing is multiplied by from step to step.
const LOWER: f64 = 1.0 / 3.0;
/// The first smoothing, of images scaled to 0..1.
const FIRST: f64 = 0.1;
/// Relative variation at which the first step ends.
const SETTLED: f64 = 1e-3;
/// What it is multiplied by from step to step: a dual point that proves something needs small gradients, and these fall
/// with the root of the objective's variation times the smoothing.
const STRICTER: f64 = 0.05;
/// The least smoothing and the least variation that f32 resolves.
const LEAST: [f64; 2] = [1e-7, 1e-9];

/// The solver's own state beside the image and its dual variable.
#[derive(Clone, Debug)]
pub struct Nesta {
    buffers: Buffers,
    mu: f64,
    tolerance: f64,
}

impl Nesta {
    /// For images of so many pixels.
    pub fn new(pixels: usize) -> Self {
        Self { buffers: Buffers::new(pixels), mu: FIRST, tolerance: SETTLED }
    }

    /// One step of the continuation, which leaves its dual point in `state`; how many iterations it took, and whether
    /// the caller ended it.
    pub fn step<B: DualBall>(
        &mut self,
        state: &mut State,
        samples: Samples<'_>,
        limit: usize,
        run: &Run<'_>,
    ) -> (usize, Option<Stop>) {
        let operator = Differences::<B> { size: state.size, ball: PhantomData };
        let mut work = operator.work();
        let step = Step { operator: &operator, samples, mu: self.mu, tolerance: self.tolerance };
        let (iterations, stop) = step.solve(&mut state.x, &mut self.buffers, &mut work, limit, run);
        operator.analyse(&state.x, &mut work);
        operator.soften(&mut work, self.mu);
        let dual = state.vertical.par_iter_mut().zip(state.horizontal.par_iter_mut());
        dual.zip(&work).for_each(|((vertical, horizontal), pair)| [*vertical, *horizontal] = pair.value);
        self.mu = (LOWER * self.mu).max(LEAST[0]);
        self.tolerance = (STRICTER * self.tolerance).max(LEAST[1]);
        let ended = matches!(stop, Stop::TimeLimit | Stop::Cancelled).then_some(stop);
        (iterations, ended)
    }
}

/// A gradient (vertical, horizontal), measured by the norm of a ball.
#[derive(Debug)]
pub struct Pair<B> {
    value: [f32; 2],
    ball: PhantomData<B>,
}

impl<B> Clone for Pair<B> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<B> Copy for Pair<B> {}

impl<B> Pair<B> {
    fn new(value: [f32; 2]) -> Self {
        Self { value, ball: PhantomData }
    }
}

impl<B: DualBall> Entry for Pair<B> {
    fn magnitude(self) -> f32 {
        B::norm(f64::from(self.value[0]), f64::from(self.value[1])) as f32
    }
    fn clip(self) -> Self {
        let (a, b) = B::clip(self.value[0], self.value[1]);
        Self::new([a, b])
    }
    fn dot(self, other: Self) -> f32 {
        self.value[0] * other.value[0] + self.value[1] * other.value[1]
    }
    fn times(self, factor: f32) -> Self {
        Self::new(self.value.map(|value| factor * value))
    }
    fn plus(self, other: Self, factor: f32) -> Self {
        Self::new([self.value[0] + factor * other.value[0], self.value[1] + factor * other.value[1]])
    }
}

/// The differences of the module [`super`], zero beyond the last row and column.
#[derive(Debug)]
struct Differences<B> {
    size: Size,
    ball: PhantomData<B>,
}

impl<B: DualBall> Sparsity for Differences<B> {
    type Entry = Pair<B>;
    type Work = Vec<Pair<B>>;

    fn work(&self) -> Self::Work {
        vec![Pair::new([0.0; 2]); self.size.pixels()]
    }

    fn analyse(&self, x: &[f32], work: &mut Self::Work) {
        let Size { height, width } = self.size;
        work.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let here = &x[y * width..][..width];
            let below = if y + 1 < height { &x[(y + 1) * width..][..width] } else { here };
            for (j, pair) in row.iter_mut().enumerate() {
                let right = if j + 1 < width { here[j + 1] } else { here[j] };
                *pair = Pair::new([below[j] - here[j], right - here[j]]);
            }
        });
    }

    fn adjoint(&self, work: &mut Self::Work, x: &mut [f32]) {
        let Size { height, width } = self.size;
        let dual = &*work;
        x.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let here = &dual[y * width..][..width];
            for (j, x) in row.iter_mut().enumerate() {
                let above = if y > 0 { dual[(y - 1) * width + j].value[0] } else { 0.0 };
                let left = if j > 0 { here[j - 1].value[1] } else { 0.0 };
                let own = [
                    if y + 1 < height { here[j].value[0] } else { 0.0 },
                    if j + 1 < width { here[j].value[1] } else { 0.0 },
                ];
                *x = above - own[0] + left - own[1];
            }
        });
    }

    fn entries<'a>(&self, work: &'a mut Self::Work) -> &'a mut [Pair<B>] {
        work
    }

    fn row(&self) -> usize {
        self.size.width
    }

    fn bound(&self) -> f64 {
        8.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::tv::{Anisotropic, Isotropic};

    fn image(size: Size, seed: usize) -> Vec<f32> {
        (0..size.pixels()).map(|i| ((i * 7919 + seed) % 101) as f32 / 50.0 - 1.0).collect()
    }

    #[test]
    fn the_adjoint_is_one_and_the_bound_holds() {
        for (height, width) in [(1, 1), (1, 6), (7, 1), (5, 8), (16, 9)] {
            let size = Size::new(height, width);
            let operator = Differences::<Isotropic> { size, ball: PhantomData };
            let (x, y) = (image(size, 1), image(size, 29));
            let (mut of_x, mut of_y) = (operator.work(), operator.work());
            operator.analyse(&x, &mut of_x);
            operator.analyse(&y, &mut of_y);
            let dot = |a: &[Pair<Isotropic>], b: &[Pair<Isotropic>]| -> f64 {
                a.iter().zip(b).map(|(a, b)| f64::from(a.dot(*b))).sum()
            };
            let (left, own) = (dot(&of_x, &of_y), dot(&of_x, &of_x));
            let mut back = vec![0.0; x.len()];
            operator.adjoint(&mut of_y, &mut back);
            let inner =
                |a: &[f32], b: &[f32]| -> f64 { a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum() };
            assert!((left - inner(&x, &back)).abs() <= 1e-5 * x.len() as f64, "{size}");
            assert!(own <= 8.0 * inner(&x, &x), "{size}");
        }
    }

    /// The gradient of the smoothed norm is that of its finite differences, for both balls.
    #[test]
    fn softened_entries_are_the_gradient_of_the_smoothed_norm() {
        fn check<B: DualBall>() {
            let size = Size::new(1, 1);
            let operator = Differences::<B> { size, ball: PhantomData };
            let smooth = |a: f32, b: f32| {
                let mut work = vec![Pair::<B>::new([a, b])];
                let value = operator.soften(&mut work, 0.5);
                (value, work[0].value)
            };
            for (a, b) in [(0.1, 0.2), (0.9, -0.3), (-2.0, 1.0), (0.3, 4.0)] {
                let (_, u) = smooth(a, b);
                let h = 1e-2;
                let slopes = [
                    (smooth(a + h, b).0 - smooth(a - h, b).0) / f64::from(2.0 * h),
                    (smooth(a, b + h).0 - smooth(a, b - h).0) / f64::from(2.0 * h),
                ];
                for (u, slope) in u.into_iter().zip(slopes) {
                    assert!((f64::from(u) - slope).abs() < 1e-3, "{a} {b}: {u} {slope}");
                }
            }
        }
        check::<Isotropic>();
        check::<Anisotropic>();
    }
}
