//! Colour spaces: linear RGB by its chromaticities to XYZ, and the sRGB transfer curve.
//!
//! Sources: CIE 15:2018, "Colorimetry"; SMPTE RP 177:1993 for the matrix of a set of primaries; IEC 61966-2-1:1999
//! for sRGB.

/// Chromaticities `(x, y)` of primaries and white, as the EXR attribute `chromaticities` holds them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chromaticities {
    /// Of red (1, 0, 0).
    pub red: [f64; 2],
    /// Of green (0, 1, 0).
    pub green: [f64; 2],
    /// Of blue (0, 0, 1).
    pub blue: [f64; 2],
    /// Of white (1, 1, 1).
    pub white: [f64; 2],
}

impl Default for Chromaticities {
    /// ITU-R BT.709 with white D65: what an EXR file without the attribute means.
    fn default() -> Self {
        Self { red: [0.64, 0.33], green: [0.30, 0.60], blue: [0.15, 0.06], white: [0.3127, 0.3290] }
    }
}

/// A 3x3 matrix, row by row.
pub type Matrix = [[f64; 3]; 3];

impl Chromaticities {
    /// The matrix from linear RGB to XYZ with `Y = 1` for white; `None` if the primaries lie on a line.
    pub fn to_xyz(&self) -> Option<Matrix> {
        let column = |[x, y]: [f64; 2]| [x / y, 1.0, (1.0 - x - y) / y];
        let (r, g, b) = (column(self.red), column(self.green), column(self.blue));
        let primaries = [0, 1, 2].map(|row| [r[row], g[row], b[row]]);
        let scale = apply(&inverse(&primaries)?, self.white_xyz());
        let matrix = primaries.map(|row| [row[0] * scale[0], row[1] * scale[1], row[2] * scale[2]]);
        matrix.iter().flatten().all(|value| value.is_finite()).then_some(matrix)
    }

    /// XYZ of white, `Y = 1`.
    pub fn white_xyz(&self) -> [f64; 3] {
        let [x, y] = self.white;
        [x / y, 1.0, (1.0 - x - y) / y]
    }
}

/// Matrix times vector.
pub fn apply(matrix: &Matrix, v: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// The inverse by the adjugate; `None` if the determinant is 0 or not finite.
pub fn inverse(m: &Matrix) -> Option<Matrix> {
    let cofactor = |i: usize, j: usize| {
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * cofactor(0, j)).sum();
    let usable = determinant.is_finite() && determinant != 0.0;
    usable.then(|| [0, 1, 2].map(|i| [0, 1, 2].map(|j| cofactor(j, i) / determinant)))
}

/// The sRGB curve: linear 0 to 1 to display 0 to 1, odd about 0 and continued beyond 1.
pub fn srgb_encode(linear: f32) -> f32 {
    let a = linear.abs();
    let encoded = if a <= 0.003_130_8 { 12.92 * a } else { 1.055 * a.powf(1.0 / 2.4) - 0.055 };
    encoded.copysign(linear)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_matrix_of_bt709_is_the_known_one() {
        let matrix = Chromaticities::default().to_xyz().unwrap();
        let known = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]];
        for (row, known) in matrix.iter().zip(known) {
            for (value, known) in row.iter().zip(known) {
                assert!((value - known).abs() < 5.1e-5, "{value} {known}");
            }
        }
        let white = apply(&matrix, [1.0; 3]);
        assert!((white[1] - 1.0).abs() < 1e-14);
    }

    #[test]
    fn the_inverse_inverts() {
        let matrix = Chromaticities::default().to_xyz().unwrap();
        let v = apply(&inverse(&matrix).unwrap(), apply(&matrix, [0.2, 0.7, 0.4]));
        for (value, expected) in v.iter().zip([0.2, 0.7, 0.4]) {
            assert!((value - expected).abs() < 1e-14);
        }
        assert_eq!(inverse(&[[1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [0.0, 1.0, 1.0]]), None);
        let line = Chromaticities { green: [0.64, 0.33], ..Chromaticities::default() };
        assert_eq!(line.to_xyz(), None);
    }

    #[test]
    fn srgb_meets_its_corners() {
        assert_eq!(srgb_encode(0.0), 0.0);
        assert!((srgb_encode(1.0) - 1.0).abs() < 1e-6);
        assert!((srgb_encode(0.5) - 0.735_356_9).abs() < 1e-6);
        assert_eq!(srgb_encode(-0.5), -srgb_encode(0.5));
    }
}
