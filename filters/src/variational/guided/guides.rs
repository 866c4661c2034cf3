//! Guides made comparable: groups of planes, each about its own mean and scaled by the spread of its group, and labels for hard borders.

use lacuna_core::parallel::prelude::*;

use super::PART;
use crate::complete::{Group, is_complete};
use crate::excerpt::Excerpt;
use crate::kernel::regress::Scales;
use crate::{Error, Mask, Plane, Size};

/// Standard deviation that every group is scaled to.
pub const SPREAD: f64 = 0.5;
/// Pixels that quantiles are taken from, about.
const PROBES: usize = 1 << 16;
/// Values that are looked at side by side.
const LANES: usize = 8;
/// The label of a pixel that has a guide which is not a number: nothing is known there.
pub const UNKNOWN: u32 = u32::MAX;

/// Complete planes that may tell how the image runs between its samples.
///
/// Values may be infinite (a depth without a surface); a pixel with a NaN in any plane is filled without guides.
///
/// Their order matters: they are tried one after the other. That of a file, which sorts its channels by name, gives the bits of the tool.
#[derive(Clone, Debug)]
pub struct Guides {
    size: Size,
    names: Vec<String>,
    groups: Vec<Vec<usize>>,
    /// Groups that are normals.
    normals: Vec<usize>,
    planes: Vec<Plane>,
    /// Which plane of its group each is, of all that were given, and how it was scaled.
    scaled: Vec<(usize, Scaling)>,
    /// What each plane has lost: scaled, its mean.
    centres: Vec<f32>,
    /// What zero became in each plane; NaN beside a constant that is not zero, as nothing is blank there.
    zeros: Vec<f32>,
    /// Of each group, where a plane is not a number, if one is.
    holes: Vec<Option<Vec<bool>>>,
    labels: Option<Vec<u32>>,
    label_names: Vec<String>,
    unknown: usize,
}

impl Guides {
    /// No guides yet.
    pub const fn new(size: Size) -> Self {
        Self {
            size,
            names: Vec::new(),
            groups: Vec::new(),
            normals: Vec::new(),
            planes: Vec::new(),
            scaled: Vec::new(),
            centres: Vec::new(),
            zeros: Vec::new(),
            holes: Vec::new(),
            labels: None,
            label_names: Vec::new(),
            unknown: 0,
        }
    }

    /// Adds planes that belong together (the components of a normal, say) and share a scale; each is taken about its mean, as moments of what
    /// is far from zero would lose their digits. Planes that are constant say nothing and are left out; returns whether any was taken.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`].
    pub fn add(&mut self, name: &str, planes: Vec<Plane>) -> Result<bool, Error> {
        if let Some(other) = planes.iter().find(|plane| plane.size() != self.size) {
            return Err(Error::size(self.size, &format!("guide '{name}'"), other.size()));
        }
        let normal = is_normal(&planes);
        let mut group = Vec::new();
        let mut held = false;
        let (mut variance, mut count) = (0.0, 0.0_f64);
        let mut holes = None;
        for plane in &planes {
            self.mark_unknown(plane, &mut holes);
        }
        let tamed = planes.into_par_iter().map(|mut plane| (tame(plane.pixels_mut()), plane));
        for (given, (moments, plane)) in tamed.into_iter().enumerate() {
            let Some(Tamed { limits, mean, square, zero }) = moments else {
                held |= plane.pixels().iter().any(|value| *value != 0.0 && !value.is_nan());
                continue;
            };
            variance += square;
            count += 1.0;
            group.push((self.planes.len(), mean, zero));
            self.scaled.push((given, Scaling { limits, mean, factor: 0.0 }));
            self.planes.push(plane);
        }
        if group.is_empty() {
            return Ok(false);
        }
        let factor = SPREAD / (variance / count).sqrt();
        for &(index, mean, zero) in &group {
            let scaling = &mut self.scaled[index].1;
            scaling.factor = factor;
            let parts = self.planes[index].pixels_mut().par_chunks_mut(PART);
            parts.for_each(|values| values.iter_mut().for_each(|value| *value = scaling.scale(*value)));
            self.centres.push((mean * factor) as f32);
            self.zeros.push(if held { f32::NAN } else { scaling.scale(zero) });
        }
        if normal && group.len() == 3 {
            self.normals.push(self.groups.len());
        }
        self.groups.push(group.into_iter().map(|(index, ..)| index).collect());
        self.holes.push(holes);
        self.names.push(name.into());
        Ok(true)
    }

    /// What these guides are in another frame, as planes of theirs: `of` gives all that belong to one, by its name, in the order in which
    /// they were added here. Nothing if some are not there.
    pub fn alike(&self, mut of: impl FnMut(&str) -> Option<Vec<Plane>>) -> Option<Vec<Plane>> {
        let mut alike = Vec::with_capacity(self.planes.len());
        for (name, group) in self.names.iter().zip(&self.groups) {
            let mut planes: Vec<_> = of(name)?.into_iter().map(Some).collect();
            for &index in group {
                let (given, scaling) = &self.scaled[index];
                let mut plane = planes.get_mut(*given)?.take()?;
                let parts = plane.pixels_mut().par_chunks_mut(PART);
                let scaled = |value: f32| scaling.scale(scaling.limits.tame(value));
                parts.for_each(|values| values.iter_mut().for_each(|value| *value = scaled(*value)));
                alike.push(plane);
            }
        }
        Some(alike)
    }

    /// Adds labels: pixels with different ones are on different surfaces. One label everywhere says nothing and is left
    /// out; returns whether they were taken.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`].
    pub fn add_labels(&mut self, name: &str, labels: &[u32]) -> Result<bool, Error> {
        if labels.len() != self.size.pixels() {
            return Err(Error::SizeMismatch {
                expected: self.size,
                found: format!("guide '{name}' of {} labels", labels.len()),
            });
        }
        if labels.iter().all(|label| *label == labels[0]) {
            return Ok(false);
        }
        let own = self.labels.get_or_insert_with(|| vec![0; labels.len()]);
        own.par_chunks_mut(PART).zip(labels.par_chunks(PART)).for_each(|(own, labels)| {
            for (own, &label) in own.iter_mut().zip(labels).filter(|(own, _)| **own != UNKNOWN) {
                // Mixed, so that several sets of labels tell all their pairs apart.
                let mixed =
                    (u64::from(*own).rotate_left(17) ^ u64::from(label)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                *own = (mixed >> 33) as u32;
            }
        });
        self.label_names.push(name.into());
        Ok(true)
    }

    /// Whether they say nothing at all.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty() && self.label_names.is_empty()
    }

    /// Height and width.
    pub const fn size(&self) -> Size {
        self.size
    }

    /// Pixels that are filled without guides because one of theirs is not a number.
    pub const fn unknown(&self) -> usize {
        self.unknown
    }

    /// The first guide that holds nothing at the pixels that a mask calls missing ([`crate::complete`]), if there is one. Labels are looked at together.
    pub(crate) fn sparse(&self, mask: &Mask) -> Option<&str> {
        let group = |group: usize| (&self.names[group], Held { guides: self, group: Some(group) });
        let labels = self.label_names.first().map(|name| (name, Held { guides: self, group: None }));
        let mut all = (0..self.groups.len()).map(group).chain(labels);
        all.find(|(_, held)| !is_complete(held, mask)).map(|(name, _)| name.as_str())
    }

    /// The names of the guides that have a weight or a slope, and of the labels.
    pub(super) fn counting(&self, scales: &Scales) -> Vec<String> {
        let counts = |(_, group): &(&String, &Vec<usize>)| {
            group.iter().any(|&guide| scales.slopes[guide] || scales.bandwidths[guide] > 0.0)
        };
        let values = self.names.iter().zip(&self.groups).filter(counts).map(|(name, _)| name.clone());
        values.chain(self.label_names.iter().cloned()).collect()
    }

    /// The names of all of them.
    pub(crate) fn all_names(&self) -> impl Iterator<Item = &String> {
        self.names.iter().chain(&self.label_names)
    }

    pub(crate) fn planes(&self) -> &[Plane] {
        &self.planes
    }

    /// What is to be added to each plane for the guide itself, scaled.
    pub(crate) fn centres(&self) -> &[f32] {
        &self.centres
    }

    /// The guides that have planes; labels have none.
    pub(crate) fn names(&self) -> &[String] {
        &self.names
    }

    /// Sets the shares of pixels to zero of whose guides one is not a number.
    pub(crate) fn forget_unknown(&self, share: &mut Plane) {
        let labels = self.labels.iter().flatten();
        let unknown = share.pixels_mut().iter_mut().zip(labels).filter(|(_, label)| **label == UNKNOWN);
        unknown.for_each(|(share, _)| *share = 0.0);
    }

    /// The pixels of whose guides one is not a number.
    pub(crate) fn unknown_pixels(&self) -> impl Iterator<Item = usize> {
        let labels = self.labels.iter().flatten().enumerate();
        labels.filter(|(_, label)| **label == UNKNOWN).map(|(pixel, _)| pixel)
    }

    /// The same guides of smaller pixels, by the map that makes a plane of them. Labels are left out: a mean has none.
    pub(crate) fn reduced(&self, size: Size, map: impl Fn(&Plane) -> Plane) -> Self {
        Self {
            size,
            names: self.names.clone(),
            groups: self.groups.clone(),
            normals: self.normals.clone(),
            planes: self.planes.iter().map(map).collect(),
            scaled: self.scaled.clone(),
            centres: self.centres.clone(),
            zeros: self.zeros.clone(),
            holes: vec![None; self.groups.len()],
            labels: None,
            label_names: Vec::new(),
            unknown: self.unknown,
        }
    }

    /// The same guides in an excerpt of their image.
    pub(crate) fn within(&self, excerpt: &Excerpt) -> Self {
        let mut own = self.reduced(excerpt.mask.size(), |plane| excerpt.plane(plane));
        let sources = 0..excerpt.mask.size().pixels();
        own.labels = self.labels.as_ref().map(|all| sources.map(|at| all[excerpt.source(at)]).collect());
        own.label_names.clone_from(&self.label_names);
        own
    }

    /// The planes of each normal.
    pub(crate) fn normals(&self) -> impl Iterator<Item = &[usize]> {
        self.normals.iter().map(|&group| self.groups[group].as_slice())
    }

    pub(super) fn groups(&self) -> &[Vec<usize>] {
        &self.groups
    }

    pub(crate) fn labels(&self) -> Option<&[u32]> {
        self.labels.as_deref()
    }

    fn mark_unknown(&mut self, plane: &Plane, holes: &mut Option<Vec<bool>>) {
        if plane.pixels().iter().any(|value| value.is_nan()) {
            let labels = self.labels.get_or_insert_with(|| vec![0; self.size.pixels()]);
            let holes = holes.get_or_insert_with(|| vec![false; labels.len()]);
            let pixels = labels.iter_mut().zip(holes).zip(plane.pixels());
            for ((label, hole), _) in pixels.filter(|(_, value)| value.is_nan()) {
                self.unknown += usize::from(*label != UNKNOWN);
                (*label, *hole) = (UNKNOWN, true);
            }
        }
    }
}

/// A group of planes of guides, or the labels.
struct Held<'a> {
    guides: &'a Guides,
    group: Option<usize>,
}

impl Group for Held<'_> {
    fn is_blank(&self, at: usize) -> bool {
        let Guides { planes, zeros, holes, groups, labels, .. } = self.guides;
        let Some(group) = self.group else { return labels.as_ref().is_some_and(|labels| labels[at] == 0) };
        groups[group].iter().all(|&plane| planes[plane].pixels()[at] == zeros[plane])
            || holes[group].as_ref().is_some_and(|holes| holes[at])
    }

    fn are_same(&self, one: usize, other: usize) -> bool {
        let Guides { planes, groups, labels, .. } = self.guides;
        let Some(group) = self.group else {
            return labels.as_ref().is_some_and(|labels| labels[one] == labels[other]);
        };
        groups[group].iter().all(|&plane| planes[plane].pixels()[one] == planes[plane].pixels()[other])
    }
}

/// Three planes of values from -1 to 1, some of them negative, which no colour has.
fn is_normal(planes: &[Plane]) -> bool {
    let all = || planes.iter().flat_map(Plane::pixels).filter(|value| !value.is_nan());
    planes.len() == 3 && all().all(|value| value.abs() <= 1.001) && all().any(|value| *value < 0.0)
}

/// Where far outliers are brought, and what is not finite.
#[derive(Clone, Copy, Debug)]
struct Limits {
    /// In place of what is not a number.
    low: f32,
    floor: f32,
    top: f32,
    /// In place of what is infinite.
    beyond: f32,
}

impl Limits {
    fn tame(self, value: f32) -> f32 {
        if value.is_nan() {
            self.low
        } else if value == f32::INFINITY {
            self.beyond
        } else {
            value.clamp(self.floor, self.top)
        }
    }
}

/// From the tamed values of a plane to what it holds.
#[derive(Clone, Copy, Debug)]
struct Scaling {
    limits: Limits,
    mean: f64,
    factor: f64,
}

impl Scaling {
    fn scale(self, value: f32) -> f32 {
        ((f64::from(value) - self.mean) * self.factor) as f32
    }
}

/// What tamed values were brought to, their mean, their variance, and what zero became.
struct Tamed {
    limits: Limits,
    mean: f64,
    square: f64,
    zero: f32,
}

/// Brings far outliers near and replaces what is not finite; nothing if the plane is constant.
///
/// The ends of the range, which backgrounds have, do not count for the quantiles, and land apart from the rest.
fn tame(values: &mut [f32]) -> Option<Tamed> {
    let parts = values.par_chunks(PART).map(|values| {
        let (mut least, mut most) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
        let mut infinite = false;
        for values in values.chunks(LANES) {
            for ((least, most), &value) in least.iter_mut().zip(&mut most).zip(values) {
                // What is not finite is no end.
                *least = least.min(if value.is_finite() { value } else { f32::INFINITY });
                *most = most.max(if value.is_finite() { value } else { f32::NEG_INFINITY });
                infinite |= value.is_infinite();
            }
        }
        (least, most, infinite)
    });
    let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
    let infinite = parts.iter().any(|part| part.2);
    for (low, high, _) in parts {
        least = low.into_iter().fold(least, f32::min);
        most = high.into_iter().fold(most, f32::max);
    }
    if least > most || (least == most && !infinite) {
        return None;
    }
    let step = values.len().div_ceil(PROBES);
    let mut probes: Vec<f32> =
        values.iter().step_by(step).copied().filter(|v| v.is_finite() && *v > least && *v < most).collect();
    probes.sort_unstable_by(f32::total_cmp);
    let (low, high) = match probes.len() {
        0 => (least, most),
        count => apart(&probes, (probes[count / 50], probes[count - 1 - count / 50]), (least, most)),
    };
    let width = (high - low).max(f32::MIN_POSITIVE);
    let room = if probes.is_empty() { 0.0 } else { width };
    let (floor, top) = ((low - room).max(f32::MIN), (high + room).min(f32::MAX));
    let beyond = if probes.is_empty() && least == most { least + 1.0_f32.max(least.abs()) } else { top };
    let limits = Limits { low, floor, top: top.max(beyond), beyond };
    let sums = values.par_chunks_mut(PART).map(|values| {
        for value in values.iter_mut() {
            *value = limits.tame(*value);
        }
        sum(values, |value| value)
    });
    let count = values.len() as f64;
    let mean = sums.into_iter().sum::<f64>() / count;
    let squares = values.par_chunks(PART).map(|values| sum(values, |value| (value - mean).powi(2)));
    let variance = squares.into_iter().sum::<f64>() / count;
    let zero = limits.tame(0.0);
    (variance > 0.0 && variance.is_finite()).then_some(Tamed { limits, mean, square: variance, zero })
}

/// Quantiles, which where they are one value (a surface beside two others) give way by the distance to the nearest other one.
fn apart(probes: &[f32], (low, high): (f32, f32), (least, most): (f32, f32)) -> (f32, f32) {
    if low < high {
        return (low, high);
    }
    let below = probes[..probes.partition_point(|probe| *probe < low)].last().map_or(least, |probe| *probe);
    let above = probes.get(probes.partition_point(|probe| *probe <= high)).map_or(most, |probe| *probe);
    let distance = (low - below).min(above - high);
    ((low - distance).max(least), (high + distance).min(most))
}

/// The sum of what `of` makes of the values, in lanes.
fn sum(values: &[f32], of: impl Fn(f64) -> f64) -> f64 {
    let mut sums = [0.0; LANES];
    for values in values.chunks(LANES) {
        for (sum, &value) in sums.iter_mut().zip(values) {
            *sum += of(f64::from(value));
        }
    }
    sums.into_iter().sum()
}
