//! Where samples are held out: in all of the image, or in tiles that are spread over a large one.

use std::sync::Arc;

use super::candidates::Task;
use crate::excerpt::Excerpt;
use crate::variational::guided::Guides;
use crate::{Mask, Plane, Planes};

/// Samples in tiles over those that lie in so large a part of the image on average: with fewer, tiles are not like the image.
const SHARE: f64 = 0.5;

/// All of the image, or tiles.
pub struct Part {
    width: usize,
    tiles: Option<Tiles>,
}

struct Tiles {
    excerpt: Excerpt,
    samples: Planes,
    guides: Option<Guides>,
    weights: Option<Arc<Plane>>,
}

impl Part {
    /// Tiles of an image that is large enough, if they hold their share of the samples that count.
    pub fn new(task: &Task<'_>, mask: &Mask, samples: &Planes) -> Self {
        let size = mask.size();
        let tiles = Excerpt::tiles(mask).map(|excerpt| Tiles {
            samples: excerpt.planes(samples),
            guides: task.guides.map(|guides| guides.within(&excerpt)),
            weights: task.weights.map(|weights| Arc::new(excerpt.plane(weights))),
            excerpt,
        });
        let held = |tiles: &Tiles| {
            let own = counting(&tiles.excerpt.mask, tiles.weights.as_deref()) as f64;
            let share = tiles.samples.size().pixels() as f64 / size.pixels() as f64;
            own >= SHARE * share * counting(mask, task.weights.map(Arc::as_ref)) as f64
        };
        Self { width: size.width, tiles: tiles.filter(held) }
    }

    /// What the candidates are given: the task of all of the image, its mask and its samples, or those of the tiles.
    pub fn task<'a>(
        &'a self,
        whole: &Task<'a>,
        mask: &'a Arc<Mask>,
        samples: &'a Planes,
    ) -> (Task<'a>, &'a Arc<Mask>, &'a Planes) {
        self.tiles.as_ref().map_or((*whole, mask, samples), |tiles| {
            let (guides, weights) = (tiles.guides.as_ref(), tiles.weights.as_ref());
            (Task { guides, weights, ..*whole }, &tiles.excerpt.mask, &tiles.samples)
        })
    }

    /// Whether the neighbours of a pixel's tile do not reach it.
    pub fn is_inner(&self, pixel: u32) -> bool {
        self.tiles.as_ref().is_none_or(|tiles| tiles.excerpt.is_inner(pixel))
    }

    /// The pixel of the image that a pixel is.
    pub fn pixel(&self, pixel: usize) -> u32 {
        self.tiles.as_ref().map_or(pixel, |tiles| tiles.excerpt.source(pixel)) as u32
    }

    /// Its row and column.
    pub fn place(&self, pixel: usize) -> (usize, usize) {
        let pixel = self.pixel(pixel) as usize;
        (pixel / self.width, pixel % self.width)
    }
}

/// The measured pixels that count.
fn counting(mask: &Mask, weights: Option<&Plane>) -> usize {
    weights.map_or(mask.count(), |weights| {
        let measured = mask.as_slice().iter().zip(weights.pixels());
        measured.filter(|(measured, weight)| **measured && **weight > 0.0).count()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Run, Size};

    fn at(row: usize, column: usize) -> f32 {
        (row * 1000 + column) as f32
    }

    #[test]
    fn tiles_of_a_large_image_hold_its_pixels_and_a_small_one_is_taken_whole() {
        for (size, tiled) in [(Size::new(900, 960), true), (Size::new(500, 600), false)] {
            let mask = Arc::new(Mask::from_fn(size, |row, column| (row + 2 * column).is_multiple_of(5)));
            let plane = Plane::from_fn(size, at);
            let samples = Planes::new(size, vec![plane.clone()]).unwrap();
            let mut guides = Guides::new(size);
            guides.add("guide", vec![plane.clone()]).unwrap();
            let (weights, run) = (Arc::new(plane), Run::default());
            let task = Task {
                guides: Some(&guides),
                weights: Some(&weights),
                counted: true,
                tuned: None,
                run: &run,
            };
            let part = Part::new(&task, &mask, &samples);
            let (small, kept, own) = part.task(&task, &mask, &samples);
            assert_eq!(kept.size() != size, tiled);
            for pixel in (0..kept.size().pixels()).step_by(37) {
                let (row, column) = part.place(pixel);
                assert_eq!(part.pixel(pixel) as usize, row * size.width + column);
                assert_eq!(kept.as_slice()[pixel], mask.is_measured(row, column));
                assert_eq!(own.as_slice()[0].pixels()[pixel], at(row, column));
                assert_eq!(small.weights.unwrap().pixels()[pixel], at(row, column));
                let guide = &small.guides.unwrap().planes()[0];
                assert_eq!(guide.pixels()[pixel], guides.planes()[0].at(row, column));
            }
            let judged = (0..kept.size().pixels() as u32).filter(|&pixel| part.is_inner(pixel)).count();
            assert_eq!(judged < kept.size().pixels(), tiled);
        }
    }

    #[test]
    fn tiles_that_few_samples_lie_in_are_not_taken() {
        let size = Size::new(900, 960);
        let plane = Planes::new(size, vec![Plane::from_fn(size, at)]).unwrap();
        let weights =
            Arc::new(Plane::from_fn(size, |row, _| if (128..250).contains(&row) { 1.0 } else { 0.0 }));
        let run = Run::default();
        for (weights, measured) in [
            (None, &(|row: usize, _: usize| (140..190).contains(&row)) as &dyn Fn(usize, usize) -> bool),
            (Some(&weights), &|row, column| (row + column).is_multiple_of(3)),
        ] {
            let mask = Mask::from_fn(size, measured);
            let task = Task { guides: None, weights, counted: true, tuned: None, run: &run };
            let tiles = Excerpt::tiles(&mask).unwrap();
            let part = Part::new(&task, &mask, &plane);
            assert!(part.tiles.is_none(), "{}", tiles.mask.count());
        }
    }
}
