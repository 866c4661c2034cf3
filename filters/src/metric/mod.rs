//! Measures of how far a test image is from its reference.
//!
//! [`error`]: squared, largest, relative and logarithmic errors, PSNR, counts of non-finite values.
//! [`ssim`]: structural similarity. [`luv`]: the distance of colours in CIELUV. [`flip`]: the difference that a viewer
//! sees when the images alternate, for displays and for HDR. [`colour`]: the conversions that they share.
//!
//! Every sum runs row by row in f64 and the rows are added in order: the same bits for every thread count. Where a
//! measure takes a `region`, it holds a flag per pixel, row by row; `None` is the whole image.

pub mod colour;
pub mod error;
pub mod flip;
pub mod luv;
pub mod ssim;

use lacuna_core::parallel::prelude::*;

use crate::{Error, Plane, Size};

/// The mean of a map over a region, `None` if the region is empty.
///
/// # Errors
/// [`Error::SizeMismatch`] for a region of another size.
pub fn mean(map: &Plane, region: Option<&[bool]>) -> Result<Option<f64>, Error> {
    Error::of_region(map.size(), region)?;
    let width = map.size().width.max(1);
    let rows: Vec<(f64, usize)> = map.pixels().par_chunks(width).enumerate().map(|(y, row)| match region {
        None => (row.iter().map(|&value| f64::from(value)).sum(), row.len()),
        Some(flags) => row
            .iter()
            .zip(&flags[y * width..])
            .filter(|&(_, &flag)| flag)
            .fold((0.0, 0), |(sum, count), (&value, _)| (sum + f64::from(value), count + 1)),
    });
    let (sum, count) = rows.iter().fold((0.0, 0), |(sum, count), row| (sum + row.0, count + row.1));
    Ok((count > 0).then(|| sum / count as f64))
}

/// Refuses images of different sizes.
fn same_size(expected: Size, planes: &[&Plane]) -> Result<(), Error> {
    match planes.iter().find(|plane| plane.size() != expected) {
        None => Ok(()),
        Some(other) => Err(Error::size(expected, "another image", other.size())),
    }
}
