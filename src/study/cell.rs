//! One cell of a study: a frame or a sequence made sparse, filled and compared, on one thread.

use std::sync::Arc;
use std::time::Instant;

use lacuna_exr::Frame;
use lacuna_filters::Run;

use super::definition::Definition;
use super::rows::Row;
use super::selection::Selection;
use super::subject::{Shot, Subject, colours, mask_of};
use super::{DefinitionError, clock, half};
use crate::mask::Masks;
use crate::reconstruct::{self, Beside, Job, Plans};
use crate::report::{self, Flicker, Images, Mean, Measure, Pair, Settings};
use crate::temporal::{Neighbour, Neighbours};
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

    /// Neighbours on either side that its filter asks for.
    fn reach(&self) -> usize {
        if self.pattern == Selection::Half { 0 } else { self.entry.job.temporal.window.each() }
    }

    /// What tells a cell from others: equal keys mean equal results.
    pub fn key(&self) -> String {
        let (name, settings) = self.method();
        format!(
            "lacuna={} pixels={:08x} pattern={} density={} seed={} display={} filter={name} {settings}",
            env!("CARGO_PKG_VERSION"),
            self.subject.sum(self.reach()),
            self.pattern,
            self.density,
            self.seed,
            self.display,
        )
    }

    /// What people call it.
    pub fn name(&self) -> String {
        let Self { subject, pattern, density, seed, .. } = self;
        format!("{}: {}, {pattern} {density}, seed {seed}", subject.name, self.label())
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
    let shots = &cell.subject.shots;
    let sparse = sparse(cell)?;
    let studied: Vec<usize> = (0..shots.len()).filter(|at| shots[*at].studied).collect();
    let (mut found, mut changes) = (Vec::new(), Vec::new());
    let mut flicker = Flicker::new(studied.iter().filter_map(|&at| shots[at].number));
    for (k, &at) in studied.iter().enumerate() {
        let mut one = Found::default();
        let (filled, masks) = match &sparse[at] {
            Some((frame, masks)) => (one.filled(cell, (at, frame, masks), &sparse)?, Some(&**masks)),
            None => (one.enlarged(&shots[at])?, None),
        };
        let mut groups = Vec::new();
        let mut look = |images: &Images<'_>| {
            if shots[at].number.is_some() {
                groups.extend(Flicker::colours(images));
            }
            // Sheets show the middle one.
            if k == studied.len() / 2 {
                visit(images);
            }
        };
        one.measure(cell.display, (&colours(&shots[at].frame), &colours(&filled)), masks, &mut look)?;
        if let Some(number) = shots[at].number {
            changes.extend(flicker.enter(number, groups, None).iter().flat_map(Pair::changes));
        }
        found.push(one);
    }
    sum_up(&found, row);
    row.flicker = mean(changes.iter().map(|changed| Some(changed.still.flicker.powi(2)))).map(f64::sqrt);
    Ok(())
}

/// A sparse frame and what was measured of it, if it is needed.
type Sparse = Option<(Arc<Frame>, Arc<Masks>)>;

/// The sparse frame of each shot that is filled or read beside one; none at half the resolution.
fn sparse(cell: &Cell<'_>) -> Result<Vec<Sparse>, String> {
    let mut all: Vec<Sparse> = vec![None; cell.subject.shots.len()];
    if cell.pattern == Selection::Half {
        return Ok(all);
    }
    for (at, shot) in cell.subject.needed(cell.reach()) {
        let frame = shot.sparse(cell.pattern, cell.density, cell.seed)?;
        let masks = mask::find(&frame, &cell.entry.job.mask, None).map_err(|error| error.to_string())?;
        all[at] = Some((Arc::new(frame), Arc::new(masks)));
    }
    Ok(all)
}

/// What was found for one frame.
#[derive(Default)]
struct Found {
    mse: Option<f64>,
    mse_missing: Option<f64>,
    ssim: Option<f64>,
    cieluv: Option<f64>,
    missing: f64,
    wall: f64,
    busy: f64,
    iterations: usize,
    stop: Option<String>,
}

impl Found {
    fn timed<T>(&mut self, work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
        let (wall, busy) = (Instant::now(), clock::busy());
        let done = work();
        (self.wall, self.busy) = (wall.elapsed().as_secs_f64(), clock::busy() - busy);
        done
    }

    fn enlarged(&mut self, shot: &Shot) -> Result<Frame, String> {
        self.missing = 1.0 - half::DENSITY;
        self.timed(|| half::enlarged(colours(&shot.frame)))
    }

    fn filled(
        &mut self,
        cell: &Cell<'_>,
        (at, frame, masks): (usize, &Frame, &Masks),
        sparse: &[Sparse],
    ) -> Result<Frame, String> {
        self.missing = mask_of(masks).map_or(0.0, |mask| 1.0 - mask.density());
        let neighbours = beside(cell, at, sparse);
        let job = &cell.entry.job;
        let frame = frame.clone();
        let (filled, report) = self.timed(|| {
            let choices = channels::choose(&frame, &masks.mask_channels, &job.overrides);
            let beside = Beside { guides: None, neighbours: Some(&neighbours), sources: None };
            let filled =
                reconstruct::fill_with(frame, masks, &choices, beside, job, &Plans::new(), &Run::default());
            filled.map_err(|error| error.to_string())
        })?;
        if let Some(outcome) = report.outcome {
            self.iterations = outcome.iterations;
            self.stop =
                serde_json::to_value(outcome.stop).ok().and_then(|stop| Some(stop.as_str()?.to_owned()));
        }
        Ok(filled)
    }

    fn measure(
        &mut self,
        display: bool,
        (reference, filled): (&Frame, &Frame),
        masks: Option<&Masks>,
        look: &mut dyn FnMut(&Images<'_>),
    ) -> Result<(), String> {
        let mut settings = Settings { display, ..Settings::default() };
        settings.wanted.add(Measure::Cieluv);
        let compared = report::compare(reference, filled, masks, &settings, look);
        let compared = compared.map_err(|error| error.to_string())?;
        let group = compared.main_group().ok_or("there is nothing to compare")?;
        let get = |region: &str, measure: Measure| group.region(region)?.measures.get(measure);
        self.mse = get("all", Measure::Mse);
        self.mse_missing = get("missing", Measure::Mse);
        self.ssim = get("all", Measure::Ssim);
        self.cieluv = get("all", Measure::Cieluv);
        Ok(())
    }
}

/// The frames beside one of a sequence that its filter asks for.
fn beside(cell: &Cell<'_>, at: usize, sparse: &[Sparse]) -> Neighbours {
    let (shots, reach) = (&cell.subject.shots, cell.reach() as u64);
    let one = |(shot, sparse): (&Shot, &Sparse)| {
        let (number, own) = (shot.number?, shots[at].number?);
        let offset = number - own;
        let (frame, masks) = sparse.as_ref().filter(|_| offset != 0 && offset.unsigned_abs() <= reach)?;
        let (frame, masks) = (Arc::clone(frame), Arc::clone(masks));
        Some(Neighbour { number, offset, label: format!("frame {number}"), frame, masks, samples: None })
    };
    let all: Vec<Neighbour> = shots.iter().zip(sparse).filter_map(one).collect();
    Neighbours { looked_at: all.iter().map(|one| one.number).collect(), all, ..Neighbours::default() }
}

/// The means over all frames.
fn sum_up(found: &[Found], row: &mut Row) {
    let values = |get: fn(&Found) -> Option<f64>| mean(found.iter().map(get));
    row.mse = geometric(found.iter().map(|one| one.mse));
    row.mse_missing = geometric(found.iter().map(|one| one.mse_missing));
    row.equal = found.iter().filter(|one| one.mse == Some(0.0)).count();
    row.ssim = values(|one| one.ssim);
    row.cieluv = values(|one| one.cieluv);
    let number = |get: fn(&Found) -> f64| found.iter().map(get).sum::<f64>() / found.len().max(1) as f64;
    row.missing = number(|one| one.missing);
    row.wall_seconds = number(|one| one.wall);
    row.seconds = number(|one| one.busy);
    row.iterations = found.iter().map(|one| one.iterations).max().unwrap_or(0);
    row.stop = found.iter().find_map(|one| one.stop.clone());
}

/// The geometric mean of errors, whose PSNR is the mean of theirs; beside others those of equal images are left out.
fn geometric(errors: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let logarithms = errors.map(|mse| Some(-mse?.ln())).collect::<Option<Vec<f64>>>()?;
    Mean::of(logarithms.into_iter()).map(|mean| (-mean.value).exp())
}

/// Of values that are all there.
fn mean(values: impl ExactSizeIterator<Item = Option<f64>>) -> Option<f64> {
    let count = values.len();
    let sum = values.sum::<Option<f64>>()?;
    (count > 0).then(|| sum / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_that_is_equal_hides_no_other() {
        let psnr = |errors: [f64; 2]| {
            let found = errors.map(|mse| Found { mse: Some(mse), ..Found::default() });
            let mut row = Row::default();
            sum_up(&found, &mut row);
            (row.psnr().map(f64::round), row.equal)
        };
        assert_eq!(psnr([1e-4, 1e-2]), (Some(30.0), 0));
        assert_eq!(psnr([0.0, 1e-4]), (Some(40.0), 1));
        assert_eq!(psnr([0.0, 0.0]), (Some(f64::INFINITY), 2));
    }
}
