//! Gradients that a renderer measured: layers `dx` and `dy` beside a layer, as `lacuna render --gradients` writes them.
//!
//! `dx.R` and `dy.R` are the derivatives of `R` per pixel, at pixel centres, x to the right and y down; those of `diffuse.R` are
//! `diffuse.dx.R` and `diffuse.dy.R`. Only the filter `cs-gradient` uses them; they are samples then, and stay as they are.

use std::sync::Arc;

use lacuna_exr::{Frame, Part};
use lacuna_filters::domain::Map;
use lacuna_filters::{Error, Gradients, Mask, Method, Plane, Planes};

use super::groups::{Group, Target, usable};
use super::part::{Work, measured_floats};
use crate::channels::{Name, Rule};

/// The layers, along x and along y.
const LAYERS: [&str; 2] = ["dx", "dy"];

/// Samples of the gradient of a group.
#[derive(Clone, Debug)]
pub struct GradientSamples {
    planes: [Planes; 2],
    mask: Arc<Mask>,
}

/// The channels `dx` and `dy` of a channel, if there are both.
fn siblings(part: &Part, channel: usize) -> Option<[usize; 2]> {
    let full = part.channels.get(channel)?.display_name().into_owned();
    let name = Name::new(&full);
    let find = |layer: &str| {
        let wanted = match name.layer {
            "" => format!("{layer}.{}", name.component),
            outer => format!("{outer}.{layer}.{}", name.component),
        };
        part.channels.iter().position(|channel| channel.display_name() == wanted.as_str())
    };
    Some([find(LAYERS[0])?, find(LAYERS[1])?])
}

/// The channels of a part that are samples of a gradient for this method.
pub fn used(part: &Part, targets: &[Target], method: &Method) -> Vec<usize> {
    if !matches!(method, Method::CsGradient(_)) {
        return Vec::new();
    }
    let filled = targets.iter().filter(|target| target.rule == Rule::Fill);
    filled.filter_map(|target| siblings(part, target.channel)).flatten().collect()
}

/// The gradients of all channels of a group, if each has both components and the method uses them. They count where all
/// are measured and finite.
pub fn find(frame: &Frame, work: &Work<'_>, group: &Group) -> Result<Option<GradientSamples>, Error> {
    if !matches!(work.job.method, Method::CsGradient(_)) {
        return Ok(None);
    }
    let part = &frame.parts[work.index];
    let Some(all) = group.channels.iter().map(|&at| siblings(part, at)).collect::<Option<Vec<_>>>() else {
        return Ok(None);
    };
    let mut flags = vec![true; group.mask.size().pixels()];
    for &channel in all.iter().flatten() {
        let samples = &part.channels[channel].samples;
        let Some(mask) = work.masks.get(work.index, channel) else { return Ok(None) };
        let Ok(mask) = usable(Rule::Fill, samples, mask) else { return Ok(None) };
        flags.iter_mut().zip(mask.as_slice()).for_each(|(flag, measured)| *flag &= measured);
    }
    let mask = Arc::new(Mask::new(group.mask.size(), flags)?);
    let planes = |axis: usize| {
        let plane = |siblings: &[usize; 2]| {
            let values = measured_floats(&part.channels[siblings[axis]].samples, &mask).ok()?;
            Plane::new(mask.size(), values).ok()
        };
        all.iter().map(plane).collect::<Option<Vec<_>>>()
    };
    let (Some(x), Some(y)) = (planes(0), planes(1)) else { return Ok(None) };
    Ok(Some(GradientSamples { planes: [Planes::new(mask.size(), x)?, Planes::new(mask.size(), y)?], mask }))
}

impl GradientSamples {
    /// As the filter takes them.
    pub fn view(&self) -> Gradients<'_> {
        Gradients { planes: [&self.planes[0], &self.planes[1]], mask: &self.mask }
    }

    /// The gradients of mapped values, by the chain rule; known only where the values themselves are.
    pub fn mapped(&self, map: Map, samples: &Planes, measured: &Mask) -> Result<Self, Error> {
        let both = self.mask.as_slice().iter().zip(measured.as_slice()).map(|(a, b)| *a && *b).collect();
        let mut planes = self.planes.clone();
        for planes in &mut planes {
            for (plane, samples) in planes.as_mut_slice().iter_mut().zip(samples.as_slice()) {
                for (slope, value) in plane.pixels_mut().iter_mut().zip(samples.pixels()) {
                    *slope *= map.slope(*value);
                }
            }
        }
        Ok(Self { planes, mask: Arc::new(Mask::new(self.mask.size(), both)?) })
    }
}
