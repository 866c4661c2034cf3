//! The rows of the factor against the equations that define them, in f64.

use super::*;
use crate::Size;
use crate::kernel::Real;
use crate::operator::energy::Form;
use crate::operator::profile::Kernel;

/// With `g` the row of pixel `k`, `A g` is zero at the pixels before it that are free, and `g_k (A g)_k = 1`.
fn check(size: Size, window: Window) {
    let a = Form::new(Kernel::Bspline, 3, 0.03).energy(size, (1.0, 1.0));
    let mut e = window.zeros::<f32>();
    for i in 0..window.height {
        for j in 0..window.width {
            e[window.at(i, j)] = f32::from(u8::from((i * 5 + j * 3 + i * j) % 7 > 1));
        }
    }
    let mut planes: [Vec<f32>; PLANES] = std::array::from_fn(|_| vec![f32::NAN; window.len()]);
    Factors::new(a.clone()).fill(Isa::best(), window, &e, planes.each_mut().map(Vec::as_mut_slice));
    let stride = window.stride();
    for at in PAD * stride..(window.height + PAD + BELOW) * stride {
        let weights: Vec<f64> =
            planes.iter().flat_map(|plane| <[f32; 2]>::from(plane[at].halves())).map(f64::from).collect();
        let (y, x) = (window.y + at / stride - PAD, (window.x + at % stride).wrapping_sub(PAD));
        let row: Vec<((usize, usize), usize, f64)> = std::iter::once((0, 0))
            .chain(BEFORE)
            .map(|(up, right)| {
                (
                    (y.wrapping_sub(up), x.wrapping_add_signed(right)),
                    (at - up * stride).wrapping_add_signed(right),
                )
            })
            .zip(weights)
            .map(|((pixel, place), weight)| (pixel, place, weight))
            .collect();
        for &(_, place, weight) in &row {
            assert!(e[at] * e[place] == 1.0 || weight == 0.0, "{size} {y} {x}");
        }
        if e[at] == 0.0 {
            continue;
        }
        let free: Vec<_> = row.iter().filter(|(_, place, _)| e[*place] == 1.0).collect();
        for (k, (pixel, ..)) in free.iter().enumerate() {
            let terms = free.iter().map(|(other, _, weight)| a.entry(*pixel, *other) * weight);
            let size: f64 = terms.clone().map(f64::abs).sum();
            let expected = if k == 0 { 1.0 / row[0].2 } else { 0.0 };
            // Weights have eight digits: each is off by 1/256 at most, and so is what is expected.
            assert!((terms.sum::<f64>() - expected).abs() <= size / 128.0, "{y} {x} {k}");
        }
    }
}

#[test]
fn rows_solve_their_equations() {
    let size = Size::new(60, 70);
    for (y, x, height, width) in [(20, 24, 20, 26), (0, 0, 24, 30), (34, 30, 26, 40), (12, 0, 9, 70)] {
        check(size, Window { y, x, height, width });
    }
    // Images without an inside.
    check(Size::new(17, 40), Window { y: 0, x: 0, height: 17, width: 40 });
    for (height, width) in [(1, 90), (2, 90), (3, 90), (90, 1), (90, 3)] {
        check(Size::new(height, width), Window { y: 0, x: 0, height, width });
    }
    check(Size::new(40, 11), Window { y: 5, x: 0, height: 35, width: 11 });
}
