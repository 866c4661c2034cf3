//! Blocks of frames, for training; and where a frame's colour is.

use lacuna_exr::{Frame, Part};
use lacuna_filters::dictionary::blocks::Grid;
use lacuna_filters::domain::{Domain, Map};
use lacuna_filters::{Mask, Plane, Planes};

use super::Error;
use crate::channels::{self, Name, rgb_place};

/// Weights of R, G and B in a grey image: the luminance of Rec. 709.
const GREY: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// The largest values that are learned from: sums of the squares of all blocks, a thousand times a million numbers, stay finite.
const LARGEST: f32 = 1e14;

/// The channels R, G and B of a layer, in that order.
pub fn triple(part: &Part, layer: &str) -> Option<[usize; 3]> {
    let mut found = [None; 3];
    for (at, channel) in part.channels.iter().enumerate() {
        let name = channel.display_name();
        if Name::new(&name).layer == layer
            && let Some(place) = rgb_place(&name)
        {
            found[place].get_or_insert(at);
            if found[place] != Some(at) {
                return None;
            }
        }
    }
    let [Some(r), Some(g), Some(b)] = found else { return None };
    Some([r, g, b])
}

/// The first part with a colour and its channels in the order R, G, B: those without a layer, else the first layer's.
///
/// # Errors
/// [`Error::Frame`] where there is none, or it is of whole numbers.
pub fn colour(frame: &Frame) -> Result<(usize, [usize; 3]), Error> {
    for (index, part) in frame.parts.iter().enumerate() {
        let names: Vec<_> = part.channels.iter().map(|channel| channel.display_name()).collect();
        let mut layers = std::iter::once("").chain(names.iter().map(|name| Name::new(name).layer));
        if let Some(channels) = layers.find_map(|layer| triple(part, layer)) {
            return Ok((index, channels));
        }
    }
    let all = crate::channels::list_channels(frame);
    Err(Error::Frame(format!("no channels R, G and B (there are: {all}); name another frame")))
}

/// What the log should say of values that are not finite, which [`planes`] takes as 0.
pub fn non_finite(part: &Part, channels: &[usize]) -> Option<String> {
    let counts = channels.iter().filter_map(|&at| part.channels.get(at));
    let counts = counts.map(|channel| (channel.display_name(), channels::non_finite(&channel.samples)));
    let said = ["value is not finite and counts as 0", "values are not finite and count as 0"];
    channels::non_finite_note(said, counts)
}

/// Some channels of a part in the domain that fills work in, values that are not finite as 0; and the map there.
///
/// # Errors
/// [`Error::Frame`] for channels of whole numbers.
pub fn planes(part: &Part, channels: &[usize]) -> Result<(Planes, Map), Error> {
    let size = part.size();
    let whole = || Error::Frame("the colour is of whole numbers; give a frame of floats".into());
    let plane = |at: &usize| {
        let mut values = part.channels.get(*at)?.samples.to_floats()?;
        values.iter_mut().filter(|value| !value.is_finite()).for_each(|value| *value = 0.0);
        Plane::new(size, values).ok()
    };
    let mut planes: Vec<Plane> = channels.iter().map(plane).collect::<Option<_>>().ok_or_else(whole)?;
    let mask = Mask::from_fn(size, |_, _| true);
    let map = Domain::Auto.map(&mask, &planes);
    for plane in &mut planes {
        map.forward_plane(&mask, plane);
    }
    let planes = Planes::new(size, planes).map_err(|error| Error::Frame(error.to_string()))?;
    Ok((planes, map))
}

/// Planes R, G and B as one grey plane.
pub fn grey(planes: &Planes) -> Planes {
    let mut grey = Planes::zeros(planes.size(), 1);
    for (plane, weight) in planes.as_slice().iter().zip(GREY) {
        let sum = grey.as_mut_slice()[0].pixels_mut().iter_mut();
        sum.zip(plane.pixels()).for_each(|(sum, value)| *sum += weight * value);
    }
    grey
}

/// Blocks of frames, at most so many: each has the same chance to stay, by the seed.
#[derive(Clone, Debug)]
pub struct Blocks {
    block: usize,
    stride: usize,
    most: usize,
    seed: u64,
    seen: u64,
    values: Vec<f32>,
}

impl Blocks {
    /// None yet. `most` of 0 keeps all.
    pub fn new(block: usize, stride: usize, most: usize, seed: u64) -> Self {
        let most = if most == 0 { usize::MAX } else { most };
        Self { block, stride, most, seed, seen: 0, values: Vec::new() }
    }

    /// The numbers of all blocks that stayed.
    pub fn into_values(self) -> Vec<f32> {
        self.values
    }

    /// Adds the blocks of a frame that are not black.
    ///
    /// # Errors
    /// [`Error::Frame`] for a frame that no block fits into, and for values whose squares overflow.
    pub fn add(&mut self, planes: &Planes) -> Result<(), Error> {
        let (size, block) = (planes.size(), self.block);
        if size.height.min(size.width) < block {
            let text = format!(
                "its {size} pixels are less than a block of {block} x {block}; leave it out, or give a smaller --block"
            );
            return Err(Error::Frame(text));
        }
        let top =
            planes.as_slice().iter().flat_map(Plane::pixels).fold(0.0_f32, |top, value| top.max(value.abs()));
        if top > LARGEST {
            return Err(Error::Frame(format!(
                "values of up to {top:e} are too large to learn from; scale them down"
            )));
        }
        let grid = Grid::new(size, block, self.stride);
        let pixels = block * block;
        let mut values = vec![0.0; pixels * planes.len()];
        for at in 0..grid.len() {
            for (plane, values) in planes.as_slice().iter().zip(values.chunks_exact_mut(pixels)) {
                grid.take(plane.pixels(), at, values);
            }
            if values.iter().any(|value| *value != 0.0) {
                self.keep(&values);
            }
        }
        Ok(())
    }

    /// Keeps the first ones, then lets each new one take the place of a random one with a falling chance (Vitter 1985, R).
    fn keep(&mut self, values: &[f32]) {
        let place = if self.seen < self.most as u64 {
            self.values.extend_from_slice(values);
            None
        } else {
            let place = random(self.seed, self.seen) % (self.seen + 1);
            (place < self.most as u64).then_some(place as usize * values.len())
        };
        if let Some(start) = place {
            self.values[start..start + values.len()].copy_from_slice(values);
        }
        self.seen += 1;
    }
}

/// A random number of a seed and a place.
fn random(seed: u64, place: u64) -> u64 {
    use lacuna_core::mix;
    mix(mix(seed ^ 0x6a09_e667_f3bc_c908).wrapping_add(place.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
}

#[cfg(test)]
mod tests {
    use lacuna_filters::Size;

    use super::*;

    #[test]
    fn blocks_that_are_not_black_stay_in_fair_shares() {
        let size = Size::new(40, 80);
        let plane = Plane::from_fn(size, |y, x| if y < 20 { 0.0 } else { (x / 4) as f32 + 1.0 });
        let planes = Planes::new(size, vec![plane]).unwrap();
        let mut all = Blocks::new(4, 4, 0, 1);
        all.add(&planes).unwrap();
        assert_eq!(all.into_values().len(), 5 * 20 * 16);
        let mut counts = [0; 20];
        for seed in 0..200 {
            let mut some = Blocks::new(4, 4, 10, seed);
            some.add(&planes).unwrap();
            let values = some.into_values();
            assert_eq!(values.len(), 160);
            values.chunks(16).for_each(|block| counts[block[0] as usize - 1] += 1);
        }
        assert!(counts.iter().all(|count| (50..160).contains(count)), "{counts:?}");
    }

    #[test]
    fn frames_that_no_block_fits_into_and_values_past_all_light_are_refused() {
        let error = |size: Size, value: f32| {
            let planes = Planes::new(size, vec![Plane::filled(size, value)]).unwrap();
            Blocks::new(4, 4, 0, 1).add(&planes).unwrap_err().to_string()
        };
        assert!(error(Size::new(40, 3), 1.0).contains("--block"));
        assert!(error(Size::new(40, 40), -3e38).contains("too large"));
    }
}
