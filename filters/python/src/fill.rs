//! `fill` and `estimate`, and what there is to fill with.

use std::sync::Arc;

use lacuna_filters::baseline::nearest;
use lacuna_filters::descriptor::Descriptor;
use lacuna_filters::domain::Domain;
use lacuna_filters::estimate::{Verdict, Why};
use lacuna_filters::fill::{Estimate, Filled, Set, Values, fill_with};
use lacuna_filters::noise::{Noise, Untold};
use lacuna_filters::variational::guided::Guides;
use lacuna_filters::{Bounds, METHODS, Mask, Method, Options, Outcome, Plane, Planes, Plans, Size, Stop};
use numpy::PyReadonlyArray2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::ThreadPool;

use crate::arrays::{self, Array, Bytes, Guide, Image, Order};
use crate::work::{pool, refusal, run};

/// Settings by name.
pub type Settings = Vec<(String, String)>;

/// How wrong the missing pixels are: estimate, lower and upper end; the upper one alone where samples do not show more.
type Rmse = (Option<f64>, Option<f64>, f64);

/// How a solver ended, and the relative duality gap, the residual and the distance from the input that are left, where it knows one.
#[derive(IntoPyObject)]
pub struct End {
    stop: &'static str,
    iterations: usize,
    gap: Option<f64>,
    residual: Option<f64>,
    off_input: Option<f64>,
}

/// What is told of a fill beside the image.
#[derive(IntoPyObject)]
pub struct Report<'py> {
    end: End,
    /// Whether noise was smoothed.
    smoothed: bool,
    filters: Vec<(&'static str, f64)>,
    guides: Vec<String>,
    rmse: Option<Rmse>,
    unclipped_rmse: Option<f64>,
    /// The part of the measured values that are above the peak, where an error is told of light.
    clipped: f64,
    reason: Option<String>,
    errors: Option<Bound<'py, PyAny>>,
}

impl From<Outcome> for End {
    fn from(outcome: Outcome) -> Self {
        let stop = match outcome.stop {
            Stop::Converged => "converged",
            Stop::IterationLimit => "iteration-limit",
            Stop::TimeLimit => "time-limit",
            Stop::Cancelled => "cancelled",
        };
        Self {
            stop,
            iterations: outcome.iterations,
            gap: outcome.gap,
            residual: outcome.residual,
            off_input: outcome.off_input,
        }
    }
}

/// The method of that name.
pub fn method(name: &str, settings: &Settings) -> PyResult<Method> {
    let settings: Vec<(&str, &str)> = settings.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
    let known: Vec<&str> = methods().map(|method| method.name).collect();
    if !known.contains(&name) {
        let known = known.join(", ");
        return Err(PyValueError::new_err(format!("filter: there is no filter '{name}', but {known}")));
    }
    let method = Method::named(name, &settings).map_err(|error| refusal(&error))?;
    method.check().map_err(|error| refusal(&error))?;
    Ok(method)
}

/// What values are, the bounds of any plane if they are not those of all such values, and the order of planes.
pub fn values(name: &str) -> PyResult<(Values, Option<Bounds>, Order)> {
    Ok(match name {
        "light" => (Values::Light, None, Order::Colours),
        "matte" => (Values::Other, Some(Bounds::Unit), Order::Colours),
        "other" => (Values::Other, None, Order::Plain),
        "directions" => (Values::Directions, None, Order::Plain),
        _ => {
            return Err(PyValueError::new_err(format!(
                "values: '{name}' is none of light, matte, other, directions"
            )));
        }
    })
}

/// Where light is reconstructed.
pub fn domain(name: &str) -> PyResult<Domain> {
    Ok(match name {
        "auto" => Domain::Auto,
        "linear" => Domain::Linear,
        "log" => Domain::Log,
        _ => return Err(PyValueError::new_err(format!("domain: '{name}' is none of auto, linear, log"))),
    })
}

fn estimate(name: &str) -> PyResult<Estimate> {
    Ok(match name {
        "no" => Estimate::No,
        "figure" => Estimate::Figure,
        "pixels" => Estimate::Pixels,
        _ => return Err(PyValueError::new_err("estimate: none of no, figure, pixels")),
    })
}

/// The guides as the filters take them.
fn guides(
    arrays: Vec<(String, Guide<'_>)>,
    method: &Method,
    image: &Planes,
    pool: &ThreadPool,
) -> PyResult<Guides> {
    let takes = method.descriptor().takes.guides && method.keeps_measured();
    if !takes && !arrays.is_empty() {
        let able: Vec<&str> = methods().filter(|known| known.takes.guides).map(|known| known.name).collect();
        let able = able.join(" and ");
        let line = format!("guides: only {able} take some, and only where measured pixels are kept");
        return Err(PyValueError::new_err(line));
    }
    steering(arrays, image.size(), pool)
}

/// Complete planes of that size, as the filters take them.
pub fn steering(arrays: Vec<(String, Guide<'_>)>, size: Size, pool: &ThreadPool) -> PyResult<Guides> {
    let mut guides = Guides::new(size);
    for (name, guide) in arrays {
        match guide {
            Guide::Labels(labels) => guides.add_labels(&name, &arrays::labels(&labels)),
            Guide::Values(values) => guides.add(&name, components(values.planes(Order::Plain, pool))),
        }
        .map_err(|error| PyValueError::new_err(format!("guides['{name}']: {error}")))?;
    }
    Ok(guides)
}

/// In the order of a file, by their names: what is nowhere negative is red, green and blue, else x, y and z.
fn components(planes: Planes) -> Vec<Plane> {
    let mut planes = planes.into_vec();
    if planes.len() == 3 && !planes.iter().flat_map(Plane::pixels).any(|value| *value < 0.0) {
        planes.reverse();
    }
    planes
}

/// How much each measured pixel counts; what is at others is not looked at.
fn weights(
    array: &PyReadonlyArray2<'_, f32>,
    method: &Method,
    counted: bool,
    mask: &Mask,
) -> PyResult<Arc<Plane>> {
    let refused = |why: String| Err(PyValueError::new_err(format!("weights: {why}")));
    match method.weighs() {
        Ok(()) => {}
        Err(_) if counted => {}
        Err("") => {
            let able: Vec<String> = methods().filter_map(smoothing).collect();
            let able = able.join(" or ");
            return refused(format!(
                "they count only where measured pixels are smoothed, by {able}, or with noise = auto"
            ));
        }
        Err(name) => {
            return refused(format!("not with {name} = {}", method.get(name).unwrap_or_default()));
        }
    }
    let plane = Plane::from(array.as_array());
    let counts = |weight: f32| weight.is_finite() && weight >= 0.0;
    let pairs = plane.pixels().iter().zip(mask.as_slice());
    match pairs.filter(|(weight, flag)| **flag && !counts(**weight)).count() {
        0 => Ok(Arc::new(plane)),
        bad => refused(format!(
            "{bad} measured pixels have some that are negative, NaN or infinite; give finite numbers of 0 or more (0: counts for nothing)"
        )),
    }
}

/// What is known of the noise of an image, by a word and what belongs to it.
fn noise((kind, known): (&str, &[Planes]), values: Values, samples: &Planes, mask: &Mask) -> PyResult<Noise> {
    let refused = |why: &dyn std::fmt::Display| PyValueError::new_err(format!("noise: {why}"));
    let planes: Result<Vec<Plane>, Untold> = match (kind, known) {
        ("none", _) => return Ok(Noise::None),
        ("auto", _) if values == Values::Light => return Ok(Noise::Unknown),
        ("auto", _) => {
            return Err(refused(&"auto is for light; of other values give the variance or half buffers"));
        }
        (_, [variance]) => {
            let planes = variance.as_slice().iter().enumerate();
            planes.map(|(number, plane)| Noise::of_variance_at(plane, number, mask)).collect()
        }
        (_, [first, second]) => {
            let halves = first.as_slice().iter().zip(second.as_slice()).zip(samples.as_slice());
            halves
                .map(|((first, second), samples)| Noise::of_halves(samples, [first, second], mask))
                .collect()
        }
        _ => return Err(refused(&"give one array or two")),
    };
    planes.and_then(|planes| Noise::like(planes, samples, mask)).map_err(|why| match why {
        Untold::Nowhere if known.len() == 2 => refused(&Untold::SameHalves),
        _ => refused(&why),
    })
}

/// The settings by which a filter smooths by weights, in words.
fn smoothing(method: &'static Descriptor) -> Option<String> {
    let smooths = method.settings.iter().filter(|setting| setting.smooths);
    let names: Vec<&str> = smooths.map(|setting| setting.name).collect();
    method.takes.weights.then(|| format!("{} with {} above 0", method.name, names.join(" or ")))
}

/// Fills an image; without a mask, what is not finite in any channel is missing.
#[pyfunction]
#[pyo3(signature = (image, mask, guides, twin, filter, settings, values, domain, limit, weights, noise, known, estimate, peak, threads))]
pub fn fill<'py>(
    py: Python<'py>,
    image: Image<'py>,
    mask: Option<Bytes<'py>>,
    guides: Vec<(String, Guide<'py>)>,
    twin: Option<Image<'py>>,
    filter: &str,
    settings: Settings,
    values: &str,
    domain: &str,
    limit: bool,
    weights: Option<PyReadonlyArray2<'py, f32>>,
    noise: &str,
    known: Vec<Image<'py>>,
    estimate: &str,
    peak: f32,
    threads: usize,
) -> PyResult<(Bound<'py, PyAny>, Report<'py>)> {
    let pool = pool(threads)?;
    let (values, bounds, order) = self::values(values)?;
    let stand = (order, image.kind());
    let samples = image.planes(order, &pool);
    let given = mask.is_some();
    let mask = Arc::new(arrays::measured(mask.as_ref(), &samples)?);
    let mut options = Options::of(method(filter, &settings)?);
    let guides = self::guides(guides, &options.method, &samples, &pool)?;
    let known = known.iter().map(|image| image.planes(order, &pool)).collect::<Vec<_>>();
    options.noise = self::noise((noise, &known), values, &samples, &mask)?;
    if options.noise != Noise::None && !options.method.keeps_measured() && !options.method.is_open() {
        let line =
            format!("noise: it says how much to smooth; leave out the settings by which {filter} smooths");
        return Err(PyValueError::new_err(line));
    }
    if !given && mask.is_full() && options.keeps_measured() {
        return Err(arrays::nothing_missing());
    }
    options.values = values;
    options.bounds = bounds.map(|bounds| vec![bounds; samples.len()]).unwrap_or_default();
    if values == Values::Light {
        arrays::not_wrong(&mask, &samples)?;
    }
    options.domain = self::domain(domain)?;
    options.limit = limit;
    let counted = options.noise == Noise::Unknown;
    options.weights =
        weights.map(|array| self::weights(&array, &options.method, counted, &mask)).transpose()?;
    options.guides = (!guides.is_empty()).then_some(&guides);
    let twins = twin.map(|twin| twin.planes(order, &pool).into_vec()).unwrap_or_default();
    options.twins = twins.into_iter().map(|plane| Some(Arc::new(plane))).collect();
    options.estimate = self::estimate(estimate)?;
    options.peak = peak;
    drop(image);
    let copied = copied(&samples, &mask, &options);
    let (array, filled) = run(py, &pool, |run| {
        let filled = fill_with(&samples, copied.as_ref().unwrap_or(&mask), &options, &Plans::new(), run);
        let mut filled = filled.map_err(|error| order.back(error, samples.len()))?;
        let mut planes = std::mem::replace(&mut filled.planes, Planes::zeros(samples.size(), 0));
        if copied.is_some() {
            put_back(&samples, &mask, &mut planes);
        }
        Ok((Array::new(planes, stand), filled))
    })?;
    let mut report = report(py, &filled, samples.len())?;
    if options.estimate != Estimate::No && values == Values::Light {
        report.clipped = above(peak, &samples, &mask);
    }
    Ok((array.into_python(py)?, report))
}

/// The pixels that missing ones are copied from, where values are copied: those that are finite in all channels, if there are some, so
/// that the components of a vector stay together. Other measured ones are kept, as by the rule `nearest` of the tool.
fn copied(samples: &Planes, mask: &Mask, options: &Options<'_>) -> Option<Arc<Mask>> {
    let other = options.values == Values::Other && options.bounds.is_empty();
    if !other || options.method.name() != nearest::DESCRIPTOR.name || mask.is_full() {
        return None;
    }
    let finite = Mask::finite(samples);
    let usable = Mask::from_fn(mask.size(), |y, x| mask.is_measured(y, x) && finite.is_measured(y, x));
    (!usable.is_empty() && usable.count() < mask.count()).then(|| Arc::new(usable))
}

/// Puts measured values back.
fn put_back(samples: &Planes, mask: &Mask, planes: &mut Planes) {
    for (samples, plane) in samples.as_slice().iter().zip(planes.as_mut_slice()) {
        let pixels = plane.pixels_mut().iter_mut().zip(samples.pixels()).zip(mask.as_slice());
        pixels.filter(|(_, flag)| **flag).for_each(|((value, &sample), _)| *value = sample);
    }
}

fn report<'py>(py: Python<'py>, filled: &Filled, planes: usize) -> PyResult<Report<'py>> {
    let errors = filled.errors().map(|plane| {
        let size = plane.size();
        arrays::shaped(py, plane.into_pixels(), [size.height, size.width])
    });
    let (rmse, reason) = verdict(&filled.sets, |set| set.estimate);
    let beyond = filled.sets.iter().any(|set| set.unclipped.is_some());
    let plain = |set: &Set| set.unclipped.or(set.estimate);
    let unclipped = if beyond { verdict(&filled.sets, plain).0 } else { rmse };
    let mut filters: Vec<(&'static str, f64)> = Vec::new();
    for set in &filled.sets {
        let part = set.planes.len() as f64 / planes.max(1) as f64;
        let alone = [(if set.copied { "copy" } else { set.method.name() }, 1.0)];
        for &(name, share) in if set.shares.is_empty() { &alone[..] } else { &set.shares } {
            match filters.iter_mut().find(|known| known.0 == name) {
                Some(known) => known.1 += part * share,
                None => filters.push((name, part * share)),
            }
        }
    }
    let mut guides: Vec<String> = filled.sets.iter().flat_map(|set| set.guides.clone()).collect();
    guides.sort();
    guides.dedup();
    Ok(Report {
        end: filled.outcome.into(),
        smoothed: filled.sets.iter().any(|set| set.smoothed),
        filters,
        guides,
        rmse,
        unclipped_rmse: unclipped.and_then(|rmse| rmse.0),
        clipped: 0.0,
        reason,
        errors: errors.transpose()?,
    })
}

/// The part of the measured values that are above a peak.
fn above(peak: f32, samples: &Planes, mask: &Mask) -> f64 {
    let measured = samples.as_slice().iter().flat_map(|plane| plane.pixels().iter().zip(mask.as_slice()));
    let count = measured.filter(|(value, flag)| **flag && **value > peak).count();
    count as f64 / (mask.count() * samples.len()).max(1) as f64
}

/// Over all sets that were not copied, each counting by its planes.
fn verdict(sets: &[Set], of: impl Fn(&Set) -> Option<Verdict>) -> (Option<Rmse>, Option<String>) {
    let (mut squares, mut planes, mut bound) = ([0.0; 3], 0.0, false);
    if let [set, ..] = sets
        && sets.iter().all(|set| set.copied)
    {
        return (
            None,
            Some(format!("copied from the twin, equal at all {} measured pixels", set.mask.count())),
        );
    }
    for set in sets.iter().filter(|set| !set.copied) {
        let ends = match of(set) {
            None => return (None, Some(untold(set))),
            Some(Verdict::CannotTell(why)) => return (None, Some(why.to_string())),
            Some(Verdict::Estimate(found)) => [found.rmse, found.low, found.high],
            Some(Verdict::AtMost(most)) => {
                bound = true;
                [most; 3]
            }
        };
        let count = set.planes.len() as f64;
        squares.iter_mut().zip(ends).for_each(|(sum, rmse)| *sum += count * rmse * rmse);
        planes += count;
    }
    if planes == 0.0 {
        return (None, Some("nothing is missing".into()));
    }
    let [rmse, low, high] = squares.map(|sum| (sum / planes).sqrt());
    if high == 0.0 {
        // Which is no promise of places that no sample has met.
        return (Some((Some(0.0), Some(0.0), 0.0)), Some("no error at held-out samples".into()));
    }
    if bound {
        return (Some((None, None, high)), Some(Why::TooFar.to_string()));
    }
    (Some((Some(rmse), Some(low), high)), None)
}

/// Why held-out samples were not asked.
fn untold(set: &Set) -> String {
    if set.smoothed || !set.method.keeps_measured() {
        return "measured pixels are smoothed, so that their errors are not those beside them".into();
    }
    format!("fills by {} without some of the samples take too long", set.method.name())
}

/// A setting: name, values, default, help.
type SettingRow = (&'static str, String, String, &'static str);

/// The filters: name, help, settings.
#[pyfunction]
pub fn filters() -> Vec<(&'static str, &'static str, Vec<SettingRow>)> {
    let setting = |plain: &Method, setting: &lacuna_filters::descriptor::Setting| {
        let default = plain.get(setting.name).unwrap_or_default();
        (setting.name, setting.values(), default, setting.help)
    };
    let row = |method: &'static Descriptor| {
        let plain = Method::of(method, &[]).unwrap_or_default();
        let settings = method.settings.iter().filter(|setting| !setting.flag.is_empty());
        (method.name, method.help, settings.map(|one| setting(&plain, one)).collect())
    };
    methods().map(row).collect()
}

/// Those that Python has: it knows no files of dictionaries.
fn methods() -> impl Iterator<Item = &'static Descriptor> {
    METHODS.iter().copied().filter(|method| !method.takes.dictionary)
}

/// Bytes that a filter takes for each pixel beside those of the channels, if measured pixels lie everywhere.
#[pyfunction]
pub fn bytes_per_pixel(filter: &str) -> u64 {
    METHODS.iter().find(|method| method.name == filter).map_or(0, |method| method.even.image)
}
