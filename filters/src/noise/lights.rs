//! Lights among smoothed pixels: kept where they were measured, and carried between samples only as far as a fill does.
//!
//! With `L` the lights, `s` the smoothed samples beside them, and `F` the default fill through logarithms, missing pixels are `F(s and L)` wherever that is
//! not `F(s)`, which lights then have changed. So a light of one pixel ends before its neighbours, as it does where nothing is smoothed, and one of many
//! pixels is whole.

use std::sync::Arc;

use crate::auto;
use crate::domain::{Domain, Map};
use crate::{Error, Filter, Mask, Plane, Planes, Problem, Run};

/// By how much lights change what they reach, about as a part of it.
const LIT: f32 = 0.05;

/// The measured pixels without those that are lights in a channel.
pub fn without(mask: &Arc<Mask>, lights: Option<&Planes>) -> Arc<Mask> {
    let Some(lights) = lights else { return Arc::clone(mask) };
    let is_light = |pixel: usize| lights.as_slice().iter().any(|plane| plane.pixels()[pixel] > 0.0);
    let flags = mask.as_slice().iter().enumerate().map(|(pixel, flag)| *flag && !is_light(pixel));
    Arc::new(Mask::of(mask.size(), flags.collect()))
}

/// Puts the samples that are lights back into an image of what is `beside` them.
pub fn put_back(
    (mask, beside): (&Arc<Mask>, &Arc<Mask>),
    samples: &Planes,
    out: &mut Planes,
    run: &Run<'_>,
) -> Result<(), Error> {
    let mut with = out.clone();
    let lights = |pixel: &usize| mask.as_slice()[*pixel] && !beside.as_slice()[*pixel];
    for (plane, samples) in with.as_mut_slice().iter_mut().zip(samples.as_slice()) {
        for pixel in (0..mask.size().pixels()).filter(lights) {
            plane.pixels_mut()[pixel] = samples.pixels()[pixel];
        }
    }
    if !mask.is_full() {
        let map = Domain::Log.map(mask, with.as_slice());
        let (bright, dark) = (fill(mask, &with, map, run)?, fill(beside, out, map, run)?);
        for (plane, both) in with.as_mut_slice().iter_mut().zip(bright.as_slice().iter().zip(dark.as_slice()))
        {
            shine(plane, mask, both, map);
        }
    }
    *out = with;
    Ok(())
}

/// Samples as the default method fills them, mapped.
fn fill(mask: &Arc<Mask>, samples: &Planes, map: Map, run: &Run<'_>) -> Result<Planes, Error> {
    let mut mapped = samples.clone();
    mapped.as_mut_slice().iter_mut().for_each(|plane| map.forward_plane(mask, plane));
    let mut filled = Planes::zeros(samples.size(), samples.len());
    let plan = auto::Settings.plan(&Problem::fill(Arc::clone(mask)), run)?;
    if let Some(blend) = plan.blend() {
        blend.choose((&mapped, map), (None, &[]), false, &mut filled, run)?;
    }
    Ok(filled)
}

/// Takes the fill with lights where it is another one than that without.
fn shine(plane: &mut Plane, mask: &Mask, (bright, dark): (&Plane, &Plane), map: Map) {
    let fills = bright.pixels().iter().zip(dark.pixels());
    let missing = plane.pixels_mut().iter_mut().zip(mask.as_slice()).zip(fills);
    for ((value, _), (&bright, &dark)) in missing.filter(|((_, flag), _)| !**flag) {
        if (bright - dark).abs() > LIT {
            *value = map.inverse(bright);
        }
    }
}
