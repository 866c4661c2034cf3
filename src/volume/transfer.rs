//! The transfer function: a value becomes a colour and an opacity.
//!
//! Colour and opacity have points of their own over the values, joined by lines or held until the next point; before
//! the first and after the last point they are constant. The march reads a table of [`ENTRIES`] equal steps over the
//! domain, in which opacity is corrected for the length of a step: `1 - (1 - alpha)^(step / unit)`. Between two
//! entries the table is read linearly, or by the entry below.

use serde::{Deserialize, Serialize};
use wide::f32x4;

use super::Error;
use super::lanes::{LANES, Lanes, all};

/// The largest colour, strength of a light or coefficient of shading: their products are finite floats.
pub const LARGEST: f64 = 1e9;
/// Entries of the table.
pub const ENTRIES: usize = 4096;

/// How values between two points are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Joining {
    /// By a line.
    #[default]
    Linear,
    /// Each point's holds until the next.
    Constant,
}

/// How the table is read between two entries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Lookup {
    /// By a line.
    #[default]
    Linear,
    /// The entry below.
    Step,
}

/// Points over values, in the order of the values.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve<const N: usize> {
    points: Vec<(f64, [f64; N])>,
    joining: Joining,
}

impl<const N: usize> Curve<N> {
    /// A curve through points; those of equal value make a jump, in the order given.
    ///
    /// # Errors
    /// [`Error::Scene`] if there is no point, a number is not finite, or a value is beyond 1e9.
    pub fn new(mut points: Vec<(f64, [f64; N])>, joining: Joining) -> Result<Self, Error> {
        if points.is_empty() {
            return Err(Error::Scene("the transfer function has no points".into()));
        }
        if points.iter().any(|(at, value)| !at.is_finite() || !value.iter().all(|part| part.abs() <= LARGEST))
        {
            let line = "transfer: a point is not finite, or its colour or opacity is beyond 1e9";
            return Err(Error::Scene(line.into()));
        }
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(Self { points, joining })
    }

    /// The curve's value at `at`.
    pub fn at(&self, at: f64) -> [f64; N] {
        let next = self.points.partition_point(|point| point.0 <= at);
        let (Some(before), after) = (next.checked_sub(1).map(|k| &self.points[k]), self.points.get(next))
        else {
            return self.points[0].1;
        };
        match after {
            Some(after) if self.joining == Joining::Linear => {
                let share = (at - before.0) / (after.0 - before.0);
                std::array::from_fn(|k| before.1[k] + share * (after.1[k] - before.1[k]))
            }
            _ => before.1,
        }
    }
}

/// A transfer function over a domain of data values.
#[derive(Clone, Debug, PartialEq)]
pub struct Transfer {
    /// Red, green, blue over the values.
    pub colour: Curve<3>,
    /// Opacity per unit of length over the values, 0 to 1.
    pub opacity: Curve<1>,
    /// The data values at which the table begins and ends.
    pub domain: (f64, f64),
    /// How the table is read.
    pub lookup: Lookup,
}

/// A transfer function as the march reads it.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Red, green, blue, opacity of one step.
    entries: Vec<f32x4>,
    /// How many entries before this one have an opacity.
    visible_before: Vec<u32>,
    low: f32,
    per_value: f32,
    lookup: Lookup,
}

impl Transfer {
    /// The colour and opacity per unit of a data value.
    pub fn at(&self, value: f64) -> ([f64; 3], f64) {
        (self.colour.at(value), self.opacity.at(value)[0].clamp(0.0, 1.0))
    }

    /// The table for steps of `step` units.
    pub fn table(&self, step: f64) -> Table {
        let (low, high) = self.domain;
        let width = if high > low { high - low } else { 1.0 };
        let entry = |k: usize| {
            let (colour, opacity) = self.at(low + width * k as f64 / (ENTRIES - 1) as f64);
            let corrected = corrected(opacity, step);
            f32x4::new([colour[0] as f32, colour[1] as f32, colour[2] as f32, corrected as f32])
        };
        let entries: Vec<f32x4> = (0..ENTRIES).map(entry).collect();
        let mut visible_before = Vec::with_capacity(ENTRIES + 1);
        let mut count = 0;
        visible_before.push(0);
        for entry in &entries {
            count += u32::from(entry.to_array()[3] > 0.0);
            visible_before.push(count);
        }
        let per_value = ((ENTRIES - 1) as f64 / width) as f32;
        Table { entries, visible_before, low: low as f32, per_value, lookup: self.lookup }
    }
}

/// The opacity of `length` units, of which one has `opacity`.
pub fn corrected(opacity: f64, length: f64) -> f64 {
    // expm1 and ln_1p: small opacities keep their digits.
    -(length * (-opacity).ln_1p()).exp_m1()
}

impl Table {
    /// The table for steps that are `ratio` times as long.
    #[must_use]
    pub fn longer(&self, ratio: f64) -> Self {
        let entry = |entry: &f32x4| {
            let [red, green, blue, opacity] = entry.to_array();
            f32x4::new([red, green, blue, corrected(opacity.into(), ratio) as f32])
        };
        Self { entries: self.entries.iter().map(entry).collect(), ..self.clone() }
    }

    /// Where a value lies in the table, from 0 to `ENTRIES - 1`.
    #[inline(always)]
    pub fn position(&self, value: f32) -> f32 {
        // Written so that a NaN becomes 0.
        let at = (value - self.low) * self.per_value;
        let at = if at > 0.0 { at } else { 0.0 };
        if at < (ENTRIES - 1) as f32 { at } else { (ENTRIES - 1) as f32 }
    }

    /// The same beyond the table's ends, too: below 0, or above `ENTRIES - 1`.
    #[inline(always)]
    pub fn place(&self, value: f32) -> f64 {
        (f64::from(value) - f64::from(self.low)) * f64::from(self.per_value)
    }

    /// An entry: red, green, blue and the opacity of a step.
    pub fn entry(&self, k: usize) -> [f32; 4] {
        self.entries[k].to_array()
    }

    /// Red, green, blue and the opacity of a step at a value.
    #[inline(always)]
    pub fn at(&self, value: f32) -> [f32; 4] {
        let at = self.position(value);
        self.between((at as usize).min(ENTRIES - 2), at)
    }

    #[inline(always)]
    fn between(&self, entry: usize, at: f32) -> [f32; 4] {
        let a = self.entries[entry];
        if self.lookup == Lookup::Step {
            return a.to_array();
        }
        (a + f32x4::splat(at - entry as f32) * (self.entries[entry + 1] - a)).to_array()
    }

    /// The same for the first `count` of eight values; nothing for the others.
    #[inline(always)]
    pub fn at_all(&self, values: Lanes, count: usize) -> [[f32; 4]; LANES] {
        let at = (values - all(self.low)) * all(self.per_value);
        let at = at.fast_max(Lanes::ZERO).fast_min(all((ENTRIES - 1) as f32));
        let (entries, at) = (at.fast_trunc_int().to_array(), at.to_array());
        let mut found = [[0.0; 4]; LANES];
        for lane in 0..count.min(LANES) {
            found[lane] = self.between((entries[lane] as usize).min(ENTRIES - 2), at[lane]);
        }
        found
    }

    /// Whether any value between these two has an opacity.
    pub fn visible(&self, low: f32, high: f32) -> bool {
        let first = (self.position(low) as usize).saturating_sub(1);
        let last = (self.position(high) as usize + 2).min(ENTRIES - 1);
        self.visible_before[last + 1] > self.visible_before[first]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Transfer {
        Transfer {
            colour: Curve::new(vec![(0.0, [1.0, 0.0, 0.5])], Joining::Linear).unwrap(),
            opacity: Curve::new(vec![(10.0, [0.0]), (20.0, [0.0]), (30.0, [0.5])], Joining::Linear).unwrap(),
            domain: (0.0, 40.0),
            lookup: Lookup::Linear,
        }
    }

    #[test]
    fn the_table_agrees_with_the_curves() {
        let transfer = ramp();
        let table = transfer.table(0.25);
        for k in 0..=400 {
            let value = f64::from(k) * 0.1;
            let (colour, opacity) = transfer.at(value);
            let entry = table.at(value as f32);
            assert_eq!(entry[0], colour[0] as f32);
            // Off only where the curve bends within an entry.
            assert!(
                (f64::from(entry[3]) - corrected(opacity, 0.25)).abs() < 40.0 / 4095.0 * 0.05 * 0.3,
                "{value}"
            );
        }
        assert!((corrected(corrected(0.3, 0.25), 4.0) - 0.3).abs() < 1e-15);
        let (short, whole) = (transfer.table(0.25).longer(4.0), transfer.table(1.0));
        for k in 0..ENTRIES {
            assert!((short.entry(k)[3] - whole.entry(k)[3]).abs() < 4.0 * f32::EPSILON, "{k}");
        }
    }

    #[test]
    fn what_has_no_opacity_is_not_visible() {
        let table = ramp().table(0.5);
        assert!(!table.visible(0.0, 19.9));
        assert!(table.visible(0.0, 20.1));
        assert!(table.visible(25.0, 25.0));
        assert!(table.visible(40.0, 1000.0));
        assert!(!table.visible(-1e9, -1e8));
    }

    #[test]
    fn constant_joining_jumps() {
        let points = vec![(0.0, [0.0]), (5.0, [1.0]), (7.0, [0.25])];
        let curve = Curve::new(points, Joining::Constant).unwrap();
        assert_eq!(
            [-1.0, 0.0, 4.99, 5.0, 6.9, 7.0, 9.0].map(|at| curve.at(at)[0]),
            [0.0, 0.0, 0.0, 1.0, 1.0, 0.25, 0.25]
        );
        assert!(Curve::<1>::new(vec![], Joining::Linear).is_err());
        for value in [f64::NAN, 1e308, -2e9] {
            assert!(Curve::new(vec![(0.0, [value])], Joining::Linear).is_err(), "{value}");
        }
    }
}
