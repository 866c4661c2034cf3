//! Which channels of a part its picture is made of.

use lacuna_exr::Part;

use super::names::{Name, rgb_place, words};
use super::rules::{is_albedo, is_light};

/// Layers of the colour itself, as renderers call them.
pub const MAIN: [&str; 3] = ["beauty", "combined", "rgba"];

/// What channels show; the more of it the picture itself, the less.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Shown {
    /// They are `R`, `G`, `B`.
    Colour,
    /// They are those of a layer of the colour itself.
    Main,
    /// They are colours of light of several layers.
    Lights,
    /// They are none of this.
    Other,
}

/// Of some channels of a part, in its order, those by which its pixels are judged: the colour, or what is nearest to it. Colours come in the order
/// R, G, B, as arrays have them: sums over channels round by their order.
pub fn shown(part: &Part, channels: &[usize]) -> (Shown, Vec<usize>) {
    let full = |channel: usize| part.channels[channel].display_name();
    let colours = || channels.iter().rev().copied().filter(|&channel| rgb_place(&full(channel)).is_some());
    let plain: Vec<usize> = channels
        .iter()
        .rev()
        .copied()
        .filter(|&channel| matches!(part.channels[channel].name.as_slice(), b"R" | b"G" | b"B"))
        .collect();
    if !plain.is_empty() {
        return (Shown::Colour, plain);
    }
    let layer = |channel: usize| Name::new(&full(channel)).layer.to_owned();
    let is_main = |layer: &str| words(layer).iter().any(|word| MAIN.contains(&word.as_str()));
    if let Some(main) = channels.iter().map(|&channel| layer(channel)).find(|layer| is_main(layer)) {
        let own: Vec<usize> = colours().filter(|&channel| layer(channel) == main).collect();
        if !own.is_empty() {
            return (Shown::Main, own);
        }
    }
    let is_lit = |channel: &usize| is_light(&full(*channel)) && !is_albedo(&full(*channel));
    let lights: Vec<usize> = colours().filter(is_lit).collect();
    if lights.is_empty() { (Shown::Other, channels.to_vec()) } else { (Shown::Lights, lights) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{float, part, window};

    #[test]
    fn the_colour_goes_first_then_its_layer_then_lights_then_anything() {
        let of = |names: &[&str]| {
            let all: Vec<usize> = (0..names.len()).collect();
            let part = part(window(0, 0, 1, 1), names.iter().map(|name| float(name, &[0.5])).collect());
            let (what, found) = shown(&part, &all);
            (what, found.into_iter().map(|at| names[at].to_owned()).collect::<Vec<_>>().join(" "))
        };
        let is = |names: &[&str], what: Shown, found: &str| assert_eq!(of(names), (what, found.to_owned()));
        is(&["A", "B", "G", "R", "diffuse.R"], Shown::Colour, "R G B");
        let blender =
            ["ViewLayer.AO.R", "ViewLayer.Combined.A", "ViewLayer.Combined.B", "ViewLayer.Combined.R"];
        is(&blender, Shown::Main, "ViewLayer.Combined.R ViewLayer.Combined.B");
        is(&["RGBA.R", "Z"], Shown::Main, "RGBA.R");
        is(
            &["albedo.R", "diffuse.B", "diffuse.R", "specular.R"],
            Shown::Lights,
            "specular.R diffuse.R diffuse.B",
        );
        is(&["RGBA.A", "Y"], Shown::Other, "RGBA.A Y");
    }
}
