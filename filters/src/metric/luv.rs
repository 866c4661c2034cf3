//! The distance of colours in CIELUV: a difference of about 1 is just visible.
//!
//! `L* = 116 (Y/Yn)^(1/3) - 16` (linear below `(6/29)^3`), `u* = 13 L* (u' - u'n)`, `v* = 13 L* (v' - v'n)` with
//! `u' = 4 X / (X + 15 Y + 3 Z)`, `v' = 9 Y / (X + 15 Y + 3 Z)`; the error of a pixel is the Euclidean distance.
//! Linear RGB over the peak is clipped to 0 to 1 first: the space is one of displays.
//!
//! Source: CIE 15:2018, "Colorimetry", section 8.2.2; used for error images as in the thesis that lacuna follows,
//! "Compressive Volume Rendering", section 4.2 (error range 0 to 20 as grey).

use lacuna_core::parallel::prelude::*;

use super::colour::{Chromaticities, Matrix, apply};
use super::same_size;
use crate::{Error, Plane};

/// The distance of each pixel, from three planes of linear red, green and blue each; `peak` is white.
///
/// # Errors
/// [`Error::SizeMismatch`]; [`Error::Setting`] for primaries that lie on a line.
pub fn difference(
    reference: [&Plane; 3],
    test: [&Plane; 3],
    chromaticities: &Chromaticities,
    peak: f32,
) -> Result<Plane, Error> {
    let size = reference[0].size();
    same_size(size, &reference)?;
    same_size(size, &test)?;
    let matrix = chromaticities.to_xyz().ok_or_else(|| Error::Setting {
        name: "chromaticities",
        value: format!("{chromaticities:?}"),
        range: "three primaries that are not on a line".into(),
    })?;
    let white = chromaticities.white_xyz();
    let mut map = Plane::filled(size, 0.0);
    map.pixels_mut().par_chunks_mut(size.width.max(1)).enumerate().for_each(|(y, out)| {
        for (x, out) in out.iter_mut().enumerate() {
            let [a, b] = [reference, test].map(|rgb| {
                to_luv(rgb.map(|plane| f64::from(plane.at(y, x) / peak).clamp(0.0, 1.0)), &matrix, white)
            });
            let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
            *out = squares.sqrt() as f32;
        }
    });
    Ok(map)
}

/// `L*`, `u*`, `v*` of linear RGB.
fn to_luv(rgb: [f64; 3], matrix: &Matrix, white: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = apply(matrix, rgb);
    let lightness =
        if y > (6.0_f64 / 29.0).powi(3) { 116.0 * y.cbrt() - 16.0 } else { (29.0_f64 / 3.0).powi(3) * y };
    let chroma = |[x, y, z]: [f64; 3]| {
        let sum = x + 15.0 * y + 3.0 * z;
        // Black has no chromaticity; its lightness of 0 makes any finite one right.
        if sum > 0.0 { [4.0 * x / sum, 9.0 * y / sum] } else { [0.0, 0.0] }
    };
    let ([u, v], [u_white, v_white]) = (chroma([x, y, z]), chroma(white));
    [lightness, 13.0 * lightness * (u - u_white), 13.0 * lightness * (v - v_white)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Size;

    fn of(rgb: [f64; 3]) -> [f64; 3] {
        let chromaticities = Chromaticities::default();
        to_luv(rgb, &chromaticities.to_xyz().unwrap(), chromaticities.white_xyz())
    }

    #[test]
    fn white_grey_black_and_red_are_where_they_belong() {
        let near = |a: [f64; 3], b: [f64; 3], by: f64| a.iter().zip(b).all(|(a, b)| (a - b).abs() < by);
        assert!(near(of([1.0; 3]), [100.0, 0.0, 0.0], 1e-10));
        assert!(near(of([0.0; 3]), [0.0; 3], 1e-12));
        assert!(near(of([0.184_187; 3]), [50.0, 0.0, 0.0], 1e-3));
        // Linear sRGB red in CIELUV under D65.
        assert!(near(of([1.0, 0.0, 0.0]), [53.24, 175.01, 37.75], 0.05));
    }

    #[test]
    fn equal_images_differ_by_nothing_and_others_symmetrically() {
        let plane = |k: usize| Plane::from_fn(Size::new(3, 5), |y, x| ((y * 5 + x + k) % 7) as f32 / 6.0);
        let (a, b) = ([plane(0), plane(1), plane(2)], [plane(3), plane(4), plane(5)]);
        let refs = |planes: &[Plane; 3]| -> [Plane; 3] { planes.clone() };
        let (a, b) = (refs(&a), refs(&b));
        let with_peak = |a: &[Plane; 3], b: &[Plane; 3], peak: f32| {
            difference([&a[0], &a[1], &a[2]], [&b[0], &b[1], &b[2]], &Chromaticities::default(), peak)
                .unwrap()
        };
        let difference = |a: &[Plane; 3], b: &[Plane; 3]| with_peak(a, b, 1.0);
        assert!(difference(&a, &a).pixels().iter().all(|&value| value == 0.0));
        assert_eq!(difference(&a, &b), difference(&b, &a));
        assert!(difference(&a, &b).pixels().iter().any(|&value| value > 1.0));
        let bright = |planes: &[Plane; 3]| {
            planes.clone().map(|plane| Plane::from_fn(plane.size(), |y, x| 64.0 * plane.at(y, x)))
        };
        assert_eq!(with_peak(&bright(&a), &bright(&b), 64.0), difference(&a, &b));
    }
}
