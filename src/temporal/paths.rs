//! Where vectors carry samples to, frame by frame, each step by the vectors of the frame that knows it; and which of them are hidden there.

use std::sync::Arc;

use lacuna_exr::Window;
use lacuna_filters::baseline::nearest::NearestMap;
use lacuna_filters::{Mask, Size};

use super::neighbours::FrameRef;
use super::vectors::{self, Layer, Reading};
use crate::channels;

/// How far the vectors of one surface may differ from frame to frame, in pixels and as a part of the longer one.
const JERK: [f32; 2] = [1.0, 0.25];
/// Where the motion around a place is looked up, in pixels, and how many of these must show it.
const PLACES: [[f32; 2]; 9] = [
    [0.0, 0.0],
    [-2.0, 0.0],
    [0.0, -2.0],
    [0.0, 2.0],
    [2.0, 0.0],
    [-2.0, -2.0],
    [-2.0, 2.0],
    [2.0, -2.0],
    [2.0, 2.0],
];
const SEEN: usize = 6;

/// The vectors of one frame, in pixels to the next frame.
struct Field {
    size: Size,
    /// Row and column of its first pixel, in the frame that is filled.
    corner: [f32; 2],
    vectors: Vec<[f32; 2]>,
    known: Mask,
    nearest: NearestMap,
}

impl Field {
    fn new(
        (source, part): (FrameRef<'_>, usize),
        window: Window,
        layer: &Layer,
        reading: Reading,
    ) -> Option<Self> {
        let own = source.frame.parts.get(layer.part)?;
        let size = own.size();
        let corner = window.corner_of(own.data_window).map(|at| at as f32);
        let scale = reading.scale(own.display_window.size());
        let scaled = |vector: [f32; 2]| std::array::from_fn(|axis| scale[axis] * vector[axis]);
        let vectors: Vec<[f32; 2]> = vectors::raw(source, part, layer)?.into_iter().map(scaled).collect();
        let dense = channels::dense(own);
        let mut known = vec![true; size.pixels()];
        for name in layer.names.iter().filter(|&name| !dense.contains(name)) {
            let mask: &Arc<Mask> = source.masks.get(layer.part, vectors::channel(own, name)?)?;
            known.iter_mut().zip(mask.as_slice()).for_each(|(known, flag)| *known &= *flag);
        }
        for (known, vector) in known.iter_mut().zip(&vectors) {
            *known &= vector.iter().all(|v| v.is_finite());
        }
        let known = Mask::new(size, known).ok()?;
        let nearest = NearestMap::new(&known).ok()?;
        Some(Self { size, corner, vectors, known, nearest })
    }

    /// The vectors that are known nearest to a place and to some around it, and are likely of the surface that moves so.
    fn like(&self, place: [f32; 2], motion: [f32; 2]) -> impl Iterator<Item = [f32; 2]> {
        let Size { height, width } = self.size;
        let pixel = |at: f32, length: usize| (at.round().max(0.0) as usize).min(length - 1);
        let all = PLACES.into_iter().map(move |[dy, dx]| {
            let [row, column] = [place[0] - self.corner[0] + dy, place[1] - self.corner[1] + dx];
            let at = pixel(row, height) * width + pixel(column, width);
            self.vectors[self.nearest.as_slice()[at] as usize]
        });
        all.filter(move |vector| is_one_motion(*vector, motion))
    }

    /// Whether a surface that moves so is seen at a place. By the nearest vector alone, what is behind would shine through beside every outline.
    fn shows(&self, place: [f32; 2], motion: [f32; 2]) -> bool {
        self.like(place, motion).count() >= SEEN
    }
}

fn is_one_motion(a: [f32; 2], b: [f32; 2]) -> bool {
    let longer = a[0].hypot(a[1]).max(b[0].hypot(b[1]));
    (a[0] - b[0]).hypot(a[1] - b[1]) <= JERK[0] + JERK[1] * longer
}

/// The vectors of a frame and of those beside it.
pub struct Paths {
    layer: Layer,
    reading: Reading,
    /// With the number of each less that of the frame.
    fields: Vec<(i64, Field)>,
}

impl Paths {
    /// By one layer and one reading, for a frame with this data window.
    pub fn new<'a>(
        frames: impl Iterator<Item = (i64, FrameRef<'a>)>,
        (part, window): (usize, Window),
        (layer, reading): (Layer, Reading),
    ) -> Self {
        let field = |(offset, source)| Some((offset, Field::new((source, part), window, &layer, reading)?));
        let fields = frames.filter_map(field).collect();
        Self { layer, reading, fields }
    }

    /// What it is, in words.
    pub fn name(&self) -> String {
        self.reading.name(&self.layer)
    }

    fn field(&self, offset: i64) -> Option<&Field> {
        self.fields.iter().find(|(own, _)| *own == offset).map(|(_, field)| field)
    }

    /// Where each pixel of the frame that is `offset` away lies in the frame; NaN where that is not known, or something else is in front of it.
    pub fn places(&self, offset: i64) -> Option<Vec<[f32; 2]>> {
        let own = self.field(offset)?;
        let place = |at: usize| {
            if own.known.as_slice()[at] { self.place(own, at, offset) } else { [f32::NAN; 2] }
        };
        Some((0..own.size.pixels()).map(place).collect())
    }

    fn place(&self, own: &Field, pixel: usize, offset: i64) -> [f32; 2] {
        let step = -offset.signum();
        let time = step as f32;
        let add = |at: [f32; 2], motion: [f32; 2]| [at[0] + time * motion[0], at[1] + time * motion[1]];
        let mut motion = own.vectors[pixel];
        let [row, column] = [pixel / own.size.width, pixel % own.size.width];
        let mut at = [row as f32 + own.corner[0], column as f32 + own.corner[1]];
        let mut frame = offset;
        while frame != 0 {
            // A step is known to the frame whose vectors span it. Where that does not show the surface, it moves on as before.
            let (knows, there) =
                if self.reading.next == (step > 0) { (frame, at) } else { (frame + step, add(at, motion)) };
            if knows != offset
                && let Some(known) = self.field(knows).and_then(|field| field.like(there, motion).next())
            {
                motion = known;
            }
            at = add(at, motion);
            frame += step;
        }
        let seen = self.field(0).is_none_or(|field| field.shows(at, motion));
        if seen { at } else { [f32::NAN; 2] }
    }
}
