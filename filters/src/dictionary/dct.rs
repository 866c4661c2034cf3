//! The overcomplete discrete cosine transform as a dictionary.
//!
//! In one dimension `C(i, j) = cos(pi i j / N)` for `i = 0..M-1`, `j = 0..N-1`. The atoms over `M x M` blocks are the `N^2`
//! products `C(y, v) C(x, u)`, the columns of the Kronecker product of `C` with itself. Each but the constant one loses its mean,
//! and all get length 1.
//!
//! Source: X. Liu, "Compressive Volume Rendering", equation 4.1; M. Elad, "Sparse and Redundant Representations", 2010.

use ndarray::Array2;

use super::{Dictionary, Invalid};

/// The atoms over blocks of one channel: the least square number of them that is not below `atoms`.
///
/// # Errors
/// [`Invalid::Range`].
pub fn dictionary(block: usize, atoms: usize) -> Result<Dictionary, Invalid> {
    let count = (1..=super::MOST_ATOMS).find(|side| side * side >= atoms).unwrap_or(super::MOST_ATOMS);
    let block = block.min(super::MOST_BLOCK + 1);
    // What is refused is not computed first.
    let count = if count * count > super::MOST_ATOMS { super::MOST_ATOMS + 1 } else { count * count };
    let side = count.isqrt();
    let cosine = |i: usize, j: usize| (std::f64::consts::PI * (i * j) as f64 / side as f64).cos();
    let pixels = block * block;
    let mut atoms = Array2::zeros((count, if count > super::MOST_ATOMS { 0 } else { pixels }));
    for (at, mut atom) in atoms.rows_mut().into_iter().enumerate() {
        let (v, u) = (at / side, at % side);
        let product = |pixel: usize| cosine(pixel / block, v) * cosine(pixel % block, u);
        let raw: Vec<f64> = (0..atom.len()).map(product).collect();
        let mean = if at == 0 { 0.0 } else { raw.iter().sum::<f64>() / pixels as f64 };
        let length = raw.iter().map(|x| (x - mean).powi(2)).sum::<f64>().sqrt();
        let constant = (pixels as f64).sqrt().recip();
        for (x, raw) in atom.iter_mut().zip(&raw) {
            // In a block of one pixel, everything is constant.
            *x = if length > 1e-9 { (raw - mean) / length } else { constant } as f32;
        }
    }
    Dictionary::new(block, 1, atoms)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn atoms_are_those_of_the_formula() {
        let dictionary = dictionary(16, 1024).unwrap();
        assert_eq!((dictionary.len(), dictionary.dimension()), (1024, 256));
        // The matrix of equation 4.1 with its indices from 1, its Kronecker product, mean and length.
        let c = |i: usize, j: usize| (std::f64::consts::PI / 32.0 * ((i - 1) * (j - 1)) as f64).cos();
        for atom in [0_usize, 1, 31, 32, 33, 517, 1023] {
            let (v, u) = (atom / 32 + 1, atom % 32 + 1);
            let raw: Vec<f64> = (0..256).map(|p| c(p / 16 + 1, v) * c(p % 16 + 1, u)).collect();
            let mean = if atom == 0 { 0.0 } else { raw.iter().sum::<f64>() / 256.0 };
            let norm = raw.iter().map(|x| (x - mean).powi(2)).sum::<f64>().sqrt();
            for (found, raw) in dictionary.atom(atom).iter().zip(&raw) {
                let expected = (raw - mean) / norm;
                assert!((f64::from(*found) - expected).abs() <= f64::from(f32::EPSILON), "{atom}");
            }
            let mean = dictionary.atom(atom).iter().map(|x| f64::from(*x)).sum::<f64>() / 256.0;
            assert!(atom == 0 || mean.abs() < f64::from(f32::EPSILON), "{atom}: {mean}");
        }
    }

    #[test]
    fn sizes_are_rounded_up_to_squares_and_refused_beyond_the_bounds() {
        assert_eq!(dictionary(4, 17).unwrap().len(), 25);
        assert_eq!(dictionary(1, 4).unwrap().atom(3), [1.0]);
        assert!(dictionary(0, 4).is_err());
        assert!(dictionary(65, 4).is_err());
        assert!(dictionary(2, crate::dictionary::MOST_ATOMS + 1).is_err());
    }
}
