//! Which values a scene may have.

use super::Error;
use super::scene::{CameraScene, Domain, LightScene, MarchScene, Scene, ShadingScene, TransferScene};
use super::shade::MOST_LIGHTS;
use super::transfer::LARGEST;
use super::vector::length;

/// Whether a value is wrong, and what is to be said then.
type Problem = (bool, &'static str);

/// That no value is out of its range, and none takes another's place.
///
/// # Errors
/// [`Error::Scene`] with the first that is.
pub fn check(scene: &Scene) -> Result<(), Error> {
    let lights = scene.light.as_deref().unwrap_or_default();
    let rooms = [
        transfer(&scene.transfer),
        shading(&scene.shading),
        light(lights),
        image(scene),
        march(&scene.march),
        camera(&scene.camera),
    ];
    match rooms.iter().flatten().find(|(wrong, _)| *wrong) {
        Some((_, text)) => Err(Error::Scene((*text).into())),
        None => Ok(()),
    }
}

fn within(values: &[f64]) -> bool {
    values.iter().all(|value| value.abs() <= LARGEST)
}

/// 0 to the largest.
fn strengths(values: &[f64]) -> bool {
    values.iter().all(|value| (0.0..=LARGEST).contains(value))
}

fn transfer(given: &TransferScene) -> Vec<Problem> {
    let share = 0.0..=1.0;
    let ordered = match given.domain {
        Domain::Values([low, high]) => low < high && (high - low).is_finite(),
        _ => true,
    };
    vec![
        (!ordered, "transfer.domain: two different numbers, the lower first"),
        (!given.points.iter().all(|point| share.contains(&point[4])), "transfer.points: opacities of 0 to 1"),
        (
            !given.opacity.iter().all(|point| share.contains(&point[1])),
            "transfer.opacity: opacities of 0 to 1",
        ),
    ]
}

fn shading(given: &ShadingScene) -> Vec<Problem> {
    let ShadingScene { flat, ambient, diffuse, specular, shininess, gradient_scale, .. } = *given;
    vec![
        (
            !strengths(&[flat, ambient, diffuse, specular]),
            "shading: flat, ambient, diffuse and specular are 0 to 1e9",
        ),
        (!strengths(&[shininess]), "shading.shininess: 0 to 1e9"),
        (!strengths(&[gradient_scale]), "shading.gradient-scale: 0 to 1e9"),
    ]
}

fn light(lights: &[LightScene]) -> Vec<Problem> {
    let towards = |light: &LightScene| within(&light.direction) && length(light.direction) > 0.0;
    vec![
        (lights.len() > MOST_LIGHTS, "light: 4 at most"),
        (
            !lights.iter().all(towards),
            "light.direction: three numbers within -1e9 and 1e9, not all of them 0",
        ),
        (!lights.iter().all(|light| strengths(&[light.intensity])), "light.intensity: 0 to 1e9"),
    ]
}

fn image(scene: &Scene) -> Vec<Problem> {
    let image = &scene.image;
    let size = 1..=65_536;
    vec![
        (!within(&image.background), "image.background: numbers within -1e9 and 1e9"),
        (!(0.0..=1.0).contains(&image.background[3]), "image.background: an alpha of 0 to 1"),
        (!image.size.iter().all(|n| size.contains(n)), "image.size: 1 to 65536 pixels"),
        (!(1..=65_536).contains(&image.samples), "image.samples: 1 to 65536"),
    ]
}

fn march(given: &MarchScene) -> Vec<Problem> {
    vec![
        (!(1e-3..=1e3).contains(&given.step), "march.step: 0.001 to 1000 voxels"),
        (
            !(given.dense_step > 0.0 && given.dense_step <= 1e3),
            "march.dense-step: above 0, 1000 voxels at most",
        ),
        (!(1..=65_536).contains(&given.dense_samples), "march.dense-samples: 1 to 65536"),
        (!(given.opaque > 0.0 && given.opaque <= 1.0), "march.opaque: above 0, 1 at most"),
        (!(0.0..=1.0).contains(&given.depth_opacity), "march.depth-opacity: 0 to 1"),
        (!given.iso.is_finite(), "march.iso: a number"),
    ]
}

fn camera(given: &CameraScene) -> Vec<Problem> {
    let angle = given.angle.unwrap_or(90.0);
    let around = given.azimuth.is_some() || given.elevation.is_some();
    let degrees = [given.azimuth.unwrap_or_default(), given.elevation.unwrap_or_default(), given.orbit];
    let points = [given.eye, given.target, given.up];
    vec![
        (
            !degrees.iter().all(|angle| angle.is_finite()),
            "camera.azimuth, camera.elevation, camera.orbit: degrees that are finite",
        ),
        (
            !points.iter().flatten().flatten().all(|part| part.is_finite()),
            "camera.eye, camera.target, camera.up: three numbers that are finite",
        ),
        (!(angle > 0.0 && angle < 180.0), "camera.angle: above 0, below 180 degrees"),
        (!(given.zoom > 0.0 && given.zoom.is_finite()), "camera.zoom: above 0"),
        (
            given.eye.is_some() && around,
            "camera.eye: the camera stands at eye, or where azimuth and elevation put it: leave one of them out",
        ),
    ]
}
