//! Predictions at some of the measured pixels, chosen so that they speak for all.

use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use super::fit::{Store, Task, Worker, parts, side};
use crate::{Mask, Plane, Planes, Size};

/// A cell whose marked pixels are predicted, and what each of them counts for.
#[derive(Clone, Debug)]
pub struct Probe {
    rows: Range<usize>,
    columns: Range<usize>,
    weight: f64,
}

/// About `count` cells of those that have marked pixels. A cell is the more likely chosen, the more its pixels differ, which is where errors are; what
/// it counts for makes up for that, so that sums over chosen cells are those over all, on average. Half of the chance is the same for all.
///
/// Source: W. G. Madow, "On the theory of systematic sampling, II", Annals of Mathematical Statistics 20, 1949 (unequal probabilities).
pub fn probes(
    wanted: &Mask,
    values: &Planes,
    weight: impl Fn(usize) -> f64 + Sync,
    count: f64,
) -> Vec<Probe> {
    let Size { height, width } = wanted.size();
    let side = side(wanted);
    let cells: Vec<_> = parts(0..height, side)
        .flat_map(|rows| parts(0..width, side).map(move |columns| (rows.clone(), columns)))
        .collect();
    let spread = |(rows, columns): &(Range<usize>, Range<usize>)| {
        let pixels = rows.clone().flat_map(|row| columns.clone().map(move |column| row * width + column));
        let marked: Vec<usize> = pixels.filter(|&pixel| wanted.as_slice()[pixel]).collect();
        let of = |plane: &Plane| {
            let values = || marked.iter().map(|&pixel| f64::from(plane.pixels()[pixel]));
            let mean = values().sum::<f64>() / marked.len() as f64;
            let squares = values().zip(&marked).map(|(value, &pixel)| weight(pixel) * (value - mean).powi(2));
            squares.sum::<f64>()
        };
        let spread = values.as_slice().iter().map(of).sum::<f64>().sqrt();
        (!marked.is_empty()).then(|| if spread.is_finite() { spread } else { 0.0 })
    };
    let spreads: Vec<Option<f64>> = cells.par_iter().map(spread);
    let marked = spreads.iter().flatten().count() as f64;
    let mean = spreads.iter().flatten().sum::<f64>() / marked.max(1.0);
    // Where nothing differs, all are alike.
    let even = if mean > 0.0 { mean } else { 1.0 };
    // Where there are few, all.
    let step = if marked > count { (mean + even) * marked / count } else { 0.0 };
    let mut next = 0.5 * step;
    let mut chosen = Vec::new();
    for ((rows, columns), spread) in cells.into_iter().zip(spreads) {
        let Some(chance) = spread.map(|spread| spread + even) else { continue };
        if next <= chance {
            chosen.push(Probe { rows, columns, weight: (step / chance).max(1.0) });
            next += if step > 0.0 { step * ((chance - next) / step).floor() + step } else { chance };
        }
        next -= chance;
    }
    chosen
}

/// Predictions at some pixels.
#[derive(Debug, Default)]
pub struct Found {
    /// Where they stand in a plane.
    pub at: Vec<usize>,
    /// What each counts for.
    pub weights: Vec<f64>,
    /// Their channels, all of a pixel together.
    pub values: Vec<f32>,
}

/// Predicts pixels that are marked in `wanted`: those of the chosen cells.
pub fn probe(store: &Store, task: Task<'_>, wanted: &Mask, cells: &[Probe]) -> Found {
    let width = store.size.width;
    let found = cells.into_par_iter().map_init(
        || Worker::new(store, task),
        |work, Probe { rows, columns, weight }| {
            let mut found = Found::default();
            work.open(rows, columns);
            work.cell(wanted, (rows.clone(), columns.clone()), |[row, column], out, lane| {
                found.at.push(row * width + column);
                found.weights.push(*weight);
                found.values.extend(out.iter().map(|out| out.0[lane]));
            });
            found
        },
    );
    let mut all = Found::default();
    for found in found {
        all.at.extend(found.at);
        all.weights.extend(found.weights);
        all.values.extend(found.values);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size::new(240, 320);

    /// A bright line on an even ground, a fifth of the pixels.
    fn line() -> (Mask, Planes) {
        let value = |row: usize, column: usize| if row == 100 && column > 40 { 1.0 } else { 0.25 };
        let mask = Mask::from_fn(SIZE, |row, column| (row + 2 * column).is_multiple_of(5));
        (mask, Planes::new(SIZE, vec![Plane::from_fn(SIZE, value)]).unwrap())
    }

    #[test]
    fn chosen_cells_speak_for_all_and_those_that_differ_are_among_them() {
        let (mask, values) = line();
        let probes = probes(&mask, &values, |_| 1.0, 60.0);
        assert!((30..=60).contains(&probes.len()), "{}", probes.len());
        let cells = (SIZE.height.div_ceil(side(&mask)) * SIZE.width.div_ceil(side(&mask))) as f64;
        let sum: f64 = probes.iter().map(|probe| probe.weight).sum();
        assert!((sum / cells - 1.0).abs() < 0.1, "{sum} of {cells}");
        let on_line = probes.iter().filter(|probe| probe.rows.contains(&100) && probe.columns.end > 42);
        // A sixteenth of the cells, nearly half of those that are chosen.
        assert!(on_line.count() * 3 > probes.len());
    }

    #[test]
    fn few_cells_are_all_chosen_and_count_once() {
        let (mask, values) = line();
        let probes = probes(&mask, &values, |_| 1.0, 1e6);
        assert_eq!(probes.len(), SIZE.height.div_ceil(side(&mask)) * SIZE.width.div_ceil(side(&mask)));
        assert!(probes.iter().all(|probe| (probe.weight - 1.0).abs() < f64::EPSILON));
        let blank = Planes::zeros(SIZE, 1);
        assert_eq!(super::probes(&mask, &blank, |_| 1.0, 100.0).len(), 100);
    }
}
