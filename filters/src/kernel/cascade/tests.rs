//! The definition of the steps in f64, entry by entry, and that strips cannot be told from the whole.

use super::super::points::Point;
use super::super::spans::Spans;
use super::*;
use crate::Size;
use crate::operator::energy::Form;
use crate::operator::profile::Kernel;

const FACTORS: [(f64, f64); 3] = [(0.0, 0.01), (0.3, 0.012), (0.5, 0.008)];
const C: f64 = 1.0;

fn image(window: Window, seed: f64) -> Vec<f64> {
    let mut image = window.zeros();
    for i in 0..window.height {
        for j in 0..window.width {
            image[window.at(i, j)] = ((i * 31 + j * 17) as f64 * seed).sin();
        }
    }
    image
}

struct Problem {
    a: Separable<f64>,
    window: Window,
    points: Option<Points<f64>>,
    e: Vec<f64>,
    r: Vec<f64>,
    x: Option<Vec<f64>>,
    /// Everything.
    spans: Spans,
    /// Whether what is left is wanted as it is.
    plain: bool,
}

impl Problem {
    fn new(size: Size, window: Window, order: usize, kind: usize) -> Self {
        let a = Form::new(Kernel::Bspline, order, 0.03).energy(size, (1.0, 1.0));
        let held =
            |k: usize| -> Point { ((k * 7) % (2 * window.height), (k * 11) % (2 * window.width), 3.0) };
        let points = match kind {
            0 => None,
            1 => Some(Points::new(
                window,
                (2, 2),
                &(0..=window.pixels() / 9).map(held).collect::<Vec<_>>(),
                5.0,
            )),
            _ => Some(Points::diagonal(image(window, 0.43).into_iter().map(f64::abs).collect())),
        };
        let e = image(window, 0.9).into_iter().map(|e| e.max(0.0)).collect();
        let x = (kind != 1).then(|| image(window, 0.21));
        Self { a, window, points, e, r: image(window, 0.71), x, spans: Spans::all(window), plain: false }
    }

    /// `x` and what is left of `r`, by the definition.
    fn reference(&self) -> (Vec<f64>, Vec<f64>) {
        let Window { height, width, .. } = self.window;
        let at = |i: usize, j: usize| self.window.at(i, j);
        let cells: Vec<(usize, usize)> = (0..height).flat_map(|i| (0..width).map(move |j| (i, j))).collect();
        let near = |(i, j): (usize, usize), by: usize| {
            let rows = i.saturating_sub(by)..height.min(i + by + 1);
            rows.flat_map(move |k| (j.saturating_sub(by)..width.min(j + by + 1)).map(move |l| (k, l)))
        };
        let mut x = self.x.clone().unwrap_or_else(|| self.window.zeros());
        let mut step = self.window.zeros::<f64>();
        let rest = |x: &[f64]| {
            let mut rest = self.window.zeros::<f64>();
            for &k in &cells {
                let entry = |l: (usize, usize)| {
                    let image = |(i, j): (usize, usize)| (self.window.y + i, self.window.x + j);
                    let stride = self.window.stride();
                    let own =
                        self.points.as_ref().map_or(0.0, |p| p.entry(stride, at(k.0, k.1), at(l.0, l.1)));
                    self.a.entry(image(k), image(l)) + own
                };
                let product: f64 = near(k, PAD).map(|l| entry(l) * x[at(l.0, l.1)]).sum();
                rest[at(k.0, k.1)] = self.e[at(k.0, k.1)] * (self.r[at(k.0, k.1)] - product);
            }
            rest
        };
        for (before, factor) in FACTORS {
            let rest = rest(&x);
            for &k in &cells {
                let weight =
                    |l: (usize, usize)| [2.0, 1.0][k.0.abs_diff(l.0)] * [2.0, 1.0][k.1.abs_diff(l.1)];
                let blurred: f64 = near(k, 1).map(|l| weight(l) * rest[at(l.0, l.1)]).sum();
                let k = at(k.0, k.1);
                step[k] = before * step[k] + factor * self.e[k] * (blurred + C * rest[k]);
            }
            x.iter_mut().zip(&step).for_each(|(x, step)| *x += step);
        }
        let left = rest(&x).iter().zip(&self.e).map(|(rest, e)| rest * e).collect();
        (x, left)
    }

    /// The same by the kernel, in strips that begin at these rows and columns.
    fn cascade<T: Lanes>(&self, isa: Isa, tops: &[usize], lefts: &[usize]) -> (Vec<T>, Vec<T>) {
        let cast = |from: &[f64]| -> Vec<T> { from.iter().map(|&x| T::from_f64(x)).collect() };
        let window = self.window;
        let (a, e, r, start) = (self.a.cast(), cast(&self.e), cast(&self.r), self.x.as_deref().map(cast));
        let points = self.points.as_ref().map(|points| points.map(cast));
        let (mut x, mut rest) = (window.zeros::<T>(), window.zeros::<T>());
        let mut scratch = Scratch::default();
        let reach = reach(a.terms, FACTORS.len());
        let ends = |starts: &[usize], end: usize| {
            let next = starts.iter().skip(1).copied().chain([end]);
            starts.iter().copied().zip(next).collect::<Vec<_>>()
        };
        for (first, last) in ends(tops, window.height) {
            for (begin, end) in ends(lefts, window.width) {
                let aside = reach.next_multiple_of(MOST);
                let (top, left) = (first.saturating_sub(reach), begin.saturating_sub(aside));
                let (bottom, right) = (window.height.min(last + reach), window.width.min(end + aside));
                let part = |values| Part::new(values, window, (top, left));
                let wanted = |rows: Vec<_>| -> Vec<_> {
                    let rows = rows.into_iter().take(last).skip(first);
                    rows.map(|row: &mut [T]| &mut row[begin..end]).collect()
                };
                let out = Out { x: wanted(rows(window, &mut x)), rest: wanted(rows(window, &mut rest)) };
                let strip = Strip {
                    a: &a,
                    points: points.as_ref().map(|points| (points, window, (top, left))),
                    window: Window {
                        y: window.y + top,
                        x: window.x + left,
                        height: bottom - top,
                        width: right - left,
                    },
                    spans: (&self.spans, (top, left)),
                    e: part(&e),
                    r: part(&r),
                    x: start.as_deref().map(part),
                    factors: &FACTORS,
                    c: C,
                    rows: first - top..last - top,
                    columns: begin - left..end - left,
                    plain: self.plain,
                    out,
                };
                cascade(isa, strip, &mut scratch);
            }
        }
        (x, rest)
    }
}

#[test]
fn every_instruction_set_takes_the_steps_of_the_definition() {
    let whole = |height, width| (Size::new(height, width), Window { y: 0, x: 0, height, width });
    let inside = (Size::new(70, 90), Window { y: 16, x: 32, height: 30, width: 41 });
    let corner = (Size::new(50, 66), Window { y: 20, x: 16, height: 30, width: 50 });
    for (size, window) in [whole(3, 5), whole(45, 60), whole(38, 9), inside, corner] {
        for (order, kind) in [(2, 0), (2, 1), (2, 2), (3, 0), (3, 1)] {
            let mut problem = Problem::new(size, window, order, kind);
            let expected = problem.reference();
            // Entries reach 50 (order 3: 500) and their rows' sums of sizes a few times that, over seven products.
            let size =
                if order == 3 { 4e3 } else { 4e2 } * expected.0.iter().fold(1.0, |a: f64, x| a.max(x.abs()));
            for isa in Isa::all() {
                let found = problem.cascade::<f32>(isa, &[0], &[0]);
                let exact = problem.cascade::<f64>(isa, &[0], &[0]);
                problem.plain = true;
                let plain = problem.cascade::<f64>(isa, &[0], &[0]).1;
                problem.plain = false;
                for i in 0..window.height {
                    for k in (0..window.width).map(|j| window.at(i, j)) {
                        let off = (problem.e[k] * problem.e[k] * plain[k] - expected.1[k]).abs();
                        assert!(off <= 8.0 * size * f64::EPSILON && (problem.e[k] > 0.0 || plain[k] == 0.0));
                        for (expected, found, exact) in
                            [(expected.0[k], found.0[k], exact.0[k]), (expected.1[k], found.1[k], exact.1[k])]
                        {
                            let off = (f64::from(found) - expected).abs();
                            assert!(
                                off <= 8.0 * size * f64::from(f32::EPSILON),
                                "{window:?} {order} {kind} {isa:?} {off}"
                            );
                            let off = (exact - expected).abs();
                            assert!(
                                off <= 8.0 * size * f64::EPSILON,
                                "{window:?} {order} {kind} {isa:?} {off}"
                            );
                        }
                    }
                }
            }
        }
    }
}

/// To the bit, but for what comes near the lower end of the image, where sums are taken in an order that depends on the first row.
#[test]
fn strips_give_the_bits_of_the_whole() {
    let window = Window { y: 0, x: 0, height: 131, width: 150 };
    for (order, kind) in [(2, 0), (2, 1), (3, 0)] {
        let problem = Problem::new(Size::new(131, 150), window, order, kind);
        for isa in Isa::all() {
            let whole = problem.cascade::<f32>(isa, &[0], &[0]);
            let size = |values: &[f32]| values.iter().fold(1.0, |a: f32, x| a.max(x.abs()));
            let size = if order == 3 { 4e3 } else { 4e2 } * size(&whole.0).max(size(&whole.1));
            for (tops, lefts) in
                [(vec![0, 43, 90], vec![0]), (vec![0], vec![0, 48, 96]), (vec![0, 70], vec![0, 80])]
            {
                let parts = problem.cascade::<f32>(isa, &tops, &lefts);
                for (whole, part) in [(&whole.0, &parts.0), (&whole.1, &parts.1)] {
                    for (k, (a, b)) in whole.iter().zip(part).enumerate() {
                        let same = a.to_bits() == b.to_bits();
                        let close = k > window.at(100, 0) && (a - b).abs() <= 8.0 * size * f32::EPSILON;
                        assert!(same || close, "{order} {kind} {isa:?} {tops:?} {lefts:?} {k}: {a} {b}");
                    }
                }
            }
        }
    }
}

/// What does not count is held: as if its factors and its unknowns were zero, whatever the buffers hold there.
#[test]
fn what_does_not_count_is_held_at_zero() {
    let window = Window { y: 0, x: 0, height: 61, width: 150 };
    let counts = [true, false, true, true, false, false, true, false, true, true, false];
    let cells =
        (0..61_usize.div_ceil(7) * 150_usize.div_ceil(16)).map(|k| counts[k % 11]).collect::<Vec<bool>>();
    for (order, kind) in [(2, 0), (2, 1), (2, 2), (3, 1)] {
        let mut problem = Problem::new(Size::new(61, 150), window, order, kind);
        problem.spans = Spans::of_cells(window, (7, 16), &cells);
        for isa in Isa::all() {
            for (tops, lefts) in [(vec![0], vec![0]), (vec![0, 30], vec![0, 64])] {
                let found = problem.cascade::<f64>(isa, &tops, &lefts);
                let mut held = Problem::new(Size::new(61, 150), window, order, kind);
                problem.spans.clear(window, &mut held.e);
                held.x.iter_mut().for_each(|x| problem.spans.clear(window, x));
                let expected = held.cascade::<f64>(isa, &tops, &lefts);
                assert_eq!(found, expected, "{order} {kind} {isa:?}");
                assert!(found.0.iter().any(|&x| x > 0.0));
            }
        }
    }
}
