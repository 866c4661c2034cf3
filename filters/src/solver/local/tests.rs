//! Both iterations against a direct solution in f64, and the probe against the eigenvalues of the whole matrix.

use super::*;
use crate::Size;
use crate::kernel::Real;
use crate::kernel::factor::BEFORE;
use crate::operator::energy::Form;
use crate::operator::profile::Kernel;

const ISA: Isa = Isa::Portable;

/// What the pixels are.
fn image(i: usize, j: usize) -> f64 {
    (0.3 * i as f64).sin() * (0.2 * j as f64).cos() + 0.3 * ((i * j) as f64).sin()
}

/// A preconditioner by rows, among the free pixels: the diagonal `D`, or where the weights of `G` stand, and the weights.
enum Rows {
    Blur(Vec<f64>),
    Factor(Vec<Vec<(usize, f64)>>),
}

/// A window inside a larger image, with a fifth of its pixels measured and a frame of fixed ones.
struct Case {
    a: Separable<f64>,
    window: Window,
    free: Vec<(usize, usize)>,
    factors: Option<Factors>,
}

impl Case {
    fn new(order: usize) -> Self {
        let a = Form::new(Kernel::Bspline, order, 0.03).energy(Size::new(80, 80), (1.0, 1.0));
        let window = Window { y: 20, x: 30, height: 24, width: 28 };
        let inside = |at: usize, n: usize| at >= a.terms && at + a.terms < n;
        let free = (0..window.height)
            .flat_map(|i| (0..window.width).map(move |j| (i, j)))
            .filter(|&(i, j)| inside(i, window.height) && inside(j, window.width))
            .filter(|&(i, j)| (j as f64 * 0.754_877 + i as f64 * 0.569_840).fract() >= 0.2)
            .collect();
        let factors = Factors::suit(a.terms).then(|| Factors::new(a.clone()));
        Self { a, window, free, factors }
    }

    fn entry(&self, p: (usize, usize), q: (usize, usize)) -> f64 {
        let Window { y, x, .. } = self.window;
        self.a.entry((y + p.0, x + p.1), (y + q.0, x + q.1))
    }

    /// The buffers with the image, zero at free pixels.
    fn load<'a>(&self, buffers: &'a mut Buffers) -> Views<'a> {
        let mut views = buffers.fit(self.window);
        for i in 0..self.window.height {
            for j in 0..self.window.width {
                views.x[self.window.at(i, j)] = image(i, j) as f32;
            }
        }
        views.w.fill(0.0);
        for &(i, j) in &self.free {
            views.x[self.window.at(i, j)] = 0.0;
            views.w[self.window.at(i, j)] = 1.0;
        }
        match &self.factors {
            None => step::shares(ISA, self.window, views.w, views.d),
            Some(factors) => {
                let (free, planes) = views.factor();
                factors.fill(ISA, self.window, free, planes);
            }
        }
        views
    }

    /// The free pixels of the exact solution, by elimination.
    fn exact(&self) -> Vec<f64> {
        let n = self.free.len();
        let fixed: Vec<(usize, usize)> = (0..self.window.height)
            .flat_map(|i| (0..self.window.width).map(move |j| (i, j)))
            .filter(|pixel| !self.free.contains(pixel))
            .collect();
        let mut rows: Vec<Vec<f64>> = self
            .free
            .iter()
            .map(|&p| {
                let right =
                    fixed.iter().map(|&q| -self.entry(p, q) * f64::from(image(q.0, q.1) as f32)).sum();
                self.free.iter().map(|&q| self.entry(p, q)).chain([right]).collect()
            })
            .collect();
        for k in 0..n {
            let (done, rest) = rows.split_at_mut(k + 1);
            for row in rest {
                let factor = row[k] / done[k][k];
                for (value, pivot) in row[k..].iter_mut().zip(&done[k][k..]) {
                    *value -= factor * pivot;
                }
            }
        }
        let mut x = vec![0.0; n];
        for k in (0..n).rev() {
            let sum: f64 = (k + 1..n).map(|j| rows[k][j] * x[j]).sum();
            x[k] = (rows[k][n] - sum) / rows[k][k];
        }
        x
    }

    /// `M A` of an image that is zero but at free pixels.
    fn preconditioned(&self, m: &Rows, x: &[f64]) -> Vec<f64> {
        let product =
            |p: (usize, usize)| self.free.iter().zip(x).map(|(&q, x)| self.entry(p, q) * x).sum::<f64>();
        let d = match m {
            Rows::Blur(d) => d,
            Rows::Factor(rows) => {
                let r: Vec<f64> = self.free.iter().map(|&p| product(p)).collect();
                let mut u = vec![0.0; r.len()];
                for row in rows {
                    let y: f64 = row.iter().map(|&(k, weight)| weight * r[k]).sum();
                    for &(k, weight) in row {
                        u[k] += weight * y;
                    }
                }
                return u;
            }
        };
        let r: Vec<f64> = self.free.iter().zip(d).map(|(&p, d)| d * product(p)).collect();
        let weight = |p: (usize, usize), q: (usize, usize)| {
            let one = |a: usize, b: usize| [2.0, 1.0, 0.0][a.abs_diff(b).min(2)];
            one(p.0, q.0) * one(p.1, q.1) + if p == q { CENTRE } else { 0.0 }
        };
        let blurred = |p| self.free.iter().zip(&r).map(|(&q, r)| weight(p, q) * r).sum::<f64>();
        self.free.iter().zip(d).map(|(&p, d)| d * blurred(p)).collect()
    }

    /// The preconditioner as it stands in buffers.
    fn rows(&self, views: &mut Views<'_>) -> Rows {
        let number = |p: usize, (up, right): (usize, isize)| {
            let (i, j) = self.free[p];
            let before = (i.wrapping_sub(up), j.wrapping_add_signed(right));
            self.free.iter().position(|&q| q == before)
        };
        if self.factors.is_none() {
            return Rows::Blur(
                self.free.iter().map(|&(i, j)| f64::from(views.d[self.window.at(i, j)])).collect(),
            );
        }
        let (_, planes) = views.factor();
        let rows = self.free.iter().enumerate().map(|(p, &(i, j))| {
            let weights =
                planes.iter().flat_map(|plane| <[f32; 2]>::from(plane[self.window.at(i, j)].halves()));
            let places = std::iter::once((0, 0)).chain(BEFORE).map(|place| number(p, place));
            places.zip(weights).filter_map(|(place, weight)| Some((place?, f64::from(weight)))).collect()
        });
        Rows::Factor(rows.collect())
    }

    /// The extreme eigenvalues by power iterations.
    fn spectrum(&self, m: &Rows) -> Spectrum {
        let power = |shift: f64, steps: usize| {
            let mut x: Vec<f64> = (0..self.free.len()).map(|k| ((k * k) as f64).sin()).collect();
            let mut value = 0.0;
            for _ in 0..steps {
                let norm = x.iter().map(|x| x * x).sum::<f64>().sqrt();
                for x in &mut x {
                    *x /= norm;
                }
                let next = self.preconditioned(m, &x);
                x = next.iter().zip(&x).map(|(next, x)| shift * x - next).collect();
                value = x.iter().map(|x| x * x).sum::<f64>().sqrt();
            }
            value
        };
        let largest = power(0.0, 60);
        let least = largest - power(largest, 150);
        Spectrum { least, begin: least, largest }
    }
}

#[test]
fn probes_find_the_extreme_eigenvalues() {
    for order in [2, 3] {
        let case = Case::new(order);
        let mut buffers = Buffers::default();
        let mut views = case.load(&mut buffers);
        let exact = case.spectrum(&case.rows(&mut views));
        let found = probe(ISA, &case.a.cast(), case.window, views).unwrap();
        assert!((found.largest / exact.largest - 1.0).abs() < 0.05, "{order} {found:?} {exact:?}");
        assert!((0.95..1.25).contains(&(found.least / exact.least)), "{order} {found:?} {exact:?}");
        // What the preconditioners are for: the blur would leave 30 at order 3.
        assert!(exact.largest < [7.0, 9.0][order - 2] * exact.least, "{order} {exact:?}");
    }
}

#[test]
fn both_iterations_agree_with_elimination() {
    for order in [2, 3] {
        let case = Case::new(order);
        let exact = case.exact();
        let a = case.a.cast::<f32>();
        let mut buffers = Buffers::default();
        let spectrum = probe(ISA, &a, case.window, case.load(&mut buffers)).unwrap();
        let late = Spectrum { begin: 1.5 * spectrum.least, ..spectrum };
        let wrong = Spectrum { begin: 2.0 * spectrum.least, largest: 0.6 * spectrum.largest, ..spectrum };
        let target = Target { tolerance: 1e-4, floor: 1e-7, least: None };
        for guess in [None, Some(spectrum), Some(late), Some(wrong)] {
            let views = case.load(&mut buffers);
            let ending = match guess {
                None => solve(ISA, &a, case.window, views, target, 200),
                Some(guess) => {
                    // What is known of the least eigenvalue is right even where the guess is not.
                    let target = Target { least: Some(spectrum.least), ..target };
                    iterate(ISA, &a, case.window, views, (target, guess), 200)
                }
            };
            assert!(ending.converged && ending.steps > 0, "{order} {guess:?} {ending:?}");
            let views = buffers.views();
            for (&(i, j), exact) in case.free.iter().zip(&exact) {
                let found = f64::from(views.x[case.window.at(i, j)]);
                assert!(
                    (found - exact).abs() <= 2.0 * target.tolerance,
                    "{order} {guess:?}: {found} {exact}"
                );
            }
        }
    }
}

#[test]
fn a_look_changes_nothing() {
    let case = Case::new(2);
    let a = case.a.cast::<f32>();
    let mut buffers = Buffers::default();
    let spectrum = probe(ISA, &a, case.window, case.load(&mut buffers)).unwrap();
    let target = Target { tolerance: 1e-4, floor: 1e-7, least: None };
    for chebyshev in [false, true] {
        let views = case.load(&mut buffers);
        let before = views.x.to_vec();
        let ending = if chebyshev {
            iterate(ISA, &a, case.window, views, (target, spectrum), 0)
        } else {
            solve(ISA, &a, case.window, views, Target { least: Some(spectrum.least), ..target }, 0)
        };
        assert!(ending.steps == 0 && !ending.converged, "{ending:?}");
        assert_eq!(buffers.views().x, before);
    }
}
