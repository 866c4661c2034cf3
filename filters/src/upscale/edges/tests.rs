use super::*;
use crate::Size;
use crate::baseline::testing;

/// A disc, a slanted edge and a texture.
fn scene(size: Size) -> Plane {
    Plane::from_fn(size, |y, x| {
        let (v, u) = (y as f32, x as f32);
        let disc = if (v - 9.0).hypot(u - 8.0) < 5.5 { 0.7 } else { 0.1 };
        let edge = if u + 0.4 * v > 23.0 { 0.9 } else { 0.0 };
        disc + edge + 0.02 * ((u * 1.3).sin() * (v * 0.9).cos())
    })
}

#[test]
fn threads_change_nothing() {
    let image = scene(Size::new(197, 31));
    assert_eq!(
        testing::with_threads(1, || unresolved(&image)),
        testing::with_threads(3, || unresolved(&image))
    );
}

#[test]
fn what_pixels_resolve_counts_for_nothing_and_hard_edges_for_most() {
    let size = Size::new(24, 40);
    let of = |value: fn(f32, f32) -> f32| unresolved(&Plane::from_fn(size, |y, x| value(y as f32, x as f32)));
    // Squared differences of a wave of w radians a pixel are at most w^2, w^4 and w^6 of its own square, and the first and third are in step.
    let wave = of(|y, x| 2.0 + (0.25 * x).sin() * (0.25 * y).cos());
    let inside = (4..20).flat_map(|y| (4..36).map(move |x| (y, x)));
    assert!(inside.into_iter().all(|(y, x)| wave.at(y, x) < 1.1 * 0.25_f32.powi(4) / SMOOTH));
    // Third differences of a step are a half at four pixels; the pixels at it have 1/2 and 1 of the others.
    let edge = of(|_, x| (x - 20.0).clamp(0.0, 1.0));
    let expected = 0.25 / (0.25 + SMOOTH * (1.5 + 2.0 * 1.5) / 4.0);
    assert!((0..24).all(|y| (edge.at(y, 20) - expected).abs() < 1e-6 && edge.at(y, 5) == 0.0));
    let ramp = of(|y, x| 0.5 * x - 0.25 * y);
    assert!(ramp.pixels().iter().all(|share| *share == 0.0));
    for (height, width) in [(1, 1), (1, 2), (2, 1), (1, 9), (3, 3)] {
        let share = unresolved(&scene(Size::new(height, width)));
        assert!(share.pixels().iter().all(|share| (0.0..=1.0).contains(share)));
    }
    let huge = Plane::from_fn(size, |y, x| if (y + x) % 2 == 0 { 3e38 } else { -3e38 });
    assert!(unresolved(&huge).pixels().iter().all(|share| share.is_finite()));
}
