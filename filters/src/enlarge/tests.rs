//! What holds of a group whatever its range and its unit.

use super::*;
use crate::Size;
use crate::variational::tv;

const MODELS: [Sampling; 5] =
    [Sampling::Point, Sampling::Grid, Sampling::Box, Sampling::Gaussian(1.5), Sampling::Mitchell];

fn options(low: Size, factor: f64, sampling: Sampling) -> Options<'static> {
    Options::new(Geometry::scaled(low, factor, sampling))
}

/// Light of a long range without neighbours that agree: lognormal, but for the tails.
fn lognormal(size: Size, mut state: u32) -> Plane {
    let mut uniform = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 16_777_216.0
    };
    Plane::from_fn(size, |_, _| (5.0 * ((0..4).map(|_| uniform()).sum::<f32>() - 2.0)).exp())
}

/// The least and the greatest of the 3 x 3 pixels around one.
fn around(plane: &Plane, at: usize) -> (f32, f32) {
    let Size { height, width } = plane.size();
    let (y, x) = (at / width, at % width);
    let rows = y.saturating_sub(1)..height.min(y + 2);
    let near = rows.flat_map(|row| &plane.row(row)[x.saturating_sub(1)..width.min(x + 2)]);
    near.fold((f32::MAX, f32::MIN), |(least, most), value| (least.min(*value), most.max(*value)))
}

/// How far the result is beyond half the least and twice the greatest of the 3 x 3 pixels around, as a factor; 1 within.
fn beyond(samples: &Plane, large: &Plane, geometry: &Geometry) -> f32 {
    let pairs = large.pixels().iter().zip(geometry.sources());
    let one = |(value, at): (&f32, u32)| {
        let (least, most) = around(samples, at as usize);
        (0.5 * least / value).max(value / (2.0 * most))
    };
    pairs.map(one).fold(1.0, f32::max)
}

#[test]
fn the_limiter_goes_by_light_and_not_by_its_logarithm() {
    let low = Size::new(24, 30);
    let light = lognormal(low, 5);
    for (sampling, method, factor) in [
        (Sampling::Grid, Method::Ss, 2.0),
        (Sampling::Grid, Method::Ss, 3.0),
        (Sampling::Grid, Method::Tv(tv::Settings::default()), 2.0),
        (Sampling::Point, Method::Ss, 2.0),
        (Sampling::Point, Method::Ss, 1.5),
        (Sampling::Box, Method::Ss, 2.0),
    ] {
        let mut options = Options { method, ..options(low, factor, sampling) };
        let group = Planes::of(low, vec![light.clone()]);
        let [limited, free] = [true, false].map(|limit| {
            options.fill.limit = limit;
            upscale(&group, &options).unwrap()
        });
        let pixels = |large: &Upscaled| large.planes.as_slice()[0].clone();
        let [beyond, free_beyond] =
            [&limited, &free].map(|large| beyond(&light, &pixels(large), &options.geometry));
        assert_eq!(limited.map.is_log(), sampling.is_pointwise(), "{sampling}");
        // A value goes through the logarithm and back.
        assert!(beyond < 1.0 + 1e-5, "{sampling} {method:?} {factor} {beyond}");
        if method == Method::Ss {
            assert!(free_beyond > 1.5, "{sampling} {factor}: nothing to limit, {free_beyond}");
        }
        if method == Method::Ss && sampling.is_pointwise() {
            // Each by itself, so what is told of moves is at least the difference of both, in the unit of light.
            let (limited_to, free) = (pixels(&limited), pixels(&free));
            let pairs = free.pixels().iter().zip(limited_to.pixels());
            let most = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(limited.limited[0].most > 0.9999 * most, "{:?} {most}", limited.limited);
        }
    }
}

/// In logarithms a spline overshoots by a factor, of which the limiter left the square.
#[test]
fn a_lamp_is_no_brighter_than_twice_what_it_is() {
    let low = Size::new(12, 12);
    let lamp =
        Plane::from_fn(low, |y, x| if (4..6).contains(&y) && (5..8).contains(&x) { 1000.0 } else { 0.1 });
    for sampling in [Sampling::Grid, Sampling::Point] {
        let large = upscale(&Planes::of(low, vec![lamp.clone()]), &options(low, 2.0, sampling)).unwrap();
        let pixels = large.planes.as_slice()[0].pixels();
        let most = pixels.iter().copied().fold(0.0, f32::max);
        let mean = pixels.iter().sum::<f32>() / pixels.len() as f32;
        assert!(large.map.is_log() && (1000.0..=2000.01).contains(&most), "{sampling} {most}");
        assert!((15.0..80.0).contains(&mean), "{sampling} {mean}");
    }
}

/// Edges and fine detail without a highlight, but for the lamp; nowhere black, as that is not what it is in every unit.
fn scene(size: Size, lamp: bool) -> Plane {
    Plane::from_fn(size, |y, x| {
        let (v, u) = (y as f32, x as f32);
        if lamp && (v - 9.0).hypot(u - 12.0) < 2.0 {
            30.0
        } else if u + 0.3 * v > 21.0 {
            0.15
        } else {
            0.4 + 0.3 * (0.9 * u).sin() * (0.7 * v).cos()
        }
    })
}

/// Powers of two times the light give that power of two times the result: to the bit, but beside highlights, where logarithms round.
#[test]
fn the_unit_of_light_changes_nothing() {
    let low = Size::new(24, 30);
    let tv = Method::Tv(tv::Settings { max_iterations: 40, ..tv::Settings::default() });
    let cases = MODELS.into_iter().flat_map(|model| {
        [(Method::Ss, 2.0), (Method::Ss, 1.5), (tv, 2.0)].map(|(method, factor)| (model, method, factor))
    });
    for (sampling, method, factor) in cases {
        let options = Options { method, ..options(low, factor, sampling) };
        for lamp in [false, true] {
            let given = scene(low, lamp);
            let Ok(one) = upscale(&Planes::of(low, vec![given.clone()]), &options) else { continue };
            // Their fourth roots are powers of two, too, so that the scale of a domain is that times as much.
            for exponent in [-100, -60, -16, 20, 60, 100] {
                let unit = 2.0_f32.powi(exponent);
                let times = Plane::from_fn(low, |y, x| unit * given.at(y, x));
                let other = upscale(&Planes::of(low, vec![times]), &options).unwrap();
                assert_eq!(other.map.name(), one.map.name());
                let most = if lamp { 1e-5 * 30.0 } else { 0.0 };
                let told = (other.limited[0].most / unit - one.limited[0].most).abs();
                assert!(told <= most, "{sampling} {factor} {method:?} 2^{exponent}");
                let pairs = other.planes.as_slice()[0].pixels().iter().zip(one.planes.as_slice()[0].pixels());
                for (other, one) in pairs {
                    let off = (other / unit - one).abs();
                    assert!(off <= most, "{sampling} {factor} {method:?} 2^{exponent} {other} {one}");
                }
            }
        }
    }
}
