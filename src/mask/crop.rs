//! A mask as rectangles, for renderers that can only crop: few enough, and with little in them that nobody asked for.
//!
//! The bounding box of all measured pixels is halved across its longer side, each half shrunk to its own bounding box, and
//! so on down to single pixels. A rectangle costs its area plus a fixed overhead (what a renderer spends on starting a
//! crop, in pixels); from the smallest up, two halves replace the whole where they cost less. Cost: O(N log N), N pixels.

use lacuna_exr::Window;
use lacuna_filters::Mask;
use serde::Serialize;

/// One rectangle, in absolute pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Rectangle {
    /// First column.
    pub x: i64,
    /// First row.
    pub y: i64,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Pixels in it that the mask asks for.
    pub measured: usize,
}

/// The rectangles of a mask and what they cost.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Crops {
    /// First column of the mask's window.
    pub x: i32,
    /// First row of the mask's window.
    pub y: i32,
    /// Columns of the mask's window.
    pub width: usize,
    /// Rows of the mask's window.
    pub height: usize,
    /// Pixels that the mask asks for, over all.
    pub density: f64,
    /// Pixels that the rectangles render, over all: what the detour costs.
    pub coverage: f64,
    /// The rectangles; none overlaps another.
    pub rectangles: Vec<Rectangle>,
}

/// Cuts a mask into rectangles of `overhead` pixels each besides their area.
pub fn crops(mask: &Mask, window: Window, overhead: usize) -> Crops {
    let size = mask.size();
    let mut rectangles = Vec::new();
    if let Some(all) = shrink(mask, Area { top: 0, left: 0, bottom: size.height, right: size.width }) {
        cut(mask, all, overhead, &mut rectangles);
    }
    let rendered: usize = rectangles.iter().map(|area: &Area| area.pixels()).sum();
    let absolute = |area: Area| Rectangle {
        x: i64::from(window.x_min) + area.left as i64,
        y: i64::from(window.y_min) + area.top as i64,
        width: area.right - area.left,
        height: area.bottom - area.top,
        measured: area
            .rows()
            .map(|row| mask.row(row)[area.left..area.right].iter().filter(|m| **m).count())
            .sum(),
    };
    Crops {
        x: window.x_min,
        y: window.y_min,
        width: size.width,
        height: size.height,
        density: mask.density(),
        coverage: rendered as f64 / size.pixels().max(1) as f64,
        rectangles: rectangles.into_iter().map(absolute).collect(),
    }
}

#[derive(Clone, Copy)]
struct Area {
    top: usize,
    left: usize,
    bottom: usize,
    right: usize,
}

impl Area {
    fn pixels(&self) -> usize {
        (self.bottom - self.top) * (self.right - self.left)
    }

    fn rows(&self) -> std::ops::Range<usize> {
        self.top..self.bottom
    }
}

/// The bounding box of the measured pixels of an area; nothing without any.
fn shrink(mask: &Mask, area: Area) -> Option<Area> {
    let any = |row: usize| mask.row(row)[area.left..area.right].contains(&true);
    let top = area.rows().find(|&row| any(row))?;
    let bottom = area.rows().rev().find(|&row| any(row))? + 1;
    let (mut left, mut right) = (area.right, area.left);
    for row in top..bottom {
        let flags = &mask.row(row)[area.left..area.right];
        if let (Some(first), Some(last)) =
            (flags.iter().position(|flag| *flag), flags.iter().rposition(|flag| *flag))
        {
            left = left.min(area.left + first);
            right = right.max(area.left + last + 1);
        }
    }
    Some(Area { top, left, bottom, right })
}

/// Adds the cheapest rectangles of a shrunk area; what they cost.
fn cut(mask: &Mask, area: Area, overhead: usize, out: &mut Vec<Area>) -> usize {
    let whole = area.pixels().saturating_add(overhead);
    let start = out.len();
    let (height, width) = (area.bottom - area.top, area.right - area.left);
    let halves = if height >= width && height > 1 {
        let middle = area.top + height / 2;
        [Area { bottom: middle, ..area }, Area { top: middle, ..area }]
    } else if width > 1 {
        let middle = area.left + width / 2;
        [Area { right: middle, ..area }, Area { left: middle, ..area }]
    } else {
        out.push(area);
        return whole;
    };
    // Nothing smaller than two overheads can be worth two rectangles.
    let mut parts = usize::MAX;
    if area.pixels() > overhead {
        parts = halves
            .into_iter()
            .filter_map(|half| shrink(mask, half))
            .map(|half| cut(mask, half, overhead, out))
            .fold(0, usize::saturating_add);
    }
    if parts < whole {
        return parts;
    }
    out.truncate(start);
    out.push(area);
    whole
}

#[cfg(test)]
mod tests {
    use lacuna_filters::Size;
    use proptest::prelude::*;

    use super::*;
    use crate::testing::window;

    #[test]
    fn an_overhead_beyond_all_pixels_is_one_rectangle() {
        let mask = Mask::from_fn(Size::new(9, 9), |y, x| (y + x) % 4 == 0);
        for overhead in [usize::MAX, usize::MAX - 80] {
            assert_eq!(crops(&mask, window(0, 0, 9, 9), overhead).rectangles.len(), 1);
        }
    }

    proptest! {
        #[test]
        fn covers_each_measured_pixel_once(
            height in 1_usize..30, width in 1_usize..30, overhead in 0_usize..40,
            flags in proptest::collection::vec(proptest::bool::weighted(0.1), 900),
        ) {
            let mask = Mask::from_fn(Size::new(height, width), |y, x| flags[y * 30 + x]);
            let crops = crops(&mask, window(-3, 5, width as i32, height as i32), overhead);
            let mut hits = vec![0; height * width];
            for rectangle in &crops.rectangles {
                for y in 0..rectangle.height {
                    for x in 0..rectangle.width {
                        let (y, x) = ((rectangle.y - 5) as usize + y, (rectangle.x + 3) as usize + x);
                        hits[y * width + x] += 1;
                    }
                }
            }
            prop_assert!(hits.iter().all(|hits| *hits <= 1));
            prop_assert!(mask.as_slice().iter().zip(&hits).all(|(measured, hits)| !measured || *hits == 1));
            prop_assert_eq!(crops.rectangles.iter().map(|r| r.measured).sum::<usize>(), mask.count());
            let coverage = hits.iter().sum::<usize>() as f64 / hits.len() as f64;
            prop_assert!((crops.coverage - coverage).abs() < 1e-12);
            if overhead == 0 {
                prop_assert!((crops.coverage - crops.density).abs() < 1e-12, "free rectangles waste nothing");
            }
        }
    }

    #[test]
    fn two_far_blocks_are_two_rectangles() {
        let block = |y: usize, x: usize, at: usize| (at..at + 8).contains(&y) && (at..at + 8).contains(&x);
        let mask = Mask::from_fn(Size::new(100, 100), |y, x| block(y, x, 4) || block(y, x, 80));
        let crops = crops(&mask, window(0, 0, 100, 100), 64);
        assert_eq!(crops.rectangles.len(), 2);
        assert_eq!(crops.rectangles[0], Rectangle { x: 4, y: 4, width: 8, height: 8, measured: 64 });
    }
}
