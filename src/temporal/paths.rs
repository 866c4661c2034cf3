//! Where vectors carry samples to, frame by frame, each step by the vectors of the frame that knows it; and which of them are hidden there.

use std::sync::Arc;

use lacuna_exr::Window;
use lacuna_filters::baseline::nearest::NearestMap;
use lacuna_filters::temporal::unjudged;
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
    /// Whether they were measured at some pixels alone.
    sparse: bool,
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
        let (mut known, mut sparse) = (vec![true; size.pixels()], false);
        for name in layer.names.iter().filter(|&name| !dense.contains(name)) {
            let mask: &Arc<Mask> = source.masks.get(layer.part, vectors::channel(own, name)?)?;
            known.iter_mut().zip(mask.as_slice()).for_each(|(known, flag)| *known &= *flag);
            sparse |= !mask.is_full();
        }
        for (known, vector) in known.iter_mut().zip(&vectors) {
            *known &= vector.iter().all(|v| v.is_finite());
        }
        let known = Mask::new(size, known).ok()?;
        let nearest = NearestMap::new(&known).ok()?;
        Some(Self { size, corner, vectors, known, nearest, sparse })
    }

    /// What it is to a missing pixel where samples that judge stand for such: these have no vectors either. Nothing if missing pixels do.
    fn blind(&self, mask: &Mask) -> Option<Self> {
        if !self.sparse || mask.size() != self.size {
            return None;
        }
        let kept = unjudged(mask);
        let judges = mask.as_slice().iter().zip(kept.as_slice()).map(|(own, kept)| *own && !*kept);
        let known = self.known.as_slice().iter().zip(judges).map(|(own, judges)| *own && !judges);
        let known = Mask::new(self.size, known.collect()).ok()?;
        let nearest = NearestMap::new(&known).ok()?;
        Some(Self { vectors: self.vectors.clone(), known, nearest, ..*self })
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
    /// The frame's own as samples that judge may know it, if that is another one.
    blind: Option<Field>,
}

impl Paths {
    /// By one layer and one reading, for a frame with this data window; its samples that judge are some of this mask.
    pub fn new<'a>(
        frames: impl Iterator<Item = (i64, FrameRef<'a>)>,
        (part, window, mask): (usize, Window, &Mask),
        (layer, reading): (Layer, Reading),
    ) -> Self {
        let field = |(offset, source)| Some((offset, Field::new((source, part), window, &layer, reading)?));
        let fields: Vec<_> = frames.filter_map(field).collect();
        let own = fields.iter().find(|(offset, _)| *offset == 0);
        let blind = own.and_then(|(_, own)| own.blind(mask));
        Self { layer, reading, fields, blind }
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
        self.places_by(self.field(0), offset)
    }

    /// The same where samples that are held out may judge, if it differs.
    pub fn judged(&self, offset: i64) -> Option<Vec<[f32; 2]>> {
        self.places_by(Some(self.blind.as_ref()?), offset)
    }

    /// The same by these vectors of the frame itself.
    fn places_by(&self, target: Option<&Field>, offset: i64) -> Option<Vec<[f32; 2]>> {
        let own = self.field(offset)?;
        let place = |at: usize| {
            if own.known.as_slice()[at] { self.place((own, target), at, offset) } else { [f32::NAN; 2] }
        };
        Some((0..own.size.pixels()).map(place).collect())
    }

    fn place(&self, (own, target): (&Field, Option<&Field>), pixel: usize, offset: i64) -> [f32; 2] {
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
            let field = if knows == 0 { target } else { self.field(knows) };
            if knows != offset
                && let Some(known) = field.and_then(|field| field.like(there, motion).next())
            {
                motion = known;
            }
            at = add(at, motion);
            frame += step;
        }
        let seen = target.is_none_or(|field| field.shows(at, motion));
        if seen { at } else { [f32::NAN; 2] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mask::{self, Source};
    use crate::temporal::Neighbour;
    use crate::testing::{float, frame, part, window};

    const SIDE: usize = 40;

    /// A frame whose left side moves by `motion`, measured at a third of its pixels or with complete vectors.
    fn shown(motion: impl Fn(usize) -> f32, dense: bool) -> Neighbour {
        let measured = |at: usize| (at * 7919 + at / SIDE).is_multiple_of(3);
        let all = |value: &dyn Fn(usize) -> f32| (0..SIDE * SIDE).map(value).collect::<Vec<f32>>();
        let across = all(&|at| if dense || measured(at) { motion(at) } else { 0.0 });
        let channels = vec![
            float("R", &[0.5; SIDE * SIDE]),
            float("mask", &all(&|at| f32::from(u8::from(measured(at))))),
            float("motion.X", &across),
            float("motion.Y", &[0.0; SIDE * SIDE]),
        ];
        let mut own = frame(vec![part(window(0, 0, SIDE as i32, SIDE as i32), channels)]);
        if dense {
            own.parts[0].attributes.set_text(channels::DENSE, "motion.X, motion.Y");
        }
        let masks = Arc::new(mask::find(&own, &Source::Auto, None).unwrap());
        Neighbour { number: 1, offset: -1, label: String::new(), frame: Arc::new(own), masks, samples: None }
    }

    fn paths(motion: impl Fn(usize) -> f32, dense: bool) -> (Paths, Mask) {
        let [before, now] = [shown(left, dense), shown(motion, dense)];
        let layer = vectors::layers(&before, 0).swap_remove(0);
        let mask = Mask::clone(now.masks.get(0, 0).unwrap());
        let frames = [(0, now.source()), (-1, before.source())].into_iter();
        (
            Paths::new(
                frames,
                (0, window(0, 0, SIDE as i32, SIDE as i32), &mask),
                (layer, Reading::all()[0]),
            ),
            mask,
        )
    }

    fn left(at: usize) -> f32 {
        if at % SIDE < SIDE / 2 { 4.0 } else { 0.0 }
    }

    fn bits(places: &[[f32; 2]]) -> Vec<[u32; 2]> {
        places.iter().map(|place| place.map(f32::to_bits)).collect()
    }

    /// Whatever vectors were measured along with them: a missing pixel would not have these.
    #[test]
    fn samples_that_judge_do_not_show_what_hides_others() {
        let (own, mask) = paths(left, false);
        let kept = unjudged(&mask);
        let judges = |at: usize| mask.as_slice()[at] && !kept.as_slice()[at];
        let (other, _) = paths(|at| if judges(at) { 4.0 - left(at) } else { left(at) }, false);
        let of = |paths: &Paths| [paths.places(-1).unwrap(), paths.judged(-1).unwrap()].map(|all| bits(&all));
        let ([known, judged], [changed, as_judged]) = (of(&own), of(&other));
        assert!(judged == as_judged);
        assert!(known != changed && judged != changed);
    }

    #[test]
    fn missing_pixels_know_complete_vectors_as_well() {
        assert!(paths(left, true).0.judged(-1).is_none());
    }
}
