//! How good a mask is, as text, JSON and plots: its measures, its spectrum, coherences, and the spectrum of a frame.

use std::fmt;

use lacuna_filters::sampling::coherence::{Basis, Wavelet, fourier};
use lacuna_filters::sampling::measure::{self, Measures};
use lacuna_filters::sampling::spectrum::{self, Histogram, Spectrum};
use lacuna_filters::sampling::{Field, Pattern, Temporal, mask as generate};
use lacuna_filters::{Mask, Plane, Size};
use serde::Serialize;

use super::MakeError;
use super::plot::Plot;

/// The side of the images of figure 3.1 of the thesis.
const SIDE: usize = 64;
/// The widths of the blurs, in the Fourier domain.
const WIDTHS: [f64; 3] = [10.0, 20.0, 30.0];

/// What is said about a mask; what was not asked for is left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Judgement {
    /// Density, discrepancy, distances, holes.
    #[serde(flatten)]
    pub measures: Option<Measures>,
    /// Radially averaged power spectrum.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spectrum: Option<Spectrum>,
    /// Coherence of the mask's partial Fourier matrix.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fourier_coherence: Option<f64>,
    /// Coherences over densities, as figure 3.1.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub coherence: Vec<Coherence>,
    /// DFT magnitudes of a frame and its derivatives along x and y, as figure 3.2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub magnitudes: Option<[Histogram; 3]>,
}

/// The coherence of one sensing matrix over densities.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Coherence {
    /// `fourier`, or the wavelet.
    pub basis: &'static str,
    /// Width of the blur in the Fourier domain; nothing without a blur.
    pub sigma: Option<f64>,
    /// The mask's pattern.
    pub pattern: &'static str,
    /// Pairs of density and coherence.
    pub values: Vec<(f64, f64)>,
}

/// Measures a mask.
///
/// # Errors
/// A mask of 2^32 pixels or more.
pub fn judge(mask: &Mask) -> Result<Judgement, MakeError> {
    Ok(Judgement {
        measures: Some(measure::measure(mask)?),
        spectrum: Some(spectrum::of_mask(mask)),
        fourier_coherence: fourier(mask),
        ..Judgement::default()
    })
}

/// The coherences of figure 3.1: 64 x 64 pixels, shuffle (low discrepancy) and random masks, partial Fourier and
/// each wavelet with each blur and without, at these densities.
///
/// # Errors
/// A density that is not above 0 and at most 1.
pub fn coherences(densities: &[f64], seed: u64) -> Result<Vec<Coherence>, MakeError> {
    coherences_of(SIDE, densities, seed)
}

fn coherences_of(side: usize, densities: &[f64], seed: u64) -> Result<Vec<Coherence>, MakeError> {
    let field = Field { x: 0, y: 0, size: Size::new(side, side) };
    let mut masks = Vec::new();
    for pattern in [Pattern::Shuffle, Pattern::Random] {
        for &density in densities {
            masks.push((pattern, density, generate(pattern, field, density, seed, Temporal::Fixed, 0)?));
        }
    }
    let mut all = over(&masks, "fourier", None, |mask| Ok(fourier(mask)))?;
    for wavelet in Wavelet::ALL {
        for sigma in std::iter::once(None).chain(WIDTHS.map(Some)) {
            let basis = Basis::new(side, wavelet, sigma)?;
            all.extend(over(&masks, wavelet.name(), sigma, |mask| Ok(basis.coherence(mask)?))?);
        }
    }
    Ok(all)
}

fn over(
    masks: &[(Pattern, f64, Mask)],
    basis: &'static str,
    sigma: Option<f64>,
    coherence: impl Fn(&Mask) -> Result<Option<f64>, MakeError>,
) -> Result<Vec<Coherence>, MakeError> {
    let mut found: Vec<Coherence> = Vec::new();
    for (pattern, density, mask) in masks {
        let Some(value) = coherence(mask)? else { continue };
        if let Some(last) = found.last_mut().filter(|last| last.pattern == pattern.name()) {
            last.values.push((*density, value));
        } else {
            let values = vec![(*density, value)];
            found.push(Coherence { basis, sigma, pattern: pattern.name(), values });
        }
    }
    Ok(found)
}

/// The histograms of figure 3.2 of a plane.
pub fn magnitudes(plane: &Plane) -> [Histogram; 3] {
    spectrum::magnitudes(plane)
}

impl Judgement {
    /// The plot of what was asked for: the magnitudes, else the spectrum; nothing without either.
    pub fn plot(&self) -> Option<Plot> {
        if let Some(histograms) = &self.magnitudes {
            let most = histograms.iter().flat_map(|h| h.counts.iter().copied()).max().unwrap_or(1) as f64;
            let curve = |h: &Histogram| {
                let points = h.counts.iter().enumerate();
                points
                    .map(|(bin, count)| (h.from + h.step * (bin as f64 + 0.5), *count as f64 / most))
                    .collect()
            };
            return Some(Plot {
                titles: ["log10 of the magnitude", "share of the largest count"],
                x: (-10.0, 0.0),
                y: (0.0, 1.0),
                x_lines: (-10..=0).step_by(2).map(f64::from).collect(),
                y_lines: vec![0.0, 0.5, 1.0],
                curves: histograms.iter().map(curve).collect(),
            });
        }
        let spectrum = self.spectrum.as_ref()?;
        let rings = spectrum.radial.len() as f64;
        let top = spectrum.radial.iter().copied().fold(2.0, f64::max).ceil().min(10.0);
        let points = spectrum.radial.iter().enumerate();
        Some(Plot {
            titles: ["cycles per pixel", "power over that of random"],
            x: (0.0, 0.5),
            y: (0.0, top),
            x_lines: vec![0.0, 0.1, 0.2, 0.3, 0.4, 0.5],
            y_lines: (0..=top as u32).map(f64::from).collect(),
            curves: vec![points.map(|(ring, power)| ((ring as f64 + 0.5) / (2.0 * rings), *power)).collect()],
        })
    }
}

impl fmt::Display for Judgement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(m) = &self.measures {
            writeln!(f, "size                  {}x{}", m.width, m.height)?;
            writeln!(f, "measured              {} ({:.4} %)", m.measured, 100.0 * m.density)?;
            writeln!(f, "star discrepancy      {:.6}", m.star_discrepancy)?;
            if let Some(nearest) = &m.nearest {
                let (mean, deviation) = (nearest.mean, nearest.standard_deviation);
                writeln!(
                    f,
                    "nearest neighbour     least {:.3}, mean {mean:.3}, standard deviation {deviation:.3} pixels",
                    nearest.minimum
                )?;
            }
            if let Some(hole) = m.largest_hole {
                writeln!(f, "largest hole          {hole:.3} pixels (radius)")?;
            }
        }
        if let Some(coherence) = self.fourier_coherence {
            writeln!(f, "coherence (Fourier)   {coherence:.4}")?;
        }
        for line in &self.coherence {
            let sigma = line.sigma.map_or_else(|| "-".into(), |sigma| format!("{sigma}"));
            write!(f, "coherence {:13} blur {sigma:>3} {:8}", line.basis, line.pattern)?;
            for (density, value) in &line.values {
                write!(f, "  {density}: {value:.3}")?;
            }
            writeln!(f)?;
        }
        if let Some(histograms) = &self.magnitudes {
            for (name, histogram) in ["image", "d/dx", "d/dy"].iter().zip(histograms) {
                writeln!(f, "DFT magnitudes of {name:6} median 10^{:.2}", histogram.median())?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coherence_is_lowest_for_fourier_and_falls_with_density() {
        let all = coherences_of(16, &[0.3, 0.7], 1).unwrap();
        // 2 patterns for Fourier and for 4 wavelets with 4 blurs each.
        assert_eq!(all.len(), 2 * (1 + 4 * 4));
        let fourier = all.iter().find(|c| c.basis == "fourier" && c.pattern == "random").unwrap();
        for other in all.iter().filter(|c| c.basis != "fourier" && c.pattern == "random") {
            assert!(other.values[0].1 > fourier.values[0].1, "{other:?}");
        }
        for line in all.iter().filter(|c| c.pattern == "random") {
            assert!(line.values[0].1 >= line.values[1].1 - 1e-6, "{line:?}");
        }
    }

    #[test]
    fn a_judgement_is_told_in_lines_and_json() {
        let mask = Mask::from_fn(Size::new(8, 8), |y, x| (y + x) % 3 == 0);
        let judgement = judge(&mask).unwrap();
        let text = judgement.to_string();
        assert!(text.contains("star discrepancy") && text.contains("largest hole"), "{text}");
        let json = serde_json::to_value(&judgement).unwrap();
        assert_eq!(json["measured"], 21);
        let plot = judgement.plot().unwrap();
        assert!(plot.titles.iter().all(|title| !title.is_empty()));
    }
}
