//! Depth: each missing pixel takes the depth of one measured neighbour, the one in the middle of those around it.
//!
//! A mean of foreground and background would be a surface that is not there, so that values are only ever copied.
//! For the missing pixel p let `q_1 .. q_4` be the nearest measured pixel in each of its four quadrants (each
//! holds its two half axes, so that neighbours on an axis belong to two), at distances `r_i`. Those with
//! `r_i > 3 min r` have no say. Of the rest, p copies the weighted median of the depths `z_i`, weights `1 / r_i`:
//! the smallest z whose weight together with that of all smaller ones reaches half of the total. On a tie that
//! is the nearer to the camera, where depth grows away from it. Each pixel that is found counts once.
//!
//! Why a median: inside a surface it is the middle of the neighbours, where the nearest alone would copy a slope in
//! blocks; at an edge it falls on one side or the other. Infinite depths are legal; they sort as background.
//!
//! Algorithm: each quadrant by one sweep in which a pixel asks its two neighbours on that side for the measured
//! pixel they found (P.-E. Danielsson, "Euclidean Distance Mapping", Computer Graphics and Image Processing 14, 1980,
//! restricted to one quadrant). As there, a pixel may find one that is not quite the nearest, by less than a pixel
//! on most masks; it always finds a measured one if its quadrant has any. Ties: the first one found, deterministic.
//! Cost: four sweeps, each serial, side by side on four threads; four planes of u32. Planned once for a mask.
//! Fails: an object that no measured pixel hit is not there; a thin one keeps only its measured pixels.

use lacuna_core::parallel::prelude::*;

use super::nearest::NearestMap;
use crate::{Error, Mask, Plane, Size};

/// The nearest measured pixel in each quadrant of every pixel: what the depth rule knows of a mask.
#[derive(Clone, Debug)]
pub struct DepthPlan {
    size: Size,
    quadrants: [Vec<u32>; 4],
}

/// In a quadrant's table: no measured pixel on that side.
const NONE: u32 = u32::MAX;

/// Neighbours farther than so many times the nearest one, squared, have no say.
const REACH_SQUARED: u64 = 9;

impl DepthPlan {
    /// Finds the neighbours.
    ///
    /// # Errors
    /// [`Error::EmptyMask`]; [`Error::TooLarge`] if the image has 2^32 pixels or more.
    pub fn new(mask: &Mask) -> Result<Self, Error> {
        let size = mask.size();
        mask.require_samples()?;
        if u32::try_from(size.pixels()).is_err() {
            return Err(Error::TooLarge { size });
        }
        let mut quadrants = [const { Vec::new() }; 4];
        quadrants.par_iter_mut().enumerate().for_each(|(which, found)| {
            *found = sweep(mask, which & 1 != 0, which & 2 != 0);
        });
        Ok(Self { size, quadrants })
    }

    /// For each pixel the measured pixel whose depth it takes; a measured pixel is its own.
    ///
    /// `depth` holds any values but NaN at measured pixels, infinities included; what it holds elsewhere is not used.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`].
    pub fn choose(&self, depth: &Plane) -> Result<NearestMap, Error> {
        let (size, depth) = (self.size, depth);
        if depth.size() != size {
            return Err(Error::size(size, "depth", depth.size()));
        }
        let mut source = vec![0; size.pixels()];
        source.par_chunks_mut(size.width).enumerate().for_each(|(y, row)| {
            for (x, source) in row.iter_mut().enumerate() {
                let at = y * size.width + x;
                let own = self.quadrants[0][at] as usize == at;
                *source = if own { at as u32 } else { self.median(depth.pixels(), y, x) };
            }
        });
        Ok(NearestMap::from_source(size, source))
    }

    /// The measured pixels that have a say in the value of one that is missing: at most four, by their indices.
    pub fn around(&self, at: usize) -> impl Iterator<Item = usize> {
        let (near, count) = self.near(at / self.size.width, at % self.size.width);
        let reach = reach(&near[..count]);
        near.into_iter().take(count).filter(move |near| near.0 <= reach).map(|near| near.1 as usize)
    }

    /// The neighbours of one missing pixel with their squared distances, and how many there are.
    fn near(&self, y: usize, x: usize) -> ([(u64, u32); 4], usize) {
        let at = y * self.size.width + x;
        let mut near = [(0, NONE); 4];
        let mut count = 0;
        for quadrant in &self.quadrants {
            let pixel = quadrant[at];
            if pixel != NONE && near[..count].iter().all(|other| other.1 != pixel) {
                near[count] = (distance_squared(pixel, y, x, self.size.width), pixel);
                count += 1;
            }
        }
        (near, count)
    }

    /// The weighted median of the neighbours of one missing pixel.
    fn median(&self, depth: &[f32], y: usize, x: usize) -> u32 {
        let (mut near, count) = self.near(y, x);
        let near = &mut near[..count];
        let reach = reach(near);
        near.sort_unstable_by(|a, b| depth[a.1 as usize].total_cmp(&depth[b.1 as usize]).then(a.cmp(b)));
        let weight = |r: u64| if r <= reach { 1.0 / (r as f64).sqrt() } else { 0.0 };
        let total: f64 = near.iter().map(|neighbour| weight(neighbour.0)).sum();
        let mut sum = 0.0;
        for &(r, pixel) in near.iter() {
            sum += weight(r);
            // Rounding must not turn a tie into the farther one.
            if sum >= total * (0.5 - 4.0 * f64::EPSILON) {
                return pixel;
            }
        }
        near.last().map_or(NONE, |neighbour| neighbour.1)
    }
}

/// The squared distance up to which neighbours have a say.
fn reach(near: &[(u64, u32)]) -> u64 {
    near.iter().map(|neighbour| neighbour.0).min().unwrap_or(0).saturating_mul(REACH_SQUARED)
}

/// Squared distance from row `y`, column `x` to the pixel with index `pixel`.
fn distance_squared(pixel: u32, y: usize, x: usize, width: usize) -> u64 {
    // Short divisions: an image has less than 2^32 pixels.
    let (row, column) = (pixel / width as u32, pixel % width as u32);
    u64::from(row.abs_diff(y as u32)).pow(2) + u64::from(column.abs_diff(x as u32)).pow(2)
}

/// For each pixel the measured pixel found in one quadrant: on or above it, or on or below it if `below`; on or left
/// of it, or on or right of it if `right`.
fn sweep(mask: &Mask, below: bool, right: bool) -> Vec<u32> {
    let Size { height, width } = mask.size();
    let mut found = vec![NONE; height * width];
    let mut before = vec![NONE; width];
    for step in 0..height {
        let y = if below { height - 1 - step } else { step };
        let flags = mask.row(y);
        let row = &mut found[y * width..][..width];
        let mut beside = NONE;
        for step in 0..width {
            let x = if right { width - 1 - step } else { step };
            beside = if flags[x] { (y * width + x) as u32 } else { closer(beside, before[x], y, x, width) };
            row[x] = beside;
        }
        before.copy_from_slice(row);
    }
    found
}

/// The closer to row `y`, column `x` of two pixels, `a` if they are equally close.
fn closer(a: u32, b: u32, y: usize, x: usize, width: usize) -> u32 {
    if a == b || b == NONE {
        a
    } else if a == NONE || distance_squared(b, y, x, width) < distance_squared(a, y, x, width) {
        b
    } else {
        a
    }
}

#[cfg(test)]
mod tests;
