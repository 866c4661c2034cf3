//! How much memory a frame needs, estimated from its header, so that frames are admitted before they are read.
//!
//! A frame takes what reading it takes, and while a part of it is filled samples and values of its channels of floats, and what the
//! filter takes for the largest layer; whether a channel is reconstructed is not known before it is read. What filters take depends on
//! the mask, which is not known either: a frame is admitted by the most that any mask makes it, and settles for what its own makes.
//! The figures were measured as peak memory over pixels, the allocator's losses included; `tests/cli/memory.rs` holds the process to them.

use std::collections::BTreeMap;
use std::path::Path;

use lacuna_exr::{ChannelHeader, Limits, PartHeader, SampleType, memory_needed, read_header};
use lacuna_filters::descriptor::Memory;
use lacuna_filters::estimate::{REPEATED, holes, may_repeat};
use lacuna_filters::upscale::Method;
use lacuna_filters::{Mask, Size};

use crate::channels::{Name, Shown, is_light, shown};
use crate::files::neighbours::NeighbourFile;
use crate::files::plan::Item;
use crate::reconstruct::{Enlarge, Windows, pixels_at_a_time};
use crate::temporal;

/// Bytes a pixel that choosing pixels takes, in rounds or after a fill, and what is estimated of each pixel, of all channels that decide and of each.
const CHOOSING: Memory = Memory { image: 36, channel: 14 };

/// Bytes a pixel of every channel that is compared.
const COMPARING: u64 = 24;

/// Bytes a pixel of every colour that are kept for the frames beside it, and the frames of which they are: its own and those.
const FOLLOWING: u64 = 8;
const KEPT_FRAMES: u64 = 3;

/// Bytes a pixel of each guide, and of each channel that it guides: planes, and once more what is measured of them, all of it and without the held-out ones.
const GUIDING: Guiding = Guiding { guide: 5.0, channel: 6.0, measured: 8.0 };

/// The part of what Slurm grants that frames may use; the rest is for the program and the allocator's losses.
const SHARE: f64 = 0.875;

/// See [`GUIDING`].
struct Guiding {
    guide: f64,
    channel: f64,
    /// Of either, of a measured pixel.
    measured: f64,
}

/// What is known of a fill beside its method.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fill {
    /// The share of the masks that is [`holes`].
    pub holes: f64,
    /// Measured pixels over all pixels, of the mask that has most.
    pub density: f64,
    /// Whether errors of each pixel are estimated.
    pub errors: bool,
    /// Whether pixels [may be](may_repeat) chosen in rounds once more.
    pub repeats: bool,
    /// Planes that guide.
    pub guides: u64,
}

impl Fill {
    /// By masks.
    pub fn of<'a>(
        masks: impl Iterator<Item = &'a Mask>,
        method: &lacuna_filters::Method,
        estimates: bool,
    ) -> Self {
        let mut own = Self::default();
        for mask in masks {
            own.holes = own.holes.max(holes(mask, estimates || method.chooses()));
            own.density = own.density.max(mask.density());
            own.repeats |= estimates && may_repeat(mask);
        }
        own
    }

    /// The most that any mask makes it, with so many guides.
    pub const fn most(estimates: bool, guides: u64) -> Self {
        Self { holes: 1.0, density: 1.0, errors: false, repeats: estimates, guides }
    }

    /// Bytes that it takes by that method.
    fn memory(self, method: &lacuna_filters::Method) -> Memory {
        let Memory { mut image, mut channel } = method.memory(self.holes);
        let measured = GUIDING.measured * self.density;
        if self.guides > 0 {
            channel += (GUIDING.channel + measured).ceil() as u64;
        }
        let others = [self.errors.then_some(CHOOSING), self.repeats.then_some(REPEATED)];
        for other in others.into_iter().flatten() {
            (image, channel) = (image.max(other.image), channel.max(other.channel));
        }
        // Guides stay whatever is done beside them.
        image += (self.guides as f64 * (GUIDING.guide + measured)).ceil() as u64;
        Memory { image, channel }
    }
}

/// The most planes of a file that may guide: all channels of a part but its mask; 0 if its header cannot be read.
pub fn most_guides(path: &Path) -> u64 {
    let parts = read_header(path).unwrap_or_default();
    parts.iter().map(|part| part.channels.len() as u64).sum()
}

/// The bound on memory that Slurm's grant to this task gives, if it says one.
pub fn granted() -> Option<u64> {
    of_grant(|name| std::env::var(name).ok()?.trim().parse().ok())
}

/// Slurm tells mebibytes: of the node (0 is all of it, which is no bound), or for each processor.
fn of_grant(variable: impl Fn(&str) -> Option<u64>) -> Option<u64> {
    let mebibytes = variable("SLURM_MEM_PER_NODE").or_else(|| {
        let processors = ["SLURM_CPUS_PER_TASK", "SLURM_CPUS_ON_NODE"].into_iter().find_map(&variable);
        Some(variable("SLURM_MEM_PER_CPU")?.saturating_mul(processors.unwrap_or(1)))
    })?;
    (mebibytes > 0).then(|| (mebibytes as f64 * SHARE * f64::from(1 << 20)) as u64)
}

/// What reading a frame may take: as much as its work was admitted for where there is a bound, else the default.
pub fn limits(bound: Option<u64>, admitted: u64) -> Limits {
    bound.map_or_else(Limits::default, |bound| Limits { bytes: admitted.min(bound) })
}

/// What reading one file may take where it is read outside a batch: the bound, else the default.
pub fn reading(bound: Option<u64>) -> Limits {
    bound.map_or_else(Limits::default, |bytes| Limits { bytes })
}

/// Whether so many bytes are within the bound, if there is one.
///
/// # Errors
/// What they would need.
pub fn afford(bound: Option<u64>, needed: u64) -> Result<(), lacuna_exr::Error> {
    match bound {
        Some(limit) if needed > limit => Err(lacuna_exr::Error::TooLarge { needed, limit }),
        _ => Ok(()),
    }
}

/// Bytes that filling a frame needs; 0 if its header cannot be read (reading it will say why).
pub fn to_fill(item: &Item, method: &lacuna_filters::Method, fill: Fill) -> u64 {
    let mask = item.mask.as_deref().map_or(0, to_copy);
    let guides = item.guides.as_deref().map_or(0, to_copy);
    let filled = Taken { each: FILLED, copy: false, ..Taken::COPY };
    // A layer is read, and stands beside the frame's own channels.
    let layers = item.layers.iter().map(|layer| filled.of(&layer.path)).fold(0, u64::saturating_add);
    // A neighbour is read, filled where its motion is estimated, and each of its pixels has a place; a frame that has some is not cut into bands.
    let beside = Taken { whole: PLACE, ..filled };
    let own = read_header(&item.input).map(|parts| temporal::shapes(&parts)).unwrap_or_default();
    let used = item.neighbours.iter().filter_map(|file| Some((file, temporal::header(file, &own).ok()?)));
    let of = |(file, beyond): (&NeighbourFile, u64)| {
        let layers = file.layers.iter().map(|layer| filled.of(&layer.path));
        layers.fold(beside.of(&file.input), u64::saturating_add).saturating_add(beyond.saturating_mul(BEYOND))
    };
    let neighbours = used.map(of).fold(0, u64::saturating_add);
    let at_a_time = if item.neighbours.is_empty() { pixels_at_a_time } else { all };
    let Memory { image, channel } = fill.memory(method);
    Taken { whole: image, together: channel, at_a_time, ..filled }
        .of(&item.input)
        .saturating_add(neighbours)
        .saturating_add(mask)
        .saturating_add(guides)
        .saturating_add(layers)
}

/// Bytes that filling a frame takes that is in memory already, of channels that are filled `together` at most.
pub fn to_fill_in_place(
    size: Size,
    (channels, together): (u64, u64),
    method: &lacuna_filters::Method,
    fill: Fill,
) -> u64 {
    let Memory { image, channel } = fill.memory(method);
    let work = pixels_at_a_time(size).saturating_mul(image + together * channel);
    all(size).saturating_mul(FILLED * channels).saturating_add(work)
}

/// Bytes that choosing pixels of that many takes by so many channels.
pub fn to_choose(size: Size, channels: u64) -> u64 {
    all(size).saturating_mul(CHOOSING.image + CHOOSING.channel * channels)
}

/// Bytes that choosing pixels of a frame takes beside reading it; 0 if its header cannot be read.
pub fn to_choose_of(path: &Path) -> u64 {
    let Ok(parts) = read_header(path) else { return 0 };
    let deciding = |part: &PartHeader| {
        let name = |header: &ChannelHeader| String::from_utf8_lossy(&header.name).into_owned();
        let names: Vec<String> = part.channels.iter().map(name).collect();
        let measured = part.channels.iter().enumerate().filter(|(_, one)| one.kind != SampleType::Uint);
        let (what, channels) = shown(&names, &measured.map(|(at, _)| at).collect::<Vec<_>>());
        (what, to_choose(part.size(), channels.len() as u64))
    };
    let all: Vec<(Shown, u64)> = parts.iter().map(deciding).collect();
    // Of each view a part; those that show less of the colour do not count.
    let best = all.iter().map(|(what, _)| *what).min();
    all.iter().filter(|(what, _)| Some(*what) == best).map(|(_, bytes)| bytes).sum()
}

/// Bytes that the larger frame needs beside: samples, and in each channel that may be computed values and the planes on the
/// way, those of total variation if that is asked for; 0 if the header cannot be read or the frame not be enlarged.
pub fn to_enlarge(path: &Path, enlarge: &Enlarge) -> u64 {
    let Ok(parts) = read_header(path) else { return 0 };
    let planes = if matches!(enlarge.method, Method::Tv(_)) { 40 } else { 20 };
    let part = |part: &PartHeader| {
        let Ok(windows) = Windows::of_header(part, &enlarge.target) else { return 0 };
        let size = windows.data.size();
        let pixels = (size.height as u64).saturating_mul(size.width as u64);
        let channel =
            |kind: SampleType| kind.bytes() as u64 + if kind == SampleType::Uint { 0 } else { planes };
        let channels: u64 = part.channels.iter().map(|header| channel(header.kind)).sum();
        // Highlights of a group at a time, from the small frame, and where each pixel comes from.
        let highlights = if matches!(enlarge.method, Method::Ss) { 16 } else { 0 };
        let small = all(part.data_window.size()).saturating_mul(highlights);
        pixels.saturating_mul(channels + 4).saturating_add(small)
    };
    parts.iter().map(part).fold(0, u64::saturating_add)
}

/// Bytes that a comparison of two files needs, the maps of the measures included; 0 for one whose header cannot be read. Frames whose windows differ
/// stand on those of both as well.
pub fn to_compare(reference: &Path, test: &Path) -> u64 {
    let [a, b] = [reference, test].map(|path| read_header(path).unwrap_or_default());
    let side = |own: &[PartHeader], other: &[PartHeader]| {
        let mut placed = own.to_vec();
        for (part, other) in placed.iter_mut().zip(other) {
            part.data_window = crate::report::of_headers(part, other);
        }
        let more = if placed == own { 0 } else { memory_needed(own) };
        let taken = Taken { each: COMPARING, whole: 48, ..Taken::COPY };
        if placed.is_empty() { 0 } else { taken.of_parts(&placed).saturating_add(more) }
    };
    side(&a, &b).saturating_add(side(&b, &a))
}

/// Bytes that is kept of a frame and of those beside it while two files are compared, so that changes from frame to frame are found: colours and
/// errors, and the references where `motion` is followed.
pub fn to_follow(reference: &Path, test: &Path, motion: bool) -> u64 {
    let [a, b] = [reference, test].map(|path| read_header(path).unwrap_or_default());
    let is_light = |header: &&ChannelHeader| {
        header.kind != SampleType::Uint && is_light(&String::from_utf8_lossy(&header.name))
    };
    let one = |(part, other): (&PartHeader, &PartHeader)| {
        let colours = part.channels.iter().filter(is_light).count() as u64;
        all(crate::report::of_headers(part, other).size()).saturating_mul(FOLLOWING * colours + MASK)
    };
    let colours = a.iter().zip(&b).map(one).fold(0, u64::saturating_add);
    let references = if motion { memory_needed(&a) } else { 0 };
    KEPT_FRAMES.saturating_mul(colours.saturating_add(references))
}

/// Bytes that reading, copying and writing a frame needs; 0 if its header cannot be read.
pub fn to_copy(path: &Path) -> u64 {
    Taken::COPY.of(path)
}

/// Bytes that reading a frame with its mask needs; 0 if its header cannot be read.
pub fn to_read(path: &Path) -> u64 {
    Taken { copy: false, ..Taken::COPY }.of(path)
}

/// What work on a frame takes beside reading it.
#[derive(Clone, Copy)]
struct Taken {
    /// Bytes a pixel of every channel that may be computed.
    each: u64,
    /// Bytes a pixel of every channel that may be computed of the layer that has most of them.
    together: u64,
    /// Bytes a pixel.
    whole: u64,
    /// The pixels of a part that are worked on at a time.
    at_a_time: fn(Size) -> u64,
    /// Whether what is written is there besides what was read.
    copy: bool,
}

impl Taken {
    /// All pixels at a time.
    const COPY: Self = Self { each: 0, together: 0, whole: 0, at_a_time: all, copy: true };

    /// Bytes, reading included; 0 if the header cannot be read.
    fn of(self, path: &Path) -> u64 {
        read_header(path).map_or(0, |parts| self.of_parts(&parts))
    }

    /// The same of parts.
    fn of_parts(self, parts: &[PartHeader]) -> u64 {
        let kept = |part: &PartHeader| {
            let kinds: u64 = part.channels.iter().map(|header| header.kind.bytes() as u64).sum();
            // The mask itself is there as a whole.
            all(part.data_window.size()).saturating_mul(if self.copy { kinds } else { MASK })
        };
        let kept = parts.iter().map(kept).fold(memory_needed(parts), u64::saturating_add);
        let work = parts.iter().map(|part| self.work(part));
        // Parts are filled one after the other.
        kept.saturating_add(if self.copy {
            work.fold(0, u64::saturating_add)
        } else {
            work.max().unwrap_or(0)
        })
    }

    /// Bytes that the work on a part takes.
    fn work(self, part: &PartHeader) -> u64 {
        let mut layers = BTreeMap::<String, u64>::new();
        // Whole numbers and sampling masks are not computed.
        let copied = |header: &&ChannelHeader| {
            header.kind == SampleType::Uint || header.name.eq_ignore_ascii_case(b"mask")
        };
        for header in part.channels.iter().filter(|header| !copied(header)) {
            let name = String::from_utf8_lossy(&header.name);
            *layers.entry(Name::new(&name).layer.to_owned()).or_default() += 1;
        }
        let (computed, most): (u64, u64) =
            (layers.values().sum(), layers.values().max().copied().unwrap_or(0));
        let bytes = self.each * computed + self.together * most + self.whole;
        (self.at_a_time)(part.data_window.size()).saturating_mul(bytes)
    }
}

/// Bytes that samples and values of a channel take, a pixel.
const FILLED: u64 = 8;

/// Bytes that the place of a neighbour's pixel takes.
const PLACE: u64 = 8;

/// Bytes that a pixel takes that neither a frame nor the one beside it has but the window of both, where motion is estimated.
const BEYOND: u64 = 96;

/// Bytes that the flags of a pixel take.
const MASK: u64 = 2;

fn all(size: Size) -> u64 {
    (size.height as u64).saturating_mul(size.width as u64)
}

#[cfg(test)]
mod tests {
    use lacuna_exr::WriteOptions;
    use lacuna_filters::upscale::Method;
    use lacuna_filters::variational::tv::Settings;

    use super::{of_grant, to_enlarge};
    use crate::reconstruct::{Enlarge, Target};
    use crate::testing::{float, frame, part, window};

    #[test]
    fn highlights_of_the_small_frame_count() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("small.exr");
        let small = frame(vec![part(window(0, 0, 4, 3), vec![float("Y", &[0.5; 12])])]);
        lacuna_exr::write(&small, &path, &WriteOptions::default()).unwrap();
        let of = |method| {
            let target = Target::Scale { x: 2.0, y: 3.0 };
            to_enlarge(
                &path,
                &Enlarge { target, method, sampling: None, take_guides: false, keep_vectors: false },
            )
        };
        let large = 8 * 9;
        assert_eq!(of(Method::Ss), large * (4 + 20 + 4) + 12 * 16);
        assert_eq!(of(Method::Tv(Settings::default())), large * (4 + 40 + 4));
    }

    #[test]
    fn a_grant_of_slurm_bounds_memory() {
        let of = |known: &[(&str, u64)]| {
            of_grant(|name| known.iter().find(|(known, _)| *known == name).map(|(_, value)| *value))
        };
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[("SLURM_MEM_PER_NODE", 0)]), None);
        assert_eq!(of(&[("SLURM_MEM_PER_NODE", 1024)]), Some(896 << 20));
        let each = [("SLURM_MEM_PER_CPU", 512)];
        assert_eq!(of(&each), Some(448 << 20));
        assert_eq!(of(&[&each[..], &[("SLURM_CPUS_ON_NODE", 2)]].concat()), Some(896 << 20));
        assert_eq!(
            of(&[&each[..], &[("SLURM_CPUS_ON_NODE", 8), ("SLURM_CPUS_PER_TASK", 4)]].concat()),
            Some(1792 << 20)
        );
    }
}
