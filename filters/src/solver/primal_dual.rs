//! The over-relaxed primal-dual iteration on a grid, several sweeps at a time over bands of rows.
//!
//! For `min_x max_q <grad x, q> + G(x)` with `q` in a unit ball at each pixel, one sweep is
//!
//! ```text
//! x' = prox_G(x - tau grad* q),  q' = clip(q + sigma grad(2 x' - x)),  (x, q) += rho ((x', q') - (x, q))
//! ```
//!
//! Source: A. Chambolle, T. Pock, "A First-Order Primal-Dual Algorithm for Convex Problems with Applications to
//! Imaging", JMIV 40, 2011 (algorithm 1); over-relaxation: L. Condat, "A Primal-Dual Splitting Method for Convex
//! Optimization Involving Lipschitzian, Proximable and Linear Composite Terms", JOTA 158, 2013 (algorithm 3.1).
//!
//! Several sweeps run over a band as a wavefront: sweep `s + 1` follows one row behind sweep `s`, so a row is touched
//! by all of them while it is in the cache. A band first copies the rows beyond its edges that those sweeps
//! depend on and computes them as well; each value is thus computed by the same operations on the same operands
//! whatever the bands, and neither their height, nor the number of sweeps in a block, nor threads change a bit.

mod rows;
mod steps;

use lacuna_core::parallel::prelude::*;

use crate::Size;
use crate::kernel::Isa;
use crate::kernel::aligned::Aligned;
use crate::kernel::tv::{
    DualBall, DualRow, HeldRow, PrimalRow, Rates, SweepRow, ball_row, distance_row, dual_row, repair_row,
    sweep_row,
};
use rows::Rows;
pub use steps::{BLOCK, Steps, smooth};

/// Rows of a band: the unit of work of a thread.
pub const BAND: usize = 128;

/// Sweeps that are done in one block at most.
pub const DEPTH: usize = 8;

/// Values of one row of a block that should fit the second-level cache: `x`, `q` and two rows of extrapolation.
const ROW_PLANES: usize = 5;

/// Bytes of cache that a block may count on.
const CACHE: usize = 1 << 20;

/// One field on the grid with its image and dual variable, row-major.
#[derive(Clone, Debug)]
pub struct State {
    /// Height and width.
    pub size: Size,
    /// The image.
    pub x: Aligned<f32>,
    /// Vertical dual variable; 0 in the last row.
    pub vertical: Aligned<f32>,
    /// Horizontal dual variable; 0 in the last column.
    pub horizontal: Aligned<f32>,
    edges: Vec<Edges>,
}

/// The rows on either side of a band as they were before a block: planes x, vertical, horizontal one after another.
#[derive(Clone, Debug, Default)]
struct Edges {
    above: Vec<f32>,
    below: Vec<f32>,
}

/// A constraint that fixed pixels lie within a ball round the samples: `sum (x - sample)^2 / ease <= radius^2`.
///
/// Its projection is a scaling where distances are measured by the same weights, that is, where a pixel's step is
/// `ease tau` (T. Pock, A. Chambolle, "Diagonal Preconditioning for First Order Primal-Dual Algorithms in Convex
/// Optimization", ICCV 2011).
#[derive(Clone, Copy, Debug)]
pub struct Ball<'a> {
    /// The samples, on the whole grid.
    pub sample: &'a [f32],
    /// The inverse of their weights, in (0, 1] at fixed pixels and 1 elsewhere.
    pub ease: &'a [f32],
    /// Radius.
    pub radius: f64,
}

impl<'a> Ball<'a> {
    fn row(self, at: std::ops::Range<usize>) -> HeldRow<'a> {
        HeldRow { sample: &self.sample[at.clone()], ease: &self.ease[at] }
    }
}

/// What all sweeps of a state share.
#[derive(Clone, Copy, Debug)]
pub struct Sweeps<'a> {
    /// 1 where a pixel may move freely, 0 where it is fixed.
    pub free: &'a [u8],
    /// Step sizes; in a ball they are the same everywhere.
    pub steps: &'a Steps,
    /// Over-relaxation, in (0, 2).
    pub rho: f32,
    /// Instruction set.
    pub isa: Isa,
}

/// What the sweeps of a block do.
#[derive(Clone, Copy, Debug)]
enum Kind<'a> {
    /// Fixed pixels stay.
    Fixed(Sweeps<'a>),
    /// Fixed pixels move within a ball; the number is the factor of its projection.
    Held(Sweeps<'a>, Ball<'a>, f32),
    /// Only the dual variable moves: the step sizes of as many sweeps.
    Repair(&'a [u8], &'a [f32], Isa),
}

impl State {
    /// Starts from what `scale` makes of an image of `size.pixels()` values, with a dual variable of 0.
    pub fn new(size: Size, image: &[f32], scale: impl Fn(f32) -> f32 + Sync) -> Self {
        let edges = vec![Edges::default(); size.height.div_ceil(BAND)];
        let zeros = || Aligned::zeros(image.len());
        Self { size, x: Aligned::map(image, scale), vertical: zeros(), horizontal: zeros(), edges }
    }

    /// Starts the dual variable at `eager sigma grad x`, clipped to the ball: where the image is steep it points along its
    /// gradient at the solution, too.
    pub fn point_along_gradient<B: DualBall>(&mut self, isa: Isa, steps: &Steps, eager: f32) {
        let width = self.size.width.max(1);
        let last = self.x.len().saturating_sub(width);
        let rows = self.vertical.par_chunks_mut(width).zip(self.horizontal.par_chunks_mut(width));
        rows.enumerate().for_each(|(y, (vertical, horizontal))| {
            let row = |y: usize| &self.x[(y * width).min(last)..][..width];
            let sigma: Vec<f32> = steps.sigma(y).iter().map(|sigma| eager * sigma).collect();
            let row = DualRow { over: row(y), below: row(y + 1), sigma: &sigma };
            vertical.fill(0.0);
            horizontal.fill(0.0);
            dual_row::<B>(isa, vertical, horizontal, row, 1.0);
        });
    }

    /// Takes `count` sweeps in which fixed pixels stay as they are.
    pub fn advance<B: DualBall>(&mut self, sweeps: Sweeps<'_>, count: usize) {
        let mut left = count;
        while left > 0 {
            // Blocks of one depth, nearly.
            let block = left.div_ceil(left.div_ceil(self.depth()));
            self.block::<B>(Kind::Fixed(sweeps), block);
            left -= block;
        }
    }

    /// Takes a step `q <- clip(q - alpha grad (free grad* q))` for each of `alphas`: projected descent on half the squared
    /// divergence at free pixels, whose curvature is below 8. Leaves `q` in its ball, to rounding; the image is not touched.
    pub fn repair<B: DualBall>(&mut self, isa: Isa, free: &[u8], alphas: &[f32]) {
        for alphas in alphas.chunks(self.depth()) {
            self.block::<B>(Kind::Repair(free, alphas, isa), alphas.len());
        }
    }

    /// Sweeps in a block.
    fn depth(&self) -> usize {
        (CACHE / (ROW_PLANES * size_of::<f32>() * self.size.width.max(1))).clamp(1, DEPTH)
    }

    /// Takes `count` sweeps in which fixed pixels move within a ball. Its projection needs a sum over all of them, so
    /// each sweep takes two passes.
    pub fn advance_in_ball<B: DualBall>(&mut self, sweeps: Sweeps<'_>, ball: Ball<'_>, count: usize) {
        for _ in 0..count {
            let distance = self.distance(sweeps, ball).sqrt();
            let keep = if distance > ball.radius { (ball.radius / distance) as f32 } else { 1.0 };
            self.block::<B>(Kind::Held(sweeps, ball, keep), 1);
        }
    }

    /// Squared distance of the next primal step from the samples, before its projection.
    fn distance(&self, sweeps: Sweeps<'_>, ball: Ball<'_>) -> f64 {
        let width = self.size.width;
        let zeros = vec![0.0; width];
        let rows = (0..self.size.height).into_par_iter().map(|y| {
            let row = self.primal_row(y, &zeros, sweeps.free);
            let at = y * width..(y + 1) * width;
            distance_row(sweeps.isa, &self.x[at.clone()], ball.row(at), row, sweeps.steps.tau(y)[0])
        });
        rows.iter().sum()
    }

    /// The dual variable round row `y`, as the row kernels take it; `zeros` is a row of zeros.
    pub fn primal_row<'a>(&'a self, y: usize, zeros: &'a [f32], free: &'a [u8]) -> PrimalRow<'a> {
        let width = self.size.width;
        let at = y * width..(y + 1) * width;
        PrimalRow {
            above: if y == 0 { zeros } else { &self.vertical[(y - 1) * width..y * width] },
            vertical: &self.vertical[at.clone()],
            horizontal: &self.horizontal[at.clone()],
            free: &free[at],
        }
    }

    /// Takes `depth` sweeps over every band.
    fn block<B: DualBall>(&mut self, kind: Kind<'_>, depth: usize) {
        let Size { height, width } = self.size;
        if width == 0 {
            return;
        }
        let planes: [&[f32]; 3] = [&self.x, &self.vertical, &self.horizontal];
        self.edges.par_iter_mut().enumerate().for_each(|(band, edges)| {
            let (first, end) = (band * BAND, ((band + 1) * BAND).min(height));
            edges.above.clear();
            edges.below.clear();
            for plane in planes {
                edges.above.extend_from_slice(&plane[first.saturating_sub(depth) * width..first * width]);
                edges.below.extend_from_slice(&plane[end * width..(end + depth).min(height) * width]);
            }
        });
        let bands = self.x.par_chunks_mut(BAND * width);
        let bands = bands.zip(self.vertical.par_chunks_mut(BAND * width));
        let bands = bands.zip(self.horizontal.par_chunks_mut(BAND * width)).zip(self.edges.par_iter_mut());
        bands.enumerate().for_each(|(band, (((x, vertical), horizontal), edges))| {
            let first = band * BAND;
            let rows = x.len() / width;
            let before = depth.min(first);
            let after = depth.min(height - first - rows);
            let mut above = edges.above.chunks_exact_mut((before * width).max(1));
            let mut below = edges.below.chunks_exact_mut((after * width).max(1));
            let [x, vertical, horizontal] = [x, vertical, horizontal].map(|own| Rows {
                above: above.next().unwrap_or_default(),
                own,
                below: below.next().unwrap_or_default(),
                first,
                width,
            });
            let front = Front {
                x,
                vertical,
                horizontal,
                over: Aligned::zeros(2 * depth * width + 1),
                edge: vec![0.0; 2 * width],
                from: first - before,
                to: first + rows + after,
                size: self.size,
            };
            front.run::<B>(kind, depth);
        });
    }
}

/// A block of sweeps over one band.
struct Front<'a> {
    x: Rows<'a>,
    vertical: Rows<'a>,
    horizontal: Rows<'a>,
    /// Two rows of extrapolated image for each sweep, of which fused steps use one, and one value more.
    over: Aligned<f32>,
    /// Two rows of zeros: the dual variable above the image.
    edge: Vec<f32>,
    /// First row that there are values of.
    from: usize,
    /// One past the last such row.
    to: usize,
    size: Size,
}

impl Front<'_> {
    fn run<B: DualBall>(mut self, kind: Kind<'_>, depth: usize) {
        for wave in self.from..self.to + depth - 1 {
            for sweep in 0..depth.min(wave + 1) {
                let y = wave - sweep;
                // Each sweep loses one row at an edge that is not the image's own.
                let start = if self.from == 0 { 0 } else { self.from + 1 + sweep };
                let end = if self.to == self.size.height { self.to } else { self.to - sweep };
                if y < start || y >= end {
                    continue;
                }
                match kind {
                    Kind::Held(sweeps, ball, keep) => {
                        self.primal(sweeps, (ball, keep), sweep, y);
                        if y > start {
                            self.dual::<B>(sweeps, sweep, y - 1, y);
                        }
                    }
                    _ => self.fused::<B>(kind, sweep, y),
                }
                if y + 1 == self.size.height {
                    self.last::<B>(kind, sweep, y);
                }
            }
        }
    }

    /// The primal step of row `y` and the dual step of the row above. At the first row of a sweep that row is beyond the
    /// image, or of the copies and not needed any more: what is written to it does not matter.
    fn fused<B: DualBall>(&mut self, kind: Kind<'_>, sweep: usize, y: usize) {
        let width = self.size.width;
        let over = &mut self.over[2 * sweep * width..][..=width];
        let at = y * width..(y + 1) * width;
        let (above, beside, vertical, horizontal) = if y == 0 {
            self.edge.fill(0.0);
            let (above, beside) = self.edge.split_at_mut(width);
            (above, beside, self.vertical.row(0), self.horizontal.row(0))
        } else {
            let (above, vertical) = self.vertical.pair(y);
            let (beside, horizontal) = self.horizontal.pair(y);
            (above, beside, vertical, horizontal)
        };
        match kind {
            Kind::Fixed(Sweeps { free, steps, rho, isa })
            | Kind::Held(Sweeps { free, steps, rho, isa }, ..) => {
                let rates = Rates { tau: steps.tau(y), sigma: steps.sigma(y.saturating_sub(1)), rho };
                let row = SweepRow { vertical, horizontal, free: &free[at] };
                sweep_row::<B>(isa, self.x.row_mut(y), over, above, beside, row, rates);
            }
            Kind::Repair(free, alphas, isa) => {
                let row = SweepRow { vertical, horizontal, free: &free[at] };
                repair_row::<B>(isa, over, above, beside, row, alphas[sweep]);
            }
        }
    }

    /// The dual step of the image's last row, which has no vertical gradient.
    fn last<B: DualBall>(&mut self, kind: Kind<'_>, sweep: usize, y: usize) {
        let width = self.size.width;
        let parity = if matches!(kind, Kind::Held(..)) { y % 2 } else { 0 };
        let over = &self.over[(2 * sweep + parity) * width..][..width];
        let (vertical, horizontal) = (self.vertical.row_mut(y), self.horizontal.row_mut(y));
        match kind {
            Kind::Fixed(Sweeps { steps, rho, isa, .. }) | Kind::Held(Sweeps { steps, rho, isa, .. }, ..) => {
                let row = DualRow { over, below: over, sigma: steps.sigma(y) };
                dual_row::<B>(isa, vertical, horizontal, row, rho);
            }
            Kind::Repair(_, _, isa) => {
                let ones = vec![1.0; width];
                let row = DualRow { over, below: over, sigma: &ones };
                dual_row::<B>(isa, vertical, horizontal, row, 1.0);
            }
        }
    }

    fn primal(&mut self, sweeps: Sweeps<'_>, (ball, keep): (Ball<'_>, f32), sweep: usize, y: usize) {
        let width = self.size.width;
        let over = &mut self.over[(2 * sweep + y % 2) * width..][..width];
        let at = y * width..(y + 1) * width;
        let row = PrimalRow {
            above: if y == 0 { &self.edge[..width] } else { self.vertical.row(y - 1) },
            vertical: self.vertical.row(y),
            horizontal: self.horizontal.row(y),
            free: &sweeps.free[at.clone()],
        };
        let rates = [sweeps.steps.tau(y)[0], sweeps.rho, keep];
        ball_row(sweeps.isa, self.x.row_mut(y), over, ball.row(at), row, rates);
    }

    /// The dual step of row `y`, with `below` the next row.
    fn dual<B: DualBall>(&mut self, sweeps: Sweeps<'_>, sweep: usize, y: usize, below: usize) {
        let width = self.size.width;
        let over = |y: usize| &self.over[(2 * sweep + y % 2) * width..][..width];
        let row = DualRow { over: over(y), below: over(below), sigma: sweeps.steps.sigma(y) };
        dual_row::<B>(sweeps.isa, self.vertical.row_mut(y), self.horizontal.row_mut(y), row, sweeps.rho);
    }
}

#[cfg(test)]
mod tests;
