//! Looking for the mask: each source in turn, and the order that `auto` goes by.

use lacuna_exr::{Frame, Part, Samples};
use lacuna_filters::Mask;

use super::cover::serve;
use super::matte::{is_element, is_matte, is_scattered, lit, may_be_mattes};
use super::provider::{Provider, Views};
use super::{ATTRIBUTE, Error, MaskFile, Masks, Source, flags};
use crate::channels::{self, Name, Rule, list_channels, view_of};

/// A channel of the frame, by its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    part: usize,
    channel: usize,
}

/// Finds the masks of a frame.
///
/// `file` is the mask image that was read for [`Source::File`].
pub fn find(frame: &Frame, source: &Source, file: Option<&MaskFile>) -> Result<Masks, Error> {
    match source {
        Source::Auto => auto(frame),
        Source::Channel(name) => {
            let places = named(frame, name)?;
            Ok(from_channels(frame, &places, false, name.clone(), at_least_half))
        }
        Source::File { channel, .. } => {
            let file = file.ok_or(Error::FileNotRead)?;
            let providers = file.providers(frame, channel.as_deref())?;
            let mut masks = serve(frame, &providers);
            let suffix = channel.as_ref().map(|name| format!(":{name}")).unwrap_or_default();
            masks.origin = format!("file:{}{suffix}", file.path());
            Ok(masks)
        }
        Source::Alpha => alpha(frame),
        Source::Finite => finite(frame),
        Source::Count { channel, at_least } => {
            let places = named(frame, channel)?;
            let origin = source.to_string();
            let mut masks = from_channels(frame, &places, false, origin, |value| value >= *at_least);
            masks.notes.clear();
            Ok(masks)
        }
    }
}

/// Whether a value is one that a sampling mask has.
fn is_binary(value: f64) -> bool {
    [0.0, 1.0].contains(&value)
}

pub(super) fn at_least_half(value: f64) -> bool {
    value >= 0.5
}

/// The attribute, then a channel `mask`, then `LAYER.mask`: the first kind that is there serves the frame.
fn auto(frame: &Frame) -> Result<Masks, Error> {
    let places = all_places(frame);
    let is = |place: &Place, test: &dyn Fn(&Part, &str) -> bool| {
        let part = &frame.parts[place.part];
        test(part, &part.channels[place.channel].display_name())
    };
    let by_attribute = pick(&places, |place| {
        is(place, &|part, name| part.attributes.text(ATTRIBUTE).is_some_and(|wanted| wanted == name))
    });
    if !by_attribute.is_empty() {
        return Ok(from_channels(frame, &by_attribute, false, origin(frame, &by_attribute), at_least_half));
    }
    let plain = without_doubles(frame, &pick(&places, |place| is(place, &is_plain_mask)))?;
    let layered = pick(&places, |place| plain.is_empty() && is_layer_mask(frame, *place));
    let mut masks = if !plain.is_empty() {
        from_channels(frame, &plain, false, origin(frame, &plain), at_least_half)
    } else if !layered.is_empty() {
        from_channels(frame, &layered, true, Source::Auto.to_string(), at_least_half)
    } else {
        return Err(Error::NotFound {
            channels: list_channels(frame),
            hint: file_hint(frame).or_else(|| nan_hint(frame)),
        });
    };
    if is_matte(frame, &masks) {
        return Ok(without_matte(frame, &masks, "colour has values"));
    }
    if may_be_mattes(frame, &masks) {
        let names = mask_names(frame, &masks).join(", ");
        masks.notes.push(format!(
            "channel {names} leaves out whole regions, which count as missing: if it is a matte, --mask nan takes the frame as complete"
        ));
    }
    masks.notes.extend(unused_attribute(frame));
    Ok(masks)
}

/// The masks of a frame to be enlarged, which may well be complete, if those that were found are mattes of an element over black.
pub fn beside_element(frame: &Frame, masks: &Masks) -> Option<Masks> {
    is_element(frame, masks).then(|| without_matte(frame, masks, "alpha is 0"))
}

/// The names of the mask channels, each once.
fn mask_names(frame: &Frame, masks: &Masks) -> Vec<String> {
    let places = masks
        .mask_channels
        .iter()
        .enumerate()
        .flat_map(|(part, channels)| channels.iter().map(move |&channel| Place { part, channel }));
    let mut names: Vec<_> = places.map(|place| name_at(frame, place)).collect();
    names.dedup();
    names
}

/// The masks of a frame that is complete beside mattes, which `why` tells where they are 0.
fn without_matte(frame: &Frame, masks: &Masks, why: &str) -> Masks {
    let names = mask_names(frame, masks);
    let note = format!(
        "channel {} is taken for a matte, as {why} where it is 0, and nothing is missing: if it says which \
         pixels were measured, name it with --mask channel:{}",
        names.join(", "),
        names.first().map_or("mask", String::as_str)
    );
    Masks { notes: vec![note], ..Masks::complete(frame) }
}

/// What is to be said where no mask was found but the frame was filled by one that it does not hold.
fn file_hint(frame: &Frame) -> Option<String> {
    let named = frame.parts.iter().find_map(|part| part.attributes.text(ATTRIBUTE))?;
    let of_values = ["alpha", "nan"].contains(&named.as_str()) || named.starts_with("count:");
    match named.strip_prefix("file:") {
        Some(path) => Some(format!("the attribute {ATTRIBUTE} names the file {path}: give it with --mask {path}")),
        None => of_values.then(|| {
            format!("the attribute {ATTRIBUTE} says '{named}', which was told from the values before they were filled")
        }),
    }
}

/// What is to be said where no mask was found but many pixels, scattered, are not finite.
fn nan_hint(frame: &Frame) -> Option<String> {
    let missing = 100.0 * (1.0 - scattered_nan(frame)?.density()?);
    Some(format!("{missing:.0} % of the pixels are not finite: --mask nan takes them as missing"))
}

/// The masks that many pixels, scattered, that are not finite tell.
fn scattered_nan(frame: &Frame) -> Option<Masks> {
    let masks = finite(frame).ok()?;
    (!masks.is_empty() && masks.all().any(|mask| is_scattered(mask))).then_some(masks)
}

/// What a frame says of itself: what `auto` finds, else what NaN tells; nothing if it says nothing.
pub fn told(frame: &Frame) -> Option<Masks> {
    auto(frame).ok().or_else(|| scattered_nan(frame))
}

/// Whether nothing in a frame without a mask tells of missing pixels: its values are finite, and no light is black in scattered pixels.
pub fn seems_complete(frame: &Frame) -> bool {
    finite(frame).is_ok_and(|masks| masks.is_full())
        && !frame.parts.iter().flat_map(lit).any(|(_, mask)| is_scattered(&mask))
}

/// The name that all masks share, or `auto` if a name alone does not find them again.
fn origin(frame: &Frame, places: &[Place]) -> String {
    let mut names = places.iter().map(|place| name_at(frame, *place));
    let first = names.next().unwrap_or_default();
    if names.all(|name| name == first) { first } else { Source::Auto.to_string() }
}

/// Says that the attribute names something else than a channel: a file, or a channel that is gone.
fn unused_attribute(frame: &Frame) -> Option<String> {
    let named = frame.parts.iter().find_map(|part| part.attributes.text(ATTRIBUTE))?;
    (named != "auto").then(|| format!("the attribute {ATTRIBUTE} names '{named}', which is no channel here"))
}

fn pick(places: &[Place], keep: impl Fn(&Place) -> bool) -> Vec<Place> {
    places.iter().copied().filter(keep).collect()
}

fn all_places(frame: &Frame) -> Vec<Place> {
    let of = |(part, content): (usize, &Part)| {
        (0..content.channels.len()).map(move |channel| Place { part, channel }).collect::<Vec<_>>()
    };
    frame.parts.iter().enumerate().flat_map(of).collect()
}

fn name_at(frame: &Frame, place: Place) -> String {
    frame.parts[place.part].channels[place.channel].display_name().into_owned()
}

fn named(frame: &Frame, name: &str) -> Result<Vec<Place>, Error> {
    let places = pick(&all_places(frame), |place| name_at(frame, *place) == name);
    if places.is_empty() {
        return Err(Error::NoChannel { name: name.into(), channels: list_channels(frame) });
    }
    Ok(places)
}

/// `mask` in any case, or the same behind the name of a view.
pub(super) fn is_plain_mask(part: &Part, name: &str) -> bool {
    let Name { layer, component } = Name::new(name);
    let of_view = part.view().is_none() && view_of(part, name).as_deref() == Some(layer);
    component.eq_ignore_ascii_case("mask") && (layer.is_empty() || of_view)
}

/// Of channels of one part and layer that differ in case alone the one called exactly `mask`.
fn without_doubles(frame: &Frame, places: &[Place]) -> Result<Vec<Place>, Error> {
    let layer_of = |place: &Place| Name::new(&name_at(frame, *place)).layer.to_owned();
    let exact = |place: &Place| Name::new(&name_at(frame, *place)).component == "mask";
    let mut chosen = Vec::new();
    for place in places {
        let rivals: Vec<&Place> = places
            .iter()
            .filter(|other| other.part == place.part && layer_of(other) == layer_of(place))
            .collect();
        if rivals.len() == 1 || exact(place) {
            chosen.push(*place);
        } else if !rivals.iter().any(|rival| exact(rival)) {
            let names: Vec<_> = rivals.iter().map(|rival| name_at(frame, **rival)).collect();
            return Err(Error::Several { names: names.join(", ") });
        }
    }
    Ok(chosen)
}

/// `LAYER.mask` is a sampling mask only if it is 0 and 1 throughout and LAYER has channels that it could be for.
fn is_layer_mask(frame: &Frame, place: Place) -> bool {
    let part = &frame.parts[place.part];
    let full = part.channels[place.channel].display_name();
    let Name { layer, component } = Name::new(&full);
    let others = part.channels.iter().enumerate().any(|(index, other)| {
        let other = other.display_name();
        let rest = Name::new(&other).layer.strip_prefix(layer);
        index != place.channel && rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    });
    !layer.is_empty()
        && component.eq_ignore_ascii_case("mask")
        && others
        && flags(&part.channels[place.channel].samples, is_binary).iter().all(|&binary| binary)
}

/// Masks from channels of the frame itself; `layered` ones serve their own layer only.
fn from_channels(
    frame: &Frame,
    places: &[Place],
    layered: bool,
    origin: String,
    measured: impl Fn(f64) -> bool + Sync,
) -> Masks {
    let mut providers = Vec::new();
    let mut between = 0;
    for place in places {
        let part = &frame.parts[place.part];
        let channel = &part.channels[place.channel];
        let name = channel.display_name();
        let binary = flags(&channel.samples, is_binary);
        between += binary.iter().filter(|&&binary| !binary).count();
        let layer = layered.then(|| Name::new(&name).layer.to_owned());
        let views = Views::of_mask(part, &name);
        providers.extend(provider((part, place.part), views, layer, flags(&channel.samples, &measured)));
    }
    let mut masks = serve(frame, &providers);
    masks.origin = origin;
    for place in places {
        masks.mask_channels[place.part].push(place.channel);
    }
    if between > 0 {
        masks.notes.push(format!(
            "{between} pixels of the mask are neither 0 nor 1: from one half on they count as measured"
        ));
    }
    masks
}

fn provider(
    (part, index): (&Part, usize),
    views: Views,
    layer: Option<String>,
    flags: Vec<bool>,
) -> Option<Provider> {
    let mask = Mask::new(part.size(), flags).ok()?;
    Some(Provider { part: Some(index), views, layer, window: part.data_window, mask })
}

/// Alpha above 0: `A` for a part and its view, `LAYER.A` for LAYER; a view that has only one alpha takes that.
fn alpha(frame: &Frame) -> Result<Masks, Error> {
    let mut providers = Vec::new();
    for place in all_places(frame) {
        let part = &frame.parts[place.part];
        let channel = &part.channels[place.channel];
        let name = channel.display_name();
        let Name { layer, component } = Name::new(&name);
        if !["a", "alpha"].contains(&component.to_ascii_lowercase().as_str()) {
            continue;
        }
        let of_view = part.view().is_none() && view_of(part, &name).as_deref() == Some(layer);
        let layer = (!layer.is_empty() && !of_view).then(|| layer.to_owned());
        let views = Views::Of(view_of(part, &name));
        providers.extend(provider((part, place.part), views, layer, flags(&channel.samples, |a| a > 0.0)));
    }
    if providers.is_empty() {
        return Err(Error::NoAlpha { channels: list_channels(frame) });
    }
    let only = |at: usize| providers.iter().filter(|other| other.views == providers[at].views).count() == 1;
    let single: Vec<bool> = (0..providers.len()).map(only).collect();
    for (provider, single) in providers.iter_mut().zip(single) {
        if single {
            provider.layer = None;
        }
    }
    let mut masks = serve(frame, &providers);
    masks.origin = Source::Alpha.to_string();
    Ok(masks)
}

/// Per part: measured where every colour is finite and no depth is NaN (an infinite depth is legal). Identifiers,
/// counts and whole numbers say nothing; a part that has only those takes the mask of its view.
pub(super) fn finite(frame: &Frame) -> Result<Masks, Error> {
    let mut providers = Vec::new();
    for (index, part) in frame.parts.iter().enumerate() {
        let mut views: Vec<(String, Vec<bool>)> = Vec::new();
        for (number, channel) in part.channels.iter().enumerate() {
            let Some(flags) = told_by(part, number) else { continue };
            let name = channel.display_name().into_owned();
            let same = |(other, _): &&mut (String, _)| view_of(part, other) == view_of(part, &name);
            match views.iter_mut().find(same) {
                Some((_, all)) => all.iter_mut().zip(flags).for_each(|(all, flag)| *all &= flag),
                None => views.push((name, flags)),
            }
        }
        let one = |(name, flags): (String, _)| {
            provider((part, index), Views::Of(view_of(part, &name)), None, flags)
        };
        providers.extend(views.into_iter().filter_map(one));
    }
    if providers.is_empty() {
        return Err(Error::NoFloat { channels: list_channels(frame) });
    }
    let mut masks = serve(frame, &providers);
    masks.origin = Source::Finite.to_string();
    Ok(masks)
}

/// The pixels that a channel calls measured by its values; nothing of one that says nothing.
pub(super) fn told_by(part: &Part, channel: usize) -> Option<Vec<bool>> {
    match (channels::by_default(part, channel).0, &part.channels[channel].samples) {
        (Rule::Keep, _) | (_, Samples::Uint(_)) => None,
        // A NaN among codes may be a value like any other.
        (Rule::Nearest, _) if channels::is_code(part, channel) => None,
        (Rule::Depth, samples) => Some(flags(samples, |value| !value.is_nan())),
        (_, samples) => Some(flags(samples, f64::is_finite)),
    }
}
