//! The transfer function integrated over values, for pre-integrated segments.
//!
//! With `t(v)` the extinction per step and `c(v)` the colour, a segment from value `a` to `b` has the opacity
//! `1 - exp(-mean of t over [a, b])` and the colour `integral of t c / integral of t`. Both integrals are differences
//! of running sums over the table's entries, which go on beyond its ends with the densities of these. Attenuation within
//! one segment is left out, as in Engel's fast table.

use super::transfer::{ENTRIES, Table};

/// Opacities are held below this, where extinction would be infinite.
const LARGEST: f64 = 1.0 - 1e-9;

/// Running integrals over the table of a transfer function.
#[derive(Clone, Debug, PartialEq)]
pub struct Integral {
    /// Extinction times red, green, blue, and extinction, integrated from the first entry on.
    sums: Vec<[f64; 4]>,
    /// The integrands at the first and at the last entry, which all values beyond have.
    ends: [[f64; 4]; 2],
    table: Table,
}

impl Integral {
    /// The integrals of a table.
    pub fn new(table: &Table) -> Self {
        let density = |k: usize| {
            let [red, green, blue, opacity] = table.entry(k).map(f64::from);
            let extinction = -(-opacity.min(LARGEST)).ln_1p();
            [red * extinction, green * extinction, blue * extinction, extinction]
        };
        let mut sums = vec![[0.0; 4]];
        let mut sum = [0.0; 4];
        for k in 1..ENTRIES {
            let (a, b) = (density(k - 1), density(k));
            for part in 0..4 {
                sum[part] += 0.5 * (a[part] + b[part]);
            }
            sums.push(sum);
        }
        Self { sums, ends: [density(0), density(ENTRIES - 1)], table: table.clone() }
    }

    /// Mean colour and opacity of the segment between two values.
    #[inline(always)]
    pub fn segment(&self, from: f32, to: f32) -> ([f32; 3], f32) {
        let (a, b) = (self.table.place(from), self.table.place(to));
        let width = b - a;
        // Within a fraction of an entry the function is as good as constant.
        if width.abs() < 1.0 / 64.0 {
            let [red, green, blue, opacity] = self.table.at(0.5 * (from + to));
            return ([red, green, blue], opacity);
        }
        let (start, end) = (self.at(a), self.at(b));
        let extinction = (end[3] - start[3]) / width;
        if extinction <= 0.0 {
            return ([0.0; 3], 0.0);
        }
        let over = 1.0 / (extinction * width);
        let colour = [0, 1, 2].map(|k| ((end[k] - start[k]) * over) as f32);
        (colour, -(-extinction).exp_m1() as f32)
    }

    /// The integrals up to a position in the table; within an entry the integrand is taken as constant.
    #[inline(always)]
    fn at(&self, place: f64) -> [f64; 4] {
        let within = place.clamp(0.0, (ENTRIES - 1) as f64);
        let entry = (within as usize).min(ENTRIES - 2);
        let (share, beyond) = (within - entry as f64, place - within);
        let (a, b, end) = (self.sums[entry], self.sums[entry + 1], self.ends[usize::from(beyond > 0.0)]);
        std::array::from_fn(|k| a[k] + share * (b[k] - a[k]) + beyond * end[k])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Curve, Joining, Transfer};

    #[test]
    fn a_segment_has_the_mean_extinction_of_its_values() {
        // Extinction that grows linearly with the value v in 0..1: t = v, opacity 1 - exp(-v).
        let opacity =
            (0..=1000).map(|k| (f64::from(k) / 1000.0, [1.0 - (-f64::from(k) / 1000.0).exp()])).collect();
        let transfer = Transfer {
            colour: Curve::new(vec![(0.0, [0.0; 3]), (1.0, [1.0, 0.5, 0.0])], Joining::Linear).unwrap(),
            opacity: Curve::new(opacity, Joining::Linear).unwrap(),
            domain: (0.0, 1.0),
            lookup: crate::Lookup::Linear,
        };
        let integral = Integral::new(&transfer.table(1.0));
        for (a, b) in [(0.1_f32, 0.9_f32), (0.9, 0.1), (0.3, 0.300_1), (0.5, 0.5), (0.0, 1.0)] {
            let (colour, opacity) = integral.segment(a, b);
            let (a, b) = (f64::from(a), f64::from(b));
            let mean = 0.5 * (a + b);
            assert!((f64::from(opacity) - (1.0 - (-mean).exp())).abs() < 2e-4, "{a} {b} {opacity}");
            // The mean of v v over the mean of v.
            let red = (a * a + a * b + b * b) / 3.0 / mean;
            assert!((f64::from(colour[0]) - red).abs() < 1e-3, "{a} {b} {colour:?}");
        }
    }

    #[test]
    fn values_beyond_the_domain_count() {
        let transfer = Transfer {
            colour: Curve::new(vec![(0.0, [1.0, 0.0, 0.2]), (1.0, [0.1, 1.0, 0.2])], Joining::Linear)
                .unwrap(),
            opacity: Curve::new(vec![(0.0, [0.1]), (0.4, [0.0]), (1.0, [0.9])], Joining::Linear).unwrap(),
            domain: (0.2, 0.6),
            lookup: crate::Lookup::Linear,
        };
        let table = transfer.table(1.0);
        let integral = Integral::new(&table);
        for (a, b) in
            [(-3.0, 4.0), (4.0, -3.0), (0.3, 9.0), (-2.0, -1.0), (2.0, 50.0), (-1.0, 0.3), (0.1, 1e9)]
        {
            let ([red, green, blue], opacity) = integral.segment(a, b);
            let mut sums = [0.0; 4];
            for k in 0..100_000 {
                let [red, green, blue, opacity] =
                    table.at(a + (k as f32 + 0.5) / 1e5 * (b - a)).map(f64::from);
                let extinction = -(-opacity).ln_1p();
                for (sum, colour) in sums.iter_mut().zip([red, green, blue, 1.0]) {
                    *sum += extinction * colour / 1e5;
                }
            }
            assert!((f64::from(opacity) + (-sums[3]).exp_m1()).abs() < 1e-4, "{a} {b} {opacity} {sums:?}");
            for (found, sum) in [red, green, blue].into_iter().zip(sums) {
                assert!((f64::from(found) - sum / sums[3]).abs() < 1e-3, "{a} {b} {found} {sums:?}");
            }
        }
    }

    #[test]
    fn a_thin_peak_is_not_stepped_over() {
        let peak = vec![(0.49, [0.0]), (0.5, [0.9]), (0.51, [0.0])];
        let transfer = Transfer {
            colour: Curve::new(vec![(0.0, [1.0; 3])], Joining::Linear).unwrap(),
            opacity: Curve::new(peak, Joining::Linear).unwrap(),
            domain: (0.0, 1.0),
            lookup: crate::Lookup::Linear,
        };
        let integral = Integral::new(&transfer.table(1.0));
        assert!(integral.segment(0.4, 0.6).1 > 0.01);
        assert_eq!(integral.segment(0.1, 0.4).1, 0.0);
    }
}
