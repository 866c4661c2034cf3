//! Frames for the tests of this folder: any types, windows, layouts and compressions, pixels of any bits.

use half::f16;
use proptest::prelude::*;

use super::{Attributes, Channel, Compression, Frame, Layout, Part, SampleType, Samples, Window};

/// Samples from a generator of bits: smooth stretches, noise, NaNs with payloads, infinities.
pub(super) fn samples(kind: SampleType, pixels: usize, seed: u64) -> Samples {
    let mut state = seed | 1;
    let bits = (0..pixels).map(|index| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        match seed % 3 {
            0 => (state >> 32) as u32,
            1 => 0x3c00_3c00 + (index as u32 / 7) * 0x1_0003,
            _ => 0,
        }
    });
    match kind {
        SampleType::Half => Samples::Half(bits.map(|bits| f16::from_bits(bits as u16)).collect()),
        SampleType::Float => Samples::Float(bits.map(f32::from_bits).collect()),
        SampleType::Uint => Samples::Uint(bits.collect()),
    }
}

pub(super) fn part(name: Option<&str>, window: Window, kinds: &[SampleType], seed: u64) -> Part {
    let mut attributes = Attributes::default();
    if let Some(name) = name {
        attributes.set_text("name", name);
    }
    let channel = |(index, kind): (usize, &SampleType)| Channel {
        name: format!("layer.{index}").into_bytes(),
        perceptually_linear: index == 1,
        samples: samples(*kind, window.size().pixels(), seed + index as u64),
    };
    Part {
        attributes,
        data_window: window,
        display_window: Window { x_min: 3, y_min: -2, x_max: 40, y_max: 30 },
        compression: Compression::Zip,
        layout: Layout::ScanLines,
        channels: kinds.iter().enumerate().map(channel).collect(),
        had_levels: false,
    }
}

/// A window of that size, anywhere.
pub(super) fn window(left: i32, top: i32, width: usize, height: usize) -> Window {
    Window { x_min: left, y_min: top, x_max: left + width as i32 - 1, y_max: top + height as i32 - 1 }
}

fn any_part(name: Option<String>) -> impl Strategy<Value = Part> {
    let kind = prop_oneof![Just(SampleType::Half), Just(SampleType::Float), Just(SampleType::Uint)];
    let window = (-100..100_i32, -100..100_i32, 1..=70_usize, 1..=70_usize)
        .prop_map(|(left, top, width, height)| window(left, top, width, height));
    let layout = prop_oneof![
        Just(Layout::ScanLines),
        (1..40_u32, 1..40_u32).prop_map(|(width, height)| Layout::Tiles { width, height }),
    ];
    let compression = prop::sample::select(vec![
        Compression::None,
        Compression::Rle,
        Compression::Zips,
        Compression::Zip,
        Compression::Piz,
    ]);
    let kinds = prop::collection::vec(kind, 1..5);
    (kinds, window, layout, compression, 0..3_u8, any::<u32>()).prop_map(
        move |(kinds, window, layout, compression, order, seed)| {
            let mut part = part(name.as_deref(), window, &kinds, u64::from(seed));
            part.layout = layout;
            part.compression = compression;
            part.attributes.set("lineOrder", "lineOrder", vec![order]);
            part.attributes.set("kürzel", "unknown type", vec![0, 255, 7]);
            part
        },
    )
}

/// Frames of one to three parts.
pub(super) fn any_frame() -> impl Strategy<Value = Frame> {
    let several = (2..=3_usize).prop_flat_map(|count| {
        (0..count).map(|index| any_part(Some(format!("part {index}")))).collect::<Vec<_>>()
    });
    prop_oneof![any_part(None).prop_map(|part| vec![part]), several].prop_map(|parts| Frame { parts })
}

/// Fails unless the frames agree in everything that the types hold, attributes aside.
pub(super) fn assert_same_pixels(a: &Frame, b: &Frame) {
    assert_eq!(a.parts.len(), b.parts.len());
    for (a, b) in a.parts.iter().zip(&b.parts) {
        assert_eq!((a.data_window, a.display_window), (b.data_window, b.display_window));
        assert_eq!((a.compression, a.layout, a.had_levels), (b.compression, b.layout, b.had_levels));
        assert_eq!(a.channels.len(), b.channels.len());
        for (a, b) in a.channels.iter().zip(&b.channels) {
            assert_eq!((&a.name, a.perceptually_linear), (&b.name, b.perceptually_linear));
            assert!(a.samples.same_bits(&b.samples), "{}", a.display_name());
        }
    }
}
