//! The filters on images whose blocks are known sums of atoms, and what every filter promises.

use super::*;
use crate::Size;
use crate::baseline::testing::with_threads;
use crate::dictionary::pursuit::tests::random;

fn learned(dictionary: &Arc<Dictionary>, how: Use) -> Learned {
    Learned { dictionary: Some(Arc::clone(dictionary)), name: "test".into(), how }
}

/// Planes of blocks with two atoms each, laid side by side.
fn image(dictionary: &Dictionary, rows: usize, columns: usize) -> Planes {
    let (block, pixels) = (dictionary.block(), dictionary.block() * dictionary.block());
    let size = Size::new(rows * block, columns * block);
    let mut planes = Planes::zeros(size, dictionary.channels());
    let mut values = vec![0.0; dictionary.dimension()];
    for at in 0..rows * columns {
        let atom = |k: u64| (lacuna_core::hash(k, at as u64) % dictionary.len() as u64) as u32;
        dictionary.sum(&[(atom(1), 2.0 + at as f32), (atom(2), -1.5)], &mut values);
        for (plane, values) in planes.as_mut_slice().iter_mut().zip(values.chunks(pixels)) {
            for (row, values) in values.chunks(block).enumerate() {
                plane.row_mut(at / columns * block + row)[at % columns * block..][..block]
                    .copy_from_slice(values);
            }
        }
    }
    planes
}

fn run(filter: &dyn Filter, mask: &Arc<Mask>, samples: &Planes) -> Planes {
    let plan = filter.plan(&Problem::fill(Arc::clone(mask)), &Run::default()).unwrap();
    let mut out = Planes::zeros(samples.size(), samples.len());
    let outcome = plan.reconstruct(samples, &mut out, &Run::default()).unwrap();
    assert_eq!(outcome, Outcome::direct());
    out
}

fn distance(a: &Planes, b: &Planes) -> f32 {
    let planes = a.as_slice().iter().zip(b.as_slice());
    let differences = planes.flat_map(|(a, b)| a.pixels().iter().zip(b.pixels()).map(|(a, b)| (a - b).abs()));
    differences.fold(0.0, f32::max)
}

fn some(size: Size, of_ten: u64) -> Arc<Mask> {
    Arc::new(Mask::from_fn(size, |y, x| lacuna_core::hash(y as u64, x as u64) % 10 < of_ten))
}

#[test]
fn sums_of_two_atoms_come_back_from_half_of_the_pixels() {
    for channels in [1, 3] {
        let dictionary = Arc::new(random(8, channels, 100, 3));
        let truth = image(&dictionary, 5, 4);
        let mask = some(truth.size(), 5);
        let how = Use { stride: Some(8), ..Use::default() };
        let filled = run(&learned(&dictionary, how), &mask, &truth);
        assert!(distance(&filled, &truth) < 1e-3, "{}", distance(&filled, &truth));
        for (out, truth) in filled.as_slice().iter().zip(truth.as_slice()) {
            for ((out, truth), measured) in out.pixels().iter().zip(truth.pixels()).zip(mask.as_slice()) {
                assert!(!measured || out.to_bits() == truth.to_bits());
            }
        }
        let restored = run(&learned(&dictionary, Use { restore: true, ..how }), &mask, &truth);
        assert!(distance(&restored, &truth) < 1e-3 && restored != filled);
    }
}

#[test]
fn a_repeating_mask_gives_what_stepping_together_gives() {
    let dictionary = Arc::new(random(8, 1, 40, 5));
    let truth = image(&dictionary, 6, 7);
    let size = truth.size();
    // The same pattern in each block, and one pixel more in the first, which keeps that block out of the group.
    let periodic = |y: usize, x: usize| lacuna_core::hash(y as u64 % 8, x as u64 % 8) % 10 < 4;
    let mask = Arc::new(Mask::from_fn(size, |y, x| periodic(y, x) || (y, x) == (0, 0)));
    let how = Use { stride: Some(8), sparsity: 4, ..Use::default() };
    let problem = Problem::fill(Arc::clone(&mask));
    let mut plan = Planned::new(Arc::clone(&dictionary), how, &problem).unwrap();
    assert_eq!(plan.shared.len(), 1);
    let mut shared = Planes::zeros(size, 1);
    plan.reconstruct(&truth, &mut shared, &Run::default()).unwrap();
    plan.group.fill(None);
    let mut alone = Planes::zeros(size, 1);
    plan.reconstruct(&truth, &mut alone, &Run::default()).unwrap();
    assert!(distance(&shared, &alone) < 1e-3, "{}", distance(&shared, &alone));
}

#[test]
fn images_of_every_size_are_filled_with_finite_values() {
    let dictionary = Arc::new(random(8, 1, 70, 1));
    for size in [(1, 1), (1, 30), (30, 1), (7, 9), (8, 8), (17, 31), (40, 40)] {
        let size = Size::new(size.0, size.1);
        let samples = Plane::from_fn(size, |y, x| (y * 3 + x) as f32);
        let samples = Planes::new(size, vec![samples]).unwrap();
        // One pixel alone: most blocks of the largest have none.
        for mask in [some(size, 4), Arc::new(Mask::from_fn(size, |y, x| (y, x) == (0, 0)))] {
            if mask.is_empty() {
                continue;
            }
            for filter in [&learned(&dictionary, Use::default()) as &dyn Filter, &Cosines::default()] {
                let filled = run(filter, &mask, &samples);
                assert!(filled.as_slice()[0].pixels().iter().all(|value| value.is_finite()));
            }
        }
    }
}

#[test]
fn constants_stay_constants_with_cosines() {
    let size = Size::new(50, 37);
    let samples = Planes::new(size, vec![Plane::filled(size, 0.7); 2]).unwrap();
    let filled = run(&Cosines::default(), &some(size, 3), &samples);
    assert!(distance(&filled, &samples) < 1e-4);
}

#[test]
fn threads_and_unmeasured_values_change_no_bit() {
    let dictionary = Arc::new(random(8, 3, 120, 2));
    let truth = image(&dictionary, 9, 13);
    let mask = some(truth.size(), 4);
    let filter = learned(&dictionary, Use::default());
    let one = with_threads(1, || run(&filter, &mask, &truth));
    assert_eq!(one, with_threads(3, || run(&filter, &mask, &truth)));
    let mut holes = truth.clone();
    for plane in holes.as_mut_slice() {
        let pixels = plane.pixels_mut().iter_mut().zip(mask.as_slice());
        pixels.filter(|(_, measured)| !**measured).for_each(|(x, _)| *x = f32::NAN);
    }
    assert_eq!(one, run(&filter, &mask, &holes));
}

#[test]
fn settings_out_of_range_are_refused() {
    let dictionary = Arc::new(random(8, 3, 20, 2));
    let problem = Problem::fill(some(Size::new(20, 20), 4));
    for how in [
        Use { sparsity: 0, ..Use::default() },
        Use { stride: Some(0), ..Use::default() },
        Use { stride: Some(9), ..Use::default() },
        Use { error: -1.0, ..Use::default() },
        Use { error: f64::NAN, ..Use::default() },
    ] {
        let refused = learned(&dictionary, how).plan(&problem, &Run::default());
        assert!(matches!(refused, Err(Error::Setting { .. })), "{how:?}");
    }
    let empty = Problem::fill(some(Size::new(20, 20), 0));
    assert!(matches!(
        learned(&dictionary, Use::default()).plan(&empty, &Run::default()),
        Err(Error::EmptyMask)
    ));
    let most = Use { sparsity: usize::MAX, ..Use::default() };
    let plan = learned(&dictionary, most).plan(&problem, &Run::default()).unwrap();
    let two = Planes::zeros(Size::new(20, 20), 2);
    let refused = plan.reconstruct(&two, &mut two.clone(), &Run::default());
    assert!(matches!(refused, Err(Error::SizeMismatch { .. })));
    assert!(Cosines { block: 65, ..Cosines::default() }.plan(&problem, &Run::default()).is_err());
}
