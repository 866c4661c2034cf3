//! The planes of the guides that were found, as the filters take them.

use lacuna_core::parallel::prelude::*;
use lacuna_exr::{Frame, Samples};
use lacuna_filters::variational::guided::Guides;
use lacuna_filters::{Error, Plane, Size};

use super::{Guide, Kind};

/// Reads the guides of one part; those that say nothing (constant ones) are left out.
///
/// # Errors
/// [`Error::SizeMismatch`] if a part's pixels are others.
pub fn collect<'a>(
    guides: impl IntoIterator<Item = &'a Guide>,
    frame: &Frame,
    second: Option<&Frame>,
    size: Size,
) -> Result<Guides, Error> {
    let mut taken = Guides::new(size);
    for guide in guides {
        let Some(source) = (if guide.second { second } else { Some(frame) }) else { continue };
        let part = &source.parts[guide.part];
        let samples: Vec<&Samples> = guide.channels.iter().map(|&at| &part.channels[at].samples).collect();
        match guide.kind {
            Kind::Labels => {
                for labels in samples.par_iter().map(|samples| labels(samples)) {
                    taken.add_labels(&guide.name, &labels)?;
                }
            }
            Kind::Values => {
                let planes = samples.par_iter().map(|samples| Plane::new(part.size(), samples.as_f32()));
                taken.add(&guide.name, planes.into_iter().collect::<Result<_, _>>()?)?;
            }
        }
    }
    Ok(taken)
}

/// Labels of surfaces; a float that was averaged over a pixel counts as the whole number next to it.
fn labels(samples: &Samples) -> Vec<u32> {
    match samples {
        Samples::Uint(values) => values.clone(),
        floats => floats.as_f32().into_iter().map(|value| value.round().to_bits()).collect(),
    }
}
