//! The library's calls on tiny planes: every method, guides, gradients, weights and noise; filled, and enlarged.

use std::sync::Arc;

use lacuna_filters::domain::Domain;
use lacuna_filters::enlarge;
use lacuna_filters::fill::{Estimate, Values, fill};
use lacuna_filters::noise::Noise;
use lacuna_filters::upscale::{self, Axis, Geometry, Sampling, plain::Kernel};
use lacuna_filters::variational::{guided::Guides, tv};
use lacuna_filters::{Bounds, Mask, Options, Plane, Planes, Size};

use super::draw::Draw;

/// The bytes say what is filled, and how.
pub fn body(data: &[u8]) {
    let mut draw = Draw(data);
    let size = Size::new(1 + draw.below(14), 1 + draw.below(14));
    let count = 1 + draw.below(3);
    let mut options = Options::of(draw.method());
    options.domain = draw.one_of(&[Domain::Auto, Domain::Linear, Domain::Log]);
    options.values = draw.one_of(&[Values::Light, Values::Light, Values::Other, Values::Directions]);
    options.limit = !draw.flag();
    options.estimate = draw.one_of(&[Estimate::No, Estimate::Figure, Estimate::Pixels]);
    let flags = draw.byte();
    let mask = Arc::new(draw.mask(size));
    let samples = Planes::new(size, (0..count).map(|_| draw.plane(size)).collect()).unwrap();
    if flags & 1 > 0 {
        options.bounds =
            (0..count).map(|_| draw.one_of(&[Bounds::Free, Bounds::Positive, Bounds::Unit])).collect();
    }
    if flags & 2 > 0 {
        options.weights = Some(Arc::new(draw.plane(size)));
    }
    if flags & 4 > 0 {
        options.gradients = (0..count).map(|_| Some([draw.plane(size), draw.plane(size)])).collect();
    }
    if flags & 8 > 0 {
        let like: Vec<_> = (0..count).map(|_| draw.plane(size)).collect();
        options.noise = if flags & 16 > 0 {
            Noise::Like(like)
        } else {
            Noise::Like(like.iter().map(|plane| Noise::of_variance(plane, 1)).collect())
        };
    } else if flags & 16 > 0 {
        options.noise = Noise::Unknown;
    }
    let guides = (flags & 32 > 0).then(|| guides(&mut draw, size));
    (options.guides, options.known) = (guides.as_ref(), true);
    if flags & 64 > 0 {
        return enlarged(&mut draw, &samples, mask, options);
    }
    // What cannot be filled is refused.
    let Ok(filled) = fill(&samples, Arc::clone(&mask), &options) else { return };
    if filled.sets.is_empty() {
        return;
    }
    finite(&filled.planes);
    for (at, (before, after)) in samples.as_slice().iter().zip(filled.planes.as_slice()).enumerate() {
        let mut pixels = before.pixels().iter().zip(after.pixels()).zip(mask.as_slice());
        let kept = pixels.all(|((before, after), &flag)| {
            !flag || !before.is_finite() || before.to_bits() == after.to_bits()
        });
        assert!(kept || !options.keeps_measured(), "plane {at}: a measured pixel lost its bits");
    }
    for set in &filled.sets {
        let mut errors = set.errors.iter().flat_map(Plane::pixels);
        assert!(errors.all(|error| error.is_finite() && *error >= 0.0), "an estimated error is none");
    }
}

fn finite(planes: &Planes) {
    let mut values = planes.as_slice().iter().flat_map(Plane::pixels);
    assert!(values.all(|value| value.is_finite()), "a value that is not finite leaves");
}

fn guides(draw: &mut Draw<'_>, size: Size) -> Guides {
    let mut guides = Guides::new(size);
    guides.add("N", vec![draw.plane(size), draw.plane(size)]).unwrap();
    guides.add("Z", vec![draw.plane(size)]).unwrap();
    if draw.flag() {
        let labels: Vec<u32> = (0..size.pixels()).map(|_| u32::from(draw.byte()) % 3).collect();
        guides.add_labels("id", &labels).unwrap();
    }
    guides
}

fn enlarged(draw: &mut Draw<'_>, samples: &Planes, mask: Arc<Mask>, mut fill: Options<'_>) {
    let low = samples.size();
    let sampling = draw.one_of(&[
        Sampling::Box,
        Sampling::Point,
        Sampling::Grid,
        Sampling::Gaussian(0.7),
        Sampling::Gaussian(1.5),
        Sampling::Mitchell,
    ]);
    let mut axis = |pixels: usize| {
        let more = [1.0, 1.5, 2.0, 2.5, 3.0, 4.0][draw.below(6)];
        Axis::whole(pixels, (pixels as f64 * more).round() as usize)
    };
    let geometry = Geometry { vertical: axis(low.height), horizontal: axis(low.width), sampling };
    let mut options = enlarge::Options::new(geometry);
    let few = tv::Settings { max_iterations: 60, ..tv::Settings::default() };
    options.method = draw.one_of(&[
        upscale::Method::Ss,
        upscale::Method::Tv(few),
        upscale::Method::Plain(Kernel::Lanczos3),
        upscale::Method::Plain(Kernel::Cubic),
        upscale::Method::Plain(Kernel::Linear),
    ]);
    options.mask = (!draw.flag()).then_some(mask);
    let guides = draw.flag().then(|| guides(draw, geometry.high()));
    options.guides = guides.as_ref();
    fill.guides = None;
    options.fill = fill;
    if let Ok(large) = enlarge::upscale(samples, &options) {
        finite(&large.planes);
    }
}
