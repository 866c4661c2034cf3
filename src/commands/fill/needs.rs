//! What the work on a frame needs of memory, before it is read and once its masks and guides are known.

use lacuna_exr::{Frame, Limits};

use super::Fill;
use crate::channels;
use crate::files::plan::Item;
use crate::guides::{self, Asked};
use crate::mask::Masks;
use crate::run::batch::{Failure, Stage};
use crate::run::memory;
use crate::run::schedule::Need;

impl Fill<'_> {
    /// What reading a file of a frame may take.
    pub(super) fn limits(&self, item: &Item) -> Limits {
        memory::limits(self.job.run.memory, self.by_header(item).most)
    }

    /// With no mask known, from the least that one makes it to the most.
    pub(super) fn by_header(&self, item: &Item) -> Need {
        let what = &self.job.what;
        let asked = (*what.wanted() != Asked::None).then(|| item.guides.as_ref().unwrap_or(&item.input));
        let most = memory::Fill::most(what.estimates(), asked.map_or(0, |path| memory::most_guides(path)));
        Need { least: self.bytes(item, memory::Fill::default()), most: self.bytes(item, most) }
    }

    /// Holds no more than the frame needs by its masks and guides.
    pub(super) fn settle(
        &self,
        (item, stage): (&Item, &Stage<'_>),
        (frame, second): (&Frame, Option<&Frame>),
        masks: &Masks,
    ) -> Result<(), Failure> {
        if self.job.run.memory.is_none() {
            return Ok(());
        }
        let what = &self.job.what;
        let mut choices = channels::choose(frame, &masks.mask_channels, &what.overrides);
        // What is wrong with them is said when they are used.
        let found = guides::find(frame, masks, &mut choices, what.wanted(), second).unwrap_or_default();
        let fill = memory::Fill::of(masks.of_parts(), &what.method, what.estimates());
        stage.settle(item, self.bytes(item, memory::Fill { guides: found.most_planes(), ..fill }))
    }

    fn bytes(&self, item: &Item, fill: memory::Fill) -> u64 {
        let what = &self.job.what;
        let larger = what.enlarge.as_ref().map_or(0, |enlarge| memory::to_enlarge(&item.input, enlarge));
        let fill = memory::Fill { errors: what.error_channel.is_some(), ..fill };
        memory::to_fill(item, &what.method, fill).saturating_add(larger)
    }
}
