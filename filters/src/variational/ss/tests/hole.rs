//! A lost bucket of 256 x 256 pixels against a direct solution in f64: Cholesky's factorisation within the envelope of the matrix.

use super::*;
use crate::kernel::vector;

/// The sum of products over the shorter length: 20 billion of them make a factorisation.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let length = a.len().min(b.len());
    vector::dot(Isa::best(), &a[..length], &b[..length])
}

/// Solves `A x = b`, where row `i` of `A` up to its diagonal is `rows[i]`, from its first entry that is not zero.
fn envelope(mut rows: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let start = |row: &[f64], i: usize| i + 1 - row.len();
    for i in 0..rows.len() {
        let (done, rest) = rows.split_at_mut(i);
        let row = &mut rest[0];
        let first = start(row, i);
        for j in first..i {
            let other = &done[j];
            let from = first.max(start(other, j));
            let sum = dot(&row[from - first..j - first], &other[from - start(other, j)..]);
            row[j - first] = (row[j - first] - sum) / other[other.len() - 1];
        }
        row[i - first] = (row[i - first] - dot(&row[..i - first], &row[..i - first])).sqrt();
        b[i] = (b[i] - dot(&row[..i - first], &b[first..])) / row[i - first];
    }
    for i in (0..rows.len()).rev() {
        let row = &rows[i];
        let first = start(row, i);
        b[i] /= row[i - first];
        let x = b[i];
        for (value, a) in b[first..i].iter_mut().zip(row) {
            *value -= x * a;
        }
    }
    b
}

#[test]
fn a_lost_bucket_meets_the_direct_solution() {
    let size = Size::new(520, 528);
    let samples = Plane::from_fn(size, |y, x| {
        0.5 + 0.3 * (y as f32 / 23.0).sin() * (x as f32 / 31.0).cos() + if x > y { 0.2 } else { 0.0 }
    });
    let base = random_mask(size, 0.95, 70);
    let mask = Mask::from_fn(size, |y, x| {
        base.is_measured(y, x) && !((132..388).contains(&y) && (212..308).contains(&x))
    });
    assert!(matches!(holes::divide(&mask), Division::Holes(..)));
    let settings = Settings::default();
    let matrix = Form::new(settings.kernel, 2, settings.tension).energy(size, (1.0, 1.0));
    let place = |k: usize| (k / size.width, k % size.width);
    let unknown: Vec<usize> = (0..size.pixels()).filter(|&k| !mask.as_slice()[k]).collect();
    let (mut rows, mut b) = (Vec::new(), Vec::new());
    for (i, &k) in unknown.iter().enumerate() {
        let (y, x) = place(k);
        let first = unknown.partition_point(|&l| l < y.saturating_sub(3) * size.width);
        rows.push((first..=i).map(|j| matrix.entry(place(k), place(unknown[j]))).collect());
        let near = (y.saturating_sub(3)..size.height.min(y + 4))
            .flat_map(|v| (x.saturating_sub(3)..size.width.min(x + 4)).map(move |u| (v, u)));
        let pull = near.filter(|&(v, u)| mask.is_measured(v, u));
        b.push(-pull.map(|(v, u)| matrix.entry((y, x), (v, u)) * f64::from(samples.at(v, u))).sum::<f64>());
    }
    let direct = envelope(rows, b);
    let (image, outcome) = solve(&settings, &samples, &mask, None);
    assert_eq!(outcome.stop, Stop::Converged, "{outcome:?}");
    let pixels = samples.pixels().iter().zip(mask.as_slice()).filter(|(_, m)| **m).map(|(x, _)| *x);
    let (low, high) = pixels.fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(x), b.max(x)));
    for (&k, x) in unknown.iter().zip(direct) {
        let error = (f64::from(image.pixels()[k]) - x).abs();
        assert!(error <= 1e-4 * f64::from(high - low), "pixel {k}: {error}");
    }
}
