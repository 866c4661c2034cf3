//! Channels of files of their own (`--layers`) as layers of the frame, with what those files say of their pixels.
//!
//! The first part of such a file, and of each view, with the data window of a part of the frame goes into that part, each channel as
//! `NAME.CHANNEL`.

use std::collections::HashMap;
use std::path::PathBuf;

use lacuna_exr::{Channel, Frame, Limits, Part, Samples};

use super::find::{at_least_half, is_plain_mask};
use super::{ATTRIBUTE, FILTER};
use crate::channels::{self, Name, part_label};
use crate::files::layers::LayerFile;

/// Adds the channels of all of these files to a frame. Returns what to tell of parts that were left out.
///
/// # Errors
/// The file, and why it cannot be read or added.
pub fn read_into(
    frame: &mut Frame,
    files: &[LayerFile],
    limits: Limits,
) -> Result<Vec<String>, (PathBuf, String)> {
    let mut notes = Vec::new();
    for LayerFile { name, path } in files {
        let read = lacuna_exr::read(path, &limits).map_err(|error| error.to_string());
        let left = read.and_then(|layer| add(frame, name, layer)).map_err(|why| (path.clone(), why))?;
        notes.extend(left.map(|left| format!("{}: {left}", path.display())));
    }
    Ok(notes)
}

/// Puts the channels of `file` into the frame as a layer. Returns what to tell of its parts that were left out.
///
/// # Errors
/// No part with the data window and view of one of the frame's; a part that was filled or has another mask; a channel of that name
/// that is there already.
pub fn add(frame: &mut Frame, name: &str, file: Frame) -> Result<Option<String>, String> {
    let labels: Vec<_> = (0..file.parts.len()).map(|at| part_label(&file, at)).collect();
    let (mut taken, mut views, mut left) = (Vec::new(), Vec::new(), Vec::new());
    for (other, label) in file.parts.into_iter().zip(labels) {
        let view = other.view();
        let at = frame.parts.iter().position(|own| belong_together(own, &other));
        let Some(at) = at.filter(|at| !taken.contains(at) && !views.contains(&view)) else {
            left.push(label);
            continue;
        };
        add_part(&mut frame.parts[at], name, other).map_err(|why| format!("layer {name}: {why}"))?;
        taken.push(at);
        views.push(view);
    }
    if taken.is_empty() {
        return Err(format!(
            "layer {name}: no part has the data window and view of the frame: render it for the same pixels"
        ));
    }
    Ok((!left.is_empty()).then(|| format!("layer {name}: left out: {}", left.join(", "))))
}

/// Whether two parts show the same pixels; one without a view goes with any.
fn belong_together(own: &Part, other: &Part) -> bool {
    let views = own.view().zip(other.view());
    own.data_window == other.data_window && views.is_none_or(|(own, other)| own == other)
}

fn add_part(part: &mut Part, name: &str, mut other: Part) -> Result<(), String> {
    if let Some(filter) = other.attributes.text(FILTER) {
        return Err(format!(
            "filled by {filter} already, so its pixels were not all measured: give the file before that"
        ));
    }
    let complete = drop_mask(part, &mut other)?;
    restore_zeros(&mut other);
    let renamed = |own: &str| format!("{name}.{own}");
    let dense: Vec<_> = if complete {
        other.channels.iter().map(|own| renamed(&own.display_name())).collect()
    } else {
        channels::dense(&other).iter().map(|own| renamed(own)).collect()
    };
    for mut channel in std::mem::take(&mut other.channels) {
        channel.name = [name.as_bytes(), b".", &channel.name].concat();
        if part.channels.iter().any(|own| own.name == channel.name) {
            return Err(format!("the frame has a channel {} already", channel.display_name()));
        }
        part.channels.push(channel);
    }
    part.channels.sort_by(|a, b| a.name.cmp(&b.name));
    if !dense.is_empty() {
        channels::list_dense(part, dense.iter().map(String::as_str));
    }
    for attribute in other.attributes.iter() {
        let key = String::from_utf8_lossy(&attribute.name);
        // What the frame says of its own Cryptomatte stands.
        if key.starts_with("cryptomatte/") && part.attributes.get(&key).is_none() {
            match other.attributes.text(&key).filter(|_| key.ends_with("/name")) {
                Some(own) => part.attributes.set_text(&key, &renamed(&own)),
                None => part.attributes.set(
                    &key,
                    &String::from_utf8_lossy(&attribute.kind),
                    attribute.value.clone(),
                ),
            }
        }
    }
    Ok(())
}

/// Removes the mask of a layer's file where it says the same as that of the frame, or that nothing is missing, which is returned.
fn drop_mask(part: &Part, other: &mut Part) -> Result<bool, String> {
    let (Some(own), Some(at)) = (own_mask(part), own_mask(other)) else { return Ok(false) };
    let flags = |channel: &Channel| -> Vec<bool> {
        channel.samples.as_f32().iter().map(|&value| at_least_half(value.into())).collect()
    };
    let channel = &other.channels[at];
    let (asked, found) = (flags(&part.channels[own]), flags(channel));
    let complete = found.iter().all(|flag| *flag);
    if found != asked && !complete {
        return Err(format!(
            "its channel {} is not the mask of the frame: fill that file by itself, or rename the channel if it is a matte",
            channel.display_name()
        ));
    }
    other.channels.remove(at);
    Ok(complete && found != asked)
}

/// The channel that says which pixels of a part were measured: the one that the attribute names, or `mask`.
fn own_mask(part: &Part) -> Option<usize> {
    let named = part.attributes.text(ATTRIBUTE);
    let find =
        |is: &dyn Fn(&str) -> bool| part.channels.iter().position(|channel| is(&channel.display_name()));
    find(&|name| named.as_deref() == Some(name)).or_else(|| find(&|name| is_plain_mask(part, name)))
}

/// Makes 0 again what a lossy compression may have made of 0 in all channels of a layer: the frame's own compression says nothing of
/// it, and missing pixels would seem to have values.
fn restore_zeros(part: &mut Part) {
    if part.compression.is_lossless() {
        return;
    }
    // An alpha is often complete beside sparse colours.
    let layer = |channel: &Channel| {
        let name = channel.display_name();
        (Name::new(&name).layer.to_owned(), channels::is_alpha(&name))
    };
    let mut zeros: HashMap<(String, bool), Vec<bool>> = HashMap::new();
    for channel in &part.channels {
        let within = part.compression.zero_within(channel.samples.kind());
        let values = channel.samples.as_f32();
        let zeros = zeros.entry(layer(channel)).or_insert_with(|| vec![true; values.len()]);
        zeros.iter_mut().zip(values.iter()).for_each(|(zero, value)| *zero &= value.abs() <= within);
    }
    for channel in &mut part.channels {
        let Some(zeros) = zeros.get(&layer(channel)) else { continue };
        match &mut channel.samples {
            Samples::Half(values) => set_default(values, zeros),
            Samples::Float(values) => set_default(values, zeros),
            Samples::Uint(_) => {}
        }
    }
}

fn set_default<T: Default>(values: &mut [T], at: &[bool]) {
    values.iter_mut().zip(at).filter(|(_, at)| **at).for_each(|(value, _)| *value = T::default());
}

#[cfg(test)]
mod tests {
    use lacuna_exr::Compression;

    use super::*;
    use crate::testing::{float, frame, half, named, part, uint, values, window};

    fn names(part: &Part) -> String {
        channels::full_names(part).join(" ")
    }

    fn row(channels: Vec<Channel>) -> Part {
        part(window(0, 0, 2, 1), channels)
    }

    #[test]
    fn channels_become_a_layer_of_the_part_with_their_window() {
        let small = || part(window(0, 0, 1, 1), vec![float("R", &[1.0])]);
        let wide = || part(window(3, 0, 2, 1), vec![float("Z", &[1.0, 2.0])]);
        let mut whole = frame(vec![named("a", "", small()), named("b", "", wide())]);
        let counts = frame(vec![part(window(3, 0, 2, 1), vec![uint("G", &[5, 6]), uint("A", &[7, 8])])]);
        add(&mut whole, "SAMPLECOUNT", counts.clone()).unwrap();
        assert_eq!(names(&whole.parts[0]), "R");
        assert_eq!(names(&whole.parts[1]), "SAMPLECOUNT.A SAMPLECOUNT.G Z");
        assert!(add(&mut whole, "SAMPLECOUNT", counts).unwrap_err().contains("already"));
        let other = frame(vec![part(window(0, 0, 2, 2), vec![float("R", &[0.0; 4])])]);
        assert!(add(&mut whole, "N", other).unwrap_err().contains("data window"));
    }

    #[test]
    fn what_may_have_been_zero_in_a_lossy_file_is_zero() {
        let mut layer = row(vec![half("R", &[1e-4, 1e-4]), half("G", &[0.5, 1e-4]), half("A", &[1.0; 2])]);
        for (compression, restored) in [(Compression::Zip, 1e-4), (Compression::Dwaa, 0.0)] {
            layer.compression = compression;
            let mut whole = frame(vec![row(vec![float("R", &[1.0, 0.0])])]);
            add(&mut whole, "P", frame(vec![layer.clone()])).unwrap();
            let red = values(&whole.parts[0], "P.R");
            assert!((red[0] - 1e-4).abs() < 1e-6 && (red[1] - restored).abs() < 1e-6, "{red:?}");
        }
    }

    #[test]
    fn what_a_file_says_of_its_channels_comes_along() {
        let mut layer = row(vec![float("R", &[1.0, 0.0]), float("obj00.R", &[1.0, 0.0])]);
        channels::list_dense(&mut layer, ["R"]);
        layer.attributes.set_text("cryptomatte/1234567/name", "obj");
        layer.attributes.set_text("cryptomatte/1234567/manifest", "{}");
        let mut whole = frame(vec![row(vec![float("Z", &[1.0, 0.0])])]);
        channels::list_dense(&mut whole.parts[0], ["Z"]);
        add(&mut whole, "P", frame(vec![layer])).unwrap();
        let part = &whole.parts[0];
        assert_eq!(channels::dense(part), ["Z", "P.R"]);
        assert_eq!(part.attributes.text("cryptomatte/1234567/name").unwrap(), "P.obj");
        assert_eq!(part.attributes.text("cryptomatte/1234567/manifest").unwrap(), "{}");
        assert_eq!(channels::by_default(part, 1).0, channels::Rule::Nearest);
    }

    #[test]
    fn what_was_filled_or_has_another_mask_is_refused() {
        let masked = |flags: &[f32]| row(vec![float("R", &[1.0, 0.0]), float("mask", flags)]);
        let mut whole = frame(vec![masked(&[1.0, 0.0])]);
        let error = add(&mut whole, "Q", frame(vec![masked(&[0.0, 1.0])])).unwrap_err();
        assert!(error.contains("layer Q") && error.contains("mask"), "{error}");
        let mut filled = masked(&[1.0, 0.0]);
        filled.attributes.set_text(FILTER, "auto");
        let error = add(&mut whole, "Q", frame(vec![filled])).unwrap_err();
        assert!(error.contains("filled by auto"), "{error}");
        add(&mut whole, "Q", frame(vec![masked(&[1.0, 0.0])])).unwrap();
        assert_eq!(names(&whole.parts[0]), "Q.R R mask");
        // Nothing is missing in what a full mask is of.
        add(&mut whole, "P", frame(vec![masked(&[1.0, 1.0])])).unwrap();
        assert_eq!(names(&whole.parts[0]), "P.R Q.R R mask");
        assert_eq!(channels::dense(&whole.parts[0]), ["P.R"]);
    }

    #[test]
    fn views_go_to_their_own_and_other_parts_are_named() {
        let of = |name: &str, view: &str| named(name, view, row(vec![float("R", &[1.0, 0.0])]));
        let stereo = || frame(vec![of("l", "left"), of("r", "right")]);
        let mut whole = stereo();
        assert_eq!(add(&mut whole, "P", frame(vec![of("", "right")])), Ok(None));
        assert_eq!((names(&whole.parts[0]), names(&whole.parts[1])), ("R".into(), "P.R R".into()));
        let mut whole = stereo();
        assert_eq!(add(&mut whole, "P", stereo()), Ok(None));
        assert_eq!((names(&whole.parts[0]), names(&whole.parts[1])), ("P.R R".into(), "P.R R".into()));
        let mut one = frame(vec![of("l", "left")]);
        let left = add(&mut one, "P", stereo()).unwrap().unwrap();
        assert!(left.ends_with("left out: part 1 (r)"), "{left}");
        let wrong = frame(vec![of("", "right")]);
        assert!(add(&mut one, "Q", wrong).unwrap_err().contains("view"));
    }
}
