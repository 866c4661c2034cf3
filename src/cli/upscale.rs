//! `lacuna upscale`: flags to a checked job.

use clap::{Args, ValueEnum};
use lacuna_filters::descriptor::{Descriptor, Setting};
use lacuna_filters::upscale::plain::Kernel;
use lacuna_filters::upscale::{Method, Sampling};
use lacuna_filters::variational::tv;

use super::Usage;
use super::channels::{ChannelArgs, RulesArgs};
use super::fill::Groups;
use super::filter::{AroundArgs, DomainName};
use super::guides::GuideArgs;
use super::input::InputArgs;
use super::mask_source::MaskArgs;
use super::output::{FormatArgs, MoreOutput, OutputArgs};
use super::run::{RunArgs, SolveArgs};
use super::settings::{Offer, SettingArgs};
use super::words::Words;
use crate::commands::FillJob;
use crate::guides::Asked;
use crate::reconstruct::{Enlarge, Target, logarithms_of};

const EXAMPLES: &str = "\
Examples:
  lacuna upscale small.exr -o large.exr --scale 2
  lacuna upscale 'shot.####.exr' -o large/ --size 3840x2160 --create-dir
  lacuna upscale sparse.exr -o large.exr --scale 1.5 --mask file:mask.png
  lacuna upscale small.exr -o large.exr --scale 2 --sampling gaussian:1
  lacuna upscale small.exr -o large.exr --scale 2 --guides-from aovs.exr

Guides: normals, depth, albedo and alpha rendered at the size of the output, a sample a pixel say, cost a renderer next to nothing. \
They stand in a file of their own (--guides-from) and say where edges run within a small pixel.

Which --sampling: what the renderer's pixel filter makes. Path tracers with a box, triangle, Blackman-Harris or area filter of \
about a pixel: box. A Gaussian or Mitchell filter: that one, with the radius in the renderer's settings (a width of 2 is \
a radius of 1). One ray through the centre of each pixel, as in lacuna render: point. Pixels kept from a larger render, as \
oiiotool or a mask of every second pixel does: grid. To tell by a frame: render one small and large, and take the model \
for which lacuna compare shows the least error.

Exit status: 0 all done, 1 some frame failed, 2 usage, 128 + n on signal n.";

const LIMIT: &str = "on or off: hold overshoot beside highlights and edges back to what the samples around allow, with --sampling \
                     box and grid, and in missing pixels";

const GUIDES: &str = "Channels of --guides-from that steer colour within a small pixel: auto, none, or full names separated by \
                      commas, globs allowed (N.*,Z)";

const GUIDES_MORE: &str = "auto: what the attribute lacuna/dense lists, and normals, positions, albedo, depth and alpha if every \
                           pixel holds them. Guides that do not predict the colour count for nothing; identifiers steer nothing \
                           here. Only with --filter ss.";

const GUIDES_FROM: &str =
    "The guides' file, or pattern that goes frame by frame: of the pixels of the output";

/// Make EXR frames larger, and fill them if pixels are missing
///
/// Reads frames rendered at a low resolution and writes them at a higher one. The result, reduced again as a pixel of the renderer
/// does it, is the input where bounds allow it, so that light and highlights keep their energy where a pixel is a mean: with --sampling box, and
/// with gaussian and mitchell except beside hard edges; a sample at a point says nothing of energy. No light becomes negative. Every channel by its rule: colour is
/// reconstructed, normals keep their lengths, depths, identifiers and kept channels take the value of the pixel they lie in, motion
/// vectors grow with the frame.
/// Frames without a mask are complete.
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES, mut_arg("limit", |limit| limit.help(LIMIT)))]
#[command(mut_arg("guides", |guides| guides.help(GUIDES).long_help(format!("{GUIDES}\n\n{GUIDES_MORE}"))))]
#[command(mut_arg("guides_from", |from| from.help(GUIDES_FROM)))]
pub struct UpscaleArgs {
    #[command(flatten)]
    input: InputArgs,

    #[command(flatten)]
    size: SizeArgs,

    #[command(flatten)]
    filter: MethodArgs,

    #[command(flatten)]
    guides: GuideArgs,

    #[command(flatten)]
    larger: LargerArgs,

    #[command(flatten)]
    mask: MaskArgs,

    #[command(flatten)]
    channels: ChannelArgs,

    #[command(flatten)]
    rules: RulesArgs,

    #[command(flatten)]
    output: OutputArgs,

    #[command(flatten)]
    format: FormatArgs,

    #[command(flatten)]
    more: MoreOutput,

    #[command(flatten)]
    run: RunArgs,

    #[command(flatten)]
    solve: SolveArgs,
}

/// How large.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Size")]
struct SizeArgs {
    /// Factor, above 1 to 16, broken ones too; two for width and height: 2x1.5
    #[arg(long, value_name = "S", value_parser = Target::scale, allow_hyphen_values = true)]
    #[arg(conflicts_with = "size")]
    scale: Option<Target>,

    /// Size of the display window; the data window follows
    #[arg(long, value_name = "WxH", value_parser = Target::size, allow_hyphen_values = true)]
    size: Option<Target>,
}

/// What is of the larger frame.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Guides")]
struct LargerArgs {
    /// Take channels of the frame that are no light (normals, depth, identifiers, alpha) from the guides' file, as they are there,
    /// where it has them by the same names
    #[arg(long, requires = "guides_from")]
    take_guides: bool,

    /// Motion vectors: scale (they are in pixels, and become pixels of the larger frame) or keep (they are normalised)
    #[arg(long, value_name = "HOW", default_value = "scale", help_heading = "Channels")]
    vectors: Vectors,
}

/// What becomes of motion vectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Vectors {
    /// Times the factor
    Scale,
    /// The numbers as they are
    Keep,
}

/// How.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Filter")]
struct MethodArgs {
    /// The filter that makes the larger image
    #[arg(long, value_name = "NAME", default_value = "ss")]
    filter: Choice,

    /// What a pixel of the input is, for --filter ss and tv: point (the value at its centre), grid (the pixel (S i, S j) of the
    /// larger frame; whole factors), box (the mean over its area), gaussian:R (R is 0.5 to 1.5 pixels) or mitchell; see below
    /// [default: box, and point for frames that lacuna render made with one ray a pixel]
    #[arg(long, value_name = "MODEL", value_parser = Words::<Sampling>::new(MODELS), hide_possible_values = true)]
    sampling: Option<Sampling>,

    #[command(flatten)]
    settings: SettingArgs<Enlarging>,

    #[command(flatten)]
    around: AroundArgs,
}

/// A filter that enlarges.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Choice {
    /// Smoothness splines: the best on smooth renders, and fast
    Ss,
    /// Total variation: flat regions between sharp edges
    Tv,
    /// A windowed sinc, without a model of a pixel
    Lanczos3,
    /// The cubic of Catmull and Rom, without a model of a pixel
    Cubic,
    /// Straight lines between pixels, without a model of a pixel
    Linear,
}

/// The models of a pixel.
const MODELS: &[&str] = &["point", "grid", "box", "gaussian:1", "mitchell"];

/// The filters whose settings count.
#[derive(Clone, Copy, Debug)]
struct Enlarging;

impl Offer for Enlarging {
    fn methods() -> Vec<&'static Descriptor> {
        vec![&tv::DESCRIPTOR]
    }

    fn has(setting: &Setting) -> bool {
        // Enlarging has one solver, and keeps what was measured.
        setting.flag != "tv-solver" && !setting.smooths
    }
}

impl MethodArgs {
    /// The filter with its settings.
    fn method(&self) -> Result<Method, Usage> {
        let name = self.filter.to_possible_value();
        let name = name.as_ref().map_or("", |value| value.get_name());
        if let Some((setting, _)) = self.settings.of(&tv::DESCRIPTOR).find(|_| self.filter != Choice::Tv) {
            return Err(SettingArgs::<Enlarging>::of_another(setting.flag, name));
        }
        let has_model = matches!(self.filter, Choice::Ss | Choice::Tv);
        if let Some(sampling) = self.sampling.filter(|_| !has_model) {
            return Err(Usage(format!(
                "--sampling {sampling} is a model of a pixel, which --filter {name} has none of: ss and tv have"
            )));
        }
        // What a frame's pixels are is known once it is read, where nobody says it.
        let asked = self.sampling.filter(|model| !model.is_pointwise());
        if let (DomainName::Log, Some(model)) = (self.around.domain, asked) {
            return Err(Usage(logarithms_of(model)));
        }
        Ok(match self.filter {
            Choice::Ss => Method::Ss,
            Choice::Tv => {
                let mut settings = tv::Settings::default();
                self.settings.apply(&mut settings);
                Method::Tv(settings)
            }
            Choice::Lanczos3 => Method::Plain(Kernel::Lanczos3),
            Choice::Cubic => Method::Plain(Kernel::Cubic),
            Choice::Linear => Method::Plain(Kernel::Linear),
        })
    }
}

impl UpscaleArgs {
    /// The checked job.
    pub fn job(&self) -> Result<FillJob, Usage> {
        let Some(target) = self.size.scale.or(self.size.size) else {
            return Err(Usage("how large is not said: give --scale S or --size WxH".into()));
        };
        let broken = matches!(target, Target::Scale { x, y } if x.fract() != 0.0 || y.fract() != 0.0);
        if self.filter.sampling == Some(Sampling::Grid) && broken {
            return Err(Usage(
                "--sampling grid needs whole factors, such as --scale 2; --sampling point takes broken ones"
                    .into(),
            ));
        }
        let groups = Groups {
            input: &self.input,
            mask: &self.mask,
            channels: &self.channels,
            rules: &self.rules,
            around: &self.filter.around,
            output: &self.output,
            format: &self.format,
            more: &self.more,
            run: &self.run,
            solve: &self.solve,
            page: None,
            guides: Some(&self.guides),
            weights: None,
            noise: None,
            layers: None,
            estimate: None,
            temporal: None,
        };
        if matches!(self.guides.guides, Asked::Channels(_)) && self.guides.guides_from.is_none() {
            return Err(Usage(
                "--guides: guides of the larger size stand in another file: name it with --guides-from"
                    .into(),
            ));
        }
        let steers = self.guides.guides_from.is_some() && self.guides.guides != Asked::None;
        if steers && self.filter.filter != Choice::Ss {
            return Err(Usage(
                "--guides-from: only --filter ss takes guides here; --guides none with --take-guides takes its channels only"
                    .into(),
            ));
        }
        let enlarge = Enlarge {
            target,
            method: self.filter.method()?,
            sampling: self.filter.sampling,
            take_guides: self.larger.take_guides,
            keep_vectors: self.larger.vectors == Vectors::Keep,
        };
        groups.job(lacuna_filters::Method::default(), Some(enlarge))
    }
}
