//! The linear ways to fill and smooth that noise chooses from.

use std::cell::OnceCell;
use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::FOLDS;
use crate::baseline::push_pull;
use crate::kernel::Isa;
use crate::kernel::regress::Scales;
use crate::network;
use crate::variational::guided::{Field, Guides, Reach, SPREAD, Store, Task as Fit, Tuned, predict_between};
use crate::variational::{edge, ss, tv};
use crate::{Error, Filter, Mask, Outcome, Plane, Planes, Problem, Run};

/// Pixels whose distance counts as much as the standard deviation of a guide does.
const PLACE: f32 = 128.0;
/// What is added to the variances of guides and places in the window, over those of the image.
const SHRINK: f64 = 1e-3;

/// How exact splines are, over the range of the samples: far below noise that is worth smoothing.
const ROUGH: f64 = 2e-3;

/// One way.
pub struct Candidate {
    /// What the report calls it.
    pub name: &'static str,
    kind: Kind,
}

#[derive(Clone, Copy)]
enum Kind {
    /// Smoothing splines with this weight of smoothness.
    Splines(f64),
    /// A first-order regression on guides and place over about so many samples.
    Regression(f64),
    /// The one that fills images without noise, as [`Task::tuned`] says.
    Guided,
}

impl Candidate {
    /// All of them; the interpolating one is the first. Regressions smooth by place as well, so that beside them smoothing splines count for
    /// next to nothing.
    pub fn all(guided: bool) -> Vec<Self> {
        let splines = |name, lambda| Self { name, kind: Kind::Splines(lambda) };
        let regression = |name, samples| Self { name, kind: Kind::Regression(samples) };
        let exact = splines("ss", 0.0);
        if guided {
            return vec![
                exact,
                regression("guided 36", 36.0),
                regression("guided 324", 324.0),
                Self { name: "guided", kind: Kind::Guided },
            ];
        }
        vec![
            exact,
            splines("ss lambda=0.3", 0.3),
            splines("ss lambda=1", 1.0),
            splines("ss lambda=3", 3.0),
            splines("ss lambda=10", 10.0),
            splines("ss lambda=30", 30.0),
        ]
    }

    /// How many of them fill missing pixels, too: the first. What the last makes there, filling what it smoothed does better.
    pub fn filling(all: &[Self]) -> usize {
        all.iter().position(|candidate| matches!(candidate.kind, Kind::Guided)).unwrap_or(all.len())
    }

    /// Whether it looks at guides.
    pub const fn is_guided(&self) -> bool {
        matches!(self.kind, Kind::Regression(_) | Kind::Guided)
    }
}

/// The candidates' images without the samples of a fold, at the measured pixels.
pub struct Fold {
    /// What is left.
    pub kept: Arc<Mask>,
    /// The pixels that were held out.
    pub at: Vec<u32>,
    /// By candidate.
    pub images: Vec<Measured>,
}

/// Values at the measured pixels of a mask, by channel, row by row.
pub struct Measured(Vec<Vec<f32>>);

impl Measured {
    fn of(planes: &Planes, mask: &Mask) -> Self {
        let channel = |plane: &Plane| {
            let measured = plane.pixels().iter().zip(mask.as_slice()).filter(|(_, flag)| **flag);
            measured.map(|(value, _)| *value).collect()
        };
        Self(planes.as_slice().iter().map(channel).collect())
    }

    /// As planes, zero where nothing was measured.
    pub fn planes(&self, mask: &Mask) -> Planes {
        let channel = |values: &Vec<f32>| {
            let mut values = values.iter();
            let mut next = |flag: &bool| if *flag { values.next().copied().unwrap_or(0.0) } else { 0.0 };
            Plane::of(mask.size(), mask.as_slice().iter().map(&mut next).collect())
        };
        Planes::of(mask.size(), self.0.iter().map(channel).collect())
    }
}

/// A way to fill from samples that were smoothed, which it keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Second {
    /// Edge-enhancing splines.
    Edge,
    /// The same, corrected by a network.
    Cnn,
    /// Total variation.
    Tv,
    /// Guided filling.
    Guided,
}

impl Second {
    /// All of them, each after what it starts from.
    pub const fn all(guided: bool) -> &'static [Self] {
        if guided {
            &[Self::Edge, Self::Cnn, Self::Tv, Self::Guided]
        } else {
            &[Self::Edge, Self::Cnn, Self::Tv]
        }
    }

    /// What the report calls it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Edge => "edge",
            Self::Cnn => "cnn",
            Self::Tv => "tv",
            Self::Guided => "guided",
        }
    }

    /// The one by whose image it starts.
    const fn start(self) -> Option<Self> {
        if matches!(self, Self::Cnn) { Some(Self::Edge) } else { None }
    }

    fn filter(self) -> Box<dyn Filter> {
        match self {
            Self::Edge => Box::new(edge::Settings::default()),
            Self::Cnn => Box::new(network::Settings),
            Self::Tv => Box::new(tv::Settings::default()),
            Self::Guided => Box::new(ss::Settings::default()),
        }
    }

    /// Fills smoothed samples; where some are held out of a mask, roughly and at its pixels. `start` is the image of another one, and becomes this
    /// one's.
    pub fn fill(
        self,
        task: &Task<'_>,
        (mask, smooth): (&Arc<Mask>, &Planes),
        held_out_of: Option<&Mask>,
        start: &mut Option<(Self, Planes)>,
    ) -> Result<Planes, Error> {
        if let (Self::Guided, Some((guides, tuned))) = (self, task.guides.zip(task.tuned)) {
            return tuned.fill((smooth, mask), guides, held_out_of, task.run);
        }
        let filter = self.filter();
        let plan = filter.plan(&Problem::fill(Arc::clone(mask)), task.run)?;
        let mut out = Planes::zeros(smooth.size(), smooth.len());
        let error = held_out_of.map(|_| ROUGH);
        match (start.take().filter(|(other, _)| self.start() == Some(*other)), error) {
            (Some((_, image)), error) => {
                out = image;
                plan.reconstruct_from_start(smooth, error, &mut out, task.run)?;
            }
            (None, Some(error)) => {
                plan.reconstruct_roughly(smooth, error, &mut out, task.run)?;
            }
            (None, None) => {
                plan.reconstruct(smooth, &mut out, task.run)?;
            }
        }
        if Self::all(true).iter().any(|other| other.start() == Some(self)) {
            *start = Some((self, out.clone()));
        }
        Ok(out)
    }
}

/// What all of them are given.
#[derive(Clone, Copy)]
pub struct Task<'a> {
    pub guides: Option<&'a Guides>,
    /// What each sample weighs.
    pub weights: Option<&'a Arc<Plane>>,
    /// Whether it does so in regressions, too: variances that noisy samples show vary with their light, which draws regressions to the dark.
    pub counted: bool,
    /// What guides count for.
    pub tuned: Option<&'a Tuned>,
    pub run: &'a Run<'a>,
}

impl Task<'_> {
    /// What each sample weighs in regressions.
    pub fn counts(&self) -> Option<&Plane> {
        self.weights.filter(|_| self.counted).map(Arc::as_ref)
    }

    /// What guides count for, as these samples show.
    pub fn tune(&self, mask: &Arc<Mask>, samples: (&Planes, Option<&Plane>)) -> Option<Tuned> {
        Tuned::new(mask, samples, self.guides?)
    }

    /// The images of samples and of noise by each candidate.
    pub fn both(
        &self,
        all: &[Candidate],
        mask: &Arc<Mask>,
        (samples, noise): (&Planes, &Planes),
    ) -> Result<(Vec<Planes>, Vec<Planes>, Outcome), Error> {
        let known = noise.as_slice().par_iter().map(|plane| {
            let known = plane.pixels().iter().map(|&n| if n.is_finite() { n } else { 0.0 });
            Plane::of(plane.size(), known.collect())
        });
        let known = Planes::of(samples.size(), known);
        // Side by side, as one group: what depends on the mask and the guides is computed once. What interpolates keeps the noise as it is.
        let (plain, rest) = all.split_at(usize::from(!all.is_empty()));
        let group: Vec<&Plane> = [samples, &known].iter().flat_map(|planes| planes.as_slice()).collect();
        let group = group.into_par_iter().map(Plane::clone);
        let (mut values, first) = self.each(plain, mask, samples)?;
        let (images, outcome) = self.each(rest, mask, &Planes::of(samples.size(), group))?;
        let mut noises = vec![known; plain.len()];
        for image in images {
            let mut planes = image.into_vec();
            noises.push(Planes::of(samples.size(), planes.split_off(samples.len())));
            values.push(Planes::of(samples.size(), planes));
        }
        Ok((values, noises, first.worst(outcome)))
    }

    /// The images by each candidate.
    pub fn each(
        &self,
        all: &[Candidate],
        mask: &Arc<Mask>,
        values: &Planes,
    ) -> Result<(Vec<Planes>, Outcome), Error> {
        let everywhere = Mask::from_fn(mask.size(), |_, _| true);
        let mut worst = Outcome::direct();
        let (mut images, regressions) = (Vec::with_capacity(all.len()), OnceCell::new());
        for (k, candidate) in all.iter().enumerate() {
            let mut out = Planes::zeros(values.size(), values.len());
            let wanted = if k < Candidate::filling(all) { &everywhere } else { mask };
            worst = worst.worst(self.one((candidate, &regressions), (mask, wanted), values, &mut out)?);
            images.push(out);
        }
        Ok((images, worst))
    }

    /// What the candidates make of the samples without some of them, of which those that are `judged` are looked at.
    pub fn folds(
        &self,
        all: &[Candidate],
        (mask, judged): (&Arc<Mask>, &dyn Fn(u32) -> bool),
        samples: &Planes,
    ) -> Result<Vec<Fold>, Error> {
        let one = |parts| {
            let kept = Arc::new(FOLDS.without(mask, &parts));
            let mut at = FOLDS.held_out(mask, &parts);
            at.retain(|&pixel| judged(pixel));
            if at.is_empty() || kept.is_empty() {
                return Ok(None);
            }
            let (mut images, regressions) = (Vec::with_capacity(all.len()), OnceCell::new());
            for candidate in all {
                let mut out = Planes::zeros(samples.size(), samples.len());
                self.one((candidate, &regressions), (&kept, mask), samples, &mut out)?;
                images.push(Measured::of(&out, mask));
            }
            Ok(Some(Fold { kept, at, images }))
        };
        let measured = mask.as_slice().iter().enumerate().filter(|(_, flag)| **flag);
        let judged = measured.filter(|(pixel, _)| judged(*pixel as u32)).count();
        FOLDS.near(judged).map(one).filter_map(Result::transpose).collect()
    }

    /// One candidate's image where it is `wanted`, at least; those of the same samples share what regressions need.
    fn one<'b>(
        &'b self,
        (candidate, regressions): (&Candidate, &OnceCell<Regressions<'b>>),
        (mask, wanted): (&'b Arc<Mask>, &Mask),
        values: &Planes,
        out: &mut Planes,
    ) -> Result<Outcome, Error> {
        match (candidate.kind, self.guides) {
            (Kind::Regression(_) | Kind::Guided, Some(guides)) => {
                match (candidate.kind, self.tuned) {
                    (Kind::Regression(count), _) => {
                        let new = || Regressions::new(guides, mask, (values, self.counts()));
                        regressions.get_or_init(new).predict(count, wanted, out);
                    }
                    (_, Some(tuned)) => tuned.predict((values, self.counts(), mask), guides, wanted, out),
                    (_, None) => {}
                }
                push_pull::complete(out, (mask, wanted), values, self.run)?;
                Ok(Outcome::direct())
            }
            (Kind::Splines(lambda), _) => {
                let mut problem = Problem::fill(Arc::clone(mask));
                problem.weights = self.weights.cloned();
                let settings = ss::Settings { lambda, ..ss::Settings::default() };
                settings.plan(&problem, self.run)?.reconstruct_roughly(values, ROUGH, out, self.run)
            }
            (Kind::Regression(_) | Kind::Guided, None) => Ok(Outcome::direct()),
        }
    }
}

/// Regressions on guides and place over the samples of a mask.
struct Regressions<'a> {
    guides: &'a Guides,
    mask: &'a Mask,
    /// Rows and columns.
    place: [Plane; 2],
    store: Store,
}

impl<'a> Regressions<'a> {
    fn new(guides: &'a Guides, mask: &'a Mask, (values, weights): (&Planes, Option<&Plane>)) -> Self {
        let size = mask.size();
        let mut place = [Plane::filled(size, 0.0), Plane::filled(size, 0.0)];
        let [rows, columns] = &mut place;
        let rows = rows.pixels_mut().par_chunks_mut(size.width.max(1));
        rows.zip(columns.pixels_mut().par_chunks_mut(size.width.max(1))).enumerate().for_each(
            |(row, (rows, columns))| {
                rows.fill(SPREAD as f32 * row as f32 / PLACE);
                columns.iter_mut().enumerate().for_each(|(at, to)| *to = SPREAD as f32 * at as f32 / PLACE);
            },
        );
        let field = Field { planes: guides.planes(), more: &place, labels: None };
        let store = Store::new(mask, values, field).weighted(weights);
        Self { guides, mask, place, store }
    }

    /// Predicts the `wanted` pixels, from about `count` samples each.
    fn predict(&self, count: f64, wanted: &Mask, out: &mut Planes) {
        let field = Field { planes: self.guides.planes(), more: &self.place, labels: None };
        let planes = field.count();
        // Weights of a disc whose samples count less towards its rim sum to a third.
        let ridge = SPREAD * SPREAD * SHRINK * count / 3.0;
        let scales =
            Scales { bandwidths: vec![0.0; planes], slopes: vec![true; planes], ridge: ridge as f32 };
        let reach = Reach::new(self.mask, count);
        let task = Fit { field, scales: &scales, reach: &reach, leave_out: false, isa: Isa::best() };
        predict_between(&self.store, task, wanted, out);
    }
}
