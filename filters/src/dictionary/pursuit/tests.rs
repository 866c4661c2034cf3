//! Both pursuits against a slow one in f64 that solves the least-squares problem anew in every step.

use ndarray::Array2;
use proptest::prelude::*;

use super::*;
use crate::dictionary::masked::Masked;
use crate::dictionary::{Dictionary, dct};

/// Numbers in -1..1 that a seed picks.
pub fn noise(seed: u64, count: usize) -> Vec<f32> {
    let unit = |at| (lacuna_core::hash(seed, at) >> 11) as f64 / (1_u64 << 53) as f64;
    (0..count as u64).map(|at| (2.0 * unit(at) - 1.0) as f32).collect()
}

/// A dictionary of random atoms.
pub fn random(block: usize, channels: usize, atoms: usize, seed: u64) -> Dictionary {
    let dimension = channels * block * block;
    let mut values = noise(seed, atoms * dimension);
    for atom in values.chunks_mut(dimension) {
        let length = atom.iter().map(|x| x * x).sum::<f32>().sqrt();
        for x in atom {
            *x /= length;
        }
    }
    Dictionary::new(block, channels, Array2::from_shape_vec((atoms, dimension), values).unwrap()).unwrap()
}

/// Solves the symmetric system by elimination with pivots.
fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|i, j| a[*i][k].abs().total_cmp(&a[*j][k].abs())).unwrap();
        a.swap(k, pivot);
        b.swap(k, pivot);
        for i in k + 1..n {
            let (above, below) = a.split_at_mut(i);
            let factor = below[0][k] / above[k][k];
            below[0].iter_mut().zip(&above[k]).for_each(|(x, pivot)| *x -= factor * pivot);
            b[i] -= factor * b[k];
        }
    }
    for k in (0..n).rev() {
        let known: f64 = (k + 1..n).map(|j| a[k][j] * b[j]).sum();
        b[k] = (b[k] - known) / a[k][k];
    }
    b
}

/// The pursuit as its definition has it. Also the margin: by how much of itself the weakest choice beat the next best.
fn brute_force(
    dictionary: &Dictionary,
    y: &[f32],
    measured: &[bool],
    sparsity: usize,
) -> (Vec<(u32, f64)>, f64) {
    let rows: Vec<usize> = (0..y.len()).filter(|i| measured[i % (y.len() / dictionary.channels())]).collect();
    let atom = |k: usize| rows.iter().map(move |i| f64::from(dictionary.atom(k)[*i]));
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let atoms: Vec<Vec<f64>> = (0..dictionary.len()).map(|k| atom(k).collect()).collect();
    let target: Vec<f64> = rows.iter().map(|i| f64::from(y[*i])).collect();
    let mut residual = target.clone();
    let (mut support, mut factors): (Vec<usize>, Vec<f64>) = (Vec::new(), Vec::new());
    let mut margin = f64::INFINITY;
    for _ in 0..sparsity {
        let strength = |k: usize| product(&atoms[k], &residual).abs() / product(&atoms[k], &atoms[k]).sqrt();
        let mut order: Vec<usize> = (0..atoms.len()).filter(|k| !support.contains(k)).collect();
        order.sort_by(|a, b| strength(*b).total_cmp(&strength(*a)));
        let Some(&best) = order.first() else { break };
        if strength(best) <= 1e-4 * product(&target, &target).sqrt() {
            break;
        }
        if let Some(&second) = order.get(1) {
            margin = margin.min(1.0 - strength(second) / strength(best));
        }
        support.push(best);
        let normal =
            support.iter().map(|i| support.iter().map(|j| product(&atoms[*i], &atoms[*j])).collect());
        let right = support.iter().map(|i| product(&atoms[*i], &target)).collect();
        factors = solve(normal.collect(), right);
        residual.clone_from(&target);
        for (k, x) in support.iter().zip(&factors) {
            residual.iter_mut().zip(&atoms[*k]).for_each(|(r, d)| *r -= x * d);
        }
    }
    (support.into_iter().map(|k| k as u32).zip(factors).collect(), margin)
}

/// By the Gram matrix of what is measured.
fn by_gram(dictionary: &Dictionary, y: &[f32], measured: &[bool], sparsity: usize) -> Code {
    let mut atoms = dictionary.atoms().clone();
    for mut atom in atoms.rows_mut() {
        atom.iter_mut()
            .enumerate()
            .for_each(|(i, x)| *x *= f32::from(u8::from(measured[i % measured.len()])));
    }
    let y: Vec<f32> =
        y.iter().enumerate().map(|(i, y)| if measured[i % measured.len()] { *y } else { 0.0 }).collect();
    let mut products: Vec<f32> =
        atoms.rows().into_iter().map(|atom| atom.iter().zip(&y).map(|(a, b)| a * b).sum()).collect();
    let energy = y.iter().map(|y| f64::from(*y).powi(2)).sum();
    let shared = Shared::new(&atoms, 0.0);
    shared.code(&mut products, energy, &Selection::atoms(sparsity), &mut Scratch::default())
}

/// By stepping together with other blocks.
fn together(dictionary: &Dictionary, y: &[f32], measured: &[bool], sparsity: usize) -> Code {
    let n = y.len();
    let measured: Vec<f32> = measured.iter().map(|flag| f32::from(u8::from(*flag))).collect();
    // The block in question between one that is empty and one that is done early.
    let values = Array2::from_shape_fn((3, n), |(row, i)| match row {
        0 => 0.0,
        1 => y[i] * measured[i % measured.len()],
        _ => dictionary.atom(0)[i],
    });
    let flags =
        Array2::from_shape_fn((3, measured.len()), |(row, i)| if row == 1 { measured[i] } else { 1.0 });
    let masked = Masked::new(dictionary);
    let selection = Selection::atoms(sparsity);
    let codes = masked.codes(&values, &flags, &[selection, selection, Selection::atoms(1)]);
    assert!(codes[0].is_empty());
    assert!(codes[2].len() == 1 && codes[2][0].0 == 0 && (codes[2][0].1 - 1.0).abs() < 1e-5);
    codes[1].clone()
}

fn agree(dictionary: &Dictionary, y: &[f32], measured: &[bool], sparsity: usize) {
    let (expected, margin) = brute_force(dictionary, y, measured, sparsity);
    let size = y.iter().map(|y| y * y).sum::<f32>().sqrt();
    for code in [by_gram(dictionary, y, measured, sparsity), together(dictionary, y, measured, sparsity)] {
        // Where two atoms are as good as each other, rounding decides; the code need not be the same then.
        if margin < 1e-3 {
            continue;
        }
        let atoms = |code: &mut dyn Iterator<Item = u32>| code.collect::<Vec<_>>();
        assert_eq!(atoms(&mut code.iter().map(|c| c.0)), atoms(&mut expected.iter().map(|c| c.0)));
        for (found, expected) in code.iter().zip(&expected) {
            assert!((f64::from(found.1) - expected.1).abs() <= 2e-3 * f64::from(size), "{margin}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn full_and_masked_blocks_get_the_code_of_the_slow_twin(
        seed in any::<u64>(), block in 3..6_usize, channels in 1..4_usize, over in 1..4_usize, density in 3..10_u64,
    ) {
        let n = channels * block * block;
        let dictionary = random(block, channels, over * n, seed);
        let y = noise(seed ^ 1, n);
        let measured: Vec<bool> =
            (0..block * block).map(|i| i == 0 || lacuna_core::hash(seed ^ 2, i as u64) % 10 < density).collect();
        let known = channels * measured.iter().filter(|flag| **flag).count();
        agree(&dictionary, &y, &measured, (known / 3).clamp(1, 8));
        agree(&dictionary, &y, &vec![true; block * block], (n / 3).min(8));
    }
}

#[test]
fn sparse_sums_come_back() {
    let dictionary = random(6, 3, 200, 5);
    let mut y = vec![0.0; dictionary.dimension()];
    let expected = [(17, 3.0), (150, -2.0), (4, 1.5), (99, 1.0)];
    dictionary.sum(&expected, &mut y);
    for code in [by_gram(&dictionary, &y, &[true; 36], 9), together(&dictionary, &y, &[true; 36], 9)] {
        assert_eq!(code.len(), 4, "no more than there are");
        for ((atom, factor), expected) in code.iter().zip(expected) {
            assert_eq!(*atom, expected.0);
            assert!((factor - expected.1).abs() < 1e-4);
        }
    }
}

#[test]
fn stops_at_the_error_bound_and_before_atoms_that_say_nothing_new() {
    let dct = dct::dictionary(4, 16).unwrap();
    // Every atom twice.
    let twice = ndarray::concatenate(ndarray::Axis(0), &[dct.atoms().view(), dct.atoms().view()]).unwrap();
    let dictionary = Dictionary::new(4, 1, twice).unwrap();
    let y = noise(3, 16);
    let full = by_gram(&dictionary, &y, &[true; 16], 32);
    assert!(full.len() <= 16, "{full:?}");
    assert_eq!(by_gram(&dictionary, &y, &[true; 16], usize::MAX), full);
    let energy: f64 = y.iter().map(|y| f64::from(*y).powi(2)).sum();
    let shared = Shared::new(dictionary.atoms(), 0.0);
    let mut products: Vec<f32> = (0..32).map(|k| crate::kernel::dense::dot(dictionary.atom(k), &y)).collect();
    let selection = Selection { error: 0.2 * energy, ..Selection::atoms(32) };
    let code = shared.code(&mut products, energy, &selection, &mut Scratch::default());
    let mut sum = vec![0.0; 16];
    let error = |code: &Code, sum: &mut Vec<f32>| {
        dictionary.sum(code, sum);
        sum.iter().zip(&y).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>()
    };
    assert!(error(&code, &mut sum) <= 0.2001 * energy);
    assert!(error(&code[..code.len() - 1].to_vec(), &mut sum) > 0.2 * energy || code.len() > 1);
    assert!(code.len() < full.len());
}

#[test]
fn atoms_that_are_hardly_measured_are_not_taken() {
    let n = 16;
    let atoms = Array2::from_shape_fn((2, n), |(k, i)| match (k, i) {
        (0, 0) => 0.05,
        (0, 15) => 0.9987,
        (1, 0 | 1) => 0.5_f32.sqrt(),
        _ => 0.0,
    });
    let dictionary = Dictionary::new(4, 1, atoms).unwrap();
    let masked = Masked::new(&dictionary);
    let flags = Array2::from_shape_fn((1, n), |(_, i)| f32::from(u8::from(i < 2)));
    let values = Array2::from_shape_fn((1, n), |(_, i)| f32::from(u8::from(i < 1)));
    let code = |floor| {
        let selection = Selection { floor, ..Selection::atoms(1) };
        masked.codes(&values, &flags, &[selection]).remove(0)
    };
    assert_eq!(code(0.0)[0].0, 0);
    assert_eq!(code(0.01)[0].0, 1);
}
