//! Every lossless codec returns the bytes it was given, at every size.

use super::*;
use crate::SampleType;

fn channels() -> Vec<ChannelHeader> {
    let channel = |name: &str, kind| ChannelHeader { name: name.into(), kind, perceptually_linear: false };
    vec![channel("B", SampleType::Half), channel("Z", SampleType::Float), channel("id", SampleType::Uint)]
}

#[test]
fn lossless_codecs_round_trip() {
    for compression in
        [Compression::None, Compression::Rle, Compression::Zips, Compression::Zip, Compression::Piz]
    {
        let codec = Codec::new(compression, &channels());
        let mut decoder = Decoder::default();
        for (height, width) in [(1, 1), (1, 7), (5, 1), (16, 33), (32, 64)] {
            for noise in [1_usize, 3, 1000] {
                let size = Size::new(height, width);
                let raw: Vec<u8> = (0..codec.raw_length(size)).map(|i| (i * i / noise) as u8).collect();
                for level in [None, Some(4)] {
                    let mut packed = vec![1; 9];
                    let gather = |place: &mut [u8]| place.copy_from_slice(&raw);
                    Encoder::new(level).encode(&codec, size, gather, &mut packed).unwrap();
                    assert!(packed.len() <= raw.len());
                    assert_eq!(decoder.decode(&codec, size, &packed).unwrap(), raw, "{compression:?} {size}");
                }
            }
        }
    }
}

#[test]
fn garbage_is_an_error_and_silent() {
    for number in 0..10 {
        let codec = Codec::new(Compression::from_number(number).unwrap(), &channels());
        let garbage: Vec<u8> = (0..97_u32).map(|i| (i * 113 + 7) as u8).collect();
        // B44 makes pixels of anything long enough.
        if !(6..=7).contains(&number) {
            assert!(Decoder::default().decode(&codec, Size::new(8, 8), &garbage).is_err(), "{number}");
        }
    }
}
