//! The transfer function integrated over values, for pre-integrated segments.
//!
//! With `t(v)` the extinction per step and `c(v)` the colour, a segment from value `a` to `b` has the opacity
//! `1 - exp(-mean of t over [a, b])` and the colour `integral of t c / integral of t`. Both integrals are differences
//! of running sums over the table's entries. Attenuation within one segment is left out, as in Engel's fast table.

use super::transfer::{ENTRIES, Table};

/// Opacities are held below this, where extinction would be infinite.
const LARGEST: f64 = 1.0 - 1e-9;

/// Running integrals over the table of a transfer function.
#[derive(Clone, Debug, PartialEq)]
pub struct Integral {
    /// Extinction times red, green, blue, and extinction, integrated from the first entry on.
    sums: Vec<[f64; 4]>,
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
        Self { sums, table: table.clone() }
    }

    /// Mean colour and opacity of the segment between two values.
    #[inline(always)]
    pub fn segment(&self, from: f32, to: f32) -> ([f32; 3], f32) {
        let (a, b) = (self.table.position(from), self.table.position(to));
        let width = f64::from(b) - f64::from(a);
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
    fn at(&self, position: f32) -> [f64; 4] {
        let entry = (position as usize).min(ENTRIES - 2);
        let share = f64::from(position - entry as f32);
        let (a, b) = (self.sums[entry], self.sums[entry + 1]);
        std::array::from_fn(|k| a[k] + share * (b[k] - a[k]))
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
