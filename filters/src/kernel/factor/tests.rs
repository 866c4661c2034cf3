//! What is packed, and which pixels are found free; the products are tested with the passes that use them.

use super::super::simd::{Lanes, Vectored, vectors};
use super::*;

struct Halves<'a, T>(&'a [T]);

impl<T: Real> Vectored<T> for Halves<'_, T> {
    type Output = Vec<(T, T)>;
    fn run<V: Vector<Number = T>>(self) -> Vec<(T, T)> {
        let mut pairs = Vec::new();
        for block in self.0.chunks_exact(V::LANES) {
            let (upper, lower) = V::load(block).halves();
            let mut lanes = [[T::ZERO; MOST]; 2];
            upper.store(&mut lanes[0]);
            lower.store(&mut lanes[1]);
            pairs.extend((0..V::LANES).map(|k| (lanes[0][k], lanes[1][k])));
        }
        pairs
    }
}

/// Numbers of many sizes and both signs come back from every instruction set, rounded to half their bits.
fn numbers_come_back<T: Lanes>(digits: i32) {
    let value = |k: i32| (f64::from(k) * 0.77).sin() * 10.0_f64.powi(k % 9 - 4);
    let pairs: Vec<(f64, f64)> =
        (0..64).map(|k| (value(k), if k % 5 == 0 { 0.0 } else { value(k + 90) })).collect();
    let packed: Vec<T> =
        pairs.iter().map(|&(upper, lower)| T::packed(T::from_f64(upper), T::from_f64(lower))).collect();
    for isa in Isa::all() {
        for (found, expected) in vectors(isa, Halves(&packed)).into_iter().zip(&pairs) {
            for (found, expected) in [(found.0, expected.0), (found.1, expected.1)] {
                let error = (found.to_f64() - expected).abs();
                assert!(error <= expected.abs() * 0.5_f64.powi(digits), "{isa:?} {found:?} {expected}");
            }
        }
    }
}

#[test]
fn two_numbers_fit_in_one() {
    numbers_come_back::<f32>(8);
    numbers_come_back::<f64>(20);
}

#[test]
fn patterns_say_which_pixels_are_free() {
    let (stride, rows) = (48, 9);
    let free = |k: usize| (k * 7919) % 11 < 6;
    let e: Vec<f32> = (0..stride * rows).map(|k| f32::from(u8::from(free(k)))).collect();
    let start = 4 * stride;
    for isa in Isa::all() {
        let mut line = vec![0; stride];
        patterns(isa, &e, (start, stride), &mut line);
        for (j, &pattern) in line.iter().enumerate() {
            let at = start + j;
            for (bit, (up, right)) in BEFORE.into_iter().chain([(0, 0)]).enumerate() {
                let place = (at - up * stride).wrapping_add_signed(right);
                assert_eq!(pattern >> bit & 1 == 1, free(place), "{isa:?} {j} {bit}");
            }
        }
    }
}
