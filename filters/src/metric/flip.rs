//! FLIP: the difference that a viewer sees when two images alternate on a display.
//!
//! Per pixel, 0 to 1: `dE_c^(1 - dE_f)`, where `dE_c` is the distance of colours after the eye's contrast sensitivity
//! has blurred both (at `ppd` pixels per degree), measured by `HyAB` on Hunt-adjusted CIELAB and remapped to 0 to 1, and
//! `dE_f` is how far edges and points of lightness differ. HDR-FLIP shows both images at a series of exposures through a
//! tone curve, and takes the largest difference of each pixel.
//!
//! Input: linear RGB with the primaries of sRGB. The border repeats. Cost: about 150 taps a pixel and image; for HDR
//! that at each exposure.
//!
//! Sources: P. Andersson, J. Nilsson, T. Akenine-Moller, M. Oskarsson, K. Astrom, M. D. Fairchild, "FLIP: A Difference
//! Evaluator for Alternating Images", HPG 2020; P. Andersson, J. Nilsson, P. Shirley, T. Akenine-Moller, "Visualizing
//! Errors in Rendered High Dynamic Range Images", Eurographics Short Papers 2021 (exposures).

use lacuna_core::parallel::prelude::*;

use super::colour::{Chromaticities, Matrix, apply, inverse};
use super::same_size;
use crate::kernel::fir::{horizontal, separable, vertical};
use crate::{Error, Plane, Size, check};

/// Pixels per degree of a 0.7 m wide display with 3840 pixels seen from 0.7 m, as in the paper.
pub const PIXELS_PER_DEGREE: f64 = 67.020_643_276_582_26;

/// Pixels per degree with which the detectors have taps, and not more than an image.
const SEEN: std::ops::RangeInclusive<f64> = 1.0..=1e4;

/// Exponent that compresses large colour differences (section 4.1).
const COLOUR_EXPONENT: f32 = 0.7;
/// The fraction of the largest colour distance at which the remapping bends, and the value there.
const BEND: (f32, f32) = (0.4, 0.95);
/// Exponent of the feature difference (section 4.2).
const FEATURE_EXPONENT: f32 = 0.5;
/// Width of the feature detectors in degrees.
const FEATURE_WIDTH: f64 = 0.082;

/// Three planes: red, green, blue.
pub type Rgb<'a> = [&'a Plane; 3];

/// The difference of two images made for a display that shows `peak` as white: linear values, clipped to 0 to `peak`.
///
/// # Errors
/// [`Error::SizeMismatch`] and, for a peak that is not above 0 and finite, or pixels per degree that are not 1 to 10000, [`Error::Setting`].
pub fn display(reference: Rgb<'_>, test: Rgb<'_>, pixels_per_degree: f64, peak: f32) -> Result<Plane, Error> {
    check::positive("peak", f64::from(peak))?;
    let size = reference[0].size();
    same_size(size, &reference)?;
    same_size(size, &test)?;
    let eye = Eye::new(pixels_per_degree)?;
    let shown = |image: Rgb<'_>| image.map(|plane| per_pixel(plane, |value| (value / peak).clamp(0.0, 1.0)));
    Ok(eye.difference(&shown(reference), &shown(test)))
}

/// The difference of two HDR images: of each pixel the largest over `exposures` in stops; see [`exposures_of`].
///
/// # Errors
/// [`Error::SizeMismatch`] and, without exposures or for one that is not finite, or pixels per degree that are not 1 to 10000, [`Error::Setting`].
pub fn hdr(
    reference: Rgb<'_>,
    test: Rgb<'_>,
    pixels_per_degree: f64,
    exposures: &[f64],
) -> Result<Plane, Error> {
    let size = reference[0].size();
    same_size(size, &reference)?;
    same_size(size, &test)?;
    if exposures.is_empty() || !exposures.iter().all(|exposure| exposure.is_finite()) {
        let value = format!("{exposures:?}");
        return Err(Error::Setting { name: "exposures", value, range: "one or more, finite".into() });
    }
    let eye = Eye::new(pixels_per_degree)?;
    let mut largest = Plane::filled(size, 0.0);
    for exposure in exposures {
        let scale = exposure.exp2();
        let shown = |image: Rgb<'_>| image.map(|plane| per_pixel(plane, |value| shown_at(value, scale)));
        let map = eye.difference(&shown(reference), &shown(test));
        largest.pixels_mut().par_iter_mut().zip(map.pixels()).for_each(|(largest, &value)| {
            *largest = largest.max(value);
        });
    }
    Ok(largest)
}

/// Numerator and denominator of the tone curve as polynomials (K. Narkowicz, "ACES Filmic Tone Mapping Curve", 2015,
/// with the exposure of 0.6 that the paper uses).
const TONE: [[f64; 3]; 2] = [[0.0, 0.03 * 0.6, 2.51 * 0.36], [0.14, 0.59 * 0.6, 2.43 * 0.36]];

/// The tone curve, 0 at 0, towards 1.03.
fn tone(x: f32) -> f32 {
    let [top, bottom] = TONE.map(|[a, b, c]| (c as f32 * x + b as f32) * x + a as f32);
    top / bottom
}

/// Magnitudes beyond which the tone curve is above 1 on either side: there the squares of its quotient would only overflow.
const WHITE: f64 = 1e3;

/// A value as a display shows it at an exposure: 0 to 1.
fn shown_at(value: f32, scale: f64) -> f32 {
    tone((f64::from(value) * scale).clamp(-WHITE, WHITE) as f32).clamp(0.0, 1.0)
}

/// The exposures at which a reference is looked at: from its brightest luminance just below white to its median
/// (of what is not black) there (the short paper, section 3; its median counts black as well,
/// and so sends a frame with a black background through twenty stops in which nothing is left to see).
pub fn exposures_of(reference: Rgb<'_>) -> Vec<f64> {
    let mut luminance: Vec<f32> = (0..reference[0].size().pixels())
        .map(|i| {
            let [r, g, b] = reference.map(|plane| f64::from(plane.pixels()[i]));
            (0.2126 * r + 0.7152 * g + 0.0722 * b) as f32
        })
        .filter(|value| value.is_finite() && *value > 0.0)
        .collect();
    if luminance.is_empty() {
        return exposures_between(1.0, 1.0);
    }
    let middle = luminance.len() / 2;
    let (_, median, above) = luminance.select_nth_unstable_by(middle, f32::total_cmp);
    let brightest = above.iter().copied().fold(*median, f32::max);
    exposures_between(f64::from(*median), f64::from(brightest))
}

/// The exposures that bring luminances from `bright` to `dark` (both above 0) just below white: as many as there are
/// stops between them, at least two, in even steps.
pub fn exposures_between(dark: f64, bright: f64) -> Vec<f64> {
    // The x at which the tone curve reaches 0.85.
    let [a, b, c] = [0, 1, 2].map(|k| TONE[0][k] - 0.85 * TONE[1][k]);
    let white = (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * c);
    let (first, last) = ((white / bright).log2(), (white / dark).log2());
    let count = (last - first).ceil().max(2.0);
    (0..count as usize).map(|i| first + (last - first) * i as f64 / (count - 1.0)).collect()
}

/// A 3x3 matrix for the loops over pixels.
type Matrix32 = [[f32; 3]; 3];

/// The filters of one viewing condition.
struct Eye {
    /// Linear RGB to XYZ relative to white, and back.
    to_white: Matrix32,
    from_white: Matrix32,
    /// Contrast sensitivity of lightness, red-green and blue-yellow: sums of weighted separable Gaussians.
    sensitivity: [Vec<(f32, Vec<f32>)>; 3],
    /// Gaussian, its first and its second derivative.
    feature: [Vec<f32>; 3],
}

impl Eye {
    fn new(pixels_per_degree: f64) -> Result<Self, Error> {
        if !SEEN.contains(&pixels_per_degree) {
            return Err(Error::setting("pixels per degree", &pixels_per_degree, "1 to 10000"));
        }
        let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let to_xyz = Chromaticities::default().to_xyz().unwrap_or(identity);
        let white = apply(&to_xyz, [1.0; 3]);
        let relative: Matrix = [0, 1, 2].map(|k| to_xyz[k].map(|value| value / white[k]));
        let narrow = |matrix: Matrix| matrix.map(|row| row.map(|value| value as f32));
        Ok(Self {
            to_white: narrow(relative),
            from_white: narrow(inverse(&relative).unwrap_or(identity)),
            sensitivity: sensitivity(pixels_per_degree),
            feature: feature(pixels_per_degree),
        })
    }

    /// The map of two images of linear RGB in 0 to 1.
    fn difference(&self, reference: &[Plane; 3], test: &[Plane; 3]) -> Plane {
        let [reference, test] = [reference, test].map(|image| opponent(image, &self.to_white));
        let mut map = self.features(&reference[0], &test[0]);
        let [reference, test] = [reference, test].map(|image| self.seen(&image));
        let largest = self.largest_distance();
        map.pixels_mut().par_iter_mut().enumerate().for_each(|(i, out)| {
            let at = |lab: &[Plane; 3]| [0, 1, 2].map(|k| lab[k].pixels()[i]);
            let colour = remap(hyab(at(&reference), at(&test)).powf(COLOUR_EXPONENT), largest);
            *out = colour.powf(1.0 - *out);
        });
        map
    }

    /// Blurred as the eye does, clipped to what a display shows, in Hunt-adjusted CIELAB.
    fn seen(&self, opponent: &[Plane; 3]) -> [Plane; 3] {
        let blurred = [0, 1, 2].map(|channel| {
            let mut sum = Plane::filled(opponent[channel].size(), 0.0);
            for (weight, taps) in &self.sensitivity[channel] {
                let part = separable(&opponent[channel], taps, taps);
                sum.pixels_mut()
                    .par_iter_mut()
                    .zip(part.pixels())
                    .for_each(|(sum, value)| *sum += weight * value);
            }
            sum
        });
        map3(&blurred, |[y, cx, cz]| {
            let lightness = (y + 16.0) / 116.0;
            let xyz = [cx / 500.0 + lightness, lightness, lightness - cz / 200.0];
            lab(times(&self.from_white, xyz).map(|value| value.clamp(0.0, 1.0)), &self.to_white)
        })
    }

    /// The largest distance that occurs: green against blue.
    fn largest_distance(&self) -> f32 {
        hyab(lab([0.0, 1.0, 0.0], &self.to_white), lab([0.0, 0.0, 1.0], &self.to_white)).powf(COLOUR_EXPONENT)
    }

    /// `dE_f`: how far edges and points differ, from the lightness of both.
    fn features(&self, reference: &Plane, test: &Plane) -> Plane {
        let [smooth, edge, point] = &self.feature;
        let detect = |lightness: &Plane| {
            let lightness = per_pixel(lightness, |y| (y + 16.0) / 116.0);
            let smoothed = horizontal(&lightness, smooth);
            [edge, point].map(|taps| {
                let mut lengths = vertical(&horizontal(&lightness, taps), smooth);
                let along_y = vertical(&smoothed, taps);
                lengths
                    .pixels_mut()
                    .par_iter_mut()
                    .zip(along_y.pixels())
                    .for_each(|(dx, dy)| *dx = length(*dx, *dy));
                lengths
            })
        };
        let ([edges, points], [test_edges, test_points]) = (detect(reference), detect(test));
        let mut map = Plane::filled(reference.size(), 0.0);
        map.pixels_mut().par_iter_mut().enumerate().for_each(|(i, out)| {
            let difference = |a: &Plane, b: &Plane| (a.pixels()[i] - b.pixels()[i]).abs();
            let largest = difference(&edges, &test_edges).max(difference(&points, &test_points));
            *out = (largest * std::f32::consts::FRAC_1_SQRT_2).powf(FEATURE_EXPONENT);
        });
        map
    }
}

/// `YCxCz`, the opponent space in which the eye's sensitivity is defined, of linear RGB.
fn opponent(rgb: &[Plane; 3], to_white: &Matrix32) -> [Plane; 3] {
    map3(rgb, |rgb| {
        let [x, y, z] = times(to_white, rgb);
        [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
    })
}

/// Hunt-adjusted CIELAB of linear RGB.
fn lab(rgb: [f32; 3], to_white: &Matrix32) -> [f32; 3] {
    const DELTA: f32 = 6.0 / 29.0;
    let root =
        |t: f32| if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 };
    let [x, y, z] = times(to_white, rgb).map(root);
    let lightness = 116.0 * y - 16.0;
    [lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)]
}

/// Matrix times vector.
fn times(matrix: &Matrix32, v: [f32; 3]) -> [f32; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// The contrast sensitivity functions of section 4.1.1 as Gaussians `a sqrt(pi / b) exp(-pi^2 d^2 / b)`, `d` in degrees.
fn sensitivity(pixels_per_degree: f64) -> [Vec<(f32, Vec<f32>)>; 3] {
    const PARAMETERS: [&[(f64, f64)]; 3] =
        [&[(1.0, 0.0047)], &[(1.0, 0.0053)], &[(34.1, 0.04), (13.5, 0.025)]];
    let pi = std::f64::consts::PI;
    let widest = (0.04 / (2.0 * pi * pi)).sqrt();
    let radius = (3.0 * widest * pixels_per_degree).ceil() as usize;
    PARAMETERS.map(|parts| {
        let raw: Vec<(f64, Vec<f64>)> = parts
            .iter()
            .map(|&(a, b)| {
                let tap = |k: usize| {
                    let d = (k as f64 - radius as f64) / pixels_per_degree;
                    (-pi * pi * d * d / b).exp()
                };
                (a * (pi / b).sqrt(), (0..=2 * radius).map(tap).collect())
            })
            .collect();
        let total: f64 = raw.iter().map(|(weight, taps)| weight * taps.iter().sum::<f64>().powi(2)).sum();
        raw.into_iter().map(|(weight, taps)| ((weight / total) as f32, trimmed(&taps))).collect()
    })
}

/// The taps without those on both ends that cannot be seen in f32.
fn trimmed(taps: &[f64]) -> Vec<f32> {
    let sum: f64 = taps.iter().sum();
    let invisible = taps.iter().take_while(|&&tap| tap < 1e-9 * sum).count();
    taps[invisible..taps.len() - invisible].iter().map(|&tap| tap as f32).collect()
}

/// Gaussian, first and second derivative of section 4.2; of the derivatives the positive and the negative taps of the
/// two-dimensional filter each sum to 1.
fn feature(pixels_per_degree: f64) -> [Vec<f32>; 3] {
    let sigma = 0.5 * FEATURE_WIDTH * pixels_per_degree;
    let radius = (3.0 * sigma).ceil() as usize;
    let position = |k: usize| (k as f64 - radius as f64) / sigma;
    let gauss = |k: usize| (-0.5 * position(k).powi(2)).exp();
    let taps = |value: &dyn Fn(usize) -> f64| (0..=2 * radius).map(value).collect::<Vec<f64>>();
    let balanced = |taps: Vec<f64>| -> Vec<f32> {
        let sum = |sign: f64| taps.iter().map(|tap| (sign * tap).max(0.0)).sum::<f64>();
        let (positive, negative) = (sum(1.0), sum(-1.0));
        taps.iter().map(|tap| (tap / if *tap > 0.0 { positive } else { negative }) as f32).collect()
    };
    let smooth = taps(&gauss);
    let total: f64 = smooth.iter().sum();
    [
        smooth.into_iter().map(|tap| (tap / total) as f32).collect(),
        balanced(taps(&|k| -position(k) * gauss(k))),
        balanced(taps(&|k| (position(k).powi(2) - 1.0) * gauss(k))),
    ]
}

/// Distance of lightness plus distance of chroma.
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).abs() + length(a[1] - b[1], a[2] - b[2])
}

/// Length of a vector. The bits of the C library's `hypotf`, without a call for every pixel.
fn length(x: f32, y: f32) -> f32 {
    let square = |value: f32| f64::from(value) * f64::from(value);
    (square(x) + square(y)).sqrt() as f32
}

/// Colour distances to 0 to 1, most of the range for the small ones.
fn remap(distance: f32, largest: f32) -> f32 {
    let (fraction, value) = BEND;
    let bend = fraction * largest;
    let mapped = if distance < bend {
        value / bend * distance
    } else {
        value + (distance - bend) / (largest - bend) * (1.0 - value)
    };
    mapped.clamp(0.0, 1.0)
}

/// A plane with `f` applied to each value.
fn per_pixel(plane: &Plane, f: impl Fn(f32) -> f32 + Sync) -> Plane {
    let mut out = plane.clone();
    out.pixels_mut().par_iter_mut().for_each(|value| *value = f(*value));
    out
}

/// Three planes with `f` applied to each triple.
fn map3(planes: &[Plane; 3], f: impl Fn([f32; 3]) -> [f32; 3] + Sync) -> [Plane; 3] {
    let size: Size = planes[0].size();
    let mut out = [0, 1, 2].map(|_| Plane::filled(size, 0.0));
    let [a, b, c] = &mut out;
    (a.pixels_mut().par_iter_mut())
        .zip(b.pixels_mut().par_iter_mut().zip(c.pixels_mut()))
        .enumerate()
        .for_each(|(i, (a, (b, c)))| {
            [*a, *b, *c] = f([0, 1, 2].map(|k| planes[k].pixels()[i]));
        });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(height: usize, width: usize, k: usize) -> [Plane; 3] {
        [0, 1, 2].map(|c| {
            Plane::from_fn(Size::new(height, width), |y, x| {
                ((y * 31 + x * 17 + 7 * c + k * x) % 13) as f32 / 12.0
            })
        })
    }

    fn rgb(image: &[Plane; 3]) -> Rgb<'_> {
        [&image[0], &image[1], &image[2]]
    }

    #[test]
    fn equal_images_show_nothing_at_every_size() {
        for (height, width) in [(1, 1), (1, 5), (4, 1), (9, 30)] {
            let a = image(height, width, 0);
            let map = display(rgb(&a), rgb(&a), PIXELS_PER_DEGREE, 1.0).unwrap();
            assert!(map.pixels().iter().all(|&value| value == 0.0));
        }
    }

    #[test]
    fn the_difference_is_symmetric_and_within_0_and_1() {
        let (a, b) = (image(24, 31, 0), image(24, 31, 3));
        let map = display(rgb(&a), rgb(&b), PIXELS_PER_DEGREE, 1.0).unwrap();
        assert_eq!(map, display(rgb(&b), rgb(&a), PIXELS_PER_DEGREE, 1.0).unwrap());
        assert!(map.pixels().iter().all(|value| (0.0..=1.0).contains(value)));
        assert!(map.pixels().iter().any(|&value| value > 0.01));
    }

    #[test]
    fn green_against_blue_is_the_largest_colour_difference() {
        let flat = |rgb: [f32; 3]| rgb.map(|value| Plane::filled(Size::new(8, 8), value));
        let seen = |a: [f32; 3], b: [f32; 3], peak: f32| {
            display(rgb(&flat(a)), rgb(&flat(b)), PIXELS_PER_DEGREE, peak).unwrap()
        };
        let map = seen([0.0, 1.0, 0.0], [0.0, 0.0, 1.0], 1.0);
        assert!(map.pixels().iter().all(|&value| (value - 1.0).abs() < 1e-3));
        let grey = seen([0.5; 3], [0.52; 3], 1.0);
        assert_eq!(seen([32.0; 3], [33.28; 3], 64.0), grey, "in the unit of the peak");
        assert!(grey.pixels().iter().all(|&value| value > 0.0 && value < 0.2));
    }

    #[test]
    fn derivatives_are_balanced_and_blurs_keep_constants() {
        let [smooth, edge, point] = feature(PIXELS_PER_DEGREE);
        let near = |value: f32, expected: f32| (value - expected).abs() < 1e-5;
        assert!(
            near(smooth.iter().sum(), 1.0) && near(edge.iter().sum(), 0.0) && near(point.iter().sum(), 0.0)
        );
        for parts in sensitivity(PIXELS_PER_DEGREE) {
            let total: f32 =
                parts.iter().map(|(weight, taps)| weight * taps.iter().sum::<f32>().powi(2)).sum();
            assert!(near(total, 1.0), "{total}");
        }
    }

    #[test]
    fn exposures_span_the_luminances_in_even_steps() {
        let exposures = exposures_between(0.18, 2.0);
        assert_eq!(exposures.len(), 4);
        assert!((f64::from(tone((2.0 * exposures[0].exp2()) as f32)) - 0.85).abs() < 1e-6);
        assert!((f64::from(tone((0.18 * exposures[3].exp2()) as f32)) - 0.85).abs() < 1e-6);
        let steps: Vec<f64> = exposures.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(steps.iter().all(|step| (step - steps[0]).abs() < 1e-12));
        assert_eq!(exposures_between(1.0, 1.0).len(), 2);
    }

    #[test]
    fn what_shows_nothing_is_refused() {
        let [a, b] = [0.2, 0.8].map(|value| [0, 1, 2].map(|_| Plane::filled(Size::new(8, 8), value)));
        let name = |found: Result<Plane, Error>| match found {
            Err(Error::Setting { name, .. }) => name,
            _ => "none",
        };
        for peak in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert_eq!(name(display(rgb(&a), rgb(&b), PIXELS_PER_DEGREE, peak)), "peak", "{peak}");
        }
        for exposures in [&[][..], &[f64::NAN], &[0.0, f64::INFINITY]] {
            let found = hdr(rgb(&a), rgb(&b), PIXELS_PER_DEGREE, exposures);
            assert_eq!(name(found), "exposures", "{exposures:?}");
        }
        for ppd in [0.0, -5.0, 0.5, f64::NAN, f64::INFINITY, 1e300] {
            assert_eq!(name(display(rgb(&a), rgb(&b), ppd, 1.0)), "pixels per degree", "{ppd}");
            assert_eq!(name(hdr(rgb(&a), rgb(&b), ppd, &[0.0])), "pixels per degree", "{ppd}");
        }
        for ppd in [*SEEN.start(), 10.0] {
            let map = display(rgb(&a), rgb(&b), ppd, 1.0).unwrap();
            assert!(map.pixels().iter().all(|value| *value > 0.0), "{ppd}");
        }
    }

    #[test]
    fn no_finite_value_is_too_large_for_the_tone_curve() {
        let image = |value: f32| [0, 1, 2].map(|_| Plane::filled(Size::new(8, 8), value));
        let difference = |value: f32| {
            let exposures = exposures_between(0.1, 1.0);
            hdr(rgb(&image(0.1)), rgb(&image(value)), PIXELS_PER_DEGREE, &exposures).unwrap().pixels()[0]
        };
        let white = difference(1e4);
        assert!(white > 0.5, "{white}");
        for value in [1e18, 1e20, 1e25, f32::MAX, -1e4, -1e20, f32::MIN] {
            assert_eq!(difference(value), white, "{value}");
        }
        for stops in [-149.0, 149.0] {
            let shown = [0.0, 1e-45, f32::MAX].map(|value| shown_at(value, f64::exp2(stops)));
            assert!(shown.iter().all(|value| (0.0..=1.0).contains(value)), "{shown:?}");
        }
    }

    #[test]
    fn black_frames_have_exposures_too() {
        let black = [0, 1, 2].map(|_| Plane::filled(Size::new(2, 2), 0.0));
        let exposures = exposures_of(rgb(&black));
        assert!(exposures.iter().all(|value| value.is_finite()));
        let map = hdr(rgb(&black), rgb(&black), PIXELS_PER_DEGREE, &exposures).unwrap();
        assert!(map.pixels().iter().all(|&value| value == 0.0));
    }
}
