//! A filter that stands in this file alone: what it takes to have its flags, help, results, settings' text and plan of memory is
//! the one line that names it in a list.

use std::sync::Arc;

use clap::{CommandFactory, Parser};
use lacuna_exr::WriteOptions;
use lacuna_filters::descriptor::{Choice, Field, Memory, Takes};
use lacuna_filters::{Filter, Mask, Outcome, Plan, Planes, Problem, Run, baseline::nearest};

use super::*;
use crate::channels::choose;
use crate::files::neighbours::NeighbourFile;
use crate::files::plan::Item;
use crate::mask::find;
use crate::reconstruct::{self, Job, Plans, Stamp};
use crate::run::memory::{Fill, to_fill};
use crate::testing::{float, frame, part, values, window};

#[derive(Clone, Debug)]
struct Flat {
    grey: f64,
    how: String,
}

static FLAT: Descriptor = Descriptor {
    held_out: None,
    name: "flat",
    help: "One grey everywhere",
    settings: &[
        Setting {
            name: "grey",
            flag: "flat-grey",
            value: "GREY",
            range: Range::NotNegative,
            help: "the grey of missing pixels, 0 or more",
            ..Setting::PLAIN
        },
        Setting {
            name: "how",
            flag: "flat-how",
            value: "HOW",
            range: Range::OneOf(&[
                Choice { name: "fast", help: "At once" },
                Choice { name: "slow", help: "Later" },
            ]),
            help: "when",
            ..Setting::PLAIN
        },
    ],
    even: Memory { image: 12_345, channel: 24 },
    uneven: Memory { image: 23_456, channel: 35 },
    takes: Takes::NOTHING,
    restores: false,
    new: || Box::new(Flat { grey: 0.25, how: "fast".into() }),
};

impl Configured for Flat {
    fn descriptor(&self) -> &'static Descriptor {
        &FLAT
    }

    fn field(&mut self, name: &str) -> Option<&mut dyn Field> {
        match name {
            "grey" => Some(&mut self.grey),
            "how" => Some(&mut self.how),
            _ => None,
        }
    }

    fn boxed(&self) -> Box<dyn Configured> {
        Box::new(self.clone())
    }
}

impl Filter for Flat {
    fn plan(&self, problem: &Problem, run: &Run<'_>) -> Result<Box<dyn Plan>, Error> {
        let start = nearest::Settings.plan(problem, run)?;
        Ok(Box::new(Planned { grey: self.grey as f32, mask: problem.mask.clone(), start }))
    }
}

struct Planned {
    grey: f32,
    mask: Arc<Mask>,
    start: Box<dyn Plan>,
}

impl Plan for Planned {
    fn reconstruct(&self, samples: &Planes, out: &mut Planes, run: &Run<'_>) -> Result<Outcome, Error> {
        let outcome = self.start.reconstruct(samples, out, run)?;
        for plane in out.as_mut_slice() {
            let missing = plane.pixels_mut().iter_mut().zip(self.mask.as_slice()).filter(|(_, flag)| !**flag);
            missing.for_each(|(value, _)| *value = self.grey);
        }
        Ok(outcome)
    }
}

#[derive(Clone, Copy, Debug)]
struct WithFlat;

impl Offer for WithFlat {
    fn methods() -> Vec<&'static Descriptor> {
        let mut methods = All::methods();
        methods.push(&FLAT);
        methods
    }
}

#[derive(Parser)]
struct Tool {
    #[command(flatten)]
    filter: FilterArgs<WithFlat>,

    #[command(flatten)]
    _baselines: BaselineArgs<WithFlat>,
}

fn method(line: &str) -> Result<Method, String> {
    let tool = Tool::try_parse_from(std::iter::once("tool").chain(line.split_whitespace()));
    tool.map_err(|error| error.to_string())?.filter.method(None).map_err(|usage| usage.0)
}

#[test]
fn it_has_its_flags_and_their_ranges() {
    let found = method("--filter flat --flat-grey 0.5 --flat-how slow").unwrap();
    assert_eq!((found.name(), found.settings().as_str()), ("flat", "grey=0.5 how=slow"));
    assert_eq!(method("--filter flat").unwrap().settings(), "grey=0.25 how=fast");
    assert_eq!(method("--flat-how slow").unwrap().settings(), "grey=0.25 how=slow");
    assert_eq!(method("").unwrap().name(), "auto");
    for (line, reason) in [
        ("--filter flat --flat-grey -1", "it must be a number of 0 or more"),
        ("--filter flat --flat-how never", "[possible values: fast, slow]"),
        (
            "--flat-grey 0.5 --ss-lambda 1",
            "--ss-lambda is a setting of --filter ss, --flat-grey is a setting of --filter flat: no filter has them all",
        ),
        ("--filter flat --ss-lambda 1", "--ss-lambda is a setting of --filter ss, but the filter is flat"),
        ("--filter ss --dict-restore", "--dict-restore is a setting of --filter dictionary and --filter dct"),
        ("--filter dct --dict-stride 17", "--dict-stride 17: it must be"),
    ] {
        let error = method(line).unwrap_err();
        assert!(error.contains(reason), "{line}: {error}");
    }
}

#[test]
fn it_has_its_help() {
    let help = Tool::command().render_long_help().to_string();
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    for text in [
        "- flat: One grey everywhere",
        "--flat-grey <GREY> flat: the grey of missing pixels, 0 or more [default: 0.25]",
        "- slow: Later",
        "--dict-error <ERROR> dictionary, dct: root mean squared error",
    ] {
        assert!(help.contains(text), "{text}: {help}");
    }
}

#[test]
fn studies_have_it_among_all() {
    let all = crate::cli::study::labels("all", &WithFlat::methods());
    assert!(all.iter().any(|label| label == "flat") && all.iter().all(|label| label != "dictionary"));
}

#[test]
fn frames_are_filled_with_it_and_say_so() {
    let flags: Vec<f32> = (0..16).map(|at| f32::from(u8::from(at % 3 == 0))).collect();
    let sparse = frame(vec![part(window(0, 0, 4, 4), vec![float("R", &[0.5; 16]), float("mask", &flags)])]);
    let job = Job::new(method("--filter flat --flat-grey 0.75").unwrap());
    let masks = find(&sparse, &job.mask, None).unwrap();
    let choices = choose(&sparse, &masks.mask_channels, &job.overrides);
    let filled = reconstruct::fill(sparse, &masks, &choices, &job, &Plans::new(), &Run::default()).unwrap().0;
    let red = values(&filled.parts[0], "R");
    assert!(red.iter().enumerate().all(|(at, value)| *value == if at % 3 == 0 { 0.5 } else { 0.75 }));
    let stamp = Stamp::read(&filled.parts[0].attributes).unwrap();
    assert_eq!((stamp.filter.as_str(), stamp.setting("grey").as_deref()), ("flat", Some("0.75")));
}

#[test]
fn memory_is_planned_with_its_bytes() {
    let file = tempfile::NamedTempFile::with_suffix(".exr").unwrap();
    let sparse = frame(vec![part(window(0, 0, 4, 4), vec![float("R", &[0.5; 16])])]);
    lacuna_exr::write(&sparse, file.path(), &WriteOptions::default()).unwrap();
    let (input, output) = (file.path().to_owned(), "filled.exr".into());
    let (layers, made_from) = (Vec::new(), Vec::new());
    let item = Item {
        number: None,
        input,
        output,
        mask: None,
        guides: None,
        layers,
        neighbours: Vec::new(),
        made_from,
    };
    let fill = Fill { holes: 0.5, ..Fill::default() };
    let needs = |method: &Method| to_fill(&item, method, fill);
    let plain = Method::named("pushpull", &[]).unwrap();
    let difference = needs(&method("--filter flat").unwrap()) - needs(&plain);
    let (other, flat) = (plain.memory(0.5), FLAT.memory(0.5));
    assert_eq!(flat.image, 17_901);
    assert_eq!(difference, 16 * (flat.image - other.image + flat.channel - other.channel));
    let neighbour = NeighbourFile { number: 2, input: item.input.clone(), mask: None, layers: Vec::new() };
    let beside = Item { neighbours: vec![neighbour; 3], ..item.clone() };
    // Each has to be read, and to stand beside the frame itself.
    assert!(to_fill(&beside, &plain, fill) > needs(&plain) + 3 * 16 * 8);
    // One of another size, one that is damaged and one without its mask are left out, and take nothing.
    let large = tempfile::NamedTempFile::with_suffix(".exr").unwrap();
    let other = frame(vec![part(window(0, 0, 64, 64), vec![float("R", &[0.5; 64 * 64])])]);
    lacuna_exr::write(&other, large.path(), &WriteOptions::default()).unwrap();
    let broken = tempfile::NamedTempFile::with_suffix(".exr").unwrap();
    let whole = std::fs::read(file.path()).unwrap();
    std::fs::write(broken.path(), &whole[..whole.len() - 8]).unwrap();
    let [large, broken] = [large.path(), broken.path()]
        .map(|path| NeighbourFile { input: path.to_owned(), ..beside.neighbours[0].clone() });
    let masked = NeighbourFile { mask: Some("no-mask.exr".into()), ..beside.neighbours[0].clone() };
    let useless = Item { neighbours: vec![large, broken, masked], ..item.clone() };
    assert!(to_fill(&useless, &plain, fill) < to_fill(&beside, &plain, fill) - 2 * 16 * 8);
    assert!(to_fill(&useless, &plain, fill) <= needs(&plain) + 16 * 8);
}
