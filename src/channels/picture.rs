//! Which channels of a part its picture is made of.

use super::geometry::is_albedo;
use super::names::{Name, rgb_place, words};
use super::rules::is_light;

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

/// Of some channels of a part, in its order, by the names of all: those by which its pixels are judged, the colour, or what is nearest to it. Colours come
/// in the order R, G, B, as arrays have them: sums over channels round by their order.
pub fn shown(names: &[String], channels: &[usize]) -> (Shown, Vec<usize>) {
    let of = |holds: &dyn Fn(&str) -> bool| -> Vec<usize> {
        channels.iter().rev().copied().filter(|&channel| holds(&names[channel])).collect()
    };
    let is_main = |name: &str| words(Name::new(name).layer).iter().any(|word| MAIN.contains(&word.as_str()));
    let plain = of(&|name| matches!(name, "R" | "G" | "B"));
    if !plain.is_empty() {
        return (Shown::Colour, plain);
    }
    if let Some(first) = channels.iter().find(|&&channel| is_main(&names[channel])) {
        let layer = Name::new(&names[*first]).layer;
        let own = of(&|name| Name::new(name).layer == layer && rgb_place(name).is_some());
        if !own.is_empty() {
            return (Shown::Main, own);
        }
    }
    let lights = of(&|name| rgb_place(name).is_some() && is_light(name) && !is_albedo(name));
    if lights.is_empty() { (Shown::Other, channels.to_vec()) } else { (Shown::Lights, lights) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_colour_goes_first_then_its_layer_then_lights_then_anything() {
        let of = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
            let all: Vec<usize> = (0..names.len()).collect();
            let (what, found) = shown(&names, &all);
            (what, found.into_iter().map(|at| names[at].clone()).collect::<Vec<_>>().join(" "))
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
