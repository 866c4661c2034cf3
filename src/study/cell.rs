//! One cell of a study: a frame made sparse, filled and compared, on one thread.

use std::time::Instant;

use lacuna_exr::Frame;
use lacuna_filters::Run;

use super::definition::Definition;
use super::rows::Row;
use super::selection::Selection;
use super::subject::{Subject, mask_of};
use super::{DefinitionError, clock, half};
use crate::mask::Masks;
use crate::reconstruct::{self, Job, Plans};
use crate::report::{self, Images, Measure, Settings};
use crate::{channels, mask};

/// A filter of a study.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// As the study's file has it.
    pub label: String,
    /// What is done.
    pub job: Job,
}

/// What a row of the results is about.
#[derive(Clone, Debug)]
pub struct Cell<'a> {
    /// The frame.
    pub subject: &'a Subject,
    /// The filter; of no account at half the resolution.
    pub entry: &'a Entry,
    /// Which pixels stay.
    pub pattern: Selection,
    /// Measured pixels over all pixels.
    pub density: f64,
    /// Which pattern.
    pub seed: u64,
    /// Compare as a display shows it.
    pub display: bool,
}

/// All cells, frame by frame.
///
/// # Errors
/// A pattern that there is not.
pub fn cells<'a>(
    definition: &Definition,
    subjects: &'a [Subject],
    entries: &'a [Entry],
) -> Result<Vec<Cell<'a>>, DefinitionError> {
    let patterns: Result<Vec<_>, _> = definition.patterns.iter().map(|name| Selection::parse(name)).collect();
    let patterns = patterns.map_err(DefinitionError)?;
    let mut all = Vec::new();
    for subject in subjects {
        for &pattern in &patterns {
            if pattern == Selection::Half {
                // There is nothing to vary.
                let (density, seed, display) = (half::DENSITY, definition.seeds[0], definition.display);
                let cell = |entry| Cell { subject, entry, pattern, density, seed, display };
                all.extend(entries.first().map(cell));
                continue;
            }
            for &density in &definition.densities {
                for &seed in &definition.seeds {
                    let display = definition.display;
                    all.extend(entries.iter().map(|entry| Cell {
                        subject,
                        entry,
                        pattern,
                        density,
                        seed,
                        display,
                    }));
                }
            }
        }
    }
    Ok(all)
}

impl Cell<'_> {
    /// The filter as the study's file has it.
    pub fn label(&self) -> &str {
        if self.pattern == Selection::Half { half::KERNEL.name() } else { &self.entry.label }
    }

    /// The filter's own name, and everything that it is set to.
    fn method(&self) -> (&str, String) {
        match self.pattern {
            Selection::Half => (half::KERNEL.name(), String::new()),
            _ => (self.entry.job.method.name(), self.entry.job.settings()),
        }
    }

    /// What tells a cell from others: equal keys mean equal results.
    pub fn key(&self) -> String {
        let (name, settings) = self.method();
        format!(
            "lacuna={} pixels={:08x} pattern={} density={} seed={} display={} filter={name} {settings}",
            env!("CARGO_PKG_VERSION"),
            self.subject.sum,
            self.pattern,
            self.density,
            self.seed,
            self.display,
        )
    }

    /// Its row without results.
    pub fn blank(&self) -> Row {
        Row {
            key: self.key(),
            frame: self.subject.name.clone(),
            class: self.subject.class.clone(),
            pattern: self.pattern.to_string(),
            density: self.density,
            seed: self.seed,
            filter: self.label().into(),
            settings: self.method().1,
            ..Row::default()
        }
    }
}

/// Runs a cell in the calling pool; `visit` sees the images while they are there. What goes wrong is in the row.
pub fn run(cell: &Cell<'_>, visit: &mut dyn FnMut(&Images<'_>)) -> Row {
    let mut row = cell.blank();
    if let Err(error) = fill(cell, &mut row, visit) {
        row.error = Some(error);
    }
    row
}

fn fill(cell: &Cell<'_>, row: &mut Row, visit: &mut dyn FnMut(&Images<'_>)) -> Result<(), String> {
    if cell.pattern == Selection::Half {
        let frame = cell.subject.frame.clone();
        let (wall, busy) = (Instant::now(), clock::busy());
        let enlarged = half::enlarged(frame)?;
        (row.wall_seconds, row.seconds) = (wall.elapsed().as_secs_f64(), clock::busy() - busy);
        row.missing = 1.0 - cell.density;
        return measure(cell, &enlarged, None, row, visit);
    }
    let sparse = cell.subject.sparse(cell.pattern, cell.density, cell.seed)?;
    let job = &cell.entry.job;
    let (wall, busy) = (Instant::now(), clock::busy());
    let masks = mask::find(&sparse, &job.mask, None).map_err(|error| error.to_string())?;
    let choices = channels::choose(&sparse, &masks.mask_channels, &job.overrides);
    let filled = reconstruct::fill(sparse, &masks, &choices, job, &Plans::new(), &Run::default());
    let (filled, report) = filled.map_err(|error| error.to_string())?;
    row.wall_seconds = wall.elapsed().as_secs_f64();
    row.seconds = clock::busy() - busy;
    if let Some(outcome) = report.outcome {
        row.iterations = outcome.iterations;
        row.stop = serde_json::to_value(outcome.stop).ok().and_then(|stop| Some(stop.as_str()?.to_owned()));
    }
    row.missing = mask_of(&masks).map_or(0.0, |mask| 1.0 - mask.density());
    measure(cell, &filled, Some(&masks), row, visit)
}

fn measure(
    cell: &Cell<'_>,
    filled: &Frame,
    masks: Option<&Masks>,
    row: &mut Row,
    visit: &mut dyn FnMut(&Images<'_>),
) -> Result<(), String> {
    let mut settings = Settings { display: cell.display, ..Settings::default() };
    settings.wanted.add(Measure::Cieluv);
    let compared = report::compare(&cell.subject.frame, filled, masks, &settings, visit);
    let compared = compared.map_err(|error| error.to_string())?;
    let group = compared.main_group().ok_or("there is nothing to compare")?;
    let get = |region: &str, measure: Measure| group.region(region)?.measures.get(measure);
    row.mse = get("all", Measure::Mse);
    row.mse_missing = get("missing", Measure::Mse);
    row.ssim = get("all", Measure::Ssim);
    row.cieluv = get("all", Measure::Cieluv);
    Ok(())
}
