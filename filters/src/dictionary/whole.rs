//! Images without a missing pixel as the codes of their blocks, and back.
//!
//! Blocks lie side by side (the last ones end with the image; what lies beyond one that is smaller than a block does not count). All share one Gram matrix; their products with the atoms are dense
//! products of many blocks at once.

use std::borrow::Cow;

use lacuna_core::parallel::prelude::*;
use ndarray::Array2;
use ndarray::linalg::general_mat_mul;

use super::Dictionary;
use super::blocks::{Average, Grid};
use super::pursuit::{Code, Scratch, Selection, Shared};
use crate::{Error, Mask, Planes, Size};

/// Blocks that are coded together; part of the method.
const TOGETHER: usize = 96;

/// Number of codes of an image: blocks times the groups of planes that an atom spans.
pub fn count(dictionary: &Dictionary, size: Size, planes: usize) -> usize {
    Grid::new(size, dictionary.block(), dictionary.block()).len() * planes.div_ceil(dictionary.channels())
}

/// The codes of the blocks of planes: group after group of as many planes as an atom spans, in each row by row.
///
/// # Errors
/// [`Error::SizeMismatch`] unless the planes are a multiple of the dictionary's channels.
pub fn codes(dictionary: &Dictionary, planes: &Planes, selection: &Selection) -> Result<Vec<Code>, Error> {
    check(dictionary, planes.size(), planes.len())?;
    let grid = Grid::new(planes.size(), dictionary.block(), dictionary.block());
    let (pixels, channels) = (dictionary.block() * dictionary.block(), dictionary.channels());
    let shared = Shared::new(&atoms_within(dictionary, &grid, planes.size()), 0.0);
    let all: Vec<usize> = (0..count(dictionary, planes.size(), planes.len())).collect();
    let parts = all.par_chunks(TOGETHER).map(|part| {
        let mut values = Array2::<f32>::zeros((part.len(), dictionary.dimension()));
        for (at, mut row) in part.iter().zip(values.rows_mut()) {
            let first = at / grid.len() * channels;
            let Some(row) = row.as_slice_mut() else { continue };
            for (plane, values) in planes.as_slice()[first..].iter().zip(row.chunks_exact_mut(pixels)) {
                grid.take(plane.pixels(), at % grid.len(), values);
            }
        }
        let mut products = Array2::<f32>::zeros((part.len(), dictionary.len()));
        general_mat_mul(1.0, &values, &dictionary.atoms().t(), 0.0, &mut products);
        let mut scratch = Scratch::default();
        let rows = values.rows().into_iter().zip(products.rows_mut());
        rows.map(|(values, mut products)| {
            let energy = values.iter().map(|x| f64::from(*x).powi(2)).sum();
            let products = products.as_slice_mut().unwrap_or_default();
            shared.code(products, energy, selection, &mut scratch)
        })
        .collect::<Vec<Code>>()
    });
    Ok(parts.concat())
}

/// The planes that codes stand for.
///
/// # Errors
/// [`Error::SizeMismatch`] unless there is a code for each block, of atoms that the dictionary has.
pub fn planes(dictionary: &Dictionary, size: Size, count: usize, codes: &[Code]) -> Result<Planes, Error> {
    check(dictionary, size, count)?;
    let known = |code: &Code| code.iter().all(|entry| (entry.0 as usize) < dictionary.len());
    if codes.len() != self::count(dictionary, size, count) || !codes.iter().all(known) {
        return Err(Error::SizeMismatch { expected: size, found: "codes of other blocks".into() });
    }
    let grid = Grid::new(size, dictionary.block(), dictionary.block());
    let pixels = dictionary.block() * dictionary.block();
    let mut out = Planes::zeros(size, count);
    let groups = out.as_mut_slice().par_chunks_mut(dictionary.channels()).zip(codes.par_chunks(grid.len()));
    groups.for_each(|(planes, codes)| {
        let mut averages = vec![Average::new(size); planes.len()];
        let mut values = vec![0.0; dictionary.dimension()];
        for (at, code) in codes.iter().enumerate() {
            dictionary.sum(code, &mut values);
            for (average, values) in averages.iter_mut().zip(values.chunks_exact(pixels)) {
                average.add(&grid, at, values);
            }
        }
        for (average, plane) in averages.iter().zip(planes) {
            // Every pixel lies in a block.
            average.write(plane);
        }
    });
    Ok(out)
}

/// The atoms, 0 beyond an image that is smaller than a block: nothing was measured there, of any block.
fn atoms_within<'a>(dictionary: &'a Dictionary, grid: &Grid, size: Size) -> Cow<'a, Array2<f32>> {
    if size.height.min(size.width) >= dictionary.block() {
        return Cow::Borrowed(dictionary.atoms());
    }
    let inside = grid.flags(&Mask::from_fn(size, |_, _| true), 0);
    let mut atoms = dictionary.atoms().clone();
    for mut atom in atoms.rows_mut() {
        atom.iter_mut()
            .zip(inside.iter().cycle())
            .filter(|(_, inside)| !**inside)
            .for_each(|(x, _)| *x = 0.0);
    }
    Cow::Owned(atoms)
}

fn check(dictionary: &Dictionary, size: Size, planes: usize) -> Result<(), Error> {
    if planes.is_multiple_of(dictionary.channels()) {
        return Ok(());
    }
    let found = format!("{planes} planes for a dictionary over {}", dictionary.channels());
    Err(Error::SizeMismatch { expected: size, found })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Plane;
    use crate::dictionary::pursuit::tests::random;

    #[test]
    fn with_enough_atoms_images_come_back() {
        for (channels, planes) in [(1, 3), (3, 3)] {
            let dictionary = random(4, channels, 100, 1);
            let size = Size::new(13, 22);
            let plane = |at: usize| Plane::from_fn(size, |y, x| ((y * 7 + x * 3 + at) % 11) as f32);
            let image = Planes::new(size, (0..planes).map(plane).collect()).unwrap();
            let codes = codes(&dictionary, &image, &Selection::atoms(16 * channels)).unwrap();
            assert_eq!(codes.len(), count(&dictionary, size, planes));
            let back = super::planes(&dictionary, size, planes, &codes).unwrap();
            for (back, plane) in back.as_slice().iter().zip(image.as_slice()) {
                for (back, value) in back.pixels().iter().zip(plane.pixels()) {
                    assert!((back - value).abs() < 0.02, "{back} {value}");
                }
            }
            assert!(super::planes(&dictionary, size, planes, &codes[1..]).is_err());
            let mut other = codes;
            other[0] = vec![(100, 1.0)];
            assert!(super::planes(&dictionary, size, planes, &other).is_err());
        }
        for size in [Size::new(3, 22), Size::new(13, 1), Size::new(1, 1)] {
            let dictionary = random(4, 1, 100, 1);
            let image =
                Planes::new(size, vec![Plane::from_fn(size, |y, x| 5.0 + ((y * 7 + x * 3) % 11) as f32)])
                    .unwrap();
            let codes = codes(&dictionary, &image, &Selection::atoms(16)).unwrap();
            let back = super::planes(&dictionary, size, 1, &codes).unwrap();
            let few =
                self::codes(&dictionary, &image, &Selection::atoms(size.height.min(4) * size.width.min(4)))
                    .unwrap();
            assert_eq!(few, codes, "no more atoms than there are pixels");
            for (back, value) in back.as_slice()[0].pixels().iter().zip(image.as_slice()[0].pixels()) {
                assert!((back - value).abs() < 0.02, "{size}: {back} {value}");
            }
        }
        let two = Planes::zeros(Size::new(4, 4), 2);
        assert!(super::codes(&random(4, 3, 50, 1), &two, &Selection::atoms(1)).is_err());
    }
}
