//! Where the noise of measured pixels is known from: half buffers, variances, counts of samples, or held-out samples alone.

use std::str::FromStr;
use std::sync::Arc;

use lacuna_core::parallel::prelude::*;
use lacuna_exr::{Frame, Part};
use lacuna_filters::fill::Values;
use lacuna_filters::noise::{Noise, Untold};
use lacuna_filters::{Mask, Plane, Planes};

use super::Error;
use super::gradients::sibling;
use super::groups::{Group, Target, groups, usable};
use super::weights::Weights;
use crate::channels::{MAIN, Name, Rule, list_channels, rgb_place};

/// Names of half buffers that are looked for.
const HALVES: [[&str; 2]; 4] =
    [["half1", "half2"], ["halfA", "halfB"], ["half_a", "half_b"], ["bufferA", "bufferB"]];
/// Names of variances that are looked for.
const VARIANCES: [&str; 4] = ["variance", "Variance", "colorVariance", "mse"];
/// Components that are colours, not one variance for all.
const COLOURS: [&str; 4] = ["R", "G", "B", "Y"];

/// What `--noise` says.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum NoiseSource {
    /// There is none.
    #[default]
    None,
    /// Whatever is there: half buffers, else variances, else held-out samples.
    Auto,
    /// The layers of two half buffers.
    Halves(String, String),
    /// The layer, or the channel, of the variance of measured pixels.
    Variance(String),
    /// The channel of the number of samples.
    Count(Weights),
}

/// Why a text names no noise.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' names no noise: write none, auto, halves:LAYER,LAYER, variance:LAYER or count:CHANNEL")]
pub struct NoiseError(String);

impl FromStr for NoiseSource {
    type Err = NoiseError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let fail = || NoiseError(text.into());
        Ok(match text.split_once(':') {
            None if text == "none" => Self::None,
            None if text == "auto" => Self::Auto,
            Some(("halves", both)) => match both.split_once(',') {
                Some((a, b)) if !a.is_empty() && !b.is_empty() => Self::Halves(a.into(), b.into()),
                _ => return Err(fail()),
            },
            Some(("variance", layer)) if !layer.is_empty() => Self::Variance(layer.into()),
            Some(("count", _)) => Self::Count(text.parse().map_err(|_| fail())?),
            _ => return Err(fail()),
        })
    }
}

impl std::fmt::Display for NoiseSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::None => f.write_str("none"),
            Self::Auto => f.write_str("auto"),
            Self::Halves(a, b) => write!(f, "halves:{a},{b}"),
            Self::Variance(layer) => write!(f, "variance:{layer}"),
            Self::Count(weights) => weights.fmt(f),
        }
    }
}

/// The channel with this full name.
fn named(part: &Part, name: &str) -> Option<usize> {
    part.channels.iter().position(|channel| channel.display_name() == name)
}

/// The channel of a layer that goes with a channel: `half1.R` with `R`, `diffuse.half1.R` or `half1.diffuse.R` with `diffuse.R`; where there is
/// no plain `R`, `half1.R` with `beauty.R`, too.
fn of_layer(part: &Part, channel: usize, layer: &str) -> Option<usize> {
    let full = part.channels[channel].display_name();
    let Name { layer: own, component } = Name::new(&full);
    let outside = || named(part, &format!("{layer}.{full}"));
    let beauty = || {
        named(part, &format!("{layer}.{component}"))
            .filter(|_| MAIN.contains(&own) && named(part, component).is_none())
    };
    sibling(part, channel, layer).or_else(outside).or_else(beauty)
}

/// The only colour of such a layer, which serves the other colours as well: smoothed by other means they would tint.
fn only(part: &Part, channel: usize, layer: &str) -> Option<usize> {
    let full = part.channels[channel].display_name();
    let own = rgb_place(&full).map(|_| Name::new(&full).layer)?;
    let layers = [format!("{own}.{layer}"), format!("{layer}.{own}")];
    let fits = |at: &usize| {
        let full = part.channels[*at].display_name();
        let Name { layer, component } = Name::new(&full);
        layers.iter().any(|one| one.trim_matches('.') == layer) && COLOURS.contains(&component)
    };
    let mut found = (0..part.channels.len()).filter(fits);
    found.next().filter(|_| found.next().is_none())
}

/// What the noise of a channel is known from.
#[derive(Clone, Copy)]
enum Known {
    Halves([usize; 2]),
    Variance(usize),
}

/// Why what is there tells no noise, and the way out for who has named it.
struct Doubt {
    why: String,
    way: &'static str,
}

impl NoiseSource {
    /// Whether `auto` takes a channel of this name for a variance.
    pub fn is_variance(name: &str) -> bool {
        VARIANCES.contains(&name)
    }

    /// What is there for a channel.
    fn known(&self, part: &Part, channel: usize) -> Option<Known> {
        let halves = |a: &str, b: &str| {
            Some(Known::Halves([of_layer(part, channel, a)?, of_layer(part, channel, b)?]))
        };
        let variance = |layer: &str| {
            let own = of_layer(part, channel, layer).or_else(|| only(part, channel, layer));
            own.map(Known::Variance)
        };
        // One channel may serve all, if it is named, and those of its layer.
        let one = |name: &str| named(part, name).map(Known::Variance);
        let full = part.channels[channel].display_name();
        let beside = |name: &str| match Name::new(&full).layer {
            "" => one(name),
            layer => one(&format!("{layer}.{name}")),
        };
        match self {
            Self::None | Self::Count(_) => None,
            Self::Halves(a, b) => halves(a, b),
            Self::Variance(layer) => variance(layer).or_else(|| one(layer)),
            Self::Auto => HALVES
                .iter()
                .find_map(|[a, b]| halves(a, b))
                .or_else(|| VARIANCES.iter().find_map(|layer| variance(layer).or_else(|| beside(layer)))),
        }
    }

    /// The groups of what the noise of others is known from, which has none to smooth by, and all other groups. First those of them that tell nothing,
    /// as they have no finite value: they are no targets any more, so that they refuse no frame.
    pub fn groups(
        &self,
        frame: &Frame,
        index: usize,
        targets: &mut Vec<Target>,
    ) -> Result<(Vec<usize>, [Vec<Group>; 2]), Error> {
        let part = &frame.parts[index];
        let filled = targets.iter().filter(|target| target.rule == Rule::Fill);
        let known = filled.filter_map(|target| self.known(part, target.channel));
        let used = known.flat_map(|known| match known {
            Known::Halves(both) => both.to_vec(),
            Known::Variance(one) => vec![one],
        });
        let used: Vec<usize> = used.collect();
        let mut blank = Vec::new();
        for target in targets.iter().filter(|target| used.contains(&target.channel)) {
            if usable(target.rule, &part.channels[target.channel].samples, &target.mask)?.is_empty() {
                blank.push(target.channel);
            }
        }
        targets.retain(|target| !blank.contains(&target.channel));
        let (telling, noisy): (Vec<Target>, Vec<Target>) =
            targets.iter().cloned().partition(|target| used.contains(&target.channel));
        Ok((blank, [telling, noisy].map(|targets| groups(frame, index, &targets))))
    }

    /// Groups whose channels all have something that tells their noise, or none has.
    pub fn split(&self, part: &Part, groups: Vec<Group>) -> Vec<Group> {
        let parts = groups.into_iter().flat_map(|group| {
            let (known, other): (Vec<usize>, Vec<usize>) =
                group.channels.iter().partition(|&&channel| self.known(part, channel).is_some());
            [known, other].map(|channels| Group { channels, ..group.clone() })
        });
        parts.filter(|group| !group.channels.is_empty()).collect()
    }

    /// Channels of whose noise nothing tells though it does of others of their group, or only what tells of another: what is to be said
    /// of them.
    pub fn untold(&self, part: &Part, groups: &[Group]) -> Vec<String> {
        let name = |at: usize| part.channels[at].display_name();
        let component = |at: usize| Name::new(&name(at)).component.to_owned();
        let listed = |channels: &[usize]| channels.iter().map(|&at| name(at)).collect::<Vec<_>>().join(", ");
        let one = |group: &Group| {
            let known = |channel: usize| self.known(part, channel);
            let (told, other): (Vec<usize>, Vec<usize>) =
                group.channels.iter().partition(|&&channel| known(channel).is_some());
            let lent = |channel: usize| match known(channel) {
                Some(Known::Variance(at)) if COLOURS.contains(&component(at).as_str()) => {
                    (component(at) != component(channel)).then_some(at)
                }
                _ => None,
            };
            let borrowers: Vec<usize> =
                told.iter().copied().filter(|&channel| lent(channel).is_some()).collect();
            let named = matches!(self, Self::Halves(..) | Self::Variance(_));
            let nothing = (named && !told.is_empty() && !other.is_empty()).then(|| {
                let names = listed(&other);
                format!("{names}: --noise {self} has nothing for it: measured pixels are not smoothed")
            });
            let another = borrowers.first().and_then(|&channel| lent(channel)).map(|at| {
                format!("{}: smoothed by {}, the only colour of its layer", listed(&borrowers), name(at))
            });
            [nothing, another]
        };
        let light = groups.iter().filter(|group| group.values == Values::Light);
        light.flat_map(one).flatten().collect()
    }

    /// Layers that were named must be there for some channel that is filled.
    ///
    /// # Errors
    /// They are not.
    pub fn check(&self, frame: &Frame) -> Result<(), Error> {
        if !matches!(self, Self::Halves(..) | Self::Variance(_)) {
            return Ok(());
        }
        if let Self::Variance(name) = self
            && COLOURS.contains(&Name::new(name).component)
            && frame.parts.iter().any(|part| named(part, name).is_some())
        {
            return Err(self.fail("a colour, no variance: name the layer or the channel of one".into()));
        }
        let any = |part: &Part| (0..part.channels.len()).any(|at| self.known(part, at).is_some());
        if frame.parts.iter().any(any) {
            return Ok(());
        }
        let what = "no such layer beside a channel of the same part; those of other parts and files come in by --layers";
        Err(self.fail(format!("{what}; there are {}", list_channels(frame))))
    }

    /// An error of weights as one of what asked for them.
    pub fn named(&self, error: Error) -> Error {
        match error {
            Error::Weights { why, .. } if matches!(self, Self::Count(_)) => self.fail(why),
            other => other,
        }
    }

    fn fail(&self, why: String) -> Error {
        Error::Noise { noise: self.to_string(), why }
    }

    /// What is known of the noise of a group, and what is to be said of it.
    ///
    /// # Errors
    /// Of what was named: halves that are the same or belong to another colour, variances that are negative or nowhere above 0.
    pub fn of(&self, part: &Part, group: &Group, samples: &Planes) -> Result<(Noise, Option<String>), Error> {
        let unknown = if group.values == Values::Light { Noise::Unknown } else { Noise::None };
        let known: Option<Vec<Known>> =
            group.channels.iter().map(|&channel| self.known(part, channel)).collect();
        let Some(known) = known else {
            let held_out = matches!(self, Self::Auto | Self::Count(_));
            return Ok((if held_out { unknown } else { Noise::None }, None));
        };
        match like(part, group, (&known, samples))? {
            Ok(noise) => {
                let note = unknown_at(part, group, &noise, samples);
                Ok((noise, note))
            }
            // What is no light, such as alpha, need not have any.
            Err(Doubt { why, .. }) if *self == Self::Auto || unknown == Noise::None => {
                Ok((unknown, Some(format!("{why}: ignored"))))
            }
            Err(Doubt { why, way }) => Err(self.fail(format!("{why}: {way}"))),
        }
    }
}

/// Noise like that of the samples; none where there is none and the samples of a channel are all the same.
fn like(
    part: &Part,
    group: &Group,
    (known, samples): (&[Known], &Planes),
) -> Result<Result<Noise, Doubt>, Error> {
    let channels = known.par_iter().zip(group.channels.par_iter()).zip(samples.as_slice().par_iter());
    let found = channels.enumerate().map(|(number, ((&known, &channel), samples))| {
        plane(part, (channel, number, known), samples, &group.mask)
    });
    let mut planes = Vec::with_capacity(known.len());
    for found in found {
        match found? {
            Ok(plane) => planes.push(plane),
            Err(doubt) => return Ok(Err(doubt)),
        }
    }
    let name = |at: usize| part.channels[at].display_name();
    Ok(Noise::like(planes, samples, &group.mask).map_err(|untold| match (known[0], untold) {
        (Known::Halves([a, b]), Untold::NotFinite) => Doubt {
            why: format!("{} and {} are {untold} together", name(a), name(b)),
            way: "name halves that were written, or leave --noise out",
        },
        (Known::Halves([a, b]), _) => same(name(a), name(b)),
        (Known::Variance(at), _) => Doubt {
            why: format!("{} is {}", name(at), Untold::Nowhere),
            way: "leave --noise out, or write --noise auto",
        },
    }))
}

/// At how many measured pixels of a group the noise of some channel is not known, if there are any.
fn unknown_at(part: &Part, group: &Group, noise: &Noise, samples: &Planes) -> Option<String> {
    let Noise::Like(planes) = noise else { return None };
    let is_finite = |planes: &[Plane], at: usize| planes.iter().all(|plane| plane.pixels()[at].is_finite());
    let unknown = |at: usize| is_finite(samples.as_slice(), at) && !is_finite(planes, at);
    let flags = group.mask.as_slice().iter().enumerate();
    let count = flags.filter(|&(at, flag)| *flag && unknown(at)).count();
    let names: Vec<_> = group.channels.iter().map(|&at| part.channels[at].display_name()).collect();
    let (names, all) = (names.join(", "), group.mask.count());
    (count > 0).then(|| format!("{names}: the noise of {count} of {all} measured pixels is not known"))
}

/// Two halves that tell nothing.
fn same(a: impl std::fmt::Display, b: impl std::fmt::Display) -> Doubt {
    Doubt { why: format!("{a} and {b} are the same"), way: "name two independent halves" }
}

/// Noise like that of a channel, which has that number in its group.
fn plane(
    part: &Part,
    (channel, number, known): (usize, usize, Known),
    samples: &Plane,
    mask: &Arc<Mask>,
) -> Result<Result<Plane, Doubt>, Error> {
    let name = |at: usize| part.channels[at].display_name();
    let read = |at: usize| {
        let values = part.channels[at].samples.to_floats().ok_or(Error::OtherFrame)?;
        Plane::new(mask.size(), values).map_err(|_| Error::OtherFrame)
    };
    let found = match known {
        Known::Halves([a, b]) => Noise::of_halves(samples, [&read(a)?, &read(b)?], mask),
        Known::Variance(at) => Noise::of_variance_at(&read(at)?, number, mask),
    };
    Ok(found.map_err(|why| match (known, why) {
        (Known::Halves([a, b]), Untold::SameHalves) => same(name(a), name(b)),
        (Known::Halves([a, b]), _) => {
            let why = format!("{} and {} do not average to {}", name(a), name(b), name(channel));
            Doubt { why, way: "name the halves of this colour" }
        }
        (Known::Variance(at), why) => {
            let bad = if let Untold::Negative(value) = why { value } else { f32::NAN };
            let why = format!("{} is {bad} at a measured pixel, which is no variance", name(at));
            Doubt { why, way: "name another layer, or write --noise auto" }
        }
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_become_sources_and_come_back() {
        for text in ["none", "auto", "halves:half1,half2", "variance:mse", "count:samples"] {
            assert_eq!(text.parse::<NoiseSource>().unwrap().to_string(), text);
        }
        for text in ["", "halves:", "halves:a", "halves:a,", "variance:", "count:", "half1"] {
            let error = text.parse::<NoiseSource>().unwrap_err().to_string();
            assert!(error.contains("halves:LAYER,LAYER"), "{error}");
        }
    }
}
