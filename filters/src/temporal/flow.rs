//! Motion between two images, estimated: where each pixel of one lies in the other.
//!
//! For images `a` and `b`, both complete, the displacement `d` of each pixel of `a` makes
//!
//! ```text
//! sum over p and planes of  g(q - p) (b(p + d(q)) - a(p))^2
//! ```
//!
//! small around every `q`, `g` a Gaussian of `WINDOW` pixels.
//!
//! Algorithm: Gauss and Newton's steps of the windowed squares from coarse to fine: each level halves the resolution, begins with the displacements of the
//! coarser one, takes `FINEST` steps of at most a pixel (twice as many on every coarser level, `MOST` on the coarsest) and smooths the field. What has
//! no gradient keeps the displacement that it came with.
//!
//! Boundary: pixels beyond the image are the outermost ones. The same bits for any number of threads.
//!
//! Cost: about 2 times (planes + 8) blurs. Fails: at occlusions and thin parts that move otherwise than what is behind them; motion of more than a few
//! pixels at the coarsest level.
//!
//! Source: B. Lucas, T. Kanade, "An iterative image registration technique with an application to stereo vision", IJCAI 1981; J.-Y. Bouguet,
//! "Pyramidal implementation of the Lucas Kanade feature tracker", 2000.

use lacuna_core::parallel::prelude::*;

use super::{Taps, usual};
use crate::kernel::blur::blur;
use crate::{Error, Plane, Planes, Size};

/// Standard deviation of the window, in pixels.
const WINDOW: f64 = 2.5;
/// Steps on the finest level, where more follow what fills err by: each of 8, 4, 3, 2 and 1 was better than the one before on four turntables.
const FINEST: usize = 1;
/// Steps on the coarsest level, and on any at most; each has twice as many as the next finer one.
const MOST: usize = 8;
/// Standard deviation of the blur of the field after each step, in pixels.
const SMOOTH: f64 = 3.5;
/// Images with a shorter side are not halved.
const SMALL: usize = 24;
/// Powers of two between which the largest value of images needs no other unit.
const USUAL: i32 = 20;
/// What is added to the squared gradients, over the mean of all.
const RIDGE: f64 = 0.01;

/// Of each pixel of `a`, row by row: row and column in `b`.
///
/// # Errors
/// [`Error::SizeMismatch`] where the images differ in size or number of planes.
pub fn estimate(a: &Planes, b: &Planes) -> Result<Vec<[f32; 2]>, Error> {
    check(a, b)?;
    let [a, b] = comparable(a, b);
    Ok(places(a.size(), &displacements(&a, &b, FINEST)))
}

/// The same from places in an image that is much like `b`.
///
/// # Errors
/// As [`estimate`], and for other numbers of places than of pixels.
pub fn refined(a: &Planes, b: &Planes, places_before: &[[f32; 2]]) -> Result<Vec<[f32; 2]>, Error> {
    check(a, b)?;
    let size = a.size();
    if places_before.len() != size.pixels() {
        let found = format!("{} places", places_before.len());
        return Err(Error::SizeMismatch { expected: size, found });
    }
    let shift = |(at, [row, column]): (usize, &[f32; 2])| {
        [row - (at / size.width) as f32, column - (at % size.width) as f32]
    };
    let mut field: Vec<[f32; 2]> = places_before.iter().enumerate().map(shift).collect();
    let [a, b] = comparable(a, b);
    steps(&a, &b, FINEST, &mut field);
    Ok(places(size, &field))
}

/// Images without outliers, in a unit in which squares of gradients are numbers that f32 has.
fn comparable(a: &Planes, b: &Planes) -> [Planes; 2] {
    let [mut a, mut b] = [a, b].map(usual::clamped);
    let values = || a.as_slice().iter().chain(b.as_slice()).flat_map(Plane::pixels);
    let exponent =
        (values().fold(0.0, |largest: f32, value| largest.max(value.abs())).to_bits() >> 23) as i32 - 127;
    if exponent.abs() > USUAL {
        let factor = f32::from_bits(((127 - exponent.clamp(-126, 126)) as u32) << 23);
        let planes = a.as_mut_slice().iter_mut().chain(b.as_mut_slice());
        planes.flat_map(Plane::pixels_mut).for_each(|value| *value *= factor);
    }
    [a, b]
}

/// Both have the same planes.
fn check(a: &Planes, b: &Planes) -> Result<(), Error> {
    if a.size() != b.size() {
        return Err(Error::size(a.size(), "another image", b.size()));
    }
    if a.len() != b.len() {
        let found = format!("{} planes where {} were expected", b.len(), a.len());
        return Err(Error::SizeMismatch { expected: a.size(), found });
    }
    Ok(())
}

fn places(size: Size, field: &[[f32; 2]]) -> Vec<[f32; 2]> {
    let place =
        |(at, d): (usize, &[f32; 2])| [(at / size.width) as f32 + d[0], (at % size.width) as f32 + d[1]];
    field.iter().enumerate().map(place).collect()
}

fn displacements(a: &Planes, b: &Planes, count: usize) -> Vec<[f32; 2]> {
    let size = a.size();
    if size.height.min(size.width) < 2 * SMALL {
        let mut field = vec![[0.0; 2]; size.pixels()];
        steps(a, b, MOST, &mut field);
        return field;
    }
    let coarse = displacements(&halved(a), &halved(b), MOST.min(2 * count));
    let mut field = doubled(size, &coarse);
    steps(a, b, count, &mut field);
    field
}

fn steps(a: &Planes, b: &Planes, count: usize, field: &mut [[f32; 2]]) {
    if a.is_empty() || field.is_empty() {
        return;
    }
    // A Gaussian that is cut at the border has less than 1.
    let ones = blur(a.size(), &vec![1.0; a.size().pixels()], SMOOTH);
    for _ in 0..count {
        step(a, b, &ones, field);
    }
}

fn half(size: Size) -> Size {
    Size::new(size.height.div_ceil(2), size.width.div_ceil(2))
}

/// Means of two by two pixels.
fn halved(planes: &Planes) -> Planes {
    let size = half(planes.size());
    let last = Size::new(planes.size().height - 1, planes.size().width - 1);
    let one = |plane: &Plane| {
        let [values] = by_pixel(size, |y, x| {
            let (top, left) = (2 * y, 2 * x);
            let (bottom, right) = ((top + 1).min(last.height), (left + 1).min(last.width));
            let four =
                plane.at(top, left) + plane.at(top, right) + plane.at(bottom, left) + plane.at(bottom, right);
            [0.25 * four]
        });
        Plane::of(size, values)
    };
    Planes::of(size, planes.as_slice().iter().map(one).collect())
}

/// The field of a coarser level on a finer one, twice as long.
fn doubled(size: Size, coarse: &[[f32; 2]]) -> Vec<[f32; 2]> {
    let small = half(size);
    let axis = |axis: usize| Plane::of(small, coarse.iter().map(|d| 2.0 * d[axis]).collect());
    let planes = [axis(0), axis(1)];
    let at = |pixel: usize| {
        let place = |at: usize| (at as f32 - 0.5) / 2.0;
        let taps = Taps::new(small, place(pixel / size.width), place(pixel % size.width));
        [taps.of(&planes[0]), taps.of(&planes[1])]
    };
    (0..size.pixels()).into_par_iter().with_min_len(4096).map(at)
}

/// One step of all displacements.
fn step(a: &Planes, b: &Planes, ones: &[f32], field: &mut [[f32; 2]]) {
    let size = a.size();
    let count = b.len();
    // What lies at the displaced places of `b`, plane by plane of each pixel.
    let mut there = vec![0.0_f32; size.pixels() * count];
    there.par_chunks_mut(size.width * count).enumerate().for_each(|(row, there)| {
        for (column, values) in there.chunks_mut(count).enumerate() {
            let d = field[row * size.width + column];
            let taps = Taps::new(size, row as f32 + d[0], column as f32 + d[1]);
            values.iter_mut().zip(b.as_slice()).for_each(|(value, plane)| *value = taps.of(plane));
        }
    });
    // Of each pixel: the products yy, yx, xx of the gradient, and what the gradient says of the difference.
    let terms = |row: usize, column: usize| {
        let at = row * size.width + column;
        let (up, down) = (row.saturating_sub(1), (row + 1).min(size.height - 1));
        let (left, right) = (column.saturating_sub(1), (column + 1).min(size.width - 1));
        let slope = |high: (usize, usize), low: (usize, usize), plane: usize| {
            let value = |(row, column): (usize, usize)| there[(row * size.width + column) * count + plane];
            let apart = (high.0 - low.0 + high.1 - low.1).max(1);
            f64::from(value(high) - value(low)) / apart as f64
        };
        let mut sums = [0.0_f64; 5];
        for (plane, a) in a.as_slice().iter().enumerate() {
            let off = f64::from(a.at(row, column) - there[at * count + plane]);
            let gradient =
                [slope((down, column), (up, column), plane), slope((row, right), (row, left), plane)];
            sums[0] += gradient[0] * gradient[0];
            sums[1] += gradient[0] * gradient[1];
            sums[2] += gradient[1] * gradient[1];
            sums[3] += gradient[0] * off;
            sums[4] += gradient[1] * off;
        }
        sums.map(|sum| sum as f32)
    };
    let sums = by_pixel(size, terms);
    let squares = sums[0].iter().zip(&sums[2]).map(|(yy, xx)| f64::from(yy + xx)).sum::<f64>();
    let ridge = (RIDGE * squares / size.pixels() as f64).max(f64::MIN_POSITIVE);
    let sums = sums.map(|sums| blur(size, &sums, WINDOW));
    let moved = |row: usize, column: usize| {
        let at = row * size.width + column;
        let [yy, yx, xx, y, x] = std::array::from_fn(|k| f64::from(sums[k][at]));
        let (yy, xx) = (yy + ridge, xx + ridge);
        let determinant = yy * xx - yx * yx;
        // Without a gradient anywhere, nothing says that it moves.
        if determinant <= 0.0 {
            return field[at];
        }
        let step = [(y * xx - x * yx) / determinant, (x * yy - y * yx) / determinant];
        std::array::from_fn(|axis| (f64::from(field[at][axis]) + step[axis].clamp(-1.0, 1.0)) as f32)
    };
    let next: [Vec<f32>; 2] = by_pixel(size, moved);
    let [rows, columns] = next.map(|shift| blur(size, &shift, SMOOTH));
    field
        .par_iter_mut()
        .zip(rows.par_iter().zip(&columns).zip(ones))
        .with_min_len(4096)
        .for_each(|(shift, ((row, column), ones))| *shift = [row / ones, column / ones]);
}

/// So many values of each pixel, each kind an image of its own.
fn by_pixel<const N: usize>(size: Size, values: impl Fn(usize, usize) -> [f32; N] + Sync) -> [Vec<f32>; N] {
    let mut all: [Vec<f32>; N] = std::array::from_fn(|_| vec![0.0; size.pixels()]);
    let mut planes = all.each_mut().map(|plane| plane.chunks_mut(size.width));
    let rows = (0..size.height).map(|_| planes.each_mut().map(|rows| rows.next().unwrap_or_default()));
    let mut rows: Vec<[&mut [f32]; N]> = rows.collect();
    rows.par_iter_mut().with_min_len(8).enumerate().for_each(|(row, own)| {
        for column in 0..size.width {
            let all = own.iter_mut().zip(values(row, column));
            all.for_each(|(own, value)| own[column] = value);
        }
    });
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pattern_that_moves_is_followed_to_a_part_of_a_pixel() {
        let size = Size::new(90, 110);
        let scene = |y: f32, x: f32| (y / 5.0).sin() * (x / 6.0).cos() + 0.5 * ((x + 0.7 * y) / 9.0).sin();
        let image = |dy: f32, dx: f32| {
            let plane = Plane::from_fn(size, |y, x| scene(y as f32 - dy, x as f32 - dx));
            Planes::new(size, vec![plane]).unwrap()
        };
        for (dy, dx) in [(0.0, 0.0), (0.4, -0.3), (3.25, 5.5), (-4.0, 2.0)] {
            let places = estimate(&image(0.0, 0.0), &image(dy, dx)).unwrap();
            for y in (32..60).step_by(7) {
                for x in (32..80).step_by(7) {
                    let [row, column] = places[y * size.width + x];
                    let off = (row - y as f32 - dy).hypot(column - x as f32 - dx);
                    assert!(off < 0.15, "{dy} {dx} at {y} {x}: {off}");
                }
            }
        }
    }

    #[test]
    fn what_has_no_gradient_stays_and_any_unit_will_do() {
        let size = Size::new(60, 70);
        let image = |moved: f32, unit: f32| {
            let value = |y: usize, x: usize| unit * (y as f32 / 5.0).sin() * ((x as f32 - moved) / 6.0).cos();
            Planes::new(size, vec![Plane::from_fn(size, value)]).unwrap()
        };
        let usual = estimate(&image(0.0, 1.0), &image(1.5, 1.0)).unwrap();
        for unit in [-100, -40, 40, 100].map(|power| 2.0_f32.powi(power)) {
            assert_eq!(estimate(&image(0.0, unit), &image(1.5, unit)).unwrap(), usual, "{unit}");
        }
        let still: Vec<[f32; 2]> =
            (0..size.pixels()).map(|at| [(at / 70) as f32, (at % 70) as f32]).collect();
        for value in [0.0, 0.18, 1e-38, 1e38] {
            let flat = Planes::new(size, vec![Plane::filled(size, value)]).unwrap();
            assert_eq!(estimate(&flat, &flat).unwrap(), still, "{value}");
        }
    }

    #[test]
    fn images_that_do_not_belong_together_are_refused() {
        let size = Size::new(60, 50);
        let image = Planes::zeros(size, 1);
        for other in [Planes::zeros(Size::new(50, 60), 1), Planes::zeros(size, 2)] {
            let refused = |found| assert!(matches!(found, Err(Error::SizeMismatch { .. })));
            refused(estimate(&image, &other));
            refused(refined(&image, &other, &vec![[0.0; 2]; size.pixels()]));
            refused(refined(&image, &image, &[[0.0; 2]]));
        }
        for (size, planes) in [(size, 0), (Size::new(0, 0), 1), (Size::new(1, 1), 1)] {
            let image = Planes::zeros(size, planes);
            assert_eq!(estimate(&image, &image).unwrap().len(), size.pixels());
        }
    }
}
