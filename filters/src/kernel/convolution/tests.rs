//! Layers against sums in f64, on every instruction set, and the sets against each other.

#![allow(clippy::float_cmp, reason = "where bits are promised, bits are compared")]

use super::*;

/// Numbers in [-1, 1] that look random.
fn noise(count: usize, seed: u64) -> Vec<f32> {
    (0..count as u64).map(|i| (lacuna_core::hash(seed, i) >> 40) as f32 / (1 << 23) as f32 - 1.0).collect()
}

/// Planes of noise.
fn maps(rows: usize, columns: usize, count: usize) -> Maps {
    let mut maps = Maps::default();
    maps.resize((rows, columns), count);
    let values = noise(rows * columns * count, 3);
    for ((plane, row), values) in
        (0..count).flat_map(|plane| (0..rows).map(move |row| (plane, row))).zip(values.chunks_exact(columns))
    {
        maps.row_mut(plane, row).copy_from_slice(values);
    }
    maps
}

/// The value of a layer at a place, and the sum of its terms' magnitudes.
fn exact(
    (weights, bias): (&[f32], &[f32]),
    from: &Maps,
    (output, row, column): (usize, usize, usize),
    activation: Activation,
) -> (f64, f64) {
    let inputs = weights.len() / (9 * bias.len());
    let (mut sum, mut size) = (f64::from(bias[output]), f64::from(bias[output].abs()));
    for (input, dy, dx) in
        (0..inputs).flat_map(|i| (0..3).flat_map(move |dy| (0..3).map(move |dx| (i, dy, dx))))
    {
        let y = (row + dy).saturating_sub(1).min(from.rows - 1);
        let x = (column + dx).saturating_sub(1).min(from.columns - 1);
        let term = f64::from(weights[((output * inputs + input) * 3 + dy) * 3 + dx])
            * f64::from(from.row(input, y)[x]);
        (sum, size) = (sum + term, size + term.abs());
    }
    if activation == Activation::ResidualRelu {
        let own = f64::from(from.row(output, row)[column]);
        (sum, size) = (sum + own, size + own.abs());
    }
    (if activation == Activation::Linear { sum } else { sum.max(0.0) }, size)
}

#[test]
fn layers_are_sums_over_windows_on_every_instruction_set() {
    let cases = [
        (17, 24, Activation::Relu),
        (24, 24, Activation::ResidualRelu),
        (24, 4, Activation::Linear),
        (3, 12, Activation::Linear),
    ];
    for ((inputs, outputs, activation), (rows, columns)) in cases
        .into_iter()
        .flat_map(|case| [(1, 1), (2, 3), (5, 17), (3, 50), (2, 90)].map(|size| (case, size)))
    {
        let (weights, bias) = (noise(outputs * inputs * 9, 1), noise(outputs, 2));
        let layer = Layer::new(&weights, &bias);
        assert_eq!(layer.outputs(), outputs);
        // All of some rows, a part of others, and none.
        let runs: Vec<Vec<_>> = (0..rows)
            .map(|row| match row % 3 {
                0 => std::iter::once(0..columns).collect(),
                1 => {
                    [0..columns / 3, columns / 2..columns].into_iter().filter(|run| !run.is_empty()).collect()
                }
                _ => Vec::new(),
            })
            .collect();
        let made: Vec<Maps> = Isa::all()
            .map(|isa| {
                let (mut from, mut to) = (maps(rows, columns, inputs), Maps::default());
                to.resize((rows, columns), outputs);
                let mut room = Room::default();
                let (layer, from, room) = (&layer, &mut from, &mut room);
                convolve(isa, Convolve { layer, from, to: &mut to, runs: &runs, room, activation });
                to
            })
            .collect();
        let from = maps(rows, columns, inputs);
        for (row, run) in
            runs.iter().enumerate().flat_map(|(row, runs)| runs.iter().map(move |run| (row, run)))
        {
            for (output, column) in (0..outputs).flat_map(|output| run.clone().map(move |x| (output, x))) {
                let (exact, size) = exact((&weights, &bias), &from, (output, row, column), activation);
                // As many roundings as terms.
                let bound = f64::from(f32::EPSILON) * (9 * inputs + 2) as f64 * size;
                let found = made.iter().map(|made| made.row(output, row)[column]);
                found
                    .clone()
                    .for_each(|found| assert!((f64::from(found) - exact).abs() <= bound, "{found} {exact}"));
                // The first one does not fuse.
                let fused: Vec<f32> = found.skip(1).collect();
                assert!(fused.iter().all(|value| *value == fused[0]));
            }
        }
    }
}
