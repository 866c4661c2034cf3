//! Against the normal equations in f64, solved by elimination with pivots.

use proptest::prelude::*;

use super::nodes::{Between, Fit, Node, record};
use super::*;
use crate::kernel::simd::vectors;

/// A pixel's sum of weights and prediction from the definition.
fn reference(
    samples: &Samples,
    channels: usize,
    centres: &Centres,
    lane: usize,
    scales: &Scales,
    leave_out: bool,
) -> (f64, Vec<f64>) {
    let guides = scales.bandwidths.len();
    let slopes: Vec<usize> = (0..guides).filter(|&guide| scales.slopes[guide]).collect();
    let order = slopes.len() + 1;
    let mut system = vec![vec![0.0; order + channels]; order];
    for index in 0..samples.at.len() {
        let difference = |guide: usize| {
            f64::from(samples.guides[index * guides + guide]) - f64::from(centres.guides[guide].0[lane])
        };
        let square: f64 = (0..2)
            .map(|axis| (f64::from(samples.at[index][axis]) - f64::from(centres.at[axis].0[lane])).powi(2))
            .sum();
        if leave_out && square == 0.0 {
            continue;
        }
        let near = (1.0 - square * f64::from(centres.inverse.0[lane])).max(0.0).powi(2);
        let sum: f64 = (0..guides).map(|g| (f64::from(scales.bandwidths[g]) * difference(g)).powi(2)).sum();
        let mut weight = near / (1.0 + sum).powi(4);
        if samples.labels.get(index).is_some_and(|label| *label != centres.labels[lane]) {
            weight *= f64::from(FOREIGN);
        }
        weight *= samples.weights.get(index).map_or(1.0, |own| f64::from(*own));
        let row: Vec<f64> = slopes.iter().map(|&guide| difference(guide)).chain([1.0]).collect();
        for a in 0..order {
            for (entry, other) in system[a].iter_mut().zip(&row) {
                *entry += weight * row[a] * other;
            }
            for channel in 0..channels {
                system[a][order + channel] +=
                    weight * row[a] * f64::from(samples.values[index * channels + channel]);
            }
        }
    }
    let total = system[order - 1][order - 1];
    for (a, row) in system.iter_mut().enumerate().take(order - 1) {
        row[a] += f64::from(RIDGE);
    }
    for a in 0..order {
        let pivot = (a..order).max_by(|&i, &j| system[i][a].abs().total_cmp(&system[j][a].abs())).unwrap();
        system.swap(a, pivot);
        for b in 0..order {
            if b != a {
                let factor = system[b][a] / system[a][a];
                let row = system[a].clone();
                system[b].iter_mut().zip(row).for_each(|(to, from)| *to -= factor * from);
            }
        }
    }
    let last = &system[order - 1];
    (total, (0..channels).map(|channel| last[order + channel] / last[order - 1]).collect())
}

/// Samples and pixels from a seed.
fn scene(seed: u64, count: usize, guides: usize, channels: usize) -> (Samples, Centres) {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1 << 24) as f32
    };
    let mut samples = Samples::default();
    for _ in 0..count {
        samples.at.push([(next() * 12.0).floor(), (next() * 12.0).floor()]);
        samples.guides.extend((0..guides).map(|_| next()));
        samples.values.extend((0..channels).map(|_| 3.0 + next()));
        samples.labels.push(u32::from(next() > 0.3));
    }
    let mut lanes = |scale: f32| Lanes(std::array::from_fn(|_| (next() * scale).floor()));
    let at = [lanes(12.0), lanes(12.0)];
    let centres = Centres {
        at,
        inverse: Lanes([1.0 / 64.0; LANES]),
        guides: (0..guides).map(|_| Lanes(std::array::from_fn(|_| next()))).collect(),
        labels: std::array::from_fn(|_| u32::from(next() > 0.3)),
    };
    (samples, centres)
}

fn run(
    isa: Isa,
    samples: &Samples,
    channels: usize,
    centres: &Centres,
    scales: &Scales,
    leave_out: bool,
) -> (Lanes, Vec<Lanes>) {
    let mut out = vec![Lanes::ZERO; channels];
    let runs = [(0, samples.at.len())];
    let mut table = Table::new(scales, channels);
    table.fill(isa, samples, &runs);
    let mut scratch = Scratch::default();
    let regress =
        Regress { table: &table, runs: &runs, centres, leave_out, scratch: &mut scratch, out: &mut out };
    (vectors(isa, regress), out)
}

proptest! {
    #[test]
    fn predictions_are_those_of_the_normal_equations(
        seed in 0_u64..1000, guides in 0..7_usize, channels in 1..5_usize, leave_out: bool, dropped in 0..7_usize, counted: bool,
    ) {
        let (mut samples, centres) = scene(seed, 60, guides, channels);
        if counted {
            samples.weights = (0..60).map(|k| (k % 4) as f32 / 1.5).collect();
        }
        let mut scales = Scales { bandwidths: vec![1.5; guides], slopes: vec![true; guides], ridge: RIDGE };
        if dropped < guides {
            scales.slopes[dropped] = false;
            scales.bandwidths[dropped] = 0.0;
        }
        for isa in [Isa::Portable, Isa::Avx2, Isa::Avx512] {
            let (weights, found) = run(isa, &samples, channels, &centres, &scales, leave_out);
            for lane in 0..LANES {
                let (weight, expected) = reference(&samples, channels, &centres, lane, &scales, leave_out);
                let found_weight = f64::from(weights.0[lane]);
                prop_assert!((found_weight - weight).abs() <= 60.0 * f64::from(f32::EPSILON) * 60.0);
                if weight <= 1e-3 {
                    continue;
                }
                for (found, expected) in found.iter().zip(expected) {
                    // Values lie within 1 of each other; predictions end 0.25 beyond. Rounding of sums of 60 terms grows
                    // by the condition, which the ridge bounds by the largest entry over it.
                    let bounded = expected.clamp(2.75, 4.25);
                    let tolerance = 60.0 * f64::from(f32::EPSILON) * 1.0e3;
                    if (3.0..=4.0).contains(&bounded) {
                        prop_assert!((f64::from(found.0[lane]) - bounded).abs() <= tolerance, "{} {}", found.0[lane], bounded);
                    }
                }
            }
        }
    }
}

#[test]
fn a_colour_that_follows_the_guides_is_found() {
    let (mut samples, centres) = scene(7, 80, 3, 2);
    samples.labels.clear();
    let colour =
        |guides: &[f32], channel: usize| 0.3 + guides[0] * 0.5 - guides[1] * 0.2 + channel as f32 * guides[2];
    for index in 0..samples.at.len() {
        for channel in 0..2 {
            samples.values[index * 2 + channel] = colour(&samples.guides[index * 3..][..3], channel);
        }
    }
    let scales = Scales { bandwidths: vec![1.0; 3], slopes: vec![true; 3], ridge: RIDGE };
    let (weights, found) = run(Isa::best(), &samples, 2, &centres, &scales, false);
    for lane in (0..LANES).filter(|&lane| weights.0[lane] > 0.5) {
        let guides = [0, 1, 2].map(|guide| centres.guides[guide].0[lane]);
        for (channel, found) in found.iter().enumerate() {
            // The ridge alone is in the way.
            assert!((found.0[lane] - colour(&guides, channel)).abs() < 2e-2, "{lane}");
        }
    }
}

#[test]
fn constants_stay_and_nothing_near_says_so() {
    let (mut samples, mut centres) = scene(3, 40, 2, 1);
    samples.values.fill(0.1);
    let scales = Scales { bandwidths: vec![1.0; 2], slopes: vec![true; 2], ridge: RIDGE };
    let (_, found) = run(Isa::best(), &samples, 1, &centres, &scales, false);
    assert_eq!(found[0].0, [0.1; LANES]);
    samples.values[0] = 0.2;
    centres.at[0] = Lanes([1000.0; LANES]);
    let (weights, _) = run(Isa::best(), &samples, 1, &centres, &scales, false);
    assert_eq!(weights, Lanes::ZERO);
}

proptest! {
    /// Four nodes of a square, and a row of pixels between them, by regressions at the nodes for each pixel's guides.
    #[test]
    fn nodes_predict_in_linear_proportion(
        seed in 0_u64..1000, guides in 0..7_usize, channels in 1..11_usize, row in 0..8_usize,
    ) {
        const STEP: usize = 8;
        let (mut samples, _) = scene(seed, 80, guides, channels);
        samples.labels.clear();
        let pixels: Vec<Vec<f32>> =
            (0..guides).map(|g| (0..=STEP).map(|p| samples.guides[(7 * g + p) * guides]).collect()).collect();
        let scales = Scales { bandwidths: vec![0.0; guides], slopes: vec![true; guides], ridge: RIDGE };
        let (inverse, runs) = (1.0 / 144.0, [(0, 30), (30, samples.at.len())]);
        let nodes: Vec<Node> = [[0, 0], [0, STEP], [STEP, 0], [STEP, STEP]]
            .map(|at| Node { at: at.map(|at| at as f32), inverse, runs: 0..2 })
            .into();
        for isa in [Isa::Portable, Isa::Avx2, Isa::Avx512] {
            let mut table = Table::new(&scales, channels);
            table.fill(isa, &samples, &[(0, samples.at.len())]);
            let mut records = vec![0.0; nodes.len() * record(&table)];
            let mut scratch = Scratch::default();
            vectors(isa, Fit {
                table: &table, runs: &runs, nodes: &nodes, scratch: &mut scratch, records: &mut records,
            });
            let mut values = vec![vec![0.0; STEP + 1]; channels];
            let mut out: Vec<&mut [f32]> = values.iter_mut().map(Vec::as_mut_slice).collect();
            let guide_rows: Vec<&[f32]> = pixels.iter().map(Vec::as_slice).collect();
            let (above, below) = records.split_at(2 * record(&table));
            dispatch(isa, Between {
                table: &table,
                records: [above, below],
                part: row as f32 / STEP as f32,
                step: STEP,
                guides: &guide_rows,
                wanted: &[true; STEP + 1],
                line: &mut Vec::new(),
                out: &mut out,
            });
            for pixel in 0..=STEP {
                let by_node = |node: &Node| {
                    let centres = Centres {
                        at: node.at.map(|at| Lanes([at; LANES])),
                        inverse: Lanes([inverse; LANES]),
                        guides: pixels.iter().map(|guide| Lanes([guide[pixel]; LANES])).collect(),
                        labels: [0; LANES],
                    };
                    reference(&samples, channels, &centres, 0, &scales, false).1
                };
                let (y, x) = (row as f64 / STEP as f64, pixel as f64 / STEP as f64);
                let parts = [(1.0 - y) * (1.0 - x), (1.0 - y) * x, y * (1.0 - x), y * x];
                let predicted: Vec<Vec<f64>> = nodes.iter().map(by_node).collect();
                for (channel, values) in values.iter().enumerate() {
                    let expected: f64 = parts.iter().zip(&predicted).map(|(part, node)| part * node[channel]).sum();
                    let tolerance = 80.0 * f64::from(f32::EPSILON) * 1.0e3;
                    if (3.0..=4.0).contains(&expected) {
                        let found = f64::from(values[pixel]);
                        prop_assert!((found - expected).abs() <= tolerance, "{found} {expected}");
                    }
                }
            }
        }
    }
}

#[test]
fn nodes_keep_constants_and_say_where_nothing_is_near() {
    let (mut samples, _) = scene(3, 40, 2, 1);
    samples.labels.clear();
    samples.values.fill(0.1);
    let scales = Scales { bandwidths: vec![0.0; 2], slopes: vec![true; 2], ridge: RIDGE };
    let runs = [(0, samples.at.len())];
    let mut table = Table::new(&scales, 1);
    table.fill(Isa::best(), &samples, &runs);
    let node = |at: f32| Node { at: [at, at], inverse: 1.0 / 64.0, runs: 0..1 };
    let nodes = [node(5.0), node(1000.0)];
    let mut records = vec![0.0; 2 * record(&table)];
    let mut scratch = Scratch::default();
    vectors(
        Isa::best(),
        Fit { table: &table, runs: &runs, nodes: &nodes, scratch: &mut scratch, records: &mut records },
    );
    let mut values = [0.0; 2];
    let guides = [[0.3, 0.9], [0.1, 0.2]];
    dispatch(
        Isa::best(),
        Between {
            table: &table,
            records: [&records; 2],
            part: 0.0,
            step: 1,
            guides: &[&guides[0], &guides[1]],
            wanted: &[true; 2],
            line: &mut Vec::new(),
            out: &mut [&mut values],
        },
    );
    assert_eq!(values[0], 0.1);
    assert!(values[1].is_nan());
}
