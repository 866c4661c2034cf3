//! The way of pixels between an image and the buffers of a tile.
//!
//! Roofline: 5 bytes a pixel from memory, 8 to the cache on the way in, 8 and 4 on the way out; two or three instructions a vector.

use super::{Body, Isa, dispatch};

/// A row of the image on its way into a tile.
pub struct Gather<'a> {
    /// The image.
    pub pixels: &'a [f32],
    /// Taken off the pixels.
    pub middle: f32,
    /// Becomes the pixels less `middle`.
    pub values: &'a mut [f32],
}

/// Brings a row of pixels into a tile.
pub fn gather(isa: Isa, row: Gather<'_>) {
    dispatch(isa, row);
}

impl Body for Gather<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for (value, &pixel) in self.values.iter_mut().zip(self.pixels) {
            *value = pixel - self.middle;
        }
    }
}

/// Which pixels of a row are free: 1 where neither `measured` nor `held`, 0 elsewhere.
pub fn free(isa: Isa, measured: &[bool], held: Option<&[bool]>, free: &mut [f32]) {
    dispatch(isa, Flags { measured, held: held.unwrap_or(measured), free });
}

struct Flags<'a> {
    measured: &'a [bool],
    held: &'a [bool],
    free: &'a mut [f32],
}

impl Body for Flags<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for ((free, &measured), &held) in self.free.iter_mut().zip(self.measured).zip(self.held) {
            *free = f32::from(u8::from(!(measured | held)));
        }
    }
}

/// A row of a tile on its way back into the image.
pub struct Scatter<'a> {
    /// The tile.
    pub values: &'a [f32],
    /// Zero where pixels stay as they are.
    pub free: &'a [f32],
    /// Added to the values.
    pub middle: f32,
    /// The image.
    pub pixels: &'a mut [f32],
}

/// Brings the free pixels of a row back.
pub fn scatter(isa: Isa, row: Scatter<'_>) {
    dispatch(isa, row);
}

impl Body for Scatter<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let middle = self.middle;
        for ((pixel, &value), &free) in self.pixels.iter_mut().zip(self.values).zip(self.free) {
            // By bits: a choice would become a branch.
            let keep = u32::from(free == 0.0).wrapping_neg();
            *pixel = f32::from_bits(pixel.to_bits() & keep | (value + middle).to_bits() & !keep);
        }
    }
}
