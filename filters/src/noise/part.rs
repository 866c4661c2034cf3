//! Where samples are held out: in all of the image, or in tiles that are spread over a large one.

use std::sync::Arc;

use super::candidates::Task;
use crate::estimate::Excerpt;
use crate::variational::guided::Guides;
use crate::{Mask, Plane, Planes};

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
    /// Tiles of an image that is large enough.
    pub fn new(task: &Task<'_>, mask: &Mask, samples: &Planes) -> Self {
        let tiles = Excerpt::tiles(mask).filter(|tiles| !tiles.mask.is_empty()).map(|excerpt| Tiles {
            samples: excerpt.planes(samples),
            guides: task.guides.map(|guides| guides.within(&excerpt)),
            weights: task.weights.map(|weights| Arc::new(excerpt.plane(weights))),
            excerpt,
        });
        Self { width: mask.size().width, tiles }
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
            (Task { guides, weights, run: whole.run }, &tiles.excerpt.mask, &tiles.samples)
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
