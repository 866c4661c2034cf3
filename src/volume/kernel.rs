//! Interpolation within cells: values and gradients of eight samples, for all ways of interpolating.
//!
//! A kernel gathers the voxels of a cell once; the samples of a ray within the cell are computed from that copy. Weights
//! are computed for eight samples side by side, sums over voxels sample by sample over rows of voxels.
//!
//! The cubic kernels are separable: with `w` the weights of an axis and `w'` their derivatives,
//! `f = sum w_z w_y w_x c`, and a component of the gradient has `w'` in place of `w` on its axis. Value and
//! gradient share the sums over z and y: 84 multiplications for the value, 108 more for the gradient.
//!
//! The reckoning, per sample of a cubic kernel, in instructions on vectors of eight: 14 for the sum over z (8
//! multiplications, 6 sums), 7 on vectors of four over y, and an eighth of 7 over x; 29 for the gradient. Weights are an
//! eighth of 42 and of 30. A ray crosses a cell in 2/3 of a voxel on average, so that at a step of 1/4 the 16 loads,
//! conversions and stores of a gather serve 2.7 samples.
//!
//! Sources: T. Möller, R. Machiraju, K. Mueller, R. Yagel, "Evaluation and design of filters using a Taylor series
//! expansion", IEEE TVCG 3(2), 1997 (derivatives by the interpolant's own); M. Unser, "Splines: a perfect fit for signal
//! and image processing", IEEE Signal Processing Magazine 16(6), 1999 (cubic B-spline).

use super::grid::Grid;
use super::lanes::{LANES, Lanes, all};
use super::weights::Weights;

/// The voxels of some cells.
pub type Cells<K> = [<K as Kernel>::Taps; LANES];

/// How values between voxels are made.
///
/// Samples are given by the cell that each lies in (`slots`, one a sample) and by their places within it: x, y, z in 0 to
/// 1 from the cell's lowest corner.
pub trait Kernel: Copy + Send + Sync {
    /// The voxels of a cell.
    type Taps: Copy;
    /// What the values leave behind for the gradients.
    type Partial;
    /// Voxels before and after a cell's lowest corner that count: -before ..= after.
    const SUPPORT: (usize, usize);

    /// Cells of value 0.
    fn cells() -> Cells<Self>;
    /// Gathers the voxels of the cell that [`Grid::at`] gives.
    fn gather(self, grid: &Grid, at: usize, taps: &mut Self::Taps);
    /// The values.
    fn values(self, cells: &Cells<Self>, slots: &[u8], within: &[Lanes; 3]) -> (Lanes, Self::Partial);
    /// The gradients per index step of those samples whose bit is set in `wanted`; others are anything.
    fn gradients(
        self,
        cells: &Cells<Self>,
        slots: &[u8],
        within: &[Lanes; 3],
        partial: &Self::Partial,
        wanted: u32,
    ) -> [Lanes; 3];
    /// Bounds of the values of an interpolant whose voxels lie between `low` and `high`.
    fn widen(low: f32, high: f32) -> (f32, f32) {
        (low, high)
    }
}

/// The nearest voxel; its gradient is that of central differences around it.
#[derive(Clone, Copy, Debug)]
pub struct Nearest;
/// Linear along each axis.
#[derive(Clone, Copy, Debug)]
pub struct Linear;
/// Cubic along each axis, by its weights.
#[derive(Clone, Copy, Debug)]
pub struct Cubic<W>(pub W);

/// Four weights, for eight samples each.
type Four = [[f32; LANES]; 4];
/// A slice of `4 x 4` voxels, x fastest.
pub type Slice = [f32; 16];

/// The sums that values and gradients share.
#[derive(Clone, Copy, Debug)]
pub struct CubicPartial {
    /// Weights along x, y, z.
    along: [[Lanes; 4]; 3],
    /// Over z, one slice a sample.
    over_z: [Slice; LANES],
    /// Over z and y, along x.
    over_zy: [Lanes; 4],
}

impl<W: Weights> Kernel for Cubic<W> {
    /// Slices by z.
    type Taps = [Slice; 4];
    type Partial = CubicPartial;
    const SUPPORT: (usize, usize) = (1, 2);

    #[inline(always)]
    fn cells() -> Cells<Self> {
        [[[0.0; 16]; 4]; LANES]
    }

    #[inline(always)]
    fn gather(self, grid: &Grid, at: usize, taps: &mut Self::Taps) {
        grid.gather4(at, taps);
    }

    #[inline(always)]
    fn values(self, cells: &Cells<Self>, slots: &[u8], within: &[Lanes; 3]) -> (Lanes, CubicPartial) {
        // Written out: a map of arrays is a call.
        let along = [W::weights(within[0]), W::weights(within[1]), W::weights(within[2])];
        let (y, z) = (four(&along[1]), four(&along[2]));
        let mut over_z = [[0.0; 16]; LANES];
        let mut rows = [[0.0; 4]; LANES];
        for (lane, &slot) in slots.iter().enumerate().take(LANES) {
            over_z[lane] = sum_over_z(&cells[slot as usize % LANES], weight(&z, lane));
            rows[lane] = sum_over_y(&over_z[lane], weight(&y, lane));
        }
        let over_zy = transposed(&rows);
        (sum_over_x(&over_zy, &along[0]), CubicPartial { along, over_z, over_zy })
    }

    #[inline(always)]
    fn gradients(
        self,
        cells: &Cells<Self>,
        slots: &[u8],
        within: &[Lanes; 3],
        partial: &CubicPartial,
        wanted: u32,
    ) -> [Lanes; 3] {
        let CubicPartial { along, over_z, over_zy } = partial;
        let slopes = [W::derivatives(within[0]), W::derivatives(within[1]), W::derivatives(within[2])];
        let (y, slopes_y, slopes_z) = (four(&along[1]), four(&slopes[1]), four(&slopes[2]));
        let (mut along_y, mut along_z) = ([[0.0; 4]; LANES], [[0.0; 4]; LANES]);
        for (lane, &slot) in slots.iter().enumerate().take(LANES) {
            if wanted >> lane & 1 == 1 {
                along_y[lane] = sum_over_y(&over_z[lane], weight(&slopes_y, lane));
                let slope = sum_over_z(&cells[slot as usize % LANES], weight(&slopes_z, lane));
                along_z[lane] = sum_over_y(&slope, weight(&y, lane));
            }
        }
        [
            sum_over_x(over_zy, &slopes[0]),
            sum_over_x(&transposed(&along_y), &along[0]),
            sum_over_x(&transposed(&along_z), &along[0]),
        ]
    }

    fn widen(low: f32, high: f32) -> (f32, f32) {
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low) * W::GAIN);
        if W::GAIN > 1.0 { (middle - half, middle + half) } else { (low, high) }
    }
}

#[inline(always)]
fn four(weights: &[Lanes; 4]) -> Four {
    let [a, b, c, d] = *weights;
    [a.to_array(), b.to_array(), c.to_array(), d.to_array()]
}

/// The four weights of one sample.
#[inline(always)]
fn weight(weights: &Four, lane: usize) -> [f32; 4] {
    [weights[0][lane], weights[1][lane], weights[2][lane], weights[3][lane]]
}

#[inline(always)]
fn sum_over_z(taps: &[Slice; 4], [a, b, c, d]: [f32; 4]) -> Slice {
    let mut sum = [0.0; 16];
    for k in 0..16 {
        sum[k] = (a * taps[0][k] + b * taps[1][k]) + (c * taps[2][k] + d * taps[3][k]);
    }
    sum
}

#[inline(always)]
fn sum_over_y(slice: &Slice, [a, b, c, d]: [f32; 4]) -> [f32; 4] {
    let mut sum = [0.0; 4];
    for k in 0..4 {
        sum[k] = (a * slice[k] + b * slice[4 + k]) + (c * slice[8 + k] + d * slice[12 + k]);
    }
    sum
}

#[inline(always)]
fn sum_over_x(rows: &[Lanes; 4], weights: &[Lanes; 4]) -> Lanes {
    (weights[0] * rows[0] + weights[1] * rows[1]) + (weights[2] * rows[2] + weights[3] * rows[3])
}

/// From numbers by sample to samples by number.
#[inline(always)]
fn transposed<const N: usize>(rows: &[[f32; N]; LANES]) -> [Lanes; N] {
    std::array::from_fn(|k| Lanes::new(std::array::from_fn(|lane| rows[lane][k])))
}

impl Kernel for Linear {
    /// The corners: x fastest, then y, z.
    type Taps = [f32; 8];
    /// The corners of each sample's cell.
    type Partial = [Lanes; 8];
    const SUPPORT: (usize, usize) = (0, 1);

    #[inline(always)]
    fn cells() -> Cells<Self> {
        [[0.0; 8]; LANES]
    }

    #[inline(always)]
    fn gather(self, grid: &Grid, at: usize, taps: &mut Self::Taps) {
        grid.gather2(at, taps);
    }

    #[inline(always)]
    fn values(self, cells: &Cells<Self>, slots: &[u8], within: &[Lanes; 3]) -> (Lanes, [Lanes; 8]) {
        let mut taps = [[0.0; 8]; LANES];
        for (lane, &slot) in slots.iter().enumerate().take(LANES) {
            taps[lane] = cells[slot as usize % LANES];
        }
        let taps = transposed(&taps);
        let plane = mixed(within[2], &taps);
        let row = mixed::<4, 2>(within[1], &plane);
        let [value] = mixed::<2, 1>(within[0], &row);
        (value, taps)
    }

    #[inline(always)]
    fn gradients(
        self,
        _: &Cells<Self>,
        _: &[u8],
        within: &[Lanes; 3],
        taps: &[Lanes; 8],
        _: u32,
    ) -> [Lanes; 3] {
        let plane: [Lanes; 4] = mixed(within[2], taps);
        let row: [Lanes; 2] = mixed(within[1], &plane);
        let [along_y] = mixed(within[0], &[plane[2] - plane[0], plane[3] - plane[1]]);
        let slope: [Lanes; 4] = std::array::from_fn(|k| taps[4 + k] - taps[k]);
        let [along_z] = mixed(within[0], &mixed::<4, 2>(within[1], &slope));
        [row[1] - row[0], along_y, along_z]
    }
}

/// The first half of the numbers and the second half, mixed by `f`.
#[inline(always)]
fn mixed<const N: usize, const HALF: usize>(f: Lanes, values: &[Lanes; N]) -> [Lanes; HALF] {
    let g = all(1.0) - f;
    std::array::from_fn(|k| g * values[k] + f * values[HALF + k])
}

impl Kernel for Nearest {
    /// As the cubic kernels.
    type Taps = [Slice; 4];
    type Partial = ();
    const SUPPORT: (usize, usize) = (0, 1);

    #[inline(always)]
    fn cells() -> Cells<Self> {
        [[[0.0; 16]; 4]; LANES]
    }

    #[inline(always)]
    fn gather(self, grid: &Grid, at: usize, taps: &mut Self::Taps) {
        grid.gather4(at, taps);
    }

    #[inline(always)]
    fn values(self, cells: &Cells<Self>, slots: &[u8], within: &[Lanes; 3]) -> (Lanes, ()) {
        let mut values = [0.0; LANES];
        for (lane, &slot) in slots.iter().enumerate().take(LANES) {
            let [x, y, z] = nearest(within, lane);
            values[lane] = cells[slot as usize % LANES][z][4 * y + x];
        }
        (Lanes::new(values), ())
    }

    #[inline(always)]
    fn gradients(
        self,
        cells: &Cells<Self>,
        slots: &[u8],
        within: &[Lanes; 3],
        (): &(),
        _: u32,
    ) -> [Lanes; 3] {
        let mut slopes = [[0.0; 3]; LANES];
        for (lane, &slot) in slots.iter().enumerate().take(LANES) {
            let taps = &cells[slot as usize % LANES];
            let [x, y, z] = nearest(within, lane);
            slopes[lane] = [
                0.5 * (taps[z][4 * y + x + 1] - taps[z][4 * y + x - 1]),
                0.5 * (taps[z][4 * (y + 1) + x] - taps[z][4 * (y - 1) + x]),
                0.5 * (taps[z + 1][4 * y + x] - taps[z - 1][4 * y + x]),
            ];
        }
        transposed(&slopes)
    }
}

/// The nearest corner of the cell, as a tap: 1 or 2 on each axis.
#[inline(always)]
fn nearest(within: &[Lanes; 3], lane: usize) -> [usize; 3] {
    [0, 1, 2].map(|axis| 1 + usize::from(within[axis].as_array()[lane] >= 0.5))
}
