//! The volume: voxels with a border of copies, and where they lie in space.
//!
//! Voxel centres lie at integer index coordinates; the volume is the box `[0, n - 1]` along each axis. A cell is the
//! unit cube between voxel centres; cell `c` has its lowest corner at voxel `c`. A border of one voxel before and two
//! after (copies of the outermost ones) gives every cell its 4 x 4 x 4 voxels without a test.

use rayon::prelude::*;
use wide::i32x4;

use super::vector::{Affine, Vector, length};
use super::{Error, Values};

/// Voxels of the border before the first one.
const BEFORE: usize = 1;
/// Voxels of the border in all.
const BORDER: usize = 3;

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
        let range = values.range().ok_or_else(|| Error::Volume("a value is not finite".into()))?;
        let strides = [size[0] + BORDER, (size[0] + BORDER) * (size[1] + BORDER)];
        let voxels = match values {
            Values::U8(values) => Values::U8(pad(values, size)),
            Values::U16(values) => Values::U16(pad(values, size)),
            Values::I16(values) => Values::I16(pad(values, size)),
            Values::F32(values) => Values::F32(pad(values, size)),
        };
        Ok(Self { size, strides, voxels, placement, range })
    }

    /// Voxels along x, y, z.
    pub const fn size(&self) -> [usize; 3] {
        self.size
    }

    /// Index to world coordinates.
    pub const fn placement(&self) -> &Affine {
        &self.placement
    }

    /// Least and largest value of all voxels.
    pub const fn range(&self) -> (f64, f64) {
        self.range
    }

    /// The full range of the voxels' type: 0 to 1 for floats.
    pub const fn type_range(&self) -> (f64, f64) {
        self.voxels.type_range()
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
        let at = self.at(index) + BEFORE * (1 + self.strides[0] + self.strides[1]);
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
        let rows = (0..nz).flat_map(|z| (0..ny).map(move |y| (y, z)));
        rows.flat_map(|(y, z)| (0..nx).map(move |x| self.value([x, y, z]) as f32)).collect()
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
        Self::new(size, &map(&bare), placement)
    }

    fn bare<T: Copy>(&self, voxels: &[T]) -> Vec<T> {
        let [nx, ny, nz] = self.size;
        let rows = (0..nz).flat_map(|z| (0..ny).map(move |y| self.at([0, y, z])));
        let corner = BEFORE * (1 + self.strides[0] + self.strides[1]);
        rows.flat_map(|start| &voxels[start + corner..][..nx]).copied().collect()
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

    /// Least and largest voxel within blocks of cells, each block with the voxels `-before..=after` around its cells:
    /// see [`super::blocks`].
    pub(super) fn block_ranges(&self, edge: usize, before: usize, after: usize) -> Vec<(f32, f32)> {
        let window = Window { edge, before, after };
        match &self.voxels {
            Values::U8(voxels) => self.ranges_of(voxels, window, f32::from),
            Values::U16(voxels) => self.ranges_of(voxels, window, f32::from),
            Values::I16(voxels) => self.ranges_of(voxels, window, f32::from),
            Values::F32(voxels) => self.ranges_of(voxels, window, |value| value),
        }
    }

    fn ranges_of<T: Copy + PartialOrd + Sync + Send>(
        &self,
        voxels: &[T],
        window: Window,
        to: fn(T) -> f32,
    ) -> Vec<(f32, f32)> {
        let blocks = self.size.map(|n| n.div_ceil(window.edge));
        let padded = self.size.map(|n| n + BORDER);
        // z first, as whole slices go fastest, then y, then x; each pass leaves one entry a block along its axis.
        let slab = |z: usize| {
            let slices = window.of(z, padded[2]);
            let [mut low, mut high] =
                [0, 1].map(|_| voxels[slices.start * self.strides[1]..][..self.strides[1]].to_vec());
            for slice in slices.skip(1) {
                spread(&mut low, &mut high, &voxels[slice * self.strides[1]..]);
            }
            let (low, high) = (&low, &high);
            (0..blocks[1])
                .flat_map(move |y| {
                    let rows = window.of(y, padded[1]);
                    let row =
                        |values: &[T], y: usize| values[y * self.strides[0]..][..self.strides[0]].to_vec();
                    let (mut least, mut most) = (row(low, rows.start), row(high, rows.start));
                    for y in rows.skip(1) {
                        spread(&mut least, &mut [], &low[y * self.strides[0]..]);
                        spread(&mut [], &mut most, &high[y * self.strides[0]..]);
                    }
                    (0..blocks[0]).map(move |x| {
                        let cells = window.of(x, padded[0]);
                        let (low, high) = (&least[cells.clone()], &most[cells]);
                        let least = low.iter().fold(low[0], |a, &b| if b < a { b } else { a });
                        (to(least), to(high.iter().fold(high[0], |a, &b| if b > a { b } else { a })))
                    })
                })
                .collect::<Vec<_>>()
        };
        (0..blocks[2]).into_par_iter().flat_map_iter(slab).collect()
    }
}

/// Widens ranges to the values beside them.
fn spread<T: Copy + PartialOrd>(low: &mut [T], high: &mut [T], values: &[T]) {
    for (low, &value) in low.iter_mut().zip(values) {
        *low = if value < *low { value } else { *low };
    }
    for (high, &value) in high.iter_mut().zip(values) {
        *high = if value > *high { value } else { *high };
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
fn pad<T: Copy + Sync + Send>(values: &[T], size: [usize; 3]) -> Vec<T> {
    let [nx, ny, nz] = size;
    let inside = |at: usize, n: usize| at.saturating_sub(BEFORE).min(n - 1);
    (0..(ny + BORDER) * (nz + BORDER))
        .into_par_iter()
        .flat_map_iter(|row| {
            let (y, z) = (inside(row % (ny + BORDER), ny), inside(row / (ny + BORDER), nz));
            let row = &values[(z * ny + y) * nx..][..nx];
            let (first, last) = (row[0], row[nx - 1]);
            std::iter::once(first).chain(row.iter().copied()).chain([last, last])
        })
        .collect()
}
