//! Filled positions, texture coordinates and motion vectors lie on one surface of the measured ones around them.
//!
//! A filter that is smooth across a silhouette makes points between two surfaces, where there is nothing. For a missing pixel let
//! `q_i` be the nearest measured pixel in each of its quadrants, at distances `r_i` (as for a depth, `baseline::depth`), with
//! vectors `p_i`. Two of them are on one surface if `|p_i - p_j| / |q_i - q_j|` is at most four times what is usual there: the
//! least of these slopes, held between the median of the part and four times that. Of the surfaces the one whose weights
//! `1 / r_i` add up to most is taken. The filter's vector stays if it is on it by half of that slope, seen
//! from one of its `p_i`; any other becomes their mean with those weights.
//! A renderer that averages within a pixel has points between surfaces, too; of texture coordinates and motion held-out samples tell
//! ([`are_near`]), positions are always on a surface.
//! Fails: a surface that is seen edge-on, steeper than sixteen times the median, falls apart into its measured points.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;
use lacuna_filters::baseline::depth::DepthPlan;
use lacuna_filters::fill::{Options, Values, fill_with};
use lacuna_filters::{Bounds, Error, Mask, Method, Plane, Planes, Run, Size};

use super::Plans;

/// How much steeper than usual one surface may be.
const STEEP: f64 = 4.0;
/// Pixels that tell the median slope, at most.
const TOLD: usize = 1 << 14;
/// One of so many measured pixels is held out.
const HELD_OUT: u32 = 10;
/// Fewer held-out pixels decide nothing.
const FEWEST: usize = 64;
/// How much farther off the held-out samples is level.
const LEVEL: f64 = 1.01;

/// Measured vectors around a missing pixel.
struct Around {
    /// Their pixels.
    pixels: [usize; 4],
    /// Their distances.
    distances: [f64; 4],
    count: usize,
}

/// The vectors of a layer: samples by component.
struct Vectors<'a> {
    size: Size,
    samples: &'a [&'a [f32]],
    plan: &'a DepthPlan,
}

/// Brings the missing vectors of `planes` onto surfaces of `samples`; returns which pixels were moved.
pub fn keep(
    planes: &mut [&mut [f32]],
    samples: &[&[f32]],
    (size, missing): (Size, &[usize]),
    plan: &DepthPlan,
) -> usize {
    let vectors = Vectors { size, samples, plan };
    let step = missing.len().div_ceil(TOLD).max(1);
    let mut slopes: Vec<f64> =
        missing.iter().step_by(step).filter_map(|&at| vectors.least_slope(&vectors.around(at))).collect();
    slopes.retain(|slope| *slope > 0.0 && slope.is_finite());
    slopes.sort_unstable_by(f64::total_cmp);
    let usual = slopes.get(slopes.len() / 2).copied().unwrap_or(0.0);
    let found = missing.par_iter().map(|&at| {
        let own: Vec<f32> = planes.iter().map(|plane| plane[at]).collect();
        vectors.moved(&own, &vectors.around(at), usual)
    });
    let mut moved = 0;
    for (&at, vector) in missing.iter().zip(found) {
        let Some(vector) = vector else { continue };
        planes.iter_mut().zip(vector).for_each(|(plane, value)| plane[at] = value);
        moved += 1;
    }
    moved
}

/// Whether vectors on surfaces are as near to held-out samples, in the mean, as the filter's own.
pub fn are_near(
    samples: &[&[f32]],
    mask: &Mask,
    method: Method,
    (plans, run): (&Plans, &Run<'_>),
) -> Result<bool, Error> {
    let size = mask.size();
    let mut count = 0_u32;
    let mut held_out = Vec::new();
    let mut flags = mask.as_slice().to_vec();
    for (at, flag) in flags.iter_mut().enumerate().filter(|(_, flag)| **flag) {
        // Multiples of the golden ratio: spread evenly, and never in step with a mask.
        count = count.wrapping_add(0x9e37_79b9);
        if count < u32::MAX / HELD_OUT {
            *flag = false;
            held_out.push(at);
        }
    }
    if held_out.len() < FEWEST {
        return Ok(true);
    }
    let mask = Arc::new(Mask::new(size, flags)?);
    let planes = samples.iter().map(|plane| Plane::new(size, plane.to_vec())).collect::<Result<_, _>>()?;
    let mut options = Options::of(method);
    options.values = Values::Other;
    options.bounds = vec![Bounds::Free; samples.len()];
    let mut filled = fill_with(&Planes::new(size, planes)?, &mask, &options, plans, run)?.planes.into_vec();
    let mut planes: Vec<&mut [f32]> = filled.iter_mut().map(Plane::pixels_mut).collect();
    let distance = |planes: &[&mut [f32]]| -> f64 {
        let at = |&at: &usize| {
            let pairs = planes.iter().zip(samples);
            pairs
                .map(|(own, sample)| (f64::from(own[at]) - f64::from(sample[at])).powi(2))
                .sum::<f64>()
                .sqrt()
        };
        held_out.iter().map(at).sum()
    };
    let before = distance(&planes);
    let plan = plans.depth(&mask)?;
    keep(&mut planes, samples, (size, &held_out), &plan);
    Ok(distance(&planes) <= LEVEL * before)
}

impl Vectors<'_> {
    fn around(&self, at: usize) -> Around {
        let mut around = Around { pixels: [0; 4], distances: [0.0; 4], count: 0 };
        for pixel in self.plan.around(at).take(4) {
            around.pixels[around.count] = pixel;
            around.distances[around.count] = self.distance(at, pixel);
            around.count += 1;
        }
        around
    }

    /// Pixels from one to another.
    fn distance(&self, a: usize, b: usize) -> f64 {
        let width = self.size.width;
        let (y, x) = ((a / width).abs_diff(b / width) as f64, (a % width).abs_diff(b % width) as f64);
        y.hypot(x)
    }

    fn slope(&self, a: usize, b: usize) -> f64 {
        let squares = self.samples.iter().map(|plane| (f64::from(plane[a]) - f64::from(plane[b])).powi(2));
        squares.sum::<f64>().sqrt() / self.distance(a, b).max(1.0)
    }

    fn least_slope(&self, around: &Around) -> Option<f64> {
        let pixels = &around.pixels[..around.count];
        let pairs = pixels.iter().enumerate().flat_map(|(i, a)| pixels[..i].iter().map(move |b| (*a, *b)));
        pairs.map(|(a, b)| self.slope(a, b)).reduce(f64::min)
    }

    /// Which of the neighbours are on the surface that has most weight.
    fn surface(&self, around: &Around, most: f64) -> [bool; 4] {
        let count = around.count;
        let mut label: [usize; 4] = [0, 1, 2, 3];
        for (i, j) in (0..count).flat_map(|i| (0..i).map(move |j| (i, j))) {
            if self.slope(around.pixels[i], around.pixels[j]) <= most {
                let (from, to) = (label[i].max(label[j]), label[i].min(label[j]));
                label.iter_mut().filter(|own| **own == from).for_each(|own| *own = to);
            }
        }
        let weight = |wanted: usize| -> f64 {
            (0..count).filter(|&i| label[i] == wanted).map(|i| 1.0 / around.distances[i].max(1.0)).sum()
        };
        let best = (0..count).reduce(|best, i| if weight(label[i]) > weight(label[best]) { i } else { best });
        let best = best.map_or(usize::MAX, |best| label[best]);
        std::array::from_fn(|i| i < count && label[i] == best)
    }

    /// Where a filled vector goes; nothing where it stays.
    fn moved(&self, own: &[f32], around: &Around, usual: f64) -> Option<Vec<f32>> {
        let most = STEEP * self.least_slope(around).unwrap_or(0.0).clamp(usual, STEEP * usual);
        let on = self.surface(around, most);
        let chosen = || (0..around.count).filter(|&i| on[i]);
        chosen().next()?;
        let near = |i: usize| {
            let pairs = own.iter().zip(self.samples);
            let squares =
                pairs.map(|(&v, plane)| (f64::from(v) - f64::from(plane[around.pixels[i]])).powi(2));
            squares.sum::<f64>().sqrt() <= most / 2.0 * around.distances[i]
        };
        if own.iter().all(|value| value.is_finite()) && chosen().any(near) {
            return None;
        }
        let weight = |i: usize| 1.0 / around.distances[i].max(1.0);
        let total: f64 = chosen().map(weight).sum();
        let mean = |plane: &&[f32]| {
            (chosen().map(|i| weight(i) * f64::from(plane[around.pixels[i]])).sum::<f64>() / total) as f32
        };
        Some(self.samples.iter().map(mean).collect())
    }
}

#[cfg(test)]
mod tests {
    use lacuna_filters::Mask;

    use super::*;

    #[test]
    fn nothing_lies_between_two_surfaces() {
        let size = Size::new(9, 12);
        let mask = Mask::from_fn(size, |y, x| (y + x) % 3 == 0);
        let plan = DepthPlan::new(&mask).unwrap();
        let truth = |at: usize| {
            let (y, x) = ((at / 12) as f32, (at % 12) as f32);
            if x < 6.0 { [x * 0.1, y * 0.1, 1.0] } else { [x * 0.3, y * 0.3, 9.0] }
        };
        let all = 0..size.pixels();
        let samples: Vec<Vec<f32>> =
            (0..3).map(|axis| all.clone().map(|at| truth(at)[axis]).collect()).collect();
        let samples: Vec<&[f32]> = samples.iter().map(Vec::as_slice).collect();
        let missing: Vec<usize> = all.clone().filter(|&at| !mask.as_slice()[at]).collect();
        // Right where it is smooth, between the surfaces at the edge.
        let mut filled: Vec<Vec<f32>> = samples.iter().map(|plane| plane.to_vec()).collect();
        let edge = |at: usize| [5, 6].contains(&(at % 12));
        missing.iter().filter(|at| edge(**at)).for_each(|&at| filled[2][at] = 5.0);
        let before = filled.clone();
        let mut planes: Vec<&mut [f32]> = filled.iter_mut().map(Vec::as_mut_slice).collect();
        let moved = keep(&mut planes, &samples, (size, &missing), &plan);
        assert_eq!(moved, missing.iter().filter(|at| edge(**at)).count());
        for &at in &missing {
            assert!([1.0, 9.0].contains(&filled[2][at]), "{at}: {}", filled[2][at]);
            assert!(edge(at) || (0..3).all(|axis| filled[axis][at] == before[axis][at]), "{at}");
        }
    }

    #[test]
    fn held_out_samples_tell_antialiased_vectors_from_hard_ones() {
        let size = Size::new(80, 80);
        let mut state = 7_u32;
        let mask = Mask::from_fn(size, |_, _| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 30 == 0
        });
        let told = |width: f32| {
            let plane = |scale: f32| -> Vec<f32> {
                let at = |at: usize| {
                    let (y, x) = ((at / 80) as f32, (at % 80) as f32);
                    let across = ((y - 40.0).hypot(x - 40.0) - 25.0) / width;
                    scale * (0.01 * x + across.clamp(-1.0, 1.0))
                };
                (0..size.pixels()).map(|pixel| if mask.as_slice()[pixel] { at(pixel) } else { 0.0 }).collect()
            };
            let planes = [plane(1.0), plane(-3.0)];
            let samples = planes.each_ref().map(Vec::as_slice);
            let method = lacuna_filters::variational::ss::Settings::default().into();
            are_near(&samples, &mask, method, (&Plans::default(), &Run::default())).unwrap()
        };
        assert!(told(0.01) && !told(8.0));
    }
}
