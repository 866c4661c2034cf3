//! From a scene to a renderer: the volume is read and prepared, the transfer function and the camera are made.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use lacuna_core::Size;

use super::automatic;
use super::blocks::Blocks;
use super::camera::Camera;
use super::integral::Integral;
use super::kernel::{Cubic, Kernel, Linear, Nearest};
use super::picture::{Interpolation, Look, Renderer};
use super::procedural;
use super::read::{self, RawLayout};
use super::reshape;
use super::scene::{AZIMUTH, Domain, ELEVATION, InterpolationName, LightScene, ModeName, NamedDomain, Scene};
use super::shade::{Light, Material, Shader, ToWorld};
use super::surface::slack;
use super::transfer::{Curve, Transfer};
use super::vector::{Affine, Vector, add, length, scale};
use super::weights::{BSpline, CatmullRom};
use super::{Error, Grid, Limits, paraview};

/// Distance of the camera in half diagonals of the volume, and the height of the image plane at zoom 1.
const FAR: f64 = 3.0;
const FIELD: f64 = 0.7;
/// Steps of a ray through the volume, beyond which nobody waits for a picture.
const MOST_STEPS: f64 = 1e6;

/// A scene that is ready to be rendered.
#[derive(Clone, Debug)]
pub struct Stage {
    /// The renderer.
    pub renderer: Renderer,
    /// What a file of the scene asks for that is not followed.
    pub notes: Vec<String>,
    scene: Scene,
    /// The centre of the volume and half its diagonal, in world units.
    centre: Vector,
    radius: f64,
}

/// Reads the volume of a scene; paths are relative to `folder`.
///
/// # Errors
/// What is wrong with the file or the scene.
pub fn volume(scene: &Scene, folder: &Path, limits: &Limits) -> Result<Grid, Error> {
    if scene.volume.is_empty() {
        return Err(Error::Scene("no volume is named (volume = \"FILE\" or --volume FILE)".into()));
    }
    let made = scene.volume.strip_prefix(procedural::PREFIX);
    if made.is_some() && scene.raw.is_some() {
        return Err(Error::Scene("raw: a procedural volume has no file: leave it out (--raw)".into()));
    }
    let raw: Option<RawLayout> = scene
        .raw
        .as_ref()
        .map(|text| text.parse())
        .transpose()
        .map_err(|why: String| Error::Scene(format!("raw: {why}")))?;
    let grid = match made {
        Some(name) => procedural::make(name, limits)?,
        None => read::read(&folder.join(&scene.volume), raw.as_ref(), limits)?,
    };
    let grid = match &scene.axes {
        Some(axes) => reshape::axes(&grid, axes, limits)?,
        None => grid,
    };
    if scene.resample { reshape::cubes(&grid, limits) } else { Ok(grid) }
}

/// The files that a scene is made from besides its own, and what they are; paths are relative to `folder`.
pub fn files(scene: &Scene, folder: &Path) -> Vec<(&'static str, PathBuf)> {
    let raw = scene.raw.as_ref().and_then(|text| text.parse::<RawLayout>().ok());
    let made = scene.volume.is_empty() || scene.volume.starts_with(procedural::PREFIX);
    let volume = if made { Vec::new() } else { read::files(&folder.join(&scene.volume), raw.as_ref()) };
    let map = scene.transfer.paraview.as_ref().map(|path| ("colour map", folder.join(path)));
    volume.into_iter().map(|path| ("volume", path)).chain(map).collect()
}

/// Prepares a scene; its files are sought relative to `folder`.
///
/// # Errors
/// What contradicts itself.
pub fn prepare(scene: &Scene, folder: &Path, limits: &Limits) -> Result<Stage, Error> {
    prepare_grid(scene, volume(scene, folder, limits)?, folder)
}

/// Prepares a scene with a volume that is there already.
///
/// # Errors
/// What contradicts itself.
pub fn prepare_grid(scene: &Scene, grid: Grid, folder: &Path) -> Result<Stage, Error> {
    let (transfer, note) = transfer(scene, &grid, folder)?;
    let notes = note.into_iter().chain(flat(scene, &grid)).collect();
    let (voxel, march) = (grid.voxel(), &scene.march);
    let placement = *grid.placement();
    let step = march.step * voxel;
    let half = grid.size().map(|n| 0.5 * n as f64);
    let (centre, radius) = (placement.point(half), longest(&placement, half));
    let across = 2.0 * radius;
    if across / step > MOST_STEPS {
        return Err(Error::Scene(format!(
            "a ray would take {:.0} steps: the edges of the voxels differ too much, or the step is too short (resample, march.step)",
            across / step
        )));
    }
    let value = if scene.transfer.data_units {
        march.iso / grid.unit()
    } else {
        transfer.domain.0 + march.iso * (transfer.domain.1 - transfer.domain.0)
    };
    let look = match march.mode {
        ModeName::Dvr => Look::Dvr,
        ModeName::Iso => Look::Iso(value as f32, transfer.colour.at(value).map(|part| part as f32)),
        ModeName::Mip => Look::Mip,
    };
    let table = transfer.table(if look == Look::Mip { 1.0 } else { march.step });
    let (low, high) = transfer.domain;
    let per_value = if high > low { (high - low).recip() } else { 1.0 };
    let to_world = ToWorld::new(placement.inverse_rows(), per_value, voxel);
    check_gradients(&to_world, &grid, march.interpolation)?;
    let (grid, interpolation) = interpolated(grid, march.interpolation);
    let mut renderer = Renderer {
        grid: Arc::new(grid),
        interpolation,
        look,
        integral: (march.preintegrated && look == Look::Dvr).then(|| Integral::new(&table)),
        table,
        to_world,
        blocks: None,
        step,
        opaque: march.opaque as f32,
        // What ends a ray is a surface.
        threshold: march.depth_opacity.min(march.opaque) as f32,
        background: background(scene),
    };
    if march.skip {
        renderer.blocks = blocks(&renderer).map(Arc::new);
    }
    Ok(Stage { renderer, notes, scene: scene.clone(), centre, radius })
}

/// The length of the longest of the box's diagonals from its centre, `half` along each axis.
fn longest(placement: &Affine, [x, y, z]: Vector) -> f64 {
    let [first, others @ ..] =
        [[x, y, z], [-x, y, z], [x, -y, z], [x, y, -z]].map(|diagonal| length(placement.direction(diagonal)));
    // Those of a box with right angles differ by rounding, which must not move its camera.
    others.into_iter().filter(|other| *other > first * (1.0 + 1e-9)).fold(first, f64::max)
}

/// What is said of isosurfaces of a volume without depth: a surface lies between two samples.
fn flat(scene: &Scene, grid: &Grid) -> Option<String> {
    (scene.march.mode == ModeName::Iso && grid.size().contains(&1)).then(|| {
        "the volume is one voxel thick: rays across it have no two samples that an isosurface lies between, and show nothing (march.mode)"
            .into()
    })
}

/// That no gradient of the domain's share leaves the range of floats.
///
/// # Errors
/// [`Error::Scene`] if one may.
fn check_gradients(to_world: &ToWorld, grid: &Grid, interpolation: InterpolationName) -> Result<(), Error> {
    // Weights of cubic kernels and spline coefficients exceed the voxels.
    let gain = match interpolation {
        InterpolationName::Nearest | InterpolationName::Trilinear => 1.0,
        _ => 100.0,
    };
    let (low, high) = grid.range();
    let sum = |row: &[f32; 3]| row.iter().map(|part| f64::from(part.abs())).sum::<f64>();
    let steepest = to_world.0.iter().map(sum).fold(0.0, f64::max) * (high - low) * gain;
    if steepest < f64::from(f32::MAX) {
        return Ok(());
    }
    Err(Error::Scene(
        "gradients leave the range of numbers: transfer.domain is too narrow beside the range of the volume's values, or its axes nearly lie in a plane"
            .into(),
    ))
}

/// The grid that the kernel works on: voxels, or spline coefficients.
fn interpolated(grid: Grid, name: InterpolationName) -> (Grid, Interpolation) {
    match name {
        InterpolationName::Nearest => (grid, Interpolation::Nearest),
        InterpolationName::Trilinear => (grid, Interpolation::Linear),
        InterpolationName::TricubicSmooth => (grid, Interpolation::BSpline),
        InterpolationName::CatmullRom => (grid, Interpolation::CatmullRom),
        InterpolationName::Tricubic => (grid.coefficients(), Interpolation::BSpline),
    }
}

/// Premultiplied.
fn background(scene: &Scene) -> [f32; 4] {
    let [red, green, blue, alpha] = scene.image.background.map(|part| part as f32);
    [red * alpha, green * alpha, blue * alpha, alpha]
}

/// The blocks in which the renderer's rays may see something.
fn blocks(renderer: &Renderer) -> Option<Blocks> {
    // Both samples that something lies between must be in one cell or in two that touch.
    let rows = renderer.grid.placement().inverse_rows();
    if renderer.spans() && rows.iter().any(|&row| length(row) * renderer.step > 1.0) {
        return None;
    }
    Some(match renderer.interpolation {
        Interpolation::Nearest => blocks_by(Nearest, renderer),
        Interpolation::Linear => blocks_by(Linear, renderer),
        Interpolation::BSpline => blocks_by(Cubic(BSpline), renderer),
        Interpolation::CatmullRom => blocks_by(Cubic(CatmullRom), renderer),
    })
}

fn blocks_by<K: Kernel>(_: K, renderer: &Renderer) -> Blocks {
    let grid = renderer.grid.as_ref();
    let widened = |low: f32, high: f32| {
        let (low, high) = K::widen(low, high);
        (low - slack(low, high), high + slack(low, high))
    };
    match renderer.look {
        Look::Mip => Blocks::with_highest(grid, K::SUPPORT, |low, high| widened(low, high).1),
        Look::Iso(value, _) => Blocks::new(grid, K::SUPPORT, |low, high| {
            let (low, high) = widened(low, high);
            low <= value && high >= value
        }),
        Look::Dvr | Look::Dense => Blocks::new(grid, K::SUPPORT, |low, high| {
            let (low, high) = widened(low, high);
            renderer.table.visible(low, high)
        }),
    }
}

/// The values of a volume, as they are kept, that are 0 and 1 to the points of a scene.
fn domain(scene: &Scene, grid: &Grid) -> Result<(f64, f64), Error> {
    let kept = |data: f64| data / grid.unit();
    let (low, high) = match scene.transfer.domain {
        Domain::Unset | Domain::Named(NamedDomain::Data) => return Ok(grid.range()),
        Domain::Named(NamedDomain::Type) => grid.type_range(),
        Domain::Values([low, high]) => (low, high),
    };
    let (low, high) = (kept(low), kept(high));
    // Beyond these the table's floats are infinite.
    if low.abs().max(high.abs()) > 1e38 || high - low < 1e-34 {
        let (least, most) = grid.range();
        let unit = grid.unit();
        return Err(Error::Scene(format!(
            "transfer.domain: it is too wide or too narrow for this volume, whose values are {:e} to {:e}",
            least * unit,
            most * unit
        )));
    }
    Ok((low, high))
}

/// The transfer function of a scene over the values of a volume, and what of its file is not followed.
fn transfer(scene: &Scene, grid: &Grid, folder: &Path) -> Result<(Transfer, Option<String>), Error> {
    let given = &scene.transfer;
    let domain = domain(scene, grid)?;
    let data =
        |at: f64| if given.data_units { at / grid.unit() } else { domain.0 + at * (domain.1 - domain.0) };
    let mut colour: Vec<(f64, [f64; 3])> =
        given.points.iter().map(|p| (data(p[0]), [p[1], p[2], p[3]])).collect();
    colour.extend(given.colour.iter().map(|p| (data(p[0]), [p[1], p[2], p[3]])));
    let mut opacity: Vec<(f64, [f64; 1])> = given.points.iter().map(|p| (data(p[0]), [p[4]])).collect();
    opacity.extend(given.opacity.iter().map(|p| (data(p[0]), [p[1]])));
    let mut note = None;
    if let Some(path) = &given.paraview {
        let map = paraview::read(&folder.join(path), domain, given.joining)?;
        note = map.note;
        colour.extend(map.colour);
        opacity.extend(map.opacity);
    }
    if colour.is_empty() || opacity.is_empty() {
        let guess = automatic::transfer(grid, domain);
        if colour.is_empty() {
            colour = guess.0;
        }
        if opacity.is_empty() {
            opacity = guess.1;
        }
    }
    let transfer = Transfer {
        colour: Curve::new(colour, given.joining)?,
        opacity: Curve::new(opacity, given.joining)?,
        domain,
        lookup: given.lookup,
    };
    Ok((transfer, note))
}

impl Stage {
    /// The scene.
    pub const fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Height and width of the picture.
    pub const fn size(&self) -> Size {
        let [width, height] = self.scene.image.size;
        Size::new(height, width)
    }

    /// The camera of a frame.
    ///
    /// # Errors
    /// [`Error::Scene`] if the directions make no camera.
    pub fn camera(&self, frame: i64) -> Result<Camera, Error> {
        let given = &self.scene.camera;
        let target = given.target.unwrap_or(self.centre);
        let field = given
            .angle
            .map_or(FIELD / given.zoom, |angle| 2.0 * (0.5 * angle.to_radians()).tan() / given.zoom);
        let turn = given.orbit * frame as f64;
        let camera = if let Some(eye) = given.eye {
            let eye = turned(eye, target, turn);
            Camera::look_at(eye, target, given.up.unwrap_or([0.0, 1.0, 0.0]), field)?
        } else {
            let azimuth = given.azimuth.unwrap_or(AZIMUTH) + turn;
            let elevation = given.elevation.unwrap_or(ELEVATION);
            let camera = Camera::around(target, FAR * self.radius, azimuth, elevation, field)?;
            given.up.map_or(Ok(camera), |up| Camera::look_at(camera.eye, target, up, field))?
        };
        Ok(Camera { projection: given.projection, ..camera })
    }

    /// The renderer of dense AOVs.
    pub fn coarse(&self) -> Renderer {
        self.renderer.coarse(self.scene.march.dense_step * self.renderer.grid.voxel())
    }

    /// The shading as that camera's lights make it.
    pub fn shader(&self, camera: &Camera) -> Option<Shader> {
        let given = &self.scene.shading;
        let lights = self.scene.light.clone().unwrap_or_else(|| vec![LightScene::default()]);
        let light = |light: &LightScene| {
            let [right, up, back] = light.direction;
            let turned =
                add(add(scale(camera.right, right), scale(camera.up, up)), scale(camera.forward, -back));
            Light::new(if light.world { light.direction } else { turned }, light.intensity)
        };
        // A surface is one, whatever its gradient.
        let scale = if matches!(self.renderer.look, Look::Iso(..)) { 0.0 } else { given.gradient_scale };
        given.enabled.then(|| Shader {
            material: Material {
                flat: given.flat as f32,
                ambient: given.ambient as f32,
                diffuse: given.diffuse as f32,
                specular: given.specular as f32,
                shininess: given.shininess as f32,
                gradient_scale: scale as f32,
            },
            lights: lights.iter().map(light).collect(),
        })
    }
}

/// A point turned about the vertical through the target.
fn turned(point: Vector, target: Vector, degrees: f64) -> Vector {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let [x, z] = [point[0] - target[0], point[2] - target[2]];
    [target[0] + cos * x + sin * z, point[1], target[2] + cos * z - sin * x]
}

#[cfg(test)]
mod tests;
