//! What filled normals, coordinates and smoothed colours have to be beside smooth: of unit length, on surfaces, black where nothing is.

use std::sync::Arc;

use lacuna_exr::{Frame, Part};
use lacuna_filters::Mask;

use super::{Done, Filled, Work};
use crate::channels::{self, DecidedBy, Name, Rule, channel_label};
use crate::guides::Asked;
use crate::reconstruct::normals::{self, Lengths};
use crate::reconstruct::{Error, surfaces};

/// Gives every whole normal the length that the measured ones around it have.
pub fn unit_normals(
    frame: &Frame,
    work: &Work<'_>,
    filled: &mut [Filled],
    done: &mut Done,
) -> Result<(), Error> {
    let part = &frame.parts[work.index];
    for channel in 0..part.channels.len() {
        let Some(triple) = channels::normal_triple(part, work.choices, channel) else { continue };
        let at = |wanted: usize| filled.iter().position(|filled| filled.channel == wanted);
        let (Some(x), Some(y), Some(z)) = (at(triple[0]), at(triple[1]), at(triple[2])) else { continue };
        if triple.iter().min() != Some(&channel) || filled[x].copied {
            continue;
        }
        let fail = |source| Error::Filter { channel: channel_label(frame, work.index, channel), source };
        let masks = [x, y, z].map(|at| Arc::clone(&filled[at].mask));
        // Components that were smoothed apart are no vector that could be scaled.
        let smoothed = [x, y, z].iter().all(|&at| filled[at].all);
        let all = normals::kept(&masks, !smoothed);
        let Some(both) = normals::both(&masks) else {
            let name = part.channels[channel].display_name();
            done.notes.push(format!("channel {name}: no pixel has all of a normal, so none is scaled"));
            continue;
        };
        let Some(lengths) = normals::lengths([x, y, z].map(|at| filled[at].samples.as_slice()), &both) else {
            let name = part.channels[channel].display_name();
            done.notes
                .push(format!("channel {name}: measured normals are not of unit length, so none is scaled"));
            continue;
        };
        let Ok([a, b, c]) = filled.get_disjoint_mut([x, y, z]) else { continue };
        let nearest = work.plans.nearest(&both).map_err(fail)?;
        let samples = [a.samples.as_slice(), &b.samples, &c.samples];
        let around = match lengths {
            Lengths::Unit => None,
            Lengths::Mixed => Some(work.plans.depth(&both).map_err(fail)?),
        };
        // Which pixels have a normal at all makes most of the error then, and is decided here, not by the filter that was estimated.
        let has_none = |(at, &flag): (usize, &bool)| flag && samples.iter().all(|samples| samples[at] == 0.0);
        if around.is_some() || both.as_slice().iter().enumerate().any(has_none) {
            done.report.estimate_none(channel);
        }
        let nearest = nearest.as_slice();
        let allowed = |at: usize| match &around {
            None => normals::unit_range(samples, nearest[at] as usize),
            Some(around) => normals::range(samples, around.around(at)),
        };
        normals::scale(
            [&mut a.values, &mut b.values, &mut c.values],
            samples,
            &all,
            nearest,
            (lengths, allowed),
        );
    }
    Ok(())
}

/// An alpha, which tells where its layer is empty.
struct Alpha {
    layer: String,
    values: Vec<f32>,
    /// Whether it counts for channels that were not smoothed.
    known: bool,
}

/// Measured pixels without alpha, all black, that show that a layer has no light without alpha.
pub const EMPTY: usize = 16;

/// Whether pixels without alpha, at least so many, are all black; each is given by its alpha and its light.
pub fn is_black_where_empty<'a>(
    pixels: impl Iterator<Item = (&'a f32, &'a f32)> + Clone,
    least: usize,
) -> bool {
    let mut empty = pixels.filter(|(alpha, _)| **alpha == 0.0);
    empty.clone().take(least).count() == least && empty.all(|(_, light)| *light == 0.0)
}

/// Makes light 0 where the alpha of its layer is, and all smoothed channels, as smoothing takes light over an edge that alpha, which is not smoothed,
/// keeps. Not where a measured pixel has light without alpha.
pub fn empty_stays_black(frame: &Frame, work: &Work<'_>, filled: &mut [Filled]) {
    let part = &frame.parts[work.index];
    let names: Vec<_> = part.channels.iter().map(lacuna_exr::Channel::display_name).collect();
    let smoothed = filled.iter().any(|filled| filled.all);
    let alphas = (0..names.len()).filter(|&at| channels::is_alpha(&names[at]));
    let alphas = alphas.filter_map(|at| alpha(part, work, filled, at));
    let alphas: Vec<Alpha> = alphas.filter(|alpha| smoothed || alpha.known).collect();
    let is_colour = |filled: &&mut Filled| !filled.copied && !channels::is_alpha(&names[filled.channel]);
    for channel in filled.iter_mut().filter(is_colour) {
        let name = &names[channel.channel];
        let tied = |alpha: &Alpha| channel.all || (alpha.known && channels::is_light(name));
        let layer = Name::new(name).layer;
        let Some(alpha) = alphas.iter().find(|alpha| alpha.layer == layer && tied(alpha)) else { continue };
        let pixels = channel.mask.as_slice().iter().zip(alpha.values.iter().zip(&channel.samples));
        let measured = pixels.filter(|(flag, _)| **flag).map(|(_, pixel)| pixel);
        if !is_black_where_empty(measured, if channel.all { 0 } else { EMPTY }) {
            continue;
        }
        let empty = channel.values.iter_mut().zip(&alpha.values).filter(|(_, alpha)| **alpha == 0.0);
        empty.for_each(|(value, _)| *value = 0.0);
    }
}

/// The alpha in a channel of a part, filled or complete; a sparse one that is kept says nothing of missing pixels.
fn alpha(part: &Part, work: &Work<'_>, filled: &[Filled], at: usize) -> Option<Alpha> {
    let layer = Name::new(&part.channels[at].display_name()).layer.to_owned();
    if let Some(found) = filled.iter().find(|filled| filled.channel == at) {
        return Some(Alpha { layer, values: found.values.clone(), known: !found.all });
    }
    let is_complete = matches!(work.choices[at].by, DecidedBy::Guide | DecidedBy::Dense);
    let values = part.channels[at].samples.to_floats().filter(|_| is_complete)?;
    Some(Alpha { layer, values, known: *work.job.wanted() != Asked::None })
}

/// Brings filled coordinates, layer by layer, onto surfaces of the measured ones where that is due.
pub fn on_surfaces(
    frame: &Frame,
    work: &Work<'_>,
    filled: &mut [Filled],
    done: &mut Done,
) -> Result<(), Error> {
    let part = &frame.parts[work.index];
    if !work.job.method.keeps_measured() {
        return Ok(());
    }
    let mut layers: Vec<(String, Arc<Mask>, Vec<usize>)> = Vec::new();
    for (at, one) in filled.iter().enumerate() {
        let name = part.channels[one.channel].display_name();
        let filled = work.choices[one.channel].rule == Rule::Fill;
        if !filled || one.copied || !channels::is_coordinate(&name) {
            continue;
        }
        let layer = Name::new(&name).layer;
        match layers.iter_mut().find(|(own, mask, _)| own == layer && **mask == *one.mask) {
            Some((.., all)) => all.push(at),
            None => layers.push((layer.to_owned(), Arc::clone(&one.mask), vec![at])),
        }
    }
    for (_, mask, all) in layers {
        let channel = filled[all[0]].channel;
        let fail = |source| Error::Filter { channel: channel_label(frame, work.index, channel), source };
        let own = filled.iter_mut().enumerate().filter(|(at, _)| all.contains(at));
        let (mut planes, samples): (Vec<&mut [f32]>, Vec<&[f32]>) =
            own.map(|(_, one)| (one.values.as_mut_slice(), one.samples.as_slice())).unzip();
        let (method, name) = (work.job.method.clone(), part.channels[channel].display_name());
        if !channels::is_position(&name)
            && !surfaces::are_near(&samples, &mask, method, (work.plans, work.run)).map_err(fail)?
        {
            continue;
        }
        let plan = work.plans.depth(&mask).map_err(fail)?;
        let missing: Vec<usize> = (0..mask.as_slice().len()).filter(|&at| !mask.as_slice()[at]).collect();
        let moved = surfaces::keep(&mut planes, &samples, (mask.size(), &missing), &plan);
        // The estimate is that of the filter alone.
        if moved > 0 {
            done.report.estimate_none(channel);
        }
    }
    Ok(())
}
