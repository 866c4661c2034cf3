use super::*;

const MODELS: [Sampling; 6] = [
    Sampling::Point,
    Sampling::Grid,
    Sampling::Box,
    Sampling::Gaussian(1.0),
    Sampling::Gaussian(1.5),
    Sampling::Mitchell,
];

/// Whole and broken factors, short and long axes, with and without a shift.
fn axes() -> Vec<Axis> {
    let mut axes: Vec<Axis> =
        [(1, 2), (1, 3), (2, 3), (3, 48), (7, 8), (40, 60), (41, 82), (300, 331), (64, 256)]
            .map(|(inputs, outputs)| Axis::whole(inputs, outputs))
            .to_vec();
    axes.push(Axis { inputs: 20, outputs: 31, scale: 62.0 / 41.0, shift: 7.0 - 5.0 * 62.0 / 41.0 });
    axes.push(Axis {
        inputs: 40,
        outputs: 97,
        scale: 77.0 / 32.0,
        shift: -8.0 + 3.0 * 77.0 / 32.0 - 1.0 + 0.9,
    });
    axes
}

fn fits(axis: &Axis, sampling: Sampling) -> bool {
    axis.check(sampling).is_ok()
}

#[test]
fn reduced_again_the_result_is_the_input() {
    for axis in axes() {
        for sampling in MODELS.into_iter().filter(|model| fits(&axis, *model)) {
            let is_spline = match sampling {
                // Means are those of the spline, over whole pixels, and not shares.
                Sampling::Box => axis.cells(sampling).is_none(),
                // Values are those of the spline at the centres, where no pixel of the result may stand.
                Sampling::Point => (0..axis.inputs).any(|i| axis.reduce(sampling).row(i).1.len() > 1),
                _ => !axis.is_whole(),
            };
            if is_spline {
                continue;
            }
            let y: Vec<f64> = (0..axis.inputs).map(|k| ((k * k) as f64 * 0.37).sin()).collect();
            let coefficients = axis.prefilter(sampling).apply(&y);
            let x = axis.spline(sampling).apply(&coefficients);
            let back = axis.reduce(sampling).apply(&x);
            let worst = back.iter().zip(&y).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            // A wide Gaussian multiplies the finest detail by 90, and what is cut with it.
            let bound = if sampling == Sampling::Gaussian(1.5) { 2e-5 } else { 1e-6 };
            assert!(worst < bound, "{axis:?} {sampling} {worst}");
        }
    }
}

#[test]
fn a_ramp_stays_that_ramp() {
    for axis in axes() {
        for sampling in MODELS.into_iter().filter(|model| fits(&axis, *model)) {
            if axis.inputs == 1 {
                continue;
            }
            // A hundred weights of 2e-8 are cut.
            let bound = if sampling == Sampling::Gaussian(1.5) { 2e-5 } else { 3e-6 };
            let centre = |k: f64| if sampling == Sampling::Grid { k } else { k + 0.5 };
            let y: Vec<f64> = (0..axis.inputs).map(|k| 3.0 + centre(k as f64)).collect();
            let x = axis.spline(sampling).apply(&axis.prefilter(sampling).apply(&y));
            for (j, x) in x.iter().enumerate() {
                let at = if sampling == Sampling::Grid { j as f64 / axis.scale } else { axis.centre(j) };
                // In high-resolution pixels, and to f64 in a ramp of hundreds.
                let error = (x - 3.0 - at).abs() * axis.scale / (1.0 + 0.05 * axis.inputs as f64);
                assert!(error < bound, "{axis:?} {sampling} {j} {error}");
            }
            // And the model takes it back to where it was.
            for (k, back) in axis.reduce(sampling).apply(&x).iter().enumerate() {
                assert!(
                    sampling == Sampling::Box || (back - y[k]).abs() < 1e-3,
                    "{axis:?} {sampling} {k} {back}"
                );
            }
        }
    }
}

/// Weighted means of a wave, at any factor: values at the centres of the result are the wave's.
#[test]
fn weighted_means_give_the_values_that_they_were_taken_from() {
    let wave = |at: f64| (at / 3.0).sin();
    for factor in [1.1, 1.25, 1.5, 2.5] {
        let axis = Axis::whole(160, (160.0_f64 * factor).round() as usize);
        for sampling in
            [Sampling::Gaussian(0.5), Sampling::Gaussian(1.0), Sampling::Gaussian(1.5), Sampling::Mitchell]
        {
            let (radius, weight) = sampling.weight().unwrap();
            let places: Vec<f64> =
                (0..1000).map(|k| (f64::from(2 * k + 1) / 1000.0 - 1.0) * radius).collect();
            let sum: f64 = places.iter().map(|place| weight(*place)).sum();
            let mean = |k: usize| {
                let values = places.iter().map(|place| weight(*place) * wave(k as f64 + 0.5 + place));
                values.sum::<f64>() / sum
            };
            let y: Vec<f64> = (0..160).map(mean).collect();
            let x = axis.spline(sampling).apply(&axis.prefilter(sampling).apply(&y));
            let back = axis.reduce(sampling).apply(&x);
            for (j, x) in x.iter().enumerate().take(axis.outputs * 3 / 4).skip(axis.outputs / 4) {
                let error = (x - wave(axis.centre(j))).abs();
                assert!(error < 1e-3, "{factor} {sampling} {j} {error}");
            }
            let worst = (40..120).map(|k| (back[k] - y[k]).abs()).fold(0.0, f64::max);
            assert!(worst < 3e-3, "{factor} {sampling} {worst}");
        }
    }
}

/// Means over pixels of a cubic, whatever the factor: the spline is that cubic, and its means those of the cubic.
#[test]
fn means_of_a_cubic_are_those_of_the_cubic_at_any_factor() {
    for factor in [1.1, 1.25, 1.5, 2.0, 2.5, 3.7, 8.0] {
        let axis = Axis::whole(160, (160.0_f64 * factor).round() as usize);
        let integral = |at: f64| {
            let t = at / 80.0 - 1.0;
            80.0 * (0.25 * t.powi(4) - 0.3 * t * t + t)
        };
        let means = |pixels: usize| -> Vec<f64> {
            let step = 160.0 / pixels as f64;
            (0..pixels)
                .map(|k| (integral((k + 1) as f64 * step) - integral(k as f64 * step)) / step)
                .collect()
        };
        let x = axis.spline(Sampling::Box).apply(&axis.prefilter(Sampling::Box).apply(&means(160)));
        let errors = x.iter().zip(means(axis.outputs)).map(|(a, b)| (a - b).abs());
        // The border is that of a natural spline, which the cubic is not.
        let inner = axis.outputs / 4..axis.outputs - axis.outputs / 4;
        let worst = errors.skip(inner.start).take(inner.len()).fold(0.0, f64::max);
        assert!(worst < 1e-6, "{factor} {worst}");
    }
}

#[test]
fn rows_of_both_maps_sum_to_one() {
    for axis in axes() {
        for sampling in MODELS.into_iter().filter(|model| fits(&axis, *model)) {
            for taps in [axis.reduce(sampling), axis.spline(sampling)] {
                for i in 0..taps.outputs() {
                    let (start, row) = taps.row(i);
                    assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{axis:?} {sampling}");
                    assert!(start + row.len() <= taps.inputs());
                }
            }
        }
    }
}

#[test]
fn a_box_at_a_whole_factor_has_cells_and_its_spline_the_known_filter() {
    let axis = Axis::whole(30, 60);
    let cells = axis.cells(Sampling::Box).unwrap();
    assert_eq!(cells[7], 14..16);
    assert_eq!(axis.cells(Sampling::Grid), None);
    assert_eq!(Axis::whole(20, 30).cells(Sampling::Box), None);
    // The mean of a cubic spline over a knot interval: (1, 76, 230, 76, 1) / 384.
    let both = axis.reduce(Sampling::Box).after(&axis.spline(Sampling::Box));
    let (start, row) = both.row(15);
    for (k, expected) in [1.0, 76.0, 230.0, 76.0, 1.0].into_iter().enumerate() {
        let at = 13 + k - start;
        assert!((row[at] - expected / 384.0).abs() < 1e-12, "{row:?}");
    }
}

#[test]
fn sources_are_the_pixels_around() {
    let axis = Axis::whole(3, 6);
    let of = |sampling| (0..6).map(|j| axis.source(sampling, j)).collect::<Vec<_>>();
    assert_eq!(of(Sampling::Box), [0, 0, 1, 1, 2, 2]);
    assert_eq!(of(Sampling::Grid), [0, 0, 1, 1, 2, 2]);
    let three = Axis::whole(2, 6);
    let nearest: Vec<_> = (0..6).map(|j| three.source(Sampling::Grid, j)).collect();
    assert_eq!(nearest, [0, 0, 1, 1, 1, 1]);
}

#[test]
fn nonsense_is_refused() {
    assert!(Axis::whole(4, 2).check(Sampling::Box).is_err());
    assert!(Axis::whole(1, 17).check(Sampling::Box).is_err());
    assert!(Axis::whole(0, 1).check(Sampling::Box).is_err());
    assert!(Axis::whole(4, 6).check(Sampling::Grid).is_err());
    assert!(Axis { shift: -1.5, ..Axis::whole(4, 8) }.check(Sampling::Box).is_err());
    assert_eq!(Axis::whole(4, 8).check(Sampling::Grid), Ok(()));
}
