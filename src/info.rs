//! What a frame holds and what filling it would do: the model of `lacuna info`, and its table.

use std::fmt::Write as _;

use lacuna_exr::{Frame, Layout, Part, Samples, Window};
use serde::Serialize;

use crate::channels::{Choice, Name, Rule, non_finite_among, non_finite_note, part_label, visible};
use crate::mask::{self, Masks};
use crate::reconstruct::{self, estimate};

/// A frame's parts and the mask that was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Info {
    /// Where the mask was found; nothing if there is none.
    pub mask: Option<String>,
    /// The names of the frame's own channels that are the mask.
    pub mask_channels: Vec<String>,
    /// Why there is no mask.
    pub mask_error: Option<String>,
    /// Measured pixels over all pixels that a mask serves, 0 to 1.
    pub density: Option<f64>,
    /// The parts, in file order.
    pub parts: Vec<PartInfo>,
    /// What else is worth saying.
    pub notes: Vec<String>,
}

/// One part.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PartInfo {
    /// Its name, if it has one.
    pub name: Option<String>,
    /// Its view, if it has one.
    pub view: Option<String>,
    /// The pixels that exist: first column, first row, last column, last row.
    pub data_window: [i32; 4],
    /// The pixels that are shown, likewise.
    pub display_window: [i32; 4],
    /// The compression's name.
    pub compression: &'static str,
    /// `scan lines`, or the size of the tiles.
    pub layout: String,
    /// Whether the file holds mip or rip levels.
    pub levels: bool,
    /// Measured pixels over all pixels, 0 to 1; nothing where no mask serves the part.
    pub density: Option<f64>,
    /// The filter that filled it, if one did.
    pub filled_by: Option<String>,
    /// Whether that filter enlarged it.
    pub enlarged: bool,
    /// What that fill was worth by its own estimate.
    pub estimate: Option<String>,
    /// What that fill copied from complete channels.
    pub copied: Option<String>,
    /// The guides that `fill` would take for it; those that do not predict count for nothing then.
    pub guides: Vec<String>,
    /// The channels, in file order.
    pub channels: Vec<ChannelInfo>,
}

/// One channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelInfo {
    /// The full name.
    pub name: String,
    /// `half`, `float` or `uint`.
    #[serde(rename = "type")]
    pub kind: &'static str,
    /// What would be done.
    pub rule: Rule,
    /// Why.
    pub why: String,
    /// Why no mask serves the channel; a channel that is not kept cannot be filled then.
    pub no_mask: Option<String>,
}

/// Describes a frame with the masks and rules found for it. Without a mask `choices` are those of empty [`Masks`].
pub fn describe(frame: &Frame, masks: Result<&Masks, &mask::Error>, choices: &[Vec<Choice>]) -> Info {
    let parts = frame.parts.iter().enumerate();
    let found = masks.ok();
    Info {
        mask: found.map(|masks| masks.origin.clone()),
        mask_channels: found.map(|masks| mask_channels(frame, masks)).unwrap_or_default(),
        mask_error: masks.err().map(|error| why_none(frame, error)),
        density: found.and_then(Masks::density),
        parts: parts
            .map(|(index, part)| part_info(part, index, found, choices.get(index).map_or(&[], Vec::as_slice)))
            .collect(),
        notes: found
            .map_or(&[][..], |masks| &masks.notes)
            .iter()
            .cloned()
            .chain(not_finite(frame, found, choices))
            .collect(),
    }
}

/// Of each part, how many values that should be numbers are not: of what is computed, the measured ones, or all without a mask.
fn not_finite(frame: &Frame, masks: Option<&Masks>, choices: &[Vec<Choice>]) -> Vec<String> {
    let note = |(index, (part, choices)): (usize, (&Part, &Vec<Choice>))| {
        let computed = part.channels.iter().zip(choices).enumerate();
        let computed = computed.filter(|(_, (_, choice))| matches!(choice.rule, Rule::Fill | Rule::Normal));
        let counts = computed.map(|(at, (channel, _))| {
            let mask = masks.and_then(|masks| masks.get(index, at));
            (channel.display_name(), non_finite_among(&channel.samples, mask.map(|mask| mask.as_slice())))
        });
        let said = match masks {
            None => ["value is not finite", "values are not finite"],
            Some(_) => ["measured value is not finite", "measured values are not finite"],
        };
        let note = non_finite_note(said, counts).into_iter().collect();
        reconstruct::prefixed(&part_label(frame, index), note)
    };
    frame.parts.iter().zip(choices).enumerate().flat_map(note).collect()
}

/// Why there is no mask: most often as there need be none.
fn why_none(frame: &Frame, error: &mask::Error) -> String {
    // A mask that is named and was not found, in a part that nobody filled.
    let is_named = |part: &Part| {
        part.attributes.text(mask::ATTRIBUTE).is_some() && mask::filled_by(part, None, 0).is_none()
    };
    match error {
        mask::Error::NotFound { hint: None, .. } if !frame.parts.iter().any(is_named) => {
            "none: the frame is taken for complete (--mask names one)".into()
        }
        error => error.to_string(),
    }
}

/// The different names of the channels that are masks in use.
fn mask_channels(frame: &Frame, masks: &Masks) -> Vec<String> {
    let mut names = Vec::new();
    for (part, channels) in frame.parts.iter().zip(&masks.mask_channels) {
        for channel in channels.iter().filter_map(|&at| part.channels.get(at)) {
            let name = channel.display_name().into_owned();
            if !names.contains(&name) {
                names.push(name);
            }
        }
    }
    names
}

fn part_info(part: &Part, index: usize, masks: Option<&Masks>, choices: &[Choice]) -> PartInfo {
    let corners = |window: Window| [window.x_min, window.y_min, window.x_max, window.y_max];
    let errors = reconstruct::error_channel(part);
    let channels = part.channels.iter().zip(choices).enumerate().map(|(number, (channel, choice))| {
        let name = channel.display_name().into_owned();
        let is_error = errors.as_deref() == Some(Name::new(&name).component);
        let reason = |masks: &Masks| masks.why_none.get(index)?.get(number)?.clone();
        ChannelInfo {
            name,
            kind: kind(&channel.samples),
            rule: choice.rule,
            why: if is_error { "estimated errors of the fill".into() } else { choice.why.clone() },
            no_mask: masks.and_then(reason).filter(|_| choice.rule != Rule::Keep),
        }
    });
    let filled_by = mask::filled_by(part, masks, index);
    PartInfo {
        name: part.name(),
        view: part.view(),
        data_window: corners(part.data_window),
        display_window: corners(part.display_window),
        compression: part.compression.name(),
        layout: match part.layout {
            Layout::ScanLines => "scan lines".into(),
            Layout::Tiles { width, height } => format!("tiles of {width}x{height}"),
        },
        levels: part.had_levels,
        density: masks.and_then(|masks| masks.part_density(index)),
        estimate: filled_by.as_ref().and_then(|_| part.attributes.text(estimate::ATTRIBUTE)),
        copied: filled_by
            .as_ref()
            .and_then(|_| reconstruct::copied_line(&crate::guides::copied(&part.attributes))),
        enlarged: filled_by.is_some() && reconstruct::is_enlarged(part),
        filled_by,
        guides: Vec::new(),
        channels: channels.collect(),
    }
}

/// The name of a channel's type.
pub fn kind(samples: &Samples) -> &'static str {
    match samples {
        Samples::Half(_) => "half",
        Samples::Float(_) => "float",
        Samples::Uint(_) => "uint",
    }
}

impl std::fmt::Display for Info {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let channels = match &*self.mask_channels {
            [] => String::new(),
            [one] if self.mask.as_ref() == Some(one) => String::new(),
            names => format!(" (channel {})", visible(&names.join(", "))),
        };
        match (&self.mask, &self.mask_error, self.density) {
            (Some(mask), _, Some(density)) => {
                writeln!(f, "mask: {}{channels}, density {:.2} %", visible(mask), density * 100.0)?;
            }
            (Some(mask), _, None) => {
                writeln!(f, "mask: {}{channels}, which serves no channel", visible(mask))?;
            }
            (None, Some(error), _) => writeln!(f, "mask: {}", visible(error))?,
            (None, None, _) => {}
        }
        for note in &self.notes {
            writeln!(f, "note: {}", visible(note))?;
        }
        for (index, part) in self.parts.iter().enumerate() {
            writeln!(f, "{}", head(index, part))?;
            if let Some(filter) = &part.filled_by {
                let how = if part.enlarged { "enlarged" } else { "filled" };
                writeln!(f, "  {how} by {}", visible(filter))?;
            }
            if let Some(estimate) = &part.estimate {
                writeln!(f, "  missing pixels by estimate: {}", visible(estimate))?;
            }
            if let Some(copied) = &part.copied {
                writeln!(f, "  copied: {}", visible(copied))?;
            }
            if !part.guides.is_empty() {
                writeln!(f, "  guides: {}", visible(&part.guides.join(", ")))?;
            }
            let width = |cell: fn(&ChannelInfo) -> usize| part.channels.iter().map(cell).max().unwrap_or(0);
            let name = width(|channel| visible(&channel.name).chars().count());
            for channel in &part.channels {
                let missing = channel.no_mask.as_ref().map(|why| format!("; NO MASK: {}", visible(why)));
                writeln!(
                    f,
                    "  {:name$}  {:5}  {:7}  {}{}",
                    visible(&channel.name),
                    channel.kind,
                    channel.rule,
                    visible(&channel.why),
                    missing.unwrap_or_default()
                )?;
            }
        }
        Ok(())
    }
}

/// The line above a part's channels.
fn head(index: usize, part: &PartInfo) -> String {
    let mut line = format!("part {index}");
    let window = |[x_min, y_min, x_max, y_max]: [i32; 4]| {
        let extent = |min: i32, max: i32| i64::from(max) - i64::from(min) + 1;
        format!("{}x{} at ({x_min}, {y_min})", extent(x_min, x_max), extent(y_min, y_max))
    };
    let mut add = |text: std::fmt::Arguments<'_>| {
        // Writing to a string does not fail.
        let _ = line.write_fmt(text);
    };
    if let Some(name) = &part.name {
        add(format_args!(" '{}'", visible(name)));
    }
    if let Some(view) = &part.view {
        add(format_args!(", view {}", visible(view)));
    }
    add(format_args!(", data {}", window(part.data_window)));
    if part.display_window != part.data_window {
        add(format_args!(", display {}", window(part.display_window)));
    }
    add(format_args!(", {}, {}", part.compression, part.layout));
    if part.levels {
        add(format_args!(", with levels"));
    }
    match part.density {
        Some(density) => add(format_args!(", density {:.2} %", density * 100.0)),
        None => add(format_args!(", no mask")),
    }
    line
}

#[cfg(test)]
#[path = "info/tests.rs"]
mod tests;
