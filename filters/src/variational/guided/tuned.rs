//! Guided regression without trust, for those that weigh it themselves.

use std::sync::Arc;

use super::{Field, Guides, Model, Seen, Task, fit, tune};
use crate::kernel::Isa;
use crate::kernel::regress::Scales;
use crate::{Error, Mask, Plane, Planes, Run};

/// What guides count for, as samples showed.
pub struct Tuned {
    scales: Scales,
}

impl Tuned {
    /// Nothing if no guide predicts the samples, which may weigh differently.
    pub fn new(
        mask: &Arc<Mask>,
        (samples, weights): (&Planes, Option<&Plane>),
        guides: &Guides,
    ) -> Option<Self> {
        let model = model(mask, (samples, weights), guides);
        let scales = model.tune(&model.seen(), tune::Weights::new(mask, samples), guides)?;
        Some(Self { scales })
    }

    /// Predicts the `wanted` pixels, measured ones from their own samples, too; where nothing is near they become NaN.
    pub fn predict(
        &self,
        (samples, weights, mask): (&Planes, Option<&Plane>, &Arc<Mask>),
        guides: &Guides,
        wanted: &Mask,
        out: &mut Planes,
    ) {
        let model = model(mask, (samples, weights), guides);
        let Seen { store, reach } = model.seen();
        let (field, isa) = (model.field, model.isa);
        let task = Task { field, scales: &self.scales, reach: &reach, leave_out: false, isa };
        fit::predict(&store, task, wanted, out);
    }

    /// The image from these samples, splines through what the regression leaves of them; where these are held out of a mask, roughly and at its
    /// pixels.
    pub fn fill(
        &self,
        (samples, mask): (&Planes, &Arc<Mask>),
        guides: &Guides,
        held_out_of: Option<&Mask>,
        run: &Run<'_>,
    ) -> Result<Planes, Error> {
        let model = model(mask, (samples, None), guides);
        Ok(model.image(&model.seen(), &self.scales, held_out_of, run)?.0)
    }
}

fn model<'a>(
    mask: &'a Arc<Mask>,
    (samples, weights): (&'a Planes, Option<&'a Plane>),
    guides: &'a Guides,
) -> Model<'a> {
    let field = Field { planes: guides.planes(), more: &[], labels: guides.labels() };
    Model { mask, samples, weights, field, isa: Isa::best() }
}
