//! An image that is brought nearer to the spline of its samples: one sweep of tiles, of few steps each.
//!
//! Where an image is smooth around its samples already, as the fill of some of them or a pyramid's, what is left of the error at these
//! goes first. That is what tells where a fill errs; what a hole is like in its midst would take multigrid.

use lacuna_core::parallel::prelude::*;

use super::tiles::{Task, Tiles};
use super::{Isa, ROUNDING, Settings};
use crate::kernel::extremes::range;
use crate::operator::energy::Form;
use crate::solver::local::Target;
use crate::{Mask, Plane, Planes, Run};

/// Least eigenvalue of the preconditioned matrix where samples are near.
const LEAST: f64 = 0.2;

/// Improves `image` as a fill of the samples by the default spline, to within about `error` times the range of these where they are near.
/// Measured pixels take their values. A tile takes at most so many `steps`.
pub(crate) fn improve(
    mask: &Mask,
    samples: &Planes,
    (error, steps): (f64, usize),
    image: &mut Planes,
    run: &Run<'_>,
) {
    let Settings { kernel, order, tension, .. } = Settings::default();
    let matrix = Form::new(kernel, order.number(), tension).energy(mask.size(), (1.0, 1.0));
    let tiles = Tiles::new(Isa::best(), &matrix, mask, None);
    let one = |(samples, image): (&Plane, &mut Plane)| {
        for ((value, &sample), _) in image
            .pixels_mut()
            .iter_mut()
            .zip(samples.pixels())
            .zip(mask.as_slice())
            .filter(|(_, flag)| **flag)
        {
            *value = sample;
        }
        let (low, high) = range(mask.as_slice(), samples.pixels());
        let (middle, range) = (low + 0.5 * (high - low), f64::from(high) - f64::from(low));
        if range > 0.0 {
            let floor = ROUNDING * range;
            let target = Target { tolerance: error * range, floor, least: Some(LEAST) };
            tiles.sweep(mask, image, Task { before: None, changed: &[], middle, target, limit: steps }, run);
        }
    };
    samples.as_slice().into_par_iter().zip(image.as_mut_slice()).for_each(one);
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::baseline::push_pull;
    use crate::sampling::shuffle;
    use crate::{Filter, Problem, Size};

    fn solve(filter: &dyn Filter, mask: &Arc<Mask>, samples: &Planes) -> Planes {
        let mut out = Planes::zeros(samples.size(), samples.len());
        let plan = filter.plan(&Problem::fill(Arc::clone(mask)), &Run::default()).unwrap();
        plan.reconstruct(samples, &mut out, &Run::default()).unwrap();
        out
    }

    fn distance(a: &Planes, b: &Planes) -> f64 {
        let pairs = a.as_slice()[0].pixels().iter().zip(b.as_slice()[0].pixels());
        pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
    }

    /// From a pyramid's image and from the fill of fewer samples it comes to within a few percent of the way to the spline.
    #[test]
    fn it_comes_near_the_spline() {
        let size = Size::new(150, 210);
        let image = Planes::from(Plane::from_fn(size, |y, x| {
            ((x * x + 3 * y * y) as f32 / 2000.0).sin() + if x > y { 0.7 } else { 0.0 }
        }));
        let few = Arc::new(shuffle::mask(0, 0, size, 0.1, 1).unwrap());
        let more = Arc::new(shuffle::mask(0, 0, size, 0.15, 1).unwrap());
        let spline = solve(&Settings::default(), &more, &image);
        for start in [solve(&push_pull::Settings, &more, &image), solve(&Settings::default(), &few, &image)] {
            let mut found = start.clone();
            improve(&more, &image, (1e-2, 20), &mut found, &Run::default());
            assert!(distance(&found, &spline) < 0.05 * distance(&start, &spline));
            let kept =
                |pixel: usize| found.as_slice()[0].pixels()[pixel] == image.as_slice()[0].pixels()[pixel];
            assert!((0..size.pixels()).all(|pixel| !more.as_slice()[pixel] || kept(pixel)));
        }
    }
}
