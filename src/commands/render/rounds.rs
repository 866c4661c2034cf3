//! Rendering a frame in rounds, each of the pixels that the fill so far lacks most.

use std::sync::atomic::{AtomicU64, Ordering};

use lacuna_exr::Frame;
use lacuna_filters::sampling::{Field, adaptive};
use lacuna_filters::{Mask, Plane, Planes, Run, Stop};
use lacuna_volume::{Picture, Shot};

use super::{Render, camera, picture};
use crate::files::plan::Item;
use crate::mask::rounds::{self, Rounds};
use crate::run::batch::{Failure, Stage};

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
    ) -> Result<(Frame, Rounds), Failure> {
        let camera = camera(item, ready)?;
        let shader = ready.shader(&camera);
        let all = self.shot(ready, (&camera, shader.as_ref()), None);
        let settings = adaptive::Settings { seed: all.seed, ..*settings };
        let advance = Advance::new(&all, settings.rounds as u64, stage);
        let mut whole: Option<Picture> = None;
        let interrupt = || stage.stopped().then_some(Stop::Cancelled);
        let run = Run { interrupt: Some(&interrupt) };
        let field = Field { x: 0, y: 0, size: all.size };
        let found = rounds::choose(&settings, field, &run, |new: &Mask| {
            let shot = Shot { mask: Some(new.as_slice()), ..all };
            let picture = lacuna_volume::render(&ready.renderer, &shot, &advance.told());
            // As the frame will hold them.
            let [colours @ .., _] = &picture.colour;
            let plane = |values: &Vec<f32>| {
                Plane::new(all.size, picture::values(values.clone(), self.job.wanted.kind).as_f32())
            };
            let planes: Result<Vec<Plane>, _> = colours.iter().map(plane).collect();
            match &mut whole {
                None => whole = Some(picture),
                Some(whole) => join(whole, &picture, new.as_slice()),
            }
            Planes::new(all.size, planes?)
        });
        let mut found = found.map_err(|error| Failure::at(&item.output, error))?;
        let rays = u64::from(all.samples) * if all.gradients { 5 } else { 1 };
        for round in &mut found.rounds {
            round.rays = Some(round.pixels as u64 * rays);
        }
        let whole = whole.unwrap_or_default();
        let mut frame = self.composed(whole, &all, Some(&found.mask), ready, (item, stage))?;
        for part in &mut frame.parts {
            part.attributes.set_text(rounds::ROUNDS, &found.line());
        }
        Ok((frame, found))
    }
}

/// Takes pixels over from another picture of the same shot.
fn join(whole: &mut Picture, from: &Picture, pixels: &[bool]) {
    let own = whole.colour.iter_mut().chain(&mut whole.normal).chain([&mut whole.depth]);
    let own = own.chain(whole.slopes.as_flattened_mut());
    let others = from.colour.iter().chain(&from.normal).chain([&from.depth]);
    for (own, other) in own.zip(others.chain(from.slopes.as_flattened())) {
        for ((own, other), _) in own.iter_mut().zip(other).zip(pixels).filter(|(_, taken)| **taken) {
            *own = *other;
        }
    }
}
