//! What filling makes of any frame is what verifying expects of it, for every size, type, mask and value.

use half::f16;
use lacuna_exr::{Channel, Frame, Samples};
use lacuna_filters::baseline::{nearest, push_pull};
use lacuna_filters::{Method, Run};
use proptest::prelude::*;

use super::compare;
use crate::channels::choose;
use crate::mask::{Source, find};
use crate::reconstruct::{Domain, Error, Job, Kind, Plans, fill};
use crate::testing::{frame, part, window};

/// Names of every rule, with the siblings that some need.
const NAMES: &[&str] = &[
    "A",
    "B",
    "CryptoObject00.r",
    "N.X",
    "N.Y",
    "N.Z",
    "P.X",
    "R",
    "Z",
    "forward.u",
    "id",
    "samples",
    "x.mask",
];

/// Bits of all sorts: whole ones of any kind, tame values, zeros of both signs, the largest, none.
fn value() -> impl Strategy<Value = f32> {
    prop_oneof![
        6 => -2.0_f32..2.0,
        2 => Just(0.0_f32),
        1 => any::<u32>().prop_map(f32::from_bits),
        1 => prop_oneof![Just(-0.0_f32), Just(1.0), Just(f32::MAX), Just(f32::INFINITY), Just(65504.0)],
    ]
}

fn channel(name: &'static str, pixels: usize) -> impl Strategy<Value = Channel> {
    (0..3_u8, prop::collection::vec(value(), pixels)).prop_map(move |(kind, values)| {
        let samples = match kind {
            0 => Samples::Half(values.into_iter().map(f16::from_f32).collect()),
            1 => Samples::Float(values),
            _ => Samples::Uint(values.into_iter().map(f32::to_bits).collect()),
        };
        Channel { name: name.into(), perceptually_linear: false, samples }
    })
}

fn any_frame() -> impl Strategy<Value = Frame> {
    let shape = (1..8_i32, 1..8_i32, -5..5_i32, -5..5_i32);
    (shape, prop::sample::subsequence(NAMES, 1..NAMES.len())).prop_flat_map(
        |((width, height, x, y), names)| {
            let pixels = (width * height) as usize;
            let channels: Vec<_> = names.into_iter().map(|name| channel(name, pixels)).collect();
            let mask = prop::collection::vec(any::<bool>(), pixels);
            (channels, mask).prop_map(move |(mut channels, mask)| {
                let flags = mask.iter().map(|&flag| if flag { f16::ONE } else { f16::ZERO }).collect();
                let samples = Samples::Half(flags);
                channels.push(Channel { name: "mask".into(), perceptually_linear: false, samples });
                frame(vec![part(window(x, y, width, height), channels)])
            })
        },
    )
}

fn any_job() -> impl Strategy<Value = Job> {
    let kinds = prop_oneof![Just(None), Just(Some(Kind::Half)), Just(Some(Kind::Float))];
    let domains = prop_oneof![Just(Domain::Auto), Just(Domain::Linear), Just(Domain::Log)];
    (any::<bool>(), any::<bool>(), any::<bool>(), kinds, domains).prop_map(
        |(smooth, limit, drop_mask, kind, domain)| {
            let method =
                if smooth { Method::from(push_pull::Settings) } else { Method::from(nearest::Settings) };
            let guides = crate::guides::Asked::None;
            Job { domain, limit, kind, drop_mask, guides, ..Job::new(method) }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn every_filled_frame_passes(sparse in any_frame(), job in any_job()) {
        let masks = find(&sparse, &Source::Auto, None).unwrap();
        let choices = choose(&sparse, &masks.mask_channels, &[]);
        match fill(sparse.clone(), &masks, &choices, &job, &Plans::new(), &Run::default()) {
            Ok((filled, report)) => {
                let differences = compare(&sparse, &filled, &masks, &choices);
                prop_assert!(differences.is_empty(), "{}", differences[0]);
                prop_assert_eq!(report.parts.len(), 1);
            }
            Err(Error::EmptyMask { .. }) => prop_assert!(masks.is_empty()),
            Err(Error::NothingFinite { .. }) => {}
            Err(other) => prop_assert!(false, "{}", other),
        }
    }

    #[test]
    fn threads_do_not_change_a_bit(sparse in any_frame(), job in any_job()) {
        let masks = find(&sparse, &Source::Auto, None).unwrap();
        let choices = choose(&sparse, &masks.mask_channels, &[]);
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| fill(sparse.clone(), &masks, &choices, &job, &Plans::new(), &Run::default()))
        };
        let bits = |result: Result<(Frame, _), Error>| result.map(|(frame, report)| (format!("{frame:?}"), format!("{report:?}")));
        prop_assert_eq!(bits(with(1)), bits(with(5)));
    }
}
