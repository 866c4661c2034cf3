use super::*;
use crate::Size;
use crate::baseline::testing;
use crate::domain::Map;
use crate::upscale::{Hint, Question};

/// Two flat surfaces and a ramp with a hard, slanted edge; the guide says where, and how far.
fn scene(size: Size) -> (Plane, Vec<Plane>) {
    let place = |y: usize, x: usize| (y as f32 / size.height as f32, x as f32 / size.width as f32);
    let inside = |v: f32, u: f32| u + 0.37 * v > 0.63 || (u - 0.2).hypot(v - 0.7) < 0.1;
    let image = Plane::from_fn(size, |y, x| {
        let (v, u) = place(y, x);
        if inside(v, u) { 0.8 - 0.3 * v } else { 0.1 + 0.2 * u }
    });
    let shape = Plane::from_fn(size, |y, x| {
        let (v, u) = place(y, x);
        f32::from(u8::from(inside(v, u)))
    });
    let depth = Plane::from_fn(size, |y, x| {
        let (v, u) = place(y, x);
        if inside(v, u) { 5.0 + v } else { 9.0 - u }
    });
    (image, vec![shape, depth])
}

fn guides(size: Size, planes: &[Plane]) -> Guides {
    let mut guides = Guides::new(size);
    for (at, plane) in planes.iter().enumerate() {
        guides.add(&at.to_string(), vec![plane.clone()]).unwrap();
    }
    guides
}

fn error(a: &Plane, b: &Plane) -> f64 {
    let pairs = a.pixels().iter().zip(b.pixels());
    pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
}

fn with(plan: &Plan, y: &Plane, guides: &Guides) -> Option<Steer> {
    steer(plan, &Planes::of(y.size(), vec![y.clone()]), guides, &Run::default()).unwrap()
}

const FREE: Question<'static> =
    Question { mask: None, range: (f32::NEG_INFINITY, f32::INFINITY), limit: false, map: Map::Linear };

#[test]
fn guides_sharpen_edges_and_keep_what_pixels_say() {
    for (sampling, factor) in
        [(Sampling::Box, 2), (Sampling::Box, 4), (Sampling::Grid, 2), (Sampling::Point, 3)]
    {
        let low = Size::new(60, 72);
        let high = Size::new(low.height * factor, low.width * factor);
        let (image, planes) = scene(high);
        let geometry = Geometry::scaled(low, factor as f64, sampling);
        let plan = Plan::new(geometry, Method::Ss).unwrap();
        let y = plan.model.reduce(&image);
        let plain = plan.enlarge(&y, &FREE, &Run::default()).unwrap().plane;
        let steer = with(&plan, &y, &guides(high, &planes)).expect("these guides tell everything");
        assert!(steer.gain > 0.5 && steer.guides.len() == 2, "{sampling} {factor} {}", steer.gain);
        let guided =
            plan.enlarge_with(&y, Hint::Guides(&steer.changes[0]), &FREE, &Run::default()).unwrap().plane;
        let (before, after) = (error(&plain, &image), error(&guided, &image));
        assert!(after < 0.5 * before, "{sampling} {factor} {before} {after}");
        let back = plan.model.reduce(&guided);
        let worst = back.pixels().iter().zip(y.pixels()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-5, "{sampling} {factor} {worst}");
    }
}

#[test]
fn guides_that_say_nothing_change_no_bit() {
    let (low, high) = (Size::new(60, 72), Size::new(120, 144));
    let (image, planes) = scene(high);
    let plan = Plan::new(Geometry::scaled(low, 2.0, Sampling::Box), Method::Ss).unwrap();
    let y = plan.model.reduce(&image);
    assert!(with(&plan, &y, &guides(high, &[Plane::filled(high, 3.0)])).is_none());
    let mut state = 1_u32;
    let noise = Plane::from_fn(high, |_, _| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 16_777_216.0
    });
    let foreign = Plane::from_fn(high, |y, x| planes[1].at(high.height - 1 - y, high.width - 1 - x));
    for wrong in [noise, foreign] {
        let plain = plan.enlarge(&y, &FREE, &Run::default()).unwrap().plane;
        let Some(steer) = with(&plan, &y, &guides(high, &[wrong])) else { continue };
        let guided =
            plan.enlarge_with(&y, Hint::Guides(&steer.changes[0]), &FREE, &Run::default()).unwrap().plane;
        // A tenth of a decibel.
        assert!(error(&guided, &image) < 1.0116 * error(&plain, &image));
    }
}

/// Normals and light of spheres without antialiasing, in `side` x `side` samples a pixel.
fn spheres(size: Size, side: usize) -> [Plane; 4] {
    let many = Size::new(size.height * side, size.width * side);
    let at = |part: usize| {
        let sample = move |y: usize, x: usize| {
            let (v, u) =
                ((y as f32 + 0.5) / many.height as f32 * 9.0, (x as f32 + 0.5) / many.width as f32 * 9.0);
            let (v, u) = (v.fract() * 2.0 - 1.0, u.fract() * 2.0 - 1.0);
            let Some(z) = Some(0.81 - u * u - v * v).filter(|z| *z > 0.0) else { return 0.0 };
            let normal = [u / 0.9, v / 0.9, z.sqrt() / 0.9];
            // Second order in the normal.
            let light = 0.2 + 0.5 * normal[2] * normal[2] + 0.2 * normal[0] * normal[1] + 0.1 * normal[0];
            if part == 3 { light } else { normal[part] }
        };
        let part = (side * side) as f32;
        Plane::from_fn(size, |y, x| {
            let rows = y * side..(y + 1) * side;
            rows.flat_map(|y| (x * side..(x + 1) * side).map(move |x| (y, x)))
                .map(|(y, x)| sample(y, x))
                .sum::<f32>()
                / part
        })
    };
    [0, 1, 2, 3].map(at)
}

/// The error without guides and with one normal, of light that is a mean of 16 samples.
fn errors_on_spheres(low: Size, factor: usize, normals: usize) -> (f64, f64) {
    let high = Size::new(low.height * factor, low.width * factor);
    let [.., image] = spheres(high, 4);
    let [x, y, z, _] = spheres(high, normals);
    let plan = Plan::new(Geometry::scaled(low, factor as f64, Sampling::Box), Method::Ss).unwrap();
    let small = plan.model.reduce(&image);
    let mut guides = Guides::new(high);
    guides.add("N", vec![x, y, z]).unwrap();
    assert_eq!((guides.normals().count(), terms(&guides).len()), (1, 9));
    let change = with(&plan, &small, &guides).map(|steer| steer.changes[0].clone());
    let [plain, guided] = [Hint::None, change.as_ref().map_or(Hint::None, Hint::Guides)]
        .map(|hint| error(&plan.enlarge_with(&small, hint, &FREE, &Run::default()).unwrap().plane, &image));
    (plain, guided)
}

#[test]
fn light_of_second_order_in_the_normal_is_followed() {
    let (plain, guided) = errors_on_spheres(Size::new(120, 132), 2, 4);
    assert!(guided < 0.25 * plain, "{guided} {plain}");
}

#[test]
fn guides_of_one_sample_a_pixel_cost_at_most_a_tenth_of_a_decibel() {
    for (low, factor) in [(Size::new(120, 132), 2), (Size::new(60, 66), 4)] {
        let (plain, guided) = errors_on_spheres(low, factor, 1);
        assert!(guided < 1.0116 * plain, "{factor} {guided} {plain}");
    }
}

#[test]
fn pixels_without_a_guide_take_nothing_and_threads_change_nothing() {
    let (low, high) = (Size::new(41, 50), Size::new(82, 100));
    let (image, mut planes) = scene(high);
    let plan = Plan::new(Geometry::scaled(low, 2.0, Sampling::Box), Method::Ss).unwrap();
    let y = plan.model.reduce(&image);
    planes[1].row_mut(40)[50] = f32::NAN;
    let guides = guides(high, &planes);
    let one = testing::with_threads(1, || with(&plan, &y, &guides)).unwrap();
    let three = testing::with_threads(3, || with(&plan, &y, &guides)).unwrap();
    assert_eq!(one.changes, three.changes);
    assert!(one.changes[0].pixels().iter().all(|value| value.is_finite()));
    let other = Guides::new(low);
    assert!(steer(&plan, &Planes::of(low, vec![y]), &other, &Run::default()).is_err());
}

/// Guides may say something of one half alone: in the other the image is smoothed along its edges as it is without them.
#[test]
fn where_guides_say_nothing_the_image_is_that_without_them() {
    for (low, factor) in [(Size::new(64, 96), 2.0), (Size::new(64, 96), 1.5)] {
        let geometry = Geometry::scaled(low, factor, Sampling::Box);
        let plan = Plan::new(geometry, Method::Ss).unwrap();
        let high = geometry.high();
        let (image, planes) = scene(high);
        let half = high.width / 2;
        let unknown =
            |plane: &Plane| Plane::from_fn(high, |y, x| if x < half { f32::NAN } else { plane.at(y, x) });
        let planes: Vec<Plane> = planes.iter().map(unknown).collect();
        let y = plan.model.reduce(&image);
        let steer = with(&plan, &y, &guides(high, &planes)).expect("half of the edges are told");
        let guided = plan.enlarge_with(&y, Hint::Guides(&steer.changes[0]), &FREE, &Run::default());
        let (guided, plain) =
            (guided.unwrap().plane, plan.enlarge(&y, &FREE, &Run::default()).unwrap().plane);
        let spline = plan.spline(&y);
        // Far enough from the guides that splines of what they change have faded.
        let most = |a: &Plane, b: &Plane| {
            let pixels = (0..high.height).flat_map(|y| (0..half - 24).map(move |x| (y, x)));
            pixels.map(|(y, x)| (a.at(y, x) - b.at(y, x)).abs()).fold(0.0, f32::max)
        };
        assert!(most(&guided, &plain) < 1e-5, "{factor} {}", most(&guided, &plain));
        assert!(most(&spline, &plain) > 1e-2, "{factor}: nothing to smooth");
    }
}

/// Depths and positions lie far from zero; what they say of edges does not depend on where.
#[test]
fn an_offset_of_a_guide_changes_nothing() {
    let (low, high) = (Size::new(60, 72), Size::new(120, 144));
    let (image, planes) = scene(high);
    let plan = Plan::new(Geometry::scaled(low, 2.0, Sampling::Box), Method::Ss).unwrap();
    let y = plan.model.reduce(&image);
    let off = |guide: Plane| {
        let steer = with(&plan, &y, &guides(high, &[guide]))?;
        let large = plan.enlarge_with(&y, Hint::Guides(&steer.changes[0]), &FREE, &Run::default()).unwrap();
        Some(error(&large.plane, &image))
    };
    for offset in [0.0_f32, 1e2, 5e2, 1e4, 1e5, 1e6] {
        // Levels that the offset does not round away, but for steps of 1/16 at a million: both guides have them.
        let far = Plane::from_fn(high, |y, x| offset + 2.0 * planes[0].at(y, x) + 0.2 * planes[1].at(y, x));
        let near = Plane::from_fn(high, |y, x| far.at(y, x) - offset);
        let (far, near) = (off(far).expect("it tells the edges"), off(near).expect("it tells the edges"));
        assert!((far / near).log10().abs() < 0.1 / 20.0, "{offset} {far} {near}");
    }
}

/// Products, of a flat wall's normals say, have no mean either.
#[test]
fn products_of_normals_are_taken_about_their_means() {
    let size = Size::new(40, 50);
    let bump = |at: usize| Plane::from_fn(size, |y, x| 0.05 * ((y * (at + 2) + 3 * x) as f32).sin());
    let [x, y] = [bump(0), bump(1)];
    let z = Plane::from_fn(size, |i, j| (1.0 - x.at(i, j).powi(2) - y.at(i, j).powi(2)).sqrt());
    let mut guides = Guides::new(size);
    guides.add("N", vec![x.clone(), y, z.clone()]).unwrap();
    let terms = terms(&guides);
    for term in &terms {
        let plane = term.plane();
        let mean = plane.pixels().iter().map(|v| f64::from(*v)).sum::<f64>() / size.pixels() as f64;
        let most = plane.pixels().iter().fold(0.0_f32, |most, v| most.max(v.abs()));
        assert!(mean.abs() < 1e-5 * f64::from(most).max(1.0), "{mean} {most}");
    }
    // The product of x and z, in the scale of the group, but for a constant.
    let (product, one) = (terms[5].plane(), terms[0].plane());
    let scale = (one.at(0, 9) - one.at(0, 0)) / (x.at(0, 9) - x.at(0, 0));
    let of = |row: usize, column: usize| scale * scale * x.at(row, column) * z.at(row, column);
    let (told, expected) = (product.at(7, 9) - product.at(0, 0), of(7, 9) - of(0, 0));
    assert!((told - expected).abs() < 1e-3 * expected.abs(), "{told} {expected}");
}
