//! Very large parts, filled in bands of rows, so that only the frame itself is in memory as a whole.
//!
//! A part of more than `WHOLE` pixels is filled band by band, whatever memory there is: the bands belong to the result. Each is filled as a
//! part of its own with `MARGIN` rows more at either side, and its own rows are taken. What is decided over a whole part is decided
//! over a band: the domain, what a blend chooses, how much is smoothed, the estimate. A band without a usable sample takes more rows.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use half::f16;
use lacuna_exr::{Channel, Frame, Part, Samples};
use lacuna_filters::variational::guided::Guides;
use lacuna_filters::{Mask, Plane, Size};

use super::part::{self, Done, Work};
use super::{Error, Estimated, PartReport, Plans};
use crate::guides::{self, Guide};
use crate::mask::Masks;

/// Parts of no more pixels are filled as a whole: 8192 x 8192.
const WHOLE: usize = 1 << 26;
/// Pixels of a band, its margins left out.
const BAND: usize = 1 << 23;
/// Rows that a band sees at either side.
const MARGIN: usize = 96;

/// Pixels that are filled at a time in a part of that size.
pub fn pixels_at_a_time(size: Size) -> u64 {
    let pixels = (size.height as u64).saturating_mul(size.width as u64);
    if pixels <= WHOLE as u64 { pixels } else { ((rows(size, BAND) + 2 * MARGIN) as u64) * size.width as u64 }
}

fn rows(size: Size, band: usize) -> usize {
    (band / size.width.max(1)).max(MARGIN)
}

/// Fills one part of a frame, in place.
pub fn fill(frame: &mut Frame, work: &Work<'_>, guides: &[Guide]) -> Result<Done, Error> {
    fill_by(frame, work, guides, (WHOLE, BAND))
}

/// The same with other bounds.
fn fill_by(
    frame: &mut Frame,
    work: &Work<'_>,
    guides: &[Guide],
    (whole, band): (usize, usize),
) -> Result<Done, Error> {
    let size = frame.parts[work.index].size();
    // Samples of other frames may come from any row.
    if size.pixels() <= whole || work.neighbours.is_some_and(|found| !found.all.is_empty()) {
        let found = collect(frame, work, guides, size)?;
        return part::fill(frame, &Work { guides: &found, ..*work });
    }
    let step = rows(size, band);
    let mut merged = Merged::default();
    // The last rows before a band as they came: the frame has them filled already.
    let mut before = Vec::new();
    for first in (0..size.height).step_by(step) {
        let own = first..size.height.min(first + step);
        let mut margin = MARGIN;
        let (band, filled) = loop {
            let rows = own.start.saturating_sub(margin)..size.height.min(own.end.saturating_add(margin));
            let band = Band { own: own.clone(), rows };
            match band.fill(frame, work, guides, &before) {
                Err(error) if band.rows != (0..size.height) && lacks_samples(&error) => {
                    margin = margin.saturating_mul(8);
                }
                filled => break (band, filled?),
            }
        };
        let last = own.end.saturating_sub(MARGIN).max(own.start)..own.end;
        let part = &mut frame.parts[work.index];
        before = part.channels.iter().map(|channel| taken(&channel.samples, size.width, &last)).collect();
        merged.take(filled, &band, part);
    }
    Ok(merged.end(&mut frame.parts[work.index], size))
}

/// Whether a band may be filled with more rows.
fn lacks_samples(error: &Error) -> bool {
    use lacuna_filters::Error::{EmptyMask, NothingFinite};
    match error {
        Error::EmptyMask { .. } | Error::NothingFinite { .. } => true,
        Error::Filter { source, .. } => matches!(source, EmptyMask | NothingFinite { .. }),
        _ => false,
    }
}

/// The guides of a part, or of a band of it, for each of its views.
fn collect(
    frame: &Frame,
    work: &Work<'_>,
    guides: &[Guide],
    size: Size,
) -> Result<Vec<(Option<String>, Guides)>, Error> {
    let label = || crate::channels::part_label(frame, work.index);
    let of = |view: Option<String>| {
        let own = guides.iter().filter(|guide| guide.serves(view.as_deref()));
        Ok((view.clone(), guides::collect(own, frame, work.second, size)?))
    };
    let all = crate::channels::views(&frame.parts[work.index]).into_iter().map(of);
    all.collect::<Result<_, _>>().map_err(|source| Error::Filter { channel: label(), source })
}

/// Rows of a part.
struct Band {
    /// Those that it fills.
    own: Range<usize>,
    /// Those that it sees.
    rows: Range<usize>,
}

impl Band {
    /// Fills it by itself; `before` holds the rows before its own as they came.
    fn fill(
        &self,
        frame: &Frame,
        work: &Work<'_>,
        guides: &[Guide],
        before: &[Samples],
    ) -> Result<(Done, Part), Error> {
        let window = frame.parts[work.index].data_window;
        let width = window.size().width;
        let cut = |part: &Part| self.cut(part, part.data_window == window);
        let mut band = Frame { parts: frame.parts.iter().map(cut).collect() };
        for (channel, rows) in band.parts[work.index].channels.iter_mut().zip(before) {
            put(&mut channel.samples, rows, (self.own.start - self.rows.start) * width - rows.len());
        }
        let second = work.second.map(|second| Frame { parts: second.parts.iter().map(cut).collect() });
        let (masks, plans) = (self.masks(work, width), Plans::new());
        let work = Work { masks: &masks, second: second.as_ref(), plans: &plans, ..*work };
        let found = collect(&band, &work, guides, band.parts[work.index].size())?;
        let done = part::fill(&mut band, &Work { guides: &found, ..work })?;
        Ok((done, band.parts.swap_remove(work.index)))
    }

    /// The rows of a part that lies where the filled one does; any other guides nothing and stays without pixels.
    fn cut(&self, part: &Part, same: bool) -> Part {
        let rows = if same { self.rows.clone() } else { 0..0 };
        let mut window = part.data_window;
        if same {
            window.y_max = (i64::from(window.y_min) + self.rows.end as i64 - 1) as i32;
            window.y_min = (i64::from(window.y_min) + self.rows.start as i64) as i32;
        }
        let width = window.size().width;
        let channel = |channel: &Channel| Channel {
            name: channel.name.clone(),
            perceptually_linear: channel.perceptually_linear,
            samples: taken(&channel.samples, width, &rows),
        };
        Part {
            attributes: part.attributes.clone(),
            data_window: window,
            display_window: part.display_window,
            compression: part.compression,
            layout: part.layout,
            channels: part.channels.iter().map(channel).collect(),
            had_levels: part.had_levels,
        }
    }

    /// The masks of the part's channels over these rows; what is one mask stays one.
    fn masks(&self, work: &Work<'_>, width: usize) -> Masks {
        let own = work.masks.channels.get(work.index).map_or(&[][..], Vec::as_slice);
        let mut known: Vec<(*const Mask, Arc<Mask>)> = Vec::new();
        let mut channels = vec![Vec::new(); work.masks.channels.len()];
        channels[work.index] = own
            .iter()
            .map(|mask| {
                let mask = mask.as_ref()?;
                if let Some((_, cut)) = known.iter().find(|(whole, _)| *whole == Arc::as_ptr(mask)) {
                    return Some(Arc::clone(cut));
                }
                let size = Size::new(self.rows.len(), width);
                let cut = Mask::from_fn(size, |y, x| mask.is_measured(self.rows.start + y, x));
                known.push((Arc::as_ptr(mask), Arc::new(cut)));
                known.last().map(|(_, cut)| Arc::clone(cut))
            })
            .collect();
        let Masks { origin, mask_channels, why_none, notes, .. } = work.masks;
        Masks {
            channels,
            origin: origin.clone(),
            mask_channels: mask_channels.clone(),
            why_none: why_none.clone(),
            notes: notes.clone(),
        }
    }
}

/// What was done to the bands so far.
#[derive(Default)]
struct Merged {
    report: Option<PartReport>,
    converted: bool,
    notes: Vec<String>,
    bands: usize,
    /// Channels that have another type now.
    changed: BTreeMap<usize, Samples>,
    /// The estimated error of layers.
    errors: Vec<(String, Plane)>,
    untold: Vec<(Vec<String>, String)>,
}

impl Merged {
    /// Puts the rows of a band into the part, and what was done beside what was done before.
    fn take(&mut self, (done, filled): (Done, Part), band: &Band, part: &mut Part) {
        let Size { width, height } = part.size();
        let upper = (band.own.start - band.rows.start) * width;
        let inside = upper / width..upper / width + band.own.len();
        for (at, (channel, filled)) in part.channels.iter_mut().zip(&filled.channels).enumerate() {
            let rows = taken(&filled.samples, width, &inside);
            let place = if rows.kind() == channel.samples.kind() {
                &mut channel.samples
            } else {
                self.changed.entry(at).or_insert_with(|| zeros(&rows, width * height))
            };
            put(place, &rows, band.own.start * width);
        }
        for (name, error) in done.errors {
            let known = self.errors.iter().position(|(known, _)| *known == name).unwrap_or_else(|| {
                self.errors.push((name, Plane::filled(Size::new(height, width), 0.0)));
                self.errors.len() - 1
            });
            let rows = &error.pixels()[upper..upper + band.own.len() * width];
            self.errors[known].1.pixels_mut()[band.own.start * width..][..rows.len()].copy_from_slice(rows);
        }
        for untold in done.untold {
            if !self.untold.contains(&untold) {
                self.untold.push(untold);
            }
        }
        let mut report = done.report;
        // What was counted in the margins is taken off by their share.
        let share = |count: &mut usize| *count = count.saturating_mul(band.own.len()) / band.rows.len();
        for channel in &mut report.channels {
            [&mut channel.filled, &mut channel.non_finite, &mut channel.limited, &mut channel.clamped_halves]
                .into_iter()
                .for_each(share);
        }
        match &mut self.report {
            None => self.report = Some(report),
            Some(all) => add(all, report, (band.own.start, band.own.len())),
        }
        self.converted |= done.converted;
        self.bands += 1;
        for note in done.notes {
            if !self.notes.contains(&note) {
                self.notes.push(note);
            }
        }
    }

    /// All of it.
    fn end(mut self, part: &mut Part, size: Size) -> Done {
        for (at, samples) in self.changed {
            part.channels[at].samples = samples;
        }
        self.notes.push(format!("filled in {} bands of rows, as it has {size} pixels", self.bands));
        Done {
            report: self.report.unwrap_or_default(),
            converted: self.converted,
            notes: self.notes,
            remarks: Vec::new(),
            errors: self.errors,
            untold: self.untold,
        }
    }
}

/// Shares of so many rows, and of so many more.
fn mix(known: &mut Vec<(String, f64)>, more: Vec<(String, f64)>, (before, own): (usize, usize)) {
    let all = (before + own) as f64;
    for (_, share) in known.iter_mut() {
        *share *= before as f64 / all;
    }
    for (name, share) in more {
        let share = share * own as f64 / all;
        match known.iter_mut().find(|(other, _)| *other == name) {
            Some((_, sum)) => *sum += share,
            None => known.push((name, share)),
        }
    }
    known.sort_by(|a, b| b.1.total_cmp(&a.1));
}

/// Adds the report of a band; `rows` are those before it and its own.
fn add(all: &mut PartReport, band: PartReport, rows: (usize, usize)) {
    for (all, band) in all.channels.iter_mut().zip(band.channels) {
        all.filled += band.filled;
        all.non_finite += band.non_finite;
        all.limited += band.limited;
        all.largest_move = all.largest_move.max(band.largest_move);
        all.clamped_halves += band.clamped_halves;
    }
    // Bands that miss nothing of a channel do not tell that it was copied.
    all.copied
        .extend(band.copied.into_iter().filter(|copied| !all.copied.contains(copied)).collect::<Vec<_>>());
    for band in band.groups {
        let Some(known) = all.groups.iter_mut().find(|known| known.channels == band.channels) else {
            all.groups.push(band);
            continue;
        };
        known.outcome = known.outcome.worst(band.outcome);
        known.domain = if known.domain == band.domain { known.domain } else { "mixed" };
        for guide in band.guides {
            if !known.guides.contains(&guide) {
                known.guides.push(guide);
            }
        }
        for settled in band.settled {
            if !known.settled.contains(&settled) {
                known.settled.push(settled);
            }
        }
        // Of what is estimated the worst band speaks for all.
        known.guides_gain = known.guides_gain.zip(band.guides_gain).map(|(a, b)| a.min(b));
        known.estimate = worse(known.estimate.take(), band.estimate);
        known.energy = known.energy.or(band.energy);
        mix(&mut known.chosen, band.chosen, rows);
    }
}

/// The larger of two estimated errors; one that cannot be told is larger than any.
fn worse(a: Option<Estimated>, b: Option<Estimated>) -> Option<Estimated> {
    let error = |estimated: &Option<Estimated>| match estimated {
        Some(Estimated::Error { rmse, .. }) => rmse.estimate,
        Some(Estimated::Bound { rmse_at_most, .. }) => *rmse_at_most,
        Some(Estimated::Unknown { .. }) => f64::INFINITY,
        Some(Estimated::Copied { .. }) => 0.0,
        None => f64::NEG_INFINITY,
    };
    if error(&b) > error(&a) { b } else { a }
}

/// Some rows of a channel.
fn taken(samples: &Samples, width: usize, rows: &Range<usize>) -> Samples {
    let range = rows.start * width..rows.end * width;
    match samples {
        Samples::Half(values) => Samples::Half(values[range].to_vec()),
        Samples::Float(values) => Samples::Float(values[range].to_vec()),
        Samples::Uint(values) => Samples::Uint(values[range].to_vec()),
    }
}

/// Puts samples of the same type into a channel from that place on.
fn put(samples: &mut Samples, new: &Samples, from: usize) {
    match (samples, new) {
        (Samples::Half(old), Samples::Half(new)) => old[from..][..new.len()].copy_from_slice(new),
        (Samples::Float(old), Samples::Float(new)) => old[from..][..new.len()].copy_from_slice(new),
        (Samples::Uint(old), Samples::Uint(new)) => old[from..][..new.len()].copy_from_slice(new),
        _ => {}
    }
}

/// A channel of that type.
fn zeros(like: &Samples, pixels: usize) -> Samples {
    match like {
        Samples::Half(_) => Samples::Half(vec![f16::ZERO; pixels]),
        Samples::Float(_) => Samples::Float(vec![0.0; pixels]),
        Samples::Uint(_) => Samples::Uint(vec![0; pixels]),
    }
}

#[cfg(test)]
mod tests {
    use lacuna_filters::{Method, Run};

    use super::*;
    use crate::channels::choose;
    use crate::mask::find;
    use crate::reconstruct::{Job, Kind, twins};
    use crate::testing::{float, frame, half, part, uint, values, window};

    const SIZE: Size = Size { height: 700, width: 40 };

    /// Colour, a depth and an identifier, a third of them measured; none in the middle rows where there is a gap.
    fn sparse(gap: Range<usize>) -> Frame {
        let all = |value: &dyn Fn(usize, usize) -> f32| -> Vec<f32> {
            (0..SIZE.pixels()).map(|i| value(i / SIZE.width, i % SIZE.width)).collect()
        };
        let measured =
            |y: usize, x: usize| !gap.contains(&y) && (y * 7919 + x * 104_729 + y * x * 31) % 10 < 3;
        let seen =
            |value: &dyn Fn(usize, usize) -> f32| all(&|y, x| if measured(y, x) { value(y, x) } else { 0.0 });
        let ids: Vec<u32> = (0..SIZE.pixels())
            .map(|i| u32::from(measured(i / SIZE.width, i % SIZE.width)) * (1 + i as u32 / 9000))
            .collect();
        let wave = |y: usize, x: usize| 0.5 + 0.3 * (y as f32 / 23.0).sin() * (x as f32 / 9.0).cos();
        frame(vec![part(
            window(-3, 11, SIZE.width as i32, SIZE.height as i32),
            vec![
                half("G", &seen(&|y, x| 0.5 * wave(y, x))),
                half("R", &seen(&wave)),
                float("Z", &seen(&|y, _| 1.0 + (y / 100) as f32)),
                uint("id", &ids),
                half("mask", &all(&|y, x| f32::from(u8::from(measured(y, x))))),
            ],
        )])
    }

    fn filled(mut frame: Frame, job: &Job, bounds: (usize, usize)) -> (Frame, Done) {
        let masks = find(&frame, &job.mask, None).unwrap();
        let choices = choose(&frame, &masks.mask_channels, &[]);
        let (plans, run) = (Plans::new(), Run::default());
        let work = Work::alone((0, &masks, &choices[0]), &[], job, &plans, &run);
        let done = fill_by(&mut frame, &work, &[], bounds).unwrap();
        (frame, done)
    }

    #[test]
    fn bands_are_the_whole_but_for_what_the_solver_leaves() {
        for kind in [None, Some(Kind::Float)] {
            let mut job = Job::new(Method::named("ss", &[]).unwrap());
            job.kind = kind;
            let (whole, told) = filled(sparse(0..0), &job, (usize::MAX, 0));
            let (banded, done) = filled(sparse(0..0), &job, (0, 200 * SIZE.width));
            let (a, b) = (&whole.parts[0], &banded.parts[0]);
            assert_eq!((a.data_window, a.channels.len()), (b.data_window, b.channels.len()));
            for (a, b) in a.channels.iter().zip(&b.channels) {
                assert_eq!(a.samples.kind(), b.samples.kind(), "{}", a.display_name());
            }
            for name in ["Z", "id", "mask"] {
                assert_eq!(values(a, name), values(b, name), "{name}");
            }
            // Four times the solver's accuracy, and a half's.
            for name in ["R", "G"] {
                let off = values(a, name).into_iter().zip(values(b, name)).map(|(a, b)| (a - b).abs());
                assert!(off.fold(0.0, f32::max) < 4e-3, "{name}");
            }
            assert!(done.notes.iter().any(|note| note.contains("4 bands")), "{:?}", done.notes);
            assert_eq!(done.report.groups.len(), told.report.groups.len());
            assert_eq!(done.converted, told.converted);
        }
    }

    #[test]
    fn a_band_without_samples_sees_more_rows() {
        let job = Job::new(Method::named("ss", &[]).unwrap());
        let (banded, _) = filled(sparse(60..640), &job, (0, 100 * SIZE.width));
        assert!(values(&banded.parts[0], "R").iter().all(|value| value.is_finite()));
        let ids = values(&banded.parts[0], "id");
        assert!(ids.iter().all(|id| *id > 0.0), "every pixel has an identifier");
    }

    #[test]
    fn what_holds_over_the_whole_is_copied_in_every_band() {
        // The last bands know of one value only, which is no evidence.
        let full: Vec<f32> =
            (0..SIZE.pixels()).map(|at| if at < 8000 { (at % 31) as f32 / 30.0 } else { 1.0 }).collect();
        let mut sparse = sparse(0..0);
        let measured = values(&sparse.parts[0], "mask");
        let seen: Vec<f32> = full.iter().zip(&measured).map(|(value, flag)| value * flag).collect();
        let mut twin = full;
        let last = measured.iter().rposition(|flag| *flag == 0.0).unwrap();
        twin[last] = 0.25;
        sparse.parts[0].channels.push(float("A", &seen));
        sparse.parts[0].channels.push(float("dense.A", &twin));
        sparse.parts[0].attributes.set_text(crate::channels::DENSE, "dense.A");
        let job = Job::new(Method::named("ss", &[]).unwrap());
        let masks = find(&sparse, &job.mask, None).unwrap();
        let mut choices = choose(&sparse, &masks.mask_channels, &[]);
        let guides = guides::find(&sparse, &masks, &mut choices, &"auto".parse().unwrap(), None).unwrap();
        let candidates = guides::twins(&sparse, 0, &choices[0], &guides.parts[0], None);
        let known = twins::known(&sparse, (0, &masks, &choices[0]), candidates, None, &job).unwrap();
        let (plans, run) = (Plans::new(), Run::default());
        let work = Work::alone((0, &masks, &choices[0]), &[], &job, &plans, &run);
        let work = Work { twins: &known, ..work };
        let done = fill_by(&mut sparse, &work, &[], (0, 200 * SIZE.width)).unwrap();
        assert!(values(&sparse.parts[0], "A") == twin);
        assert_eq!(twins::line(&done.report.copied).as_deref(), Some("A from dense.A"));
    }

    #[test]
    fn smoothing_starts_from_what_was_measured() {
        let job = Job::new(Method::named("ss", &[("lambda", "0.5")]).unwrap());
        let (whole, _) = filled(sparse(0..0), &job, (usize::MAX, 0));
        let (banded, _) = filled(sparse(0..0), &job, (0, 200 * SIZE.width));
        let off = values(&whole.parts[0], "R").into_iter().zip(values(&banded.parts[0], "R"));
        assert!(off.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) < 4e-3);
    }

    #[test]
    fn shares_are_those_of_all_rows() {
        let of =
            |shares: &[(&str, f64)]| shares.iter().map(|&(name, share)| (name.to_owned(), share)).collect();
        let mut known: Vec<(String, f64)> = of(&[("edge", 0.75), ("tv", 0.25)]);
        mix(&mut known, of(&[("ss", 1.0)]), (300, 100));
        assert_eq!(known, of(&[("edge", 0.5625), ("ss", 0.25), ("tv", 0.1875)]));
    }
}
