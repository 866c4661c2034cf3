//! One channel on its way: scaled to [0, 1], advanced by sweeps, judged by its duality gap.

use lacuna_core::parallel::prelude::*;

use super::nesta::Nesta;
use super::tighten::step_sizes;
use super::weights::Weights;
use super::{Settings, Solver};
use crate::kernel::Isa;
use crate::kernel::tv::{Bound, DualBall, bound_row, squares_row, variation_row};
use crate::prox::L2Ball;
use crate::solver::primal_dual::{BLOCK, Ball, State, Steps, Sweeps, smooth};
use crate::solver::sparsity::Samples;
use crate::{Outcome, Plane, Run, Size, Stop};

/// Primal step over the geometric mean of the start's mean gradient, of the image and near the pixel, at [`USUAL_DENSITY`]. A
/// step that follows the near one alone is as fast, but ends with flatter images.
const STEP: f64 = 0.8;
/// Where the near gradient is less than this share of the image's, it counts as this.
const FLATTEST: f64 = 0.01;
/// Primal step over the mean norm of the start's gradient where measured pixels may move: the same for all.
const HELD_STEP: f64 = 1.1;
/// Density at which the constants here were measured.
const USUAL_DENSITY: f64 = 0.2;
/// The farther apart the samples, the farther the minimiser from the start: the step grows as this power of
/// [`USUAL_DENSITY`] over the density.
const REACH: f64 = 0.75;
/// `tau sigma |grad|^2`, below 1; `|grad|^2 < 8`.
const PRODUCT: f64 = 0.99;
/// Over-relaxation.
const RHO: f32 = 1.6;
/// What a clipped f32 vector may be longer than 1.
const LONGER: f64 = 4.0 * f32::EPSILON as f64;
/// What the start's gradient over its mean norm is multiplied by before it is clipped: the dual variable's start.
const EAGER: f64 = 3.0;
/// Sweeps after which most frames at 20 % density have a gap of [`USUAL_GAP`]: there it is first evaluated.
const USUAL_SWEEPS: f64 = 40.0;
/// See [`USUAL_SWEEPS`].
const USUAL_GAP: f64 = 1e-2;
/// The gap falls about as this power of the sweeps from one look to the next.
const DECAY: f64 = 2.2;
/// And as this one to far smaller gaps.
const FAR_DECAY: f64 = 2.4;
/// The sweeps grow as this power of [`USUAL_DENSITY`] over the density. Denser samples get no fewer, for the image's sake.
const LATER: f64 = 0.9;

/// A channel's solver.
pub struct Channel {
    low: f64,
    range: f64,
    state: State,
    /// Only where NESTA solves.
    nesta: Option<Box<Nesta>>,
    /// Scaled samples (anything at missing pixels); only where measured pixels may move.
    sample: Option<Vec<f32>>,
    radius: f64,
    steps: Steps,
    /// Best lower bound of the objective so far.
    bound: f64,
    gap: f64,
    iterations: usize,
    next_check: usize,
    stop: Option<Stop>,
}

/// What all channels share.
#[derive(Clone, Copy)]
pub struct Shared<'a> {
    /// What is asked for.
    pub settings: &'a Settings,
    /// Height and width.
    pub size: Size,
    /// 1 where a pixel is missing.
    pub free: &'a [u8],
    /// Where measured pixels may move.
    pub ball: &'a Weights,
    /// Which pixels are not missing.
    pub measured: &'a [bool],
    /// Measured pixels over all pixels.
    pub density: f64,
    /// Instruction set.
    pub isa: Isa,
}

impl Shared<'_> {
    /// How much sparser than usual the samples are.
    fn sparsity(&self) -> f64 {
        USUAL_DENSITY / self.density
    }

    /// What the steps grow by with the samples' distance.
    fn reach(&self) -> f64 {
        self.sparsity().powf(REACH)
    }
}

impl Channel {
    /// Starts from `start`, which holds the samples at measured pixels and a guess elsewhere. The measured values
    /// span `low..=high`, which differ.
    pub fn new<B: DualBall>(shared: Shared<'_>, start: &Plane, low: f64, high: f64) -> Self {
        let range = high - low;
        let scale = |v: f32| ((f64::from(v) - low) / range).clamp(0.0, 1.0) as f32;
        let state = State::new(shared.size, start.pixels(), scale);
        let nesta = (shared.settings.solver == Solver::Nesta).then(|| Box::new(Nesta::new(state.x.len())));
        let sample = (shared.settings.epsilon > 0.0).then(|| state.x.to_vec());
        let mut channel = Self {
            low,
            range,
            state,
            nesta,
            sample,
            radius: shared.ball.radius / range,
            steps: Steps::uniform(shared.size, 1.0, PRODUCT),
            bound: 0.0,
            gap: 1.0,
            iterations: 0,
            next_check: first_check(shared.settings.gap, shared.sparsity()),
            stop: None,
        };
        channel.start::<B>(shared);
        channel
    }

    /// Chooses the step sizes by the start, and the dual variable's.
    fn start<B: DualBall>(&mut self, shared: Shared<'_>) {
        let mut near = self.steepness::<B>(shared.isa);
        let blocks = near.len() as f64;
        let mean = (near.iter().sum::<f64>() / blocks).max(f64::from(f32::EPSILON));
        let scale = if self.sample.is_some() { HELD_STEP } else { STEP } * shared.reach();
        self.steps = if self.sample.is_some() {
            Steps::uniform(shared.size, scale * mean, PRODUCT)
        } else {
            smooth(shared.size.width.div_ceil(BLOCK), &mut near);
            let tau = |near: &f64| scale * mean * (near / mean).max(FLATTEST).sqrt();
            let tau: Vec<f64> = near.iter().map(tau).collect();
            Steps::of_blocks(shared.size, &tau, PRODUCT)
        };
        let eager = EAGER * scale * 8.0 / PRODUCT;
        self.state.point_along_gradient::<B>(shared.isa, &self.steps, eager as f32);
    }

    /// The mean norm of the gradient in each block of the step sizes; differences across its right edge do not count.
    fn steepness<B: DualBall>(&self, isa: Isa) -> Vec<f64> {
        let Size { height, width } = self.state.size;
        let (rows, columns) = (height.div_ceil(BLOCK), width.div_ceil(BLOCK));
        let of_rows = |block: usize| {
            let mut sums = vec![0.0; columns];
            let (first, end) = (block * BLOCK, ((block + 1) * BLOCK).min(height));
            for y in first..end {
                let row = |y: usize| &self.state.x[y.min(height - 1) * width..][..width];
                let pieces = row(y).chunks(BLOCK).zip(row(y + 1).chunks(BLOCK)).zip(&mut sums);
                pieces.for_each(|((here, below), sum)| {
                    *sum += variation_row::<B>(isa, here, below) / (here.len() * (end - first)) as f64;
                });
            }
            sums
        };
        (0..rows).into_par_iter().map(of_rows).concat()
    }

    /// Whether it has stopped.
    pub fn done(&self) -> bool {
        self.stop.is_some()
    }

    /// Takes up to `count` sweeps, with the gap evaluated when it is due.
    pub fn advance<B: DualBall>(&mut self, shared: Shared<'_>, count: usize) {
        let limit = shared.settings.max_iterations;
        let mut left = count;
        while left > 0 && self.stop.is_none() {
            let due = self.next_check.min(limit);
            let sweeps = left.min(due.saturating_sub(self.iterations));
            self.sweep::<B>(shared, sweeps);
            left -= sweeps;
            if self.iterations >= due {
                self.judge::<B>(shared);
            }
        }
    }

    fn sweep<B: DualBall>(&mut self, shared: Shared<'_>, count: usize) {
        let sweeps = Sweeps { free: shared.free, steps: &self.steps, rho: RHO, isa: shared.isa };
        match &self.sample {
            None => self.state.advance::<B>(sweeps, count),
            Some(sample) => {
                let ball = Ball { sample, ease: &shared.ball.ease, radius: self.radius };
                self.state.advance_in_ball::<B>(sweeps, ball, count);
            }
        }
        self.iterations += count;
    }

    /// Takes one step of NESTA, if that is the solver, and evaluates the gap; whether it is.
    pub fn step<B: DualBall>(&mut self, shared: Shared<'_>, run: &Run<'_>) -> bool {
        let Some(nesta) = &mut self.nesta else { return false };
        let fixed = self.sample.is_none().then(|| self.state.x.to_vec());
        let samples = Samples {
            values: self.sample.as_ref().or(fixed.as_ref()).map_or(&[], Vec::as_slice),
            measured: shared.measured,
            radius: self.radius,
        };
        let limit = shared.settings.max_iterations - self.iterations;
        let (iterations, ended) = nesta.step::<B>(&mut self.state, samples, limit, run);
        self.iterations += iterations;
        match ended {
            Some(stop) => self.interrupt::<B>(shared, stop),
            None => self.judge::<B>(shared),
        }
        true
    }

    /// Evaluates the gap with a tightened dual variable, and decides when to look again.
    fn judge<B: DualBall>(&mut self, shared: Shared<'_>) {
        self.certify::<B>(shared, true);
        let Settings { gap, max_iterations, .. } = *shared.settings;
        if self.gap <= gap {
            self.stop = Some(Stop::Converged);
        } else if self.iterations >= max_iterations {
            self.stop = Some(Stop::IterationLimit);
        }
        // Looking costs about twenty sweeps.
        let factor = (self.gap / gap).powf(1.0 / DECAY).clamp(1.1, 2.0);
        self.next_check = (self.iterations as f64 * factor) as usize + 1;
    }

    /// Ends early, with the gap of the image as it is.
    pub fn interrupt<B: DualBall>(&mut self, shared: Shared<'_>, stop: Stop) {
        self.certify::<B>(shared, false);
        self.stop = Some(stop);
    }

    /// Makes the image feasible and the dual variable a good bound, and evaluates the gap. The solver goes on from
    /// both, which saves it about a tenth of its sweeps; as there are ever fewer looks, it converges as before.
    fn certify<B: DualBall>(&mut self, shared: Shared<'_>, tight: bool) {
        self.make_feasible(shared);
        let objective = self.variation::<B>(shared.isa);
        let steps = if tight { step_sizes(shared.sparsity()) } else { vec![0.0] };
        self.state.repair::<B>(shared.isa, shared.free, &steps);
        let bound = self.dual_bound(shared);
        self.bound = self.bound.max(bound);
        self.gap = if objective > 0.0 { ((objective - self.bound) / objective).max(0.0) } else { 0.0 };
    }

    /// Clamps missing pixels to the measured range and, where measured pixels may move, projects these on the ball.
    /// Both shorten the distance to the solution.
    fn make_feasible(&mut self, shared: Shared<'_>) {
        let keep = match &self.sample {
            None => 1.0,
            Some(sample) => {
                let width = shared.size.width.max(1);
                let rows = self.state.x.par_chunks(width).zip(sample.par_chunks(width));
                let rows = rows.zip(shared.free.par_chunks(width).zip(shared.ball.ease.par_chunks(width)));
                let rows = rows.map(|((x, sample), (free, ease))| -> f64 {
                    let both = x.iter().zip(sample).zip(free.iter().zip(ease));
                    both.map(|((x, s), (&f, &e))| f64::from(1 - f) * f64::from(x - s).powi(2) / f64::from(e))
                        .sum()
                });
                L2Ball { radius: self.radius }.keep(rows.iter().sum::<f64>().sqrt()) as f32
            }
        };
        let x = self.state.x.par_iter_mut().zip(shared.free);
        match &self.sample {
            None => x.for_each(|(x, _)| *x = x.clamp(0.0, 1.0)),
            Some(sample) => x.zip(sample).for_each(|((x, &free), &sample)| {
                let held = if free == 1 { *x } else { sample + keep * (*x - sample) };
                *x = held.clamp(0.0, 1.0);
            }),
        }
    }

    /// The objective, of the scaled image.
    fn variation<B: DualBall>(&self, isa: Isa) -> f64 {
        let Size { height, width } = self.state.size;
        let row = |y: usize| &self.state.x[y * width..][..width];
        let rows = (0..height).into_par_iter();
        rows.map(|y| variation_row::<B>(isa, row(y), row((y + 1).min(height - 1)))).iter().sum()
    }

    /// A lower bound of the objective over all feasible images within [0, 1]; at least 0.
    fn dual_bound(&self, shared: Shared<'_>) -> f64 {
        let width = shared.size.width;
        let zeros = vec![0.0; width];
        let sample = self.sample.as_deref().unwrap_or(&self.state.x);
        let rows = (0..shared.size.height).into_par_iter().map(|y| {
            let row = self.state.primal_row(y, &zeros, shared.free);
            let sums = bound_row(shared.isa, &sample[y * width..][..width], row);
            match shared.ball.ease.get(y * width..(y + 1) * width) {
                Some(ease) => Bound { squares: squares_row(shared.isa, ease, row), ..sums },
                None => sums,
            }
        });
        let sum = rows.into_iter().fold(Bound::default(), |a, b| a + b);
        let ball = if self.sample.is_some() { self.radius * sum.squares.sqrt() } else { 0.0 };
        ((sum.measured + sum.missing - ball) / (1.0 + LONGER)).max(0.0)
    }

    /// Writes the image, at missing pixels only unless measured pixels may move.
    pub fn write(&self, shared: Shared<'_>, out: &mut Plane) {
        let (low, high) = (self.low, self.low + self.range);
        let moves = self.sample.is_some();
        let x = self.state.x.par_iter().zip(shared.free);
        out.pixels_mut().par_iter_mut().zip(x).for_each(|(out, (&x, &free))| {
            if moves || free == 1 {
                *out = (low + self.range * f64::from(x)).clamp(low, high) as f32;
            }
        });
    }

    /// How it ended.
    pub fn outcome(&self) -> Outcome {
        Outcome {
            stop: self.stop.unwrap_or(Stop::IterationLimit),
            iterations: self.iterations,
            gap: Some(self.gap),
            ..Outcome::direct()
        }
    }
}

/// When to evaluate the gap for the first time.
fn first_check(gap: f64, sparsity: f64) -> usize {
    let sweeps = USUAL_SWEEPS * (USUAL_GAP / gap).powf(1.0 / FAR_DECAY) * sparsity.max(1.0).powf(LATER);
    sweeps.clamp(16.0, 400.0) as usize
}
