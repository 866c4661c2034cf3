//! Frames built by hand for unit tests.

use half::f16;
use lacuna_exr::{Channel, Frame, Part, Samples, Window};

/// A window by its first column and row, width and height.
pub fn window(x: i32, y: i32, width: i32, height: i32) -> Window {
    Window { x_min: x, y_min: y, x_max: x + width - 1, y_max: y + height - 1 }
}

/// A part whose display window is its data window.
pub fn part(window: Window, channels: Vec<Channel>) -> Part {
    Part::new(window, channels)
}

/// A part with a `name` and a `view`, empty for none.
pub fn named(name: &str, view: &str, mut part: Part) -> Part {
    if !name.is_empty() {
        part.attributes.set_text("name", name);
    }
    if !view.is_empty() {
        part.attributes.set_text("view", view);
    }
    part
}

/// A frame of parts.
pub fn frame(parts: Vec<Part>) -> Frame {
    Frame { parts }
}

/// A channel of 32-bit floats.
pub fn float(name: &str, values: &[f32]) -> Channel {
    Channel { name: name.into(), perceptually_linear: false, samples: Samples::Float(values.to_vec()) }
}

/// A channel of halves.
pub fn half(name: &str, values: &[f32]) -> Channel {
    let samples = Samples::Half(values.iter().map(|&value| f16::from_f32(value)).collect());
    Channel { name: name.into(), perceptually_linear: false, samples }
}

/// A channel of whole numbers.
pub fn uint(name: &str, values: &[u32]) -> Channel {
    Channel { name: name.into(), perceptually_linear: false, samples: Samples::Uint(values.to_vec()) }
}

/// The values of a channel of one part.
pub fn values(part: &Part, name: &str) -> Vec<f32> {
    part.channels.iter().find(|channel| channel.name == name.as_bytes()).unwrap().samples.as_f32()
}
