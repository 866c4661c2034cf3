//! What is kept of a frame beside one: of channels that are filled the measured samples, of complete ones those that tell where surfaces are and how
//! they move, and of guides what they are at measured pixels. All else would only take memory, for every frame of the window.

use std::sync::Arc;

use half::f16;
use lacuna_exr::{Frame, Part, SampleType, Samples};
use lacuna_filters::Mask;

use crate::channels::{self, Rule};
use crate::mask::Masks;

/// The samples of a frame that others need, by part and channel.
#[derive(Clone, Debug)]
pub struct KeptSamples {
    kept: Vec<Vec<Kept>>,
}

/// Those of a channel.
#[derive(Clone, Debug)]
enum Kept {
    None,
    All(Samples),
    /// Of the pixels of its mask, in the order of rows.
    Measured(Samples),
    /// Of the pixels of any mask of its part, in the order of rows.
    Guide(Samples, Arc<Mask>),
}

impl KeptSamples {
    /// Takes them out of a frame, whose channels keep none; those of complete channels that may guide only if that is wanted.
    pub fn take_from(frame: &mut Frame, masks: &Masks, guides: bool) -> Self {
        let one = |(index, part): (usize, &mut Part)| {
            let dense = channels::dense(part);
            let any = guides.then(|| masks.any(index)).flatten();
            let kept = |at: usize| {
                let channel = &part.channels[at];
                let is_dense = dense.iter().any(|name| *name == channel.display_name());
                let is_read = !masks.is_mask_channel(index, at) && channel.samples.kind() != SampleType::Uint;
                match masks.get(index, at).filter(|_| is_read) {
                    Some(mask) if !is_dense => Kept::Measured(measured(&channel.samples, mask)),
                    _ if leads(part, at) => Kept::All(channel.samples.clone()),
                    _ => match any.as_ref().filter(|_| is_read && is_dense) {
                        Some(any) => Kept::Guide(measured(&channel.samples, any), Arc::clone(any)),
                        None => Kept::None,
                    },
                }
            };
            let all = (0..part.channels.len()).map(kept).collect();
            part.channels.iter_mut().for_each(|channel| channel.samples = none_like(&channel.samples));
            all
        };
        Self { kept: frame.parts.iter_mut().enumerate().map(one).collect() }
    }

    /// The values of a channel of floats, 0 where they are not kept.
    pub fn floats(&self, part: usize, channel: usize, mask: Option<&Mask>) -> Option<Vec<f32>> {
        match self.kept.get(part)?.get(channel)? {
            Kept::None => None,
            Kept::All(samples) => samples.to_floats(),
            Kept::Measured(samples) => spread(samples, mask?),
            Kept::Guide(samples, any) => spread(samples, any),
        }
    }
}

/// Samples of the pixels of a mask where they are, and 0 elsewhere.
fn spread(samples: &Samples, mask: &Mask) -> Option<Vec<f32>> {
    let mut values = vec![0.0; mask.size().pixels()];
    let measured = values.iter_mut().zip(mask.as_slice()).filter(|(_, flag)| **flag);
    measured.zip(samples.to_floats()?).for_each(|((value, _), sample)| *value = sample);
    Some(values)
}

/// Whether a channel may say where surfaces are or how they move.
fn leads(part: &Part, channel: usize) -> bool {
    channels::by_default(part, channel).0 == Rule::Depth || channels::motion_axis(part, channel).is_some()
}

fn measured(samples: &Samples, mask: &Mask) -> Samples {
    fn few<T: Copy>(values: &[T], mask: &Mask) -> Vec<T> {
        let mut few = Vec::with_capacity(mask.count());
        few.extend(values.iter().zip(mask.as_slice()).filter(|(_, flag)| **flag).map(|(value, _)| *value));
        few
    }
    match samples {
        Samples::Half(values) => Samples::Half(few(values, mask)),
        Samples::Float(values) => Samples::Float(few(values, mask)),
        Samples::Uint(values) => Samples::Uint(few(values, mask)),
    }
}

fn none_like(samples: &Samples) -> Samples {
    match samples {
        Samples::Half(_) => Samples::Half(Vec::<f16>::new()),
        Samples::Float(_) => Samples::Float(Vec::new()),
        Samples::Uint(_) => Samples::Uint(Vec::new()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mask::{self, Source};
    use crate::testing::{float, frame, half, part, uint, values, window};

    #[test]
    fn what_others_need_is_kept_and_nothing_else() {
        let channels = vec![
            half("R", &[0.5, 0.0, 2.0, f32::NAN]),
            float("Z", &[1.0, 2.0, 3.0, 4.0]),
            float("albedo.R", &[5.0; 4]),
            uint("id", &[7; 4]),
            half("mask", &[1.0, 0.0, 0.0, 1.0]),
            float("motion.X", &[1.0, 2.0, 3.0, 4.0]),
        ];
        let mut own = frame(vec![part(window(0, 0, 2, 2), channels)]);
        own.parts[0].attributes.set_text(channels::DENSE, "Z, albedo.R");
        let masks = mask::find(&own, &Source::Auto, None).unwrap();
        let before = own.clone();
        let kept = |guides: bool| KeptSamples::take_from(&mut before.clone(), &masks, guides);
        assert_eq!(kept(true).floats(0, 2, None).unwrap(), [5.0, 0.0, 0.0, 5.0]);
        assert_eq!(kept(true).floats(0, 3, None), None);
        let few = KeptSamples::take_from(&mut own, &masks, false);
        let floats = |at: usize| few.floats(0, at, masks.get(0, at).map(|mask| &**mask));
        let found = floats(0).unwrap();
        assert_eq!([found[0], found[1], found[2]], [0.5, 0.0, 0.0]);
        assert!(found[3].is_nan());
        assert_eq!(floats(1).unwrap(), values(&before.parts[0], "Z"));
        assert_eq!([floats(2), floats(3), floats(4)], [None, None, None]);
        assert_eq!(floats(5).unwrap(), [1.0, 0.0, 0.0, 4.0]);
        assert!(own.parts[0].channels.iter().all(|channel| channel.samples.is_empty()));
        assert_eq!(own.parts[0].channels[3].samples.kind(), before.parts[0].channels[3].samples.kind());
    }
}
