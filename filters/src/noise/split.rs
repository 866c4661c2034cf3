//! Fireflies and lights: what of a sample lies far above the others.

use super::LIMIT;
use crate::{Mask, Planes};

/// Noise far above all light is doubted where it is that of at most one sample in so many: that of more is as large as it says.
const FEW: usize = 10;

/// Samples below the limit, and what lies beyond it.
pub struct Split {
    /// Samples below the limit.
    pub samples: Planes,
    /// Their noise.
    pub noise: Option<Planes>,
    /// Light beyond the limit.
    pub lights: Option<Planes>,
    /// What nine tenths of the samples stay below; infinite where they are no light, or none is.
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
            let mut noise = own.noise.as_mut().map(|planes| planes.as_mut_slice()[channel].pixels_mut());
            for (pixel, _) in mask.as_slice().iter().enumerate().filter(|(_, flag)| **flag) {
                let value = plane.pixels()[pixel];
                let n = noise.as_ref().map_or(0.0, |noise| noise[pixel]);
                // No half of light is so far below zero: such noise was drawn.
                let n = if n.is_finite() && value - n.abs() >= -level { n } else { 0.0 };
                let (low, high) = (value - n.abs(), value + n.abs());
                if high <= limit {
                    continue;
                }
                let halves = (low.min(limit), high.min(limit));
                plane.pixels_mut()[pixel] = 0.5 * (halves.0 + halves.1);
                if let Some(noise) = noise.as_mut().filter(|_| n != 0.0) {
                    noise[pixel] = (0.5 * (halves.1 - halves.0)).copysign(n);
                }
                light.pixels_mut()[pixel] = (low - limit).max(0.0);
                any |= low > limit;
            }
        }
        own.lights = any.then_some(lights);
        own.doubt(mask, limit);
        own
    }

    /// The samples with lights, but without fireflies, if halves tell the two apart.
    pub fn without_fireflies(&self) -> Option<Planes> {
        self.noise.as_ref()?;
        let mut clean = self.samples.clone();
        let lights = self.lights.iter().flat_map(Planes::as_slice);
        for (plane, lights) in clean.as_mut_slice().iter_mut().zip(lights) {
            plane.pixels_mut().iter_mut().zip(lights.pixels()).for_each(|(value, light)| *value += light);
        }
        Some(clean)
    }

    /// Noise far above all light at few samples, as of half buffers that were not clamped as the colour was, tells nothing there.
    fn doubt(&mut self, mask: &Mask, limit: f32) {
        let Some(noise) = &mut self.noise else { return };
        for plane in noise.as_mut_slice() {
            let known = |at: &usize| mask.as_slice()[*at] && plane.pixels()[*at].is_finite();
            let known: Vec<usize> = (0..plane.pixels().len()).filter(known).collect();
            let far: Vec<usize> =
                known.iter().copied().filter(|&at| plane.pixels()[at].abs() > limit).collect();
            if far.len() * FEW <= known.len() {
                let pixels = plane.pixels_mut();
                for at in far {
                    pixels[at] = f32::NAN;
                }
            }
        }
    }
}

/// The value that nine tenths of the samples stay below, by their largest channel.
fn level(mask: &Mask, samples: &Planes) -> f32 {
    let mut levels: Vec<f32> = (0..mask.size().pixels())
        .filter(|&pixel| mask.as_slice()[pixel])
        .map(|pixel| samples.as_slice().iter().fold(0.0_f32, |most, plane| most.max(plane.pixels()[pixel])))
        .collect();
    if levels.is_empty() {
        return f32::INFINITY;
    }
    let at = levels.len() * 9 / 10;
    let (_, level, _) = levels.select_nth_unstable_by(at, f32::total_cmp);
    if *level > 0.0 { *level } else { f32::INFINITY }
}
