//! Products with windows against plain sums over the matrix's entries.

use super::*;
use crate::operator::energy::Form;
use crate::operator::profile::Kernel;

/// Every instruction set against a plain sum over the matrix's entries, on windows at and away from the borders.
fn check<T: Lanes>(epsilon: f64) {
    for (order, kernel) in [(2, Kernel::Bspline), (3, Kernel::Bspline), (2, Kernel::Piecewise)] {
        for (height, width) in [(1, 1), (1, 40), (5, 3), (40, 5), (41, 50)] {
            let a = Form::new(kernel, order, 0.01).energy(Size::new(height, width), (1.0, 2.0));
            let windows = [
                Window { y: 0, x: 0, height, width },
                Window { y: height / 4, x: width / 3, height: height - height / 2, width: width - width / 2 },
            ];
            for window in windows {
                for isa in Isa::all() {
                    compare::<T>(isa, &a, window, epsilon);
                }
            }
        }
    }
}

fn compare<T: Lanes>(isa: Isa, a: &Separable<f64>, window: Window, epsilon: f64) {
    let (mut p, mut q) = (window.zeros::<T>(), window.zeros::<T>());
    let cells: Vec<(usize, usize)> =
        (0..window.height).flat_map(|i| (0..window.width).map(move |j| (i, j))).collect();
    for &(i, j) in &cells {
        p[window.at(i, j)] = T::from_f64(((i * 31 + j * 17) as f64 * 0.37).sin());
    }
    let dot = apply(isa, &a.cast::<T>(), window, &p, None, &mut q);
    let (mut expected_dot, mut scale) = (0.0, 0.0);
    for &(i, j) in &cells {
        let here = (window.y + i, window.x + j);
        let (mut sum, mut size) = (0.0, 0.0);
        for &(k, l) in &cells {
            let entry = a.entry(here, (window.y + k, window.x + l));
            assert!(
                (entry - a.entry((window.y + k, window.x + l), here)).abs()
                    <= 1e-12 * a.diagonal(here.0, here.1).max(1.0)
            );
            sum += entry * p[window.at(k, l)].to_f64();
            size += entry.abs();
        }
        let value = q[window.at(i, j)].to_f64();
        assert!((value - sum).abs() <= 64.0 * epsilon * size, "{isa:?} {window:?} {i} {j}: {value} {sum}");
        expected_dot += sum * p[window.at(i, j)].to_f64();
        scale += size;
    }
    assert!((dot - expected_dot).abs() <= 64.0 * epsilon * scale, "{dot} {expected_dot}");
}

/// Rows of a window, with what lies around them in its buffer.
#[test]
fn a_part_reads_its_surroundings() {
    let a = Form::new(Kernel::Bspline, 2, 0.01).energy(Size::new(40, 21), (1.0, 1.0));
    let window = Window { y: 0, x: 0, height: 40, width: 21 };
    let mut p = window.zeros::<f64>();
    for i in 0..40 {
        for j in 0..21 {
            p[window.at(i, j)] = ((i * 31 + j * 17) as f64 * 0.37).sin();
        }
    }
    for isa in Isa::all() {
        let mut whole = window.zeros();
        apply(isa, &a, window, &p, None, &mut whole);
        for (y, height) in [(0, 1), (0, 7), (3, 12), (33, 7), (39, 1), (12, 20)] {
            let part = Window { y, height, ..window };
            let mut q = part.zeros();
            apply(isa, &a, part, &p[y * window.stride()..], None, &mut q);
            for i in 0..height {
                let (own, all) = (&q[part.at(i, 0)..][..21], &whole[window.at(y + i, 0)..][..21]);
                for (own, all) in own.iter().zip(all) {
                    assert!((own - all).abs() <= 256.0 * f64::EPSILON * a.diagonal(y + i, 10), "{y} {i}");
                }
            }
        }
    }
}

#[test]
fn every_instruction_set_computes_the_matrix_in_f64() {
    check::<f64>(f64::EPSILON);
}

#[test]
fn every_instruction_set_computes_the_matrix_in_f32() {
    check::<f32>(f64::from(f32::EPSILON));
}
