//! Filling frames, and enlarging them: what is done with each, and with all of them.

mod current;
mod ending;
mod hints;
mod needs;

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use current::may_be_copy;
use lacuna_exr::{Channel, Frame, Limits};
use lacuna_filters::{Run, Stop};

use crate::channels::{self, Rule};
use crate::commands::page::Page;
use crate::files::content::{Seen, Sums};
use crate::files::error::PlanError;
use crate::files::inputs::Selection;
use crate::files::plan::{Item, Targets, plan};
use crate::mask::shared::MaskFiles;
use crate::mask::{self, MaskFile, Masks, Source, layers};
use crate::reconstruct::estimate::joined;
use crate::reconstruct::shared::SharedPlans;
use crate::reconstruct::{
    self, Beside, Enlarge, Estimated, Gate, GroupReport, PartReport, Report, behind, copied_line, energy,
    estimate, named, was_smoothed, wrong_mask,
};
use crate::run::batch::{Decision, Failure, RunOptions, Stage, Work};
use crate::run::existing::Existing;
use crate::run::record::{Estimate, Heading, Light, Record};
use crate::run::schedule::Need;
use crate::run::{batch, outputs};
use crate::temporal::{NeighbourFiles, Neighbours, Reading};

/// Frames to be filled, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct FillJob {
    /// The frames.
    pub selection: Selection,
    /// Whether frames that do not exist are passed over.
    pub skip_missing: bool,
    /// Where outputs go.
    pub targets: Targets,
    /// What is done to a frame.
    pub what: reconstruct::Job,
    /// What happens to outputs that exist.
    pub existing: Existing,
    /// Whether frames that were filled before are filled again.
    pub again: bool,
    /// What the fill must reach by its estimate.
    pub gate: Gate,
    /// How to run.
    pub run: RunOptions,
}

impl FillJob {
    /// The subcommand that does it.
    pub fn command(&self) -> &'static str {
        if self.what.enlarge.is_some() { "upscale" } else { "fill" }
    }

    /// Whether there is a plan for it, as every task of a farm will find. Opens no frame, changes nothing.
    pub fn check(&self) -> Result<(), PlanError> {
        plan(&self.selection, &self.targets)?;
        self.run.console().map(drop)
    }
}

/// Fills the frames; the exit status.
pub fn fill(job: &FillJob) -> Result<u8, PlanError> {
    let plan = plan(&job.selection, &job.targets)?;
    let work = Fill {
        job,
        plans: SharedPlans::new(job.run.memory.is_some()),
        masks: MaskFiles::default(),
        neighbours: NeighbourFiles::default(),
        sums: Sums::default(),
        page: Page::new(job.run.page.as_ref(), plan.items.len()),
    };
    let console = job.run.console()?;
    if job.run.dry_run {
        return Ok(outputs::print(&plan, &work, &console));
    }
    console.listen();
    if let Some(warning) = hints::alone(&job.what, &plan.items) {
        console.warning(&warning);
    }
    outputs::make_folders(&plan)?;
    let heading = Heading {
        lacuna: env!("CARGO_PKG_VERSION"),
        command: job.command(),
        filter: Some(job.what.filter_name().into()),
        settings: Some(job.what.settings()),
    };
    batch::run(heading, &plan.items, &job.run, &work, &console).map_err(PlanError::Failed)
}

struct Fill<'a> {
    job: &'a FillJob,
    plans: SharedPlans,
    masks: MaskFiles,
    neighbours: NeighbourFiles,
    sums: Sums,
    page: Page,
}

/// What is read for a frame.
struct Loaded {
    /// With its layers.
    frame: Frame,
    mask: Option<Arc<MaskFile>>,
    guides: Option<Frame>,
    neighbours: Neighbours,
}

impl Fill<'_> {
    fn read(&self, item: &Item) -> Result<Loaded, Failure> {
        let limits = self.limits(item);
        let mut frame =
            lacuna_exr::read(&item.input, &limits).map_err(|error| Failure::at(&item.input, error))?;
        let left = layers::read_into(&mut frame, &item.layers, limits)
            .map_err(|(path, why)| Failure::at(&path, why))?;
        for note in left {
            tracing::warn!("{}: {note}", item.input.display());
        }
        let mask = item.mask.as_deref().map(|path| self.masks.get(path, limits)).transpose();
        let mask = mask.map_err(|error| Failure::at(&item.input, error))?;
        let guides = item.guides.as_deref();
        let guides =
            guides.map(|path| lacuna_exr::read(path, &limits).map_err(|error| Failure::at(path, error)));
        let number = item.number.unwrap_or_default();
        let reading = Reading {
            source: &self.job.what.mask,
            masks: &self.masks,
            again: self.job.again,
            guides: *self.job.what.wanted() != crate::guides::Asked::None,
            // As many as the window has, and those of frames that are read beside.
            most: item.neighbours.len() + self.job.run.parallel_frames.max(1),
            limits,
        };
        let neighbours = self.neighbours.read((number, &frame), &item.neighbours, reading);
        Ok(Loaded { frame, mask, guides: guides.transpose()?, neighbours })
    }

    /// The masks to go by. A frame to be enlarged may well be complete; one to be filled is not, and was not filled before.
    fn masks_of(&self, frame: &Frame, found: Result<Masks, mask::Error>) -> Result<Masks, String> {
        let what = &self.job.what;
        let made = || frame.parts.iter().find_map(reconstruct::made_by);
        let masks = match (found, made()) {
            (Err(mask::Error::NotFound { .. }), Some(made)) if what.enlarge.is_some() => {
                tell_complete(&made);
                return Ok(Masks::complete(frame));
            }
            (Err(mask::Error::NotFound { hint, .. }), None) if what.enlarge.is_some() => {
                return Ok(Masks { notes: hint.into_iter().collect(), ..Masks::complete(frame) });
            }
            (Err(mask::Error::NotFound { hint: None, .. }), Some(made)) => {
                return Err(format!("{made} already, and without a mask: nothing says what to fill"));
            }
            (found, _) => found.map_err(|error| error.to_string())?,
        };
        let may_be_complete = what.enlarge.is_some() && what.mask == Source::Auto;
        if let Some(complete) = may_be_complete.then(|| mask::beside_element(frame, &masks)).flatten() {
            return Ok(complete);
        }
        let mut masks = masks;
        if mask::filled_before(frame, &masks).is_none() {
            return Ok(masks);
        }
        let made = made().unwrap_or_default();
        if self.job.again {
            let doubt = was_smoothed(frame).then(|| {
                "measured pixels were smoothed when it was filled before: no estimate knows what that cost".to_owned()
            });
            return match doubt {
                Some(doubt) if self.job.gate.is_set() => Err(doubt),
                doubt => {
                    masks.notes.extend(doubt);
                    Ok(masks)
                }
            };
        }
        match (&what.enlarge, &what.mask) {
            (None, _) => Err(format!(
                "{made} already; --again fills it anew from the pixels that its mask calls measured"
            )),
            (Some(_), Source::Auto) => {
                tell_complete(&made);
                Ok(masks.filled(frame))
            }
            (Some(_), _) => Ok(masks),
        }
    }

    /// Whether the output is the copy that this run would make of a frame in which nothing is missing. A copy is the input,
    /// attribute for attribute, so that only the input's mask can tell.
    fn is_copy(&self, item: &Item) -> bool {
        let what = &self.job.what;
        if what.enlarge.is_some() || what.method.restores() || !may_be_copy(item) {
            return false;
        }
        // What cannot be read or filled says so when it is done.
        let Ok(Loaded { frame, mask, guides, .. }) = self.read(item) else { return false };
        let found = mask::find(&frame, &what.mask, mask.as_deref());
        let Some(masks) = found.ok().filter(Masks::is_full) else { return false };
        let choices = channels::choose(&frame, &masks.mask_channels, &what.overrides);
        let (plans, run) = (self.plans.of(&masks), Run::default());
        let beside = Beside { guides: guides.as_ref(), ..Beside::default() };
        reconstruct::fill_with(frame, &masks, &choices, beside, what, &plans, &run)
            .is_ok_and(|(frame, report)| report.copied && holds(&item.output, &frame, self.limits(item)))
    }
}

impl Work for Fill<'_> {
    fn words(&self) -> (&'static str, &'static str) {
        (self.job.command(), if self.job.what.enlarge.is_some() { "enlarged" } else { "filled" })
    }

    fn decide(&self, item: &Item) -> Result<Decision, Failure> {
        let FillJob { skip_missing, existing, gate, .. } = *self.job;
        let stale = |item: &Item| current::stale(item, self.job, &self.sums).filter(|_| !self.is_copy(item));
        let decision = outputs::decide_to_write(item, skip_missing, existing, stale)?;
        // What is there is held to the gate like what is made.
        let is_kept = matches!(decision, Decision::Skip(_)) && item.input.exists();
        let doubt = (is_kept && gate.is_set()).then(|| current::doubt(&item.output, &gate)).flatten();
        doubt.map_or(Ok(decision), |doubt| Err(Failure::kept_doubtful(&item.output, &doubt)))
    }

    fn need(&self, item: &Item) -> Need {
        self.by_header(item)
    }

    fn frame(&self, item: &Item, stage: &Stage<'_>, record: &mut Record) -> Result<(), Failure> {
        let at_input = |error: &dyn std::fmt::Display| Failure::at(&item.input, error);
        let seen = Seen::new(item.used_sources());
        let (loaded, sources) = stage.read(record, || {
            let loaded = self.read(item)?;
            Ok::<_, Failure>((loaded, seen.line(&self.sums)))
        })?;
        let Loaded { mut frame, mask, guides, neighbours } = loaded;
        let what = &self.job.what;
        let beside =
            Beside { guides: guides.as_ref(), neighbours: Some(&neighbours), sources: Some(&sources) };
        record.warn(&neighbours.notes);
        if self.job.again || what.enlarge.is_some() {
            record.warn(&reconstruct::drop_errors(&mut frame, |_, _| true));
        }
        let solved = stage.solve(record, || {
            // From here on: a frame that waits for its turn is not late.
            let start = Instant::now();
            let interrupt = || {
                let late = self.job.run.time_limit.is_some_and(|limit| start.elapsed() >= limit);
                if stage.stopped() { Some(Stop::Cancelled) } else { late.then_some(Stop::TimeLimit) }
            };
            let run = Run { interrupt: Some(&interrupt) };
            let found = mask::find(&frame, &what.mask, mask.as_deref());
            let masks = self.masks_of(&frame, found).map_err(|error| at_input(&error))?;
            self.settle((item, stage), (&frame, guides.as_ref()), &masks)?;
            let choices = channels::choose(&frame, &masks.mask_channels, &what.overrides);
            if mask::filled_before(&frame, &masks).is_none() {
                // Black is filled with black, which no estimate finds doubtful.
                wrong_mask(&frame, &masks, &choices).map_or(Ok(()), |why| Err(at_input(&why)))?;
            } else if self.job.again {
                reconstruct::blank(&mut frame, &masks, &choices);
            }
            let plans = self.plans.of(&masks);
            let done = match &what.enlarge {
                Some(asked) => {
                    reconstruct::enlarge(frame, &masks, &choices, beside, (what, asked), &plans, &run)
                }
                None => reconstruct::fill_with(frame, &masks, &choices, beside, what, &plans, &run),
            };
            let done = done.map_err(|error| Failure::at(about(&error, item), error))?;
            // The masks are those of the frame that was read, not of the enlarged one.
            if what.enlarge.is_none() {
                let mask = |part, channel| masks.get(part, channel).map(|mask| &**mask);
                self.page.look(item, &done.0, mask, true);
            }
            Ok(done)
        });
        let (frame, report) = solved?;
        enter(&report, what.enlarge.as_ref(), record);
        if report.outcome.is_some_and(|outcome| outcome.stop == Stop::Cancelled) {
            return Err(at_input(&"stopped"));
        }
        let doubt = self.job.gate.is_set().then(|| self.job.gate.doubt(&report)).flatten();
        outputs::check_unchanged(&seen, &self.sums)?;
        outputs::write(&frame, item, (self.job.existing, what.level), stage, record)?;
        doubt.map_or(Ok(()), |doubt| Err(Failure::doubtful(&item.output, &doubt)))
    }

    fn hints(&self, records: &[Record]) -> Vec<String> {
        hints::of(&self.job.what, records)
    }

    fn end(&self, heading: &Heading, records: &[Record]) -> Result<(), String> {
        self.page.write(heading, records)
    }
}

/// Whether a file is this frame, bit for bit.
fn holds(path: &Path, frame: &Frame, limits: Limits) -> bool {
    fn channels(frame: &Frame) -> impl Iterator<Item = &Channel> {
        frame.parts.iter().flat_map(|part| &part.channels)
    }
    let same = |(found, own): (&Channel, &Channel)| found.samples.same_bits(&own.samples);
    lacuna_exr::has_header_of(path, frame)
        && lacuna_exr::read(path, &limits).is_ok_and(|found| channels(&found).zip(channels(frame)).all(same))
}

/// Puts what was done into the frame's record, and its notes into the log.
fn enter(report: &Report, enlarge: Option<&Enlarge>, record: &mut Record) {
    record.mask = Some(report.mask.clone());
    record.density = report.density;
    record.non_finite = Some(report.non_finite);
    record.limited = Some(report.limited);
    record.largest_move = Some(report.largest_move);
    record.outcome = report.outcome;
    record.rules = Some(rules(report));
    tell(report, record);
    let light = |(part, group): (Option<String>, &GroupReport)| {
        Some(Light { part, channels: group.channels.clone(), energy: group.energy? })
    };
    record.energies = all_groups(report).filter_map(light).collect();
    let notes =
        groups(report).filter_map(|(part, group)| Some(behind(part.as_deref(), &energy::note(group)?)));
    record.warn(&notes.collect::<Vec<_>>());
    record.warn(&report.notes);
    for remark in &report.remarks {
        tracing::info!("{remark}");
    }
    record.warn(&ending::notes(report, enlarge));
    record.clamped(report.clamped_halves);
}

/// Puts into the record, and says in the log, what steered a fill, what it was made of and how wrong it is.
pub fn tell(report: &Report, record: &mut Record) {
    record.guides = guides(report, usize::MAX);
    if let Some(guides) = guides(report, SHOWN) {
        tracing::info!("guided by {guides}");
    }
    record.copied = joined(report.lines(|part| copied_line(&part.copied)));
    if let Some(copied) = &record.copied {
        tracing::info!("copied, as all measured values are equal: {copied}");
    }
    record.neighbours = neighbours(report);
    if let Some(neighbours) = &record.neighbours {
        tracing::info!("along with {neighbours}");
    }
    for (part, group) in groups(report).filter(|(_, group)| group.noiseless) {
        let names = behind(part.as_deref(), &group.names());
        tracing::info!(
            "{names}: no noise that could be told from detail, and nothing is smoothed; where there is some, half buffers tell it, or --ss-lambda auto smooths all alike"
        );
    }
    for (part, line) in groups(report).filter_map(|(part, group)| Some((part, group.settled()?))) {
        tracing::info!("chosen for {}", behind(part.as_deref(), &line));
    }
    record.chosen = joined(report.lines(|part| estimate::chosen(part.groups.iter())));
    if let Some(chosen) = &record.chosen {
        tracing::info!("chosen, place by place: {chosen}");
    }
    if let Some(line) = joined(report.lines(|part| estimate::line(part.groups.iter()))) {
        tracing::info!("missing pixels by estimate: {line}");
    }
    let estimated = |(part, group): (Option<String>, &GroupReport)| {
        let error = group.estimate.clone()?;
        Some(Estimate { part, channels: group.channels.clone(), error, exponent: group.exponent })
    };
    record.estimates = all_groups(report).filter_map(estimated).collect();
}

/// The groups, each with its part's name where the frame has several: for programs, which look parts up.
fn all_groups(report: &Report) -> impl Iterator<Item = (Option<String>, &GroupReport)> {
    report.every_part().flat_map(|(name, part)| part.groups.iter().map(move |group| (name.clone(), group)))
}

/// The groups, each with its part's name where a filter ran on several: for people.
fn groups(report: &Report) -> impl Iterator<Item = (Option<String>, &GroupReport)> {
    report.named_parts().flat_map(|(name, part)| part.groups.iter().map(move |group| (name.clone(), group)))
}

/// Guides and channels of a group that a line of the log names.
const SHOWN: usize = 4;

/// The first names, and how many there are besides.
fn few(names: &[String], most: usize) -> String {
    let shown = names.iter().take(most).map(String::as_str).collect::<Vec<_>>().join(", ");
    match names.len().saturating_sub(most) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

/// The file that an error is about.
fn about<'a>(error: &reconstruct::Error, item: &'a Item) -> &'a Path {
    match error {
        reconstruct::Error::Guides(error) => error.file(&item.input, item.guides.as_deref()),
        _ => &item.input,
    }
}

/// What steered which colour, and how much of the error it took away by estimate; so many guides and groups are named.
pub fn guides(report: &Report, most: usize) -> Option<String> {
    let one = |(part, group): (Option<String>, &GroupReport)| {
        // A gain in decibels is what people compare.
        let decibels = |gain: f64| format!(": {:.1} dB by estimate", -10.0 * (1.0 - gain).max(1e-9).log10());
        let gain = group.guides_gain.map(decibels).unwrap_or_default();
        let names = behind(part.as_deref(), &few(&named(&group.channels), most));
        format!("{} ({names}{gain})", few(&group.guides, most))
    };
    let all: Vec<String> = groups(report).filter(|(_, group)| !group.guides.is_empty()).map(one).collect();
    let more = all.len().saturating_sub(most);
    let more = if more > 0 { format!("; and {more} more") } else { String::new() };
    (!all.is_empty()).then(|| all[..all.len().min(most)].join("; ") + &more)
}

/// How much of an error neighbours took away, where it can be told at all.
fn gained(part: f64, error: Option<&Estimated>) -> String {
    match error {
        Some(Estimated::Unknown { .. }) => "a gain that cannot be told".into(),
        _ => format!("{:.1} dB by estimate", -10.0 * (1.0 - part).max(1e-9).log10()),
    }
}

/// Which frames beside it a frame was filled along with, by what motion, and how much of the error they took away by estimate.
fn neighbours(report: &Report) -> Option<String> {
    let one = |part: &PartReport| {
        let mut ways: Vec<(&str, Vec<String>)> = Vec::new();
        for (number, how) in &part.neighbours {
            match ways.iter_mut().find(|way| way.0 == how) {
                Some(way) => way.1.push(number.to_string()),
                None => ways.push((how, vec![number.to_string()])),
            }
        }
        let ways = ways.iter().map(|(how, frames)| format!("{} by {how}", frames.join(", ")));
        let gains = part.groups.iter().filter_map(|group| {
            let gain = gained(group.neighbours_gain?, group.estimate.as_ref());
            Some(format!("{}: {gain}", few(&named(&group.channels), SHOWN)))
        });
        let gains: Vec<String> = gains.collect();
        let gains = if gains.is_empty() { "they help nowhere".into() } else { gains.join("; ") };
        format!("frames {} ({gains})", ways.collect::<Vec<_>>().join(", "))
    };
    joined(report.lines(move |part| (!part.neighbours.is_empty()).then(|| one(part))))
}

/// How many channels each rule had: `3 fill, 1 keep`.
fn rules(report: &Report) -> String {
    let count = |rule: Rule| {
        report.parts.iter().flat_map(|part| &part.channels).filter(|channel| channel.rule == rule).count()
    };
    let all = [Rule::Fill, Rule::Normal, Rule::Depth, Rule::Nearest, Rule::Keep];
    let used = all.map(|rule| (count(rule), rule)).into_iter().filter(|(count, _)| *count > 0);
    used.map(|(count, rule)| format!("{count} {rule}")).collect::<Vec<_>>().join(", ")
}

/// Says that a filled or enlarged frame is to be enlarged: what people mean to do, so no warning.
fn tell_complete(made: &str) {
    tracing::info!("{made} already: taken as complete (--mask names the pixels that count)");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_an_error_that_cannot_be_told_no_gain_is() {
        let unknown = Estimated::Unknown { unknown: "why".into(), unclipped_rmse: None };
        assert_eq!(gained(0.9, Some(&unknown)), "a gain that cannot be told");
        let bound = Estimated::Bound { rmse_at_most: 0.1, psnr_at_least: 20.0 };
        assert_eq!(gained(0.9, Some(&bound)), "10.0 dB by estimate");
        assert_eq!(gained(0.9, None), "10.0 dB by estimate");
    }
}
