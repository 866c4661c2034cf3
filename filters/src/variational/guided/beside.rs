//! Guided regression that sees samples of other frames beside those of this one.
//!
//! As in [`super`], but over more and nearer samples, so that the regression goes by place as well as by guides: planes of rows and of columns have a
//! slope and no weight. A last plane, with a weight and no slope, is how many frames away a sample was measured: 0 for those of this frame. The guides of
//! a sample are those of its own frame, of the very rays that it is of; where these are not known, this frame's at its place. Nothing is chosen: where it is worse than others, [`crate::auto`] gives it no share.

use std::sync::Arc;

use super::{Field, Guides, Model, Reach, SAMPLES, Seen, Store};
use crate::kernel::Isa;
use crate::kernel::regress::{RIDGE, Samples, Scales};
use crate::{Error, Mask, Outcome, Plane, Planes, Run, Size};

/// Pixels over which a slope along rows or columns counts as one of a guide over its range.
const PIXELS: f32 = 4.0;
/// Factor of a guide's difference: samples are near, so guides differ little.
const BANDWIDTH: f32 = 0.8;
/// Factor of a frame's distance: a sample of the next frame counts about half.
const AWAY: f32 = 0.45;

/// Samples of other frames at any places of an image.
#[derive(Clone, Debug, Default)]
pub struct Beside {
    /// Rows and columns.
    pub at: Vec<[f32; 2]>,
    /// All channels of a sample together.
    pub values: Vec<f32>,
    /// How many frames away each was measured.
    pub away: Vec<f32>,
    /// All guides of a sample together, as its own frame has them; those of this frame at its place where none are known.
    pub guides: Vec<f32>,
}

/// The regression on some guides.
pub struct Regression<'a> {
    labels: Option<&'a [u32]>,
    /// Guides, rows, columns, and the distance of a frame.
    planes: Vec<Plane>,
    scales: Scales,
}

impl<'a> Regression<'a> {
    /// On these guides.
    pub fn new(guides: &'a Guides) -> Self {
        let (size, count) = (guides.size(), guides.planes().len());
        let mut planes = guides.planes().to_vec();
        planes.push(Plane::from_fn(size, |row, _| row as f32 / PIXELS));
        planes.push(Plane::from_fn(size, |_, column| column as f32 / PIXELS));
        planes.push(Plane::filled(size, 0.0));
        let bandwidths = [vec![BANDWIDTH; count], vec![0.0, 0.0, AWAY]].concat();
        let slopes = [vec![true; count + 2], vec![false]].concat();
        Self { labels: guides.labels(), planes, scales: Scales { bandwidths, slopes, ridge: RIDGE } }
    }

    /// The number of planes of guides.
    pub fn guides(&self) -> usize {
        self.planes.len() - 3
    }

    /// The image from the samples of a mask and those beside them. Where some samples are held out of a mask, roughly and at its pixels.
    pub fn fill(
        &self,
        (samples, mask): (&Planes, &Arc<Mask>),
        beside: &Beside,
        held_out_of: Option<&Mask>,
        run: &Run<'_>,
    ) -> Result<(Planes, Outcome), Error> {
        let field = Field { planes: &self.planes, more: &[], labels: self.labels };
        let seen = seen((samples, mask), beside, field);
        Model { mask, samples, weights: None, field, isa: Isa::best() }.image(
            &seen,
            &self.scales,
            held_out_of,
            run,
        )
    }
}

/// The samples of a mask and those beside them.
fn seen((samples, mask): (&Planes, &Mask), beside: &Beside, field: Field<'_>) -> Seen {
    let size = mask.size();
    let mut flags = mask.as_slice().to_vec();
    let mut more = Samples { at: beside.at.clone(), values: beside.values.clone(), ..Samples::default() };
    let guides = &field.planes[..field.planes.len() - 1];
    let count = guides.len() - 2;
    for (i, (at, away)) in beside.at.iter().zip(&beside.away).enumerate() {
        let pixel = pixel(size, *at);
        flags[pixel] = true;
        let own = beside.guides.get(i * count..(i + 1) * count).unwrap_or_default();
        more.guides.extend_from_slice(own);
        more.guides.extend(guides[own.len()..].iter().map(|plane| between(plane, *at)));
        more.guides.push(*away);
        more.labels.extend(field.labels.map(|labels| labels[pixel]));
    }
    // A pixel may hold several samples.
    let several = (mask.count() + beside.at.len()).max(1) as f64;
    let holding = Mask::of(size, flags);
    let wanted = SAMPLES * holding.count() as f64 / several;
    Seen { store: Store::beside(mask, samples, field, &more), reach: Reach::new(&holding, wanted) }
}

fn pixel(size: Size, [y, x]: [f32; 2]) -> usize {
    let at = |at: f32, length: usize| (at.round().max(0.0) as usize).min(length - 1);
    at(y, size.height) * size.width + at(x, size.width)
}

/// Linearly between pixel centres.
fn between(plane: &Plane, [y, x]: [f32; 2]) -> f32 {
    let size = plane.size();
    let axis = |at: f32, length: usize| {
        let at = at.clamp(0.0, (length - 1) as f32);
        let low = at as usize;
        (low, (low + 1).min(length - 1), at - low as f32)
    };
    let ((top, bottom, v), (left, right, u)) = (axis(y, size.height), axis(x, size.width));
    let line = |row: usize| {
        let row = plane.row(row);
        row[left] + u * (row[right] - row[left])
    };
    let (a, b) = (line(top), line(bottom));
    a + v * (b - a)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size::new(60, 64);

    fn guide(y: f32, x: f32) -> f32 {
        (0.8 * y).sin() + (0.5 * x + 0.2 * y).cos()
    }

    /// The squared error of the image from the samples of a mask and those beside them.
    fn error(guides: &Guides, (truth, mask): (&Planes, &Arc<Mask>), beside: &Beside) -> f64 {
        let regression = Regression::new(guides);
        let (image, _) = regression.fill((truth, mask), beside, None, &Run::default()).unwrap();
        let pairs = image.as_slice()[0].pixels().iter().zip(truth.as_slice()[0].pixels());
        pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum()
    }

    /// Each pixel of each frame shows another place of what it covers, and its guide is of that place.
    #[test]
    fn guides_of_the_frame_that_a_sample_is_of_tell_more_than_those_of_this_one() {
        let shaken = |seed: u64, y: usize, x: usize| {
            let random = |axis: u64| {
                let key = 2 * (y * SIZE.width + x) as u64 + axis;
                (lacuna_core::hash(seed, key) as f64 / u64::MAX as f64 - 0.5) as f32
            };
            guide(y as f32 + random(0), x as f32 + random(1))
        };
        let scene = |guide: f32| 0.4 + 0.1 * guide;
        let plane = |value: &dyn Fn(usize, usize) -> f32| Plane::from_fn(SIZE, value);
        let truth = Planes::new(SIZE, vec![plane(&|y, x| scene(shaken(0, y, x)))]).unwrap();
        let mut guides = Guides::new(SIZE);
        guides.add("guide", vec![plane(&|y, x| shaken(0, y, x))]).unwrap();
        let own = guides.alike(|_| Some(vec![plane(&|y, x| shaken(1, y, x))])).unwrap();
        let mask = Arc::new(Mask::from_fn(SIZE, |y, x| (3 * y + 2 * x) % 7 == 0));
        let mut beside = Beside::default();
        for (y, x) in (0..60).flat_map(|y| (0..64).map(move |x| (y, x))).filter(|(y, x)| (y + 2 * x) % 3 == 0)
        {
            beside.at.push([y as f32, x as f32]);
            beside.values.push(scene(shaken(1, y, x)));
            beside.away.push(1.0);
            beside.guides.push(own[0].at(y, x));
        }
        let error = |beside: &Beside| error(&guides, (&truth, &mask), beside);
        let with = error(&beside);
        let without = error(&Beside { guides: Vec::new(), ..beside });
        assert!(with < 0.2 * without, "{with} {without}");
    }

    /// A function of a guide and of the place, sampled by one frame at few pixels and by another between many.
    #[test]
    fn samples_between_pixels_tell_what_the_frame_does_not() {
        let scene = |y: f32, x: f32| 0.4 + 0.1 * guide(y, x) + 0.05 * (0.4 * y - 0.25 * x).sin();
        let plane = |value: &dyn Fn(f32, f32) -> f32| Plane::from_fn(SIZE, |y, x| value(y as f32, x as f32));
        let truth = Planes::new(SIZE, vec![plane(&scene)]).unwrap();
        let mut guides = Guides::new(SIZE);
        guides.add("guide", vec![plane(&guide)]).unwrap();
        let mask = Arc::new(Mask::from_fn(SIZE, |y, x| (3 * y + 2 * x) % 7 == 0));
        let mut beside = Beside::default();
        for (y, x) in (0..59).flat_map(|y| (0..63).map(move |x| (y, x))).filter(|(y, x)| (y + 2 * x) % 3 == 0)
        {
            let at = [y as f32 + 0.3, x as f32 + 0.6];
            beside.at.push(at);
            beside.values.push(scene(at[0], at[1]));
            beside.away.push(1.0);
        }
        let error = |beside: &Beside| error(&guides, (&truth, &mask), beside);
        let (with, without) = (error(&beside), error(&Beside::default()));
        assert!(with < 0.5 * without, "{with} {without}");
    }
}
