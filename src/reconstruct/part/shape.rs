//! What filled normals, coordinates and smoothed colours have to be beside smooth: of unit length, on surfaces, black where nothing is.

use std::sync::Arc;

use lacuna_exr::Frame;
use lacuna_filters::Mask;

use super::{Done, Filled, Work};
use crate::channels::{self, DecidedBy, Name, Rule, channel_label};
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
        if triple.iter().min() != Some(&channel) {
            continue;
        }
        let fail = |source| Error::Filter { channel: channel_label(frame, work.index, channel), source };
        let masks = [x, y, z].map(|at| Arc::clone(&filled[at].mask));
        let all = normals::kept(&masks, work.job.method.keeps_measured());
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

/// Makes smoothed channels 0 where the alpha of their layer is: smoothing takes light over an edge that alpha, which is not smoothed, keeps. Not where
/// a measured pixel has light without alpha.
pub fn empty_stays_black(frame: &Frame, work: &Work<'_>, filled: &mut [Filled]) {
    let part = &frame.parts[work.index];
    let names: Vec<_> = part.channels.iter().map(lacuna_exr::Channel::display_name).collect();
    if !filled.iter().any(|filled| filled.all) {
        return;
    }
    let is_complete = |at: usize| matches!(work.choices[at].by, DecidedBy::Guide | DecidedBy::Dense);
    let alpha = |at: usize| match filled.iter().find(|filled| filled.channel == at) {
        Some(alpha) => Some((at, alpha.values.clone())),
        // A sparse one that is kept says nothing of missing pixels.
        None => part.channels[at].samples.to_floats().filter(|_| is_complete(at)).map(|values| (at, values)),
    };
    let alphas: Vec<(usize, Vec<f32>)> =
        (0..names.len()).filter(|&at| channels::is_alpha(&names[at])).filter_map(alpha).collect();
    for channel in
        filled.iter_mut().filter(|filled| filled.all && !channels::is_alpha(&names[filled.channel]))
    {
        let layer = Name::new(&names[channel.channel]).layer;
        let Some((_, alpha)) = alphas.iter().find(|(at, _)| Name::new(&names[*at]).layer == layer) else {
            continue;
        };
        let measured = channel.mask.as_slice().iter().zip(&channel.samples);
        if measured.zip(alpha).any(|((flag, sample), alpha)| *flag && *alpha == 0.0 && *sample != 0.0) {
            continue;
        }
        let empty = channel.values.iter_mut().zip(alpha).filter(|(_, alpha)| **alpha == 0.0);
        empty.for_each(|(value, _)| *value = 0.0);
    }
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
        if !filled || !channels::is_coordinate(&name) {
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
