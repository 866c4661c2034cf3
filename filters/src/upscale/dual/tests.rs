use super::*;
use crate::Size;
use crate::operator::taps::Taps;
use crate::upscale::{Geometry, Method, Question, Sampling};

/// Ones and zeros beside each other, and something smooth: bounds cut in almost everywhere.
fn edges(size: Size) -> Plane {
    Plane::from_fn(size, |i, j| {
        let hash = (i * 7919 + j * 104_729 + i * j * 31) % 97;
        if hash < 20 {
            1.0
        } else if hash < 60 {
            0.0
        } else {
            0.2 + 0.1 * ((i + j) as f32 * 0.3).sin()
        }
    })
}

/// The nearest image to `start` within `range` whose reduction is `samples`: plain steps of the dual in f64, many of them.
fn reference(plan: &Plan, samples: &[f64], start: &[f64], range: (f64, f64)) -> Vec<f64> {
    let [vertical, horizontal] =
        [plan.geometry.vertical, plan.geometry.horizontal].map(|axis| axis.reduce(plan.geometry.sampling));
    let both = |first: &Taps, second: &Taps, image: &[f64], width: usize| -> Vec<f64> {
        let rows: Vec<Vec<f64>> = image.chunks(width).map(|row| second.apply(row)).collect();
        let columns: Vec<Vec<f64>> = (0..second.outputs())
            .map(|x| first.apply(&rows.iter().map(|row| row[x]).collect::<Vec<_>>()))
            .collect();
        (0..first.outputs()).flat_map(|y| columns.iter().map(move |column| column[y])).collect()
    };
    let (low, high) = (plan.geometry.low(), plan.geometry.high());
    let adjoint = [vertical.transpose(), horizontal.transpose()];
    let mut multiplier = vec![0.0; low.pixels()];
    let mut x = start.to_vec();
    for _ in 0..6000 {
        let free = both(&adjoint[0], &adjoint[1], &multiplier, low.width);
        x = start.iter().zip(&free).map(|(start, free)| (start + free).clamp(range.0, range.1)).collect();
        let back = both(&vertical, &horizontal, &x, high.width);
        // The largest eigenvalue of R R' is 0.61 at a factor of 2: a step of 1 leads up.
        multiplier.iter_mut().zip(samples.iter().zip(&back)).for_each(|(m, (y, back))| *m += y - back);
    }
    x
}

#[test]
fn the_image_is_the_nearest_one_within_bounds() {
    let low = Size::new(21, 26);
    let plan = Plan::new(Geometry::scaled(low, 2.0, Sampling::Point), Method::Ss).unwrap();
    let y = edges(low);
    let start = plan.spline(&y);
    let question = Question { mask: None, range: (0.0, 1.0), limit: true, map: crate::domain::Map::Linear };
    let mut plane = start.clone();
    let bounds = Bounds::new(&plan, &y, &question);
    let (moved, stop, _) = ascend(&plan, &y, (&bounds, question.range), &mut plane, &Run::default());
    assert!(moved.values > 100 && stop == Stop::Converged);
    let wide = |plane: &Plane| plane.pixels().iter().map(|v| f64::from(*v)).collect::<Vec<_>>();
    let expected = reference(&plan, &wide(&y), &wide(&start), (0.0, 1.0));
    let off = plane.pixels().iter().zip(&expected).map(|(a, b)| (f64::from(*a) - b).abs());
    let off = off.fold(0.0, f64::max);
    assert!(off < 2e-3, "{off}");
}

#[test]
fn windows_that_meet_bring_everything_within_the_tolerance() {
    for (low, sampling, factor) in [
        ((40, 70), Sampling::Point, 2.0),
        ((33, 50), Sampling::Point, 1.6),
        ((50, 40), Sampling::Mitchell, 2.0),
    ] {
        let low = Size::new(low.0, low.1);
        let plan = Plan::new(Geometry::scaled(low, factor, sampling), Method::Ss).unwrap();
        // Samples of an image that keeps its bounds.
        let y = plan.model.reduce(&edges(plan.geometry.high()));
        let task = Task { samples: &y, range: (0.0, 1.0), tolerance: 1e-5, limit: f32::INFINITY };
        let mut free = plan.spline(&y);
        let (stop, steps) = finish(&plan, &task, &mut free, &Run::default());
        let mut inside = free;
        inside.pixels_mut().iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
        let back = plan.model.reduce(&inside);
        let off = back.pixels().iter().zip(y.pixels()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(stop == Stop::IterationLimit || off <= 1e-5, "{sampling} {off}");
        assert!(off < 1e-3 && steps > 0, "{sampling} {off} {steps}");
    }
}
