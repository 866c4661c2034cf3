//! What motion is judged by: colours of the frame, and those of its neighbours where they were measured.

use std::sync::Arc;

use lacuna_filters::{Mask, Plane, Planes};

use super::Neighbour;

/// What motion is judged by and estimated from: colours of a part.
pub struct Reference<'a> {
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
