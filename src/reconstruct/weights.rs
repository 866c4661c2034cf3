//! How much each measured pixel counts where a filter smooths: by the samples that were taken in it.
//!
//! The mean of n samples has a variance of 1/n, so a pixel of n samples weighs n. Weights are divided by their mean over the
//! measured pixels, so that the filters' settings mean what they mean without weights.

use std::str::FromStr;
use std::sync::Arc;

use lacuna_exr::{Frame, Part};
use lacuna_filters::{Mask, Plane};

use super::Error;
use crate::channels::{channel_label, list_channels};

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
    /// The weights of a part's pixels, 0 where nothing was counted, and how many measured pixels that are.
    ///
    /// # Errors
    /// No such channel in the part or in another one of its view and data window; nothing counted in any measured pixel.
    pub fn plane(&self, frame: &Frame, part: usize, mask: &Mask) -> Result<(Arc<Plane>, usize), Error> {
        let own = &frame.parts[part];
        let fail = |why: String| Error::Weights { weights: self.to_string(), why };
        let alike = |other: &&Part| other.data_window == own.data_window && other.view() == own.view();
        let named =
            |part: &Part| part.channels.iter().position(|c| c.display_name() == self.channel.as_str());
        let parts = std::iter::once(own).chain(frame.parts.iter().filter(alike));
        let samples = parts.into_iter().find_map(|part| named(part).map(|at| &part.channels[at].samples));
        let samples = samples.ok_or_else(|| {
            let what =
                if part == 0 { String::new() } else { format!(" of {}", channel_label(frame, part, 0)) };
            fail(format!("no such channel over the pixels{what}; there are {}", list_channels(frame)))
        })?;
        let counts = samples.as_f32();
        let usable = |count: f32| if count.is_finite() && count > 0.0 { count } else { 0.0 };
        let measured =
            || counts.iter().zip(mask.as_slice()).filter(|(_, flag)| **flag).map(|(&count, _)| usable(count));
        let sum: f64 = measured().map(f64::from).sum();
        let empty = measured().filter(|&count| count == 0.0).count();
        if sum <= 0.0 {
            return Err(fail("it counts no sample in any measured pixel".into()));
        }
        let mean = sum / (mask.count() - empty) as f64;
        let weights = counts.iter().map(|&count| (f64::from(usable(count)) / mean) as f32).collect();
        let plane = Plane::new(mask.size(), weights).map_err(|_| Error::OtherFrame)?;
        Ok((Arc::new(plane), empty))
    }
}

#[cfg(test)]
mod tests {
    use lacuna_filters::Size;

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
    fn counts_become_weights_of_mean_one() {
        let colour = || named("colour", "", part(window(0, 0, 4, 1), vec![float("R", &[0.0; 4])]));
        let counted = |values: &[u32]| named("count", "", part(window(0, 0, 4, 1), vec![uint("n", values)]));
        let mask = Mask::from_fn(Size::new(1, 4), |_, x| x < 3);
        let weights = Weights { channel: "n".into() };
        let both = |values: &[u32]| weights.plane(&frame(vec![colour(), counted(values)]), 0, &mask);
        let (plane, empty) = both(&[3, 1, 0, 8]).unwrap();
        assert_eq!((plane.pixels(), empty), (&[1.5, 0.5, 0.0, 4.0][..], 1));
        assert!(both(&[0, 0, 0, 9]).unwrap_err().to_string().contains("no sample"));
        let elsewhere = frame(vec![colour(), part(window(1, 0, 4, 1), vec![uint("n", &[1; 4])])]);
        let error = weights.plane(&elsewhere, 0, &mask).unwrap_err().to_string();
        assert!(error.contains("count:n") && error.contains("no such channel"), "{error}");
    }
}
