//! `lacuna render`: flags to a checked job.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};
use lacuna_exr::{Compression, SampleType};
use lacuna_filters::Method;
use lacuna_volume::{InterpolationName, ModeName, Override, PROCEDURAL};

use super::Usage;
use super::adaptive::AdaptiveArgs;
use super::numbers::{density, seed_of_scene, step};
use super::output::{Depth, OutputArgs, PACKINGS, Packing};
use super::run::{PageArgs, RunArgs};
use super::settings::{FilterName, NameParser};
use super::words::Words;
use crate::commands::{Pixels, RenderJob, Wanted};
use crate::files::Targets;
use crate::files::ranges::Frames;
use crate::mask::Source;
use crate::run::RunOptions;

const EXAMPLES: &str = "\
Examples:
  lacuna render samples/scenes/head.toml -o head.exr
  lacuna render samples/scenes/head.toml -o head.exr --density 0.2 --fill auto
  lacuna render samples/scenes/head.toml -o head.exr --density 0.1 --adaptive
  lacuna render foot.nrrd -o 'foot.####.exr' --frames 1-36 --set camera.orbit=10
  lacuna render foot.nrrd -o foot.exr --mode mip
  lacuna render scan.raw -o scan.exr --raw 256x256x128:u16:be:1,1,2

Exit status: 0 all done, 1 some frame failed, 2 usage, 128 + n on signal n.";

// Not comments for rustdoc, which would read names and addresses into them.
const SCENE: &str =
    "A scene (.toml) or a volume: NRRD, MetaImage, NIfTI, VTK image data, raw, or procedural:NAME";
const MASK: &str = "Render only the pixels of a mask: file:PATTERN[:CHANNEL] or a bare path, EXR or PNG; a pattern goes frame by frame";

/// Render a volume, all of its pixels or only those asked for
///
/// Casts rays through a volume as a scene says (TOML, see docs/rendering.md; every value can be set by a flag) and writes
/// R, G, B, A, premultiplied and linear. With a density or a mask only those pixels are rendered, with the bits that
/// they have in the full picture, and a channel mask says which.
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct RenderArgs {
    #[arg(value_name = "SCENE", help = SCENE, help_heading = "Scene")]
    scene: PathBuf,

    /// Frames of an output pattern or folder: 1-10, 1-10x2 or 1-10:2 (every second), 1,5,9-12, 10-1, -5--1
    #[arg(long, value_name = "RANGE", allow_hyphen_values = true, help_heading = "Scene")]
    frames: Option<Frames>,

    #[command(flatten)]
    scene_values: SceneArgs,

    #[command(flatten)]
    pixels: PixelArgs,

    #[command(flatten)]
    layers: LayerArgs,

    #[command(flatten)]
    output: OutputArgs,

    /// Lossless compression: none, rle, zips, zip or piz; LEVEL is for zips and zip, 1 (fast) to 12 (small)
    /// [default: zip; no level: twice as fast as 4, files about 3 % larger]
    #[arg(long, value_name = "NAME[:LEVEL]", hide_possible_values = true, help_heading = "Output")]
    #[arg(value_parser = Words::<Packing>::new(PACKINGS))]
    compression: Option<Packing>,

    /// Pass over frames whose output was made by this version of the very volume, colour map and mask file that are there, from the
    /// same scene with the same settings
    // It was --resume once, which stands in scripts.
    #[arg(short, long, alias = "resume", conflicts_with_all = ["no_clobber", "force"], help_heading = "Output")]
    update: bool,

    #[command(flatten)]
    run: RunArgs,

    #[command(flatten)]
    page: PageArgs,
}

/// Values over the scene's.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Scene")]
struct SceneArgs {
    /// The volume, instead of the scene's
    #[arg(long, value_name = "FILE")]
    volume: Option<PathBuf>,

    /// Let a volume's header name a file outside its own folder
    #[arg(long)]
    allow_outside: bool,

    /// Layout of a volume without a header: WxHxD:type[:le|be][:spacing], type u8, i8, u16, i16, u32, i32, f32 or f64
    #[arg(long, value_name = "LAYOUT")]
    raw: Option<String>,

    /// Width and height of the picture
    #[arg(long, value_name = "WxH")]
    size: Option<PictureSize>,

    /// What rays look for
    #[arg(long, value_name = "MODE")]
    mode: Option<ModeName>,

    /// How values between voxels are made
    #[arg(long, value_name = "NAME")]
    interpolation: Option<InterpolationName>,

    /// Length of a step in voxels, 0.001 to 1000; smaller is finer and slower
    #[arg(long, value_name = "VOXELS", value_parser = step, allow_negative_numbers = true)]
    step: Option<f64>,

    /// Samples a pixel, 1 or more
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    samples: Option<u32>,

    /// Seed of the patterns of pixels and samples; the output records it
    #[arg(long, value_name = "N", value_parser = seed_of_scene)]
    seed: Option<u64>,

    /// Any value of the scene, such as camera.azimuth=30 or march.preintegrated=true; may be given again
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<Override>,
}

/// Which pixels are rendered.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Mask")]
struct PixelArgs {
    /// Render only this share of the pixels, above 0 to 1, spread evenly
    #[arg(long, value_name = "D", value_parser = density)]
    density: Option<f64>,

    #[arg(long, value_name = "SOURCE", help = MASK, conflicts_with = "density")]
    mask: Option<Source>,

    #[command(flatten)]
    adaptive: AdaptiveArgs,

    /// Fill the other pixels in memory with this filter's default settings, and report both times
    #[arg(long, value_name = "FILTER", value_parser = NameParser::without_dictionaries())]
    fill: Option<FilterName>,

    /// Do not estimate how wrong the filled pixels are
    #[arg(long, requires = "fill")]
    no_estimate: bool,
}

/// What a frame holds besides colour and alpha.
#[derive(Args, Clone, Debug)]
// Each is a flag of its own.
#[allow(clippy::struct_excessive_bools)]
#[command(next_help_heading = "Output")]
struct LayerArgs {
    /// Add Z: distance from the camera to where opacity reaches march.depth-opacity, or to the place that iso and mip show;
    /// infinite where there is none. The nearest of a pixel's samples
    #[arg(long)]
    depth: bool,

    /// Add N.X, N.Y, N.Z: the surface normal in world coordinates, from high to low values, samples weighted by what they add
    /// to alpha
    #[arg(long)]
    normals: bool,

    /// Add samples: how many a pixel had
    #[arg(long)]
    count: bool,

    /// Add the layers dx and dy: the colour's derivatives per pixel, by central differences over half a pixel; four
    /// more rays a sample
    #[arg(long)]
    gradients: bool,

    /// Add dense.albedo.R to .B, dense.A, dense.N.X to .Z, dense.Z: colour without light, alpha, normal and distance of
    /// every pixel, by a coarse march (march.dense-step, march.dense-samples), listed in lacuna/dense
    ///
    /// Filling takes them for guides, with --fill auto here or with lacuna fill later.
    #[arg(long)]
    dense_aovs: bool,

    /// Add motion.X and motion.Y: how far what a pixel shows moves until the next frame, pixels to the right and down, by the
    /// distance of dense.Z of its centre and both cameras
    ///
    /// Of every pixel, listed in lacuna/dense; 0 where nothing is seen, infinite behind the next camera.
    #[arg(long)]
    motion: bool,

    /// Type of colours, normals and derivatives
    #[arg(short = 'd', long, value_name = "TYPE", default_value = "float")]
    data_type: Depth,
}

/// Width and height.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct PictureSize([usize; 2]);

impl FromStr for PictureSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (width, height) = text.split_once('x').ok_or("not a size such as 1920x1080")?;
        match (width.parse(), height.parse()) {
            (Ok(width @ 1..=65_536), Ok(height @ 1..=65_536)) => Ok(Self([width, height])),
            _ => Err("not a size such as 1920x1080, 1 to 65536 each".into()),
        }
    }
}

impl SceneArgs {
    /// `--set` first, so that a flag of its own decides.
    fn overrides(&self) -> Result<Vec<Override>, Usage> {
        fn name(value: &impl ValueEnum) -> String {
            value.to_possible_value().map_or(String::new(), |value| format!("{:?}", value.get_name()))
        }
        let mut found = self.set.clone();
        // A path on the command line is relative to the working folder, not to the scene.
        let volume = |path: &PathBuf| {
            let wrong = |why: &str| Usage(format!("--volume {}: {why}", path.display()));
            let made = path.to_string_lossy().starts_with(PROCEDURAL);
            let full = if made { Ok(path.clone()) } else { std::path::absolute(path) };
            let full = full.map_err(|error| wrong(&error.to_string()))?.into_os_string().into_string();
            full.map_err(|_| wrong("its path is not UTF-8: rename it"))
        };
        let volume = self.volume.as_ref().map(volume).transpose()?;
        let values = [
            ("volume", volume.map(|path| toml::Value::String(path).to_string())),
            ("raw", self.raw.as_ref().map(|raw| toml::Value::String(raw.clone()).to_string())),
            ("image.size", self.size.map(|size| format!("{:?}", size.0))),
            ("image.samples", self.samples.map(|samples| samples.to_string())),
            ("image.seed", self.seed.map(|seed| seed.to_string())),
            ("march.mode", self.mode.as_ref().map(name)),
            ("march.interpolation", self.interpolation.as_ref().map(name)),
            ("march.step", self.step.map(|step| format!("{step:?}"))),
        ];
        for (path, value) in values {
            found.extend(value.map(|value| Override { path: path.into(), value }));
        }
        Ok(found)
    }
}

impl RenderArgs {
    /// The checked job.
    pub fn job(&self) -> Result<RenderJob, Usage> {
        let (pixels, mask) = match (&self.pixels.mask, self.pixels.density) {
            (Some(source @ Source::File { pattern, .. }), _) => {
                (Pixels::Mask(source.clone()), Some(pattern.clone()))
            }
            (Some(other), _) => {
                return Err(Usage(format!("--mask {other} needs a frame; render takes a mask file")));
            }
            (None, Some(density)) => {
                // The seed is the scene's.
                let rounds = self.pixels.adaptive.settings(density, 0)?;
                (rounds.map_or(Pixels::Shuffle(density), Pixels::Adaptive), None)
            }
            (None, None) => (Pixels::All, None),
        };
        if self.pixels.fill.is_some() && pixels == Pixels::All {
            return Err(Usage(
                "--fill needs --density or --mask: without them every pixel is rendered".into(),
            ));
        }
        let packing = self.compression;
        let run = RunOptions { page: self.page.report.clone(), ..self.run.options() };
        let kind = SampleType::from(self.layers.data_type);
        Ok(RenderJob {
            scene: self.scene.clone(),
            overrides: self.scene_values.overrides()?,
            frames: self.frames.clone(),
            targets: Targets {
                neighbours: 0,
                guides: None,
                layers: Vec::new(),
                output: self.output.checked(true)?,
                mask,
                also_read: Vec::new(),
                also_written: run.also_written(),
                create_dir: self.output.create_dir,
            },
            allow_outside: self.scene_values.allow_outside,
            pixels,
            wanted: Wanted {
                depth: self.layers.depth,
                normals: self.layers.normals,
                samples: self.layers.count,
                gradients: self.layers.gradients,
                dense: self.layers.dense_aovs,
                motion: self.layers.motion,
                kind,
                compression: packing.map_or(Compression::Zip, |packing| packing.compression),
            },
            level: packing.and_then(|packing| packing.level),
            fill: self.pixels.fill.map(method).transpose()?,
            estimate: !self.pixels.no_estimate,
            existing: self.output.existing(self.update),
            run,
        })
    }
}

/// A filter with its default settings.
fn method(FilterName(filter): FilterName) -> Result<Method, Usage> {
    Method::of(filter, &[]).map_err(|error| Usage(error.to_string()))
}
