//! `lacuna compare`: flags to a checked job.

use std::path::PathBuf;

use clap::Args;

use super::Usage;
use super::input::FramesArgs;
use super::numbers::peak;
use super::run::RunArgs;
use crate::commands::{CompareJob, CompareOutputs};
use crate::files::Selection;
use crate::mask::Source;
use crate::report::{Bound, Gate, Measure, Settings, Wanted};

const EXAMPLES: &str = "\
Examples:
  lacuna compare full.exr filled.exr
  lacuna compare 'full/shot.#.exr' 'filled/shot.#.exr' --html shot.html
  lacuna compare full.exr filled.exr --mask file:mask.png --csv values.csv
  lacuna compare full.exr filled.exr --fail-below psnr=40 --fail-above flip=0.05

Exit status: 0 all compared and within the bounds, 1 a frame is not or cannot be read, 2 usage, 128 + n on signal n.";

const MASK: &str =
    "Which pixels were measured, as in fill [default: what the test image's attributes say, or its mask]";

const MISSING: &str =
    "A reference that does not exist: fail (the others are compared, exit status 1) or pass over it";

/// Measure how far test images are from their references
///
/// Per part, layer and group of channels (R, G and B of a layer together): MSE, RMSE, largest error, PSNR, relative MSE,
/// PSNR of logarithms, SSIM, counts of NaN and infinities, on request CIELUV, FLIP, HDR-FLIP, flicker, in place or along the motion, and the reference's own change; over the whole
/// image, over the missing pixels only, and where the reference's alpha is above 0. Pixels are compared by absolute coordinates: where data windows differ,
/// a pixel that only one image has counts as 0 in the other, and that is said. The tables go to standard output as
/// Markdown, unless a report goes there.
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES, mut_arg("missing_frame", |missing| missing.help(MISSING)))]
pub struct CompareArgs {
    /// The reference: a file, a pattern or a glob, as in fill
    #[arg(value_name = "REFERENCE", display_order = 0, help_heading = "Input and frames")]
    reference: PathBuf,

    /// The test image: a file, a pattern or a folder, as fill's OUTPUT
    #[arg(value_name = "TEST", display_order = 1, help_heading = "Input and frames")]
    test: PathBuf,

    #[command(flatten)]
    frames: FramesArgs,

    #[arg(long, value_name = "SOURCE", help = MASK, help_heading = "Mask")]
    mask: Option<Source>,

    #[command(flatten)]
    measures: MeasureArgs,

    #[command(flatten)]
    outputs: ReportArgs,

    #[command(flatten)]
    run: RunArgs,
}

/// How images are compared, and what is good enough.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Measures")]
struct MeasureArgs {
    /// Compute these as well, separated by commas: cieluv, flip, hdr-flip, flicker (with change), flicker-along (along the motion, with
    /// change-along), or all of them with all
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    measures: Vec<String>,

    /// The value of colours that counts as white, above 0; that of alphas is 1
    #[arg(long, value_name = "VALUE", default_value = "1", value_parser = peak)]
    peak: f32,

    /// Do not clip colours and alphas to 0 to white before they are compared
    #[arg(long)]
    no_clip: bool,

    /// Compare colours as a display shows them: clipped to 0 to 1, after the sRGB curve
    #[arg(long, conflicts_with_all = ["no_clip", "peak"])]
    display: bool,

    /// HDR-FLIP with images looked at between these luminances, for the same exposures in every frame, for example 0.18,2
    /// [default: the reference's median and largest, frame by frame]
    #[arg(long, value_name = "DARK,BRIGHT", value_parser = range)]
    hdr_range: Option<(f64, f64)>,

    /// Exit with status 1 and name the frames if a measure of the colours is below its bound: psnr=40,ssim=0.98, or for a
    /// region missing.psnr=38, alpha.ssim=0.97
    #[arg(long, value_name = "BOUNDS", value_delimiter = ',')]
    fail_below: Vec<Bound>,

    /// The same for measures above their bounds: flip=0.05,nan=0,different=0
    #[arg(long, value_name = "BOUNDS", value_delimiter = ',')]
    fail_above: Vec<Bound>,
}

/// Where the comparison goes, besides standard output and `--json`.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Reports")]
struct ReportArgs {
    /// Write every measure as CSV (- is standard output, as for the others): a line a frame, group, channel and region
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,

    /// Write the tables as Markdown
    #[arg(long = "md", value_name = "FILE")]
    markdown: Option<PathBuf>,

    /// Write one HTML page with tables, plots and a viewer for the ten worst frames; it needs no other file and no network,
    /// and computes CIELUV, FLIP and flicker as well
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,

    /// Write maps of each frame into this folder: one EXR with absolute error, SSIM, CIELUV and FLIP, and PNG pictures
    #[arg(long, value_name = "DIR")]
    maps: Option<PathBuf>,
}

fn range(text: &str) -> Result<(f64, f64), String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|number| number.trim().parse().ok()).collect();
    match numbers[..] {
        [dark, bright] if dark > 0.0 && bright >= dark && bright.is_finite() => Ok((dark, bright)),
        _ => Err("must be two luminances above 0, the darker first".into()),
    }
}

impl ReportArgs {
    fn files(&self) -> CompareOutputs {
        CompareOutputs {
            csv: self.csv.clone(),
            markdown: self.markdown.clone(),
            html: self.html.clone(),
            maps: self.maps.clone(),
        }
    }
}

impl CompareArgs {
    /// The checked job.
    pub fn job(&self) -> Result<CompareJob, Usage> {
        let gate = Gate { below: self.measures.fail_below.clone(), above: self.measures.fail_above.clone() };
        let mut wanted = Wanted::default();
        gate.measures().for_each(|measure| wanted.add(measure));
        for name in &self.measures.measures {
            match (name.as_str(), Measure::from_name(name)) {
                ("all", _) => wanted = Wanted::all(),
                (_, Some(measure)) => wanted.add(measure),
                _ => {
                    let names: Vec<_> = Measure::on_request().map(Measure::name).collect();
                    return Err(Usage(format!(
                        "--measures: '{name}' is no measure; those on request are {} and all",
                        names.join(", ")
                    )));
                }
            }
        }
        if self.measures.hdr_range.is_some() {
            wanted.add(Measure::HdrFlip);
        }
        if self.outputs.html.is_some() {
            for measure in [Measure::Cieluv, Measure::Flip, Measure::Flicker] {
                wanted.add(measure);
            }
        }
        if self.outputs.maps.is_some() {
            wanted.add(Measure::Cieluv);
            wanted.add(Measure::Flip);
        }
        let measures = &self.measures;
        Ok(CompareJob {
            selection: Selection {
                inputs: vec![self.reference.clone()],
                files_from: None,
                frames: self.frames.frames.clone(),
            },
            skip_missing: self.frames.skips_missing(),
            test: self.test.clone(),
            mask: self.mask.clone(),
            settings: Settings {
                peak: measures.peak,
                clip: !measures.no_clip,
                display: measures.display,
                hdr_range: measures.hdr_range,
                wanted,
            },
            gate,
            outputs: self.outputs.files(),
            run: self.run.options(),
        })
    }
}
