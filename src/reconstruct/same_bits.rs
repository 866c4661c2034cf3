//! The library's calls and the tool's functions give the same bits: for every method, in every domain, filled and enlarged.

use std::sync::Arc;

use lacuna_exr::Frame;
use lacuna_filters::dictionary::dct;
use lacuna_filters::dictionary::fill::{Learned, Use};
use lacuna_filters::fill::{Options, Values};
use lacuna_filters::limiter::Moved;
use lacuna_filters::upscale::{self, Geometry, Sampling};
use lacuna_filters::variational::guided::Guides;
use lacuna_filters::{Bounds, METHODS, Mask, Method, Plane, Planes, Size};

use super::*;
use crate::channels::choose;
use crate::mask::find;
use crate::testing::{float, frame, part, values, window};

const SIZE: Size = Size::new(40, 52);
const COLOURS: [&str; 3] = ["B", "G", "R"];

/// About a third of the pixels.
fn mask() -> Arc<Mask> {
    Arc::new(Mask::from_fn(SIZE, |y, x| (y * 7919 + x * 104_729 + y * x * 31) % 10 < 3))
}

fn value(at: usize, y: usize, x: usize) -> f32 {
    let ramp = 0.1 + (y + x * (at + 1)) as f32 / 200.0;
    if (y / 9 + x / 11) % 3 == at { ramp * 3.0 } else { ramp }
}

/// Samples of a colour with an edge, a highlight, and a measured value that is not a number; zero where nothing was measured.
fn colour(at: usize, broken: bool) -> Vec<f32> {
    let mask = mask();
    let mut found: Vec<f32> = (0..SIZE.pixels())
        .map(|i| if mask.as_slice()[i] { value(at, i / SIZE.width, i % SIZE.width) } else { 0.0 })
        .collect();
    let measured: Vec<usize> = (0..found.len()).filter(|&i| mask.as_slice()[i]).collect();
    found[measured[100]] = 800.0;
    if broken && at == 1 {
        found[measured[50]] = f32::NAN;
    }
    found
}

fn albedo() -> Vec<f32> {
    (0..SIZE.pixels()).map(|i| value(1, i / SIZE.width, i % SIZE.width)).collect()
}

/// A frame with those colours, an alpha, their mask, and slopes and a guide if they are asked for.
fn sparse(broken: bool, slopes: bool, guide: bool) -> Frame {
    let mask = mask();
    let flags: Vec<f32> = mask.as_slice().iter().map(|&flag| f32::from(u8::from(flag))).collect();
    let mut channels = vec![float("A", &alpha()), float("mask", &flags), float("samples", &counts())];
    channels.extend((0..3).map(|at| float(COLOURS[at], &colour(at, broken))));
    if slopes {
        for name in COLOURS {
            channels.extend(["dx", "dy"].map(|axis| float(&format!("{axis}.{name}"), &slope(axis == "dy"))));
        }
    }
    if guide {
        channels.push(float("albedo.R", &albedo()));
    }
    frame(vec![part(window(3, -5, SIZE.width as i32, SIZE.height as i32), channels)])
}

fn alpha() -> Vec<f32> {
    colour(0, false).iter().map(|value| value.min(1.0)).collect()
}

fn counts() -> Vec<f32> {
    (0..SIZE.pixels()).map(|i| (i % 5) as f32).collect()
}

fn slope(down: bool) -> Vec<f32> {
    let value = |i: usize| if down { 0.005 } else { (i % 7) as f32 / 500.0 };
    (0..SIZE.pixels()).map(|i| if mask().as_slice()[i] { value(i) } else { 0.0 }).collect()
}

fn planes(all: impl IntoIterator<Item = Vec<f32>>) -> Planes {
    Planes::new(SIZE, all.into_iter().map(|values| Plane::new(SIZE, values).unwrap()).collect()).unwrap()
}

/// What the tool makes of the colours, and of alpha.
fn of_tool(frame: &Frame, job: &Job) -> (Vec<Vec<u32>>, Report) {
    let masks = find(frame, &job.mask, None).unwrap();
    let choices = choose(frame, &masks.mask_channels, &job.overrides);
    let (plans, run) = (Plans::new(), Run::default());
    let (frame, report) = match &job.enlarge {
        None => fill(frame.clone(), &masks, &choices, job, &plans, &run).unwrap(),
        Some(asked) => {
            enlarge(frame.clone(), &masks, &choices, Beside::default(), (job, asked), &plans, &run).unwrap()
        }
    };
    let names = COLOURS.iter().chain(&["A"]);
    (names.map(|name| bits(&values(&frame.parts[0], name))).collect(), report)
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// Every method with its defaults, and with what smooths where it has such a setting; the dictionary is of one channel.
fn methods() -> Vec<Method> {
    let mut all = Vec::new();
    for found in METHODS {
        let mut method = Method::of(found, &[]).unwrap();
        if found.takes.dictionary {
            let dictionary = Some(Arc::new(dct::dictionary(4, 16).unwrap()));
            method = Learned { dictionary, name: "cosines".into(), how: Use::default() }.into();
        }
        let mut smooth = method.clone();
        for setting in found.settings.iter().filter(|setting| setting.smooths) {
            smooth.set(setting.name, "0.3").or_else(|_| smooth.set(setting.name, "true")).unwrap();
        }
        all.extend((smooth != method).then_some(smooth));
        all.push(method);
    }
    all
}

#[test]
fn filled_by_every_method() {
    for method in methods() {
        for (domain, broken) in [(Domain::Auto, true), (Domain::Linear, false), (Domain::Log, true)] {
            let slopes = method.descriptor().takes.gradients;
            let name = format!("{} {} {domain:?}", method.name(), method.settings());
            let job = Job { domain, ..Job::new(method.clone()) };
            let (tool, report) = of_tool(&sparse(broken, slopes, false), &job);
            let mut options = Options::of(method.clone());
            options.domain = domain;
            if slopes {
                let plane = |down: bool| {
                    let known = slope(down).into_iter().zip(mask().as_slice().to_vec());
                    Plane::new(SIZE, known.map(|(v, flag)| if flag { v } else { f32::NAN }).collect())
                        .unwrap()
                };
                options.gradients = vec![Some([plane(false), plane(true)]); 3];
            }
            let samples = planes((0..3).map(|at| colour(at, broken)));
            let filled = lacuna_filters::fill(&samples, mask(), &options).unwrap();
            for (at, plane) in filled.planes.as_slice().iter().enumerate() {
                assert!(bits(plane.pixels()) == tool[at], "{name}: {}", COLOURS[at]);
            }
            assert_eq!(filled.non_finite, [0, usize::from(broken), 0]);
            let told = COLOURS.iter().map(|name| channel(&report, name));
            let told: Vec<_> =
                told.map(|one| Moved { values: one.limited, most: one.largest_move }).collect();
            assert_eq!(filled.limited, told, "{name}");
            // Dictionaries are for light: the tool fills alpha by splines then.
            let mut options = Options::of(method.clone());
            (options.domain, options.values) = (domain, Values::Other);
            if method.descriptor().takes.dictionary {
                options.method = Method::default();
            }
            options.bounds = vec![Bounds::Unit];
            let filled = lacuna_filters::fill(&planes([alpha()]), mask(), &options).unwrap();
            assert!(bits(filled.planes.as_slice()[0].pixels()) == tool[3], "{name}: A");
        }
    }
}

fn channel<'a>(report: &'a Report, name: &str) -> &'a ChannelReport {
    report.parts[0].channels.iter().find(|channel| channel.name == name).unwrap()
}

#[test]
fn steered_by_guides() {
    let job = Job::new(Method::default());
    let (tool, report) = of_tool(&sparse(false, false, true), &job);
    let mut guides = Guides::new(SIZE);
    guides.add("albedo", vec![Plane::new(SIZE, albedo()).unwrap()]).unwrap();
    let mut options = Options::default();
    options.guides = Some(&guides);
    let samples = planes((0..3).map(|at| colour(at, false)));
    let filled = lacuna_filters::fill(&samples, mask(), &options).unwrap();
    assert!((0..3).all(|at| bits(filled.planes.as_slice()[at].pixels()) == tool[at]));
    let group = report.parts[0].groups.iter().find(|group| group.channels.len() == 3).unwrap();
    assert_eq!(group.guides_gain, filled.sets[0].gain);
    assert!(group.guides_gain.is_some(), "guides that count");
}

#[test]
fn copied_from_twins_by_every_method_that_takes_guides() {
    for method in methods().into_iter().filter(|method| method.descriptor().takes.guides) {
        let mut complete = alpha();
        complete.iter_mut().enumerate().filter(|(at, _)| !mask().as_slice()[*at]).for_each(|(at, value)| {
            *value = (1 + at % 13) as f32 / 16.0;
        });
        let mut frame = sparse(false, false, false);
        frame.parts[0].channels.push(float("dense.A", &complete));
        frame.parts[0].attributes.set_text(crate::channels::DENSE, "dense.A");
        let (tool, report) = of_tool(&frame, &Job::new(method.clone()));
        let mut options = Options::of(method.clone());
        (options.values, options.bounds) = (Values::Other, vec![Bounds::Unit]);
        options.twins = vec![Some(Arc::new(Plane::new(SIZE, complete).unwrap()))];
        let filled = lacuna_filters::fill(&planes([alpha()]), mask(), &options).unwrap();
        let same = bits(filled.planes.as_slice()[0].pixels()) == tool[3];
        let keeps = method.keeps_measured();
        assert!(same, "{} {}", method.name(), method.settings());
        assert_eq!((filled.sets[0].copied, report.parts[0].copied.len()), (keeps, usize::from(keeps)));
    }
}

#[test]
fn smoothed_by_weights() {
    for name in ["ss", "tv"] {
        let smooths = if name == "ss" { "lambda" } else { "epsilon" };
        let method = Method::named(name, &[(smooths, "0.2")]).unwrap();
        let weights = Some(Weights { channel: "samples".into() });
        let (tool, _) = of_tool(&sparse(true, false, false), &Job { weights, ..Job::new(method.clone()) });
        let mut options = Options::of(method);
        options.weights = Some(Arc::new(Plane::new(SIZE, counts()).unwrap()));
        let samples = planes((0..3).map(|at| colour(at, true)));
        let filled = lacuna_filters::fill(&samples, mask(), &options).unwrap();
        assert!((0..3).all(|at| bits(filled.planes.as_slice()[at].pixels()) == tool[at]), "{name}");
    }
}

#[test]
fn enlarged_by_every_method() {
    use upscale::plain::Kernel;
    let tv = lacuna_filters::variational::tv::Settings::default();
    let all = [upscale::Method::Ss, upscale::Method::Tv(tv), upscale::Method::Plain(Kernel::Lanczos3)];
    for method in all {
        for (sampling, domain) in
            [(Sampling::Box, Domain::Auto), (Sampling::Point, Domain::Auto), (Sampling::Grid, Domain::Log)]
        {
            for broken in [false, true] {
                let asked = Enlarge {
                    target: Target::Scale { x: 2.0, y: 2.0 },
                    method,
                    sampling: Some(sampling),
                    take_guides: false,
                    keep_vectors: false,
                };
                let job = Job {
                    domain,
                    enlarge: Some(asked),
                    guides: crate::guides::Asked::None,
                    ..Job::new(Method::default())
                };
                let (tool, _) = of_tool(&sparse(broken, false, false), &job);
                let mut options =
                    lacuna_filters::enlarge::Options::new(Geometry::scaled(SIZE, 2.0, sampling));
                options.method = method;
                options.mask = Some(mask());
                options.fill.domain = domain;
                let samples = planes((0..3).map(|at| colour(at, broken)));
                let large = lacuna_filters::upscale(&samples, &options).unwrap();
                let same = (0..3).all(|at| bits(large.planes.as_slice()[at].pixels()) == tool[at]);
                assert!(same, "{} {sampling} {domain:?} {broken}", asked.name());
            }
        }
    }
}
