//! What a comparison found, as every format and the gate read it.

use std::collections::BTreeMap;

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use super::groups::Kind;
use super::measure::{Measure, Wanted};

/// How images are compared.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// The value of colours that counts as white, above 0; that of alphas is 1.
    pub peak: f32,
    /// Whether colours and alphas are clipped to 0 and white first.
    pub clip: bool,
    /// Whether colours are compared after the sRGB curve, clipped to `[0, 1]`; the peak is 1 then.
    pub display: bool,
    /// The luminances that HDR-FLIP brings just below white, the darker first; the reference's median and largest if
    /// `None`.
    pub hdr_range: Option<(f64, f64)>,
    /// The measures that are computed only if asked for.
    pub wanted: Wanted,
}

impl Default for Settings {
    fn default() -> Self {
        Self { peak: 1.0, clip: true, display: false, hdr_range: None, wanted: Wanted::default() }
    }
}

/// Values of measures; those that do not apply are not there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measures(BTreeMap<Measure, f64>);

impl Measures {
    /// The value of a measure.
    pub fn get(&self, measure: Measure) -> Option<f64> {
        self.0.get(&measure).copied()
    }

    /// Enters a value, if there is one.
    pub fn set(&mut self, measure: Measure, value: impl Into<Option<f64>>) {
        if let Some(value) = value.into() {
            self.0.insert(measure, value);
        }
    }
}

/// A mean over frames or groups. A PSNR is infinite where images are equal, as black ones are: those are counted, and hide no others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mean {
    /// Of the values that are not infinite; infinite if all are.
    pub value: f64,
    equal: usize,
    count: usize,
}

impl Mean {
    /// The mean of values; nothing if there are none.
    pub fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let all: Vec<f64> = values.collect();
        let (equal, mut rest): (Vec<f64>, Vec<f64>) = all.iter().partition(|value| **value == f64::INFINITY);
        if rest.is_empty() {
            rest.clone_from(&equal);
        }
        let value = rest.iter().sum::<f64>() / rest.len() as f64;
        (!all.is_empty()).then_some(Self { value, equal: equal.len(), count: all.len() })
    }

    /// How many were left out, if any were: ` (1 of 2 equal)`.
    pub fn left_out(&self) -> String {
        let Self { equal, count, .. } = self;
        if equal % count == 0 { String::new() } else { format!(" ({equal} of {count} equal)") }
    }
}

/// Infinities, which JSON has not, become the texts `inf` and `-inf`.
impl Serialize for Measures {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (measure, &value) in &self.0 {
            if measure.is_count() {
                map.serialize_entry(measure.name(), &(value as u64))?;
            } else if value.is_finite() {
                map.serialize_entry(measure.name(), &value)?;
            } else {
                map.serialize_entry(measure.name(), &value.to_string())?;
            }
        }
        map.end()
    }
}

/// One region of a group.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RegionReport {
    /// `all`, `missing` (not measured, by the mask) or `alpha` (the reference's alpha is above 0).
    pub region: &'static str,
    /// Over all channels of the group.
    pub measures: Measures,
    /// The pixel (column, row) of the largest error, in absolute coordinates.
    pub largest_at: Option<(i64, i64)>,
    /// Per channel, by its full name, in the group's order; empty for a group of one.
    pub channels: Vec<(String, Measures)>,
}

/// Channels that are compared together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GroupReport {
    /// Index of the part in the reference.
    pub part: usize,
    /// The part's name.
    pub part_name: Option<String>,
    /// The layer; empty for channels without one.
    pub layer: String,
    /// Full names.
    pub channels: Vec<String>,
    /// How its values are understood.
    pub kind: Kind,
    /// Rows and columns.
    pub size: (usize, usize),
    /// The value that PSNR and SSIM take as the full range; nothing for codes.
    pub peak: Option<f32>,
    /// Whether values were clipped to `[0, peak]`.
    pub clipped: bool,
    /// The share of the values that differ only where clipping makes them equal, if it is more than a twentieth.
    pub hidden: Option<f64>,
    /// The values that are not 0 and that only one of the images has, if their data windows differ and there are any.
    pub beyond: Option<usize>,
    /// Measured pixels over all, where a mask serves the group.
    pub density: Option<f64>,
    /// Largest absolute error on measured pixels, unclipped.
    pub measured_max: Option<f64>,
    /// Values on measured pixels whose bits differ.
    pub measured_different: Option<usize>,
    /// The regions.
    pub regions: Vec<RegionReport>,
}

impl GroupReport {
    /// The region of that name.
    pub fn region(&self, name: &str) -> Option<&RegionReport> {
        self.regions.iter().find(|region| region.region == name)
    }

    /// What shows values that clipping makes equal; of an alpha white is 1.
    pub fn remedy(&self) -> &'static str {
        if self.kind == Kind::Alpha { "give --no-clip" } else { "give --peak, or --no-clip" }
    }

    /// What people call the group: `RGB`, `diffuse.RGB`, `Z`, with the part's name in front where there is one.
    pub fn label(&self) -> String {
        let component = |name: &String| name.rsplit('.').next().unwrap_or(name).to_owned();
        let names: Vec<String> = self.channels.iter().map(component).collect();
        let short = names.iter().all(|name| name.chars().count() == 1);
        let joined = names.join(if short { "" } else { "," });
        let layer = if self.layer.is_empty() { String::new() } else { format!("{}.", self.layer) };
        match &self.part_name {
            Some(part) => format!("{part}: {layer}{joined}"),
            None => format!("{layer}{joined}"),
        }
    }
}

/// One frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FrameReport {
    /// The frame number.
    pub frame: Option<i64>,
    /// The reference's file.
    pub reference: String,
    /// The test image's file.
    pub test: String,
    /// Why the frame could not be compared.
    pub error: Option<String>,
    /// Why it was passed over.
    pub skipped: Option<String>,
    /// Where the mask was found.
    pub mask: Option<String>,
    /// What a reader should know: channels without a partner, say.
    pub notes: Vec<String>,
    /// What the gate found wanting.
    pub failures: Vec<String>,
    /// The groups, part by part.
    pub groups: Vec<GroupReport>,
    /// Which of them stands for the frame.
    #[serde(skip)]
    pub main: usize,
}

impl FrameReport {
    /// The group that stands for the frame in pictures, plots and sums.
    pub fn main_group(&self) -> Option<&GroupReport> {
        self.groups.get(self.main)
    }

    /// The frame number, or the file's name.
    pub fn label(&self) -> String {
        let name = || std::path::Path::new(&self.test).file_name().map(|name| name.display().to_string());
        self.frame.map(|number| number.to_string()).or_else(name).unwrap_or_else(|| self.test.clone())
    }
}

/// A comparison of frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// The version of lacuna.
    pub lacuna: &'static str,
    /// How images were compared.
    pub settings: Settings,
    /// What the gate asks, as it was written.
    pub gate: Vec<String>,
    /// The frames, in the order asked for.
    pub frames: Vec<FrameReport>,
}

impl Comparison {
    /// Of the measured pixels of all groups the largest error and how many values differ in bits; nothing where no mask serves any.
    pub fn measured(&self) -> Option<(f64, usize)> {
        let groups = || self.frames.iter().flat_map(|frame| &frame.groups);
        let different =
            groups().filter_map(|group| group.measured_different).reduce(|sum, count| sum + count)?;
        Some((groups().filter_map(|group| group.measured_max).fold(0.0, f64::max), different))
    }

    /// The measures that any frame has in that region of its groups, in the order of tables.
    pub fn measures_in(&self, region: &str) -> Vec<Measure> {
        let regions = || {
            let groups = self.frames.iter().flat_map(|frame| &frame.groups);
            groups.flat_map(|group| &group.regions).filter(|found| found.region == region)
        };
        Measure::all()
            .filter(|&measure| regions().any(|region| region.measures.get(measure).is_some()))
            .collect()
    }
}
