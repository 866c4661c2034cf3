//! The volume: voxels with a border of copies, and where they lie in space.
//!
//! Voxel centres lie at integer index coordinates; the volume is the box `[0, n - 1]` along each axis. A cell is the
//! unit cube between voxel centres; cell `c` has its lowest corner at voxel `c`. A border of one voxel before and two
//! after (copies of the outermost ones) gives every cell its 4 x 4 x 4 voxels without a test.

use lacuna_core::parallel::prelude::*;
use wide::i32x4;

use super::prefilter::prefilter;
use super::vector::{Affine, Vector, length};
use super::{Error, Values};

/// Voxels of the border before the first one.
const BEFORE: usize = 1;
/// Voxels of the border behind the last one.
const AFTER: usize = 2;
/// Voxels of the border in all.
const BORDER: usize = BEFORE + AFTER;
/// Values are kept within this and its reciprocal: their sums, squares and reciprocals are floats.
const MOST: f64 = (1_u128 << 64) as f64;

/// A volume of `size[0] x size[1] x size[2]` voxels, x fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    size: [usize; 3],
    /// Voxels from one row to the next, and from one slice to the next, border included.
    strides: [usize; 2],
    voxels: Values,
    /// Index to world coordinates.
    placement: Affine,
    /// Least and largest value.
    range: (f64, f64),
    /// All that the voxels' type can hold, in data values.
    type_range: (f64, f64),
    /// What a kept value of 1 is in data values.
    unit: f64,
}

impl Grid {
    /// Takes `size[0] * size[1] * size[2]` values, x fastest.
    ///
    /// # Errors
    /// [`Error::Volume`] if the number of values is another, there are none, one is not finite, or the placement is
    /// flat.
    pub fn new(size: [usize; 3], values: &Values, placement: Affine) -> Result<Self, Error> {
        let count = size.iter().try_fold(1_usize, |product, &n| product.checked_mul(n));
        if count != Some(values.len()) || values.is_empty() {
            return Err(Error::Volume(format!("{} voxels instead of {size:?}", values.len())));
        }
        let flat = placement.determinant();
        if !flat.is_finite() || flat == 0.0 || placement.origin.iter().any(|x| !x.is_finite()) {
            return Err(Error::Volume("the axes of the voxels do not span space".into()));
        }
        // Beyond these squares and reciprocals leave the range of numbers.
        if let Some(edge) = placement.axes.map(length).into_iter().find(|edge| !(1e-30..=1e30).contains(edge))
        {
            return Err(Error::Volume(format!(
                "an edge of its voxels is {edge:e} long: 1e-30 to 1e30 can be rendered"
            )));
        }
        let range = values.range().ok_or_else(|| {
            Error::Volume(
                "a voxel is NaN, infinite or beyond 3.4e38: give it a number, such as that of the surroundings"
                    .into(),
            )
        })?;
        let unit = unit(range);
        let range = (range.0 / unit, range.1 / unit);
        let strides = [size[0] + BORDER, (size[0] + BORDER) * (size[1] + BORDER)];
        let voxels = match values {
            Values::U8(values) => Values::U8(pad(values, size)),
            Values::U16(values) => Values::U16(pad(values, size)),
            Values::I16(values) => Values::I16(pad(values, size)),
            Values::F32(values) => Values::F32(scaled(pad(values, size), unit)),
        };
        Ok(Self { size, strides, voxels, placement, range, type_range: values.type_range(), unit })
    }

    /// The same voxels, of a type that can hold these data values.
    #[must_use]
    pub(super) fn with_type_range(self, type_range: (f64, f64)) -> Self {
        Self { type_range, ..self }
    }

    /// The same voxels, which were made from those of another grid.
    #[must_use]
    pub(super) fn made_from(self, other: &Self) -> Self {
        Self { type_range: other.type_range, unit: self.unit * other.unit, ..self }
    }

    /// Voxels along x, y, z.
    pub const fn size(&self) -> [usize; 3] {
        self.size
    }

    /// Index to world coordinates.
    pub const fn placement(&self) -> &Affine {
        &self.placement
    }

    /// What a value of 1 is in data values: a power of two, and 1 unless those are huge or tiny.
    pub const fn unit(&self) -> f64 {
        self.unit
    }

    /// Least and largest value of all voxels as they were given.
    pub const fn range(&self) -> (f64, f64) {
        self.range
    }

    /// The full range of the voxels' type in their file, in data values: 0 to 1 for floats.
    pub const fn type_range(&self) -> (f64, f64) {
        self.type_range
    }

    /// Bytes that a voxel takes.
    pub const fn voxel_bytes(&self) -> u64 {
        match self.voxels {
            Values::U8(_) => 1,
            Values::U16(_) | Values::I16(_) => 2,
            Values::F32(_) => 4,
        }
    }

    /// The length of one voxel: that of the shortest axis, in world units.
    pub fn voxel(&self) -> f64 {
        self.placement.axes.iter().map(|&axis| length(axis)).fold(f64::INFINITY, f64::min)
    }

    /// The last index along each axis.
    pub fn last(&self) -> Vector {
        self.size.map(|n| (n - 1) as f64)
    }

    /// The value of the voxel.
    pub fn value(&self, index: [usize; 3]) -> f64 {
        let at = self.at(index) + self.corner();
        match &self.voxels {
            Values::U8(voxels) => voxels[at].into(),
            Values::U16(voxels) => voxels[at].into(),
            Values::I16(voxels) => voxels[at].into(),
            Values::F32(voxels) => voxels[at].into(),
        }
    }

    /// All values without the border, x fastest, as f32.
    pub fn values(&self) -> Vec<f32> {
        let [nx, ny, nz] = self.size;
        let mut values = vec![0.0; nx * ny * nz];
        values.par_chunks_mut(nx * ny).enumerate().for_each(|(z, slice)| {
            for (y, row) in slice.chunks_mut(nx).enumerate() {
                self.row(y, z, row);
            }
        });
        values
    }

    /// The values of one row, without the border.
    fn row(&self, y: usize, z: usize, out: &mut [f32]) {
        fn of<T: Copy + Into<f32>>(row: &[T], out: &mut [f32]) {
            for (out, &value) in out.iter_mut().zip(row) {
                *out = value.into();
            }
        }
        let at = self.at([0, y, z]) + self.corner();
        let place = at..at + self.size[0];
        match &self.voxels {
            Values::U8(voxels) => of(&voxels[place], out),
            Values::U16(voxels) => of(&voxels[place], out),
            Values::I16(voxels) => of(&voxels[place], out),
            Values::F32(voxels) => of(&voxels[place], out),
        }
    }

    /// Where the first voxel without the border stands.
    const fn corner(&self) -> usize {
        BEFORE * (1 + self.strides[0] + self.strides[1])
    }

    /// The grid of the coefficients of the cubic B-spline that goes through this one's values; its range stays that of
    /// the values.
    #[must_use]
    pub fn coefficients(&self) -> Self {
        let [width, area] = self.strides;
        let last = self.size.map(|n| BEFORE + n - 1);
        let mut voxels = vec![0.0; area * (self.size[2] + BORDER)];
        prefilter(&mut voxels[self.corner()..], self.size, self.strides, |y, z, row| self.row(y, z, row));
        voxels[BEFORE * area..][..self.size[2] * area].par_chunks_mut(area).for_each(|slice| {
            for row in slice.chunks_mut(width) {
                let (first, end) = (row[BEFORE], row[last[0]]);
                row[..BEFORE].fill(first);
                row[last[0] + 1..].fill(end);
            }
            spread(slice, width, last[1]);
        });
        spread(&mut voxels, area, last[2]);
        Self { voxels: Values::F32(voxels), ..self.empty() }
    }

    /// This grid without voxels.
    const fn empty(&self) -> Self {
        let Self { size, strides, placement, range, type_range, unit, .. } = *self;
        Self { size, strides, voxels: Values::F32(Vec::new()), placement, range, type_range, unit }
    }

    /// A grid made from this one's values without the border, in their own type.
    pub(super) fn mapped(
        &self,
        size: [usize; 3],
        placement: Affine,
        map: impl Fn(&Values) -> Values,
    ) -> Result<Self, Error> {
        let bare = match &self.voxels {
            Values::U8(voxels) => Values::U8(self.bare(voxels)),
            Values::U16(voxels) => Values::U16(self.bare(voxels)),
            Values::I16(voxels) => Values::I16(self.bare(voxels)),
            Values::F32(voxels) => Values::F32(self.bare(voxels)),
        };
        Ok(Self::new(size, &map(&bare), placement)?.made_from(self))
    }

    fn bare<T: Copy>(&self, voxels: &[T]) -> Vec<T> {
        let [nx, ny, nz] = self.size;
        let rows = (0..nz).flat_map(|z| (0..ny).map(move |y| self.at([0, y, z])));
        rows.flat_map(|start| &voxels[start + self.corner()..][..nx]).copied().collect()
    }

    /// Where the 4 x 4 x 4 voxels of a cell begin in the bordered array.
    #[inline(always)]
    pub(super) fn at(&self, cell: [usize; 3]) -> usize {
        cell[0] + cell[1] * self.strides[0] + cell[2] * self.strides[1]
    }

    /// The `4 x 4 x 4` voxels around a cell, from one before its lowest corner to two after: slices by z, x fastest. The
    /// cell is given by [`Grid::at`].
    #[inline(always)]
    pub(super) fn gather4(&self, at: usize, taps: &mut [[f32; 16]; 4]) {
        match &self.voxels {
            Values::U8(voxels) => gather4(voxels, at, self.strides, taps, whole),
            Values::U16(voxels) => gather4(voxels, at, self.strides, taps, whole),
            Values::I16(voxels) => gather4(voxels, at, self.strides, taps, whole),
            Values::F32(voxels) => gather4(voxels, at, self.strides, taps, |row| row),
        }
    }

    /// The `2 x 2 x 2` voxels at the corners of a cell: x fastest, then y, z.
    #[inline(always)]
    pub(super) fn gather2(&self, at: usize, taps: &mut [f32; 8]) {
        match &self.voxels {
            Values::U8(voxels) => gather2(voxels, at, self.strides, taps, whole),
            Values::U16(voxels) => gather2(voxels, at, self.strides, taps, whole),
            Values::I16(voxels) => gather2(voxels, at, self.strides, taps, whole),
            Values::F32(voxels) => gather2(voxels, at, self.strides, taps, |row| row),
        }
    }

    /// What `of` makes of the least and the largest voxel of each block of `edge^3` cells, with the voxels
    /// `-before..=after` around its cells: see [`super::blocks`].
    pub(super) fn blocks<U: Copy + Default + Send>(
        &self,
        edge: usize,
        (before, after): (usize, usize),
        of: impl Fn(f32, f32) -> U + Sync,
    ) -> Vec<U> {
        let window = Window { edge, before, after };
        match &self.voxels {
            Values::U8(voxels) => self.blocks_of(voxels, window, |low, high| of(low.into(), high.into())),
            Values::U16(voxels) => self.blocks_of(voxels, window, |low, high| of(low.into(), high.into())),
            Values::I16(voxels) => self.blocks_of(voxels, window, |low, high| of(low.into(), high.into())),
            Values::F32(voxels) => self.blocks_of(voxels, window, of),
        }
    }

    fn blocks_of<T: Copy + PartialOrd + Sync + Send, U: Copy + Default + Send>(
        &self,
        voxels: &[T],
        window: Window,
        of: impl Fn(T, T) -> U + Sync,
    ) -> Vec<U> {
        let blocks = self.size.map(|n| n.div_ceil(window.edge));
        let padded = self.size.map(|n| n + BORDER);
        let [width, area] = self.strides;
        let mut found = vec![U::default(); blocks.iter().product()];
        // z first, as whole slices go fastest, then y, then x; the last for every voxel, side by side.
        found.par_chunks_mut(blocks[0] * blocks[1]).enumerate().for_each(|(z, found)| {
            let slices = window.of(z, padded[2]);
            let mut low = voxels[slices.start * area..][..area].to_vec();
            let mut high = low.clone();
            for slice in slices.skip(1) {
                lower(&mut low, &voxels[slice * area..]);
                higher(&mut high, &voxels[slice * area..]);
            }
            for (y, found) in found.chunks_mut(blocks[0]).enumerate() {
                let rows = window.of(y, padded[1]);
                let start = rows.start * width;
                let (mut least, mut most) = (low[start..][..width].to_vec(), high[start..][..width].to_vec());
                for y in rows.skip(1) {
                    lower(&mut least, &low[y * width..]);
                    higher(&mut most, &high[y * width..]);
                }
                let (mut lowest, mut highest) = (least.clone(), most.clone());
                for shift in 1..window.length() {
                    lower(&mut lowest, least.get(shift..).unwrap_or_default());
                    higher(&mut highest, most.get(shift..).unwrap_or_default());
                }
                for (x, found) in found.iter_mut().enumerate() {
                    let first = window.of(x, padded[0]).start;
                    *found = of(lowest[first], highest[first]);
                }
            }
        });
        found
    }
}

/// The power of two that values of that range are divided by.
fn unit((low, high): (f64, f64)) -> f64 {
    let largest = low.abs().max(high.abs());
    if largest == 0.0 || (MOST.recip()..=MOST).contains(&largest) {
        return 1.0;
    }
    let bound = if largest > 1.0 { MOST } else { MOST.recip() };
    2_f64.powi((largest / bound).log2().floor() as i32)
}

/// Values in that unit.
fn scaled(mut values: Vec<f32>, unit: f64) -> Vec<f32> {
    if unit != 1.0 {
        for value in &mut values {
            *value *= unit.recip() as f32;
        }
    }
    values
}

/// Takes the lesser of each two.
fn lower<T: Copy + PartialOrd>(low: &mut [T], values: &[T]) {
    for (low, &value) in low.iter_mut().zip(values) {
        *low = if value < *low { value } else { *low };
    }
}

/// Takes the larger of each two.
fn higher<T: Copy + PartialOrd>(high: &mut [T], values: &[T]) {
    for (high, &value) in high.iter_mut().zip(values) {
        *high = if value > *high { value } else { *high };
    }
}

/// Copies the first and the last piece of that length within the border into the border before and behind them.
fn spread(values: &mut [f32], piece: usize, last: usize) {
    for k in 0..BEFORE {
        values.copy_within(BEFORE * piece..(BEFORE + 1) * piece, k * piece);
    }
    for k in 1..=AFTER {
        values.copy_within(last * piece..(last + 1) * piece, (last + k) * piece);
    }
}

/// Which voxels belong to a block: those of its `edge` cells with so many before and after each.
#[derive(Clone, Copy)]
struct Window {
    edge: usize,
    before: usize,
    after: usize,
}

impl Window {
    /// Voxels of a whole block along an axis.
    const fn length(self) -> usize {
        self.before + self.edge + self.after
    }

    /// The voxels of a block along one axis of that padded length.
    fn of(self, block: usize, padded: usize) -> std::ops::Range<usize> {
        let first = block * self.edge + BEFORE;
        let end = (first + self.edge + self.after).min(padded);
        first - self.before..end
    }
}

/// Integers as floats, through 32-bit ones, which SIMD converts four at a time.
#[inline(always)]
fn whole<T: Into<i32>>([a, b, c, d]: [T; 4]) -> [f32; 4] {
    i32x4::new([a.into(), b.into(), c.into(), d.into()]).round_float().to_array()
}

#[inline(always)]
fn gather4<T: Copy>(
    voxels: &[T],
    at: usize,
    strides: [usize; 2],
    taps: &mut [[f32; 16]; 4],
    to: impl Fn([T; 4]) -> [f32; 4],
) {
    for z in 0..4 {
        for y in 0..4 {
            let start = at + y * strides[0] + z * strides[1];
            let row = &voxels[start..start + 4];
            taps[z][4 * y..4 * y + 4].copy_from_slice(&to([row[0], row[1], row[2], row[3]]));
        }
    }
}

#[inline(always)]
fn gather2<T: Copy>(
    voxels: &[T],
    at: usize,
    strides: [usize; 2],
    taps: &mut [f32; 8],
    to: impl Fn([T; 4]) -> [f32; 4],
) {
    let corner = at + BEFORE * (1 + strides[0] + strides[1]);
    for z in 0..2 {
        let start = corner + z * strides[1];
        let (a, b) = (&voxels[start..start + 2], &voxels[start + strides[0]..][..2]);
        taps[4 * z..4 * z + 4].copy_from_slice(&to([a[0], a[1], b[0], b[1]]));
    }
}

/// The values with the border around them.
fn pad<T: Copy + Default + Sync + Send>(values: &[T], size: [usize; 3]) -> Vec<T> {
    let [nx, ny, nz] = size;
    let inside = |at: usize, n: usize| at.saturating_sub(BEFORE).min(n - 1);
    let [width, area] = [nx + BORDER, (nx + BORDER) * (ny + BORDER)];
    let mut padded = vec![T::default(); area * (nz + BORDER)];
    padded.par_chunks_mut(area).enumerate().for_each(|(z, slice)| {
        for (y, row) in slice.chunks_mut(width).enumerate() {
            let values = &values[(inside(z, nz) * ny + inside(y, ny)) * nx..][..nx];
            row[..BEFORE].fill(values[0]);
            row[BEFORE..][..nx].copy_from_slice(values);
            row[BEFORE + nx..].fill(values[nx - 1]);
        }
    });
    padded
}
