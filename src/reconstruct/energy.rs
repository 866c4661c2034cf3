//! Whether filled pixels have the light that measured ones lead to expect.
//!
//! Where samples are spread without regard to the picture, missing pixels of a block have the mean of its measured ones but for chance;
//! samples that are denser in some blocks than in others by more than chance may well follow the picture, and say nothing.
//! With `d_b` the light that the filled pixels of block b have beyond that, the sum of all `d_b` has a variance of about the sum of their
//! squares if they are independent and of mean 0, whatever the picture and however pixels of a block depend on each other.

use std::ops::Range;

use lacuna_core::Size;
use lacuna_core::parallel::prelude::*;
use lacuna_filters::Mask;
use serde::Serialize;

use super::GroupReport;

/// Edge of a block in pixels: at 1 % it has ten samples.
const BLOCK: usize = 32;
/// Standard deviations that are no chance.
const DEVIATIONS: f64 = 4.0;
/// The mean square of what a block has too many samples, over that of random ones, from which they are not evenly spread.
const UNEVEN: f64 = 2.0;
/// So much more than chance explains is told: by less the line would seem to refute itself.
const BEYOND: f64 = 1.25;
/// What nobody sees, whether it is chance or not.
const LEAST: f64 = 0.01;

/// Decimals of a per cent, at most.
const DECIMALS: usize = 6;

/// Light of filled pixels that differs from what measured ones lead to expect by more than chance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Energy {
    /// The mean of filled pixels over that of the measured pixels around them.
    pub ratio: f64,
    /// How far from 1 chance could bring it.
    pub chance: f64,
}

/// Compares all channels of a group together; nothing where chance could explain the difference.
pub fn compare(planes: &[(&[f32], &[f32])], mask: &Mask) -> Option<Energy> {
    let Size { width, height } = mask.size();
    let density = mask.count() as f64 / mask.as_slice().len() as f64;
    let (mut excess, mut squares, mut expected) = (0.0, 0.0, 0.0);
    let (mut uneven, mut blocks) = (0.0, 0.0);
    let rows = (0..height.div_ceil(BLOCK)).into_par_iter().map(|row| {
        let rows = row * BLOCK..height.min((row + 1) * BLOCK);
        let block = |left| light(planes, mask, (rows.clone(), left..width.min(left + BLOCK)));
        (0..width).step_by(BLOCK).map(block).collect::<Vec<_>>()
    });
    for [(filled, missing), (measured, count)] in rows.into_iter().flatten() {
        let all = (missing + count) as f64;
        uneven += (count as f64 - density * all).powi(2) / (all * density * (1.0 - density));
        blocks += 1.0;
        if missing > 0 && count > 0 {
            let should = measured / count as f64 * missing as f64;
            excess += filled - should;
            squares += (filled - should).powi(2);
            expected += should;
        }
    }
    if uneven > UNEVEN * blocks || expected <= 0.0 {
        return None;
    }
    let (ratio, chance) = (1.0 + excess / expected, DEVIATIONS * squares.sqrt() / expected);
    ((ratio - 1.0).abs() > (BEYOND * chance).max(LEAST)).then_some(Energy { ratio, chance })
}

/// The light of a block's missing and measured pixels, of all channels together, and how many pixels these are.
fn light(
    planes: &[(&[f32], &[f32])],
    mask: &Mask,
    (rows, columns): (Range<usize>, Range<usize>),
) -> [(f64, usize); 2] {
    let width = mask.size().width;
    let mut of = [(0.0_f64, 0_usize); 2];
    for row in rows {
        for at in row * width + columns.start..row * width + columns.end {
            let measured = mask.as_slice()[at];
            let light = |&(samples, values): &(&[f32], &[f32])| {
                f64::from(if measured { samples[at] } else { values[at] })
            };
            let (sum, count) = &mut of[usize::from(measured)];
            *sum += planes.iter().map(light).sum::<f64>();
            *count += 1;
        }
    }
    of
}

/// What is to be said of a group's light.
pub fn note(group: &GroupReport) -> Option<String> {
    let Energy { ratio, chance } = group.energy?;
    let less = if ratio < 1.0 { "less" } else { "more" };
    let [found, chance] = percents([(ratio - 1.0).abs(), chance]);
    Some(format!(
        "{}: filled pixels have {found} % {less} light than the measured ones around them, where chance explains {chance} %",
        group.names()
    ))
}

/// Two shares in per cent, with as many decimals as tell them apart.
fn percents(shares: [f64; 2]) -> [String; 2] {
    let texts = |decimals: usize| shares.map(|share| format!("{:.decimals$}", 100.0 * share));
    (0..DECIMALS).map(texts).find(|[a, b]| a != b).unwrap_or_else(|| texts(DECIMALS))
}

#[cfg(test)]
mod tests {
    use lacuna_filters::sampling::shuffle;

    use super::*;

    const SIZE: Size = Size { width: 320, height: 320 };

    fn found(truth: impl Fn(usize, usize) -> f32, lost: f32) -> Option<Energy> {
        found_with(&shuffle::mask(0, 0, SIZE, 0.2, 1).unwrap(), truth, lost)
    }

    fn found_with(mask: &Mask, truth: impl Fn(usize, usize) -> f32, lost: f32) -> Option<Energy> {
        let values: Vec<f32> = (0..SIZE.pixels()).map(|at| truth(at % 320, at / 320)).collect();
        let filled: Vec<f32> = values.iter().map(|value| value * (1.0 - lost)).collect();
        compare(&[(&values, &filled)], mask)
    }

    #[test]
    fn lost_light_is_told_from_chance() {
        let smooth = |x: usize, y: usize| 1.0 + (x as f32 * 0.05).sin() * (y as f32 * 0.03).cos();
        // Lights of one pixel, which samples hit or miss.
        let lights =
            |x: usize, y: usize| if (x * 7919 + y * 104_729).is_multiple_of(97) { 50.0 } else { 0.1 };
        assert_eq!(found(smooth, 0.0), None);
        assert_eq!(found(lights, 0.0), None);
        assert_eq!(found(smooth, 0.005), None);
        for truth in [&smooth as &dyn Fn(usize, usize) -> f32, &lights] {
            let ratio = found(truth, 0.33).unwrap().ratio;
            assert!((ratio - 0.67).abs() < 0.1, "{ratio}");
        }
        // Samples that follow the picture lead to expect nothing.
        let half = Mask::from_fn(SIZE, |y, x| (x * 31 + y * 17) % if x < 160 { 2 } else { 10 } == 0);
        assert_eq!(found_with(&half, smooth, 0.33), None);
        // Chance is passed by far or not at all.
        for Energy { ratio, chance } in (1..60).filter_map(|lost| found(lights, lost as f32 / 100.0)) {
            assert!((ratio - 1.0).abs() > 1.25 * chance, "{ratio} {chance}");
        }
        // One light that nothing else tells of is chance.
        assert_eq!(found(|x, y| if (x, y) == (100, 100) { 1e4 } else { 0.1 }, 0.0), None);
    }

    /// A warning must not look as if it refuted itself.
    #[test]
    fn numbers_are_told_as_exactly_as_they_differ() {
        assert_eq!(percents([0.33, 0.02]), ["33", "2"]);
        assert_eq!(percents([0.0149, 0.0121]), ["1.5", "1.2"]);
        assert_eq!(percents([0.01049, 0.01041]), ["1.05", "1.04"]);
    }
}
