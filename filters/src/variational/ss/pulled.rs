//! Splines that keep the measured pixels and are pulled towards values at others.
//!
//! ```text
//! x' H x  +  sum over missing pixels of  w (x - v)^2      over all x that equal y at the measured pixels
//! ```
//!
//! By conjugate gradients with a multigrid cycle on the whole image, one channel after the other.

use super::region::Region;
use super::{Isa, Settings};
use crate::operator::energy::Form;
use crate::{Mask, Outcome, Plane, Planes, Run};

/// From this weight on a pixel takes its value.
pub const FIRM: f32 = 1e4;

/// The problem of one mask and one set of weights.
pub struct Pulled {
    region: Region,
    /// Pixels that take their values.
    firm: Vec<usize>,
}

impl Pulled {
    /// The pulls are finite, 0 or more, and count at missing pixels only.
    pub fn new(mask: &Mask, pulls: &Plane) -> Self {
        let Settings { kernel, order, tension, .. } = Settings::default();
        let form = Form::new(kernel, order.number(), tension);
        let is_firm = |at: &usize| !mask.as_slice()[*at] && pulls.pixels()[*at] >= FIRM;
        let firm: Vec<usize> = (0..mask.size().pixels()).filter(is_firm).collect();
        let mut flags = mask.as_slice().to_vec();
        for &at in &firm {
            flags[at] = true;
        }
        let held = Mask::of(mask.size(), flags);
        Self { region: Region::pulled(Isa::best(), &form, &held, pulls), firm }
    }

    /// Replaces the missing pixels of `image`, where it starts, by the solution, until corrections are as small as the tolerance of each plane;
    /// planes whose tolerance is 0 keep what they have.
    pub fn solve(&self, values: &Planes, tolerances: &[f64], image: &mut Planes, run: &Run<'_>) -> Outcome {
        let planes = values.as_slice().iter().zip(image.as_mut_slice()).zip(tolerances);
        let solve = |((values, image), &tolerance): ((&Plane, &mut Plane), &f64)| {
            for &at in &self.firm {
                image.pixels_mut()[at] = values.pixels()[at];
            }
            self.region.solve(values, image, tolerance, run)
        };
        planes.filter(|(_, tolerance)| **tolerance > 0.0).map(solve).fold(Outcome::direct(), Outcome::worst)
    }
}
