//! A pass against its definition in f64, entry by entry of the matrix.

use super::super::step::tests::{Case, KINDS, narrow, norm};
use super::*;

#[test]
fn every_instruction_set_takes_the_same_step() {
    for case in Case::all() {
        let (a, scale) = (case.a.cast::<f32>(), norm(&case.a));
        let turns = [Turn::Begin, Turn::Hold, Turn::Take];
        for (kind, turn) in KINDS.into_iter().flat_map(|kind| turns.map(|turn| (kind, turn))) {
            let begins = turn == Turn::Begin;
            let (share, length) = if begins { (0.0, 0.02) } else { (0.4, 0.01) };
            let source = if begins { &case.x } else { &case.p };
            let product = case.kept(kind, &case.times(source));
            let old = |r: f64| if begins { 0.0 } else { r };
            let r: Vec<f64> = case.r.iter().zip(&product).map(|(r, q)| old(*r) - q).collect();
            let (u, _) = case.precondition(kind, &r);
            let p: Vec<f64> = u.iter().zip(&case.p).map(|(u, p)| share * old(*p) + length * u).collect();
            let takes = if turn == Turn::Take { 1.0 } else { 0.0 };
            let corrections = case.p.iter().zip(&p).map(|(before, next)| takes * (before + next));
            let x: Vec<f64> = case.x.iter().zip(corrections).map(|(x, correction)| x + correction).collect();
            let top = u.iter().fold(0.0, |top: f64, u| top.max(u.abs()));
            for isa in Isa::all() {
                let [d, mut x_now, mut r_now, mut p_now] =
                    [&case.d, &case.x, &case.r, &case.p].map(|buffer| narrow(buffer));
                let mut q = case.window.zeros::<f32>();
                let m = case.preconditioner(kind, &d);
                let buffers = Buffers { m, x: &mut x_now, r: &mut r_now, p: &mut p_now, q: &mut q };
                let found = pass(isa, &a, case.window, turn, (share, length), buffers);
                case.check("x", &x_now, &x, 3.0 + takes * 20.0 * scale * length);
                case.check("r", &r_now, &r, scale);
                case.check("p", &p_now, &p, 20.0 * scale * length);
                let bound = 64.0 * f64::from(f32::EPSILON) * 20.0 * scale;
                assert!((found - top).abs() <= bound, "{isa:?} {kind:?} {:?}: {found} {top}", case.window);
            }
        }
    }
}
