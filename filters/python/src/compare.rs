//! `compare`: the measures of `lacuna compare`, of colours.

use lacuna_filters::metric::error::{self, Options, Statistics};
use lacuna_filters::metric::ssim::Similarity;
use lacuna_filters::metric::{flip, mean};
use lacuna_filters::{Error, Mask, Plane, Planes};
use pyo3::prelude::*;

use crate::arrays::{self, Bytes, Image, Order};
use crate::work::{pool, run};

/// A measure's value, where there is one.
type Row = (&'static str, Option<f64>);

/// Compares two images, over all pixels or those of a mask.
#[pyfunction]
#[pyo3(signature = (reference, image, region, peak, clip, flip, threads))]
pub fn compare<'py>(
    py: Python<'py>,
    reference: Image<'py>,
    image: Image<'py>,
    region: Option<Bytes<'py>>,
    peak: f32,
    clip: bool,
    flip: bool,
    threads: usize,
) -> PyResult<Vec<Row>> {
    let pool = pool(threads)?;
    let pair = (reference.planes(Order::Plain, &pool), image.planes(Order::Plain, &pool));
    let region = region.map(|region| arrays::mask(&region));
    drop((reference, image));
    run(py, &pool, |_| measures(&pair.0, &pair.1, region.as_ref(), Options { peak, clip }, flip))
}

fn measures(
    reference: &Planes,
    image: &Planes,
    region: Option<&Mask>,
    options: Options,
    flip: bool,
) -> Result<Vec<Row>, Error> {
    let flags = region.map(Mask::as_slice);
    let pixels = region.map_or(reference.size().pixels(), Mask::count);
    let (mut sums, mut similar) = (Statistics::default(), Vec::new());
    for (reference, image) in reference.as_slice().iter().zip(image.as_slice()) {
        let own = error::compare(reference, image, flags, options)?;
        sums = sums.and(own);
        let clip = options.clip.then_some(options.peak);
        let pair = [clean(reference, reference, clip), clean(image, reference, clip)];
        let mean = Similarity::new(&pair[0], &pair[1], options.peak)?.mean(flags)?;
        // What is not finite counts as 0 in both, which is no likeness where there is nothing else.
        similar.push(mean.filter(|_| own.count > 0));
    }
    let similar: Option<Vec<f64>> = similar.into_iter().collect();
    let mut rows = vec![
        ("pixels", Some(pixels as f64)),
        ("mse", sums.mse()),
        ("rmse", sums.rmse()),
        ("max", (sums.count > 0).then_some(sums.largest)),
        ("psnr", sums.psnr(options.peak)),
        ("relative_mse", sums.relative_mse()),
        ("log_psnr", sums.log_psnr()),
        ("ssim", similar.map(|all| all.iter().sum::<f64>() / all.len().max(1) as f64)),
        ("different", Some(sums.different as f64)),
        ("nan", Some(sums.test_nan as f64)),
        ("inf", Some(sums.test_infinite as f64)),
        ("left_out", Some((pixels * reference.len() - sums.count) as f64)),
        ("hidden", sums.hidden_share()),
    ];
    if flip {
        let seen = seen(reference, image, options.peak)?.map(|map| mean(&map, flags)).transpose()?.flatten();
        rows.push(("flip", seen.filter(|_| sums.count > 0)));
    }
    Ok(rows)
}

/// LDR-FLIP of three channels or of one.
fn seen(reference: &Planes, image: &Planes, peak: f32) -> Result<Option<Plane>, Error> {
    let clean = |planes: &Planes| -> Vec<Plane> {
        let pairs = planes.as_slice().iter().zip(reference.as_slice());
        pairs.map(|(plane, reference)| clean(plane, reference, None)).collect()
    };
    match (clean(reference).as_slice(), clean(image).as_slice()) {
        ([r, g, b], [x, y, z]) => {
            flip::display([r, g, b], [x, y, z], flip::PIXELS_PER_DEGREE, peak).map(Some)
        }
        ([r], [x]) => flip::display([r, r, r], [x, x, x], flip::PIXELS_PER_DEGREE, peak).map(Some),
        _ => Ok(None),
    }
}

/// 0 where a value, or that of the reference, is not finite; clipped to a peak, if there is one.
fn clean(plane: &Plane, reference: &Plane, clip: Option<f32>) -> Plane {
    let mut out = plane.clone();
    for (value, reference) in out.pixels_mut().iter_mut().zip(reference.pixels()) {
        let usable = value.is_finite() && reference.is_finite();
        *value = if usable { clip.map_or(*value, |peak| value.clamp(0.0, peak)) } else { 0.0 };
    }
    out
}
