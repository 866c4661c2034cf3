//! What was found for each channel, written into the part: types first, then the missing pixels.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;
use lacuna_exr::{Part, Samples};
use lacuna_filters::Mask;
use lacuna_filters::baseline::nearest::NearestMap;

use super::job::Kind;
use super::values::{Loss, convert, copy_from, kind_for, write};
use crate::channels::Choice;

/// What happens to the pixels of one channel.
#[derive(Clone, Debug)]
pub enum Change {
    /// Values for the missing pixels, or for all if the method smooths.
    Values {
        /// One for each pixel.
        values: Vec<f32>,
        /// The values that count as measured.
        mask: Arc<Mask>,
        /// Whether measured pixels are written as well.
        all: bool,
    },
    /// Bits of measured pixels for the missing ones.
    Copies {
        /// Where each pixel takes them.
        map: Arc<NearestMap>,
        /// The values that count as measured.
        mask: Arc<Mask>,
    },
}

impl Change {
    fn mask(&self) -> &Mask {
        match self {
            Self::Values { mask, .. } | Self::Copies { mask, .. } => mask,
        }
    }
}

/// What became of one channel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Applied {
    /// Whether it has another type now.
    pub converted: bool,
    /// Values that would have overflowed a half, and measured ones that were rounded to one.
    pub loss: Loss,
}

/// Gives the channels the type that was asked for where the rule allows, then writes the changes; one for each channel.
pub fn apply(
    part: &mut Part,
    changes: &[Option<Change>],
    choices: &[Choice],
    kind: Option<Kind>,
) -> Vec<Applied> {
    let channels = part.channels.par_iter_mut().zip(changes).zip(choices);
    channels.map(|((channel, change), choice)| {
        apply_one(&mut channel.samples, change.as_ref(), kind_for(choice.rule, kind))
    })
}

fn apply_one(samples: &mut Samples, change: Option<&Change>, kind: Option<Kind>) -> Applied {
    let mut applied = Applied::default();
    if kind.is_some() {
        let before = samples.kind();
        let old = std::mem::replace(samples, Samples::Uint(Vec::new()));
        let (new, loss) = convert(old, kind, change.map(Change::mask));
        // Where all pixels are written anew, the old ones are not the ones that were changed.
        let anew = matches!(change, Some(Change::Values { all: true, .. }));
        let loss = if anew { Loss::default() } else { loss };
        applied = Applied { converted: new.kind() != before, loss };
        *samples = new;
    }
    match change {
        Some(Change::Values { values, mask, all }) => {
            applied.loss.clamped += write(samples, values, mask, *all);
        }
        Some(Change::Copies { map, mask }) => copy_from(samples, mask, map.as_slice()),
        None => {}
    }
    applied
}
