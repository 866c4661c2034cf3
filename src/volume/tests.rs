//! The ray caster against closed forms, polynomials, finite differences, and itself with and without leaps.

use super::camera::clip;
use super::kernel::{Cubic, Kernel, Linear};
use super::lanes::LANES;
use super::picture::{Instructions, Interpolation, Look, Picture, Pixel, Shot, render, render_by};
use super::scene::Scene;
use super::shade::Shader;
use super::stage::{Stage, prepare};
use super::walk::Walk;
use super::weights::{BSpline, CatmullRom};
use super::{Affine, Camera, Grid, Ray, Values};

const EPSILON: f64 = f32::EPSILON as f64;

/// A cube of `n^3` voxels with a function of the index coordinates.
fn cube(n: usize, of: impl Fn([f64; 3]) -> f64) -> Grid {
    let at = |k: usize| [k % n, k / n % n, k / n / n].map(|k| k as f64);
    let values = (0..n * n * n).map(|k| of(at(k)) as f32).collect();
    Grid::new([n; 3], &Values::F32(values), Affine::spacing([1.0; 3])).unwrap()
}

/// Value and gradient at an index point.
fn sample<K: Kernel>(grid: &Grid, kernel: K, p: [f64; 3]) -> (f64, [f64; 3]) {
    let ray = Ray { origin: p, direction: [0.0, 0.0, 1.0] };
    let segment = clip(&ray, grid.placement(), grid.last()).unwrap();
    let mut walk = Walk::new(grid, kernel, (None, false), &segment, 1.0);
    let bundle = walk.bundle([0.0; LANES], 1);
    let (values, partial) = walk.values(&bundle);
    let gradients = walk.gradients(&bundle, &partial, 1);
    (values.to_array()[0].into(), gradients.map(|part| part.to_array()[0].into()))
}

fn points() -> impl Iterator<Item = [f64; 3]> {
    let one = |k: u32| (f64::from(k) * 0.754_877_666).fract();
    (0..200).map(move |k| [one(k), one(7 * k + 1), one(13 * k + 5)].map(|x| 2.0 + 4.0 * x))
}

#[test]
fn polynomials_are_reproduced() {
    let linear = |[x, y, z]: [f64; 3]| 3.0 + 0.5 * x - 2.0 * y + 1.5 * z;
    let grid = cube(9, linear);
    for p in points() {
        for (value, gradient) in
            [sample(&grid, Linear, p), sample(&grid, Cubic(BSpline), p), sample(&grid, Cubic(CatmullRom), p)]
        {
            assert!((value - linear(p)).abs() < 40.0 * 16.0 * EPSILON, "{p:?}");
            for (found, expected) in gradient.into_iter().zip([0.5, -2.0, 1.5]) {
                assert!((found - expected).abs() < 40.0 * 32.0 * EPSILON);
            }
        }
    }
}

#[test]
fn the_spline_reproduces_cubics_and_catmull_rom_quadratics() {
    // On the spline's coefficients: those of x^3 are x^3 - x, of x^2 are x^2 - 1/3.
    let coefficient = |x: f64| x * x * x - x - 2.0 * (x * x - 1.0 / 3.0);
    let exact = |x: f64| x * x * x - 2.0 * x * x;
    let slope = |x: f64| 3.0 * x * x - 4.0 * x;
    let grid = cube(9, |[x, y, z]| coefficient(x) + coefficient(y) * z);
    for p in points() {
        let (value, gradient) = sample(&grid, Cubic(BSpline), p);
        let [x, y, z] = p;
        let size = 8.0 * 512.0 * 32.0 * EPSILON;
        assert!((value - exact(x) - exact(y) * z).abs() < size, "{p:?}");
        for (found, expected) in gradient.into_iter().zip([slope(x), slope(y) * z, exact(y)]) {
            assert!((found - expected).abs() < size);
        }
    }
    let grid = cube(9, |[x, y, z]| x * x - 0.5 * y * y + z * z);
    for p in points() {
        let (value, gradient) = sample(&grid, Cubic(CatmullRom), p);
        let [x, y, z] = p;
        assert!((value - (x * x - 0.5 * y * y + z * z)).abs() < 128.0 * 32.0 * EPSILON);
        for (found, expected) in gradient.into_iter().zip([2.0 * x, -y, 2.0 * z]) {
            assert!((found - expected).abs() < 128.0 * 32.0 * EPSILON);
        }
    }
}

#[test]
fn gradients_are_those_of_finite_differences() {
    fn check<K: Kernel>(grid: &Grid, kernel: K) {
        let h = 1.0 / 256.0;
        // Away from the faces of cells, where the linear one has a corner.
        for p in points().filter(|p| p.iter().all(|x| (0.01..0.99).contains(&x.fract()))) {
            let gradient = sample(grid, kernel, p).1;
            for axis in 0..3 {
                let at = |h: f64| {
                    let mut q = p;
                    q[axis] += h;
                    sample(grid, kernel, q).0
                };
                let difference = (at(h) - at(-h)) / (2.0 * h);
                // The third derivative times h^2 / 6, and the rounding of two values of size 1.
                let bound = 4.0 * h * h + 16.0 * EPSILON / h;
                assert!(
                    (difference - gradient[axis]).abs() < bound,
                    "{p:?} {axis}: {difference} {gradient:?}"
                );
            }
        }
    }
    let grid = cube(9, |[x, y, z]| (0.9 * x).sin() * (0.7 * y).cos() + 0.3 * (x * z * 0.2).sin());
    check(&grid, Linear);
    check(&grid, Cubic(BSpline));
    check(&grid, Cubic(CatmullRom));
}

/// A scene on a grid of its own.
fn stage(grid: Grid, toml: &str) -> Stage {
    let scene = Scene::parse(toml, &[]).unwrap();
    super::stage::prepare_grid(&scene, grid, std::path::Path::new("")).unwrap()
}

/// The shot of a stage with a camera.
pub(crate) fn shot<'a>(
    stage: &Stage,
    camera: &'a Camera,
    shader: Option<&'a Shader>,
    mask: Option<&'a [bool]>,
) -> Shot<'a> {
    let image = &stage.scene().image;
    Shot {
        camera,
        shader,
        size: stage.size(),
        mask,
        samples: image.samples,
        seed: image.seed,
        normals: true,
        depth: true,
        gradients: false,
    }
}

/// All pixels of a stage with a camera.
fn picture(stage: &Stage, camera: &Camera, mask: Option<&[bool]>) -> Vec<Pixel> {
    let shader = stage.shader(camera);
    pixels(&render(&stage.renderer, &shot(stage, camera, shader.as_ref(), mask), &|| true))
}

/// A picture pixel by pixel.
fn pixels(picture: &Picture) -> Vec<Pixel> {
    let pixel = |at: usize| Pixel {
        colour: std::array::from_fn(|k| picture.colour[k][at]),
        normal: std::array::from_fn(|k| picture.normal[k][at]),
        depth: picture.depth[at],
        slopes: Default::default(),
    };
    (0..picture.depth.len()).map(pixel).collect()
}

/// Looks along -z at the centre of a cube of 17^3.
fn straight() -> Camera {
    let mut camera = Camera::look_at([8.0, 8.0, 40.0], [8.0, 8.0, 8.0], [0.0, 1.0, 0.0], 0.05).unwrap();
    camera.projection = super::Projection::Orthographic;
    camera
}

#[test]
fn a_constant_cube_attenuates_by_its_closed_form() {
    let toml = "[transfer]\ndomain=[0.0, 1.0]\ncolour=[[0.0, 0.5, 0.25, 1.0]]\nopacity=[[0.0, 0.1]]\n\
                [shading]\nenabled=false\n[march]\nopaque=1.0\nstep=0.5\n[image]\nsize=[4, 4]";
    let stage = stage(cube(17, |_| 1.0), toml);
    // Samples at both ends of 16 voxels: 33 half steps.
    let alpha = 1.0 - 0.9_f64.powf(16.5);
    for pixel in picture(&stage, &straight(), None) {
        for (part, share) in pixel.colour.into_iter().zip([0.5, 0.25, 1.0, 1.0]) {
            assert!((f64::from(part) - alpha * share).abs() < 33.0 * 4.0 * EPSILON, "{pixel:?}");
        }
    }
}

/// The opacity of a ray through the middle of a Gaussian ball, and its closed form.
fn ball(step: f64, preintegrated: bool) -> (f64, f64) {
    let sigma = 3.0;
    let grid =
        cube(33, |p| (-p.iter().map(|x| (x - 16.0) * (x - 16.0)).sum::<f64>() / (2.0 * sigma * sigma)).exp());
    // Extinction 0.4 v: opacity 1 - exp(-0.4 v) over values 0 to 1, by many points.
    let points: Vec<String> = (0..=1000)
        .map(|k| f64::from(k) / 1000.0)
        .map(|v| format!("[{v:?}, {:?}]", 1.0 - (-0.4 * v).exp()))
        .collect();
    let toml = format!(
        "[transfer]\ndomain=[0.0, 1.0]\ncolour=[[0.0, 1.0, 1.0, 1.0]]\nopacity=[{}]\n[shading]\nenabled=false\n\
         [march]\nopaque=1.0\nstep={step:?}\ninterpolation=\"tricubic\"\npreintegrated={preintegrated}\n[image]\nsize=[1, 1]",
        points.join(",")
    );
    let stage = stage(grid, &toml);
    let mut camera = Camera::look_at([16.0, 16.0, 80.0], [16.0, 16.0, 16.0], [0.0, 1.0, 0.0], 0.01).unwrap();
    camera.projection = super::Projection::Orthographic;
    let found = picture(&stage, &camera, None)[0].colour[3];
    // The ball is cut at 16 = 5.3 sigma, beyond which 1e-7 of it lies.
    let exact = 1.0 - (-0.4 * sigma * (2.0 * std::f64::consts::PI).sqrt()).exp();
    (found.into(), exact)
}

#[test]
fn a_gaussian_ball_attenuates_by_its_closed_form() {
    for preintegrated in [false, true] {
        let (found, exact) = ball(0.25, preintegrated);
        assert!((found - exact).abs() < 5e-5, "{preintegrated}: {found} {exact}");
    }
}

#[test]
fn the_isosurface_of_a_sphere_is_where_it_belongs() {
    let radius = 10.0;
    let grid = cube(33, |p| p.iter().map(|x| (x - 16.0) * (x - 16.0)).sum::<f64>().sqrt());
    for interpolation in ["tricubic", "catmull-rom", "trilinear"] {
        let toml = format!(
            "[transfer]\ndomain=[0.0, 1.0]\ndata-units=true\npoints=[[0.0, 1.0, 1.0, 1.0, 1.0]]\n\
             [march]\nmode=\"iso\"\niso={radius:?}\nstep=0.25\ninterpolation=\"{interpolation}\"\n[image]\nsize=[24, 24]"
        );
        let stage = stage(grid.clone(), &toml);
        let target = [16.0; 3];
        let camera = Camera::around(target, 100.0, 33.0, 21.0, 0.14).unwrap();
        // Linear interpolation cuts chords: an eighth of the second derivative 1/r along each axis.
        let bound = if interpolation == "trilinear" { 3.0 / 8.0 / radius } else { 0.01 };
        let mut hits = 0;
        for (k, pixel) in picture(&stage, &camera, None).into_iter().enumerate() {
            let ray = camera.ray(stage.size(), (k % 24) as f64 + 0.5, (k / 24) as f64 + 0.5);
            if pixel.depth.is_infinite() {
                continue;
            }
            hits += 1;
            let at: [f64; 3] = std::array::from_fn(|k| {
                ray.origin[k] + f64::from(pixel.depth) * ray.direction[k] - target[k]
            });
            let distance = super::vector::length(at);
            assert!((distance - radius).abs() < bound, "{interpolation}: {distance}");
            // Values grow outwards, so that the normal points inwards.
            let cosine = super::vector::dot(at, pixel.normal.map(f64::from)) / distance;
            assert!(cosine < -0.99, "{interpolation}: {cosine}");
        }
        assert!(hits > 300, "{hits}");
    }
}

/// Differences between two steps, and between one and one half of them: of second order if the ratio is 4.
#[test]
fn the_march_converges_with_second_order() {
    let errors = [1.0, 0.5, 0.25].map(|step| {
        // Smooth in every way: the values, the transfer function, and nothing at the ends of the ray.
        let grid = cube(33, |[x, y, z]| {
            let r = ((x - 16.0).powi(2) + (y - 16.0).powi(2) + (z - 16.0).powi(2)) / 200.0;
            if r < 1.0 { (1.0 - r).powi(2) } else { 0.0 }
        });
        let points: Vec<String> =
            (0..=400).map(|k| f64::from(k) / 400.0).map(|v| format!("[{v:?}, {:?}]", 0.3 * v * v)).collect();
        let toml = format!(
            "[transfer]\ndomain=[0.0, 1.0]\ncolour=[[0.0, 0.0, 1.0, 1.0], [1.0, 1.0, 0.0, 1.0]]\nopacity=[{}]\n\
             [shading]\nenabled=false\n[march]\nopaque=1.0\nstep={step:?}\ninterpolation=\"tricubic\"\n\
             [image]\nsize=[1, 1]",
            points.join(",")
        );
        let stage = stage(grid, &toml);
        let camera = Camera::look_at([16.0, 16.0, 80.0], [16.0; 3], [0.0, 1.0, 0.0], 0.01).unwrap();
        f64::from(picture(&stage, &camera, None)[0].colour[0])
    });
    let ratio = (errors[0] - errors[1]) / (errors[1] - errors[2]);
    assert!((3.0..5.5).contains(&ratio), "{errors:?}: {ratio}");
}

fn all_scenes() -> Vec<String> {
    let mut scenes = Vec::new();
    for interpolation in ["nearest", "trilinear", "tricubic", "tricubic-smooth", "catmull-rom"] {
        for mode in
            ["mode=\"dvr\"", "mode=\"dvr\"\npreintegrated=true", "mode=\"iso\"\niso=0.5", "mode=\"mip\""]
        {
            scenes.push(format!(
                "volume=\"procedural:head:24\"\n[transfer]\ndomain=\"type\"\npoints=[[0.0, 0.1, 0.2, 0.3, 0.0], \
                 [0.3, 0.9, 0.5, 0.2, 0.0], [0.6, 0.2, 0.9, 0.4, 0.2], [1.0, 1.0, 1.0, 1.0, 0.6]]\n\
                 [march]\ninterpolation=\"{interpolation}\"\n{mode}\n[image]\nsize=[40, 30]\n"
            ));
        }
    }
    scenes
}

fn bits(pixel: &Pixel) -> Vec<u32> {
    pixel.colour.iter().chain(&pixel.normal).chain([&pixel.depth]).map(|part| part.to_bits()).collect()
}

#[test]
fn leaps_change_no_bit() {
    for toml in all_scenes() {
        let [with, without] = ["", "skip=false"].map(|skip| {
            let scene = Scene::parse(&toml.replace("[march]\n", &format!("[march]\n{skip}\n")), &[]).unwrap();
            let stage = prepare(&scene, std::path::Path::new(""), &crate::Limits::default()).unwrap();
            picture(&stage, &stage.camera(1).unwrap(), None)
        });
        assert!(with.iter().any(|pixel| pixel.colour[3] > 0.1), "{toml}");
        for (a, b) in with.iter().zip(&without) {
            assert_eq!(bits(a), bits(b), "{toml}");
        }
    }
}

#[test]
fn a_masked_pixel_has_the_bits_of_the_full_picture() {
    let scene = Scene::parse(&format!("{}samples=3\n", all_scenes()[8]), &[]).unwrap();
    let stage = prepare(&scene, std::path::Path::new(""), &crate::Limits::default()).unwrap();
    let camera = stage.camera(0).unwrap();
    let mask: Vec<bool> = (0..30 * 40).map(|at| (at % 40 * 7 + at / 40 * 3) % 5 == 0).collect();
    let (full, sparse) = (picture(&stage, &camera, None), picture(&stage, &camera, Some(&mask)));
    for ((a, b), &measured) in full.iter().zip(&sparse).zip(&mask) {
        assert!(if measured { bits(a) == bits(b) } else { b.colour == [0.0; 4] });
    }
}

#[test]
fn modes_and_interpolations_are_as_named() {
    for (k, toml) in all_scenes().iter().enumerate() {
        let scene = Scene::parse(toml, &[]).unwrap();
        let stage = prepare(&scene, std::path::Path::new(""), &crate::Limits::default()).unwrap();
        let cubic = matches!(stage.renderer.interpolation, Interpolation::BSpline);
        assert_eq!(cubic, (8..16).contains(&k));
        assert_eq!(matches!(stage.renderer.look, Look::Iso(..)), k % 4 == 2);
        assert_eq!(stage.renderer.integral.is_some(), k % 4 == 1);
    }
}

#[test]
fn every_kind_of_instructions_gives_the_same_bits() {
    for toml in all_scenes() {
        let stage =
            prepare(&Scene::parse(&toml, &[]).unwrap(), std::path::Path::new(""), &crate::Limits::default())
                .unwrap();
        let camera = stage.camera(0).unwrap();
        let shader = stage.shader(&camera);
        let shot = shot(&stage, &camera, shader.as_ref(), None);
        let best = picture(&stage, &camera, None);
        assert!(Instructions::kinds().len() >= 2);
        for instructions in Instructions::kinds() {
            let mut found = Picture::default();
            render_by(&mut found, &stage.renderer, &shot, instructions, &|| true);
            let found = pixels(&found);
            for (a, b) in best.iter().zip(&found) {
                assert_eq!(bits(a), bits(b), "{toml} {instructions:?}");
            }
        }
    }
}

/// Three smooth blobs.
fn blobs() -> Grid {
    let blob = |p: [f64; 3], c: [f64; 3], size: f64| {
        let square: f64 = (0..3).map(|k| (p[k] - c[k]) * (p[k] - c[k])).sum();
        (-square / (size * size)).exp()
    };
    cube(33, |p| {
        blob(p, [12.0, 14.0, 13.0], 6.0)
            + 0.8 * blob(p, [22.0, 17.0, 20.0], 4.0)
            + 0.6 * blob(p, [15.0, 24.0, 9.0], 3.0)
    })
}

/// Distances and normals of surfaces and maxima against the slow twin's, with shading and without. A normal has the error of a gradient
/// over its length.
#[test]
fn surfaces_and_maxima_have_the_distance_and_the_normal_of_their_place() {
    for (mode, shading) in [("iso", true), ("iso", false), ("mip", true), ("mip", false)] {
        let toml = format!(
            "[transfer]\npoints=[[0.0, 1.0, 1.0, 1.0, 0.1], [1.0, 1.0, 1.0, 1.0, 1.0]]\n[shading]\nenabled={shading}\n\
             [camera]\nzoom=2\n[march]\nstep=0.25\nmode=\"{mode}\"\niso=0.3\n[image]\nsize=[40, 30]"
        );
        let stage = stage(blobs(), &toml);
        let camera = stage.camera(0).unwrap();
        let (mut seen, mut off) = (0, 0);
        for (k, pixel) in picture(&stage, &camera, None).iter().enumerate() {
            let ray = camera.ray(stage.size(), (k % 40) as f64 + 0.5, (k / 40) as f64 + 0.5);
            let Some((distance, normal, size)) = super::reference::place(&stage.renderer, &ray) else {
                continue;
            };
            seen += 1;
            let turned = 1.0 - super::vector::dot(normal, pixel.normal.map(f64::from));
            let same = (f64::from(pixel.depth) - distance).abs() < 1e-3;
            off += usize::from(!same || (size > 1e-3 && turned > 1e-4));
            // From outside a surface looks at the viewer.
            assert!(mode == "mip" || super::vector::dot(ray.direction, normal) < 0.05, "{normal:?}");
        }
        assert!(seen > 150 && off <= seen / 100, "{mode}: {off} of {seen}");
    }
}

/// The march against its slow twin in f64.
///
/// A position has an error of some units in the last place of the largest coordinate (24): `24 eps`. The steepest
/// transfer function changes opacity by 0.4 a third of the range and a value changes by the range within a voxel at most,
/// shading turns with the gradient at `gradient-scale` 40 times the change: in all a few thousand eps. One sample more or
/// less where a ray grazes the box, ends or meets the surface at a grazing angle is another picture: rare, and
/// counted.
#[test]
fn the_march_agrees_with_its_slow_twin() {
    for toml in all_scenes() {
        let stage =
            prepare(&Scene::parse(&toml, &[]).unwrap(), std::path::Path::new(""), &crate::Limits::default())
                .unwrap();
        let camera = stage.camera(0).unwrap();
        let shader = stage.shader(&camera);
        let nearest = stage.renderer.interpolation == Interpolation::Nearest;
        let (mut sum, mut off, mut count) = (0.0, 0, 0);
        for (k, pixel) in picture(&stage, &camera, None).iter().enumerate() {
            let ray = camera.ray(stage.size(), (k % 40) as f64 + 0.5, (k / 40) as f64 + 0.5);
            let exact = super::reference::ray(&stage.renderer, shader.as_ref(), &ray);
            let difference =
                (0..4).map(|k| (f64::from(pixel.colour[k]) - exact[k]).abs()).fold(0.0, f64::max);
            count += 1;
            if difference > 4096.0 * EPSILON {
                off += 1;
            } else {
                sum += difference;
            }
        }
        // The nearest voxel jumps wherever a sample lies on a face.
        let allowed = if nearest { count / 20 } else { count / 100 };
        assert!(off <= allowed, "{off} of {count} pixels are off: {toml}");
        assert!(sum / f64::from(count) < 128.0 * EPSILON, "{}: {toml}", sum / f64::from(count) / EPSILON);
    }
}

#[test]
fn up_is_upwards_wherever_the_camera_stands() {
    let camera = |camera: &str| {
        let stage = stage(blobs(), &format!("[camera]\n{camera}\n[image]\nsize=[4, 4]"));
        stage.camera(0).unwrap()
    };
    let (plain, turned) = (camera("azimuth=40"), camera("azimuth=40\nup=[1, 0, 0]"));
    assert_eq!((plain.eye, plain.forward), (turned.eye, turned.forward));
    assert!(super::vector::dot(turned.right, [1.0, 0.0, 0.0]).abs() < 1e-12 && turned.up[0] > 0.5);
    let eye = plain.eye;
    assert_eq!(camera(&format!("eye={eye:?}\nup=[1, 0, 0]")), turned);
}

#[test]
fn a_layout_of_a_volume_without_a_file_is_refused() {
    let scene = Scene::parse("volume=\"procedural:head:8\"\nraw=\"8x8x8:u8\"", &[]).unwrap();
    let error = prepare(&scene, std::path::Path::new(""), &crate::Limits::default()).unwrap_err();
    assert!(error.to_string().contains("raw: "), "{error}");
}
