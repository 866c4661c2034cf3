//! Scenes of unusual volumes: huge and tiny values, sheared axes, one voxel thick.

use super::*;
use crate::picture::{Picture, render};
use crate::tests::shot;
use crate::{Affine, Values};

fn staged(grid: Grid, toml: &str) -> Result<Stage, Error> {
    prepare_grid(&Scene::parse(toml, &[]).unwrap(), grid, Path::new(""))
}

fn picture(stage: &Stage) -> Picture {
    let camera = stage.camera(0).unwrap();
    let shader = stage.shader(&camera);
    let shot = shot(stage, &camera, shader.as_ref(), None);
    render(&stage.renderer, &shot, &|| true)
}

fn cube(n: usize, placement: Affine, of: impl Fn([usize; 3]) -> f32) -> Grid {
    let values = (0..n * n * n).map(|k| of([k % n, k / n % n, k / n / n])).collect();
    Grid::new([n; 3], &Values::F32(values), placement).unwrap()
}

/// A ball of whole values from -128 to 127, times a factor.
fn ball(factor: f64) -> Grid {
    cube(12, Affine::spacing([1.0; 3]), |p| {
        let square: f64 = p.iter().map(|&x| (x as f64 - 5.5).powi(2)).sum();
        ((factor * (255.0 * (-square / 12.0).exp() - 128.0).floor()) as f32).max(f32::MIN)
    })
}

#[test]
fn pictures_do_not_depend_on_the_unit_of_the_values() {
    for (mode, interpolation) in [
        ("dvr", "tricubic"),
        ("dvr", "trilinear"),
        ("dvr", "nearest"),
        ("iso", "tricubic"),
        ("mip", "catmull-rom"),
    ] {
        // The middle of the domain, by its share and in data values.
        for units in ["", "domain", "data"] {
            let made = |factor: f64| {
                let value = |v: f64| v * factor;
                let transfer = match units {
                    "domain" => format!("domain=[{:?}, {:?}]", value(-100.0), value(120.0)),
                    "data" => format!(
                        "data-units=true\npoints=[[{:?}, 0.2, 0.5, 1.0, 0.0], [{:?}, 1.0, 0.5, 0.1, 0.5]]",
                        value(-60.0),
                        value(100.0)
                    ),
                    _ => String::new(),
                };
                let iso = if units == "data" { value(20.0) } else { 0.6 };
                let toml = format!(
                    "[transfer]\n{transfer}\n[march]\nmode=\"{mode}\"\niso={iso:?}\ninterpolation=\"{interpolation}\"\n\
                     [image]\nsize=[20, 16]"
                );
                picture(&staged(ball(factor), &toml).unwrap())
            };
            let usual = made(1.0);
            assert!(usual.colour[3].iter().any(|alpha| *alpha > 0.1), "{mode} {interpolation} {units}");
            for exponent in [-149, -120, -66, 70, 120] {
                let found = made(2_f64.powi(exponent));
                assert!(found == usual, "{mode} {interpolation} {units} 2^{exponent}");
            }
        }
    }
}

#[test]
fn domains_that_are_no_floats_are_refused() {
    for (factor, domain, said) in [
        (1.0, "[0.0, 1e-40]", "too narrow for this volume, whose values are -1.28e2 to"),
        (1.0, "[1e38, 3e38]", "transfer.domain"),
        (1.0, "[-1e300, 1e300]", "transfer.domain"),
        (1e20, "[0.0, 1e-16]", "gradients"),
    ] {
        let error = staged(ball(factor), &format!("[transfer]\ndomain={domain}")).unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
    assert!(staged(ball(1e20), "[transfer]\ndomain=[0.0, 1.0]").is_ok());
}

#[test]
fn the_domain_of_a_type_stays_that_of_the_file() {
    let grid = ball(1.0).with_type_range((-128.0, 127.0));
    for toml in ["", "resample=true\n", "axes=\"x -z y\"\n"] {
        let scene = Scene::parse(&format!("{toml}[transfer]\ndomain=\"type\""), &[]).unwrap();
        let grid = match &scene.axes {
            Some(axes) => reshape::axes(&grid, axes, &Limits::default()).unwrap(),
            None => grid.clone(),
        };
        assert_eq!(domain(&scene, &grid).unwrap(), (-128.0, 127.0));
    }
    let long = Affine::spacing([1.0, 1.0, 2.0]);
    let values = Values::U8(vec![1; 27]);
    let cubes = reshape::cubes(&Grid::new([3; 3], &values, long).unwrap(), &Limits::default()).unwrap();
    assert_eq!(cubes.type_range(), (0.0, 255.0));
}

#[test]
fn the_camera_shows_the_whole_of_sheared_volumes() {
    for shear in [[0.0, -0.577], [-0.7, -0.7], [0.7, 0.7], [0.7, -0.7], [-0.9, 0.2], [0.0, 0.0]] {
        let placement = Affine {
            axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [shear[0], shear[1], 0.3]],
            ..Affine::spacing([1.0; 3])
        };
        let toml = |azimuth: u32| format!("camera.azimuth={azimuth}\n[image]\nsize=[8, 8]");
        for azimuth in (0..360).step_by(15) {
            let stage = staged(cube(16, placement, |[x, ..]| x as f32), &toml(azimuth)).unwrap();
            let matrix = stage.camera(0).unwrap().world_to_ndc(stage.size());
            for corner in 0..8 {
                let [x, y, z] = placement.point([0, 1, 2].map(|k| f64::from(corner >> k & 1) * 15.0));
                let at: [f64; 4] = std::array::from_fn(|c| {
                    [x, y, z, 1.0].iter().zip(&matrix).map(|(v, row)| v * row[c]).sum()
                });
                // A corner on the sphere about the centre stands 1 % out where it is nearest to its outline.
                assert!(
                    (at[0] / at[3]).abs() < 1.011 && (at[1] / at[3]).abs() < 1.011,
                    "{shear:?} {azimuth}"
                );
            }
        }
    }
}

#[test]
fn the_camera_of_a_box_with_right_angles_is_that_of_its_first_diagonal() {
    for k in 0..200 {
        let (sin, cos) = (f64::from(k) * 0.7).sin_cos();
        let (a, b) = (f64::from(k) * 1.3).sin_cos();
        let axes = [[cos, sin * b, sin * a], [-sin, cos * b, cos * a], [0.0, -a, b]];
        let placement =
            Affine { axes: [scale(axes[0], 0.7), axes[1], scale(axes[2], 2.3)], ..Affine::spacing([1.0; 3]) };
        let half = [128.0, 77.5, 50.0];
        assert_eq!(longest(&placement, half), length(placement.direction(half)));
    }
}

#[test]
fn a_ray_that_ends_has_a_depth() {
    let toml = "[transfer]\ndomain=[0.0, 1.0]\npoints=[[0.0, 1.0, 1.0, 1.0, 0.2]]\n\
                [march]\nopaque=0.3\ndepth-opacity=0.9\n[image]\nsize=[16, 16]";
    let found = picture(&staged(cube(9, Affine::spacing([1.0; 3]), |_| 1.0), toml).unwrap());
    let mut ended = 0;
    for (alpha, depth) in found.colour[3].iter().zip(&found.depth) {
        assert_eq!(*alpha >= 0.3, depth.is_finite());
        ended += u32::from(*alpha >= 0.3);
    }
    assert!(ended > 50, "{ended}");
}

#[test]
fn a_volume_one_voxel_thick_is_seen() {
    let flat = || Grid::new([8, 8, 1], &Values::U8((0..64).collect()), Affine::spacing([1.0; 3])).unwrap();
    let toml = |more: &str| {
        format!(
            "[transfer]\npoints=[[0.0, 1.0, 0.5, 0.2, 0.2], [1.0, 0.2, 0.5, 1.0, 0.6]]\n[march]\n{more}\n[image]\nsize=[20, 20]"
        )
    };
    let [table, integrated] =
        ["", "preintegrated=true"].map(|more| picture(&staged(flat(), &toml(more)).unwrap()));
    assert!(table.colour[3].iter().filter(|alpha| **alpha > 0.1).count() > 50);
    assert!(table == integrated);
    let said = staged(flat(), &toml("mode=\"iso\"")).unwrap().notes;
    assert!(said.len() == 1 && said[0].contains("one voxel thick"), "{said:?}");
    assert!(staged(flat(), &toml("")).unwrap().notes.is_empty());
}
