//! Rendering a frame in rounds, each of the pixels that the fill so far lacks most.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use lacuna_exr::Frame;
use lacuna_filters::sampling::{Field, adaptive};
use lacuna_filters::{Mask, Planes, Run, Stop};
use lacuna_volume::{Picture, Shot};

use super::{Render, camera, picture};
use crate::files::plan::Item;
use crate::mask::PATTERN;
use crate::mask::rounds::{self, Rounds};
use crate::run::batch::{Failure, Stage};

/// Channels that pixels are chosen by: all but alpha.
pub const COLOURS: usize = 3;
/// Pieces of a frame's progress while it is rendered.
pub const PIECES: u64 = 100;

/// Tells how far a frame is, over all its rounds.
pub struct Advance<'a> {
    stage: &'a Stage<'a>,
    tiles: u64,
    done: AtomicU64,
}

impl<'a> Advance<'a> {
    pub fn new(shot: &Shot<'_>, rounds: u64, stage: &'a Stage<'a>) -> Self {
        let tiles = lacuna_volume::tiles(shot.size) as u64 * rounds;
        Self { stage, tiles, done: AtomicU64::new(0) }
    }

    /// To be called after each tile; whether the work goes on.
    pub fn told(&self) -> impl Fn() -> bool + Sync + '_ {
        || {
            let now = self.done.fetch_add(1, Ordering::Relaxed) + 1;
            let pieces = |tiles_done: u64| tiles_done * PIECES / self.tiles;
            self.stage.piece(pieces(now) - pieces(now - 1));
            !self.stage.stopped()
        }
    }
}

impl Render<'_> {
    /// The sparse frame, and the rounds that chose its pixels.
    pub fn in_rounds(
        &self,
        settings: &adaptive::Settings,
        item: &Item,
        ready: &lacuna_volume::Stage,
        stage: &Stage<'_>,
    ) -> Result<((Frame, usize), Rounds), Failure> {
        let camera = camera(item, ready)?;
        let shader = ready.shader(&camera);
        let all = self.shot(ready, (&camera, shader.as_ref()), None);
        let settings = adaptive::Settings { seed: all.seed, frame: item.number, ..*settings };
        let advance = Advance::new(&all, settings.rounds.unwrap_or(adaptive::ROUNDS) as u64, stage);
        let mut whole = Picture::default();
        // As the frame will hold them.
        let mut colours = Arc::new(Planes::zeros(all.size, COLOURS));
        let interrupt = || stage.stopped().then_some(Stop::Cancelled);
        let run = Run { interrupt: Some(&interrupt) };
        let field = Field { x: 0, y: 0, size: all.size };
        let found = rounds::choose(&settings, (field, None), &run, |new: &Mask| {
            let shot = Shot { mask: Some(new.as_slice()), ..all };
            lacuna_volume::render_onto(&mut whole, &ready.renderer, &shot, &advance.told());
            for (plane, from) in Arc::make_mut(&mut colours).as_mut_slice().iter_mut().zip(&whole.colour) {
                let values = plane.pixels_mut().iter_mut().zip(from).zip(new.as_slice());
                values
                    .filter(|(_, new)| **new)
                    .for_each(|((own, from), _)| *own = picture::kept(*from, self.job.wanted.kind));
            }
            Ok(Arc::clone(&colours))
        });
        stage.end_pieces();
        let mut found = found.map_err(|error| Failure::at(&item.input, error))?;
        let rays = u64::from(all.samples) * if all.gradients { 5 } else { 1 };
        for round in &mut found.rounds {
            round.rays = Some(round.pixels as u64 * rays);
        }
        let (mut frame, clamped) = self.composed(whole, &all, Some(&found.mask), ready, (item, stage))?;
        for part in &mut frame.parts {
            part.attributes.set_text(PATTERN, &found.pattern(&settings));
            part.attributes.set_text(rounds::ROUNDS, &found.line());
        }
        Ok(((frame, clamped), found))
    }
}
