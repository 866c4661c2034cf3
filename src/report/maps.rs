//! The maps of a frame's differences: one EXR file with every map as values, and PNG files to look at.
//!
//! EXR, 32-bit floats, the parts, windows and aspect of the reference: `error.CHANNEL` (absolute, 0 where a value is not finite), `ssim.CHANNEL`, and for colours
//! `cieluv` and `flip` (with the group's components where the name is taken), each behind the name of its layer. PNG, grey: error 0 to 0.1 of the peak, CIELUV 0 to 20, SSIM 0 to
//! 1, FLIP 0 to 1.

use lacuna_exr::{Attribute, Attributes, Channel, Frame, Part, Samples};
use lacuna_filters::Plane;

use super::groups::Kind;
use super::images::Images;
use crate::channels::Name;
use crate::raster::{self, BitDepth, ColorType};

/// The part of the peak that is white in the picture of the absolute error.
const ERROR_RANGE: f32 = 0.1;
/// CIELUV error that is white, as in the thesis that lacuna follows.
const CIELUV_RANGE: f32 = 20.0;

/// What a part of maps has from that of the reference, beside its windows.
const LIKE: [&str; 6] =
    ["name", "view", "pixelAspectRatio", "screenWindowCenter", "screenWindowWidth", "chromaticities"];

/// PNG files and what their names end in.
type Pictures = Vec<(String, Vec<u8>)>;

/// The maps of one frame, collected group by group.
#[derive(Default)]
pub struct Maps {
    parts: Vec<(usize, Part)>,
    pictures: Pictures,
}

impl Maps {
    /// Takes the maps of a group.
    pub fn add(&mut self, images: &Images<'_>) {
        let report = images.report;
        let prefix = |map: &str| {
            if report.layer.is_empty() { map.to_owned() } else { format!("{}.{map}", report.layer) }
        };
        // Two groups of one layer, as colours and their luminance, would give both their maps one name.
        let of_group = |map: &str| {
            let known = self.parts.iter().filter(|(known, _)| *known == report.part);
            let mut channels = known.flat_map(|(_, part)| &part.channels);
            let name = prefix(map);
            let taken = channels.any(|one| one.name == name.as_bytes());
            let components = report.channels.iter().map(|name| Name::new(name).component);
            if taken { format!("{name}.{}", components.collect::<String>()) } else { name }
        };
        let mut errors = Vec::new();
        let mut channels = Vec::new();
        let all = images.reference.iter().zip(images.test).zip(images.similarity).zip(&report.channels);
        for (((reference, test), similarity), name) in all {
            let component = Name::new(name).component;
            let mut error = reference.clone();
            for (error, test) in error.pixels_mut().iter_mut().zip(test.pixels()) {
                *error = Some((*test - *error).abs()).filter(|error| error.is_finite()).unwrap_or(0.0);
            }
            channels.push(channel(&prefix(&format!("error.{component}")), &error));
            channels.push(channel(&prefix(&format!("ssim.{component}")), &similarity.map));
            errors.push(error);
        }
        let colours = [("cieluv", images.cieluv), ("flip", images.flip)];
        for (name, map) in colours.iter().filter_map(|(name, map)| Some((name, (*map)?))) {
            channels.push(channel(&of_group(name), map));
        }
        if report.kind == Kind::Colour {
            let similar: Vec<&Plane> = images.similarity.iter().map(|similarity| &similarity.map).collect();
            let peak = report.peak.unwrap_or(1.0);
            let errors: Vec<&Plane> = errors.iter().collect();
            self.picture(images, "error", &errors, peak * ERROR_RANGE, f32::max);
            self.picture(images, "ssim", &similar, 1.0, f32::min);
            for (name, map) in colours.iter().filter_map(|(name, map)| Some((name, (*map)?))) {
                let range = if *name == "cieluv" { CIELUV_RANGE } else { 1.0 };
                self.picture(images, name, &[map], range, f32::max);
            }
        }
        self.enter(images, channels);
    }

    fn enter(&mut self, images: &Images<'_>, channels: Vec<Channel>) {
        let index = images.report.part;
        if let Some((_, part)) = self.parts.iter_mut().find(|(known, _)| *known == index) {
            part.channels.extend(channels);
            return;
        }
        let mut attributes = Attributes::default();
        let like = |attribute: &&Attribute| LIKE.iter().any(|name| name.as_bytes() == attribute.name);
        for Attribute { name, kind, value } in images.part.attributes.iter().filter(like) {
            attributes.set(&String::from_utf8_lossy(name), &String::from_utf8_lossy(kind), value.clone());
        }
        let display_window = images.part.display_window;
        let part = Part { attributes, display_window, ..Part::new(images.part.data_window, channels) };
        self.parts.push((index, part));
    }

    /// A grey picture: of each pixel the worst of the planes, `range` white.
    fn picture(
        &mut self,
        images: &Images<'_>,
        name: &str,
        planes: &[&Plane],
        range: f32,
        worst: fn(f32, f32) -> f32,
    ) {
        let size = planes.first().map_or(lacuna_filters::Size::new(0, 0), |plane| plane.size());
        let grey = |at: usize| {
            let value = planes.iter().map(|plane| plane.pixels()[at]).reduce(worst).unwrap_or(0.0);
            (255.0 * (value / range).clamp(0.0, 1.0)).round() as u8
        };
        let bytes: Vec<u8> = (0..size.pixels()).map(grey).collect();
        let kind = (ColorType::Grayscale, BitDepth::Eight);
        if let Ok(png) = raster::png((size.width, size.height), kind, raster::Compression::Fast, &bytes) {
            let safe = |c: char| if c.is_alphanumeric() || ".-_".contains(c) { c } else { '-' };
            let label: String = images.report.label().chars().map(safe).collect();
            let numbered = (2..).map(|number| format!("{label}-{number}.{name}"));
            let mut names = std::iter::once(format!("{label}.{name}")).chain(numbered);
            // Labels may differ in the signs alone that names of files should not have.
            let free = names.find(|name| self.pictures.iter().all(|(other, _)| other != name));
            self.pictures.extend(free.map(|name| (name, png)));
        }
    }

    /// The EXR frame, and the pictures by name; nothing if no group had maps.
    pub fn finish(self) -> Option<(Frame, Pictures)> {
        let parts: Vec<Part> = self.parts.into_iter().map(|(_, part)| part).collect();
        (!parts.is_empty()).then_some((Frame { parts }, self.pictures))
    }
}

fn channel(name: &str, plane: &Plane) -> Channel {
    let samples = Samples::Float(plane.pixels().to_vec());
    Channel { name: name.as_bytes().to_vec(), perceptually_linear: false, samples }
}
