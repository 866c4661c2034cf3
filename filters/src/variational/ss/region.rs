//! A rectangle of the image that is solved by conjugate gradients with a multigrid cycle: holes, sparse masks, and smoothing.
//!
//! Order 2 is solved in f32 by iterative refinement: the residual of the image as it stands is computed in f64, its
//! correction in f32 to two digits, and so on. Rounding the image to f32 in between costs nothing, as the next residual is
//! that of the rounded image. Third order, smoothing of more than [`WEAK`] or less than [`STRONG`], energies without tension, and
//! windows that are little more than a line, where the least eigenvalue is smaller than a few iterations show, are solved in f64 in one go.
//! So is what a round of refinement does not bring nearer, as far from all samples.
//!
//! Source: J. Wilkinson, "Rounding Errors in Algebraic Processes", HMSO 1963 (iterative refinement).

use std::cell::RefCell;
use std::sync::{Arc, OnceLock};

use lacuna_core::parallel::prelude::*;

use crate::kernel::simd::Lanes;
use crate::kernel::spans::Spans;
use crate::kernel::stencil::{Separable, apply};
use crate::kernel::window::{PAD, Window};
use crate::kernel::{Isa, vector};
use crate::operator::energy::Form;
use crate::solver::conjugate::{self, Goal};
use crate::solver::holes::{self, Division};
use crate::solver::multigrid::Multigrid;
use crate::{Mask, Outcome, Plane, Run, Size, Stop};

/// What a round of refinement in f32 is to gain.
const GAIN: f64 = 1e-3;
/// The same where smoothing of at most [`HELD`] and samples in every block hold the image: rounding is then a few parts in 1e6 of a correction.
const GAIN_HELD: f64 = 1e-4;
/// The largest weight of smoothness with which they do.
const HELD: f64 = 1.0;
/// Iterations of a round without a smaller correction.
const PATIENCE: usize = 3;
/// Rounds of refinement.
const ROUNDS: usize = 40;
/// The error that order 2 may leave by its estimate, over the last correction that the others may see.
const EASE: f64 = 30.0;
/// The error that a cell may be left with where others are corrected further, over what all may have.
const SPARE: f64 = 0.25;
/// The largest weight of smoothness with which f32 is taken: beyond, samples hold the image too weakly.
const WEAK: f64 = 1e3;
/// Smoothing of less than this pulls at samples with more than f32 holds beside the energy.
const STRONG: f64 = 1e-12;
/// The largest weight of a sample over lambda: beyond, the image has no other value there, and f64 holds no energy beside it.
const FIRMEST: f64 = 1e13;
/// Rows or columns from which on f32 is taken.
const NARROW: usize = 16;
/// Rows whose residual one task computes.
const CHUNK: usize = 32;

/// Multigrid cycles in the numbers that suffice.
enum Grids {
    /// For the well-posed case.
    Single(Multigrid<f32>),
    /// For third order, smoothing, energies that may leave an image undetermined, and lines.
    Double(Multigrid<f64>),
}

/// The energies of an image and of its coarser grids, as long as the image is wide: all rectangles share them.
pub struct Matrices<'a> {
    form: &'a Form,
    size: Size,
    double: RefCell<Vec<Arc<Separable<f64>>>>,
    single: RefCell<Vec<Arc<Separable<f32>>>>,
}

impl<'a> Matrices<'a> {
    /// None so far.
    pub fn new(form: &'a Form, size: Size) -> Self {
        Self { form, size, double: RefCell::default(), single: RefCell::default() }
    }

    fn double(&self, level: usize) -> Arc<Separable<f64>> {
        let mut known = self.double.borrow_mut();
        while known.len() <= level {
            // A side of one pixel stays as it is.
            let halve = |(n, spacing): (usize, f64)| {
                if n > 1 { (n.div_ceil(2), 2.0 * spacing) } else { (n, spacing) }
            };
            let side = |n: usize| (0..known.len()).fold((n, 1.0), |side, _| halve(side));
            let (tall, wide) = (side(self.size.height), side(self.size.width));
            let energy = self.form.energy(Size::new(tall.0, wide.0), (tall.1, wide.1));
            known.push(Arc::new(energy));
        }
        Arc::clone(&known[level])
    }

    fn single(&self, level: usize) -> Arc<Separable<f32>> {
        let mut known = self.single.borrow_mut();
        while known.len() <= level {
            let exact = self.double(known.len());
            known.push(Arc::new(exact.cast()));
        }
        Arc::clone(&known[level])
    }
}

/// The rectangle with its grids.
pub struct Region {
    isa: Isa,
    window: Window,
    matrix: Arc<Separable<f64>>,
    form: Form,
    grids: Grids,
    /// What a round of refinement is to gain.
    gain: f64,
    /// Where the numbers of `grids` do not suffice.
    exact: OnceLock<Multigrid<f64>>,
    /// Per pixel the weight of its sample over lambda.
    pull: Option<Vec<f64>>,
}

impl Region {
    /// All of the image.
    pub fn whole(isa: Isa, form: &Form, mask: &Mask, lambda: f64, weights: Option<&Plane>) -> Self {
        let size = mask.size();
        let window = Window { y: 0, x: 0, height: size.height, width: size.width };
        Self::new(isa, &Matrices::new(form, size), mask, (lambda, weights), window)
    }

    /// A window of the image, around which all pixels keep their values.
    pub fn new(
        isa: Isa,
        matrices: &Matrices<'_>,
        mask: &Mask,
        (lambda, weights): (f64, Option<&Plane>),
        window: Window,
    ) -> Self {
        let measured = |i: usize| &mask.row(window.y + i)[window.x..][..window.width];
        let free = rows(window, |i, j| if lambda == 0.0 && measured(i)[j] { 0.0 } else { 1.0 });
        let weight =
            |i: usize, j: usize| weights.map_or(1.0, |w| f64::from(w.at(window.y + i, window.x + j)));
        let stretch = matrices.form.stretch();
        let of_sample = |i: usize, j: usize| (weight(i, j) / lambda).min(FIRMEST * stretch);
        let pull =
            (lambda > 0.0).then(|| rows(window, |i, j| if measured(i)[j] { of_sample(i, j) } else { 0.0 }));
        let lambda = lambda * stretch;
        let single = lambda == 0.0 || (STRONG..=WEAK).contains(&lambda);
        let firm = lambda > 0.0 && lambda <= HELD && weights.is_none();
        let held = firm && matches!(holes::divide(mask), Division::Dense);
        let gain = if held { GAIN_HELD } else { GAIN };
        Self { gain, ..Self::of(isa, matrices, window, free, (pull, single)) }
    }

    /// All of the image; measured pixels keep their values, and the others are pulled towards theirs as firmly as `pulls` says.
    pub fn pulled(isa: Isa, form: &Form, mask: &Mask, pulls: &Plane) -> Self {
        let size = mask.size();
        let window = Window { y: 0, x: 0, height: size.height, width: size.width };
        let free = rows(window, |i, j| if mask.is_measured(i, j) { 0.0 } else { 1.0 });
        let pull = rows(window, |i, j| if mask.is_measured(i, j) { 0.0 } else { f64::from(pulls.at(i, j)) });
        Self::of(isa, &Matrices::new(form, size), window, free, (Some(pull), true))
    }

    fn of(
        isa: Isa,
        matrices: &Matrices<'_>,
        window: Window,
        free: Vec<f64>,
        (pull, single): (Option<Vec<f64>>, bool),
    ) -> Self {
        let (form, wide) = (matrices.form, window.height.min(window.width) >= NARROW);
        let grids = if form.order == 2 && form.tension > 0.0 && single && wide {
            let cast = |from: &[f64]| {
                let rows = from
                    .par_chunks(window.stride())
                    .map(|row| row.iter().map(|&x| x as f32).collect::<Vec<f32>>());
                rows.concat()
            };
            let (free, pull) = (cast(&free), pull.as_deref().map(cast));
            let matrix = |level| (matrices.double(level), matrices.single(level));
            Grids::Single(Multigrid::new(isa, window, &matrix, free, pull))
        } else {
            let matrix = |level| (matrices.double(level), matrices.double(level));
            Grids::Double(Multigrid::new(isa, window, &matrix, free, pull.clone()))
        };
        let matrix = matrices.double(0);
        Self { isa, window, matrix, form: *form, grids, gain: GAIN, exact: OnceLock::new(), pull }
    }

    /// The grids in f64. They are made before they are stored: making them runs parallel loops, in which this thread may start on another
    /// channel that needs them, too, and would wait for itself.
    fn exact(&self, single: &Multigrid<f32>) -> &Multigrid<f64> {
        if let Some(exact) = self.exact.get() {
            return exact;
        }
        let matrices = Matrices::new(&self.form, self.matrix.size());
        let matrix = |level| (matrices.double(level), matrices.double(level));
        let free = single.free().iter().map(|free| if *free == 0.0 { 0.0 } else { 1.0 });
        let exact = Multigrid::new(self.isa, self.window, &matrix, free.collect(), self.pull.clone());
        self.exact.get_or_init(|| exact)
    }

    /// The rectangle.
    pub fn window(&self) -> Window {
        self.window
    }

    /// Sets the free pixels of the image, all of which the window has to take up, to what the coarse grids make of the samples.
    /// Without coarse grids nothing happens.
    pub fn begin(&self, samples: &Plane, image: &mut Plane, tolerance: f64) {
        match &self.grids {
            Grids::Single(grids) => self.start(grids, (samples, image), tolerance),
            Grids::Double(grids) => self.start(grids, (samples, image), tolerance),
        }
    }

    fn start<T: Lanes>(&self, grids: &Multigrid<T>, (samples, image): (&Plane, &mut Plane), tolerance: f64) {
        let mut workspace = grids.workspace();
        // About a value in their midst and in units of the tolerance, which suit f32 whatever the samples are.
        let middle = f64::from(image.at(0, 0));
        if !grids.start(&mut workspace, &|y, x| (f64::from(samples.at(y, x)) - middle) / tolerance) {
            return;
        }
        self.correct(grids.free(), workspace.correction(), image, |_| middle, tolerance);
    }

    /// Replaces the free pixels of `image` in the window by the solution, to within about `tolerance`.
    pub fn solve(&self, samples: &Plane, image: &mut Plane, tolerance: f64, run: &Run<'_>) -> Outcome {
        let exactly = |grids: &Multigrid<f64>, image: &mut Plane| {
            let goal = Goal { tolerance: 1.0, error: 0.0, least: None, gain: 0.0, spare: 0.0, patience: 200 };
            self.refine(grids, goal, (samples, image), tolerance, run).0
        };
        match &self.grids {
            Grids::Single(grids) => {
                let goal = Goal {
                    tolerance: 0.0,
                    error: 1.0,
                    least: None,
                    gain: self.gain,
                    spare: SPARE,
                    patience: PATIENCE,
                };
                let unit = f64::max(EASE * tolerance, self.spacing(image));
                let (outcome, ends) = self.refine(grids, goal, (samples, image), unit, run);
                if ends { outcome } else { exactly(self.exact(grids), image) }
            }
            Grids::Double(grids) => exactly(grids, image),
        }
    }

    /// About how far the largest values of the image in the window are apart: no correction of a rounded image is smaller.
    fn spacing(&self, image: &Plane) -> f64 {
        let Window { y, x, height, width } = self.window;
        let top = |i: usize| {
            image.row(y + i)[x..][..width].iter().fold(0.0, |top: f32, value| top.max(value.abs()))
        };
        let top = (0..height).into_par_iter().map(top).into_iter().fold(0.0, f32::max);
        f64::from(f32::EPSILON) * f64::from(top.max(f32::MIN_POSITIVE))
    }

    /// Iterative refinement: corrections in the numbers of the grids for residuals in f64. Returns false where a round brings the image no
    /// nearer, and leaves it as it was before.
    fn refine<T: Lanes>(
        &self,
        grids: &Multigrid<T>,
        mut goal: Goal,
        (samples, image): (&Plane, &mut Plane),
        tolerance: f64,
        run: &Run<'_>,
    ) -> (Outcome, bool) {
        let mut workspace = grids.workspace();
        let mut outcome = Outcome::direct();
        let mut left = 1.0;
        for _ in 0..ROUNDS {
            // In units of the tolerance, which suit f32 whatever the range of the image.
            let (spans, residual) = workspace.residual();
            self.residual(samples, image, (grids.free(), spans), 1.0 / tolerance, residual);
            let ending = conjugate::solve(grids, &mut workspace, goal, run);
            let stuck = ending.stop == Stop::IterationLimit && ending.iterations > 0 && goal.gain > 0.0;
            if stuck && (ending.residual.is_nan() || ending.residual >= 1.0) {
                return (Outcome { stop: ending.stop, ..outcome }, false);
            }
            self.correct(grids.free(), workspace.correction(), image, f64::from, tolerance);
            goal.least = Some(ending.least).filter(|least| least.is_finite());
            left *= ending.residual;
            outcome.iterations += ending.iterations;
            outcome.residual = Some(left);
            outcome.stop = ending.stop;
            let over = !matches!(ending.stop, Stop::Converged | Stop::IterationLimit)
                || (ending.stop == Stop::IterationLimit && ending.iterations == 0)
                || goal.gain == 0.0;
            // A correction so small that its rounding does not matter is exact.
            let near = ending.stop == Stop::Converged && ending.left <= goal.error;
            if over || !grids.take_up(&mut workspace, SPARE / self.gain, !near) {
                return (outcome, true);
            }
        }
        (Outcome { stop: Stop::IterationLimit, ..outcome }, false)
    }

    /// Changes the free pixels of `image` in the window to what `before` makes of them and `scale c`.
    fn correct<T: Lanes>(
        &self,
        free: &[T],
        c: &[T],
        image: &mut Plane,
        before: impl Fn(f32) -> f64 + Sync,
        scale: f64,
    ) {
        let (window, width) = (self.window, image.size().width);
        let chunk = |(i, row): (usize, &mut [f32])| {
            let at = window.at(i, 0);
            let row = &mut row[window.x..][..window.width];
            for ((value, c), free) in row.iter_mut().zip(&c[at..]).zip(&free[at..]) {
                let new = (before(*value) + c.to_f64() * scale) as f32;
                *value = if *free == T::ZERO { *value } else { new };
            }
        };
        let rows = &mut image.pixels_mut()[window.y * width..][..window.height * width];
        rows.par_chunks_mut(width).enumerate().shared_if(window.is_large()).for_each(chunk);
    }

    /// Sets `residual` to `scale (diag(pull) (samples - image) - H image)`, computed in f64, at free pixels of the spans and to
    /// anything elsewhere. Pixels around the window count.
    fn residual<T: Lanes>(
        &self,
        samples: &Plane,
        image: &Plane,
        (free, spans): (&[T], &Spans),
        scale: f64,
        residual: &mut [T],
    ) {
        let (window, size) = (self.window, image.size());
        let stride = window.stride();
        window.in_chunks(residual, CHUNK, |first, rows| {
            let own = first..first + rows.len() / stride;
            let Some(columns) = spans.columns(own.clone(), 0..window.width) else { return };
            let part = Window {
                y: window.y + own.start,
                x: window.x + columns.start,
                height: own.len(),
                width: columns.len(),
            };
            // With what lies around it in the image; zeros beyond.
            let mut values = part.zeros::<f64>();
            let (left, right) = (part.x.min(PAD), PAD.min(size.width - part.x - part.width));
            for k in 0..part.height + 2 * PAD {
                let Some(y) = (part.y + k).checked_sub(PAD).filter(|&y| y < size.height) else { continue };
                let row = &image.row(y)[part.x - left..][..left + part.width + right];
                for (value, &pixel) in values[k * part.stride() + PAD - left..].iter_mut().zip(row) {
                    *value = f64::from(pixel);
                }
            }
            let mut product = part.zeros::<f64>();
            apply(self.isa, &self.matrix, part, &values, None, &mut product);
            for i in 0..part.height {
                let whole = window.at(own.start + i, columns.start);
                let product = &mut product[part.at(i, 0)..][..part.width];
                if let Some(pull) = &self.pull {
                    let [image, samples] = [image, samples].map(|plane| &plane.row(part.y + i)[part.x..]);
                    let pulls = pull[whole..].iter().zip(image.iter().zip(samples));
                    for (value, (&pull, (&pixel, &sample))) in product.iter_mut().zip(pulls) {
                        if pull > 0.0 {
                            *value -= pull * (f64::from(sample) - f64::from(pixel));
                        }
                    }
                }
                let out = &mut rows[i * stride + PAD + columns.start..][..part.width];
                vector::lacking(self.isa, &free[whole..][..part.width], scale, product, out);
            }
        });
    }
}

/// A buffer of a window, from its rows and columns.
fn rows(window: Window, value: impl Fn(usize, usize) -> f64 + Sync) -> Vec<f64> {
    let mut values = window.zeros();
    window.in_chunks(&mut values, CHUNK, |first, rows| {
        for (i, row) in rows.chunks_mut(window.stride()).enumerate() {
            for (j, to) in row[PAD..][..window.width].iter_mut().enumerate() {
                *to = value(first + i, j);
            }
        }
    });
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::variational::ss::{AIM, Settings, TOLERANCE};
    use lacuna_core::hash;

    /// Noise with a sample in every block of 8 x 8 pixels: one round in f32 is as exact as is asked for.
    #[test]
    fn smoothing_that_samples_hold_needs_no_second_round() {
        let size = Size::new(240, 256);
        let random = |y: usize, x: usize| (hash(1, (y * 1000 + x) as u64) >> 40) as f32 / (1 << 24) as f32;
        let one = |y: usize, x: usize| {
            let place = hash(2, (y / 8 * 1000 + x / 8) as u64) as usize % 64;
            (y % 8, x % 8) == (place / 8, place % 8)
        };
        let form = Form::new(Settings::default().kernel, 2, Settings::default().tension);
        for (density, lambda) in [(0.0, 0.01), (0.0, 0.3), (0.0, 1.0), (0.3, 0.01), (0.3, 1.0)] {
            let mask = Mask::from_fn(size, |y, x| one(y, x) || random(x, y) < density);
            let samples =
                Plane::from_fn(size, |y, x| if mask.is_measured(y, x) { random(y, x) } else { 0.0 });
            let region = Region::whole(Isa::best(), &form, &mask, lambda, None);
            assert_eq!(region.gain, GAIN_HELD);
            let run = Run::default();
            let mut found = samples.clone();
            region.begin(&samples, &mut found, TOLERANCE);
            let outcome = region.solve(&samples, &mut found, TOLERANCE, &run);
            assert_eq!(outcome.stop, Stop::Converged);
            let Grids::Single(single) = &region.grids else { panic!("f64 at once") };
            let mut exact = found.clone();
            let goal = Goal { tolerance: 1.0, error: 0.0, least: None, gain: 0.0, spare: 0.0, patience: 200 };
            region.refine(region.exact(single), goal, (&samples, &mut exact), 1e-9, &run);
            let distance = found.pixels().iter().zip(exact.pixels()).map(|(a, b)| (a - b).abs());
            let distance = f64::from(distance.fold(0.0, f32::max));
            assert!(distance < EASE * TOLERANCE, "{density} {lambda}: {distance}");
        }
    }

    /// Noise in a corner of a large image: what lies hundreds of pixels away hangs on it by less than f32 holds.
    #[test]
    fn far_from_all_samples_f64_takes_over() {
        let size = Size::new(900, 1000);
        let random = |y: usize, x: usize| (hash(1, (y * 1000 + x) as u64) >> 40) as f32 / (1 << 24) as f32;
        let mask = Mask::from_fn(size, |y, x| y < 150 && x < 150 && random(x, y) < 0.25);
        let samples = Plane::from_fn(size, |y, x| if mask.is_measured(y, x) { random(y, x) } else { 0.0 });
        let settings = Settings::default();
        let form = Form::new(settings.kernel, settings.order.number(), settings.tension);
        let region = Region::whole(Isa::best(), &form, &mask, 0.0, None);
        let run = Run::default();
        let begin = || {
            let mut image = samples.clone();
            region.begin(&samples, &mut image, AIM);
            Plane::from_fn(
                size,
                |y, x| {
                    if mask.is_measured(y, x) { samples.at(y, x) } else { image.at(y, x) }
                },
            )
        };
        let Grids::Single(single) = &region.grids else { panic!("f64 at once") };
        let goal =
            Goal { tolerance: 0.0, error: 1.0, least: None, gain: GAIN, spare: SPARE, patience: PATIENCE };
        let mut image = begin();
        assert!(!region.refine(single, goal, (&samples, &mut image), EASE * AIM, &run).1);
        let mut found = begin();
        assert_eq!(region.solve(&samples, &mut found, AIM, &run).stop, Stop::Converged);
        let mut closer = found.clone();
        region.solve(&samples, &mut closer, AIM / 100.0, &run);
        let distance = found.pixels().iter().zip(closer.pixels()).map(|(a, b)| (a - b).abs());
        let distance = distance.fold(0.0, f32::max);
        // What a correction of the aim may leave by the least eigenvalue.
        assert!(distance > 0.0 && f64::from(distance) < EASE * AIM, "{distance}");
    }
}
