//! A multigrid cycle on a window, as a preconditioner: symmetric, positive definite, one sweep down and one up.
//!
//! The system is `(A_l + diag(d_l)) x = r` over the free unknowns of each level. Level 0 is the caller's; each coarser
//! grid has half the resolution, its own `A_l` (the same energy at twice the spacing), `d` summed over a cell's
//! children, and a cell that is free only if all its children are. Smoother: a Chebyshev polynomial in `B A`
//! for the upper part of the spectrum, with `B` the masked blur of [`crate::kernel::blur`], the same
//! down and up; its bound is the largest eigenvalue of the masked operator, which exceeds that of the unmasked one. Transfer: [`crate::operator::resample`]. The coarsest grid
//! is solved directly.
//!
//! Source: W. Briggs, V. Henson, S. Mc Cormick, "A Multigrid Tutorial", SIAM 2000; M. Adams, M. Brezina, J. Hu,
//! R. Tuminaro, "Parallel multigrid smoothing: polynomial versus Gauss-Seidel", J. Comput. Phys. 188, 2003.
//!
//! Cost: `2 DEGREE` applications of `A` a level, 4/3 of that in all. Memory: seven buffers a level, 10 windows in all.

use super::bottom::Bottom;
use crate::kernel::blur::blur;
use crate::kernel::simd::Lanes;
use crate::kernel::stencil::{PAD, Separable, Window, apply};
use crate::kernel::{Isa, Real, vector};
use crate::operator::resample::Resample;

/// Steps of the smoother before and after the coarse correction.
const DEGREE: usize = 3;
/// The smoother works on eigenvalues from the largest down to the largest over this.
const SPREAD: f64 = 12.0;
/// Added to the middle of the smoother's blur.
const CENTRE: f64 = 1.0;
/// Grids with at most this many cells are solved directly.
const DIRECT: usize = 144;

/// One grid.
struct Level<T> {
    a: Separable<T>,
    window: Window,
    /// Added to the diagonal.
    d: Option<Vec<T>>,
    /// The share of `A` in the diagonal at free unknowns, zero at others: what a coarse correction is multiplied by. It
    /// keeps corrections away from unknowns that are held by a large `d`, as it does from those that are not free.
    share: Vec<T>,
    /// Its square root, `E` of the smoother.
    e: Vec<T>,
    /// Bounds of the eigenvalues that the smoother damps.
    bounds: (f64, f64),
    /// To the next coarser grid.
    down: Option<Resample<T>>,
}

/// The grids of a window.
pub struct Multigrid<T> {
    isa: Isa,
    levels: Vec<Level<T>>,
    bottom: Option<Bottom>,
}

/// Buffers for one cycle at a time.
pub struct Workspace<T> {
    levels: Vec<Buffers<T>>,
}

struct Buffers<T> {
    r: Vec<T>,
    x: Vec<T>,
    q: Vec<T>,
    s: Vec<T>,
    t: Vec<T>,
}

impl<T: Lanes> Multigrid<T> {
    /// Sets up the grids below `window`. `matrix(l)` is the operator of level `l` on the whole image; `free` is 1 at free
    /// unknowns and 0 elsewhere, padding included. The window begins at multiples of `2^l` for as many levels as it is
    /// to have.
    pub fn new(
        isa: Isa,
        window: Window,
        matrix: &mut dyn FnMut(usize) -> Separable<f64>,
        free: Vec<T>,
        d: Option<Vec<T>>,
    ) -> Self {
        let mut levels: Vec<Level<T>> = Vec::new();
        let (mut window, mut free, mut d) = (window, free, d);
        let bottom = loop {
            let a = matrix(levels.len());
            if window.pixels() <= DIRECT {
                break Some((Bottom::new(&a, window, &free, d.as_deref()), a));
            }
            let size = a.size();
            let splits = window.y % 2 == 0 && window.x % 2 == 0;
            let down = splits.then(|| Resample::new(window, size.height, size.width));
            let coarse = down.as_ref().map(|down| coarsen(window, down.coarse(), &free, d.as_deref()));
            let more = coarse.as_ref().is_some_and(|(free, _)| free.iter().any(|&x| x != T::ZERO));
            let next = down.as_ref().map(Resample::coarse).filter(|_| more);
            levels.push(Level::new(isa, &a, window, d, free, down.filter(|_| more)));
            let (Some(next), Some(coarse)) = (next, coarse) else { break None };
            (window, (free, d)) = (next, coarse);
        };
        let bottom = bottom.map(|(bottom, a)| {
            let none = Vec::new;
            levels.push(Level {
                a: a.cast(),
                window,
                d: None,
                share: none(),
                e: none(),
                bounds: (1.0, 1.0),
                down: None,
            });
            bottom
        });
        Self { isa, levels, bottom }
    }

    /// Buffers for [`Self::cycle`].
    pub fn workspace(&self) -> Workspace<T> {
        let buffers = |level: &Level<T>| Buffers {
            r: level.window.zeros(),
            x: level.window.zeros(),
            q: level.window.zeros(),
            s: level.window.zeros(),
            t: level.window.zeros(),
        };
        Workspace { levels: self.levels.iter().map(buffers).collect() }
    }

    /// The instruction set in use.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// The finest window.
    pub fn window(&self) -> Window {
        self.levels[0].window
    }

    /// Sets `z` to an approximate solution for the residual `r`: zero at unknowns that are not free. While computing, `r` is
    /// multiplied by `scale`.
    pub fn cycle(&self, r: &[f64], scale: f64, workspace: &mut Workspace<T>, z: &mut [f64]) {
        for (own, &r) in workspace.levels[0].r.iter_mut().zip(r) {
            *own = T::from_f64(r * scale);
        }
        self.descend(0, &mut workspace.levels);
        for (z, x) in z.iter_mut().zip(&workspace.levels[0].x) {
            *z = x.to_f64() / scale;
        }
    }

    fn descend(&self, index: usize, buffers: &mut [Buffers<T>]) {
        let Some((here, below)) = buffers.split_first_mut() else { return };
        let level = &self.levels[index];
        if let Some(bottom) = self.bottom.as_ref().filter(|_| index + 1 == self.levels.len()) {
            bottom.solve(&here.r, &mut here.x);
            return;
        }
        here.x.fill(T::ZERO);
        self.smooth(level, here, true);
        if let (Some(down), Some(coarse)) = (&level.down, below.first_mut()) {
            apply(self.isa, &level.a, level.window, &here.x, level.d.as_deref(), &mut here.q);
            vector::weighted_difference(self.isa, &level.share, &here.r, &here.q, &mut here.t);
            down.restrict(&here.t, &mut coarse.r);
            self.descend(index + 1, below);
            down.prolong_add(&below[0].x, &level.share, &mut here.x);
            self.smooth(level, here, false);
        }
    }

    fn smooth(&self, level: &Level<T>, here: &mut Buffers<T>, from_zero: bool) {
        let (low, high) = level.bounds;
        let (centre, radius) = (0.5 * (high + low), 0.5 * (high - low));
        let mut rho = radius / centre;
        for step in 0..DEGREE {
            if step == 0 && from_zero {
                here.q.fill(T::ZERO);
            } else {
                apply(self.isa, &level.a, level.window, &here.x, level.d.as_deref(), &mut here.q);
            }
            let factors = if step == 0 {
                (1.0 / centre, 0.0)
            } else {
                let next = 1.0 / (2.0 * centre / radius - rho);
                let factors = (2.0 * next / radius, next * rho);
                rho = next;
                factors
            };
            vector::weighted_difference(self.isa, &level.e, &here.r, &here.q, &mut here.t);
            blur(self.isa, level.window, CENTRE, &level.e, &here.t, &mut here.q);
            vector::smooth(self.isa, factors, &here.q, &mut here.s, &mut here.x);
        }
    }
}

impl<T: Lanes> Level<T> {
    fn new(
        isa: Isa,
        a: &Separable<f64>,
        window: Window,
        d: Option<Vec<T>>,
        free: Vec<T>,
        down: Option<Resample<T>>,
    ) -> Self {
        let (mut e, mut share) = (free.clone(), free);
        for (i, (e, share)) in e.iter_mut().zip(&mut share).enumerate() {
            if *e != T::ZERO {
                let own = d.as_ref().map_or(0.0, |d| d[i].to_f64());
                let stride = window.stride();
                let (y, x) = (window.y + i / stride - PAD, window.x + i % stride - PAD);
                let diagonal = a.diagonal(y, x);
                *share = T::from_f64(diagonal / (diagonal + own));
                *e = T::from_f64((diagonal / (diagonal + own)).sqrt());
            }
        }
        let mut level = Self { a: a.cast(), window, d, share, e, bounds: (1.0, 1.0), down };
        let high = level.largest(isa) * 1.15;
        level.bounds = (high / SPREAD, high);
        level
    }

    /// The largest eigenvalue of the preconditioned matrix by power iteration.
    fn largest(&self, isa: Isa) -> f64 {
        const STEPS: usize = 24;
        let window = self.window;
        let (mut x, mut q, mut t) = (window.zeros::<T>(), window.zeros::<T>(), window.zeros::<T>());
        // A start that is rough and has a share in every free unknown.
        for i in 0..window.height {
            for j in 0..window.width {
                let sign = if (i + j) % 2 == 0 { 1.0 } else { -1.0 };
                let place = window.at(i, j);
                x[place] = self.e[place] * T::from_f64(sign * (1.0 + 0.2 * ((i * 7 + j * 3) % 5) as f64));
            }
        }
        let zero = window.zeros::<T>();
        let mut value = 1.0;
        for _ in 0..STEPS {
            let (norm, _) = vector::dot(isa, &x, &x);
            let unit: Vec<T> = x.iter().map(|&x| x * T::from_f64(1.0 / norm.sqrt().max(1e-30))).collect();
            apply(isa, &self.a, window, &unit, self.d.as_deref(), &mut q);
            vector::weighted_difference(isa, &self.e, &q, &zero, &mut t);
            blur(isa, window, CENTRE, &self.e, &t, &mut x);
            value = vector::dot(isa, &x, &x).0.sqrt();
        }
        value
    }
}

/// What is free, and what is added to the diagonal, one level up.
fn coarsen<T: Real>(fine: Window, coarse: Window, free: &[T], d: Option<&[T]>) -> (Vec<T>, Option<Vec<T>>) {
    let mut coarse_free = coarse.zeros();
    let mut coarse_d = d.map(|_| coarse.zeros());
    for i in 0..coarse.height {
        for j in 0..coarse.width {
            let place = coarse.at(i, j);
            let mut all = true;
            for (y, x) in [(2 * i, 2 * j), (2 * i, 2 * j + 1), (2 * i + 1, 2 * j), (2 * i + 1, 2 * j + 1)] {
                if y < fine.height && x < fine.width {
                    all &= free[fine.at(y, x)] != T::ZERO;
                    if let (Some(sum), Some(d)) = (&mut coarse_d, d) {
                        sum[place] += d[fine.at(y, x)];
                    }
                }
            }
            coarse_free[place] = T::from_f64(if all { 1.0 } else { 0.0 });
        }
    }
    (coarse_free, coarse_d)
}
