//! Fireflies and lights: what of a sample lies far above the others.

use lacuna_core::parallel::prelude::*;

use super::LIMIT;
use crate::{Mask, Plane, Planes, domain};

/// Pixels that one task takes.
const PIECE: usize = 1 << 14;

/// Noise far above all light is doubted where it is that of at most one sample in so many: that of more is as large as it says.
const FEW: usize = 10;

/// Samples below the limit, and what lies beyond it.
pub struct Split {
    /// Samples below the limit.
    pub samples: Planes,
    /// Their noise.
    pub noise: Option<Planes>,
    /// The samples that are lights, zero elsewhere.
    pub lights: Option<Planes>,
    /// What nine tenths of the samples that are not black stay below; infinite where they are no light, or all black.
    pub level: f32,
}

impl Split {
    /// Cuts samples at a level that they show themselves, if they may be light.
    pub fn new(mask: &Mask, samples: &Planes, noise: Option<&Planes>, light: bool) -> Self {
        let level = if light { level(mask, samples) } else { f32::INFINITY };
        let limit = LIMIT * level;
        let mut own = Self { samples: samples.clone(), noise: noise.cloned(), lights: None, level };
        let mut lights = Planes::zeros(samples.size(), samples.len());
        let mut any = false;
        for (channel, (plane, light)) in
            own.samples.as_mut_slice().iter_mut().zip(lights.as_mut_slice()).enumerate()
        {
            let noise = own.noise.as_mut().map(|planes| &mut planes.as_mut_slice()[channel]);
            any |= cut((plane, noise, light), mask, (level, limit));
        }
        own.lights = any.then_some(lights);
        own.doubt(mask, limit);
        own
    }

    /// The samples with lights, but without fireflies, if halves tell the two apart.
    pub fn without_fireflies(&self) -> Option<Planes> {
        self.noise.as_ref()?;
        Some(self.with_lights().unwrap_or_else(|| self.samples.clone()))
    }

    /// The samples with lights, if there are any.
    pub fn with_lights(&self) -> Option<Planes> {
        let lights = self.lights.as_ref()?;
        let mut whole = self.samples.clone();
        for (plane, lights) in whole.as_mut_slice().iter_mut().zip(lights.as_slice()) {
            let pixels = plane.pixels_mut().iter_mut().zip(lights.pixels());
            pixels.filter(|(_, light)| **light > 0.0).for_each(|(value, light)| *value = *light);
        }
        Some(whole)
    }

    /// Noise far above all light at few samples, as of half buffers that were not clamped as the colour was, tells nothing there.
    fn doubt(&mut self, mask: &Mask, limit: f32) {
        let Some(noise) = &mut self.noise else { return };
        for plane in noise.as_mut_slice() {
            let pieces = mask.as_slice().par_chunks(PIECE).zip(plane.pixels().par_chunks(PIECE)).enumerate();
            let pieces = pieces.map(|(piece, (flags, noise))| {
                let known =
                    || flags.iter().zip(noise).enumerate().filter(|(_, (flag, n))| **flag && n.is_finite());
                let far = known().filter(|(_, (_, n))| n.abs() > limit).map(|(at, _)| piece * PIECE + at);
                (known().count(), far.collect::<Vec<usize>>())
            });
            let known: usize = pieces.iter().map(|piece| piece.0).sum();
            let far: Vec<usize> = pieces.into_iter().flat_map(|piece| piece.1).collect();
            if far.len() * FEW <= known {
                let pixels = plane.pixels_mut();
                for at in far {
                    pixels[at] = f32::NAN;
                }
            }
        }
    }
}

/// Cuts the measured pixels of a plane at a limit; whether any light lies beyond it.
fn cut(
    (plane, noise, light): (&mut Plane, Option<&mut Plane>, &mut Plane),
    mask: &Mask,
    (level, limit): (f32, f32),
) -> bool {
    let pieces = mask.size().pixels().div_ceil(PIECE);
    let noise: Vec<Option<&mut [f32]>> = match noise {
        Some(noise) => noise.pixels_mut().chunks_mut(PIECE).map(Some).collect(),
        None => (0..pieces).map(|_| None).collect(),
    };
    let planes =
        plane.pixels_mut().par_chunks_mut(PIECE).zip(light.pixels_mut().par_chunks_mut(PIECE)).zip(noise);
    let any = planes.zip(mask.as_slice().par_chunks(PIECE)).map(|(((values, lights), mut noise), flags)| {
        let mut any = false;
        for (at, _) in flags.iter().enumerate().filter(|(_, flag)| **flag) {
            let value = values[at];
            let n = noise.as_ref().map_or(0.0, |noise| noise[at]);
            // No half of light is so far below zero: such noise was drawn.
            let n = if n.is_finite() && value - n.abs() >= -level { n } else { 0.0 };
            let (low, high) = (value - n.abs(), value + n.abs());
            if high <= limit {
                continue;
            }
            let halves = (low.min(limit), high.min(limit));
            values[at] = 0.5 * (halves.0 + halves.1);
            if let Some(noise) = noise.as_mut().filter(|_| n != 0.0) {
                noise[at] = (0.5 * (halves.1 - halves.0)).copysign(n);
            }
            // What both halves show is no firefly: the sample itself comes back.
            if low > limit {
                (lights[at], any) = (value, true);
            }
        }
        any
    });
    any.contains(&true)
}

/// The value that nine tenths of the samples that are not black stay below, by their largest channel: how much black surrounds an object must not
/// move the level into its rim.
fn level(mask: &Mask, samples: &Planes) -> f32 {
    let largest =
        |pixel: usize| samples.as_slice().iter().fold(0.0_f32, |most, plane| most.max(plane.pixels()[pixel]));
    let (black, _) = domain::black(mask, samples.as_slice());
    let pieces = mask.as_slice().par_chunks(PIECE).enumerate().map(|(piece, flags)| {
        let measured = flags.iter().enumerate().filter(|(_, flag)| **flag);
        let lit = measured.map(|(at, _)| largest(piece * PIECE + at)).filter(|most| f64::from(*most) > black);
        lit.collect::<Vec<f32>>()
    });
    let mut levels = pieces.concat();
    if levels.is_empty() {
        return f32::INFINITY;
    }
    let at = levels.len() * 9 / 10;
    *levels.select_nth_unstable_by(at, f32::total_cmp).1
}
