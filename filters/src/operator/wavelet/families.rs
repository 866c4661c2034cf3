//! The wavelet families and their filter banks.

use super::taps;

/// A wavelet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Wavelet {
    /// Haar, 2 taps.
    Haar,
    /// Daubechies of this order, 2 to 10; twice as many taps.
    Daubechies(u8),
    /// Symlet of this order, 2 to 10; twice as many taps.
    Symlet(u8),
    /// Coiflet of this order, 1 to 5; six times as many taps.
    Coiflet(u8),
    /// Cohen, Daubechies and Feauveau, 9 and 7 taps, biorthogonal: the lossy wavelet of JPEG 2000.
    Cdf97,
}

/// Analysis and synthesis filters of one level, all of the same even length `f`.
///
/// Coefficient `k` of a line is `sum_j low[j] x[2 k + c - j]`, with `c` given by the boundary.
#[derive(Clone, Debug, PartialEq)]
pub struct Bank {
    /// Analysis, low-pass.
    pub low: Vec<f64>,
    /// Analysis, high-pass.
    pub high: Vec<f64>,
    /// Synthesis, low-pass.
    pub low_back: Vec<f64>,
    /// Synthesis, high-pass.
    pub high_back: Vec<f64>,
}

impl Wavelet {
    /// Every wavelet.
    pub fn all() -> Vec<Self> {
        let mut all = vec![Self::Haar];
        all.extend((2..=10).map(Self::Daubechies));
        all.extend((2..=10).map(Self::Symlet));
        all.extend((1..=5).map(Self::Coiflet));
        all.push(Self::Cdf97);
        all
    }

    /// Whether the analysis is an isometry (up to the boundary).
    pub fn is_orthonormal(self) -> bool {
        self != Self::Cdf97
    }

    /// The filters.
    pub fn bank(self) -> Bank {
        let low_back: Vec<f64> = match self {
            Self::Cdf97 => return cdf97(),
            Self::Haar => vec![std::f64::consts::FRAC_1_SQRT_2; 2],
            Self::Daubechies(order) | Self::Symlet(order @ ..=3) => daubechies(order),
            Self::Symlet(order) => symlet(order),
            Self::Coiflet(order) => coiflet(order),
        };
        let low: Vec<f64> = low_back.iter().rev().copied().collect();
        mirrored(low, low_back)
    }
}

/// The bank whose high-pass filters are the quadrature mirrors of the other side's low-pass filters.
fn mirrored(low: Vec<f64>, low_back: Vec<f64>) -> Bank {
    let sign = |odd: usize, (k, tap): (usize, &f64)| if k % 2 == odd { *tap } else { -tap };
    let high = low_back.iter().enumerate().map(|tap| sign(1, tap)).collect();
    let high_back = low.iter().enumerate().map(|tap| sign(0, tap)).collect();
    Bank { low, high, low_back, high_back }
}

fn daubechies(order: u8) -> Vec<f64> {
    match order {
        ..=2 => taps::DB2.to_vec(),
        3 => taps::DB3.to_vec(),
        4 => taps::DB4.to_vec(),
        5 => taps::DB5.to_vec(),
        6 => taps::DB6.to_vec(),
        7 => taps::DB7.to_vec(),
        8 => taps::DB8.to_vec(),
        9 => taps::DB9.to_vec(),
        _ => taps::DB10.to_vec(),
    }
}

fn symlet(order: u8) -> Vec<f64> {
    match order {
        ..=4 => taps::SYM4.to_vec(),
        5 => taps::SYM5.to_vec(),
        6 => taps::SYM6.to_vec(),
        7 => taps::SYM7.to_vec(),
        8 => taps::SYM8.to_vec(),
        9 => taps::SYM9.to_vec(),
        _ => taps::SYM10.to_vec(),
    }
}

fn coiflet(order: u8) -> Vec<f64> {
    match order {
        ..=1 => taps::COIF1.to_vec(),
        2 => taps::COIF2.to_vec(),
        3 => taps::COIF3.to_vec(),
        4 => taps::COIF4.to_vec(),
        _ => taps::COIF5.to_vec(),
    }
}

/// Source: A. Cohen, I. Daubechies, J.-C. Feauveau, "Biorthogonal bases of compactly supported wavelets", Communications on
/// Pure and Applied Mathematics 45, 1992 (table 6.2); half of each symmetric filter, the middle first.
fn cdf97() -> Bank {
    const NINE: [f64; 5] = [
        0.852_698_679_008_893_8,
        0.377_402_855_612_830_66,
        -0.110_624_404_418_437_18,
        -0.023_849_465_019_556_843,
        0.037_828_455_507_264_04,
    ];
    const SEVEN: [f64; 4] = [
        0.788_485_616_405_582_9,
        0.418_092_273_221_617_24,
        -0.040_689_417_609_164_06,
        -0.064_538_882_628_697_06,
    ];
    // The middle at index 5 of 10 (analysis) and 4 of 10 (synthesis).
    let unfold = |half: &[f64], middle: usize| -> Vec<f64> {
        (0..10).map(|k: usize| half.get(k.abs_diff(middle)).copied().unwrap_or(0.0)).collect()
    };
    mirrored(unfold(&NINE, 5), unfold(&SEVEN, 4))
}

impl std::fmt::Display for Wavelet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Haar => f.write_str("haar"),
            Self::Daubechies(order) => write!(f, "db{order}"),
            Self::Symlet(order) => write!(f, "sym{order}"),
            Self::Coiflet(order) => write!(f, "coif{order}"),
            Self::Cdf97 => f.write_str("cdf97"),
        }
    }
}

impl std::str::FromStr for Wavelet {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::all()
            .into_iter()
            .find(|wavelet| wavelet.to_string() == text)
            .ok_or_else(|| "wavelets are haar, db2 to db10, sym2 to sym10, coif1 to coif5 and cdf97".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bank is a perfect pair: the shifts of the synthesis filters are dual to those of the analysis filters.
    #[test]
    fn filters_are_dual_and_low_passes_sum_to_the_root_of_two() {
        for wavelet in Wavelet::all() {
            let bank = wavelet.bank();
            let length = bank.low.len() as isize;
            let product = |a: &[f64], b: &[f64], shift: isize| -> f64 {
                // Analysis filters run against the signal, synthesis filters along it.
                let at = |k: isize| {
                    let index = length - 1 - k + shift;
                    (0..length).contains(&index).then(|| a[index as usize])
                };
                (0..length).filter_map(|k| at(k).map(|a| a * b[k as usize])).sum()
            };
            for shift in (-length + 2..length).step_by(2) {
                let one = if shift == 0 { 1.0 } else { 0.0 };
                let pairs = [
                    (&bank.low, &bank.low_back, one),
                    (&bank.high, &bank.high_back, one),
                    (&bank.low, &bank.high_back, 0.0),
                    (&bank.high, &bank.low_back, 0.0),
                ];
                for (a, b, expected) in pairs {
                    assert!((product(a, b, shift) - expected).abs() < 2e-12, "{wavelet} {shift}");
                }
            }
            for sum in [bank.low.iter().sum::<f64>(), bank.low_back.iter().sum()] {
                assert!((sum - std::f64::consts::SQRT_2).abs() < 1e-12, "{wavelet} {sum}");
            }
        }
    }

    #[test]
    fn names_come_back() {
        for wavelet in Wavelet::all() {
            assert_eq!(wavelet.to_string().parse(), Ok(wavelet));
        }
        assert!("db11".parse::<Wavelet>().is_err());
        assert_eq!(Wavelet::all().len(), 25);
    }
}
