//! Pixels chosen in rounds, and what is told of each: in attributes, in the report and in the log.

use std::sync::Arc;
use std::time::Instant;

use lacuna_filters::sampling::{Field, adaptive};
use lacuna_filters::{Error, Mask, Planes, Run};
use serde::Serialize;

/// The attribute that says which rounds made a frame.
pub const ROUNDS: &str = "lacuna/rounds";

/// A round, as the report has it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Round {
    /// Pixels that it added.
    pub pixels: usize,
    /// Rays that these took, where frames are rendered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rays: Option<u64>,
    /// Seconds in which they were measured.
    pub measured: f64,
    /// Seconds in which the error was estimated then, and the next pixels chosen.
    pub chosen: f64,
    /// The estimated error after it, over the measured range.
    pub estimated_error: Option<f64>,
}

/// The pixels of a frame, and the rounds that chose them.
#[derive(Clone, Debug, PartialEq)]
pub struct Rounds {
    /// The pixels.
    pub mask: Arc<Mask>,
    /// The rounds.
    pub rounds: Vec<Round>,
    /// Rounds that there were to be.
    pub planned: usize,
}

/// Measures pixels in rounds: see [`adaptive::choose`].
///
/// # Errors
/// Those of `measure`, and settings out of range.
pub fn choose(
    settings: &adaptive::Settings,
    field: (Field, Option<&Mask>),
    run: &Run<'_>,
    mut measure: impl FnMut(&Mask) -> Result<Arc<Planes>, Error>,
) -> Result<Rounds, Error> {
    let mut times = Vec::new();
    let found = adaptive::choose(settings, field, run, |new: &Mask| {
        let start = Instant::now();
        let values = measure(new);
        times.push((start, Instant::now()));
        values
    })?;
    let end = Instant::now();
    let next = times.iter().skip(1).map(|(start, _)| *start).chain([end]);
    let rounds = found.rounds.iter().zip(&times).zip(next).map(|((round, (start, done)), next)| Round {
        pixels: round.pixels,
        rays: None,
        measured: (*done - *start).as_secs_f64(),
        chosen: (next - *done).as_secs_f64(),
        estimated_error: round.error,
    });
    Ok(Rounds { rounds: rounds.collect(), mask: Arc::new(found.mask), planned: found.planned })
}

/// The settings on one line.
pub fn pattern(settings: &adaptive::Settings) -> String {
    let adaptive::Settings { density, rounds, target, .. } = settings;
    let rounds = rounds.unwrap_or(adaptive::ROUNDS);
    let target = target.map_or(String::new(), |target| format!(" target-error={target}"));
    format!("adaptive density={density} rounds={rounds} first={}{target}", settings.first())
}

impl Rounds {
    /// The settings that they were chosen by on one line, as the pattern's attribute has them.
    pub fn pattern(&self, settings: &adaptive::Settings) -> String {
        pattern(&adaptive::Settings { rounds: Some(self.planned), ..*settings })
    }

    /// The rounds on one line: pixels and the estimated error after them.
    pub fn line(&self) -> String {
        let one = |round: &Round| {
            let error = round.estimated_error.map_or(String::new(), |error| format!(" error={error:.2e}"));
            format!("{}{error}", round.pixels)
        };
        self.rounds.iter().map(one).collect::<Vec<_>>().join(", ")
    }

    /// What became of the target: something to know, or else something to warn of.
    pub fn verdict(&self, target: Option<f64>) -> Option<Result<String, String>> {
        let (target, count) = (target?, self.rounds.len());
        let Some(error) = self.rounds.last()?.estimated_error else {
            return Some(Err(format!(
                "whether the target error of {target} is reached is not known, as the values of every channel are alike, or none is finite"
            )));
        };
        if error <= target {
            let first = if count == 1 { ", at once" } else { "" };
            return Some(Ok(format!(
                "the target error of {target} is reached after round {count}{first}: {error:.2e}"
            )));
        }
        Some(Err(format!(
            "the target error of {target} is not reached: after all {count} rounds the estimate is {error:.2e}; give a higher density"
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rounds(errors: &[Option<f64>]) -> Rounds {
        let round = |error: &Option<f64>| Round {
            pixels: 7,
            rays: None,
            measured: 0.0,
            chosen: 0.0,
            estimated_error: *error,
        };
        let mask = Mask::from_fn(lacuna_filters::Size::new(1, 1), |_, _| true);
        Rounds { mask: Arc::new(mask), rounds: errors.iter().map(round).collect(), planned: errors.len() }
    }

    #[test]
    fn lines_say_what_was_asked_for_and_what_came_of_it() {
        let settings = adaptive::Settings {
            density: 0.2,
            rounds: Some(3),
            first: Some(0.05),
            target: Some(0.01),
            seed: 0,
            frame: None,
        };
        assert_eq!(pattern(&settings), "adaptive density=0.2 rounds=3 first=0.05 target-error=0.01");
        let found = rounds(&[Some(0.02), None]);
        let by_default = adaptive::Settings { rounds: None, ..settings };
        assert_eq!(found.pattern(&by_default), "adaptive density=0.2 rounds=2 first=0.05 target-error=0.01");
        assert_eq!(found.line(), "7 error=2.00e-2, 7");
        assert_eq!(found.verdict(None), None);
        let text = |errors: &[Option<f64>]| rounds(errors).verdict(Some(0.01)).unwrap();
        assert!(text(&[Some(0.01)]).unwrap().contains("at once"));
        assert!(!text(&[Some(0.1), Some(0.01)]).unwrap().contains("at once"));
        assert!(text(&[Some(0.1), Some(0.02)]).unwrap_err().contains("2.00e-2"));
        let unknown = text(&[None]).unwrap_err();
        assert!(unknown.contains("not known") && !unknown.contains("higher density"), "{unknown}");
    }
}
