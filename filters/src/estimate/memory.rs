//! What plans of memory must know of a mask, where a fill learns from held-out samples.

use super::held_out::Folds;
use super::repetition::Repetition;
use crate::Mask;
use crate::descriptor::Memory;
use crate::solver;

/// The largest share of the image, 0 to 1, that has so few measured pixels that splines solve it by multigrid: 0 where every block of 8 x 8 pixels
/// has one, 1 where holes are everywhere. Where the method `learns` from held-out samples, they leave holes of their own, none of which need hold another's.
pub fn holes(mask: &Mask, learns: bool) -> f64 {
    let kept = learns.then(|| Folds::default().kept(mask)).into_iter().flatten();
    kept.map(|kept| solver::holes::share(&kept)).fold(solver::holes::share(mask), f64::max)
}

/// What choosing pixels in rounds once more and filling from them takes, the samples and the result among it: as measured.
pub const REPEATED: Memory = Memory { image: 66, channel: 13 };

/// Whether estimating the error may choose pixels of all of the image in rounds once more: where they lie unevenly, errors decide.
pub fn may_repeat(mask: &Mask) -> bool {
    Repetition::is_whole(mask)
}
