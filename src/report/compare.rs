//! One test frame against its reference: every group, every region, every measure that is wanted.
//!
//! Pixels at which either value is not finite are counted and take no part in sums; for maps (SSIM, CIELUV, FLIP) such a
//! value is 0, in both images if it is the reference's.

use std::borrow::Cow;

use lacuna_exr::{Frame, Part};
use lacuna_filters::metric::error::{self, Options, Statistics};
use lacuna_filters::metric::ssim::Similarity;
use lacuna_filters::metric::{flip, luv, mean};
use lacuna_filters::{Mask, Plane};

use super::groups::{Group, Kind, pair};
use super::images::Images;
use super::measure::Measure;
use super::model::{FrameReport, GroupReport, Measures, RegionReport, Settings};
use super::values::{Clean, Values, chromaticities, differing, value};
use super::windows::{self, Placed};
use crate::channels::{Name, channel_label, is_alpha, view_of};
use crate::mask::Masks;
use crate::reconstruct::estimated_errors;

/// Why two frames cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// Their pixels are in different places.
    #[error(
        "{what}: the data window is {reference} in the reference and {test} here, of another display window; bring both to one {}",
        if *same_size { "window, with 'oiiotool IN --crop WINDOW -o OUT' for example" }
        else { "size: render or resize one of them" }
    )]
    Windows {
        /// The part.
        what: String,
        /// The reference's window.
        reference: String,
        /// The test image's window.
        test: String,
        /// Whether one is the other, moved.
        same_size: bool,
    },
    /// They have no channel in common.
    #[error("no channel has a partner in the reference; its channels are {0}")]
    NothingInCommon(String),
    /// A measure refused.
    #[error("{what}: {source}")]
    Measure {
        /// The channel.
        what: String,
        /// Why.
        source: lacuna_filters::Error,
    },
}

/// What has no partner, in a line for the channels of a part.
fn alone(labels: &[String], side: &str) -> Vec<String> {
    const CHANNEL: &str = "channel ";
    let split = |label: &'_ String| label.rfind(CHANNEL).map(|at| at + CHANNEL.len());
    let part = |label: &String| split(label).map(|at| label[..at].to_owned());
    let line = |labels: &[String]| match (labels, part(&labels[0])) {
        ([_, _, ..], Some(part)) => {
            let names: Vec<&str> = labels.iter().filter_map(|label| label.get(split(label)?..)).collect();
            format!("{}s {} are in the {side} only", part.trim_end(), names.join(", "))
        }
        _ => format!("{} is in the {side} only", labels[0]),
    };
    labels.chunk_by(|a, b| part(a).is_some() && part(a) == part(b)).map(line).collect()
}

/// What is said of values that only clipping makes equal.
fn hidden(group: &GroupReport) -> String {
    format!(
        "{}: more than a twentieth of the values differ only outside 0 to {}, where no clipped measure tells them apart: {}",
        group.label(),
        group.peak.unwrap_or(1.0),
        group.remedy()
    )
}

/// Compares two frames; `visit` sees the images of each group of floats while they are there.
///
/// # Errors
/// [`Error`]; what has no partner is no error but a note.
pub fn compare(
    reference: &Frame,
    test: &Frame,
    masks: Option<&Masks>,
    settings: &Settings,
    visit: &mut dyn FnMut(&Images<'_>),
) -> Result<FrameReport, Error> {
    let pairing = pair(reference, test);
    if pairing.groups.is_empty() {
        return Err(Error::NothingInCommon(crate::channels::list_channels(reference)));
    }
    let main = pairing.main(reference).unwrap_or_default();
    let mask = masks.map(|masks| masks.origin.clone());
    let mut report = FrameReport { mask, main, ..FrameReport::default() };
    report.notes.extend(alone(&pairing.missing, "reference"));
    report.notes.extend(alone(&pairing.extra, "test image"));
    for groups in pairing.groups.chunk_by(|a, b| a.parts == b.parts) {
        let placed = windows::place(reference, test, groups[0].parts)?;
        report.notes.extend(placed.note.clone());
        for group in groups {
            let main = report.groups.len() == main;
            let found = Work { reference, placed: &placed, masks, settings, group, main }.run(visit)?;
            report.notes.extend(found.beyond.map(|count| beyond(&found, count)));
            report.notes.extend(found.hidden.map(|_| hidden(&found)));
            report.groups.push(found);
        }
    }
    Ok(report)
}

/// What is said of values that only one of the images has.
fn beyond(group: &GroupReport, count: usize) -> String {
    format!("{}: {count} values that are not 0 lie in one of the data windows only", group.label())
}

/// One group at work.
struct Work<'a> {
    reference: &'a Frame,
    placed: &'a Placed<'a>,
    masks: Option<&'a Masks>,
    settings: &'a Settings,
    group: &'a Group,
    /// Whether it stands for the frame.
    main: bool,
}

/// A region by its name, and which pixels are in it; all for `None`.
type Region<'a> = (&'static str, Option<&'a [bool]>);

impl Work<'_> {
    fn parts(&self) -> (&Part, &Part) {
        (&self.placed.parts.0, &self.placed.parts.1)
    }

    fn run(&self, visit: &mut dyn FnMut(&Images<'_>)) -> Result<GroupReport, Error> {
        let mask = self.mask();
        let missing = self.missing();
        let shown = self.shown();
        let alpha = self.alpha();
        let mask = mask.as_deref();
        let mut regions: Vec<Region<'_>> = vec![("all", shown.as_deref())];
        regions.extend(missing.as_deref().map(|flags| ("missing", Some(flags))));
        regions.extend(alpha.as_deref().map(|flags| ("alpha", Some(flags))));
        let mut report = self.heading();
        if self.group.kind == Kind::Codes {
            report.regions = regions.iter().map(|&region| self.codes(region)).collect();
            self.measured(mask, &mut report);
            return Ok(report);
        }
        self.floats(&regions, (mask, missing.as_deref()), &mut report, visit)?;
        Ok(report)
    }

    fn heading(&self) -> GroupReport {
        let (part, _) = self.parts();
        let name = |&(channel, _): &(usize, usize)| part.channels[channel].display_name().into_owned();
        let size = part.size();
        GroupReport {
            part: self.group.parts.0,
            part_name: part.name().filter(|_| self.reference.parts.len() > 1),
            layer: self.group.layer.clone(),
            channels: self.group.channels.iter().map(name).collect(),
            kind: self.group.kind,
            size: (size.height, size.width),
            peak: None,
            clipped: false,
            hidden: None,
            beyond: self.beyond(),
            density: self.own_mask().map(Mask::density),
            measured_max: None,
            measured_different: None,
            regions: Vec::new(),
        }
    }

    /// The mask of the test image.
    fn own_mask(&self) -> Option<&Mask> {
        let (_, channel) = *self.group.channels.first()?;
        self.masks?.get(self.group.parts.1, channel).map(|mask| &**mask)
    }

    /// The pixels that were measured.
    fn mask(&self) -> Option<Cow<'_, Mask>> {
        let (mask, on) = (self.own_mask()?, self.parts().0.data_window);
        if self.placed.windows.1 == on {
            return Some(Cow::Borrowed(mask));
        }
        Mask::new(on.size(), self.placed.windows.1.place(mask.as_slice(), on, false)).ok().map(Cow::Owned)
    }

    /// The pixels that were not measured, but that the test image has.
    fn missing(&self) -> Option<Vec<bool>> {
        let flags: Vec<bool> = self.own_mask()?.as_slice().iter().map(|flag| !flag).collect();
        Some(self.placed.windows.1.place(&flags, self.parts().0.data_window, false))
    }

    /// The pixels that either image has; nothing if these are all.
    fn shown(&self) -> Option<Vec<bool>> {
        let (on, (a, b)) = (self.parts().0.data_window, self.placed.windows);
        if on == a || on == b {
            return None;
        }
        let [a, b] = [a, b].map(|own| own.place(&vec![true; own.size().pixels()], on, false));
        Some(a.into_iter().zip(b).map(|(a, b)| a || b).collect())
    }

    /// The values that are not 0 in one image where the other one has no pixel, if there are any.
    fn beyond(&self) -> Option<usize> {
        let ((part, other), (a, b)) = (self.parts(), self.placed.windows);
        if a == b {
            return None;
        }
        let on = part.data_window;
        let one = |&(at, to): &(usize, usize)| {
            windows::beyond(&part.channels[at].samples, (on, b))
                + windows::beyond(&other.channels[to].samples, (on, a))
        };
        Some(self.group.channels.iter().map(one).sum()).filter(|count| *count > 0)
    }

    /// Where the reference's alpha is above 0: that of the layer, else that of the part; never that of another view.
    fn alpha(&self) -> Option<Vec<bool>> {
        let (part, _) = self.parts();
        let view = view_of(part, &part.channels[self.group.channels.first()?.0].display_name());
        let with = |layer: &str| {
            part.channels.iter().find(|channel| {
                let name = channel.display_name();
                is_alpha(&name) && Name::new(&name).layer == layer && view_of(part, &name) == view
            })
        };
        let of_view = || with(view.as_deref()?);
        let channel = with(&self.group.layer).or_else(|| with("")).or_else(of_view)?;
        let alpha = channel.samples.to_floats()?;
        Some(alpha.iter().map(|&value| value > 0.0).collect())
    }

    /// Counts of equal bits, for a group of whole numbers or identifiers.
    fn codes(&self, (name, flags): Region<'_>) -> RegionReport {
        let (part, other) = self.parts();
        let mut measures = Measures::default();
        let all = part.size().pixels();
        let pixels = flags.map_or(all, |flags| flags.iter().filter(|&&flag| flag).count());
        let different: usize = self
            .group
            .channels
            .iter()
            .map(|&(a, b)| {
                differing(&part.channels[a].samples, &other.channels[b].samples)
                    .enumerate()
                    .filter(|&(at, differs)| differs && flags.is_none_or(|flags| flags[at]))
                    .count()
            })
            .sum();
        measures.set(Measure::Pixels, pixels as f64);
        measures.set(Measure::Different, different as f64);
        RegionReport { region: name, measures, largest_at: None, channels: Vec::new() }
    }

    /// What became of measured pixels.
    fn measured(&self, mask: Option<&Mask>, report: &mut GroupReport) {
        let Some(mask) = mask else { return };
        let (part, other) = self.parts();
        let (mut different, mut largest) = (0, 0.0_f64);
        for &(a, b) in &self.group.channels {
            let (a, b) = (&part.channels[a].samples, &other.channels[b].samples);
            for (at, _) in differing(a, b).enumerate().filter(|&(at, differs)| differs && mask.as_slice()[at])
            {
                different += 1;
                let by = (value(a, at) - value(b, at)).abs();
                largest = largest.max(if by.is_nan() { f64::INFINITY } else { by });
            }
        }
        report.measured_different = Some(different);
        report.measured_max = (self.group.kind != Kind::Codes).then_some(largest);
    }

    fn floats(
        &self,
        regions: &[Region<'_>],
        (mask, missing): (Option<&Mask>, Option<&[bool]>),
        report: &mut GroupReport,
        visit: &mut dyn FnMut(&Images<'_>),
    ) -> Result<(), Error> {
        let (part, other) = self.parts();
        let size = part.size();
        let planes = |side: usize| -> Vec<Plane> {
            let channels = self.group.channels.iter().map(|&(a, b)| {
                let samples = if side == 0 { &part.channels[a].samples } else { &other.channels[b].samples };
                samples.to_floats().and_then(|values| Plane::new(size, values).ok())
            });
            channels.map(|plane| plane.unwrap_or_else(|| Plane::filled(size, 0.0))).collect()
        };
        let (linear, test_linear) = (planes(0), planes(1));
        let values = Values::new(self.group.kind, self.settings, &linear);
        let (shown, test_shown) = (values.shown(&linear), values.shown(&test_linear));
        let (a, b) = (shown.as_deref().unwrap_or(&linear), test_shown.as_deref().unwrap_or(&test_linear));
        report.peak = Some(values.options.peak);
        report.clipped = values.options.clip;
        self.measured(mask, report);
        let clean = Clean::new(a, b, &values);
        let similar: Vec<Similarity> = (clean.pairs().enumerate())
            .map(|(index, (a, b))| {
                Similarity::new(a, b, values.options.peak).map_err(|error| self.at(index, error))
            })
            .collect::<Result<_, _>>()?;
        let finite = Clean::of_linear(&linear, &test_linear);
        let colour = self.colour_maps(&finite, values.options.peak)?;
        let flags: Vec<_> = regions.iter().map(|region| region.1).collect();
        let mut sums = Vec::new();
        for (index, (a, b)) in a.iter().zip(b).enumerate() {
            let found = error::compare_regions(a, b, &flags, values.options);
            sums.push(found.map_err(|error| self.at(index, error))?);
        }
        report.hidden =
            sums.iter().fold(Statistics::default(), |all, channel| all.and(channel[0])).hidden_share();
        for (at, &(name, flags)) in regions.iter().enumerate() {
            let statistics: Vec<Statistics> = sums.iter().map(|channel| channel[at]).collect();
            let region = self.region(name, flags, &statistics, &similar, &colour, values.options);
            report.regions.push(region.map_err(|error| self.at(0, error))?);
        }
        let estimate = estimated_errors(other, &self.group.layer);
        visit(&Images {
            report,
            main: self.main,
            reference: &linear,
            test: &test_linear,
            similarity: &similar,
            cieluv: colour.cieluv.as_ref(),
            flip: colour.flip.as_ref(),
            mask,
            missing,
            estimate: estimate.as_ref(),
            part,
        });
        Ok(())
    }

    fn at(&self, index: usize, source: lacuna_filters::Error) -> Error {
        let channel = self.group.channels[index].0;
        Error::Measure { what: channel_label(self.reference, self.group.parts.0, channel), source }
    }

    /// The maps that need red, green and blue together.
    fn colour_maps(&self, finite: &Clean<'_>, peak: f32) -> Result<ColourMaps, Error> {
        let wanted = &self.settings.wanted;
        let mut maps = ColourMaps::default();
        let (Some(reference), Some(test)) = (finite.rgb(0), finite.rgb(1)) else { return Ok(maps) };
        if self.group.kind != Kind::Colour {
            return Ok(maps);
        }
        let failed = |error| self.at(0, error);
        if wanted.has(Measure::Cieluv) {
            let chromaticities = chromaticities(self.parts().0);
            maps.cieluv = Some(luv::difference(reference, test, &chromaticities, peak).map_err(failed)?);
        }
        if wanted.has(Measure::Flip) {
            let map = flip::display(reference, test, flip::PIXELS_PER_DEGREE, peak).map_err(failed)?;
            maps.flip = Some(map);
        }
        if wanted.has(Measure::HdrFlip) {
            let exposures = match self.settings.hdr_range {
                Some((dark, bright)) => flip::exposures_between(dark, bright),
                None => flip::exposures_of(reference),
            };
            let map = flip::hdr(reference, test, flip::PIXELS_PER_DEGREE, &exposures).map_err(failed)?;
            maps.hdr_flip = Some(map);
        }
        Ok(maps)
    }

    fn region(
        &self,
        name: &'static str,
        flags: Option<&[bool]>,
        statistics: &[Statistics],
        similar: &[Similarity],
        colour: &ColourMaps,
        options: Options,
    ) -> Result<RegionReport, lacuna_filters::Error> {
        let (part, _) = self.parts();
        let all = statistics.iter().fold(Statistics::default(), |sum, &one| sum.and(one));
        let pixels = flags.map_or(part.size().pixels(), |flags| flags.iter().filter(|&&flag| flag).count());
        let mut measures = enter(&all, pixels, options.peak);
        // Where nothing is finite, both are 0, which is no likeness.
        let mean_of = |(similarity, own): (&Similarity, &Statistics)| {
            Ok(similarity.mean(flags)?.filter(|_| own.count > 0))
        };
        let means = similar.iter().zip(statistics).map(mean_of);
        let means = means.collect::<Result<Vec<Option<f64>>, lacuna_filters::Error>>()?;
        let known: Option<Vec<f64>> = means.iter().copied().collect();
        measures.set(Measure::Ssim, known.map(|means| means.iter().sum::<f64>() / means.len() as f64));
        for (measure, map) in [
            (Measure::Cieluv, &colour.cieluv),
            (Measure::Flip, &colour.flip),
            (Measure::HdrFlip, &colour.hdr_flip),
        ] {
            let mean = map.as_ref().map(|map| mean(map, flags)).transpose()?;
            measures.set(measure, mean.flatten().filter(|_| all.count > 0));
        }
        let mut channels = Vec::new();
        if statistics.len() > 1 {
            for (index, (one, mean)) in statistics.iter().zip(means).enumerate() {
                let name = part.channels[self.group.channels[index].0].display_name().into_owned();
                let mut own = enter(one, pixels, options.peak);
                own.set(Measure::Ssim, mean);
                channels.push((name, own));
            }
        }
        let largest_at = all.largest_at.map(|at| {
            let (y, x) = (at / part.size().width, at % part.size().width);
            (i64::from(part.data_window.x_min) + x as i64, i64::from(part.data_window.y_min) + y as i64)
        });
        Ok(RegionReport { region: name, measures, largest_at, channels })
    }
}

/// Puts sums into a table of measures.
fn enter(sums: &Statistics, pixels: usize, peak: f32) -> Measures {
    let mut measures = Measures::default();
    measures.set(Measure::Pixels, pixels as f64);
    measures.set(Measure::Mse, sums.mse());
    measures.set(Measure::Rmse, sums.rmse());
    measures.set(Measure::Max, (sums.count > 0).then_some(sums.largest));
    measures.set(Measure::Psnr, sums.psnr(peak));
    measures.set(Measure::RelativeMse, sums.relative_mse());
    measures.set(Measure::LogPsnr, sums.log_psnr());
    for (measure, count) in [
        (Measure::Different, sums.different),
        (Measure::Nan, sums.test_nan),
        (Measure::Infinite, sums.test_infinite),
        (Measure::ReferenceNan, sums.reference_nan),
        (Measure::ReferenceInfinite, sums.reference_infinite),
        (Measure::NewNan, sums.new_nan),
        (Measure::NewInfinite, sums.new_infinite),
    ] {
        measures.set(measure, count as f64);
    }
    measures
}

/// Maps of a colour group, as far as wanted.
#[derive(Default)]
struct ColourMaps {
    cieluv: Option<Plane>,
    flip: Option<Plane>,
    hdr_flip: Option<Plane>,
}
