//! What was measured at held-out samples: how predictions are compared with it.

use crate::domain::Map;
use crate::estimate::{HeldOut, Voronoi};
use crate::{Mask, Plane, Planes};

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

impl Truth<'_> {
    /// The squared error of predictions, as it is compared.
    pub fn error(&self, held: &HeldOut) -> f64 {
        let of = |(i, &pixel): (usize, &u32)| {
            let difference = |(plane, predicted): (&Plane, &Vec<f32>)| {
                let [value, held] =
                    [plane.pixels()[pixel as usize], predicted[i]].map(|v| self.map.shown(f64::from(v)));
                (held - value).powi(2)
            };
            let counts = self.voronoi.map_or(1.0, |voronoi| f64::from(voronoi.weight(pixel)));
            counts * self.samples.as_slice().iter().zip(&held.predicted).map(difference).sum::<f64>()
        };
        held.at.iter().enumerate().map(of).sum()
    }
}
