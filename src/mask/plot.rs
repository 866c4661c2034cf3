//! Plain plots as PNG: axes, grid lines with numbers, one or more curves.

use std::io::Write;
use std::path::Path;

use super::MakeError;
use crate::raster::{self, BitDepth, ColorType, Compression};

/// Pixels of the image, and of its margins for numbers and titles.
const SIZE: (usize, usize) = (640, 400);
const LEFT: usize = 44;
const BELOW: usize = 40;
const ABOVE: usize = 24;
const MARGIN: usize = 12;

/// A plot: the titles and ranges of its axes, where their grid lines stand, and its curves.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Titles of the horizontal and the vertical axis: letters without capitals, digits, points and signs.
    pub titles: [&'static str; 2],
    /// Ends of the horizontal axis.
    pub x: (f64, f64),
    /// Ends of the vertical axis.
    pub y: (f64, f64),
    /// Grid lines of the horizontal axis.
    pub x_lines: Vec<f64>,
    /// Grid lines of the vertical axis.
    pub y_lines: Vec<f64>,
    /// Points of each curve; later curves are lighter.
    pub curves: Vec<Vec<(f64, f64)>>,
}

impl Plot {
    /// Writes the plot.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn write(&self, path: &Path, no_clobber: bool) -> Result<(), MakeError> {
        let kind = (ColorType::Grayscale, BitDepth::Eight);
        let png = raster::png(SIZE, kind, Compression::Fast, &self.draw().0);
        Ok(lacuna_exr::write_other(path, no_clobber, |out| {
            out.write_all(&png.map_err(std::io::Error::other)?)
        })?)
    }

    fn draw(&self) -> Grey {
        let mut image = Grey(vec![255; SIZE.0 * SIZE.1]);
        let (right, bottom) = (SIZE.0 - MARGIN, SIZE.1 - BELOW);
        let place = |value: f64, (low, high): (f64, f64), from: usize, to: usize| {
            let share = if high > low { ((value - low) / (high - low)).clamp(0.0, 1.0) } else { 0.0 };
            from as f64 + share * (to as f64 - from as f64)
        };
        let across = |x: f64| place(x, self.x, LEFT, right);
        let up = |y: f64| place(y, self.y, bottom, ABOVE);
        for &x in &self.x_lines {
            line(&mut image, (across(x), up(self.y.0)), (across(x), up(self.y.1)), 220);
            let text = format!("{x}");
            write(&mut image, &text, across(x) as i64 - 4 * text.len() as i64, bottom as i64 + 6);
        }
        for &y in &self.y_lines {
            line(&mut image, (across(self.x.0), up(y)), (across(self.x.1), up(y)), 220);
            let text = format!("{y}");
            write(&mut image, &text, LEFT as i64 - 8 * text.len() as i64 - 4, up(y) as i64 - 5);
        }
        let [below, above] = self.titles;
        write(&mut image, below, (right - 8 * below.len()) as i64, bottom as i64 + 24);
        write(&mut image, above, LEFT as i64, 6);
        for (index, curve) in self.curves.iter().enumerate() {
            let grey = (index * 90).min(180) as u8;
            for pair in curve.windows(2) {
                line(
                    &mut image,
                    (across(pair[0].0), up(pair[0].1)),
                    (across(pair[1].0), up(pair[1].1)),
                    grey,
                );
            }
        }
        image
    }
}

/// Grey values, 0 to 255, row by row.
struct Grey(Vec<u8>);

/// Darkens a pixel; those outside are passed over.
fn set(image: &mut Grey, x: i64, y: i64, grey: u8) {
    if let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y))
        && x < SIZE.0
        && y < SIZE.1
    {
        let pixel = &mut image.0[y * SIZE.0 + x];
        *pixel = grey.min(*pixel);
    }
}

fn line(image: &mut Grey, from: (f64, f64), to: (f64, f64), grey: u8) {
    let steps = (to.0 - from.0).abs().max((to.1 - from.1).abs()).ceil().max(1.0);
    for step in 0..=steps as u32 {
        let share = f64::from(step) / steps;
        let at = |from: f64, to: f64| (from + share * (to - from)).round() as i64;
        set(image, at(from.0, to.0), at(from.1, to.1), grey);
    }
}

/// Writes letters, digits, points and signs, each 3 x 5 dots of 2 x 2 pixels, 8 pixels apart.
fn write(image: &mut Grey, text: &str, x: i64, y: i64) {
    for (index, letter) in text.chars().enumerate() {
        for (row, bits) in glyph(letter).into_iter().enumerate() {
            for column in (0..3).filter(|column| bits & (4 >> column) != 0) {
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    set(image, x + 8 * index as i64 + 2 * column + dx, y + 2 * row as i64 + dy, 60);
                }
            }
        }
    }
}

/// The rows of a character, three bits each.
const fn glyph(letter: char) -> [u8; 5] {
    match letter {
        '0' => [7, 5, 5, 5, 7],
        '1' => [2, 6, 2, 2, 7],
        '2' => [7, 1, 7, 4, 7],
        '3' => [7, 1, 7, 1, 7],
        '4' => [5, 5, 7, 1, 1],
        '5' => [7, 4, 7, 1, 7],
        '6' => [7, 4, 7, 5, 7],
        '7' => [7, 1, 1, 2, 2],
        '8' => [7, 5, 7, 5, 7],
        '9' => [7, 5, 7, 1, 7],
        'a' => [7, 5, 7, 5, 5],
        'b' => [6, 5, 6, 5, 6],
        'c' => [7, 4, 4, 4, 7],
        'd' => [6, 5, 5, 5, 6],
        'e' => [7, 4, 7, 4, 7],
        'f' => [7, 4, 7, 4, 4],
        'g' => [7, 4, 5, 5, 7],
        'h' => [5, 5, 7, 5, 5],
        'i' => [7, 2, 2, 2, 7],
        'j' => [1, 1, 1, 5, 7],
        'k' => [5, 5, 6, 5, 5],
        'l' => [4, 4, 4, 4, 7],
        'm' => [5, 7, 7, 5, 5],
        'n' => [6, 5, 5, 5, 5],
        'o' => [2, 5, 5, 5, 2],
        'p' => [6, 5, 6, 4, 4],
        'q' => [7, 5, 5, 7, 1],
        'r' => [6, 5, 6, 5, 5],
        's' => [3, 4, 2, 1, 6],
        't' => [7, 2, 2, 2, 2],
        'u' => [5, 5, 5, 5, 7],
        'v' => [5, 5, 5, 5, 2],
        'w' => [5, 5, 7, 7, 5],
        'x' => [5, 5, 2, 5, 5],
        'y' => [5, 5, 2, 2, 2],
        'z' => [7, 1, 2, 4, 7],
        '.' => [0, 0, 0, 0, 2],
        '-' => [0, 0, 7, 0, 0],
        _ => [0; 5],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_letter_can_be_read() {
        let letters: Vec<char> = ('a'..='z').chain('0'..='9').chain(['.', '-']).collect();
        for (at, &letter) in letters.iter().enumerate() {
            assert_ne!(glyph(letter), glyph(' '), "{letter}");
            assert_eq!(letters[..at].iter().find(|other| glyph(**other) == glyph(letter)), None, "{letter}");
        }
    }

    #[test]
    fn curves_pass_where_they_should() {
        let plot = Plot {
            titles: ["x", ""],
            x: (0.0, 1.0),
            y: (0.0, 2.0),
            x_lines: vec![0.5],
            y_lines: vec![],
            curves: vec![vec![(0.0, 1.0), (1.0, 1.0)], vec![(0.0, f64::NAN), (1.0, 9.0)]],
        };
        let image = plot.draw();
        let at = |x: usize, y: usize| image.0[y * SIZE.0 + x];
        let middle = ABOVE + (SIZE.1 - BELOW - ABOVE) / 2;
        assert_eq!(at(LEFT + 100, middle), 0);
        assert_eq!(at(LEFT + 100, middle + 5), 255);
        assert_eq!(at(LEFT + (SIZE.0 - MARGIN - LEFT) / 2, middle + 50), 220);
        // The title: an x of 5 x 3 dots.
        let (left, top) = (SIZE.0 - MARGIN - 8, SIZE.1 - BELOW + 24);
        let dots = [0, 2, 4].map(|column| at(left + column, top));
        assert_eq!((dots, at(left + 2, top + 4)), ([60, 255, 60], 60));
    }
}
