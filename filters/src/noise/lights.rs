//! Lights among smoothed pixels: kept where they were measured, and carried between samples only as far as a fill does.
//!
//! With `L` the lights, `s` the smoothed samples beside them, and `F` the default fill through logarithms, missing pixels are `F(s and L)` wherever that is
//! not `F(s)`, up to `REACH` spacings of the samples away from a light: `F` chooses by all samples, so that lights change it a little far away, too. So a
//! light of one pixel ends before its neighbours, as it does where nothing is smoothed, and one of many pixels is whole.

use std::sync::Arc;

use crate::auto::{self, Blend};
use crate::baseline::nearest::NearestMap;
use crate::domain::{Domain, Map};
use crate::{Error, Filter, Mask, Outcome, Plane, Planes, Problem, Run};

/// By how much lights change what they reach, about as a part of it: less is not seen beside a light. Not measured.
const LIT: f32 = 0.05;
/// Spacings of the samples that lights reach: as far as a spline through logarithms rings by more than `LIT` around light of a thousand times as much.
const REACH: f64 = 4.0;

/// The measured pixels without those that are lights in a channel.
pub fn without(mask: &Arc<Mask>, lights: Option<&Planes>) -> Arc<Mask> {
    let Some(lights) = lights else { return Arc::clone(mask) };
    let is_light = |pixel: usize| lights.as_slice().iter().any(|plane| plane.pixels()[pixel] > 0.0);
    let flags = mask.as_slice().iter().enumerate().map(|(pixel, flag)| *flag && !is_light(pixel));
    Arc::new(Mask::of(mask.size(), flags.collect()))
}

/// Puts the samples that are lights back into an image of what is `beside` them. An interrupted run fills nothing around them.
pub fn put_back(
    (mask, beside): (&Arc<Mask>, &Arc<Mask>),
    samples: &Planes,
    out: &mut Planes,
    run: &Run<'_>,
) -> Result<Outcome, Error> {
    let mut with = out.clone();
    let flags = mask.as_slice().iter().zip(beside.as_slice()).map(|(flag, beside)| *flag && !beside);
    let lights = Mask::of(mask.size(), flags.collect());
    for (plane, samples) in with.as_mut_slice().iter_mut().zip(samples.as_slice()) {
        lights.restore(samples, plane);
    }
    let mut outcome = Outcome::direct();
    if let Some(stop) = run.interrupted() {
        outcome.stop = stop;
    } else if !mask.is_full() && lights.count() > 0 {
        let map = Domain::Log.map(mask, with.as_slice());
        let (bright, first) = fill(mask, &with, map, run)?;
        let (dark, second) = fill(beside, out, map, run)?;
        outcome = first.worst(second);
        let near = near(mask, &lights)?;
        for (plane, both) in with.as_mut_slice().iter_mut().zip(bright.as_slice().iter().zip(dark.as_slice()))
        {
            shine(plane, &near, both, map);
        }
    }
    *out = with;
    Ok(outcome)
}

/// Samples as the default method fills them, mapped.
fn fill(mask: &Arc<Mask>, samples: &Planes, map: Map, run: &Run<'_>) -> Result<(Planes, Outcome), Error> {
    let mut mapped = samples.clone();
    mapped.as_mut_slice().iter_mut().for_each(|plane| map.forward_plane(mask, plane));
    let mut filled = Planes::zeros(samples.size(), samples.len());
    let plan = auto::Settings.plan(&Problem::fill(Arc::clone(mask)), run)?;
    let outcome = match Blend::of(plan.as_ref()) {
        Some(blend) => blend.choose((&mapped, map), (None, &[]), None, &mut filled, run)?.0,
        None => plan.reconstruct(&mapped, &mut filled, run)?,
    };
    Ok((filled, outcome))
}

/// The missing pixels that lights reach.
fn near(mask: &Mask, lights: &Mask) -> Result<Mask, Error> {
    let area = mask.size().pixels() as f64 / mask.count().max(1) as f64;
    let distances = NearestMap::new(lights)?.squared_distances();
    let pixels = distances.iter().zip(mask.as_slice());
    let near = pixels.map(|(squared, flag)| !flag && f64::from(*squared) <= REACH * REACH * area);
    Ok(Mask::of(mask.size(), near.collect()))
}

/// Takes the fill with lights where it is another one than that without.
fn shine(plane: &mut Plane, near: &Mask, (bright, dark): (&Plane, &Plane), map: Map) {
    let fills = bright.pixels().iter().zip(dark.pixels());
    let near = plane.pixels_mut().iter_mut().zip(near.as_slice()).zip(fills);
    for ((value, _), (&bright, &dark)) in near.filter(|((_, flag), _)| **flag) {
        if (bright - dark).abs() > LIT {
            *value = map.inverse(bright);
        }
    }
}
