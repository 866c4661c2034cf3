//! `lacuna filters`: what there is to know of the filters, from their descriptors.

use std::fmt::Write;

use clap::Args;
use lacuna_filters::descriptor::{Descriptor, Memory, Range, Setting};
use lacuna_filters::{METHODS, Method};

use super::settings::FilterName;

const EXAMPLES: &str = "\
Examples:
  lacuna filters
  lacuna filters ss

docs/methods.md sets them side by side, with figures.";

/// List the filters, or say what there is to know of one
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct FiltersArgs {
    /// A filter
    #[arg(value_name = "NAME", hide_possible_values = true, help_heading = "Filter")]
    name: Option<FilterName>,
}

impl FiltersArgs {
    /// The list, or the page of a filter.
    pub fn text(&self) -> String {
        self.name.map_or_else(list, |name| page(name.0))
    }
}

/// One line a filter, the default first.
fn list() -> String {
    let mut text = String::new();
    for method in METHODS {
        writeln!(text, "{:<12} {}", method.name, method.help).unwrap_or_default();
    }
    text + "\nlacuna filters NAME says more of one; --filter NAME takes it.\n"
}

/// What it is, what it takes, its settings.
fn page(method: &'static Descriptor) -> String {
    let mut lines = vec![format!("{}: {}", method.name, method.help), String::new()];
    let takes = [
        (method.takes.guides, "guides"),
        (method.takes.weights, "weights of the samples, where it smooths"),
        (method.takes.gradients, "samples of the gradient"),
        (method.takes.dictionary, "a learned dictionary"),
    ];
    let takes: Vec<&str> = takes.into_iter().filter_map(|(does, what)| does.then_some(what)).collect();
    if !takes.is_empty() {
        lines.push(format!("Takes: {}.", takes.join("; ")));
    }
    let estimates = if method.held_out.is_some() { "yes" } else { "no, a fill takes too long" };
    lines.push(format!("Says how wrong it is: {estimates}."));
    let Memory { image, channel } = method.even;
    let holes = match method.uneven {
        uneven if uneven == method.even => String::new(),
        Memory { image, .. } => format!(" (up to {image} where the mask leaves holes)"),
    };
    lines.push(format!(
        "Memory: {image} bytes a pixel{holes} and {channel} a channel of a layer, beside the channels."
    ));
    let settings: Vec<_> = method.settings.iter().filter(|setting| !setting.flag.is_empty()).collect();
    if !settings.is_empty() {
        lines.extend([String::new(), "Settings:".into()]);
    }
    let plain = Method::of(method, &[]).ok();
    for setting in settings {
        let default = plain.as_ref().and_then(|plain| plain.get(setting.name));
        lines.extend(about(setting, default));
    }
    lines.join("\n") + "\n"
}

/// The lines of a setting.
fn about(setting: &Setting, default: Option<String>) -> Vec<String> {
    let value = if let Range::Switch = setting.range { String::new() } else { format!(" {}", setting.value) };
    let default =
        default.filter(|text| !text.is_empty()).map_or_else(String::new, |text| format!("; default {text}"));
    let mut lines = vec![format!("  --{}{value}", setting.flag), format!("      {}", setting.help)];
    match setting.range {
        Range::OneOf(choices) => {
            lines.extend(choices.iter().map(|choice| format!("      {}: {}", choice.name, choice.help)));
            lines.push(format!("      [{}]", default.trim_start_matches("; ")));
        }
        _ => lines.push(format!("      [{}{default}]", setting.values())),
    }
    if setting.smooths {
        lines.push("      Changes measured pixels where it is not zero or off.".into());
    }
    lines
}
