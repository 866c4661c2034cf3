//! Leave-out errors: what a method makes of a measured pixel that it is not shown.
//!
//! - [`by_parts`], for any method: the samples are cut into 8 parts at random, each in turn is taken out and filled from the rest.
//! - [`of_spline`], for interpolating splines: with `x` the filled image, `E` the energy, `m` measured and `u` missing pixels,
//!   `S = E_mm - E_mu E_uu^-1 E_um`, every residual of leaving one sample out is known from one application of the energy,
//!
//!   ```text
//!   y_i - x_without_i(i) = (E x)_i / S_ii
//!   ```
//!
//!   At second order `1 / S_ii`, the variance of a sample given the others, goes by the square of their distance. Here it is
//!   `K` times the geometric mean of the squared distances to the four nearest ones, which is enough to rank pixels by.
//!
//! Source: M. Stone, "Cross-Validatory Choice and Assessment of Statistical Predictions", Journal of the Royal Statistical
//! Society B 36, 1974 (leaving out); G. Wahba, "Spline Models for Observational Data", SIAM 1990, section 4.2 (the identity).

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::hash;
use crate::baseline::nearest::NearestMap;
use crate::kernel::Isa;
use crate::kernel::stencil::{Separable, apply};
use crate::kernel::window::Window;
use crate::operator::energy::Form;
use crate::variational::ss;
use crate::{Error, Filter, Mask, Plane, Planes, Problem, Run, Size};

/// Parts into which the samples are cut.
const PARTS: u64 = 8;
/// Distances to other samples that count.
const NEAREST: usize = 4;
/// Samples are looked for up to so many pixels away.
const REACH: usize = 24;
/// Samples that one task takes.
const SAMPLES: usize = 1 << 10;
/// Channels of whose errors products are taken, at most.
const FEW: usize = 16;
/// `K`, which makes the error of low-discrepancy samples about that of their fill; no choice depends on it.
const FACTOR: f32 = 0.08;

/// At measured pixels the squared error of leaving them out, and the sixth power of the distance it took; else 0.
pub struct LeftOut {
    /// Sum over the channels.
    pub error: Vec<f32>,
    /// To the nearest sample that was not left out.
    pub distance: Vec<f32>,
    /// Sums over the samples of the products of the errors of any two channels, row by row; of more than [`FEW`] channels nothing.
    pub products: Vec<f64>,
}

/// Whether [`of_spline`] knows the errors of this spline.
pub fn suits(settings: &ss::Settings) -> bool {
    settings.lambda == 0.0 && settings.order == ss::Order::Second
}

/// By eight fills, each without an eighth of the samples.
pub fn by_parts(
    samples: &Planes,
    mask: &Arc<Mask>,
    filter: &dyn Filter,
    rough: f64,
    run: &Run<'_>,
) -> Result<LeftOut, Error> {
    let size = mask.size();
    let mut left = LeftOut::nothing(size, samples.len());
    let mut errors = vec![0.0; samples.len()];
    for part in 0..PARTS {
        let out = |pixel: usize| hash(0, pixel as u64) % PARTS == part;
        let kept = Arc::new(Mask::from_fn(size, |row, column| {
            mask.is_measured(row, column) && !out(row * size.width + column)
        }));
        if kept.is_empty() || kept.count() == mask.count() {
            continue;
        }
        let filled = fill(samples, &kept, filter, rough, run)?;
        let squared = NearestMap::new(&kept)?.squared_distances();
        for pixel in (0..size.pixels()).filter(|&pixel| mask.as_slice()[pixel] && out(pixel)) {
            let planes = samples.as_slice().iter().zip(filled.as_slice());
            for (error, (y, u)) in errors.iter_mut().zip(planes) {
                *error = y.pixels()[pixel] - u.pixels()[pixel];
            }
            left.add(pixel, &errors, (squared[pixel] as f32).powi(3));
        }
    }
    Ok(left)
}

impl LeftOut {
    fn nothing(size: Size, channels: usize) -> Self {
        let zeros = || vec![0.0; size.pixels()];
        let products = if channels <= FEW { channels * channels } else { 0 };
        Self { error: zeros(), distance: zeros(), products: vec![0.0; products] }
    }

    /// A sample, the errors of its channels, and the sixth power of its distance.
    fn add(&mut self, pixel: usize, errors: &[f32], distance: f32) {
        self.error[pixel] = errors.iter().map(|error| error * error).sum();
        self.distance[pixel] = distance;
        for (row, a) in self.products.chunks_exact_mut(errors.len()).zip(errors) {
            row.iter_mut().zip(errors).for_each(|(sum, b)| *sum += f64::from(*a) * f64::from(*b));
        }
    }
}

/// By the identity, from a spline's fill of all samples, before anything limits it.
pub fn of_spline(settings: &ss::Settings, mask: &Mask, filled: &Planes) -> LeftOut {
    let size = mask.size();
    let at: Vec<u32> =
        (0..size.pixels()).filter(|&pixel| mask.as_slice()[pixel]).map(|pixel| pixel as u32).collect();
    let energy: Separable<f32> =
        Form::new(settings.kernel, settings.order.number(), settings.tension).energy(size, (1.0, 1.0)).cast();
    let forces: Vec<Vec<f32>> = filled.as_slice().into_par_iter().map(|plane| applied(&energy, plane, &at));
    let offsets = offsets();
    let known = at.par_chunks(SAMPLES).map(|at| -> Vec<(f32, f32)> {
        let one = |&pixel: &u32| {
            let squared = nearest(mask, pixel, &offsets).map(|squared| squared as f32);
            // The fourth root.
            (FACTOR * squared.iter().product::<f32>().sqrt().sqrt(), squared[0].powi(3))
        };
        at.iter().map(one).collect()
    });
    let mut left = LeftOut::nothing(size, filled.len());
    let mut errors = vec![0.0; filled.len()];
    for (k, (&pixel, (variance, distance))) in at.iter().zip(known.into_iter().flatten()).enumerate() {
        errors.iter_mut().zip(&forces).for_each(|(error, forces)| *error = variance * forces[k]);
        left.add(pixel as usize, &errors, distance);
    }
    left
}

/// The method's image of the samples, as it comes, off by about `rough` times their range.
pub fn fill(
    samples: &Planes,
    mask: &Arc<Mask>,
    filter: &dyn Filter,
    rough: f64,
    run: &Run<'_>,
) -> Result<Planes, Error> {
    let mut out = Planes::zeros(samples.size(), samples.len());
    filter.plan(&Problem::fill(mask.clone()), run)?.reconstruct_roughly(samples, rough, &mut out, run)?;
    Ok(out)
}

/// `E x` at some pixels.
fn applied(energy: &Separable<f32>, plane: &Plane, at: &[u32]) -> Vec<f32> {
    let size = plane.size();
    let window = Window { y: 0, x: 0, height: size.height, width: size.width };
    // The energy does not see constants; rounding does.
    let sum: f64 = at.iter().map(|&pixel| f64::from(plane.pixels()[pixel as usize])).sum();
    let mean = (sum / at.len().max(1) as f64) as f32;
    let (mut x, mut q) = (window.zeros::<f32>(), window.zeros::<f32>());
    for row in 0..size.height {
        let start = window.at(row, 0);
        for (x, value) in x[start..start + size.width].iter_mut().zip(plane.row(row)) {
            *x = value - mean;
        }
    }
    apply(Isa::best(), energy, window, &x, None, &mut q);
    at.iter().map(|&pixel| q[window.at(pixel as usize / size.width, pixel as usize % size.width)]).collect()
}

/// Squared distances of a sample to the nearest other ones, from places around it.
fn nearest(mask: &Mask, pixel: u32, offsets: &[(u32, isize, isize)]) -> [u32; NEAREST] {
    let size = mask.size();
    let (row, column) = (pixel as usize / size.width, pixel as usize % size.width);
    let mut found = [(REACH * REACH) as u32; NEAREST];
    let mut count = 0;
    for &(squared, dy, dx) in offsets {
        let (y, x) = (row.wrapping_add_signed(dy), column.wrapping_add_signed(dx));
        if y < size.height && x < size.width && mask.is_measured(y, x) {
            found[count] = squared;
            count += 1;
            if count == NEAREST {
                break;
            }
        }
    }
    found
}

/// Places around a pixel, the nearest first.
fn offsets() -> Vec<(u32, isize, isize)> {
    let reach = REACH as isize;
    let all =
        (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| ((dy * dy + dx * dx) as u32, dy, dx)));
    let mut near: Vec<_> =
        all.filter(|&(squared, ..)| squared > 0 && squared as usize <= REACH * REACH).collect();
    near.sort_unstable();
    near
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::shuffle;

    const EXACT: f64 = 1e-4;

    /// Against leaving out one sample after the other: the same order of size, and mostly the same ranks.
    #[test]
    fn the_identity_agrees_with_leaving_out_one_by_one() {
        let size = Size::new(40, 44);
        let plane = Plane::from_fn(size, |y, x| {
            ((x * x + 3 * y) as f32 / 90.0).sin() + if x > y { 0.7 } else { 0.0 }
        });
        let mask = Arc::new(shuffle::mask(0, 0, size, 0.12, 4).unwrap());
        let (samples, settings) = (Planes::from(plane.clone()), ss::Settings::default());
        let filled = fill(&samples, &mask, &settings, EXACT, &Run::default()).unwrap();
        let left = of_spline(&settings, &mask, &filled);
        let (mut logarithms, mut count) = (Vec::new(), 0);
        for pixel in (0..size.pixels()).filter(|&pixel| mask.as_slice()[pixel]) {
            let (row, column) = (pixel / size.width, pixel % size.width);
            let inside = (4..size.height - 4).contains(&row) && (4..size.width - 4).contains(&column);
            let others = Mask::from_fn(size, |y, x| mask.is_measured(y, x) && (y, x) != (row, column));
            let without = fill(&samples, &Arc::new(others), &settings, EXACT, &Run::default()).unwrap();
            let exact = (plane.at(row, column) - without.as_slice()[0].at(row, column)).powi(2);
            assert!(left.distance[pixel] >= 1.0);
            if inside && exact > 1e-6 {
                logarithms.push(0.5 * (left.error[pixel] / exact).ln());
                count += 1;
            }
        }
        logarithms.sort_unstable_by(f32::total_cmp);
        let quantile = |share: usize| logarithms[share * count / 10];
        // `K` is larger than the identity's own, as it stands for missing pixels.
        assert!(count > 80 && (0.0..1.5).contains(&quantile(5)), "{count}: {}", quantile(5));
        assert!(quantile(9) - quantile(1) < 1.0, "{} to {}", quantile(1), quantile(9));
    }
}
