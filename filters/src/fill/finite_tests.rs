//! Whatever is given, nothing that is not finite leaves: every method, in both domains, with everything that it can use.

use super::*;
use crate::dictionary::dct;
use crate::dictionary::fill::Learned;
use crate::enlarge;
use crate::upscale::{self, Geometry, Sampling, plain};
use crate::{METHODS, Size};

/// No numbers, and numbers near the ends of the range.
const BAD: [f32; 6] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, 1e-45];

fn size() -> Size {
    Size::new(21, 26)
}

fn hash(y: usize, x: usize) -> u64 {
    lacuna_core::hash(y as u64, x as u64)
}

/// Pairs of pixels, so that there are differences to start from; borders among them.
fn mask() -> Arc<Mask> {
    Arc::new(Mask::from_fn(size(), |y, x| hash(y, x / 2).is_multiple_of(2)))
}

/// A plane in which some pixels are `bad`: of those that the mask calls measured a few, and all others.
fn image(at: usize, bad: f32) -> Plane {
    let mask = mask();
    Plane::from_fn(size(), |y, x| {
        let sick = !mask.is_measured(y, x) || hash(y + 31 * at, x + 7).is_multiple_of(40);
        if sick { bad } else { 0.2 + ((y * 3 + x * (at + 1)) % 17) as f32 / 20.0 }
    })
}

/// A plane that is `bad` at every 23rd pixel.
fn beside(at: usize, bad: f32) -> Plane {
    Plane::from_fn(size(), |y, x| {
        if hash(x, y + at).is_multiple_of(23) { bad } else { ((x + at * y) % 5) as f32 / 4.0 - 0.4 }
    })
}

/// Every method as it is, and where it can smooth, smoothing.
fn methods() -> Vec<Method> {
    let mut methods = Vec::new();
    for found in METHODS {
        let mut method = Method::of(found, &[]).unwrap();
        if found.takes.dictionary {
            let dictionary = Some(Arc::new(dct::dictionary(4, 16).unwrap()));
            method = Learned { dictionary, ..Learned::default() }.into();
        }
        for (name, value) in [("block", "4"), ("atoms", "16")] {
            // Only the filter of cosines has them.
            let _ = method.set(name, value);
        }
        let mut smooth = method.clone();
        for setting in found.settings.iter().filter(|setting| setting.smooths) {
            let _ = smooth.set(setting.name, "0.5").or_else(|_| smooth.set(setting.name, "true"));
        }
        methods.push(method.clone());
        if smooth != method {
            methods.push(smooth);
        }
    }
    methods
}

fn guides(bad: f32) -> Guides {
    let mut guides = Guides::new(size());
    guides.add("N", vec![beside(1, bad), beside(2, bad)]).unwrap();
    guides.add("Z", vec![beside(3, bad)]).unwrap();
    guides
}

fn all_finite(planes: &Planes) -> bool {
    planes.as_slice().iter().flat_map(Plane::pixels).all(|value| value.is_finite())
}

#[test]
fn what_is_not_finite_stays_inside_whatever_the_method() {
    let guides = BAD.map(guides);
    for method in methods() {
        for (which, bad) in BAD.into_iter().enumerate() {
            let samples = Planes::new(size(), (0..3).map(|at| image(at, bad)).collect()).unwrap();
            for domain in [Domain::Linear, Domain::Log] {
                let plain = Options { domain, estimate: Estimate::Pixels, ..Options::of(method.clone()) };
                let slopes = |at: usize| Some([beside(at, bad), beside(at + 5, bad)]);
                let fed = Options {
                    weights: Some(Arc::new(beside(9, bad))),
                    gradients: (0..3).map(slopes).collect(),
                    guides: Some(&guides[which]),
                    known: true,
                    ..plain.clone()
                };
                let free = Options { limit: false, values: Values::Other, ..fed.clone() };
                // What leaves the limiter and the bounds does so in any domain alike.
                let free = (domain == Domain::Linear).then_some(("free", &free));
                for (how, options) in [("plain", &plain), ("fed", &fed)].into_iter().chain(free) {
                    let name = format!("{} {} {bad} {domain:?} {how}", method.name(), method.settings());
                    let filled =
                        fill(&samples, mask(), options).unwrap_or_else(|error| panic!("{name}: {error}"));
                    assert!(all_finite(&filled.planes), "{name}");
                    let errors = filled.sets.iter().filter_map(|set| set.errors.as_ref());
                    let mut errors = errors.flat_map(Plane::pixels);
                    assert!(errors.all(|error| error.is_finite()), "{name}: estimated errors");
                }
            }
        }
    }
}

/// What overflows in a fill teaches nothing, and fails nothing.
#[test]
fn what_overflows_is_no_sample() {
    let size = Size::new(40, 44);
    let mask = Arc::new(crate::sampling::shuffle::mask(0, 0, size, 0.5, 3).unwrap());
    for values in [[f32::MAX, f32::MIN], [f32::MAX, 0.0]] {
        let samples = Planes::from(Plane::from_fn(size, |y, x| values[(y + x / 3) % 2]));
        // Others have no estimate.
        for method in methods().into_iter().filter(Method::keeps_measured) {
            for values in [Values::Light, Values::Other] {
                let options = Options { values, estimate: Estimate::Pixels, ..Options::of(method.clone()) };
                let name = format!("{} {} {values:?}", method.name(), method.settings());
                let filled = fill(&samples, Arc::clone(&mask), &options)
                    .unwrap_or_else(|error| panic!("{name}: {error}"));
                assert!(all_finite(&filled.planes), "{name}");
                let errors = filled.sets.iter().filter_map(|set| set.errors.as_ref());
                let mut errors = errors.flat_map(Plane::pixels);
                assert!(errors.all(|error| error.is_finite()), "{name}: estimated errors");
            }
        }
    }
}

#[test]
fn what_is_not_finite_in_noise_stays_inside() {
    let guides = BAD.map(guides);
    for (which, bad) in BAD.into_iter().enumerate() {
        let samples = Planes::new(size(), (0..2).map(|at| image(at, bad)).collect()).unwrap();
        let like = Noise::Like((0..2).map(|at| beside(at, bad)).collect());
        let drawn = Noise::Like((0..2).map(|at| Noise::of_variance(&beside(at, bad), 3)).collect());
        for noise in [Noise::Unknown, like, drawn] {
            for guides in [None, Some(&guides[which])] {
                let method = Method::named("ss", &[]).unwrap();
                let options = Options { noise: noise.clone(), guides, known: true, ..Options::of(method) };
                let filled = fill(&samples, mask(), &options).unwrap();
                assert!(all_finite(&filled.planes), "{bad} {noise:?}");
            }
        }
    }
}

#[test]
fn what_is_not_finite_stays_inside_where_images_are_enlarged() {
    let methods = [
        upscale::Method::Ss,
        upscale::Method::Tv(crate::variational::tv::Settings { max_iterations: 40, ..Default::default() }),
        upscale::Method::Plain(plain::Kernel::Lanczos3),
        upscale::Method::Plain(plain::Kernel::Cubic),
        upscale::Method::Plain(plain::Kernel::Linear),
    ];
    for bad in BAD {
        let samples = Planes::new(size(), (0..2).map(|at| image(at, bad)).collect()).unwrap();
        for sampling in [Sampling::Box, Sampling::Point, Sampling::Grid, Sampling::Gaussian(0.7)] {
            let geometry = Geometry::scaled(size(), 2.0, sampling);
            let mut large = Guides::new(geometry.high());
            let plane = |at: usize| Plane::from_fn(geometry.high(), |y, x| beside(at, bad).at(y / 2, x / 2));
            large.add("N", vec![plane(1), plane(2)]).unwrap();
            for method in methods {
                for (guides, domain) in
                    [(None, Domain::Linear), (Some(&large), Domain::Linear), (Some(&large), Domain::Log)]
                {
                    let name = format!("{method:?} {sampling:?} {bad} {domain:?} {}", guides.is_some());
                    let mut options = enlarge::Options::new(geometry);
                    (options.method, options.guides, options.mask) = (method, guides, Some(mask()));
                    options.fill = Options { domain, ..Options::of(Method::named("ss", &[]).unwrap()) };
                    let large = enlarge::upscale(&samples, &options)
                        .unwrap_or_else(|error| panic!("{name}: {error}"));
                    assert!(all_finite(&large.planes), "{name}");
                }
            }
        }
    }
}
