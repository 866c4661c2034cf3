//! `lacuna fill`: flags to a checked job.

use std::path::PathBuf;

use clap::Args;
use lacuna_filters::Method;
use lacuna_filters::fill::Estimate;

use super::Usage;
use super::channels::{self, ChannelArgs, RulesArgs};
use super::estimate::EstimateArgs;
use super::filter::AroundArgs;
use super::guides::GuideArgs;
use super::input::InputArgs;
use super::layers::LayerArgs;
use super::mask_source::MaskArgs;
use super::noise::NoiseArgs;
use super::output::{FormatArgs, MoreOutput, OutputArgs};
use super::run::{PageArgs, RunArgs, SolveArgs};
use super::settings::{BaselineArgs, FilterArgs};
use super::temporal::TemporalArgs;
use super::weights::WeightArgs;
use crate::channels::Override;
use crate::commands::FillJob;
use crate::files::Targets;
use crate::guides::Asked;
use crate::reconstruct::{self, Enlarge, Gate, NoiseSource};
use crate::run::RunOptions;
use crate::temporal::Temporal;

const EXAMPLES: &str = "\
Examples:
  lacuna fill sparse.exr -o full.exr
  lacuna fill 'shot.####.exr' -o full/ --frames 1-100 --create-dir
  lacuna fill 'in/*.exr' -o out/ -u --json report.json
  lacuna fill shot.exr -o full.exr --mask file:mask.png --channels 'id*=keep'
  lacuna fill shot.exr -o full.exr --filter tv --tv-gap 1e-3

Exit status: 0 all done, 1 some frame failed, 2 usage, 128 + n on signal n.";

/// Fill the missing pixels of sparse EXR frames
///
/// Reads frames in which only some pixels were measured, reconstructs the rest and writes complete frames. A measured
/// pixel keeps its bits unless an option asks for smoothing or for another type; whatever has no business being reconstructed passes through.
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct FillArgs {
    #[command(flatten)]
    input: InputArgs,

    #[command(flatten)]
    layers: LayerArgs,

    #[command(flatten)]
    mask: MaskArgs,

    /// Fill frames that were filled before, from the pixels that the mask calls measured; else they are refused
    #[arg(long, help_heading = "Mask")]
    again: bool,

    #[command(flatten)]
    channels: ChannelArgs,

    #[command(flatten)]
    rules: RulesArgs,

    #[command(flatten)]
    filter: FilterArgs,

    #[command(flatten)]
    around: AroundArgs,

    #[command(flatten)]
    weights: WeightArgs,

    #[command(flatten)]
    noise: NoiseArgs,

    #[command(flatten)]
    guides: GuideArgs,

    #[command(flatten)]
    temporal: TemporalArgs,

    #[command(flatten)]
    estimate: EstimateArgs,

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

    #[command(flatten)]
    page: PageArgs,

    #[command(flatten)]
    _baselines: BaselineArgs,
}

impl FillArgs {
    /// The checked job.
    pub fn job(&self) -> Result<FillJob, Usage> {
        let groups = Groups {
            input: &self.input,
            mask: &self.mask,
            channels: &self.channels,
            rules: &self.rules,
            around: &self.around,
            output: &self.output,
            format: &self.format,
            more: &self.more,
            run: &self.run,
            solve: &self.solve,
            page: Some(&self.page),
            guides: Some(&self.guides),
            weights: Some(&self.weights),
            noise: Some(&self.noise),
            layers: Some(&self.layers),
            estimate: Some(&self.estimate),
            temporal: Some(&self.temporal),
        };
        let method = self.filter.method(self.run.options().memory)?;
        let mut job = FillJob { again: self.again, ..groups.job(method, None)? };
        job.targets.also_read.extend(self.filter.file().map(|path| ("dictionary", path.clone())));
        Ok(job)
    }
}

/// The flags that filling shares with enlarging.
pub(super) struct Groups<'a> {
    pub input: &'a InputArgs,
    pub mask: &'a MaskArgs,
    pub channels: &'a ChannelArgs,
    pub rules: &'a RulesArgs,
    pub around: &'a AroundArgs,
    pub output: &'a OutputArgs,
    pub format: &'a FormatArgs,
    pub more: &'a MoreOutput,
    pub run: &'a RunArgs,
    pub solve: &'a SolveArgs,
    pub page: Option<&'a PageArgs>,
    pub guides: Option<&'a GuideArgs>,
    pub weights: Option<&'a WeightArgs>,
    pub noise: Option<&'a NoiseArgs>,
    pub layers: Option<&'a LayerArgs>,
    pub estimate: Option<&'a EstimateArgs>,
    pub temporal: Option<&'a TemporalArgs>,
}

impl Groups<'_> {
    /// The files that tell what is done.
    fn also_read(&self) -> Vec<(&'static str, PathBuf)> {
        let rules = self.rules.rules.clone().map(|path| ("file of --rules", path));
        self.input.listed().into_iter().chain(rules).collect()
    }

    /// The checked job of a method that fills, and of what is done afterwards.
    pub fn job(&self, method: Method, enlarge: Option<Enlarge>) -> Result<FillJob, Usage> {
        let (selection, skip_missing) = self.input.selection();
        let packing = self.format.compression;
        let layers = self.layers.map_or(&[][..], |layers| &layers.layers);
        let mut what = reconstruct::Job {
            method,
            domain: self.around.domain(),
            limit: self.around.limits(),
            kind: self.more.kind(),
            drop_mask: self.more.drop_mask,
            compression: packing.map(|packing| packing.compression),
            level: packing.and_then(|packing| packing.level),
            mask: self.mask.mask.clone(),
            overrides: channels::all(self.channels, self.rules.rules.as_deref())?,
            rules: self.rules.rules.as_ref().map(|path| path.display().to_string()),
            enlarge,
            guides: self.guides.map_or(Asked::None, |guides| guides.guides.clone()),
            guides_from: self.guides.and_then(|guides| guides.guides_from.clone()),
            weights: self.weights.and_then(|weights| weights.weights.clone()),
            noise: NoiseSource::None,
            temporal: self.temporal.map_or_else(|| Ok(Temporal::default()), TemporalArgs::temporal)?,
            layers: layers.iter().map(ToString::to_string).collect(),
            estimate: self.estimate.map_or(Estimate::No, EstimateArgs::estimate),
            peak: self.estimate.map_or(1.0, |estimate| estimate.peak),
            error_channel: self.estimate.and_then(|estimate| estimate.error_channel.clone()),
        };
        // How much to smooth is chosen by noise, wherever that is known from.
        let unless_given = if what.method.is_open() { NoiseSource::Auto } else { NoiseSource::None };
        what.noise = self.noise.and_then(|noise| noise.noise.clone()).unwrap_or(unless_given);
        // What counts samples is true where it is 0, too.
        let own = what.counts().filter(|name| !what.overrides.iter().any(|rule| rule.matches(name)));
        let own = own.and_then(Override::keeping);
        what.overrides.extend(own);
        WeightArgs::check(&what)?;
        NoiseArgs::check(&what)?;
        TemporalArgs::check(&what)?;
        if let Some(guides) = self.guides {
            guides.check(&what)?;
        }
        let page = self.page.and_then(|page| page.report.clone());
        let run = RunOptions { page, time_limit: self.solve.time_limit, ..self.run.options() };
        Ok(FillJob {
            selection,
            skip_missing,
            targets: Targets {
                output: self.output.checked(self.page.is_some())?,
                mask: self.mask.file(),
                guides: what.guides_from.clone(),
                also_read: self.also_read(),
                also_written: run.also_written(),
                layers: layers.to_vec(),
                neighbours: what.temporal.window.each(),
                create_dir: self.output.create_dir,
            },
            what,
            again: false,
            existing: self.output.existing(self.more.update),
            gate: self.estimate.map_or_else(Gate::default, EstimateArgs::gate),
            run,
        })
    }
}
