//! Colours between two others, along paths through the colour spaces that colour maps are made in.
//!
//! Sources: HSV after A. Smith, "Color gamut transform pairs", SIGGRAPH 1978; CIELAB of sRGB (IEC 61966-2-1, white D65); diverging
//! maps after K. Moreland, "Diverging Color Maps for Scientific Visualization", ISVC 2009, whose Msh are polar coordinates of CIELAB.
//! Colours that no display has are scaled down to 1 and cut at 0, as VTK does it.

use std::f64::consts::{FRAC_PI_3, PI};

/// A colour: red, green, blue, 0 to 1.
pub type Rgb = [f64; 3];

/// The space in which colours are joined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Space {
    /// By lines in red, green and blue.
    Rgb,
    /// Hue, saturation and value; hues the shorter way round, or never through red.
    Hsv {
        /// The shorter way round.
        wrap: bool,
    },
    /// CIELAB.
    Lab,
    /// Msh, through white between hues that differ.
    Diverging,
    /// Each colour up to its point.
    Step,
}

/// White of D65, over that of Y.
const WHITE: [f64; 3] = [0.9505, 1.0, 1.089];
/// Rows: X, Y, Z of linear red, green and blue.
const TO_XYZ: [[f64; 3]; 3] = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]];
const FROM_XYZ: [[f64; 3]; 3] =
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]];
/// Where the cube root of CIELAB becomes a line, and its slope and offset.
const DARK: f64 = 0.008_856;
const LINE: (f64, f64) = (7.787, 16.0 / 116.0);
/// Saturation of Msh below which a colour is grey, and has no hue of its own.
const GREY: f64 = 0.05;
/// The least magnitude of the white between two hues.
const BRIGHT: f64 = 88.0;

impl Space {
    /// The space of that name in a colour map; nothing for one that is not known.
    pub fn named(name: &str, wrap: bool) -> Option<Self> {
        Some(match name {
            "RGB" => Self::Rgb,
            "HSV" => Self::Hsv { wrap },
            "Lab" => Self::Lab,
            "Diverging" => Self::Diverging,
            "Step" => Self::Step,
            _ => return None,
        })
    }

    /// The colour at a share of the way from `a` to `b`.
    pub fn between(self, a: Rgb, b: Rgb, share: f64) -> Rgb {
        match self {
            Self::Rgb => mix(a, b, share),
            Self::Hsv { wrap } => {
                let (mut a, mut b) = (hsv(a), hsv(b));
                if wrap && (a[0] - b[0]).abs() > 0.5 {
                    if a[0] < b[0] { a[0] += 1.0 } else { b[0] += 1.0 }
                }
                let [hue, saturation, value] = mix(a, b, share);
                of_hsv([hue.rem_euclid(1.0), saturation, value])
            }
            Self::Lab => of_lab(mix(lab(a), lab(b), share)),
            Self::Diverging => diverging(msh(lab(a)), msh(lab(b)), share),
            Self::Step => b,
        }
    }
}

fn mix(a: [f64; 3], b: [f64; 3], share: f64) -> [f64; 3] {
    std::array::from_fn(|k| (1.0 - share) * a[k] + share * b[k])
}

fn hsv([red, green, blue]: Rgb) -> [f64; 3] {
    let (most, least) = (red.max(green).max(blue), red.min(green).min(blue));
    let spread = most - least;
    if spread == 0.0 {
        return [0.0, 0.0, most];
    }
    let sixths = if red == most {
        (green - blue) / spread
    } else if green == most {
        2.0 + (blue - red) / spread
    } else {
        4.0 + (red - green) / spread
    };
    [(sixths / 6.0).rem_euclid(1.0), spread / most, most]
}

fn of_hsv([hue, saturation, value]: [f64; 3]) -> Rgb {
    [5.0, 3.0, 1.0].map(|from| {
        let k: f64 = (from + 6.0 * hue) % 6.0;
        value * (1.0 - saturation * k.min(4.0 - k).clamp(0.0, 1.0))
    })
}

fn product(rows: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    rows.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn lab(colour: Rgb) -> [f64; 3] {
    let linear = colour.map(|v| if v > 0.040_45 { ((v + 0.055) / 1.055).powf(2.4) } else { v / 12.92 });
    let xyz = product(&TO_XYZ, linear);
    let [x, y, z] = std::array::from_fn(|k| {
        let share = xyz[k] / WHITE[k];
        if share > DARK { share.cbrt() } else { LINE.0 * share + LINE.1 }
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn of_lab([lightness, a, b]: [f64; 3]) -> Rgb {
    let y = (lightness + 16.0) / 116.0;
    let roots = [y + a / 500.0, y, y - b / 200.0];
    let xyz = std::array::from_fn(|k| {
        let cube = roots[k].powi(3);
        WHITE[k] * if cube > DARK { cube } else { (roots[k] - LINE.1) / LINE.0 }
    });
    let encode = |v: f64| if v > 0.003_130_8 { 1.055 * v.powf(1.0 / 2.4) - 0.055 } else { 12.92 * v };
    let colour = product(&FROM_XYZ, xyz).map(encode);
    let most = colour.iter().copied().fold(1.0, f64::max);
    colour.map(|v| (v / most).max(0.0))
}

/// Magnitude, saturation and hue of CIELAB.
fn msh([lightness, a, b]: [f64; 3]) -> [f64; 3] {
    let magnitude = (lightness * lightness + a * a + b * b).sqrt();
    let saturation = if magnitude > 0.001 { (lightness / magnitude).clamp(-1.0, 1.0).acos() } else { 0.0 };
    let hue = if saturation > 0.001 { b.atan2(a) } else { 0.0 };
    [magnitude, saturation, hue]
}

fn of_msh([magnitude, saturation, hue]: [f64; 3]) -> Rgb {
    let away = magnitude * saturation.sin();
    of_lab([magnitude * saturation.cos(), away * hue.cos(), away * hue.sin()])
}

/// Moreland's path: over white between hues more than a third of a half turn apart, and a hue for greys that keeps the path even.
fn diverging(mut a: [f64; 3], mut b: [f64; 3], mut share: f64) -> Rgb {
    let apart = (a[2] - b[2]).rem_euclid(2.0 * PI);
    if a[1] > GREY && b[1] > GREY && apart.min(2.0 * PI - apart) > FRAC_PI_3 {
        let white = [a[0].max(b[0]).max(BRIGHT), 0.0, 0.0];
        if share < 0.5 {
            (b, share) = (white, 2.0 * share);
        } else {
            (a, share) = (white, 2.0 * share - 1.0);
        }
    }
    if a[1] < GREY && b[1] > GREY {
        a[2] = hue_of_grey(b, a[0]);
    } else if b[1] < GREY && a[1] > GREY {
        b[2] = hue_of_grey(a, b[0]);
    }
    of_msh(mix(a, b, share))
}

fn hue_of_grey([magnitude, saturation, hue]: [f64; 3], grey: f64) -> f64 {
    if magnitude >= grey {
        return hue;
    }
    let spin = saturation * (grey * grey - magnitude * magnitude).sqrt() / (magnitude * saturation.sin());
    if hue > -FRAC_PI_3 { hue + spin } else { hue - spin }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLOURS: [Rgb; 5] =
        [[0.231, 0.298, 0.753], [0.706, 0.016, 0.149], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.9, 0.7, 0.1]];

    #[test]
    fn colours_come_back_from_every_space() {
        for colour in COLOURS {
            let back = [of_hsv(hsv(colour)), of_lab(lab(colour)), of_msh(msh(lab(colour)))];
            for (back, within) in back.iter().zip([1e-12, 2e-4, 2e-4]) {
                for (a, b) in colour.iter().zip(back) {
                    assert!((a - b).abs() < within, "{colour:?} {back:?}");
                }
            }
        }
    }

    /// What `vtkColorTransferFunction` 9.7 has in the middle and at a quarter, to three digits.
    #[test]
    fn paths_are_those_of_vtk() {
        let [cool, warm, ..] = COLOURS;
        for (space, share, expected) in [
            (Space::Lab, 0.25, [0.467, 0.253, 0.595]),
            (Space::Lab, 0.5, [0.581, 0.203, 0.443]),
            (Space::Diverging, 0.25, [0.553, 0.689, 0.995]),
            (Space::Diverging, 0.5, [0.865, 0.865, 0.865]),
            (Space::Diverging, 0.75, [0.958, 0.603, 0.482]),
        ] {
            let found = space.between(cool, warm, share);
            for (a, b) in found.iter().zip(&expected) {
                assert!((a - b).abs() < 1e-3, "{space:?} {share} {found:?}");
            }
        }
        let hues = |wrap| Space::Hsv { wrap }.between([1.0, 0.0, 0.1], [1.0, 0.1, 0.0], 0.5);
        assert!(hues(true)[1] < 0.01 && hues(true)[2] < 0.06 && hues(false)[1] > 0.9, "{:?}", hues(false));
    }
}
