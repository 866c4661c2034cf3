//! What each candidate of a blend counts for at each pixel, from the products of the candidates' errors at samples.
//!
//! ```text
//! w(p) = argmin  w' (A(p) + s tr A(p) B / tr B) w,   w_k >= 0,  sum of w_k = 1,      A_kl(p) = sum over samples i of g(p - i) e_kl(i)
//! ```
//!
//! with `e_kl(i)` the product of two candidates' errors, `g` a Gaussian of some spacings of samples ([`Neighbourhood`]), `B` the sum over all of the image and
//! `s` its share: where few samples are around a pixel, or nothing differs, the image decides.

mod simplex;
mod slopes;
mod surfaces;

use lacuna_core::parallel::prelude::*;

use crate::domain::Map;
use crate::estimate::{HeldOut, Voronoi};
use crate::{Mask, Plane, Planes, Size};
use lacuna_core::hash;
use simplex::{best, best_of};
pub use slopes::Slopes;
pub use surfaces::{BySurface, Surfaces};

/// What the weights of a pixel are learned from.
#[derive(Clone, Copy, Debug)]
pub struct Neighbourhood {
    /// Width of the Gaussian, in spacings of the samples.
    pub spread: f64,
    /// What the errors of all of the image count for.
    pub frame: f64,
}

/// Where what is held out is as it will be filled.
const HELD_OUT: Neighbourhood = Neighbourhood { spread: 4.0, frame: 0.5 };
/// What a candidate must take away of the squared error to count where it has to be computed.
const WORTH: f64 = 0.01;
/// Cells to each side of a cell that its neighbourhood takes in: three Gaussian widths.
const REACH: usize = 6;
/// By how much the misses around a cell may be larger by chance where those of the image are not.
const STILL: f64 = 1.3;
/// The same where they are: none, but for rounding.
const ROUNDING: f64 = 0.02;
/// Parts of the held-out samples that are blended with weights of the others.
const CROSSED: u64 = 5;
/// Cuts them independently of the folds.
const CUT: u64 = 0x52;
/// What is added to the diagonal of errors, over their mean, so that candidates that agree share alike.
const RIDGE: f64 = 1e-4;

/// Weights in cells, by candidate; they sum to 1.
#[derive(Clone, Debug)]
pub struct Weights {
    size: Size,
    /// Side of a cell.
    side: usize,
    cells: Size,
    /// Row and column, in the image of the cells, of the first pixel of what is weighed.
    first: [f32; 2],
    /// What the errors of all of the image count for.
    frame: f64,
    /// Of each candidate, the weight in each cell; empty for one that counts nowhere.
    of: Vec<Vec<f32>>,
    /// Of each candidate, its mean weight at missing pixels.
    shares: Vec<f64>,
}

/// What was measured at held-out samples, and what these stand for.
#[derive(Clone, Copy)]
pub struct Truth<'a> {
    /// Where samples are.
    pub mask: &'a Mask,
    /// Their cells, by which those that stand close together do not speak for all of the image; without, all count alike.
    pub voronoi: Option<&'a Voronoi>,
    /// Their values.
    pub samples: &'a Planes,
    /// Errors are those of what it shows of mapped values ([`Map::shown`]); a linear one compares values as they are, mapped or not.
    pub map: Map,
    /// What the first candidate's squared error is at missing pixels, which stand nearer to samples, over that at held-out ones: all inherit as
    /// much of its error as theirs go along with it.
    pub less: f64,
}

/// A candidate that is taken alone where that costs little and is right.
#[derive(Clone, Copy, Debug)]
pub struct Preferred<'a> {
    /// Its place among the candidates.
    pub candidate: usize,
    /// The share of the squared error that it may cost.
    pub loss: f64,
    /// Squared errors at pixels, which are to be no larger around than those of the first candidate.
    pub misses: &'a [(u32, f64)],
}

/// Products of the errors of two candidates.
type Products = Vec<f64>;

impl Weights {
    /// From predictions at the same held-out samples, one list a candidate; nothing held out leaves all to the first. Candidates that are not
    /// worth their time do not count.
    pub fn new(truth: &Truth<'_>, held: &[HeldOut], prefers: Option<Preferred<'_>>) -> Self {
        let mask = truth.mask;
        let at = held.first().map_or(&[][..], |held| &held.at);
        if at.is_empty() || held.len() < 2 {
            return Self::first(mask, (at, HELD_OUT));
        }
        let (mut own, mut around, mut whole) = Self::of_errors(truth, held);
        let right = prefers.map(|one| own.right(at, &around, one.misses));
        around.iter_mut().chain([&mut whole]).for_each(|products| inherit(products, held.len(), truth.less));
        let mut counting: Vec<usize> = (0..held.len()).collect();
        while let Some(least) = Self::dispensable(&around, (&whole, own.frame), held.len(), &counting) {
            counting.retain(|&k| k != least);
        }
        own.of = Self::solve(&around, (&whole, own.frame), held.len(), &counting).0;
        if let (Some(right), Some(Preferred { candidate, loss, .. })) = (right, prefers)
            && own.counts(candidate)
        {
            for (cell, products) in around.iter().enumerate().filter(|(cell, _)| right[*cell]) {
                let error = |among: &[usize]| {
                    best_of(products, (&whole, own.frame), held.len(), (among, &counting)).1
                };
                if error(&[candidate]) <= (1.0 + loss) * error(&counting) {
                    for &k in &counting {
                        own.of[k][cell] = f32::from(u8::from(k == candidate));
                    }
                }
            }
        }
        own.shares = own.mean_at_missing(mask);
        own
    }

    /// Of each cell, whether the mean of misses around it is no larger than that of the first candidate's errors, of which `around` has the
    /// sums of products; a mean over all of the image is added to both in its share.
    fn right(&self, at: &[u32], around: &[Products], misses: &[(u32, f64)]) -> Vec<bool> {
        // Of each cell: the held-out samples, the misses and their sum.
        let mut sums = vec![vec![0.0; 3]; self.cells.pixels()];
        for &pixel in at {
            sums[self.cell(pixel as usize)][0] += 1.0;
        }
        for &(pixel, miss) in misses {
            let sums = &mut sums[self.cell(pixel as usize)];
            sums[1] += 1.0;
            sums[2] += miss;
        }
        let (all, missed) = (sum(&sums), misses.iter().map(|(_, miss)| miss).sum::<f64>());
        let sums = blur(self.cells, &sums);
        let held: f64 = sums.iter().map(|sums| sums[0]).sum();
        let total = around.iter().map(|products| products[0]).sum::<f64>() / held.max(f64::MIN_POSITIVE);
        let still = all[1] == 0.0 || missed / all[1] <= total;
        let most = if still { STILL } else { 1.0 + ROUNDING };
        let right = |(sums, products): (&Vec<f64>, &Products)| {
            let added = self.frame * total;
            let [own, other] = [(products[0], sums[0]), (sums[2], sums[1])]
                .map(|(sum, count)| if count > 0.0 { sum / count } else { 0.0 } + added);
            other <= most * own
        };
        sums.iter().zip(around).map(right).collect()
    }

    /// Cells and sums as of [`Self::summed`], from predictions at the same held-out samples.
    fn of_errors(truth: &Truth<'_>, held: &[HeldOut]) -> (Self, Vec<Products>, Products) {
        let Truth { mask, voronoi, samples, map, .. } = *truth;
        let at = held.first().map_or(&[][..], |held| &held.at);
        let mut errors = vec![0.0_f64; held.len()];
        Self::summed(mask, (at, HELD_OUT), held.len(), |i, pixel, products| {
            let factor = voronoi.map_or(1.0, |voronoi| f64::from(voronoi.weight(pixel as u32)).sqrt());
            for (channel, plane) in samples.as_slice().iter().enumerate() {
                let value = map.shown(f64::from(plane.pixels()[pixel]));
                for (error, held) in errors.iter_mut().zip(held) {
                    *error = factor * (map.shown(f64::from(held.predicted[channel][i])) - value);
                }
                add_products(&errors, products);
            }
        })
    }

    /// The squared error of predictions, as candidates' are compared.
    pub fn error(truth: &Truth<'_>, held: &HeldOut) -> f64 {
        Self::of_errors(truth, std::slice::from_ref(held)).2[0]
    }

    /// Cells for as many held-out samples, in which the first candidate counts alone.
    fn first(mask: &Mask, (at, near): (&[u32], Neighbourhood)) -> Self {
        let size = mask.size();
        let spacing = (size.pixels() as f64 / at.len().max(1) as f64).sqrt();
        let side = ((0.5 * near.spread * spacing).round() as usize).max(1);
        let cells = Size::new(size.height.div_ceil(side), size.width.div_ceil(side));
        let of = vec![vec![1.0; cells.pixels()]];
        let first = [0.0; 2];
        Self { size, side, cells, first, frame: near.frame, of, shares: vec![1.0] }
    }

    /// Cells, in which the first candidate counts alone, the sums of products around each, and those over all.
    fn summed(
        mask: &Mask,
        (at, near): (&[u32], Neighbourhood),
        count: usize,
        mut products: impl FnMut(usize, usize, &mut [f64]),
    ) -> (Self, Vec<Products>, Products) {
        let own = Self::first(mask, (at, near));
        let cells = own.cells;
        let mut sums = vec![vec![0.0; count * count]; cells.pixels()];
        for (i, &pixel) in at.iter().enumerate() {
            products(i, pixel as usize, &mut sums[own.cell(pixel as usize)]);
        }
        let whole = sum(&sums);
        let around = blur(cells, &sums);
        (own, around, whole)
    }

    fn cell(&self, pixel: usize) -> usize {
        pixel / self.size.width / self.side * self.cells.width + pixel % self.size.width / self.side
    }

    /// The candidate whose absence costs least, if that is not worth its time.
    fn dispensable(around: &[Products], whole: (&[f64], f64), count: usize, all: &[usize]) -> Option<usize> {
        if all.len() < 2 {
            return None;
        }
        let error = |among: &[usize]| {
            let errors =
                around.par_iter().with_min_len(64).map(|cell| best_of(cell, whole, count, (among, all)).1);
            errors.iter().sum::<f64>()
        };
        let without = |&k: &usize| {
            let rest: Vec<usize> = all.iter().copied().filter(|&other| other != k).collect();
            (error(&rest), k)
        };
        let (least, k) = all.iter().map(without).min_by(|a, b| a.0.total_cmp(&b.0))?;
        (least * (1.0 - WORTH) <= error(all)).then_some(k)
    }

    /// The weights of all cells, by candidate, and the squared error that they leave.
    fn solve(
        around: &[Products],
        whole: (&[f64], f64),
        count: usize,
        among: &[usize],
    ) -> (Vec<Vec<f32>>, f64) {
        let cells = around.par_iter().with_min_len(64).map(|cell| best(cell, whole, count, among));
        let error = cells.iter().map(|cell| cell.1).sum();
        let of = |k: usize| match among.iter().position(|&other| other == k) {
            Some(at) => cells.iter().map(|cell| cell.0[at] as f32).collect(),
            None => Vec::new(),
        };
        ((0..count).map(of).collect(), error)
    }

    /// Of each candidate the mean weight at missing pixels; at all of them where none is missing.
    fn mean_at_missing(&self, mask: &Mask) -> Vec<f64> {
        let full = mask.is_full();
        let mut missing = vec![0_usize; self.cells.pixels()];
        for (row, flags) in mask.as_slice().chunks(self.size.width).enumerate() {
            let missing = &mut missing[row / self.side * self.cells.width..];
            for (missing, flags) in missing.iter_mut().zip(flags.chunks(self.side)) {
                *missing += flags.iter().filter(|flag| full || !**flag).count();
            }
        }
        let all = missing.iter().sum::<usize>().max(1) as f64;
        let share = |of: &Vec<f32>| {
            of.iter().zip(&missing).map(|(&w, &n)| f64::from(w) * n as f64).sum::<f64>() / all
        };
        self.of.iter().map(share).collect()
    }

    /// Whether a candidate counts anywhere.
    pub fn counts(&self, candidate: usize) -> bool {
        self.of.get(candidate).is_some_and(|of| !of.is_empty())
    }

    /// The only candidate that counts, if there is one.
    pub fn alone(&self) -> Option<usize> {
        let mut counting = (0..self.of.len()).filter(|&k| self.counts(k));
        counting.next().filter(|_| counting.next().is_none())
    }

    /// The same where one candidate counts alone.
    pub fn only(mut self, candidate: usize) -> Self {
        for (k, (of, share)) in self.of.iter_mut().zip(&mut self.shares).enumerate() {
            let alone = k == candidate;
            *of = if alone { vec![1.0; self.cells.pixels()] } else { Vec::new() };
            *share = f64::from(u8::from(alone));
        }
        self
    }

    /// The same for an image that begins at this row and column; beyond the cells the outermost ones count.
    pub fn at_corner(&self, corner: [i64; 2]) -> Self {
        Self { first: corner.map(|at| at as f32), ..self.clone() }
    }

    /// The mean weight of a candidate at missing pixels.
    pub fn share(&self, candidate: usize) -> f64 {
        self.shares.get(candidate).copied().unwrap_or(0.0)
    }

    /// Adds a candidate's image, weighted, to the blend.
    pub fn add(&self, candidate: usize, image: &Planes, out: &mut Planes) {
        let of = &self.of[candidate];
        let width = image.size().width;
        for (out, image) in out.as_mut_slice().iter_mut().zip(image.as_slice()) {
            let rows =
                out.pixels_mut().par_chunks_mut(width).zip(image.pixels().par_chunks(width)).enumerate();
            rows.for_each(|(row, (out, image))| {
                for (column, (out, &value)) in out.iter_mut().zip(image).enumerate() {
                    *out += self.at(of, row, column) * value;
                }
            });
        }
    }

    /// At each pixel the mean of a value of each candidate, as these are weighted there.
    pub fn mean(&self, values: &[f64]) -> Plane {
        let counting = || values.iter().zip(&self.of).filter(|(value, of)| **value != 0.0 && !of.is_empty());
        Plane::from_fn(self.size, |row, column| {
            counting().map(|(value, of)| *value as f32 * self.at(of, row, column)).sum()
        })
    }

    /// Linearly between the centres of cells.
    fn at(&self, of: &[f32], row: usize, column: usize) -> f32 {
        let between = |at: usize, first: f32, count: usize| {
            let place = ((at as f32 + first + 0.5) / self.side as f32 - 0.5).clamp(0.0, (count - 1) as f32);
            let low = (place as usize).min(count.saturating_sub(2));
            (low, (low + 1).min(count - 1), place - low as f32)
        };
        let (top, bottom, y) = between(row, self.first[0], self.cells.height);
        let (left, right, x) = between(column, self.first[1], self.cells.width);
        let line = |row: usize| {
            let (a, b) = (of[row * self.cells.width + left], of[row * self.cells.width + right]);
            a + x * (b - a)
        };
        let (a, b) = (line(top), line(bottom));
        a + y * (b - a)
    }

    /// The blend of what was predicted at held-out samples, each part of them with weights that the others have taught: those that it has
    /// taught itself fit its own errors, too, and make the blend look up to 2 dB better than it is. `learn` makes weights of some of them.
    pub fn crossed(held: &[HeldOut], learn: &dyn Fn(&[HeldOut]) -> Self) -> HeldOut {
        let part = |pixel: u32| hash(CUT, u64::from(pixel)) % CROSSED;
        let of = |wanted: &dyn Fn(u32) -> bool| -> Vec<HeldOut> {
            held.iter().map(|held| held.sorted(wanted)).collect()
        };
        let mut blend = HeldOut::default();
        for own in 0..CROSSED {
            let others = learn(&of(&|pixel| part(pixel) != own));
            blend.extend(others.of_held_out(&of(&|pixel| part(pixel) == own)));
        }
        blend.sorted(|_| true)
    }

    /// The blend of what was predicted at held-out samples.
    pub fn of_held_out(&self, held: &[HeldOut]) -> HeldOut {
        let mut blend = held.first().cloned().unwrap_or_default();
        if self.alone() == Some(0) {
            return blend;
        }
        for (channel, values) in blend.predicted.iter_mut().enumerate() {
            for (i, (value, &pixel)) in values.iter_mut().zip(&blend.at).enumerate() {
                let place = (pixel as usize / self.size.width, pixel as usize % self.size.width);
                let counting = held.iter().enumerate().filter(|(k, _)| self.counts(*k));
                *value = counting
                    .map(|(k, held)| self.at(&self.of[k], place.0, place.1) * held.predicted[channel][i])
                    .sum();
            }
        }
        blend
    }
}

/// Adds the products of all pairs.
pub fn add_products(errors: &[f64], products: &mut [f64]) {
    for (row, a) in products.chunks_exact_mut(errors.len()).zip(errors) {
        row.iter_mut().zip(errors).for_each(|(product, b)| *product += a * b);
    }
}

/// Takes from the products of errors what all have of a part of the first one's.
fn inherit(products: &mut [f64], count: usize, less: f64) {
    let first = products[..count].to_vec();
    if first[0] > 0.0 && less < 1.0 {
        for (k, row) in products.chunks_exact_mut(count).enumerate() {
            row.iter_mut().zip(&first).for_each(|(own, l)| *own -= (1.0 - less) * first[k] * l / first[0]);
        }
    }
}

fn sum(cells: &[Products]) -> Products {
    let mut whole = vec![0.0; cells.first().map_or(0, Vec::len)];
    for cell in cells {
        whole.iter_mut().zip(cell).for_each(|(sum, value)| *sum += value);
    }
    whole
}

/// Convolves with a Gaussian whose standard deviation is two cells, along rows and columns.
fn blur(size: Size, cells: &[Products]) -> Vec<Products> {
    let gauss = |k: usize| (-0.125 * (k * k) as f64).exp();
    let pass = |from: &[Products], step: usize, length: usize, place: &(dyn Fn(usize) -> usize + Sync)| {
        (0..from.len()).into_par_iter().with_min_len(64).map(|at| {
            let here = place(at);
            let mut sum = vec![0.0; from[at].len()];
            for other in here.saturating_sub(REACH)..(here + REACH + 1).min(length) {
                let weight = gauss(other.abs_diff(here));
                let from = &from[at + other * step - here * step];
                sum.iter_mut().zip(from).for_each(|(sum, value)| *sum += weight * value);
            }
            sum
        })
    };
    let rows = pass(cells, 1, size.width, &|at| at % size.width);
    pass(&rows, size.width, size.height, &|at| at / size.width)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples that stand for all, as they are.
    fn told<'a>(mask: &'a Mask, samples: &'a Planes) -> Truth<'a> {
        Truth { mask, voronoi: None, samples, map: Map::Linear, less: 1.0 }
    }

    /// A mean of values is the blend of images of these values.
    #[test]
    fn means_are_blends_of_constant_images() {
        let size = Size::new(50, 40);
        let mask = Mask::from_fn(size, |y, x| (y + 2 * x) % 4 == 0);
        let truth = Planes::zeros(size, 1);
        let at: Vec<u32> = (0..2000).filter(|&pixel| mask.as_slice()[pixel as usize]).collect();
        // Each candidate is right in a part of the image.
        let one = |k: usize| {
            let sign =
                |pixel: u32| if hash(k as u64, u64::from(pixel)).is_multiple_of(2) { 1.0 } else { -1.0 };
            let error = |pixel: &u32| sign(*pixel) * if *pixel as usize / 667 == k { 0.01 } else { 0.1 };
            let values = at.iter().map(error).collect();
            HeldOut { at: at.clone(), predicted: vec![values], variance: Vec::new() }
        };
        let held: Vec<HeldOut> = (0..3).map(one).collect();
        let weights = Weights::new(&told(&mask, &truth), &held, None);
        assert!(weights.counts(0) && weights.counts(1) && weights.counts(2));
        let values = [2.0, 0.0, -5.0];
        let mut blend = Planes::zeros(size, 1);
        for (k, value) in values.iter().enumerate() {
            let image = Plane::from_fn(size, |_, _| *value as f32);
            weights.add(k, &Planes::of(size, vec![image]), &mut blend);
        }
        let mean = weights.mean(&values);
        for (a, b) in mean.pixels().iter().zip(blend.as_slice()[0].pixels()) {
            assert!((a - b).abs() <= 16.0 * f32::EPSILON, "{a} {b}");
        }
        assert!(weights.mean(&[1.0; 3]).pixels().iter().all(|sum| (sum - 1.0).abs() <= 8.0 * f32::EPSILON));
    }

    /// A blend of errors that have nothing in common is better on those that it was learned from than on others, which crossing shows.
    #[test]
    fn a_crossed_blend_is_as_good_as_on_new_samples() {
        let size = Size::new(64, 64);
        let mask = Mask::from_fn(size, |y, x| (y + 2 * x) % 8 == 0);
        let truth = Planes::zeros(size, 1);
        let at: Vec<u32> = (0..4096).filter(|&pixel| mask.as_slice()[pixel as usize]).collect();
        // Heavy tails, as of a few edges.
        let error = |seed: u64, pixel: u32| {
            let random = hash(seed, u64::from(pixel)) as f64 / u64::MAX as f64 - 0.5;
            (2.0 * random).powi(21) as f32
        };
        let draw = |seed: u64| -> Vec<HeldOut> {
            let one = |k: u64| {
                let values = at.iter().map(|&pixel| error(3 * seed + k, pixel)).collect();
                HeldOut { at: at.clone(), predicted: vec![values], variance: Vec::new() }
            };
            (0..3).map(one).collect()
        };
        let learn = |held: &[HeldOut]| Weights::new(&told(&mask, &truth), held, None);
        let mean = |held: &HeldOut| {
            let errors = held.squared_errors(&truth);
            errors.iter().sum::<f64>() / errors.len() as f64
        };
        let (mut own, mut crossed, mut new) = (0.0, 0.0, 0.0);
        for seed in 0..20 {
            let held = draw(2 * seed);
            let weights = learn(&held);
            own += mean(&weights.of_held_out(&held));
            new += mean(&weights.of_held_out(&draw(2 * seed + 1)));
            let blend = Weights::crossed(&held, &learn);
            assert_eq!(blend.at, at);
            crossed += mean(&blend);
        }
        assert!(own < 0.9 * new, "{own} {crossed} {new}");
        assert!((crossed / new - 1.0).abs() < 0.1, "{own} {crossed} {new}");
    }

    /// Of errors `a`, `c a + r` with `r` apart from `a`: those of a part of `a`.
    #[test]
    fn what_goes_along_with_the_first_error_is_inherited_in_part() {
        let (a, c, r, less) = (4.0, 0.5, 3.0, 0.3);
        let mut products = vec![a, c * a, c * a, c * c * a + r];
        inherit(&mut products, 2, less);
        let expected = [less * a, less * c * a, less * c * a, less * c * c * a + r];
        assert!(products.iter().zip(expected).all(|(found, e)| (found - e).abs() < 1e-12), "{products:?}");
    }
}
