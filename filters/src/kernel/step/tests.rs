//! Passes over a tile against their definition in f64, entry by entry of the matrix.

use super::*;
use crate::Size;
use crate::kernel::factor::{BEFORE, PLANES, WEIGHTS, pack};
use crate::operator::energy::Form;
use crate::operator::profile::Kernel;

/// A window of an image with free pixels, and its buffers in f64.
pub(crate) struct Case {
    pub a: Separable<f64>,
    pub window: Window,
    pub c: f64,
    /// Buffers as a pass finds them.
    pub d: Vec<f64>,
    pub x: Vec<f64>,
    pub r: Vec<f64>,
    pub p: Vec<f64>,
    /// A sparse factor as its planes hold it.
    planes: [Vec<f32>; PLANES],
}

/// A preconditioner of a case.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Kind {
    Blur,
    Factor,
}

pub(crate) const KINDS: [Kind; 2] = [Kind::Blur, Kind::Factor];

impl Case {
    /// Windows in corners, at sides and away from the border of images; some do not fill a vector, some are the image.
    pub fn all() -> Vec<Self> {
        let mut cases = Vec::new();
        for order in [2, 3] {
            for (size, window) in [
                ((1, 1), (0, 0, 1, 1)),
                ((3, 40), (0, 0, 3, 40)),
                ((40, 5), (0, 0, 40, 5)),
                ((60, 70), (0, 0, 25, 30)),
                ((60, 70), (12, 13, 23, 37)),
                ((60, 70), (30, 20, 30, 50)),
                ((60, 70), (0, 9, 60, 20)),
            ] {
                let a = Form::new(Kernel::Bspline, order, 0.02).energy(Size::new(size.0, size.1), (1.0, 1.0));
                let window = Window { y: window.0, x: window.1, height: window.2, width: window.3 };
                cases.push(Self::new(a, window));
            }
        }
        cases
    }

    fn new(a: Separable<f64>, window: Window) -> Self {
        let image = |seed: f64| {
            let mut image = window.zeros::<f64>();
            for (i, j) in cells(window) {
                image[window.at(i, j)] = f64::from(((i * 31 + j * 17) as f64 * seed).sin() as f32);
            }
            image
        };
        let (mut d, mut r, mut p) = (image(0.9), image(0.71), image(0.37));
        let size = a.size();
        for (i, j) in cells(window) {
            // What is not free, and what A of pixels outside the window would enter.
            let k = window.at(i, j);
            let edge = |at: usize, length: usize, from: usize, n: usize| {
                (at < a.terms && from > 0) || (at + a.terms >= length && from + length < n)
            };
            let fixed =
                edge(i, window.height, window.y, size.height) || edge(j, window.width, window.x, size.width);
            d[k] = if d[k] > -0.5 && !fixed { 0.5 + 0.5 * d[k].abs() } else { 0.0 };
            (r[k], p[k]) = if d[k] == 0.0 { (0.0, 0.0) } else { (r[k], p[k]) };
        }
        let planes = std::array::from_fn(|_| window.zeros());
        let mut case = Self { x: image(0.53), a, window, c: 0.5, d, r, p, planes };
        let weights = (0..WEIGHTS).map(|k| image(0.17 + 0.11 * k as f64)).collect::<Vec<_>>();
        for (i, j) in cells(window) {
            let k = window.at(i, j);
            let mut row: [f64; WEIGHTS] = std::array::from_fn(|w| weights[w][k]);
            row[0] = 1.0 + 0.5 * row[0];
            for (w, place) in row.iter_mut().zip(case.places(k)) {
                *w = if case.d[k] == 0.0 || case.d[place] == 0.0 { 0.0 } else { *w };
            }
            for (plane, packed) in case.planes.iter_mut().zip(pack(&row)) {
                plane[k] = packed;
            }
        }
        case
    }

    /// The places of the pixels that a row of the sparse factor has weights for.
    fn places(&self, at: usize) -> impl Iterator<Item = usize> + use<> {
        let stride = self.window.stride();
        let before = BEFORE.into_iter().map(move |(up, right)| (at - up * stride).wrapping_add_signed(right));
        std::iter::once(at).chain(before)
    }

    /// A row of the sparse factor: where each weight stands, and the weight.
    fn factor(&self, (i, j): (usize, usize)) -> Vec<(usize, f64)> {
        let k = self.window.at(i, j);
        let weights = self.planes.iter().flat_map(|plane| <[f32; 2]>::from(plane[k].halves()));
        self.places(k).zip(weights.map(f64::from)).collect()
    }

    /// `M r` and `r' M r`, of a residual that is without `D`.
    pub fn precondition(&self, kind: Kind, r: &[f64]) -> (Vec<f64>, f64) {
        let mut u = self.window.zeros();
        let mut square = 0.0;
        if kind == Kind::Blur {
            let blurred = self.blur(r);
            for (i, j) in cells(self.window) {
                let k = self.window.at(i, j);
                u[k] = self.d[k] * blurred[k];
                square += r[k] * blurred[k];
            }
            return (u, square);
        }
        for cell in cells(self.window) {
            let row = self.factor(cell);
            let y: f64 = row.iter().map(|&(place, weight)| weight * r[place]).sum();
            for (place, weight) in row {
                u[place] += weight * y;
            }
            square += y * y;
        }
        (u, square)
    }

    /// A product as a pass keeps it.
    pub fn kept(&self, kind: Kind, product: &[f64]) -> Vec<f64> {
        let share = |k: usize| if kind == Kind::Blur { self.d[k] } else { 1.0 };
        product.iter().enumerate().map(|(k, x)| share(k) * x).collect()
    }

    /// The preconditioner as a pass takes it; `d` is the diagonal in f32.
    pub fn preconditioner<'a>(&'a self, kind: Kind, d: &'a [f32]) -> Preconditioner<'a, f32> {
        match kind {
            Kind::Blur => Preconditioner::Blur { d, c: self.c },
            Kind::Factor => Preconditioner::Factor(self.planes.each_ref().map(Vec::as_slice)),
        }
    }

    /// The matrix times an image in the window.
    pub fn times(&self, x: &[f64]) -> Vec<f64> {
        let (window, reach) = (self.window, self.a.terms);
        let mut result = window.zeros();
        for (i, j) in cells(window) {
            let mut sum = 0.0;
            for k in i.saturating_sub(reach)..window.height.min(i + reach + 1) {
                for l in j.saturating_sub(reach)..window.width.min(j + reach + 1) {
                    let entry = self.a.entry((window.y + i, window.x + j), (window.y + k, window.x + l));
                    sum += entry * x[window.at(k, l)];
                }
            }
            result[window.at(i, j)] = sum;
        }
        result
    }

    /// `(B + c) r`, where `r` is zero outside the window.
    pub fn blur(&self, r: &[f64]) -> Vec<f64> {
        let mut result = self.window.zeros();
        let stride = self.window.stride();
        for (i, j) in cells(self.window) {
            let k = self.window.at(i, j);
            let weigh = |di: usize, dj: usize| [1.0, 2.0, 1.0][di] * [1.0, 2.0, 1.0][dj];
            let around = (0..3).flat_map(|di| (0..3).map(move |dj| (di, dj)));
            let sum: f64 = around.map(|(di, dj)| weigh(di, dj) * r[k + di * stride + dj - stride - 1]).sum();
            result[k] = sum + self.c * r[k];
        }
        result
    }

    /// Whether a buffer of a pass is what it should be, within rounding of values up to `scale`.
    pub fn check(&self, name: &str, found: &[f32], expected: &[f64], scale: f64) {
        for (i, j) in cells(self.window) {
            let k = self.window.at(i, j);
            let error = (f64::from(found[k]) - expected[k]).abs();
            let bound = 64.0 * f64::from(f32::EPSILON) * scale;
            assert!(error <= bound, "{name} {:?} {i} {j}: {} {}", self.window, found[k], expected[k]);
        }
    }
}

/// A buffer for a pass, its rows at multiples of a cache line or not: a pass may not depend on it.
pub(crate) fn narrow(buffer: &[f64]) -> Vec<f32> {
    buffer.iter().map(|&x| x as f32).collect()
}

/// The pixels of a window.
pub(crate) fn cells(window: Window) -> impl Iterator<Item = (usize, usize)> {
    (0..window.height).flat_map(move |i| (0..window.width).map(move |j| (i, j)))
}

/// The sum of absolute values in a row of the matrix, and of the blur: what rounding is measured by.
pub(crate) fn norm(a: &Separable<f64>) -> f64 {
    16.5 * 16.0 * a.diagonal(a.vertical.len / 2, a.horizontal.len / 2).max(1.0)
}

#[test]
fn every_instruction_set_takes_the_same_step() {
    let steps = [Move::Begin, Move::First(0.3), Move::Step(0.3, 0.6)];
    for case in Case::all() {
        for (kind, what) in KINDS.into_iter().flat_map(|kind| steps.map(|what| (kind, what))) {
            check(&case, kind, what);
        }
    }
}

fn check(case: &Case, kind: Kind, what: Move) {
    let product = |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a * b).collect() };
    let mix =
        |a: &[f64], t: f64, b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a + t * b).collect() };
    let (a, window, scale) = (case.a.cast::<f32>(), case.window, norm(&case.a));
    let (u, w, s) = (product(&case.d, &case.p), product(&case.d, &case.x), product(&case.r, &case.d));
    let (p, s_next) = match what {
        Move::Step(_, b) => (mix(&u, b, &case.p), mix(&w, b, &s)),
        _ => (u.clone(), w.clone()),
    };
    let (x, r) = match what {
        Move::Begin => (case.x.clone(), mix(&window.zeros(), -1.0, &case.kept(kind, &w))),
        Move::First(t) | Move::Step(t, _) => (mix(&case.x, t, &p), mix(&case.r, -t, &s_next)),
    };
    let (u_next, square) = case.precondition(kind, &r);
    let w_next = case.kept(kind, &case.times(&u_next));
    let curvature: f64 = product(&u_next, &case.times(&u_next)).iter().sum();
    let top = u_next.iter().fold(0.0, |top: f64, u| top.max(u.abs()));
    for isa in Isa::all() {
        let [d, mut x_now, mut r_now, mut u_now, mut w_now, mut p_now, mut s_now] =
            [&case.d, &case.x, &case.r, &u, &w, &case.p, &s].map(|buffer| narrow(buffer));
        let buffers = Buffers {
            m: case.preconditioner(kind, &d),
            x: &mut x_now,
            r: &mut r_now,
            u: &mut u_now,
            w: &mut w_now,
            p: &mut p_now,
            s: &mut s_now,
        };
        let sums = pass(isa, &a, window, (what, true), buffers);
        case.check("x", &x_now, &x, 1.0);
        case.check("r", &r_now, &r, 1.0);
        case.check("u", &u_now, &u_next, 20.0);
        case.check("w", &w_now, &w_next, scale);
        let bound = 64.0 * f64::from(f32::EPSILON) * window.pixels() as f64;
        assert!((sums.square - square).abs() <= 20.0 * bound, "{isa:?} {kind:?} {window:?}");
        assert!((sums.curvature - curvature).abs() <= 20.0 * scale * bound, "{isa:?} {kind:?} {window:?}");
        assert!((sums.top - top).abs() <= 20.0 * bound, "{isa:?} {kind:?} {window:?}");
    }
}

#[test]
fn shares_are_those_of_the_blur_on_free_pixels() {
    for case in Case::all() {
        let free: Vec<f64> = case.d.iter().map(|&d| f64::from(u8::from(d > 0.0))).collect();
        let blurred = Case { c: 0.0, ..Case::new(case.a.clone(), case.window) }.blur(&free);
        for isa in Isa::all() {
            let mut d = case.window.zeros::<f32>();
            shares(isa, case.window, &narrow(&free), &mut d);
            for (i, j) in cells(case.window) {
                let k = case.window.at(i, j);
                assert_eq!(f64::from(d[k]), free[k] * blurred[k] / 16.0, "{isa:?} {i} {j}");
            }
        }
    }
}
