//! What a page shows of one frame: thumbnails for everyone, codes of every pixel for the viewer.

use std::collections::BTreeMap;

use lacuna_exr::Part;
use lacuna_filters::metric::colour::{Matrix, srgb_encode};
use lacuna_filters::metric::ssim::Similarity;
use lacuna_filters::{Mask, Plane, Size};
use serde::Serialize;

use super::codes::{BUDGET, Codes, base64, packed};
use crate::raster::{self, BitDepth, ColorType, Compression};
use crate::report::groups::Kind;
use crate::report::values::chromaticities;
use crate::report::{Images, Measure};

/// Maps of images with more pixels are shown at half the resolution.
const SMALL: usize = 1 << 18;
/// What a value that is not finite looks like, which no picture has otherwise; the page's script has it as well.
const NOT_FINITE: [u8; 3] = [0, 255, 255];
/// Rows of the screen that a thumbnail takes at least, however wide its image is.
pub const LEAST_SHOWN: usize = 4;
/// What an error is multiplied with in its thumbnail.
pub const ERROR_GAIN: f32 = 10.0;

/// The pictures of one frame.
#[derive(Clone, Debug)]
pub struct Picture {
    /// The channels that are shown.
    pub label: String,
    /// Reference, sparse input (if a mask is known), result, error: PNG as base64.
    pub thumbnails: Vec<(&'static str, String)>,
    /// Width and height of the thumbnails on the screen.
    pub thumbnail_size: (usize, usize),
    /// How good the frame is: the lower, the sooner it is shown in full.
    pub score: f64,
    /// Every pixel, for the viewer; only for the worst frames of a long sequence.
    pub pixels: Option<Pixels>,
}

/// Every pixel of one frame, as the page's script reads it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pixels {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// First column and row, in absolute coordinates.
    pub origin: (i32, i32),
    /// Width of a pixel over its height.
    pub aspect: f32,
    /// The value that is white.
    pub white: f32,
    /// Reference and test image, or what was filled alone.
    pub codes: Codes,
    /// Which pixels were measured: a bit each, lowest first, packed.
    pub mask: Option<String>,
    /// The estimated error, as grey.
    pub estimate: Option<Codes>,
    /// What colours mean, where they are colours.
    pub colour: Option<Colour>,
    /// Each pixel of a map stands for a square of so many.
    pub map_step: usize,
    /// `ssim` (1 less the mean of the channels), `flip`: 32 levels of square roots, each row less the row above, packed.
    pub maps: BTreeMap<&'static str, String>,
}

/// The way from linear red, green and blue to XYZ.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Colour {
    /// Row by row.
    pub matrix: Matrix,
    /// XYZ of white.
    pub white: [f64; 3],
}

impl Picture {
    /// The pictures of a group; its values as they are in the files.
    pub fn new(images: &Images<'_>, thumbnail_width: usize) -> Option<Self> {
        let reference = rgb(images.reference)?;
        let test = rgb(images.test)?;
        let psnr = |region: &str| images.report.region(region)?.measures.get(Measure::Psnr);
        let score = psnr("missing").or_else(|| psnr("all")).unwrap_or(0.0);
        let size = reference[0].size();
        let thumb = Thumbnail::new(size, thumbnail_width);
        let white = images.report.peak.unwrap_or(1.0);
        let shown = |value: f32| srgb_encode((value / white).clamp(0.0, 1.0));
        let mut thumbnails = vec![("reference", thumb.png(reference, None, shown))];
        if let Some(mask) = images.mask {
            thumbnails.push(("sparse", thumb.png(reference, Some(mask), shown)));
        }
        thumbnails.push(("result", thumb.png(test, None, shown)));
        thumbnails.push(("error", thumb.error(reference, test, white)));
        Some(Self {
            label: images.report.label(),
            thumbnails,
            thumbnail_size: thumb.on_screen(aspect(images.part)),
            score,
            pixels: Some(Pixels::new(images, reference, test, white)),
        })
    }
}

/// PNG as base64, by name.
type Named = Vec<(&'static str, String)>;

/// Mask (if there is one), sparse input (if it was filled) and result of a group of a part, and the size of the pictures; `white` is
/// the brightest.
pub fn filled_pictures(
    part: &Part,
    planes: &[Plane],
    mask: Option<&Mask>,
    filled: bool,
    (width, white): (usize, f32),
) -> Option<((usize, usize), Named)> {
    let image = rgb(planes)?;
    let thumb = Thumbnail::new(image[0].size(), width);
    let shown = |value: f32| srgb_encode((value / white).clamp(0.0, 1.0));
    let mut all = Vec::new();
    if let Some(mask) = mask {
        let ones = Plane::filled(mask.size(), 1.0);
        all.push(("mask", thumb.png([&ones; 3], Some(mask), |value| value)));
        if filled {
            all.push(("sparse", thumb.png(image, Some(mask), shown)));
        }
    }
    all.push(("result", thumb.png(image, None, shown)));
    Some((thumb.on_screen(aspect(part)), all))
}

impl Pixels {
    fn new(images: &Images<'_>, reference: [&Plane; 3], test: [&Plane; 3], white: f32) -> Self {
        let size = reference[0].size();
        let similarity = |at: usize| {
            let sum: f32 = images.similarity.iter().map(|s: &Similarity| s.map.pixels()[at]).sum();
            1.0 - sum / images.similarity.len() as f32
        };
        let codes = Codes::new(reference, Some(test), BUDGET);
        let pixels = Self::of(codes, size, images.part, images.mask, images.estimate);
        let flip = images.flip.map(|flip| ("flip", levels(size, pixels.map_step, |at| flip.pixels()[at])));
        let maps = [("ssim", levels(size, pixels.map_step, similarity))].into_iter().chain(flip).collect();
        let colour = (images.report.kind == Kind::Colour).then(|| chromaticities(images.part));
        let colour = colour.and_then(|of| Some(Colour { matrix: of.to_xyz()?, white: of.white_xyz() }));
        Self { white, colour, maps, ..pixels }
    }

    /// Every pixel of a frame that was filled, if it has colours or a channel to show.
    pub fn filled(
        part: &Part,
        planes: &[Plane],
        mask: Option<&Mask>,
        estimate: Option<&Plane>,
        white: f32,
    ) -> Option<Self> {
        let image = rgb(planes)?;
        let codes = Codes::new(image, None, BUDGET);
        Some(Self { white, ..Self::of(codes, image[0].size(), part, mask, estimate) })
    }

    fn of(codes: Codes, size: Size, part: &Part, mask: Option<&Mask>, estimate: Option<&Plane>) -> Self {
        let map_step = if size.pixels() > SMALL { 2 } else { 1 };
        let mask = mask.filter(|mask| mask.size() == size).map(|mask| packed(&bits(mask)));
        let estimate = estimate.filter(|estimate| estimate.size() == size);
        Self {
            width: size.width,
            height: size.height,
            origin: (part.data_window.x_min, part.data_window.y_min),
            aspect: aspect(part),
            white: 1.0,
            codes,
            mask,
            estimate: estimate.map(|plane| Codes::new([plane; 3], None, BUDGET / 3.0)),
            colour: None,
            map_step,
            maps: BTreeMap::new(),
        }
    }
}

/// Width of a part's pixels over their height; 1 where that cannot be.
fn aspect(part: &Part) -> f32 {
    let bytes = part.attributes.get("pixelAspectRatio").and_then(|found| found.value.first_chunk().copied());
    bytes.map(f32::from_le_bytes).filter(|aspect| (0.01..=100.0).contains(aspect)).unwrap_or(1.0)
}

/// Three planes for a display: colours as they are, a single channel as grey.
fn rgb(planes: &[Plane]) -> Option<[&Plane; 3]> {
    match planes {
        [r, g, b] => Some([r, g, b]),
        [grey, ..] => Some([grey, grey, grey]),
        [] => None,
    }
}

fn bits(mask: &Mask) -> Vec<u8> {
    let byte = |flags: &[bool]| flags.iter().enumerate().map(|(k, &flag)| u8::from(flag) << k).sum();
    mask.as_slice().chunks(8).map(byte).collect()
}

/// A map of values 0 to 1 as 32 levels of their square roots, each row less the row above, packed.
fn levels(size: Size, step: usize, value: impl Fn(usize) -> f32) -> String {
    let (rows, columns) = (size.height.div_ceil(step), size.width.div_ceil(step));
    let mut codes = Vec::with_capacity(rows * columns);
    for y in 0..rows {
        for x in 0..columns {
            let mut largest = 0.0_f32;
            for v in (y * step..(y + 1) * step).take_while(|&v| v < size.height) {
                for u in (x * step..(x + 1) * step).take_while(|&u| u < size.width) {
                    largest = largest.max(value(v * size.width + u));
                }
            }
            codes.push((31.0 * largest.clamp(0.0, 1.0).sqrt()).round() as u8);
        }
    }
    let less: Vec<u8> = (0..codes.len())
        .map(|at| codes[at].wrapping_sub(if at >= columns { codes[at - columns] } else { 0 }))
        .collect();
    packed(&less)
}

/// A smaller image: each pixel the mean of a box.
struct Thumbnail {
    full: Size,
    size: Size,
}

impl Thumbnail {
    fn new(full: Size, width: usize) -> Self {
        let width = width.min(full.width).max(1);
        let height = (full.height * width / full.width.max(1)).clamp(1, 4 * width);
        Self { full, size: Size::new(height, width) }
    }

    /// Columns and rows that it takes on the screen.
    fn on_screen(&self, aspect: f32) -> (usize, usize) {
        let height = (self.size.height as f32 / aspect).round() as usize;
        (self.size.width, height.max(LEAST_SHOWN))
    }

    /// The mean of `value` over each box, row by row; not finite if one of its values is not.
    fn means(&self, value: impl Fn(usize) -> [f32; 3]) -> Vec<[f32; 3]> {
        let mut out = Vec::with_capacity(self.size.pixels());
        for y in 0..self.size.height {
            let rows = self.range(y, self.size.height, self.full.height);
            for x in 0..self.size.width {
                let columns = self.range(x, self.size.width, self.full.width);
                let (mut sum, mut count) = ([0.0_f32; 3], 0.0_f32);
                for v in rows.clone() {
                    for u in columns.clone() {
                        let rgb = value(v * self.full.width + u);
                        for (sum, value) in sum.iter_mut().zip(rgb) {
                            *sum += value;
                        }
                        count += 1.0;
                    }
                }
                out.push(sum.map(|sum| sum / count.max(1.0)));
            }
        }
        out
    }

    #[allow(clippy::unused_self, reason = "it belongs to the geometry of a thumbnail")]
    fn range(&self, at: usize, small: usize, full: usize) -> std::ops::Range<usize> {
        let start = at * full / small;
        start..((at + 1) * full / small).max(start + 1).min(full)
    }

    fn png(&self, image: [&Plane; 3], mask: Option<&Mask>, curve: impl Fn(f32) -> f32) -> String {
        let value = |at: usize| {
            let measured = mask.is_none_or(|mask| mask.as_slice()[at]);
            if measured { image.map(|plane| plane.pixels()[at]) } else { [0.0; 3] }
        };
        self.encode(value, |rgb| rgb.map(|value| (255.0 * curve(value)).round() as u8))
    }

    fn error(&self, reference: [&Plane; 3], test: [&Plane; 3], white: f32) -> String {
        let value = |at: usize| {
            let by = |k: usize| (test[k].pixels()[at] - reference[k].pixels()[at]).abs();
            let by = [by(0), by(1), by(2)];
            // The largest of numbers passes over those that are none.
            let largest =
                if by.iter().all(|by| by.is_finite()) { by[0].max(by[1]).max(by[2]) } else { f32::NAN };
            [largest * ERROR_GAIN / white; 3]
        };
        self.encode(value, |[value, ..]| heat(value))
    }

    fn encode(&self, value: impl Fn(usize) -> [f32; 3], shown: impl Fn([f32; 3]) -> [u8; 3]) -> String {
        let is_finite = |rgb: &[f32; 3]| rgb.iter().all(|value| value.is_finite());
        let pixel = |rgb| if is_finite(&rgb) { shown(rgb) } else { NOT_FINITE };
        let bytes: Vec<u8> = self.means(value).into_iter().flat_map(pixel).collect();
        let kind = (ColorType::Rgb, BitDepth::Eight);
        let png = raster::png((self.size.width, self.size.height), kind, Compression::Fast, &bytes);
        png.map_or_else(|_| String::new(), |png| base64(&png))
    }
}

/// 0 to 1 as black, violet, red, yellow, white: lightness grows evenly.
fn heat(value: f32) -> [u8; 3] {
    const STOPS: [[f32; 3]; 5] = [
        [0.0, 0.0, 4.0],
        [81.0, 18.0, 124.0],
        [183.0, 55.0, 121.0],
        [252.0, 137.0, 97.0],
        [252.0, 253.0, 191.0],
    ];
    let at = value.clamp(0.0, 1.0) * 4.0;
    let below = (at as usize).min(3);
    let part = at - below as f32;
    [0, 1, 2].map(|k| (STOPS[below][k] + part * (STOPS[below + 1][k] - STOPS[below][k])).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thumbnails_cover_every_pixel() {
        let thumb = Thumbnail::new(Size::new(3, 5), 2);
        assert_eq!((thumb.size.height, thumb.size.width), (1, 2));
        let means = thumb.means(|at| [at as f32, 1.0, 0.0]);
        // Columns 0, 1 and 2, 3, 4 of rows that begin at 0, 5, 10.
        assert_eq!(means, [[5.5, 1.0, 0.0], [8.0, 1.0, 0.0]]);
        let whole = Thumbnail::new(Size::new(1, 1), 160);
        assert_eq!((whole.size.height, whole.size.width), (1, 1));
    }

    #[test]
    fn bits_lie_lowest_first() {
        let mask = Mask::from_fn(Size::new(1, 10), |_, x| [0, 3, 9].contains(&x));
        assert_eq!(bits(&mask), [0b1001, 0b10]);
    }

    #[test]
    fn heat_goes_from_black_to_bright() {
        let sum = |value: f32| heat(value).map(u32::from).iter().sum::<u32>();
        assert_eq!(heat(0.0), [0, 0, 4]);
        assert_eq!(heat(9.0), [252, 253, 191]);
        assert!((0..20).all(|k| sum(k as f32 / 20.0) < sum((k + 1) as f32 / 20.0)));
    }
}
