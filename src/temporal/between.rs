//! Where the pixels of a complete frame lie in the next one.

use std::sync::Arc;

use lacuna_exr::Frame;
use lacuna_filters::{Mask, Plane, Planes};

use super::carriers::carriers;
use super::reference::{Reference, measured};
use super::{Motion, Neighbour, Neighbours};
use crate::mask::Masks;

/// Of each pixel of a part of the frame before, row by row: row and column in this one; NaN where that is not known or hidden. By vectors or cameras where
/// the frames have them, else as their colours in these channels show. Nothing beyond a cut.
pub fn between(
    (before, now): (&Arc<Frame>, &Arc<Frame>),
    part: usize,
    names: &[String],
) -> Option<Vec<[f32; 2]>> {
    let whole = |frame: &Arc<Frame>, offset: i64| Neighbour {
        number: offset,
        offset,
        label: String::new(),
        frame: Arc::clone(frame),
        masks: Arc::new(Masks::complete(frame)),
        samples: None,
    };
    let own = whole(now, 0);
    let neighbours = Neighbours { all: vec![whole(before, -1)], ..Neighbours::default() };
    let (samples, mask) = measured(&own, part, names)?;
    let finite = |samples: &Planes, _: &Arc<Mask>| {
        let mut planes = samples.clone();
        let values = planes.as_mut_slice().iter_mut().flat_map(Plane::pixels_mut);
        values.filter(|value| !value.is_finite()).for_each(|value| *value = 0.0);
        Some(planes)
    };
    let filled = finite(&samples, &mask)?;
    let window = now.parts[part].data_window;
    let reference =
        Reference { window, names: names.to_vec(), filled, samples: &samples, mask: &mask, sharp: &finite };
    let (mut found, _) = carriers((now, &own.masks, part), &neighbours, Motion::Auto, &reference);
    found.pop().map(|carrier| carrier.places())
}
