//! Images in tiles: the missing pixels of each are found from a window around it, all windows from the image as it was.
//!
//! The size of tiles belongs to a method, not to the run: results are the same for any number of threads.

use lacuna_core::parallel::prelude::*;

use crate::{Mask, Plane, Planes, Run, Size};

/// How an image is cut into tiles.
#[derive(Clone, Copy, Debug)]
pub struct Tiling {
    /// Pixels of the side of a tile.
    pub side: usize,
    /// Pixels around it that its window has besides.
    pub halo: usize,
    /// Pixels by which the first tiles of rows and columns are shorter.
    pub shift: usize,
}

/// A tile's place: what is kept of it, and the window that it is found from.
#[derive(Debug)]
pub struct Core {
    /// The window's first row and column.
    pub origin: (usize, usize),
    /// The window.
    pub outer: Size,
    /// The tile.
    pub inner: Size,
    /// Rows and columns of the window before the tile.
    pub margin: (usize, usize),
}

impl Tiling {
    /// Replaces missing pixels by what `f` makes of each tile, one channel after the other; nothing leaves a tile as it is, as what is not finite does
    /// a pixel. `f` is given room that it may use again, the tile and the image as it was. Returns what else it says of tiles that changed.
    pub fn map<S: Default, T: Send>(
        &self,
        mask: &Mask,
        out: &mut Planes,
        run: &Run<'_>,
        f: impl Fn(&mut S, &Core, &Planes) -> Option<(Vec<f32>, T)> + Sync,
    ) -> Vec<T> {
        let size = mask.size();
        let (rows, columns) =
            ((size.height + self.shift).div_ceil(self.side), (size.width + self.shift).div_ceil(self.side));
        let core = |index| self.core(size, (index / columns, index % columns));
        let before = &*out;
        let answers = (0..rows * columns).into_par_iter().map_init(S::default, |room, index| {
            if run.interrupted().is_some() { None } else { f(room, &core(index), before) }
        });
        let (values, said): (Vec<_>, Vec<_>) = answers.into_iter().map(Option::unzip).unzip();
        let mut rest: Vec<&mut [f32]> = out.as_mut_slice().iter_mut().map(Plane::pixels_mut).collect();
        let rows = values.chunks(columns).enumerate().map(|(row, values)| {
            let height = core(row * columns).inner.height;
            let planes = rest.iter_mut().map(|rest| {
                let (own, below) = std::mem::take(rest).split_at_mut(height * size.width);
                *rest = below;
                own
            });
            (row, values, planes.collect::<Vec<_>>())
        });
        rows.collect::<Vec<_>>().into_par_iter().for_each(|(row, values, mut planes)| {
            for (column, values) in
                values.iter().enumerate().filter_map(|(k, values)| Some((k, values.as_ref()?)))
            {
                core(row * columns + column).write(values, mask, &mut planes);
            }
        });
        said.into_iter().flatten().collect()
    }

    fn core(&self, size: Size, (row, column): (usize, usize)) -> Core {
        let Self { side, halo, shift } = *self;
        let axis = |k: usize, length: usize| {
            let (start, end) = ((k * side).saturating_sub(shift), ((k + 1) * side - shift).min(length));
            let (first, last) = (start.saturating_sub(halo), (end + halo).min(length));
            (first, last - first, start - first, end - start)
        };
        let (top, height, above, inner_height) = axis(row, size.height);
        let (left, width, before, inner_width) = axis(column, size.width);
        Core {
            origin: (top, left),
            outer: Size::new(height, width),
            inner: Size::new(inner_height, inner_width),
            margin: (above, before),
        }
    }
}

impl Core {
    /// Copies the window of a plane, times a factor, to the beginnings of as many rows of some width.
    pub fn copy(&self, from: &Plane, factor: f32, width: usize, to: &mut [f32]) {
        for (y, to) in to.chunks_exact_mut(width).enumerate().take(self.outer.height) {
            let row = &from.row(self.origin.0 + y)[self.origin.1..][..self.outer.width];
            to.iter_mut().zip(row).for_each(|(to, value)| *to = value * factor);
        }
    }

    /// Writes the tile's missing pixels.
    fn write(&self, values: &[f32], mask: &Mask, out: &mut [&mut [f32]]) {
        let (y, x) = (self.origin.0 + self.margin.0, self.origin.1 + self.margin.1);
        let (width, across) = (self.inner.width, mask.size().width);
        for (rows, values) in out.iter_mut().zip(values.chunks_exact(self.inner.pixels())) {
            let rows = rows.chunks_exact_mut(across);
            for ((y, row), values) in (y..).zip(rows).zip(values.chunks_exact(width)) {
                let pixels = row[x..][..width].iter_mut();
                for ((pixel, value), measured) in pixels.zip(values).zip(&mask.row(y)[x..]) {
                    if !measured && value.is_finite() {
                        *pixel = *value;
                    }
                }
            }
        }
    }
}
