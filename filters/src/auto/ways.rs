//! How samples of other frames may be taken: what they pull, and the guided regression that sees them beside those of the frame.

use std::sync::Arc;

use super::{Candidate, How, candidates};
use crate::temporal::{self, Beside, Carried, Changes, First, Pull, Pulling};
use crate::variational::guided::{self, Regression};
use crate::{Error, Mask, Outcome, Plane, Planes, Run};

/// How samples of other frames are taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Way {
    /// They pull the frame's own fill.
    Pulled(Pull),
    /// They pull what the frame gives without guides.
    Plain(Pull),
    /// They are regressed on guides along with those of the frame: on their own ones or on this frame's at their places.
    Regressed(On),
    /// They and those of the frame pull the frames beside it, which are seen from it.
    Seen(Pull),
}

/// Which guides samples of other frames have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum On {
    /// This frame's, at their places.
    Ours,
    /// Those of their frames, of the very rays.
    Theirs,
}

/// What a way starts from.
#[derive(Clone, Copy)]
pub struct Given<'a> {
    /// The frame's samples.
    pub samples: &'a Planes,
    /// Where they are.
    pub mask: &'a Arc<Mask>,
    /// Its own fill.
    pub alone: &'a Planes,
    /// The samples of each other frame.
    pub carried: &'a [Carried],
    /// What each other frame makes of its own, where these are known.
    pub fills: &'a [Planes],
    /// The nearest frames on either side, on their own.
    pub beside: &'a [Beside],
    /// The regression, where there are guides.
    pub regression: Option<&'a Regression<'a>>,
    /// Where some of the samples are held out: the mask of all, at which what comes out is looked at.
    pub held_out_of: Option<&'a Mask>,
    /// What pulls of its own fill have in common.
    pub first: Option<&'a First>,
}

impl Way {
    /// Whether samples are brought to the brightness of the frame.
    pub const fn is_levelled(self) -> bool {
        matches!(self, Self::Pulled(Pull { changes: Changes::Levelled, .. }))
    }

    /// What comes of it.
    pub fn image(self, given: &Given<'_>, run: &Run<'_>) -> Result<(Planes, Outcome), Error> {
        match self {
            Self::Pulled(pull) => Ok(given.pulled(given.alone, pull, None, run)),
            Self::Plain(pull) => {
                let how = if given.held_out_of.is_some() { How::ROUGHLY } else { How::EXACTLY };
                let (image, outcome) = plain((given.samples, given.mask), how, run)?;
                let (image, ended) = Given { first: None, ..*given }.pulled(&image, pull, None, run);
                Ok((image, outcome.worst(ended)))
            }
            Self::Regressed(on) => given.regressed(on, run),
            Self::Seen(pull) => Ok((given.seen(pull, run)?, Outcome::direct())),
        }
    }
}

impl Given<'_> {
    /// An image, pulled; by weights that differ between pixels, if there are some.
    pub fn pulled(
        &self,
        image: &Planes,
        pull: Pull,
        weights: Option<&Plane>,
        run: &Run<'_>,
    ) -> (Planes, Outcome) {
        let Self { carried, fills, first, .. } = *self;
        let pulling = Pulling { carried, fills, pull, weights, roughly: self.held_out_of.is_some(), first };
        temporal::pull(self.mask, &pulling, image, run)
    }

    /// What the frames beside it show of the frame.
    fn seen(&self, pull: Pull, run: &Run<'_>) -> Result<Planes, Error> {
        let Self { samples, mask, alone, beside, carried, .. } = *self;
        temporal::seen((samples, mask, alone), (beside, carried), (pull, self.held_out_of.is_some()), run)
    }

    fn regressed(&self, on: On, run: &Run<'_>) -> Result<(Planes, Outcome), Error> {
        let Some(regression) = self.regression else { return Ok((self.alone.clone(), Outcome::direct())) };
        let mut beside = guided::Beside::default();
        let guided = on == On::Theirs && Carried::are_guided(self.carried, regression.guides());
        self.carried.iter().for_each(|carried| carried.put_beside(&mut beside, guided));
        regression.fill((self.samples, self.mask), &beside, self.held_out_of, run)
    }
}

/// What a frame gives without guides.
pub fn plain(
    (samples, mask): (&Planes, &Arc<Mask>),
    how: How<'_>,
    run: &Run<'_>,
) -> Result<(Planes, Outcome), Error> {
    let [cnn, ..] = candidates();
    let mut out = Planes::zeros(samples.size(), samples.len());
    let (outcome, _) = Candidate::of(cnn).fill((samples, mask), how, &mut out, run)?;
    Ok((out, outcome))
}
