//! The parts of the image with measured pixels everywhere near: tiles in f32.
//!
//! A tile is solved in a window that overlaps its neighbours; around the window the image keeps its values. Tiles are taken
//! one after the other, every other row of tiles first, and each finds what those before it have left: what the
//! surroundings get wrong fades within a few samples. The next sweep, whose tiles are shifted by half a tile, finds
//! out whether anything was left where that may be (`doubt`): a tile whose residual is within the tolerance there is not
//! touched, and when no tile was, the image solves the whole problem. Rows of tiles that do not touch each other are shared
//! out among threads.
//!
//! Source: M. Dryja, O. Widlund, "An additive variant of the Schwarz alternating method", Courant Institute 1987 (this is
//! the multiplicative one).

use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use super::doubt::{Doubt, Felt, Grid, Mark, Seen};
use crate::kernel::stencil::Separable;
use crate::kernel::tile::{Gather, Scatter, free, gather, scatter};
use crate::kernel::window::{PAD, Window};
use crate::kernel::{Isa, factor, step};
use crate::solver::factor::Factors;
use crate::solver::local::{self, Buffers, Ending, Spectrum, Target, Views};
use crate::solver::pool::Pool;
use crate::{Mask, Plane, Run, Size};

/// Most rows and columns of a tile.
const SIDES: (usize, usize) = (120, 176);
/// Pixels that a window extends beyond its tile.
const HALO: usize = 6;
/// The same at third order, where what surroundings get wrong fades more slowly: with 5 a second sweep solves 86 % of the pixels
/// again, with 12 a seventh.
const LONG_HALO: usize = 12;
/// Steps that a tile takes at most in one sweep.
pub const LIMIT: usize = 60;
/// Most rows and columns of the parts whose eigenvalues are looked at.
const SAMPLE: (usize, usize) = (60, 88);
/// Parts whose eigenvalues are looked at.
const PROBES: usize = 4;
/// Ratio of the least eigenvalues of tiles up to which one stands for all.
const ALIKE: f64 = 2.5;
/// Where the interval of the Chebyshev iteration begins, over the largest of the least eigenvalues seen.
const BEGIN: f64 = 1.15;
/// By how much the largest eigenvalue of any tile may exceed those seen.
const MARGIN: f64 = 1.04;

/// The dense part of a plan.
pub struct Tiles {
    isa: Isa,
    matrix: Separable<f32>,
    /// The preconditioner where the blur is not enough.
    factors: Option<Box<Factors>>,
    /// Pixels that a window extends beyond its tile.
    halo: usize,
    size: Size,
    /// Pixels that tiles may not change besides the measured ones: those in holes.
    held: Option<Vec<bool>>,
    /// Eigenvalues of the preconditioned matrix in tiles away from the border of the image and in those at one side of it, if
    /// they are much the same in all of them.
    spectra: [Option<Spectrum>; 2],
    spare: Pool<Buffers>,
}

/// What a sweep is to do.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// The sweep before, if there was one.
    pub before: Option<&'a Seen>,
    /// What has changed besides since then.
    pub changed: &'a [Window],
    /// A value in the midst of the image's. It is taken off while computing, so that a narrow range far from zero keeps
    /// its digits.
    pub middle: f32,
    /// When a tile is done.
    pub target: Target,
    /// Steps that a tile takes at most.
    pub limit: usize,
}

/// What a sweep over all tiles did.
#[derive(Clone, Copy, Debug)]
pub struct Sweep {
    /// Most steps that a tile took.
    pub steps: usize,
    /// The largest entry of the preconditioned residual before and after, in all windows looked at.
    pub tops: (f64, f64),
    /// Least eigenvalue of the preconditioned matrix of any tile.
    pub least: f64,
    /// Largest error that any tile may have left, by its estimate.
    pub error: f64,
}

impl Sweep {
    const NONE: Self = Self { steps: 0, tops: (0.0, 0.0), least: f64::INFINITY, error: 0.0 };

    fn and(self, other: Self) -> Self {
        Self {
            steps: self.steps.max(other.steps),
            tops: (self.tops.0.max(other.tops.0), self.tops.1.max(other.tops.1)),
            least: self.least.min(other.least),
            error: self.error.max(other.error),
        }
    }
}

impl From<Ending> for Sweep {
    fn from(ending: Ending) -> Self {
        Self { steps: ending.steps, tops: ending.tops, least: ending.least, error: ending.error }
    }
}

/// Rows of the image that one task works on.
struct Slab<'a> {
    /// First row in the image.
    y: usize,
    rows: &'a mut [f32],
    /// First row and number of rows of its tiles.
    tiles: (usize, usize),
}

/// A window, and its rows and columns that may be changed.
struct Place {
    window: Window,
    lines: Range<usize>,
    columns: Range<usize>,
}

impl Tiles {
    /// `held` marks pixels that are solved elsewhere.
    pub fn new(isa: Isa, matrix: &Separable<f64>, mask: &Mask, held: Option<Vec<bool>>) -> Self {
        let mut tiles = Self {
            isa,
            matrix: matrix.cast(),
            halo: if Factors::suit(matrix.terms) { LONG_HALO } else { HALO },
            factors: Factors::suit(matrix.terms).then(|| Box::new(Factors::new(matrix.clone()))),
            size: matrix.size(),
            held,
            spectra: [None; 2],
            spare: Pool::default(),
        };
        tiles.spectra = [0, 1].map(|ends| tiles.probe(mask, ends));
        tiles
    }

    /// Where the solution of a tile is felt but not part of it: at pixels whose residual those that it changes enter. The
    /// preconditioner mixes residuals of neighbours.
    pub fn felt(&self) -> Felt {
        let mixed = if self.factors.is_some() { factor::REACH } else { 1 };
        Felt { from: self.halo - mixed, to: self.halo + self.matrix.terms + mixed }
    }

    /// On how many sides of a window the image ends: there, and most of all in corners, lower eigenvalues occur.
    fn ends(&self, window: Window) -> usize {
        let Window { y, x, height, width } = window;
        let sides = [y == 0, x == 0, y + height == self.size.height, x + width == self.size.width];
        sides.iter().filter(|ends| **ends).count()
    }

    /// Looks at the eigenvalues of a few of the tiles at which the image ends on so many sides.
    fn probe(&self, mask: &Mask, ends: usize) -> Option<Spectrum> {
        let grid = Grid::new(self.size, SAMPLE, false);
        let tiles = grid.rows.iter().flat_map(|&(y, height)| {
            grid.columns.iter().map(move |&(x, width)| Window { y, x, height, width })
        });
        let places: Vec<Place> = tiles
            .map(|tile| self.place(tile, self.halo + self.matrix.terms))
            .filter(|place| self.ends(place.window) == ends)
            .collect();
        let (count, last) = (PROBES.min(places.len()), places.len().saturating_sub(1));
        let picks = (0..count).map(|k| &places[k * last / (count - 1).max(1)]);
        let spectra: Vec<Spectrum> = picks
            .collect::<Vec<_>>()
            .into_par_iter()
            .map(|place| {
                let mut buffers = self.spare.lend();
                let mut views = buffers.fit(place.window);
                self.free(mask, place, &mut views);
                local::probe(self.isa, &self.matrix, place.window, views)
            })
            .into_iter()
            .flatten()
            .collect();
        let extreme = |of: fn(f64, f64) -> f64| spectra.iter().map(|spectrum| spectrum.least).reduce(of);
        let (low, high) = (extreme(f64::min)?, extreme(f64::max)?);
        let largest = spectra.iter().map(|spectrum| spectrum.largest).fold(0.0, f64::max);
        // Others may have as much less than the least as this one has less than the largest of them.
        (high <= ALIKE * low).then_some(Spectrum {
            least: low * (low / high).sqrt(),
            begin: BEGIN * high,
            largest: MARGIN * largest,
        })
    }

    /// Solves each tile whose residual asks for it; also says what the next sweep must look at.
    pub fn sweep(&self, mask: &Mask, image: &mut Plane, task: Task<'_>, run: &Run<'_>) -> (Sweep, Seen) {
        let shifted = task.before.is_some_and(|before| !before.grid.shifted);
        let grid = Grid::new(self.size, SIDES, shifted);
        let mut total = Sweep::NONE;
        let mut marks = vec![Vec::new(); grid.rows.len()];
        for parity in 0..2 {
            let slabs = self.slabs(image, grid.rows.iter().skip(parity).step_by(2));
            let sweeps = slabs.into_par_iter().map_init(
                || self.spare.lend(),
                |buffers, mut slab| {
                    let (mut total, mut marks) = (Sweep::NONE, Vec::new());
                    for &(x, width) in &grid.columns {
                        if run.interrupted().is_some() {
                            break;
                        }
                        let tile = Window { y: slab.tiles.0, x, height: slab.tiles.1, width };
                        let sweep = self.visit(mask, &mut slab, tile, task, buffers);
                        marks.push(Mark::new(sweep.steps, sweep.error <= task.target.tolerance));
                        total = total.and(sweep);
                    }
                    (total, marks)
                },
            );
            for (k, (sweep, row)) in sweeps.into_iter().enumerate() {
                total = total.and(sweep);
                marks[2 * k + parity] = row;
            }
        }
        (total, Seen { grid, marks })
    }

    /// Solves a tile if what must be looked at asks for it.
    fn visit(
        &self,
        mask: &Mask,
        slab: &mut Slab<'_>,
        tile: Window,
        task: Task<'_>,
        buffers: &mut Buffers,
    ) -> Sweep {
        let reach = self.matrix.terms;
        match Doubt::new(tile, task.before, task.changed, self.felt()) {
            Doubt::Everywhere => {}
            Doubt::Along(bands) => {
                let mut total = Sweep::NONE;
                let mut quiet = true;
                for band in bands {
                    let place = self.place(band, reach);
                    let ending = self.solve(mask, slab, &place, task, 0, buffers);
                    quiet &= ending.converged;
                    total = total.and(ending.into());
                }
                if quiet {
                    return total;
                }
            }
        }
        let place = self.place(tile, self.halo + reach);
        let ending = self.solve(mask, slab, &place, task, task.limit, buffers);
        if !ending.tops.1.is_finite() {
            // Numbers that f32 cannot hold go neither into the image nor, from the padding, into the next window.
            *buffers = Buffers::default();
        } else if ending.steps > 0 {
            self.store(slab, &place, task.middle, buffers);
        }
        ending.into()
    }

    /// A window that extends beyond a rectangle by `margin`. Its outermost `reach` rows and columns are read but not changed,
    /// unless the image ends there.
    fn place(&self, inner: Window, margin: usize) -> Place {
        let (reach, size) = (self.matrix.terms, self.size);
        let (y, height) = span(inner.y, inner.height, size.height, margin);
        let (x, width) = span(inner.x, inner.width, size.width, margin);
        let free = |start: usize, length: usize, n: usize| {
            let first = if start == 0 { 0 } else { reach };
            first..if start + length == n { length } else { length - reach }
        };
        let (lines, columns) = (free(y, height, size.height), free(x, width, size.width));
        Place { window: Window { y, x, height, width }, lines, columns }
    }

    /// Cuts the image into the rows that the windows of the given rows of tiles take.
    fn slabs<'a>(
        &self,
        image: &'a mut Plane,
        tiles: impl Iterator<Item = &'a (usize, usize)>,
    ) -> Vec<Slab<'a>> {
        let size = self.size;
        let (mut rest, mut top) = (image.pixels_mut(), 0);
        tiles
            .map(|&tiles| {
                let (y, height) = span(tiles.0, tiles.1, size.height, self.halo + self.matrix.terms);
                let here = std::mem::take(&mut rest);
                let (rows, below) = here[(y - top) * size.width..].split_at_mut(height * size.width);
                (rest, top) = (below, y + height);
                Slab { y, rows, tiles }
            })
            .collect()
    }

    /// Brings the pixels of a window into the buffers, and which of them are free.
    fn load(&self, mask: &Mask, slab: &Slab<'_>, place: &Place, middle: f32, views: &mut Views<'_>) {
        let (across, window) = (self.size.width, place.window);
        for i in 0..window.height {
            let pixels = &slab.rows[(window.y - slab.y + i) * across + window.x..][..window.width];
            let values = &mut views.x[window.at(i, 0)..][..window.width];
            gather(self.isa, Gather { pixels, middle, values });
        }
        self.free(mask, place, views);
    }

    /// The preconditioner on a window, from which pixels are free.
    fn free(&self, mask: &Mask, place: &Place, views: &mut Views<'_>) {
        let (across, window) = (self.size.width, place.window);
        for i in 0..window.height {
            let flags = &mut views.w[window.at(i, 0) - PAD..][..window.stride()];
            flags.fill(0.0);
            if place.lines.contains(&i) {
                let row = (window.y + i) * across + window.x;
                let own = row + place.columns.start..row + place.columns.end;
                let held = self.held.as_ref().map(|held| &held[own.clone()]);
                free(self.isa, &mask.as_slice()[own], held, &mut flags[PAD..][place.columns.clone()]);
            }
        }
        match &self.factors {
            None => {
                step::shares(self.isa, window, views.w, views.d);
                self.scale(window, views.d);
            }
            Some(factors) => {
                views.w[..PAD * window.stride()].fill(0.0);
                let (free, planes) = views.factor();
                factors.fill(self.isa, window, free, planes);
            }
        }
    }

    /// Near the border of the image the matrix has smaller entries, and the blur's weights end: the diagonal makes up for both.
    fn scale(&self, window: Window, d: &mut [f32]) {
        let Size { height, width } = self.size;
        let ends = (self.matrix.vertical.ends.min(height), self.matrix.horizontal.ends.min(width));
        let inside = self.matrix.diagonal(height / 2, width / 2);
        let weight = |i: usize, n: usize| 4.0 - f64::from(u8::from(i == 0)) - f64::from(u8::from(i + 1 == n));
        let left = ends.1.saturating_sub(window.x).min(window.width);
        let right = (width - ends.1).saturating_sub(window.x).clamp(left, window.width);
        for i in 0..window.height {
            let y = window.y + i;
            let inner = if y < ends.0 || y + ends.0 >= height { 0..0 } else { left..right };
            for j in (0..inner.start).chain(inner.end..window.width) {
                let x = window.x + j;
                let share = 16.0 / (weight(y, height) * weight(x, width));
                d[window.at(i, j)] *= (share * (inside / self.matrix.diagonal(y, x)).sqrt()) as f32;
            }
        }
    }

    fn solve(
        &self,
        mask: &Mask,
        slab: &Slab<'_>,
        place: &Place,
        task: Task<'_>,
        limit: usize,
        buffers: &mut Buffers,
    ) -> Ending {
        let mut views = buffers.fit(place.window);
        self.load(mask, slab, place, task.middle, &mut views);
        let (isa, matrix, window) = (self.isa, &self.matrix, place.window);
        match self.spectra.get(self.ends(window)).copied().flatten() {
            Some(spectrum) => local::iterate(isa, matrix, window, views, (task.target, spectrum), limit),
            None => local::solve(isa, matrix, window, views, task.target, limit),
        }
    }

    /// Brings what was solved back into the image.
    fn store(&self, slab: &mut Slab<'_>, place: &Place, middle: f32, buffers: &mut Buffers) {
        let (window, views) = (place.window, buffers.views());
        for i in place.lines.clone() {
            let from = window.at(i, 0);
            let row = (window.y - slab.y + i) * self.size.width + window.x;
            let pixels = &mut slab.rows[row..][..window.width];
            let (values, free) = (&views.x[from..], &views.d[from..]);
            scatter(self.isa, Scatter { values, free, middle, pixels });
        }
    }
}

/// First and number of the rows or columns from `margin` before to `margin` after, of `n`.
fn span(from: usize, length: usize, n: usize, margin: usize) -> (usize, usize) {
    let start = from.saturating_sub(margin);
    (start, n.min(from + length + margin) - start)
}
