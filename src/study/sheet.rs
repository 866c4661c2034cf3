//! Results and error maps side by side, as one SVG with its pictures inside: a column a filter, three rows a density.
//!
//! The rows: result (sRGB), distance in CIELUV (0 black, 20 white), SSIM squared (0 black, 1 white), as the thesis that
//! lacuna follows shows them. Maps have 16 levels of grey, results 32 levels a channel.

use lacuna_exr::Window;
use lacuna_filters::Plane;
use lacuna_filters::metric::colour::srgb_encode;

use super::cell::{Cell, run};
use super::definition::SheetDefinition;
use super::selection::Selection;
use super::verdict::percents;
use crate::raster::{self, BitDepth, ColorType, Compression};
use crate::report::{GroupReport, Images, Measure, base64, escape};

/// CIELUV distance that is white.
const CIELUV: f32 = 20.0;
const GAP: usize = 6;
const TEXT: usize = 17;
/// About the width of a character.
const CHARACTER: usize = 7;

/// The pictures of one cell.
#[derive(Clone, Debug, Default)]
pub struct Sheet {
    width: usize,
    height: usize,
    reference: String,
    sparse: String,
    result: String,
    error: String,
    similarity: String,
    psnr: Option<f64>,
    cieluv: Option<f64>,
    ssim: Option<f64>,
}

impl Sheet {
    /// Runs a cell and keeps its pictures.
    ///
    /// # Errors
    /// What went wrong in the cell.
    pub fn of(cell: &Cell<'_>, definition: &SheetDefinition) -> Result<Self, String> {
        let mut sheet = Self::default();
        let row = run(cell, &mut |images| sheet.look(images, definition));
        match row.error {
            Some(error) => Err(error),
            None if sheet.width == 0 => Err("the sheet's window holds no pixel of the frame".into()),
            None => Ok(sheet),
        }
    }

    fn look(&mut self, images: &Images<'_>, definition: &SheetDefinition) {
        let Some(view) = View::new(images, definition) else { return };
        (self.width, self.height) = (view.width, view.height);
        let colours = |planes: &[Plane], measured: bool| {
            view.colours(|at, k| {
                let hidden = measured && images.mask.is_some_and(|mask| !mask.as_slice()[at]);
                if hidden { 0.0 } else { planes[k.min(planes.len() - 1)].pixels()[at] }
            })
        };
        self.reference = colours(images.reference, false);
        self.sparse = colours(images.reference, true);
        self.result = colours(images.test, false);
        if let Some(map) = images.cieluv {
            self.error = view.greys(|at| map.pixels()[at] / CIELUV);
        }
        let maps = images.similarity;
        let mean = |at: usize| maps.iter().map(|one| one.map.pixels()[at]).sum::<f32>() / maps.len() as f32;
        self.similarity = view.greys(|at| mean(at).max(0.0).powi(2));
        let report: &GroupReport = images.report;
        let get = |measure: Measure| report.region("all")?.measures.get(measure);
        (self.psnr, self.cieluv, self.ssim) = (get(Measure::Psnr), get(Measure::Cieluv), get(Measure::Ssim));
    }
}

/// Whether the window of a sheet, first column and row, width and height, begins within the frame's.
pub fn meets([x, y, width, height]: [i32; 4], frame: Window) -> bool {
    let inside = (frame.x_min..=frame.x_max).contains(&x) && (frame.y_min..=frame.y_max).contains(&y);
    inside && width > 0 && height > 0
}

/// Which pixels a tile shows, and how large it is.
struct View {
    columns: usize,
    left: usize,
    top: usize,
    shown: [usize; 2],
    width: usize,
    height: usize,
}

impl View {
    fn new(images: &Images<'_>, definition: &SheetDefinition) -> Option<Self> {
        let window = images.part.data_window;
        let size = window.size();
        let all = [window.x_min, window.y_min, size.width as i32, size.height as i32];
        let [x, y, width, height] = definition.window.unwrap_or(all);
        let (left, top) = (x.checked_sub(window.x_min)?, y.checked_sub(window.y_min)?);
        let (left, top) = (usize::try_from(left).ok()?, usize::try_from(top).ok()?);
        let shown = [usize::try_from(width).ok()?, usize::try_from(height).ok()?];
        let [columns, rows] =
            [shown[0].min(size.width.checked_sub(left)?), shown[1].min(size.height.checked_sub(top)?)];
        if columns == 0 || rows == 0 {
            return None;
        }
        let width = definition.tile.min(columns);
        let height = (rows * width / columns).max(1);
        Some(Self { columns: size.width, left, top, shown: [columns, rows], width, height })
    }

    /// The mean of a value over the box of each of the tile's pixels.
    fn means(&self, value: impl Fn(usize) -> f32) -> Vec<f32> {
        let range = |at: usize, small: usize, full: usize| {
            let start = at * full / small;
            start..((at + 1) * full / small).max(start + 1).min(full)
        };
        let mut out = Vec::with_capacity(self.width * self.height);
        for y in 0..self.height {
            for x in 0..self.width {
                let (mut sum, mut count) = (0.0, 0.0);
                for v in range(y, self.height, self.shown[1]) {
                    for u in range(x, self.width, self.shown[0]) {
                        let value = value((self.top + v) * self.columns + self.left + u);
                        sum += if value.is_finite() { value } else { 0.0 };
                        count += 1.0;
                    }
                }
                out.push(sum / count);
            }
        }
        out
    }

    fn colours(&self, value: impl Fn(usize, usize) -> f32) -> String {
        let planes = [0, 1, 2].map(|k| self.means(|at| value(at, k)));
        let code = |value: f32| {
            let level = (31.0 * srgb_encode(value.clamp(0.0, 1.0))).round() as u8;
            level << 3 | level >> 2
        };
        let bytes: Vec<u8> =
            (0..planes[0].len()).flat_map(|at| [0, 1, 2].map(|k| code(planes[k][at]))).collect();
        self.encode(&bytes, ColorType::Rgb, BitDepth::Eight)
    }

    fn greys(&self, value: impl Fn(usize) -> f32) -> String {
        let levels: Vec<u8> =
            self.means(value).into_iter().map(|v| (15.0 * v.clamp(0.0, 1.0)).round() as u8).collect();
        let pair = |pair: &[u8]| pair[0] << 4 | pair.get(1).copied().unwrap_or(0);
        let bytes: Vec<u8> = levels.chunks(self.width).flat_map(|row| row.chunks(2).map(pair)).collect();
        self.encode(&bytes, ColorType::Grayscale, BitDepth::Four)
    }

    fn encode(&self, bytes: &[u8], colour: ColorType, depth: BitDepth) -> String {
        let png = raster::png((self.width, self.height), (colour, depth), Compression::High, bytes);
        png.map_or_else(|_| String::new(), |png| base64(&png))
    }
}

/// A cell of a sheet with its pictures, or why there are none.
pub type Tile<'a> = (&'a Cell<'a>, Result<Sheet, String>);

/// The whole sheet: per density and filter the pictures, in the order of the cells.
pub fn sheet(definition: &SheetDefinition, tiles: &[Tile<'_>]) -> String {
    let lines: Vec<&[Tile<'_>]> =
        tiles.chunk_by(|a, b| a.0.density.to_bits() == b.0.density.to_bits()).collect();
    let names: Vec<&str> =
        lines.first().map_or_else(Vec::new, |line| line.iter().map(|tile| tile.0.label()).collect());
    let missing: Vec<f64> = lines.iter().map(|line| 1.0 - line[0].0.density).collect();
    let heading = |missing: String| {
        let (frame, pattern) = (&definition.frame, &definition.pattern);
        format!("{frame}, {pattern}, {missing} missing: result; CIELUV error, 0 to 20; SSIM squared")
    };
    let headings: Vec<String> = percents(&missing).into_iter().map(heading).collect();
    let size =
        tiles.iter().find_map(|(_, found)| found.as_ref().ok().map(|found| (found.width, found.height)));
    let (tile, height) = size.unwrap_or((definition.tile, definition.tile));
    let longest =
        |all: &mut dyn Iterator<Item = &str>| all.map(|text| text.chars().count()).max().unwrap_or(0);
    let step = tile.max(100).max(8 * longest(&mut names.iter().copied())) + GAP;
    let (label, block) = (20 + TEXT, 3 * (height + TEXT + GAP) + TEXT);
    let width =
        (step * (names.len() + 1)).max(CHARACTER * longest(&mut headings.iter().map(String::as_str))) + GAP;
    let height = label + lines.len() * block;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    for (index, name) in names.iter().enumerate() {
        svg += &text((GAP + (index + 1) * step, 16), name, "bold");
    }
    for (index, (line, heading)) in lines.iter().zip(&headings).enumerate() {
        let top = label + index * block;
        svg += &text((GAP, top - 4), heading, "bold");
        svg += &rows(line, top, [step, block - TEXT]);
    }
    svg.push_str("</svg>\n");
    svg
}

/// The three rows of a density: reference and sparse input first, then a column a filter.
fn rows(tiles: &[Tile<'_>], top: usize, [step, block]: [usize; 2]) -> String {
    let line = |k: usize| top + k * block / 3;
    let mut svg = String::new();
    if let Some((cell, first)) = tiles.iter().find_map(|(cell, found)| Some((cell, found.as_ref().ok()?))) {
        svg += &first.captioned((GAP, line(0)), &first.reference, "reference");
        if cell.pattern != Selection::Half {
            svg += &first.captioned((GAP, line(1)), &first.sparse, "sparse");
        }
    }
    for (index, (_, found)) in tiles.iter().enumerate() {
        let x = GAP + (index + 1) * step;
        let tile = match found {
            Ok(tile) => tile,
            Err(why) => {
                svg += &wrapped((x, top), why, [(step - GAP) / CHARACTER, block / TEXT]);
                continue;
            }
        };
        let number = |name: &str, value: Option<f64>, digits: usize| {
            value.map_or_else(String::new, |value| format!("{name} {value:.digits$}"))
        };
        svg += &tile.captioned((x, line(0)), &tile.result, &number("PSNR", tile.psnr, 2));
        svg += &tile.captioned((x, line(1)), &tile.error, &number("CIELUV", tile.cieluv, 3));
        svg += &tile.captioned((x, line(2)), &tile.similarity, &number("mSSIM", tile.ssim, 4));
    }
    svg
}

/// Words in lines of so many characters, as many lines as there is room for.
fn wrapped((x, y): (usize, usize), words: &str, [columns, most]: [usize; 2]) -> String {
    let mut lines: Vec<String> = Vec::new();
    for word in words.split_whitespace() {
        match lines.last_mut().filter(|line| line.chars().count() + word.chars().count() < columns) {
            Some(line) => line.extend([" ", word]),
            None => lines.push(word.into()),
        }
    }
    if lines.len() > most {
        lines.truncate(most);
        lines.last_mut().into_iter().for_each(|line| line.push('…'));
    }
    lines.iter().enumerate().map(|(at, line)| text((x, y + (at + 1) * TEXT - 4), line, "normal")).collect()
}

impl Sheet {
    /// One picture with a line below it.
    fn captioned(&self, (x, y): (usize, usize), png: &str, caption: &str) -> String {
        let (width, height) = (self.width, self.height);
        format!(
            "<image x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" href=\"data:image/png;base64,{png}\"/>\n\
             <rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" fill=\"none\" stroke=\"#999\"/>\n{}",
            text((x, y + height + 13), caption, "normal")
        )
    }
}

fn text((x, y): (usize, usize), words: &str, weight: &str) -> String {
    format!("<text x=\"{x}\" y=\"{y}\" font-weight=\"{weight}\">{}</text>\n", escape(words))
}
