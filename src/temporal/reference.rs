//! What motion is judged by: colours of the frame, and those of its neighbours where they were measured.

use std::borrow::Cow;
use std::sync::Arc;

use lacuna_exr::Window;
use lacuna_filters::{Mask, Plane, Planes};

use super::Neighbour;

/// What motion is judged by and estimated from: colours of a part.
pub struct Reference<'a> {
    /// Where its pixels lie.
    pub window: Window,
    /// The full names of the channels.
    pub names: Vec<String>,
    /// All pixels of them, filled by splines.
    pub filled: Planes,
    /// Their samples.
    pub samples: &'a Planes,
    /// Where these are.
    pub mask: &'a Arc<Mask>,
    /// Fills samples with sharp edges, which motion is estimated from.
    pub sharp: &'a dyn Fn(&Planes, &Arc<Mask>) -> Option<Planes>,
}

impl Reference<'_> {
    /// Row and column, counted from the first pixel of the frame, at which a neighbour's part begins.
    pub fn corner(&self, neighbour: &Neighbour, part: usize) -> [i64; 2] {
        self.window.corner_of(neighbour.frame.parts[part].data_window)
    }
}

/// Planes of one window on another one, by absolute coordinates; 0 beyond, as the background is that renderers crop.
pub fn placed(planes: &Planes, from: Window, to: Window) -> Cow<'_, Planes> {
    if from == to {
        return Cow::Borrowed(planes);
    }
    let mut all = Planes::zeros(to.size(), planes.len());
    for (all, own) in all.as_mut_slice().iter_mut().zip(planes.as_slice()) {
        all.pixels_mut().copy_from_slice(&from.place(own.pixels(), to, 0.0));
    }
    Cow::Owned(all)
}

/// A neighbour's samples of these channels, and where all of them were measured.
pub fn measured(neighbour: &Neighbour, part: usize, names: &[String]) -> Option<(Planes, Arc<Mask>)> {
    let own = &neighbour.frame.parts[part];
    let mut both = None::<Arc<Mask>>;
    let mut planes = Vec::with_capacity(names.len());
    for name in names {
        let at = own.channels.iter().position(|channel| channel.display_name() == name.as_str())?;
        let mask = neighbour.masks.get(part, at)?;
        planes.push(Plane::new(mask.size(), neighbour.floats(part, at)?).ok()?);
        both = Some(match both {
            None => Arc::clone(mask),
            Some(both) if Arc::ptr_eq(&both, mask) => both,
            Some(both) => {
                let flags = both.as_slice().iter().zip(mask.as_slice()).map(|(a, b)| *a && *b).collect();
                Arc::new(Mask::new(both.size(), flags).ok()?)
            }
        });
    }
    let mask = both?;
    Some((Planes::new(mask.size(), planes).ok()?, mask))
}
