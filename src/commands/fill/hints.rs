//! What a user who passed no flag for it would like to know of.

use crate::channels::is_light;
use crate::files::patterns;
use crate::files::plan::Item;
use crate::reconstruct::{Job, NoiseSource};
use crate::run::record::{Record, State};
use crate::temporal::Window;

/// Squared errors of colours that grow by less than this power of the variance hardly fall where samples are nearer: that is noise, or detail
/// finer than the samples. Edges alone give 0.6.
const NOISY: f64 = 0.45;
/// Fewer frames are no sequence.
const SEQUENCE: usize = 3;

/// That neighbours were asked for, but no frame has any.
pub fn alone(job: &Job, items: &[Item]) -> Option<String> {
    let window = job.temporal.window;
    let asked = window != Window::None && !items.is_empty();
    if !asked || items.iter().any(|item| !item.neighbours.is_empty()) {
        return None;
    }
    let each = window.each();
    let first = items.iter().find_map(|item| {
        let number = item.number?;
        let next = patterns::beside(&item.input, number.checked_add(1)?).into_iter().next()?;
        Some(format!(", as {} would be", next.display()))
    });
    let names = first.unwrap_or_else(|| ", as shot.0002.exr is beside shot.0001.exr".into());
    Some(format!(
        "--temporal {window}: no frame has a neighbour, and each is filled by itself: neighbours are files in its folder \
         that have its name with another number, at most {each} away{names}"
    ))
}

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
    if let Some(first) = filled.iter().find(noisy).filter(|_| job.noise == NoiseSource::None) {
        let (first, all) = (&first.input, filled.len());
        let which = if all > 1 { format!("{count} of {all} frames, first {first}") } else { first.clone() };
        hints.push(format!(
            "{which}: samples predict their neighbours badly, as noise or detail finer than them does: it is kept; if it is noise, \
             --noise auto smooths it, and such detail with it"
        ));
    }
    let numbered = filled.iter().filter(|record| record.frame.is_some()).count();
    let fills = job.enlarge.is_none() && job.method.name() == "auto";
    if job.temporal.window == Window::None && numbered >= SEQUENCE && fills {
        hints.push(
            "each frame was filled by itself: --temporal auto takes the samples of the frames beside it, too, for several times the work"
                .into(),
        );
    }
    hints
}
