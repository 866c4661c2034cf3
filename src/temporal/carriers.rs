//! Where the samples of each neighbour lie in a part, and by what that is known.

use std::cell::LazyCell;
use std::ops::Deref;

use lacuna_exr::{Frame, Part, Window};
use lacuna_filters::temporal::{Carried, Judge, explained, flow};
use lacuna_filters::variational::guided::Guides;
use lacuna_filters::{Mask, Plane, Planes, Size};

use super::blind::Blind;
use super::doubt::outdone;
use super::fit::{self, Shape, misfit};
use super::neighbours::FrameRef;
use super::paths::Paths;
use super::reference::{Reference, measured, placed};
use super::{Motion, Neighbour, Neighbours, camera, reading, vectors};
use crate::channels::part_label;
use crate::guides::Guide;
use crate::mask::Masks;

/// The part of the variance of a neighbour's samples that the frame must explain where motion carries them. Beyond a cut it is about 0.
const EXPLAINED: f64 = 0.5;

/// Samples of a neighbour by which its motion is judged at most.
const ASKED: usize = 1 << 14;

/// Some of a neighbour's samples, by which its motion is judged.
pub(super) struct Asked {
    samples: Planes,
    mask: Mask,
}

impl Asked {
    /// Nothing if the neighbour lacks some of these channels.
    pub(super) fn new(neighbour: &Neighbour, part: usize, names: &[String]) -> Option<Self> {
        let (samples, mask) = measured(neighbour, part, names)?;
        let every = mask.count().div_ceil(ASKED).max(1);
        let mut flags = mask.as_slice().to_vec();
        let measured = flags.iter_mut().filter(|flag| **flag).enumerate();
        measured.for_each(|(k, flag)| *flag = k % every == 0);
        Some(Self { mask: Mask::new(mask.size(), flags).ok()?, samples })
    }

    /// At these places of all pixels, in an image of that size.
    pub(super) fn at(&self, size: Size, places: &[[f32; 2]]) -> Carried {
        Carried::new(size, (&self.samples, &self.mask), 1, |at| places[at]).unwrap_or_default()
    }
}

/// Where the pixels of a neighbour lie, those that were measured in some channel.
struct Places {
    pixels: usize,
    known: Vec<(u32, [f32; 2])>,
}

impl Places {
    fn new(all: &[[f32; 2]], masks: &[&Mask]) -> Self {
        let measured = |at: &usize| masks.iter().any(|mask| mask.as_slice()[*at]);
        let mut known: Vec<_> = (0..all.len()).filter(measured).map(|at| (at as u32, all[at])).collect();
        known.shrink_to_fit();
        Self { pixels: all.len(), known }
    }

    /// Row and column of each pixel; NaN for those that were not measured.
    fn all(&self) -> Vec<[f32; 2]> {
        let mut all = vec![[f32::NAN; 2]; self.pixels];
        self.known.iter().for_each(|&(at, place)| all[at as usize] = place);
        all
    }
}

/// A neighbour's part whose samples have places.
pub struct Carrier<'a> {
    neighbour: &'a Neighbour,
    part: usize,
    /// The size of the frame, and where in it the neighbour begins.
    size: Size,
    corner: [i64; 2],
    places: Places,
    /// The same by motion that does not know the samples that judge, where it was estimated or measured along with them.
    judged: Option<Places>,
    /// What the motion is known from.
    pub how: String,
}

/// The guides of a part, and the channels that they are.
pub struct Guided<'a> {
    /// What they are in this frame.
    pub guides: &'a Guides,
    /// The channels, of one view or of all.
    pub found: Vec<&'a Guide>,
    /// The part that they guide.
    pub part: &'a Part,
}

impl Guided<'_> {
    /// What they are in another frame, at the pixels that were measured there; nothing if it does not have all of them.
    fn of(&self, carrier: &Carrier<'_>) -> Option<Vec<Plane>> {
        let Carrier { neighbour, part, .. } = *carrier;
        let other = &neighbour.frame.parts[part];
        let plane = |&at: &usize| {
            let name = self.part.channels[at].display_name();
            let at = other.channels.iter().position(|channel| channel.display_name() == name)?;
            Plane::new(other.size(), neighbour.floats(part, at)?).ok()
        };
        self.guides.alike(|name| {
            let guide = self.found.iter().find(|guide| guide.name == name)?;
            // Of another file or part nothing is kept.
            let is_own = !guide.second && guide.part == part;
            guide.channels.iter().filter(|_| is_own).map(plane).collect::<Option<Vec<_>>>()
        })
    }
}

/// The places of all pixels of a neighbour.
struct Found {
    places: Vec<[f32; 2]>,
    judged: Option<Vec<[f32; 2]>>,
    how: String,
    /// What is wrong with the cameras that would have told.
    broken: Option<String>,
}

impl Carrier<'_> {
    /// The frame's number.
    pub fn number(&self) -> i64 {
        self.neighbour.number
    }

    /// Row and column of each pixel of the neighbour; NaN for those that were not measured.
    pub fn places(&self) -> Vec<[f32; 2]> {
        self.places.all()
    }

    /// The samples of these channels, with guides where the neighbour has them; nothing if it has not all of the channels, with measured values.
    pub fn carried(&self, names: &[String], guides: Option<&Guided<'_>>) -> Option<Carried> {
        let (samples, mask) = measured(self.neighbour, self.part, names)?;
        let offset = self.neighbour.offset.clamp(i32::MIN.into(), i32::MAX.into()) as i32;
        let at = |places: &Places| {
            let places = places.all();
            let carried = Carried::new(self.size, (&samples, &*mask), offset, |at| places[at]).ok()?;
            Some(carried.at_corner(self.corner))
        };
        let carried = at(&self.places)?;
        let carried = match &self.judged {
            Some(judged) => carried.judged_by(at(judged)?),
            None => carried,
        };
        match guides.and_then(|guides| guides.of(self)) {
            Some(planes) => carried.guided(&planes).ok(),
            None => Some(carried),
        }
    }
}

impl Found {
    /// Refuses a neighbour beyond a cut, or of a motion that cannot be true: motion that is estimated from the frame itself bends anything
    /// towards it, which held-out pixels cannot tell.
    fn shows_the_same(self, asked: Option<&Asked>, reference: &Reference<'_>) -> Result<Self, String> {
        let Some(asked) = asked else { return Ok(self) };
        let carried = asked.at(reference.mask.size(), &self.places);
        if carried.is_empty() {
            return Err(format!("none of its samples lies in this frame (by {})", self.how));
        }
        if explained(&carried, &reference.filled) < EXPLAINED {
            return Err(format!(
                "it shows something else (by {} it does not agree with this frame)",
                self.how
            ));
        }
        Ok(self)
    }

    fn of<'a>(self, neighbour: &'a Neighbour, part: usize, reference: &Reference<'_>) -> Carrier<'a> {
        let Self { places, judged, how, .. } = self;
        let masks = neighbour.masks.different(part);
        let few = |all: Vec<[f32; 2]>| Places::new(&all, &masks);
        let (size, corner) = (reference.mask.size(), reference.corner(neighbour, part));
        Carrier { neighbour, part, size, corner, places: few(places), judged: judged.map(few), how }
    }
}

/// The neighbours' parts that fit a part of the frame, with places of their samples; and one line for each that does not.
pub fn carriers<'a>(
    (frame, masks, part): (&Frame, &Masks, usize),
    neighbours: &'a Neighbours,
    motion: Motion,
    reference: &Reference<'_>,
) -> (Vec<Carrier<'a>>, Vec<String>) {
    let (mut found, mut notes) = (Vec::new(), Vec::new());
    let misfit = |neighbour: &Neighbour| {
        let other = neighbour.frame.parts.get(part).map(Shape::from);
        misfit(&Shape::from(&frame.parts[part]), other.as_ref())
    };
    let fitting: Vec<&Neighbour> = neighbours.all.iter().filter(|one| misfit(one).is_none()).collect();
    let mut paths = if matches!(motion, Motion::Auto | Motion::Vectors) {
        paths((frame, masks, part), &fitting, reference)
    } else {
        [None, None]
    };
    let blind = LazyCell::new(|| Blind::new(reference, &fitting, part));
    let examined = (motion == Motion::Auto).then(|| outdone(&paths, &fitting, part, reference, &blind));
    let motion = if let Some(why) = examined.flatten() {
        notes.push(format!("{}{why}", in_part(frame, part, ": ")));
        paths = [None, None];
        Motion::Flow
    } else {
        motion
    };
    for neighbour in &neighbours.all {
        let made = if let Some(why) = misfit(neighbour) {
            Err(why)
        } else {
            let paths = paths[usize::from(neighbour.offset > 0)].as_ref();
            let asked = Asked::new(neighbour, part, &reference.names);
            carrier((frame, part), (neighbour, asked.as_ref()), (motion, paths), (reference, &blind))
                .and_then(|found| found.shows_the_same(asked.as_ref(), reference))
        };
        let label = in_part(frame, part, " of ");
        match made {
            Ok(made) => {
                let how = &made.how;
                let note =
                    |why| format!("along with {label}{} by {how}, not by camera: {why}", neighbour.label);
                notes.extend(made.broken.as_ref().map(note));
                found.push(made.of(neighbour, part, reference));
            }
            Err(why) => notes.push(format!("filled without {label}{}: {why}", neighbour.label)),
        }
    }
    (found, notes)
}

/// What a line says of a part, if the frame has several, before what else it says.
fn in_part(frame: &Frame, part: usize, then: &str) -> String {
    let label = part_label(frame, part);
    if label.is_empty() { label } else { label + then }
}

/// What vectors say of the neighbours before and of those after the frame.
fn paths(
    (frame, masks, part): (&Frame, &Masks, usize),
    neighbours: &[&Neighbour],
    reference: &Reference<'_>,
) -> [Option<Paths>; 2] {
    let mut chosen = reading::choose(neighbours, part, reference);
    std::array::from_fn(|later| {
        let side = neighbours.iter().filter(|one| usize::from(one.offset > 0) == later);
        let side = side.map(|one| (one.offset, one.source()));
        Some(Paths::new(
            [(0, FrameRef::whole(frame, masks))].into_iter().chain(side),
            (part, reference.window, reference.mask),
            chosen[later].take()?,
        ))
    })
}

fn carrier(
    (frame, part): (&Frame, usize),
    (neighbour, asked): (&Neighbour, Option<&Asked>),
    (motion, paths): (Motion, Option<&Paths>),
    (reference, blind): (&Reference<'_>, &dyn Deref<Target = Option<Blind>>),
) -> Result<Found, String> {
    let make =
        |places: Vec<[f32; 2]>, how: &str| Found { places, judged: None, how: how.into(), broken: None };
    if let Some(paths) = paths
        && let Some(places) = paths.places(neighbour.offset)
    {
        return Ok(Found { judged: paths.judged(neighbour.offset), ..make(places, &paths.name()) });
    }
    if motion == Motion::Vectors {
        return Err(vectors::why_none(neighbour, part).into());
    }
    if matches!(motion, Motion::Auto | Motion::Camera) {
        match camera::places((frame, part), neighbour) {
            Ok(all) => {
                let mut made: Vec<_> = all.into_iter().map(|places| make(places, "camera")).collect();
                let best = if made.len() > 1 { most_agreeing(&made, asked, reference) } else { 0 };
                return Ok(made.swap_remove(best));
            }
            Err(why) if motion == Motion::Camera => return Err(why),
            Err(_) => {}
        }
    }
    let broken = (motion == Motion::Auto).then(|| camera::broken((frame, part), neighbour)).flatten();
    if matches!(motion, Motion::Auto | Motion::Flow) {
        let (samples, mask) = measured(neighbour, part, &reference.names)
            .ok_or_else(|| lacking(neighbour, part, &reference.names))?;
        let blind = blind.as_ref().ok_or("this frame cannot be filled to estimate motion from")?;
        if motion == Motion::Flow || !blind.still {
            let filled =
                (reference.sharp)(&samples, &mask).ok_or("it cannot be filled to estimate motion from")?;
            let own = &neighbour.frame.parts[part];
            let found = flowed(&filled, (own.data_window, own.display_window), blind, reference);
            let found = found.map_err(|error| error.to_string())?;
            return Ok(Found { broken, ..found });
        }
    }
    Ok(Found {
        broken,
        ..make(still(neighbour.frame.parts[part].size(), reference.corner(neighbour, part)), "no motion")
    })
}

/// Which colours a neighbour lacks.
fn lacking(neighbour: &Neighbour, part: usize, names: &[String]) -> String {
    let own = &neighbour.frame.parts[part];
    let measured =
        |name: &str| vectors::channel(own, name).is_some_and(|at| neighbour.masks.get(part, at).is_some());
    let lacking: Vec<&str> = names.iter().map(String::as_str).filter(|name| !measured(name)).collect();
    format!("it has no measured {}", if lacking.is_empty() { "colours".into() } else { lacking.join(", ") })
}

/// Every pixel of an image of that size where it is, if the image begins there.
fn still(size: Size, corner: [i64; 2]) -> Vec<[f32; 2]> {
    let at = |at: usize, corner: i64| (at as i64 + corner) as f32;
    (0..size.pixels()).map(|k| [at(k / size.width, corner[0]), at(k % size.width, corner[1])]).collect()
}

/// Where estimated motion carries each pixel of a neighbour, `filled` in this window; and the same by what does not know the samples that judge, unless
/// the frame is complete.
fn flowed(
    filled: &Planes,
    (there, display): (Window, Window),
    blind: &Blind,
    reference: &Reference<'_>,
) -> Result<Found, lacuna_filters::Error> {
    let here = reference.window;
    let both = fit::around(here, there, display);
    let (filled, whole) = (placed(filled, there, both), placed(&blind.whole, here, both));
    let judged = if reference.mask.is_full() {
        None
    } else {
        Some(flow::estimate(&filled, &placed(&blind.filled, here, both))?)
    };
    let places = match &judged {
        Some(judged) => flow::refined(&filled, &whole, judged)?,
        None => flow::estimate(&filled, &whole)?,
    };
    // From the pixels of both to those of the neighbour, and to places in the frame.
    let corner = both.corner_of(here).map(|at| at as f32);
    let own = |all: Vec<[f32; 2]>| {
        let own = both.place(&all, there, [f32::NAN; 2]).into_iter();
        own.map(|[row, column]| [row - corner[0], column - corner[1]]).collect()
    };
    Ok(Found { places: own(places), judged: judged.map(own), how: "flow".into(), broken: None })
}

/// The one whose samples the frame agrees with most.
fn most_agreeing(all: &[Found], asked: Option<&Asked>, reference: &Reference<'_>) -> usize {
    let judge = Judge::new(&reference.filled, reference.mask);
    let of = |found: &Found| {
        asked.map_or(f64::INFINITY, |asked| judge.mean(&asked.at(reference.mask.size(), &found.places)))
    };
    let errors: Vec<f64> = all.iter().map(of).collect();
    (0..all.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b])).unwrap_or(0)
}
