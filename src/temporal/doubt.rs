//! Whether vectors lead where they should, and if not, whether estimated motion does.
//!
//! Vectors that are right carry samples to where the frame's fill misses them by no more than it misses its own held-out samples, which stand in emptier
//! places. Where they miss it by more, which shadows and reflections do as well, motion is estimated from the nearest frame on either side: both then predict the
//! samples that neither knows, from the fills of those frames.

use std::ops::Deref;

use lacuna_filters::baseline::nearest::NearestMap;
use lacuna_filters::temporal::{Judge, flow};
use lacuna_filters::{Mask, Size};

use super::Neighbour;
use super::blind::Blind;
use super::carriers::Asked;
use super::paths::Paths;
use super::reference::{Reference, measured};

/// The part of the disagreement by vectors that estimated motion may leave to be taken for better: what frames say of themselves goes first.
const BETTER: f64 = 0.8;
/// How far from where a pixel is carried to a sample may be, in pixels, to be predicted by its motion.
const NEAR: u32 = 2;
/// Samples that say something, at least.
const FEWEST: usize = 64;

/// A line that says so where motion that is estimated is clearly better than vectors.
pub fn outdone(
    paths: &[Option<Paths>; 2],
    neighbours: &[&Neighbour],
    part: usize,
    reference: &Reference<'_>,
    blind: &dyn Deref<Target = Option<Blind>>,
) -> Option<String> {
    // Of a complete frame nothing is judged.
    if reference.mask.is_full() {
        return None;
    }
    let nearest = |later: bool| {
        let fits = |one: &Neighbour| one.frame.parts[part].data_window == reference.window;
        let side = neighbours.iter().filter(|one| (one.offset > 0) == later && fits(one));
        side.min_by_key(|one| one.offset.unsigned_abs())
    };
    let led = [false, true].into_iter().filter_map(|later| {
        let (own, paths) = (nearest(later)?, paths[usize::from(later)].as_ref()?);
        Some((*own, paths.places(own.offset)?, paths.judged(own.offset)))
    });
    let led: Vec<_> = led.collect();
    let judge = Judge::new(&reference.filled, reference.mask);
    let missed = led.iter().filter_map(|(own, places, _)| {
        let asked = Asked::new(own, part, &reference.names)?;
        Some(judge.mean(&asked.at(reference.mask.size(), places)))
    });
    let worst = missed.fold(0.0, f64::max);
    let blind = blind.as_ref()?;
    if worst <= own_misses(reference, blind) {
        return None;
    }
    let mut sums = [0.0; 2];
    let mut count = 0;
    for (own, places, judged) in &led {
        let (samples, mask) = measured(own, part, &reference.names)?;
        let filled = (reference.sharp)(&samples, &mask)?;
        let by_flow = flow::estimate(&filled, &blind.filled).ok()?;
        let both = [judged.as_ref().unwrap_or(places), &by_flow];
        let of = both.map(|places| Back::new(samples.size(), places));
        let [Some(vectors), Some(flow)] = of else { continue };
        let judge = Judge::new(&filled, &mask);
        for &at in &blind.judges {
            let miss = |back: &Back<'_>| judge.of(reference.samples, at, back.place(at)?);
            if let (Some(a), Some(b)) = (miss(&vectors), miss(&flow)) {
                sums = [sums[0] + a, sums[1] + b];
                count += 1;
            }
        }
    }
    let name = paths.iter().flatten().next()?.name();
    let less = 100.0 * (1.0 - sums[1] / sums[0]);
    (count >= FEWEST && sums[1] < BETTER * sums[0])
        .then(|| format!("along by flow, not by {name}: it misses held-out samples by {less:.0} % less"))
}

/// How far the frame's own fill disagrees with its samples where it does not know them.
fn own_misses(reference: &Reference<'_>, blind: &Blind) -> f64 {
    let size = reference.mask.size();
    let judge = Judge::new(&blind.filled, reference.mask);
    let of =
        |&at: &usize| judge.of(reference.samples, at, [(at / size.width) as f32, (at % size.width) as f32]);
    blind.judges.iter().filter_map(of).sum::<f64>() / blind.judges.len().max(1) as f64
}

/// Where pixels of the frame lie in another one, by those that are carried near them.
struct Back<'a> {
    size: Size,
    places: &'a [[f32; 2]],
    /// The pixel of the other frame that is carried into each pixel of this one.
    carried: Vec<u32>,
    nearest: NearestMap,
    squared: Vec<u32>,
}

impl<'a> Back<'a> {
    fn new(size: Size, places: &'a [[f32; 2]]) -> Option<Self> {
        let mut carried = vec![u32::MAX; size.pixels()];
        for (pixel, place) in places.iter().enumerate() {
            let [row, column] = place.map(f32::round);
            let inside = |at: f32, length: usize| at >= 0.0 && at < length as f32;
            if inside(row, size.height) && inside(column, size.width) {
                carried[row as usize * size.width + column as usize] = pixel as u32;
            }
        }
        let known = Mask::new(size, carried.iter().map(|pixel| *pixel != u32::MAX).collect()).ok()?;
        let nearest = NearestMap::new(&known).ok()?;
        let squared = nearest.squared_distances();
        Some(Self { size, places, carried, nearest, squared })
    }

    fn place(&self, at: usize) -> Option<[f32; 2]> {
        let pixel = self.carried[self.nearest.as_slice()[at] as usize] as usize;
        let width = self.size.width;
        let [row, column] = self.places[pixel];
        let place = [(at / width + pixel / width) as f32 - row, (at % width + pixel % width) as f32 - column];
        (self.squared[at] <= NEAR * NEAR).then_some(place)
    }
}
