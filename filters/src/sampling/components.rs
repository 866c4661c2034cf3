//! Principal components of a group's leave-out errors: fewer planes in which a fill errs nearly as much.
//!
//! Sums of squares over the channels are the same in any orthonormal basis of them, and a spline is linear: it makes the components of
//! the fill of the components of the samples. In the basis of the eigenvectors of `sum e e'`, `e` the vector of a sample's errors,
//! most renders err in one or two components, and the others need not be filled to know where.
//!
//! Source: I. Jolliffe, "Principal Component Analysis", Springer 2002, chapter 1.

use lacuna_core::parallel::prelude::*;

use crate::solver::eigen::eigenvectors;
use crate::{Plane, Planes};

/// Share of the squared error that components may miss.
const MISSED: f64 = 0.02;
/// Pixels that one task takes.
const PIECE: usize = 1 << 14;

/// Fewer components than channels.
pub struct Components(Vec<Vec<f32>>);

impl Components {
    /// Those that hold nearly all of the squared error; nothing if that takes as many as there are channels. `products` has the sums
    /// of `e e'`, row by row.
    pub fn new(products: &[f64], channels: usize) -> Option<Self> {
        if products.len() != channels * channels {
            return None;
        }
        let mut found = eigenvectors(products.to_vec(), channels);
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let all: f64 = found.iter().map(|(value, _)| value.max(0.0)).sum();
        let mut left = all;
        let more = |(value, _): &&(f64, Vec<f64>)| {
            let needed = left > MISSED * all;
            left -= value.max(0.0);
            needed
        };
        let rows: Vec<Vec<f32>> = found
            .iter()
            .take_while(more)
            .map(|(_, row)| row.iter().map(|&value| value as f32).collect())
            .collect();
        (!rows.is_empty() && rows.len() < channels).then_some(Self(rows))
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// A component of the values of a pixel's channels.
    pub fn of(&self, component: usize, values: impl Iterator<Item = f32>) -> f32 {
        self.0[component].iter().zip(values).map(|(factor, value)| factor * value).sum()
    }

    /// The components of planes.
    pub fn apply(&self, planes: &Planes) -> Planes {
        let size = planes.size();
        let component = |row: &Vec<f32>| {
            let mut out = vec![0.0; size.pixels()];
            out.par_chunks_mut(PIECE).enumerate().for_each(|(piece, out)| {
                for (plane, factor) in planes.as_slice().iter().zip(row) {
                    let values = &plane.pixels()[piece * PIECE..][..out.len()];
                    out.iter_mut().zip(values).for_each(|(out, value)| *out += factor * value);
                }
            });
            Plane::of(size, out)
        };
        Planes::of(size, self.0.iter().map(component).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Size;

    /// Errors along one direction need one component, which holds all of them; errors in every direction need all channels.
    #[test]
    fn as_many_as_the_errors_have_directions() {
        let direction = [2.0_f64, -1.0, 0.5];
        let line: Vec<f64> = (0..9).map(|k| direction[k / 3] * direction[k % 3]).collect();
        let one = Components::new(&line, 3).unwrap();
        assert_eq!(one.len(), 1);
        let square: f64 = direction.iter().map(|d| d * d).sum();
        let along = f64::from(one.of(0, direction.iter().map(|&d| d as f32)));
        assert!((along * along - square).abs() < 16.0 * f64::from(f32::EPSILON) * square);
        let even: Vec<f64> = (0..9).map(|k| if k / 3 == k % 3 { 1.0 } else { 0.0 }).collect();
        assert!(Components::new(&even, 3).is_none());
        // Without an error there is nothing to tell them by.
        assert!(Components::new(&[0.0; 9], 3).is_none() && Components::new(&[], 3).is_none());
    }

    #[test]
    fn planes_are_as_their_pixels() {
        let size = Size::new(5, 7);
        let planes = Planes::of(
            size,
            (0..2).map(|c| Plane::from_fn(size, |y, x| ((y * 7 + x) * (c + 3) % 11) as f32)).collect(),
        );
        let components = Components::new(&[4.0, 2.0, 2.0, 1.0], 2).unwrap();
        let found = components.apply(&planes);
        for pixel in 0..size.pixels() {
            let values = planes.as_slice().iter().map(|plane| plane.pixels()[pixel]);
            assert_eq!(found.as_slice()[0].pixels()[pixel].to_bits(), components.of(0, values).to_bits());
        }
    }
}
