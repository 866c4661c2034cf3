//! How much each measured pixel counts where a filter smooths: by the samples that were taken in it.
//!
//! The mean of n samples has a variance of 1/n, so a pixel of n samples weighs n.

use std::str::FromStr;
use std::sync::Arc;

use lacuna_exr::{Frame, Part};
use lacuna_filters::Plane;

use super::Error;
use crate::channels::{list_channels, view_of, visible, without_view};

/// What `--weights` says: the channel that counts samples.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Weights {
    /// The channel's full name.
    pub channel: String,
}

/// Why a text names no weights.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' names no weights: write count:CHANNEL, such as count:SAMPLECOUNT")]
pub struct WeightsError(String);

impl FromStr for Weights {
    type Err = WeightsError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.strip_prefix("count:") {
            Some(channel) if !channel.is_empty() => Ok(Self { channel: channel.into() }),
            _ => Err(WeightsError(text.into())),
        }
    }
}

impl std::fmt::Display for Weights {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "count:{}", self.channel)
    }
}

impl Weights {
    /// The weights of a part's pixels in one of its views; nothing where another part of the frame has them alone, of other pixels.
    ///
    /// # Errors
    /// No such channel of the view in the frame.
    pub fn plane(&self, frame: &Frame, part: usize, view: Option<&str>) -> Result<Option<Arc<Plane>>, Error> {
        let own = &frame.parts[part];
        let alike = |other: &&Part| other.data_window == own.data_window;
        let named = |part: &Part| {
            let asked = without_view(part, &self.channel);
            let is = |name: &str| view_of(part, name).as_deref() == view && without_view(part, name) == asked;
            part.channels.iter().position(|channel| is(&channel.display_name()))
        };
        let mut parts = std::iter::once(own).chain(frame.parts.iter().filter(alike));
        let Some(samples) = parts.find_map(|part| named(part).map(|at| &part.channels[at].samples)) else {
            if frame.parts.iter().any(|part| named(part).is_some()) {
                return Ok(None);
            }
            let of_view = view.map_or_else(String::new, |view| format!(" of the view {}", visible(view)));
            let why = format!("no such channel{of_view}; there are {}", list_channels(frame));
            return Err(Error::Weights { weights: self.to_string(), why });
        };
        let plane = Plane::new(own.size(), samples.as_f32()).map_err(|_| Error::OtherFrame)?;
        Ok(Some(Arc::new(plane)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{float, frame, named, part, uint, window};

    #[test]
    fn texts_become_weights_and_come_back() {
        for text in ["count:SAMPLECOUNT", "count:a:b"] {
            assert_eq!(text.parse::<Weights>().unwrap().to_string(), text);
        }
        for text in ["", "count:", "SAMPLECOUNT", "variance:V"] {
            assert!(text.parse::<Weights>().is_err(), "{text}");
        }
    }

    #[test]
    fn each_view_has_its_own_counts() {
        let mut stereo = part(
            window(0, 0, 2, 1),
            vec![
                float("R", &[0.0; 2]),
                uint("n", &[3, 1]),
                float("right.R", &[0.0; 2]),
                uint("right.n", &[7, 2]),
            ],
        );
        let views: Vec<u8> = ["left", "right"]
            .iter()
            .flat_map(|view| [&(view.len() as u32).to_le_bytes(), view.as_bytes()].concat())
            .collect();
        stereo.attributes.set("multiView", "stringvector", views);
        let stereo = frame(vec![stereo]);
        for (channel, view, counts) in
            [("n", "left", [3.0, 1.0]), ("n", "right", [7.0, 2.0]), ("right.n", "left", [3.0, 1.0])]
        {
            let weights = Weights { channel: channel.into() };
            assert_eq!(
                weights.plane(&stereo, 0, Some(view)).unwrap().unwrap().pixels(),
                counts,
                "{channel} {view}"
            );
        }
        let error = Weights { channel: "n".into() }.plane(&stereo, 0, Some("top")).unwrap_err().to_string();
        assert!(error.contains("no such channel of the view top"), "{error}");
    }

    #[test]
    fn the_counts_are_found_over_the_same_pixels_only() {
        let colour = || named("colour", "", part(window(0, 0, 4, 1), vec![float("R", &[0.0; 4])]));
        let counted = |at: i32| named("count", "", part(window(at, 0, 4, 1), vec![uint("n", &[3, 1, 0, 8])]));
        let weights = Weights { channel: "n".into() };
        let plane = weights.plane(&frame(vec![colour(), counted(0)]), 0, None).unwrap().unwrap();
        assert_eq!(plane.pixels(), [3.0, 1.0, 0.0, 8.0]);
        assert!(weights.plane(&frame(vec![colour(), counted(1)]), 0, None).unwrap().is_none());
        let error = weights.plane(&frame(vec![colour()]), 0, None).unwrap_err().to_string();
        assert!(error.contains("count:n") && error.contains("no such channel"), "{error}");
    }
}
