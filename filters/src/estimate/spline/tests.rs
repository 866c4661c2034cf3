//! Against solving again without each sample, densely and in f64.

use std::sync::Arc;

use super::*;
use crate::solver::cholesky::Cholesky;
use crate::{Filter, Problem, Run, Size};

fn scene(size: Size) -> Vec<f64> {
    let value = |k: usize| {
        let (y, x) = ((k / size.width) as f64, (k % size.width) as f64);
        (0.3 * x).sin() * (0.2 * y).cos() + if x + 0.5 * y > 12.0 { 0.7 } else { 0.0 }
    };
    (0..size.pixels()).map(value).collect()
}

fn some(size: Size, one_in: u64, seed: u64) -> Mask {
    Mask::from_fn(size, |row, column| hash(seed, (row * 1000 + column) as u64).is_multiple_of(one_in))
}

/// The energy without the rounding of f32.
fn energy(settings: &ss::Settings, size: Size) -> Separable<f64> {
    Form::new(settings.kernel, settings.order.number(), settings.tension).energy(size, (1.0, 1.0))
}

/// Solves for what is not known: `-E_uu^-1 E_uk y_k`. `rest` is what else stands on the right side.
struct Dense<'a> {
    matrix: &'a Separable<f64>,
    unknown: Vec<usize>,
    factor: Cholesky,
}

impl<'a> Dense<'a> {
    fn new(matrix: &'a Separable<f64>, is_known: impl Fn(usize) -> bool) -> Self {
        let size = matrix.size();
        let unknown: Vec<usize> = (0..size.pixels()).filter(|&pixel| !is_known(pixel)).collect();
        let place = |pixel: usize| (pixel / size.width, pixel % size.width);
        let entry = |a: usize, b: usize| matrix.entry(place(unknown[a]), place(unknown[b]));
        let factor = Cholesky::new(unknown.len(), 0.0, entry);
        Self { matrix, unknown, factor }
    }

    fn entry(&self, a: usize, b: usize) -> f64 {
        let width = self.matrix.size().width;
        self.matrix.entry((a / width, a % width), (b / width, b % width))
    }

    fn fill(&self, values: &[f64]) -> Vec<f64> {
        let mut full = values.to_vec();
        self.unknown.iter().for_each(|&pixel| full[pixel] = 0.0);
        let mut right: Vec<f64> = self
            .unknown
            .iter()
            .map(|&u| -(0..full.len()).map(|pixel| self.entry(u, pixel) * full[pixel]).sum::<f64>())
            .collect();
        self.factor.solve(&mut right);
        self.unknown.iter().zip(right).for_each(|(&pixel, value)| full[pixel] = value);
        full
    }

    /// `S_ii` of a sample.
    fn own(&self, i: usize) -> f64 {
        let column: Vec<f64> = self.unknown.iter().map(|&u| self.entry(u, i)).collect();
        let mut solved = column.clone();
        self.factor.solve(&mut solved);
        self.entry(i, i) - column.iter().zip(solved).map(|(a, b)| a * b).sum::<f64>()
    }
}

#[test]
fn the_identity_holds_to_rounding() {
    let size = Size::new(13, 16);
    let (values, mask) = (scene(size), some(size, 4, 2));
    let matrix = energy(&ss::Settings::default(), size);
    let all = Dense::new(&matrix, |pixel| mask.as_slice()[pixel]);
    let filled = all.fill(&values);
    for i in (0..size.pixels()).filter(|&pixel| mask.as_slice()[pixel]) {
        let without = Dense::new(&matrix, |pixel| pixel != i && mask.as_slice()[pixel]).fill(&values)[i];
        let force: f64 = (0..size.pixels()).map(|pixel| all.entry(i, pixel) * filled[pixel]).sum();
        let residual = force / all.own(i);
        assert!((residual - (values[i] - without)).abs() < 1e-10, "{i}: {residual}");
    }
}

#[test]
fn the_fast_way_comes_near_it() {
    for one_in in [3, 5, 12] {
        let size = Size::new(34, 36);
        let (values, mask) = (scene(size), Arc::new(some(size, one_in, 9)));
        let settings = ss::Settings::default();
        let plane = Plane::new(size, values.iter().map(|&value| value as f32).collect()).unwrap();
        let samples = Planes::new(size, vec![plane]).unwrap();
        let run = Run::default();
        let mut filled = Planes::zeros(size, 1);
        settings
            .plan(&Problem::fill(mask.clone()), &run)
            .unwrap()
            .reconstruct(&samples, &mut filled, &run)
            .unwrap();
        let evidence = leave_one_out(&settings, (&samples, &mask), &filled, Folds { seed: 4 });
        assert_eq!(evidence.near.at.len(), mask.count());
        let matrix = energy(&settings, size);
        let all = Dense::new(&matrix, |pixel| mask.as_slice()[pixel]);
        let exact = all.fill(&values);
        let (mut cross, mut fast, mut slow) = (0.0, 0.0, 0.0);
        for (k, &pixel) in evidence.near.at.iter().enumerate().step_by(3) {
            let i = pixel as usize;
            let force: f64 = (0..size.pixels()).map(|pixel| all.entry(i, pixel) * exact[pixel]).sum();
            let right = force / all.own(i);
            let found = values[i] - f64::from(evidence.near.predicted[0][k]);
            cross += right * found;
            fast += found * found;
            slow += right * right;
        }
        let (correlation, size) = (cross / f64::sqrt(fast * slow), f64::sqrt(fast / slow));
        assert!(correlation > 0.95 && (0.8..1.25).contains(&size), "1 in {one_in}: {correlation} {size}");
    }
}

#[test]
fn threads_change_no_bit() {
    let size = Size::new(60, 70);
    let mask = some(size, 5, 3);
    let values = scene(size).into_iter().map(|value| value as f32).collect();
    let samples = Planes::new(size, vec![Plane::new(size, values).unwrap()]).unwrap();
    let of = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            leave_one_out(&ss::Settings::default(), (&samples, &mask), &samples, Folds { seed: 1 })
        })
    };
    let (one, four) = (of(1), of(4));
    let bits = |held: &HeldOut| held.predicted[0].iter().map(|value| value.to_bits()).collect::<Vec<u32>>();
    assert_eq!(bits(&one.near), bits(&four.near));
    assert_eq!(one.pairs.0, four.pairs.0);
    assert_eq!(bits(&one.pairs.2), bits(&four.pairs.2));
}
