//! What a user who passed no flag for it would like to know of.

use crate::channels::is_light;
use crate::reconstruct::{Job, NoiseSource};
use crate::run::record::{Record, State};
use crate::temporal::Window;

/// Squared errors of colours that grow by less than this power of the variance hardly fall where samples are nearer: that is noise, or detail
/// finer than the samples. Edges alone give 0.6.
const NOISY: f64 = 0.45;
/// Fewer frames are no sequence.
const SEQUENCE: usize = 3;

/// Lines about the frames that were filled.
pub fn of(job: &Job, records: &[Record]) -> Vec<String> {
    let filled: Vec<&Record> = records.iter().filter(|record| record.state == State::Done).collect();
    let mut hints = Vec::new();
    let noisy = |record: &&&Record| {
        let colours =
            record.estimates.iter().filter(|group| group.channels.iter().all(|name| is_light(name)));
        { colours }.any(|group| group.exponent.is_some_and(|exponent| exponent < NOISY))
    };
    let count = filled.iter().filter(noisy).count();
    if job.noise == NoiseSource::None && count > 0 {
        let which =
            if filled.len() == 1 { "it has".into() } else { format!("{count} of {} have", filled.len()) };
        hints.push(format!(
            "{which} noise, or detail finer than the samples: noise is kept; --noise auto tells the two apart, and smooths noise"
        ));
    }
    let numbered = filled.iter().filter(|record| record.frame.is_some()).count();
    if job.temporal.window == Window::None && numbered >= SEQUENCE && job.method.name() == "auto" {
        hints.push(
            "each frame was filled by itself: --temporal auto takes the samples of the frames beside it, too"
                .into(),
        );
    }
    hints
}
