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

use crate::baseline::nearest::NearestMap;
use crate::kernel::Isa;
use crate::kernel::stencil::{Separable, apply};
use crate::kernel::window::{PAD, Window};
use crate::operator::energy::Form;
use crate::variational::ss;
use crate::{Error, Filter, Mask, Plane, Planes, Problem, Run, Size};
use lacuna_core::hash;

/// Parts into which the samples are cut.
const PARTS: u64 = 8;
/// Distances to other samples that count.
const NEAREST: usize = 4;
/// Samples are looked for up to so many pixels away.
const REACH: usize = 24;
/// Rows that one task takes.
const BAND: usize = 32;
/// Pixels that one task looks at.
const PIECE: usize = 1 << 16;
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
        add_products(&mut self.products, errors);
    }
}

/// Adds the products of any two errors, row by row.
fn add_products(products: &mut [f64], errors: &[f32]) {
    for (row, a) in products.chunks_exact_mut(errors.len().max(1)).zip(errors) {
        row.iter_mut().zip(errors).for_each(|(sum, b)| *sum += f64::from(*a) * f64::from(*b));
    }
}

/// By the identity, from a spline's fill of all samples, before anything limits it.
pub fn of_spline(settings: &ss::Settings, mask: &Mask, filled: &Planes) -> LeftOut {
    let size = mask.size();
    let identity = Identity::new(settings, mask, filled);
    let mut left = LeftOut::nothing(size, filled.len());
    let (rows, count) = (BAND * size.width.max(1), left.products.len());
    let bands = left.error.par_chunks_mut(rows).zip(left.distance.par_chunks_mut(rows)).enumerate();
    let products: Vec<Vec<f64>> = bands.map_init(Default::default, |buffers, (band, out)| {
        let mut products = vec![0.0; count];
        identity.rows(band * BAND, out, &mut products, buffers);
        products
    });
    for products in products {
        left.products.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
    }
    left
}

/// The same at some measured pixels, in the order of rows: by channel, what is measured less what is predicted.
pub fn of_spline_at(settings: &ss::Settings, mask: &Mask, filled: &Planes, at: &[u32]) -> Vec<Vec<f32>> {
    let identity = Identity::new(settings, mask, filled);
    let width = mask.size().width.max(1);
    let bands: Vec<&[u32]> =
        at.chunk_by(|a, b| *a as usize / width / BAND == *b as usize / width / BAND).collect();
    let found: Vec<Vec<f32>> = bands.par_iter().map_init(Default::default, |buffers, at| {
        let y = at[0] as usize / width / BAND * BAND;
        let window = Window { y, x: 0, height: BAND.min(mask.size().height - y), width };
        let at: Vec<usize> = at.iter().map(|pixel| *pixel as usize - y * width).collect();
        let mut errors = Vec::with_capacity(at.len() * filled.len());
        identity.errors(window, &at, buffers, |_, _, own| errors.extend_from_slice(own));
        errors
    });
    let channels = filled.len().max(1);
    (0..filled.len())
        .map(|k| found.iter().flat_map(|own| own.iter().skip(k).step_by(channels).copied()).collect())
        .collect()
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

/// What energy and mask say of leaving samples out.
struct Identity<'a> {
    energy: Separable<f32>,
    mask: &'a Mask,
    filled: &'a Planes,
    /// Of the samples of each plane. The energy does not see constants; rounding does.
    means: Vec<f32>,
    offsets: Vec<(u32, isize, isize)>,
}

impl<'a> Identity<'a> {
    fn new(settings: &ss::Settings, mask: &'a Mask, filled: &'a Planes) -> Self {
        let form = Form::new(settings.kernel, settings.order.number(), settings.tension);
        let means = filled.as_slice().iter().map(|plane| mean(mask, plane)).collect();
        Self { energy: form.energy(mask.size(), (1.0, 1.0)).cast(), mask, filled, means, offsets: offsets() }
    }

    /// Writes what is known of the samples in some rows, from row `y` on, and adds to the products.
    fn rows(
        &self,
        y: usize,
        (error, distance): (&mut [f32], &mut [f32]),
        products: &mut [f64],
        buffers: &mut [Vec<f32>; 2],
    ) {
        let width = self.mask.size().width;
        let window = Window { y, x: 0, height: error.len() / width, width };
        let from = y * width;
        let at: Vec<usize> = (0..error.len()).filter(|k| self.mask.as_slice()[from + k]).collect();
        self.errors(window, &at, buffers, |pixel, nearest, errors| {
            error[pixel] = errors.iter().map(|error| error * error).sum();
            distance[pixel] = nearest.powi(3);
            add_products(products, errors);
        });
    }

    /// Tells of measured pixels of a window as wide as the image, by index row by row: which, the squared distance to the nearest other one, and
    /// the errors of the channels.
    fn errors(
        &self,
        window: Window,
        at: &[usize],
        buffers: &mut [Vec<f32>; 2],
        mut tell: impl FnMut(usize, f32, &[f32]),
    ) {
        if at.is_empty() {
            return;
        }
        let forces: Vec<Vec<f32>> =
            (0..self.filled.len()).map(|channel| self.forces(window, channel, at, buffers)).collect();
        let mut errors = vec![0.0; forces.len()];
        for (k, &pixel) in at.iter().enumerate() {
            let place = (window.y + pixel / window.width, pixel % window.width);
            let squared = self.nearest(place).map(|squared| squared as f32);
            // The fourth root.
            let variance = FACTOR * squared.iter().product::<f32>().sqrt().sqrt();
            errors.iter_mut().zip(&forces).for_each(|(error, forces)| *error = variance * forces[k]);
            tell(pixel, squared[0], &errors);
        }
    }

    /// Squared distances of a sample to the nearest other ones, from places around it.
    fn nearest(&self, (row, column): (usize, usize)) -> [u32; NEAREST] {
        let (flags, size) = (self.mask.as_slice(), self.mask.size());
        let mut found = [(REACH * REACH) as u32; NEAREST];
        let mut count = 0;
        for &(squared, dy, dx) in &self.offsets {
            let (y, x) = (row.wrapping_add_signed(dy), column.wrapping_add_signed(dx));
            if y < size.height && x < size.width && flags[y * size.width + x] {
                found[count] = squared;
                count += 1;
                if count == NEAREST {
                    break;
                }
            }
        }
        found
    }

    /// `E x` at some pixels of a window. What buffers hold beyond the image does not matter.
    fn forces(&self, window: Window, channel: usize, at: &[usize], [x, q]: &mut [Vec<f32>; 2]) -> Vec<f32> {
        let (plane, mean) = (&self.filled.as_slice()[channel], self.means[channel]);
        x.resize(window.len(), 0.0);
        q.resize(window.len(), 0.0);
        let (first, last) =
            (window.y.saturating_sub(PAD), (window.y + window.height + PAD).min(plane.size().height));
        for row in first..last {
            let start = (row + PAD - window.y) * window.stride() + PAD;
            for (x, value) in x[start..start + window.width].iter_mut().zip(plane.row(row)) {
                *x = value - mean;
            }
        }
        apply(Isa::best(), &self.energy, window, x, None, q);
        at.iter().map(|&pixel| q[window.at(pixel / window.width, pixel % window.width)]).collect()
    }
}

/// The mean of a plane's samples.
fn mean(mask: &Mask, plane: &Plane) -> f32 {
    let both = mask.as_slice().par_chunks(PIECE).zip(plane.pixels().par_chunks(PIECE));
    let sums: Vec<f64> = both.map(|(flags, values)| {
        let pairs = flags.iter().zip(values);
        pairs.filter(|(flag, _)| **flag).map(|(_, &value)| f64::from(value)).sum()
    });
    (sums.iter().sum::<f64>() / mask.count().max(1) as f64) as f32
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

    #[test]
    fn errors_at_some_samples_are_those_at_all() {
        let size = Size::new(70, 44);
        let wave = |k: f32| Plane::from_fn(size, |y, x| ((x * x + 3 * y) as f32 / k).sin());
        let mask = Arc::new(shuffle::mask(0, 0, size, 0.2, 4).unwrap());
        let (samples, settings) = (Planes::of(size, vec![wave(90.0), wave(300.0)]), ss::Settings::default());
        let filled = fill(&samples, &mask, &settings, EXACT, &Run::default()).unwrap();
        let left = of_spline(&settings, &mask, &filled);
        let measured = |pixel: &u32| mask.as_slice()[*pixel as usize];
        let at: Vec<u32> = (0..size.pixels() as u32).filter(measured).step_by(3).collect();
        let errors = of_spline_at(&settings, &mask, &filled, &at);
        for (k, &pixel) in at.iter().enumerate() {
            let sum = errors[0][k].powi(2) + errors[1][k].powi(2);
            assert_eq!(sum, left.error[pixel as usize]);
        }
        // What is measured less what is predicted: mostly of the sign of what leaving one part out shows.
        let parts = Mask::from_fn(size, |y, x| {
            mask.is_measured(y, x) && at.binary_search(&((y * size.width + x) as u32)).is_err()
        });
        let without = fill(&samples, &Arc::new(parts), &settings, EXACT, &Run::default()).unwrap();
        let same = at.iter().zip(&errors[0]).filter(|(pixel, error)| {
            let pixel = **pixel as usize;
            let off = samples.as_slice()[0].pixels()[pixel] - without.as_slice()[0].pixels()[pixel];
            off * **error > 0.0
        });
        assert!(same.count() > at.len() * 3 / 4);
    }
}
