//! One frame in, a larger frame out; pure.
//!
//! ```text
//! part ──> fill (missing pixels by the rules) ──> each channel by its rule onto the larger grid ──> windows, types, stamp
//! ```
//!
//! Colour, alpha and positions are reconstructed by the method; normals too, and made unit length again; depths,
//! identifiers and everything that is kept (the sampling mask as well) take the bits of the pixel that they lie in, so
//! that no value appears that was not there; motion in pixels is scaled. A second frame of the larger size may hold guides, and
//! what need not be enlarged. Values that are not finite count as missing. With total variation what was
//! missing does not bind the result: filling and enlarging are one problem.

mod channels;
mod target;
mod windows;

use std::sync::Arc;

use half::f16;
use lacuna_exr::{Channel, Frame, Part, Samples, Window};
use lacuna_filters::Run;
use lacuna_filters::domain::Domain;
use lacuna_filters::enlarge;
use lacuna_filters::upscale::guided::FEWEST;
use lacuna_filters::upscale::{Geometry, Method, Sampling};
use lacuna_filters::variational::guided::Guides;
pub use target::Target;
pub use windows::Windows;

use super::groups::usable;
use super::part::{self, Done};
use super::{
    Beside, Error, Job, Kind, Plans, Report, Stamp, drop_derived, estimate, finish, mask_name,
    nothing_dropped, prefixed, stamp,
};
use crate::channels::{Choice, DecidedBy, Rule, channel_label, part_label, unheeded};
use crate::guides::{self, Asked, Guide, Second};
use crate::mask::Masks;
use crate::temporal;

/// How frames are enlarged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Enlarge {
    /// By how much, or to what size.
    pub target: Target,
    /// How.
    pub method: Method,
    /// The model of a low-resolution pixel; unless given, what the frame's attributes say.
    pub sampling: Option<Sampling>,
    /// Whether what is no light comes from the guides' file, where that has it.
    pub take_guides: bool,
    /// Whether motion vectors keep their numbers, and are not of the larger frame's pixels.
    pub keep_vectors: bool,
}

impl Enlarge {
    /// The name that `--filter` takes.
    pub const fn name(&self) -> &'static str {
        match &self.method {
            Method::Tv(_) => "tv",
            Method::Plain(kernel) => kernel.name(),
            _ => "ss",
        }
    }

    /// The model of a part's pixels, and whether its attributes decided it.
    fn model(&self, part: &Part) -> (Sampling, bool) {
        match self.sampling {
            Some(sampling) => (sampling, false),
            None if has_one_ray(part) && !matches!(self.method, Method::Plain(_)) => (Sampling::Point, true),
            None => (Sampling::default(), false),
        }
    }

    /// The same where light is reconstructed in a domain, or why it cannot be.
    fn model_in(&self, part: &Part, domain: Domain) -> Result<(Sampling, bool), String> {
        let (sampling, is_known) = self.model(part);
        let has_model = !matches!(self.method, Method::Plain(_));
        if domain == Domain::Log && has_model && !sampling.is_pointwise() {
            return Err(logarithms_of(sampling));
        }
        Ok((sampling, is_known))
    }

    /// Everything that changes the result, `name=value` separated by spaces.
    pub fn settings(&self) -> String {
        let sampling = self.sampling.map_or_else(|| "auto".into(), |sampling| sampling.to_string());
        let mut line = format!("upscale={} {} sampling={sampling}", self.name(), self.target);
        line += if self.take_guides { " take-guides=on" } else { "" };
        line += if self.keep_vectors { " vectors=keep" } else { " vectors=scale" };
        match self.method {
            Method::Tv(settings) => format!("{line} {}", lacuna_filters::Method::from(settings).settings()),
            _ => line,
        }
    }
}

/// Whether `lacuna render` made the part with one ray a pixel. Other tools keep the attribute in frames that they resize.
fn has_one_ray(part: &Part) -> bool {
    let scene = part.attributes.text(stamp::SCENE);
    let scene = scene.and_then(|text| serde_json::from_str::<serde_json::Value>(&text).ok());
    let size = part.display_window.size();
    scene.is_some_and(|scene| {
        let image = &scene["image"];
        image["samples"] == 1 && image["size"] == serde_json::json!([size.width, size.height])
    })
}

/// Why logarithms of pixels that are means are refused.
pub fn logarithms_of(sampling: Sampling) -> String {
    format!("--domain log has other means than light: it is for --sampling point and grid, not {sampling}")
}

/// Fills and enlarges a frame; guides come from a frame of the larger size.
pub fn enlarge(
    mut frame: Frame,
    masks: &Masks,
    choices: &[Vec<Choice>],
    Beside { guides: second, sources, .. }: Beside<'_>,
    (job, asked): (&Job, &Enlarge),
    plans: &Plans,
    run: &Run<'_>,
) -> Result<(Frame, Report), Error> {
    let stamp = Stamp::new(job, &masks.origin, sources);
    let mut notes =
        [masks.notes.clone(), unheeded(&frame, &masks.mask_channels, &job.overrides, choices)].concat();
    notes.extend(nothing_dropped(masks, job));
    let mut report = Report::new(&stamp, masks.density(), notes);
    let (finite, lost) = finite(&frame, masks, choices)?;
    let second = second.map(Second::new);
    let known = Known { masks, second: second.as_ref(), asked, stamp: &stamp, plans, run };
    report.notes.extend(second.as_ref().and_then(|second| takes_none(&frame, choices, second, asked)));
    for (index, (choices, lost)) in choices.iter().zip(&lost).enumerate() {
        let done = part(&mut frame, (index, choices.clone()), (&finite, lost), job, &known)?;
        let label = part_label(&frame, index);
        report.notes.extend(prefixed(&label, done.notes));
        report.remarks.extend(prefixed(&label, done.remarks));
        report.parts.push(done.report);
    }
    report.total();
    Ok((frame, report))
}

/// What the parts of a frame have in common.
struct Known<'a> {
    masks: &'a Masks,
    /// A frame of the larger size that guides come from.
    second: Option<&'a Second<'a>>,
    asked: &'a Enlarge,
    stamp: &'a Stamp,
    plans: &'a Plans,
    run: &'a Run<'a>,
}

/// Fills and enlarges a part; `finite` are masks of its finite samples, of which `lost` a channel are none.
fn part(
    frame: &mut Frame,
    (index, mut choices): (usize, Vec<Choice>),
    (finite, lost): (&Masks, &[usize]),
    job: &Job,
    known: &Known<'_>,
) -> Result<Done, Error> {
    let Known { second, asked, plans, run, .. } = *known;
    let label = part_label(frame, index);
    let refused = |why: String| Error::Enlarge {
        part: if label.is_empty() { String::new() } else { format!("{label}: ") },
        why,
    };
    let windows = Windows::of(&frame.parts[index], &asked.target).map_err(refused)?;
    let kinds: Vec<_> = frame.parts[index].channels.iter().map(|channel| channel.samples.kind()).collect();
    let part = &frame.parts[index];
    let (sampling, is_known) = asked.model_in(part, job.domain).map_err(refused)?;
    windows.check(sampling).map_err(refused)?;
    let geometry = windows.geometry(sampling);
    let mut notes = Vec::new();
    let found = match second.filter(|_| *job.wanted() != Asked::None) {
        Some(second) if choices.iter().any(|choice| choice.rule == Rule::Fill) => {
            guides::of_larger(part, windows.data, second, job.wanted(), &mut notes)?
        }
        _ => Vec::new(),
    };
    notes.extend(idle(&found, geometry));
    let high = guides::collect(&found, frame, second.map(|second| second.frame), geometry.high());
    let high = high.map_err(|source| Error::Filter { channel: label.clone(), source })?;
    let mut taken = vec![None; choices.len()];
    let taking = second.filter(|_| asked.take_guides);
    if let Some(second) = taking {
        taken = take((part, index), windows.data, second, &mut choices, &mut notes)?;
    }
    let choices = choices.as_slice();
    let mut done = low(frame, (index, finite, choices), (&high, geometry), job, plans, run)?;
    done.notes.extend(notes);
    tell_taken(&frame.parts[index], &taken, &mut done);
    for (channel, lost) in done.report.channels.iter_mut().zip(lost) {
        channel.non_finite += lost;
    }
    done.notes.extend(done.report.non_finite());
    let high = [(None, high)];
    let work = part::Work::alone((index, finite, choices), &high, job, plans, run);
    let before = done.report.groups.len();
    channels::enlarge(frame, (&work, &kinds), (geometry, asked.method), taken, &mut done)?;
    let why = format!("--sampling {sampling}, as the frame was rendered with one ray a pixel");
    for group in done.report.groups.iter_mut().skip(before).filter(|_| is_known) {
        group.settled.push(why.clone());
    }
    let part = &mut frame.parts[index];
    vectors(part, (geometry, asked.keep_vectors), choices, &mut done);
    describe(part, (index, windows), job, known, &mut done);
    Ok(done)
}

/// Gives a part its larger windows, a full mask where the small one was, and attributes that say how it was made.
fn describe(
    part: &mut Part,
    (index, windows): (usize, Windows),
    job: &Job,
    known: &Known<'_>,
    done: &mut Done,
) {
    let Known { masks, stamp, .. } = *known;
    (part.data_window, part.display_window) = (windows.data, windows.display);
    if masks.channels[index].iter().flatten().all(|mask| mask.is_full()) {
        masks.mask_channels[index].iter().for_each(|&at| call_measured(&mut part.channels[at].samples));
    }
    let mask = mask_name(part, masks, index);
    let (notes, _) = finish(part, masks, index, job);
    done.notes.extend(notes);
    done.notes.extend(drop_derived(part));
    stamp.with_mask(mask).sign(&mut part.attributes, masks.part_density(index), &done.report);
    // What is known of the small frame's missing pixels is not known of the large one.
    for name in [estimate::ATTRIBUTE, temporal::ATTRIBUTE] {
        part.attributes.remove(name);
    }
}

/// A mask of 1 throughout: the frame was complete, or was taken as complete, and so is the larger one.
fn call_measured(mask: &mut Samples) {
    match mask {
        Samples::Half(values) => values.fill(f16::ONE),
        Samples::Float(values) => values.fill(1.0),
        Samples::Uint(values) => values.fill(1),
    }
}

/// Fills the part on its own grid, with floats in place of halves where something is missing, so that nothing is rounded twice.
fn low(
    frame: &mut Frame,
    (index, masks, choices): (usize, &Masks, &[Choice]),
    (high, geometry): (&Guides, Geometry),
    job: &Job,
    plans: &Plans,
    run: &Run<'_>,
) -> Result<Done, Error> {
    let missing = masks.channels[index].iter().flatten().any(|mask| !mask.is_full());
    let job = Job { kind: missing.then_some(Kind::Float), enlarge: None, ..job.clone() };
    let mut guides = Guides::new(frame.parts[index].size());
    if missing && !high.is_empty() {
        let smaller = enlarge::smaller_guides(high, &enlarge::Options::new(geometry), plans);
        let label = || part_label(frame, index);
        guides = smaller.map_err(|source| Error::Filter { channel: label(), source })?;
    }
    let guides = [(None, guides)];
    let work = part::Work::alone((index, masks, choices), &guides, &job, plans, run);
    part::fill(frame, &work)
}

/// The masks without the pixels whose value a rule cannot use, and how many these are for each channel.
fn finite(frame: &Frame, masks: &Masks, choices: &[Vec<Choice>]) -> Result<(Masks, Vec<Vec<usize>>), Error> {
    let mut finite = masks.clone();
    let mut lost = Vec::with_capacity(choices.len());
    for (index, choices) in choices.iter().enumerate() {
        let mut counts = vec![0; choices.len()];
        for (channel, choice) in choices.iter().enumerate() {
            let Some(mask) = masks.get(index, channel) else { continue };
            let content = &frame.parts[index].channels[channel];
            let usable = usable(choice.rule, &content.samples, mask)?;
            if Arc::ptr_eq(&usable, mask) {
                continue;
            }
            if usable.is_empty() {
                let name = content.display_name().into_owned();
                return Err(Error::NothingFinite { channel: channel_label(frame, index, channel), name });
            }
            counts[channel] = mask.count() - usable.count();
            let known = finite.channels[index][..channel].iter().flatten().find(|other| ***other == *usable);
            let shared = known.cloned().unwrap_or(usable);
            finite.channels[index][channel] = Some(shared);
        }
        lost.push(counts);
    }
    Ok((finite, lost))
}

/// Why guides that were found steer nothing.
fn idle(found: &[Guide], geometry: Geometry) -> Option<String> {
    let (first, low) = (found.first()?, geometry.low());
    if found.iter().all(|guide| guide.kind == guides::Kind::Labels) {
        return Some(format!(
            "{}: identifiers steer nothing where frames are enlarged: give normals, depth, albedo or alpha",
            first.name
        ));
    }
    (low.height.min(low.width) < FEWEST).then(|| {
        format!("enlarged without guides: {low} pixels say too little of them, below {FEWEST} along a side")
    })
}

/// That the second frame has nothing to take for any part.
fn takes_none(
    frame: &Frame,
    choices: &[Vec<Choice>],
    second: &Second<'_>,
    asked: &Enlarge,
) -> Option<String> {
    let has_none = |(part, choices): (&Part, &Vec<Choice>)| {
        let mut channels = part.channels.iter().zip(choices);
        channels.all(|(channel, choice)| named(part, channel, choice, second.frame).is_empty())
    };
    (asked.take_guides && frame.parts.iter().zip(choices).all(has_none))
        .then(|| "--take-guides: the guides' file has no channel of this frame but light".into())
}

/// Where a second frame has a channel that is no light: in which parts, at which place.
fn named(part: &Part, channel: &Channel, choice: &Choice, second: &Frame) -> Vec<(usize, usize)> {
    let is_mask = choice.by == DecidedBy::SamplingMask || channel.name == b"mask";
    if is_mask || (choice.rule == Rule::Fill && crate::channels::is_light(&channel.display_name())) {
        return Vec::new();
    }
    let parts = &second.parts;
    let seen = parts.iter().enumerate().filter(|(_, other)| parts.len() == 1 || other.view() == part.view());
    let place = |other: &Part| other.channels.iter().position(|own| own.name == channel.name);
    seen.filter_map(|(at, other)| Some((at, place(other)?))).collect()
}

/// The channels of the second frame, over the larger window, that stand for those of the part which are no light; they are kept.
fn take(
    (part, index): (&Part, usize),
    window: Window,
    second: &Second<'_>,
    choices: &mut [Choice],
    notes: &mut Vec<String>,
) -> Result<Vec<Option<Samples>>, Error> {
    let parts = &second.frame.parts;
    let [mut sparse, mut other, mut doubtful] = [const { Vec::new() }; 3];
    let mut one = |channel: &Channel, choice: &mut Choice| {
        let named = named(part, channel, choice, second.frame);
        let strange = |at: usize| parts[at].name() != part.name();
        let rank = |&&(at, _): &&(usize, usize)| (parts[at].data_window != window, strange(at), at != index);
        let &(at, found) = named.iter().min_by_key(rank)?;
        let label = part_label(second.frame, at);
        let name = channel.display_name();
        let name = if label.is_empty() { name.into_owned() } else { format!("{name} of {label}") };
        if parts[at].data_window != window {
            other.push(name);
            return None;
        }
        if !second.is_complete(at, found) {
            sparse.push(name);
            return None;
        }
        if named.len() > 1 && strange(at) {
            doubtful.push(name);
        }
        choice.complete(true);
        Some(parts[at].channels[found].samples.clone())
    };
    let taken = part.channels.iter().zip(choices).map(|(channel, choice)| one(channel, choice)).collect();
    if !other.is_empty() && parts.iter().all(|part| part.data_window != window) {
        return Err(guides::of_other_pixels(part, window).into());
    }
    for (names, what) in [
        (sparse, "sparse in the guides' file, and enlarged"),
        (other, "of other pixels in the guides' file, and enlarged"),
        (doubtful, "taken, though other parts of the guides' file have that name, too"),
    ] {
        if !names.is_empty() {
            notes.push(format!("--take-guides: {}: {what}", names.join(", ")));
        }
    }
    Ok(taken)
}

/// Says which channels were taken.
fn tell_taken(part: &Part, taken: &[Option<Samples>], done: &mut Done) {
    let names = part.channels.iter().zip(taken).filter(|(_, taken)| taken.is_some());
    let names: Vec<_> = names.map(|(channel, _)| channel.display_name().into_owned()).collect();
    if !names.is_empty() {
        let names = names.join(", ");
        done.remarks.push(format!("taken from the guides' file as they are there: {names}"));
    }
}

/// Scales motion in pixels to the larger frame's, and says so.
fn vectors(part: &mut Part, (geometry, keep): (Geometry, bool), choices: &[Choice], done: &mut Done) {
    let factors = [geometry.horizontal.scale, geometry.vertical.scale];
    let made = |at: &usize| choices[*at].rule != Rule::Keep;
    let axes: Vec<(usize, usize)> = (0..part.channels.len())
        .filter(made)
        .filter_map(|at| Some((at, crate::channels::motion_axis(part, at)?)))
        .collect();
    let names: Vec<_> = axes.iter().map(|(at, _)| part.channels[*at].display_name().into_owned()).collect();
    let names = names.join(", ");
    if axes.is_empty() {
        return;
    }
    if keep {
        done.remarks.push(format!("{names}: kept as numbers (--vectors keep)"));
        return;
    }
    let mut clamped = 0;
    // What was infinite stays so.
    let mut scaled = |value: f64, factor: f64, most: f64| {
        let product = value * factor;
        let beyond = value.is_finite() && product.abs() > most;
        clamped += usize::from(beyond);
        if beyond { most.copysign(product) } else { product }
    };
    for (at, axis) in axes {
        let factor = factors[axis];
        match &mut part.channels[at].samples {
            Samples::Half(values) => values.iter_mut().for_each(|value| {
                *value = half::f16::from_f64(scaled(value.to_f64(), factor, half::f16::MAX.to_f64()));
            }),
            Samples::Float(values) => values.iter_mut().for_each(|value| {
                *value = scaled(f64::from(*value), factor, f64::from(f32::MAX)) as f32;
            }),
            Samples::Uint(_) => {}
        }
    }
    let [x, y] = factors;
    let past = if clamped > 0 {
        format!("; {clamped} values past the largest of their type were clamped to it")
    } else {
        String::new()
    };
    done.notes.push(format!(
        "{names}: motion in pixels, by its name, times {x:.4} across and {y:.4} down (--vectors keep leaves it){past}"
    ));
}

impl Windows {
    /// Whether the model of a pixel goes with these sizes.
    fn check(&self, sampling: Sampling) -> Result<(), String> {
        let [x, y] = [self.horizontal, self.vertical].map(|axis| (axis.scale, axis.check(sampling).is_ok()));
        if sampling != Sampling::Grid || (x.1 && y.1) {
            return Ok(());
        }
        Err(format!(
            "--sampling grid needs whole factors, such as --scale 2, and not {:.4} x {:.4}; --sampling point takes broken ones",
            x.0, y.0
        ))
    }

    /// Where the pixels lie.
    fn geometry(&self, sampling: Sampling) -> Geometry {
        Geometry { vertical: self.vertical, horizontal: self.horizontal, sampling }
    }
}
