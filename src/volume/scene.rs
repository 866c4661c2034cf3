//! The scene: a TOML file, values from the command line over it, and what they mean.
//!
//! Every value has a default, so that an empty scene with a volume renders. `docs/rendering.md` lists them all.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::Error;
use super::camera::Projection;
use super::check;
use super::transfer::{Joining, Lookup};

/// Where the camera is unless told otherwise, in degrees.
pub const AZIMUTH: f64 = 30.0;
/// The same upwards.
pub const ELEVATION: f64 = 20.0;

/// A scene as its file has it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct Scene {
    /// The volume's file, relative to the scene's, or `procedural:NAME[:N]`.
    pub volume: String,
    /// `WxHxD:type[:be][:spacing]` for a volume without a header.
    pub raw: Option<String>,
    /// What the axes of the picture's volume are in the file: `x y z`, with `-` before one that is mirrored.
    pub axes: Option<String>,
    /// Whether voxels that are not cubes are resampled linearly to the shortest edge.
    pub resample: bool,
    /// How values become colours.
    pub transfer: TransferScene,
    /// Where the camera is.
    pub camera: CameraScene,
    /// The lights; nothing for one beside the camera.
    pub light: Option<Vec<LightScene>>,
    /// How surfaces reflect.
    pub shading: ShadingScene,
    /// How rays march.
    pub march: MarchScene,
    /// The picture.
    pub image: ImageScene,
}

/// How values become colours.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case", expecting = "a table")]
pub struct TransferScene {
    /// `data` (the volume's least and largest value), `type` (all that the voxels' type can hold) or two data values:
    /// what 0 and 1 mean to the points.
    pub domain: Domain,
    /// Points with colour and opacity: value, red, green, blue, opacity per voxel of length.
    pub points: Vec<[f64; 5]>,
    /// Points with colour alone: value, red, green, blue.
    pub colour: Vec<[f64; 4]>,
    /// Points with opacity alone: value, opacity.
    pub opacity: Vec<[f64; 2]>,
    /// Whether the points' values are data values rather than 0 to 1 over the domain.
    pub data_units: bool,
    /// What is between two points.
    pub joining: Joining,
    /// How the table made of them is read: `linear`, or `step` for the entry below.
    pub lookup: Lookup,
    /// A `ParaView` colour map (JSON), relative to the scene's file, stretched over the domain.
    pub paraview: Option<PathBuf>,
}

/// What 0 and 1 mean to the points of a transfer function.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected data, type or [low, high]")]
pub enum Domain {
    /// A range that has a name.
    Named(NamedDomain),
    /// Two data values.
    Values([f64; 2]),
    /// The volume's least and largest value.
    #[default]
    Unset,
}

/// A range that has a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NamedDomain {
    /// The volume's least and largest value.
    Data,
    /// All that the voxels' type can hold; 0 to 1 for floats.
    Type,
}

/// Where the camera is: around the target, or at an eye.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case", expecting = "a table")]
pub struct CameraScene {
    /// Degrees about the y axis, from +z towards +x.
    pub azimuth: Option<f64>,
    /// Degrees towards +y; beyond 90 the camera stands behind the pole.
    pub elevation: Option<f64>,
    /// Larger is closer; 1 shows the whole volume.
    pub zoom: f64,
    /// Degrees of azimuth that each frame adds.
    pub orbit: f64,
    /// World coordinates; nothing for azimuth and elevation.
    pub eye: Option<[f64; 3]>,
    /// World coordinates; nothing for the volume's centre.
    pub target: Option<[f64; 3]>,
    /// Roughly upwards; nothing for the y axis.
    pub up: Option<[f64; 3]>,
    /// Full angle of view over the height at zoom 1, in degrees; the zoom divides the height of the image plane. Nothing for the
    /// zoom's alone.
    pub angle: Option<f64>,
    /// How rays leave.
    pub projection: Projection,
}

impl Default for CameraScene {
    fn default() -> Self {
        Self {
            azimuth: None,
            elevation: None,
            zoom: 1.0,
            orbit: 0.0,
            eye: None,
            target: None,
            up: None,
            angle: None,
            projection: Projection::Perspective,
        }
    }
}

/// A light at infinity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case", expecting = "a table")]
pub struct LightScene {
    /// Towards the light: right, up and back of the camera, or x, y, z of the world.
    pub direction: [f64; 3],
    /// Whether the direction is the world's.
    pub world: bool,
    /// Strength.
    pub intensity: f64,
}

impl Default for LightScene {
    fn default() -> Self {
        Self { direction: [0.4, 0.6, 1.0], world: false, intensity: 1.0 }
    }
}

/// How surfaces reflect; see [`super::shade`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case", expecting = "a table")]
#[allow(missing_docs, reason = "the formula in `shade` tells each value")]
pub struct ShadingScene {
    pub enabled: bool,
    pub flat: f64,
    pub ambient: f64,
    pub diffuse: f64,
    pub specular: f64,
    pub shininess: f64,
    pub gradient_scale: f64,
}

impl Default for ShadingScene {
    fn default() -> Self {
        Self {
            enabled: true,
            flat: 0.8,
            ambient: 0.25,
            diffuse: 0.65,
            specular: 0.25,
            shininess: 30.0,
            gradient_scale: 40.0,
        }
    }
}

/// The interpolation's names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum InterpolationName {
    /// The nearest voxel
    Nearest,
    /// Linear along each axis
    Trilinear,
    /// Cubic B-spline through the voxels
    #[default]
    Tricubic,
    /// Cubic B-spline weights on the voxels themselves, which smooths
    TricubicSmooth,
    /// The cubic of Catmull and Rom
    CatmullRom,
}

/// The modes' names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum ModeName {
    /// Direct volume rendering
    #[default]
    Dvr,
    /// The first surface of the iso value
    Iso,
    /// The largest value along the ray
    Mip,
}

/// How rays march.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case", expecting = "a table")]
pub struct MarchScene {
    /// Length of a step in voxels (of the shortest edge).
    pub step: f64,
    /// How values between voxels are made.
    pub interpolation: InterpolationName,
    /// What rays look for.
    pub mode: ModeName,
    /// The iso value, in the unit of the transfer function's points.
    pub iso: f64,
    /// Whether segments are pre-integrated.
    pub preintegrated: bool,
    /// Opacity at which a ray ends.
    pub opaque: f64,
    /// Opacity at which `Z` is told; 0 is the first hit. Isosurfaces and maxima have it whatever their opacity.
    pub depth_opacity: f64,
    /// Length of a step of dense AOVs in voxels where they are not of surfaces or maxima; not less than `step`.
    pub dense_step: f64,
    /// Samples a pixel of dense AOVs: the first of the picture's, if it has more.
    pub dense_samples: u32,
    /// Whether empty space is skipped; it changes no bit.
    pub skip: bool,
}

impl Default for MarchScene {
    fn default() -> Self {
        Self {
            step: 0.5,
            interpolation: InterpolationName::default(),
            mode: ModeName::default(),
            iso: 0.5,
            preintegrated: false,
            opaque: 0.995,
            depth_opacity: 0.5,
            dense_step: 1.0,
            dense_samples: 1,
            skip: true,
        }
    }
}

/// The picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case", expecting = "a table")]
pub struct ImageScene {
    /// Width and height.
    pub size: [usize; 2],
    /// Samples a pixel.
    pub samples: u32,
    /// Of all patterns.
    pub seed: u64,
    /// Red, green, blue, alpha behind the volume, not premultiplied.
    pub background: [f64; 4],
}

impl Default for ImageScene {
    fn default() -> Self {
        Self { size: [800, 800], samples: 1, seed: 0, background: [0.0; 4] }
    }
}

/// A value that the command line sets: its path and its text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Override {
    /// `camera.azimuth`, say.
    pub path: String,
    /// TOML; a word that is none is taken as a string.
    pub value: String,
}

impl std::str::FromStr for Override {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (path, value) = text.split_once('=').ok_or("not PATH=VALUE, such as camera.azimuth=30")?;
        Ok(Self { path: path.trim().into(), value: value.trim().into() })
    }
}

impl Scene {
    /// Reads the text of a scene with values set over it, in their order.
    ///
    /// # Errors
    /// [`Error::Scene`] with the place of what cannot be read; [`Error::Set`] if the text is a scene, but not with these values.
    pub fn parse(text: &str, overrides: &[Override]) -> Result<Self, Error> {
        let fail = |error: toml::de::Error| {
            let before = |end: usize| text.bytes().take(end).filter(|byte| *byte == b'\n').count();
            let line = error.span().map(|span| before(span.start) + 1);
            let place = line.map(|line| format!("line {line}: ")).unwrap_or_default();
            Error::Scene(format!("{place}{}", problem(error)))
        };
        if overrides.is_empty() {
            return toml::from_str::<Self>(text).map_err(fail)?.checked();
        }
        let mut table: toml::Table = toml::from_str(text).map_err(fail)?;
        let changed = overrides.iter().try_for_each(|change| set(&mut table, change));
        let made = changed.and_then(|()| table.try_into().map_err(|error| Error::Scene(problem(error))));
        made.and_then(Self::checked).map_err(|error| match (error, Self::parse(text, &[])) {
            (Error::Scene(why), Ok(_)) => Error::Set(why),
            (error, _) => error,
        })
    }

    /// Reads a scene's file.
    ///
    /// # Errors
    /// As [`Scene::parse`], or what the system refuses.
    pub fn read(path: &Path, overrides: &[Override]) -> Result<Self, Error> {
        let text = crate::read::text(path, "read the scene")?;
        Self::parse(&text, overrides)
    }

    /// All values on one line, defaults included: equal lines mean equal pictures.
    pub fn line(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }

    /// The scene, if no value is wrong, with the defaults of those that depend on others.
    fn checked(mut self) -> Result<Self, Error> {
        check::check(&self)?;
        if self.camera.eye.is_none() {
            self.camera.azimuth.get_or_insert(AZIMUTH);
            self.camera.elevation.get_or_insert(ELEVATION);
        }
        Ok(self)
    }
}

/// The value that cannot be read, and why, in the words of the docs and not of Rust.
fn problem(mut error: toml::de::Error) -> String {
    // Without the text that it points into, the key stands on a line of its own.
    error.set_input(None);
    let whole = error.to_string();
    let key = whole.lines().find_map(|line| line.strip_prefix("in `")?.strip_suffix('`'));
    let key = key.map_or_else(String::new, |key| format!("{key}: "));
    let words = [
        ("expected f64", "expected a number"),
        ("expected u32", "expected a whole number of 0 or more"),
        ("expected u64", "expected a whole number of 0 or more"),
        ("expected usize", "expected a whole number of 0 or more"),
        ("expected a sequence", "expected a list"),
        ("expected an array of length", "expected a list of"),
        ("expected a boolean", "expected true or false"),
    ];
    let text = words.iter().fold(error.message().to_owned(), |text, (rust, plain)| text.replace(rust, plain));
    format!("{key}{text}")
}

/// Sets one value in a table of TOML.
fn set(table: &mut toml::Table, change: &Override) -> Result<(), Error> {
    let value = format!("value = {}", change.value)
        .parse::<toml::Table>()
        .ok()
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| toml::Value::String(change.value.clone()));
    let mut place = table;
    let mut names = change.path.split('.').peekable();
    while let Some(name) = names.next() {
        if names.peek().is_none() {
            place.insert(name.into(), value);
            return Ok(());
        }
        place = place
            .entry(name)
            .or_insert_with(|| toml::Value::Table(toml::Table::new()))
            .as_table_mut()
            .ok_or_else(|| Error::Scene(format!("{}: {name} has no parts", change.path)))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_scene_has_defaults_and_flags_go_over_the_file() {
        let empty = Scene::parse("", &[]).unwrap();
        assert_eq!(empty.march.step, 0.5);
        let changes =
            ["camera.azimuth=12", "march.mode=mip", "transfer.domain=[1, 2]", "transfer.opacity=[[0, 0.5]]"];
        let changes: Vec<Override> = changes.iter().map(|text| text.parse().unwrap()).collect();
        let scene = Scene::parse("[camera]\nazimuth = 5\nelevation = 6\n", &changes).unwrap();
        assert_eq!((scene.camera.azimuth, scene.camera.elevation), (Some(12.0), Some(6.0)));
        assert_eq!(scene.march.mode, ModeName::Mip);
        assert_eq!(scene.transfer.domain, Domain::Values([1.0, 2.0]));
        assert_ne!(scene.line(), empty.line());
    }

    #[test]
    fn what_is_unknown_or_out_of_range_is_refused() {
        for (text, part) in [
            ("colour = 3", "unknown field"),
            ("[camera]\nazimut = 3", "line 2"),
            ("[march]\nstep = 0.0", "march.step"),
            ("[shading]\nshininess = -1", "shading.shininess"),
            ("[camera]\nangle = 180", "camera.angle"),
            ("[camera]\neye = [1, 2, 3]\nelevation = 5", "camera.eye"),
            ("[camera]\norbit = nan", "camera.orbit"),
            ("[camera]\nelevation = inf", "camera.elevation"),
            ("[camera]\ntarget = [1, 2, nan]", "camera.target"),
            ("[camera]\nup = [0, inf, 0]", "camera.up"),
            ("[shading]\nambient = -0.1", "ambient"),
            ("[shading]\ngradient-scale = -1", "shading.gradient-scale"),
            ("[[light]]\ndirection = [0, 0, 0]", "light.direction"),
            ("[[light]]\ndirection = [0, inf, 0]", "light.direction"),
            ("[[light]]\nintensity = -1", "light.intensity"),
            ("[transfer]\npoints = [[0, 1, 1, 1, 1.5]]", "transfer.points"),
            ("[transfer]\nopacity = [[0, 0], [1, -0.1]]", "transfer.opacity"),
            ("[transfer]\nopacity = [[0, nan]]", "transfer.opacity"),
            ("[transfer]\ndomain = [5, 5]", "transfer.domain"),
            ("[transfer]\ndomain = [6, 5]", "transfer.domain"),
            ("[image]\nsize = [0, 5]", "image.size"),
            ("[image]\nbackground = [0.0, nan, 0.0, 0.0]", "image.background"),
            ("[image]\nbackground = [0.0, 0.0, 0.0, 1.5]", "image.background: an alpha"),
            ("[image]\nbackground = [0.0, 0.0, 0.0, -0.5]", "image.background: an alpha"),
            ("[[light]]\nintensity = 1e308", "light.intensity"),
            ("[shading]\ndiffuse = inf", "shading"),
            ("[march]\nmode = \"x\"", "dvr"),
        ] {
            let error = Scene::parse(text, &[]).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
        for (change, said) in [
            ("camera.azimuth=abc", "camera.azimuth: invalid type: string \"abc\", expected a number"),
            ("camera.eye=[1, 2]", "camera.eye: invalid length 2, expected a list of 3"),
            ("image.samples=1.5", "expected a whole number of 0 or more"),
            ("march.skip=1", "march.skip: invalid type: integer `1`, expected true or false"),
            ("transfer.domain=x", "transfer.domain: expected data, type or [low, high]"),
            ("camera.azimut=1", "camera: unknown field `azimut`"),
            ("camera=3", "camera: invalid type: integer `3`, expected a table"),
        ] {
            let error = Scene::parse("", &[change.parse().unwrap()]).unwrap_err();
            assert!(matches!(error, Error::Set(_)), "{error}");
            let error = error.to_string();
            assert!(error.contains(said), "{change}: {error}");
        }
        let error = Scene::parse("[camera]\nazimuth = \"abc\"", &[]).unwrap_err().to_string();
        assert!(error.contains("line 2: ") && error.ends_with("expected a number"), "{error}");
        let of_a_file = Scene::parse("volume = \"a\"", &["volume.x=3".parse().unwrap()]);
        assert!(matches!(of_a_file, Err(Error::Set(_))));
        // A wrong file is the file's fault, and a right value may mend it.
        let (wrong, set) = ("[camera]\nangle = 180", |text: &str| [text.parse().unwrap()]);
        assert!(matches!(Scene::parse(wrong, &set("camera.zoom=2")), Err(Error::Scene(_))));
        assert!(Scene::parse(wrong, &set("camera.angle=30")).is_ok());
    }
}
