//! Planted dictionaries, the error, threads, and training in two goes.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::*;
use crate::baseline::testing::with_threads;
use crate::dictionary::pursuit::tests::{noise, random};
use lacuna_core::hash;

/// `count` blocks, each the sum of `sparsity` atoms, with white noise at so many decibels.
fn planted(dictionary: &Dictionary, count: usize, sparsity: usize, decibels: f64, seed: u64) -> Vec<f32> {
    let n = dictionary.dimension();
    let mut blocks = vec![0.0; count * n];
    for (at, block) in blocks.chunks_mut(n).enumerate() {
        let order = Permutation::new(dictionary.len() as u64, hash(seed, at as u64));
        let factors = gaussian(hash(seed ^ 1, at as u64), sparsity);
        let code: Vec<(u32, f32)> =
            factors.iter().enumerate().map(|(k, x)| (order.apply(k as u64) as u32, *x)).collect();
        dictionary.sum(&code, block);
        let noise = gaussian(hash(seed ^ 2, at as u64), n);
        let level = (squared(block) / squared(&noise) / 10_f64.powf(decibels / 10.0)).sqrt() as f32;
        block.iter_mut().zip(noise).for_each(|(x, noise)| *x += level * noise);
    }
    blocks
}

/// Nearly normal numbers: sums of twelve uniform ones.
fn gaussian(seed: u64, count: usize) -> Vec<f32> {
    noise(seed, 12 * count).chunks(12).map(|chunk| chunk.iter().sum::<f32>() / 2.0).collect()
}

/// 20 numbers a block, as in the paper.
fn small(atoms: usize, sparsity: usize, iterations: usize) -> Settings {
    Settings { block: 2, channels: 5, atoms, sparsity, iterations, seed: 7, approximate: false }
}

fn train(blocks: &[f32], settings: &Settings) -> State {
    learn(blocks, settings, None, &Run::default(), |_| {}).unwrap()
}

/// The part of the planted atoms that is found to `1 - |product| < 0.01`.
fn recovered(planted: &Dictionary, found: &State) -> f64 {
    let products = planted.atoms().dot(&found.atoms.t());
    let hits = products.rows().into_iter().filter(|row| row.iter().any(|p| p.abs() > 0.99)).count();
    hits as f64 / planted.len() as f64
}

/// Rounding of residuals that are computed anew, for blocks that are as long as their codes' factors or shorter.
fn never_increases(errors: &[f64], scale: f64) {
    for pair in errors.windows(2) {
        assert!(pair[1] <= pair[0] + 8.0 * f64::from(f32::EPSILON) * scale, "{errors:?}");
    }
}

/// Over eight dictionaries, as the paper has its means over trials: a single one may end in a local minimum.
#[test]
fn planted_atoms_are_found_at_20_decibels() {
    for approximate in [false, true] {
        let part = |seed| {
            let truth = random(2, 5, 50, seed);
            let blocks = planted(&truth, 1500, 3, 20.0, seed);
            let state = train(&blocks, &Settings { approximate, ..small(50, 3, 80) });
            never_increases(&state.errors, 1.0);
            recovered(&truth, &state)
        };
        let parts: Vec<f64> = (1..9).map(part).collect();
        assert!(parts.iter().sum::<f64>() >= 0.9 * 8.0, "{parts:?}, approximate {approximate}");
        assert!(parts.iter().all(|part| *part >= 0.8), "{parts:?}, approximate {approximate}");
    }
}

#[test]
fn the_error_never_increases_whatever_the_blocks() {
    for (seed, approximate) in [(1, false), (2, true), (3, false), (4, true)] {
        // Noise, with every fifth block black and every seventh a copy: atoms go unused and become twins.
        let mut blocks = noise(seed, 300 * 20);
        for at in 0..300 {
            if at % 5 == 0 {
                blocks[at * 20..][..20].fill(0.0);
            } else if at % 7 == 0 {
                blocks.copy_within(20..40, at * 20);
            }
        }
        let settings = Settings { seed, approximate, ..small(120, 4, 25) };
        let state = train(&blocks, &settings);
        assert_eq!(state.errors.len(), 25);
        never_increases(&state.errors, 1.0);
        assert!(state.errors[24] < 0.9 * state.errors[0]);
        // The state says the truth: codes are short, atoms have length 1, the error is theirs.
        let dictionary = Dictionary::new(2, 5, state.atoms.clone()).unwrap();
        let mut sum = vec![0.0; 20];
        let mut error = 0.0;
        for (block, code) in blocks.chunks(20).zip(&state.codes) {
            assert!(code.len() <= 4);
            dictionary.sum(code, &mut sum);
            error += sum.iter().zip(block).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        }
        let error = (error / 6000.0).sqrt();
        assert!((error - state.errors[24]).abs() < 1e-5 * error, "{error} {:?}", state.errors);
        assert!(usage(&state.codes, 120).iter().all(|count| *count > 0));
    }
}

#[test]
fn twins_are_told_apart() {
    let truth = random(2, 5, 30, 9);
    let blocks = planted(&truth, 600, 2, 60.0, 3);
    let mut state = train(&blocks, &small(30, 2, 1));
    // Every second atom is made its neighbour, codes and all.
    for at in (1..30).step_by(2) {
        let twin = state.atoms.row(at - 1).to_owned();
        state.atoms.row_mut(at).assign(&twin);
    }
    let settings = small(30, 2, 30);
    let state = learn(&blocks, &settings, Some(state), &Run::default(), |_| {}).unwrap();
    let dictionary = Dictionary::new(2, 5, state.atoms.clone()).unwrap();
    let twins = dictionary.coherences().iter().filter(|coherence| **coherence > 0.999).count();
    assert_eq!(twins, 0);
    never_increases(&state.errors[1..], 1.0);
}

/// A block that a refused twin does not become is left for the next atom.
#[test]
fn unused_atoms_become_blocks_that_twins_refuse() {
    let settings = small(3, 1, 1);
    let unit = |at: usize| Array2::from_shape_fn((1, 20), |(_, i)| f32::from(u8::from(i == at)));
    let near = 0.995 * unit(0) + (1.0_f32 - 0.995 * 0.995).sqrt() * unit(1);
    let atoms =
        ndarray::concatenate(ndarray::Axis(0), &[unit(0).view(), near.view(), unit(5).view()]).unwrap();
    let parts = [100.0 * unit(0), 100.0 * &near, 100.0 * &near, 3.0 * unit(7)];
    let blocks: Vec<f32> = parts.iter().flatten().copied().collect();
    let codes = vec![vec![(0, 100.0)], vec![(1, 100.0)], vec![(1, 100.0)], Code::new()];
    let mut residuals = vec![0.0; 80];
    residuals[67] = 3.0;
    let mut work = Work { settings: &settings, blocks: &blocks, dimension: 20, atoms, codes, residuals };
    let shared = Shared::new(&work.atoms, 0.0);
    work.replace(&shared);
    assert_eq!(work.atoms.row(0), unit(0).row(0), "handing over costs more than the block gains");
    assert_eq!(work.codes[3], [(2, 3.0)]);
    assert!(work.residuals.iter().all(|left| *left == 0.0));
}

#[test]
fn threads_and_breaks_change_no_bit() {
    let blocks = planted(&random(2, 5, 60, 4), 700, 3, 20.0, 5);
    let settings = small(64, 3, 6);
    let whole = with_threads(1, || train(&blocks, &settings));
    assert_eq!(whole, with_threads(3, || train(&blocks, &settings)));
    let asked = AtomicUsize::new(0);
    let after_two = || (asked.fetch_add(1, Ordering::Relaxed) == 2).then_some(Stop::Cancelled);
    let run = Run { interrupt: Some(&after_two) };
    let mut told = 0;
    let part = learn(&blocks, &settings, None, &run, |_| told += 1).unwrap();
    assert_eq!((part.stop, part.errors.len(), told), (Stop::Cancelled, 2, 2));
    assert_eq!(learn(&blocks, &settings, Some(part), &Run::default(), |_| {}).unwrap(), whole);
    let finished = train(&blocks, &small(64, 3, 4));
    assert_eq!(learn(&blocks, &settings, Some(finished), &Run::default(), |_| {}).unwrap(), whole);
}

#[test]
fn what_cannot_be_learned_is_refused() {
    let blocks = noise(1, 40 * 20);
    let refused = |settings: &Settings, start| {
        let result = learn(&blocks, settings, start, &Run::default(), |_| {});
        assert!(matches!(result, Err(Error::Setting { .. })), "{settings:?}");
    };
    refused(&small(41, 3, 1), None);
    refused(&small(0, 3, 1), None);
    refused(&small(10, 0, 1), None);
    refused(&small(10, 11, 1), None);
    refused(&Settings { block: 0, ..small(10, 3, 1) }, None);
    refused(&Settings { channels: 9, ..small(10, 3, 1) }, None);
    let mut other = train(&blocks, &small(10, 3, 1));
    refused(&small(11, 3, 1), Some(other.clone()));
    other.codes[3] = vec![(10, 1.0)];
    refused(&small(10, 3, 1), Some(other));
}
