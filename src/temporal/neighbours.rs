//! Reading the frames beside one: each by itself, so that no chunk and no order changes what is found; those that were read last are kept.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use lacuna_exr::{Frame, Limits};

use super::fit::{Shape, beyond, misfit_of_all, shapes};
use super::kept::KeptSamples;
use crate::files::content::State;
use crate::files::neighbours::NeighbourFile;
use crate::mask::shared::MaskFiles;
use crate::mask::{self, Masks, layers};

/// A frame beside the one that is filled.
#[derive(Clone, Debug)]
pub struct Neighbour {
    /// Its number.
    pub number: i64,
    /// Its number less that of the frame that is filled.
    pub offset: i64,
    /// What the log calls it.
    pub label: String,
    /// What it holds; the samples of its channels only if these are not in `samples`.
    pub frame: Arc<Frame>,
    /// What was measured.
    pub masks: Arc<Masks>,
    /// The samples that are kept.
    pub samples: Option<Arc<KeptSamples>>,
}

impl Neighbour {
    /// The frame, to look its samples up.
    pub fn source(&self) -> FrameRef<'_> {
        FrameRef { frame: &self.frame, masks: &self.masks, samples: self.samples.as_deref() }
    }

    /// The values of a channel of floats, where they were measured.
    pub fn floats(&self, part: usize, channel: usize) -> Option<Vec<f32>> {
        self.source().floats(part, channel)
    }
}

/// A frame whose samples are all there, or those that are kept.
#[derive(Clone, Copy)]
pub struct FrameRef<'a> {
    /// The frame.
    pub frame: &'a Frame,
    /// What was measured.
    pub masks: &'a Masks,
    samples: Option<&'a KeptSamples>,
}

impl<'a> FrameRef<'a> {
    /// All of a frame.
    pub fn whole(frame: &'a Frame, masks: &'a Masks) -> Self {
        Self { frame, masks, samples: None }
    }

    /// The values of a channel of floats, where they were measured.
    pub fn floats(self, part: usize, channel: usize) -> Option<Vec<f32>> {
        match self.samples {
            Some(samples) => samples.floats(part, channel, self.masks.get(part, channel).map(|mask| &**mask)),
            None => self.frame.parts.get(part)?.channels.get(channel)?.samples.to_floats(),
        }
    }
}

/// The frames beside one, and what is to be said of those that cannot be used.
#[derive(Clone, Debug, Default)]
pub struct Neighbours {
    /// In the order of their numbers.
    pub all: Vec<Neighbour>,
    /// The numbers of all files that were looked at, those that cannot be used as well.
    pub looked_at: Vec<i64>,
    /// The numbers of those among them that are left out because they were filled before.
    pub filled: Vec<i64>,
    /// The numbers of those that the system refused to give.
    pub unread: Vec<i64>,
    /// One line for each that was left out.
    pub notes: Vec<String>,
}

impl Neighbours {
    /// The frames on one line, as the attribute has them: `2 filled, 3, 4 camera, 6 camera`.
    pub fn line(&self, used: &[(i64, String)]) -> String {
        let one = |number: &i64| match used.iter().find(|used| used.0 == *number) {
            Some((_, how)) => format!("{number} {how}"),
            None if self.unread.contains(number) => format!("{number}{LEFT_UNREAD}"),
            None if self.filled.contains(number) => format!("{number}{LEFT_FILLED}"),
            None => number.to_string(),
        };
        self.looked_at.iter().map(one).collect::<Vec<_>>().join(", ")
    }
}

/// The numbers in such a line.
pub fn numbers(line: &str) -> Vec<i64> {
    line.split(", ").filter_map(|one| one.split(' ').next()?.parse().ok()).collect()
}

/// Whether such a line names a frame that the system refused to give, which it may do another time.
pub fn left_unread(line: &str) -> bool {
    line.split(", ").any(|one| one.ends_with(LEFT_UNREAD))
}

/// Whether such a line names a frame that was left out because it was filled before.
pub fn left_filled(line: &str) -> bool {
    line.split(", ").any(|one| one.ends_with(LEFT_FILLED))
}

/// What the line says of such frames.
const LEFT_FILLED: &str = " filled";
const LEFT_UNREAD: &str = " unread";

/// Why a neighbour is left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Left {
    /// It was filled before.
    Filled,
    /// The system refused to give it.
    Unread(String),
    /// It does not exist, is damaged or does not go with the frame.
    Unfit(String),
}

impl std::fmt::Display for Left {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Filled => "it was filled already (--again takes the pixels that its mask calls measured)",
            Self::Unread(why) | Self::Unfit(why) => why,
        })
    }
}

type Read = Result<(Arc<Frame>, Arc<Masks>, Arc<KeptSamples>), Left>;

/// How the frames beside one are read.
#[derive(Clone, Copy)]
pub struct Reading<'a> {
    /// Where masks come from.
    pub source: &'a mask::Source,
    /// Masks that are files.
    pub masks: &'a MaskFiles,
    /// Whether those that were filled before count by their measured pixels.
    pub again: bool,
    /// Whether complete channels may guide.
    pub guides: bool,
    /// How many are kept for the next frame.
    pub most: usize,
    /// What reading one may take.
    pub limits: Limits,
}

/// A frame, and its files as they were before they were read.
type Known = (NeighbourFile, Vec<Option<State>>);

fn known(file: &NeighbourFile) -> Known {
    (file.clone(), file.sources().map(|(path, _)| State::of(path)).collect())
}

/// Frames that were read, the last ones of a run.
#[derive(Debug, Default)]
pub struct NeighbourFiles {
    kept: Mutex<Vec<(Known, Read)>>,
}

impl NeighbourFiles {
    /// The frames beside a frame of that number.
    pub fn read(
        &self,
        (number, frame): (i64, &Frame),
        files: &[NeighbourFile],
        reading: Reading<'_>,
    ) -> Neighbours {
        let mut found = Neighbours::default();
        let own = shapes(&frame.parts);
        for file in files {
            // One that lacks something is as good as not there, until it has come.
            if file.is_complete() {
                found.looked_at.push(file.number);
            }
            let name = file.input.file_name().map(|name| name.display().to_string()).unwrap_or_default();
            let label = format!("frame {} ({name})", file.number);
            match self.get(file, &own, reading) {
                Ok((frame, masks, samples)) => {
                    let (number, offset) = (file.number, file.number - number);
                    found.all.push(Neighbour { number, offset, label, frame, masks, samples: Some(samples) });
                }
                Err(why) => {
                    match why {
                        Left::Filled => found.filled.push(file.number),
                        Left::Unread(_) => found.unread.push(file.number),
                        Left::Unfit(_) => {}
                    }
                    found.notes.push(format!("filled without {label}: {why}"));
                }
            }
        }
        found
    }

    fn get(&self, file: &NeighbourFile, own: &[Shape], reading: Reading<'_>) -> Read {
        let known = known(file);
        if let Some(read) = self.kept(&known) {
            let read = read?;
            return misfit_of_all(own, &shapes(&read.0.parts)).map_or(Ok(read), |why| Err(Left::Unfit(why)));
        }
        // Whatever is larger than the frame itself is not decoded.
        header(file, own)?;
        let read = read(file, reading);
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        while kept.len() >= reading.most.max(1) {
            drop(kept.remove(0));
        }
        kept.push((known, read.clone()));
        read
    }

    /// One that was read before, which becomes the newest.
    fn kept(&self, known: &Known) -> Option<Read> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let at = kept.iter().position(|(own, _)| own == known)?;
        let entry = kept.remove(at);
        let read = entry.1.clone();
        kept.push(entry);
        Some(read)
    }
}

/// Whether a neighbour may be of use to a frame of these shapes, as its files and their headers tell; the pixels that both their windows have beyond
/// its own.
///
/// # Errors
/// Why it is left out.
pub fn header(file: &NeighbourFile, own: &[Shape]) -> Result<u64, Left> {
    for (path, what) in file.sources() {
        path.metadata().map_err(|error| {
            if lacuna_exr::is_refusal(&error) {
                Left::Unread(format!("its {what} {} cannot be reached: {error}", path.display()))
            } else {
                Left::Unfit(format!("its {what} {} does not exist", path.display()))
            }
        })?;
    }
    let failed = |error: lacuna_exr::Error| of_file(&file.input, &error);
    let parts = lacuna_exr::read_header(&file.input).map_err(failed)?;
    let other = shapes(&parts);
    if let Some(why) = misfit_of_all(own, &other) {
        return Err(Left::Unfit(why));
    }
    lacuna_exr::read_whole_header(&file.input).map_err(failed)?;
    Ok(beyond(own, &other))
}

/// What is wrong with a neighbour's own file, which the line names already.
fn of_file(path: &Path, error: &lacuna_exr::Error) -> Left {
    let text = without(path, &error.to_string());
    if error.is_of_system() { Left::Unread(text) } else { Left::Unfit(text) }
}

/// What is wrong with a file that belongs to a neighbour.
fn of_source(path: &Path, text: String) -> Left {
    let refused = std::fs::File::open(path).is_err_and(|error| lacuna_exr::is_refusal(&error));
    if refused { Left::Unread(text) } else { Left::Unfit(text) }
}

fn without(path: &Path, text: &str) -> String {
    text.strip_prefix(&format!("{}: ", path.display())).unwrap_or(text).into()
}

fn read(file: &NeighbourFile, reading: Reading<'_>) -> Read {
    let Reading { source, masks, limits, .. } = reading;
    let mut frame = lacuna_exr::read(&file.input, &limits).map_err(|error| of_file(&file.input, &error))?;
    layers::read_into(&mut frame, &file.layers, limits)
        .map_err(|(path, why)| of_source(&path, format!("{}: {}", path.display(), without(&path, &why))))?;
    let mask = |path| masks.get(path, limits).map_err(|error| of_source(path, error.to_string()));
    let mask = file.mask.as_deref().map(mask).transpose()?;
    let found =
        mask::find(&frame, source, mask.as_deref()).map_err(|error| Left::Unfit(error.to_string()))?;
    if found.is_empty() {
        return Err(Left::Unfit("no pixel of it was measured".into()));
    }
    if !reading.again && mask::filled_before(&frame, &found).is_some() {
        return Err(Left::Filled);
    }
    let samples = KeptSamples::take_from(&mut frame, &found, reading.guides);
    Ok((Arc::new(frame), Arc::new(found), Arc::new(samples)))
}

#[cfg(test)]
mod tests {
    use lacuna_exr::WriteOptions;

    use super::*;
    use crate::files::layers::LayerFile;
    use crate::testing::{float, frame, part, window};

    /// Whichever was read first, the layers are those of the frame that asks.
    #[test]
    fn a_neighbour_with_another_layer_is_read_anew() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, channels: &[(&str, [f32; 2])]| {
            let channels = channels.iter().map(|(name, values)| float(name, values)).collect();
            let path = folder.path().join(name);
            lacuna_exr::write(
                &frame(vec![part(window(0, 0, 2, 1), channels)]),
                &path,
                &WriteOptions::default(),
            )
            .unwrap();
            path
        };
        let own = frame(vec![part(window(0, 0, 2, 1), vec![float("R", &[0.0; 2])])]);
        let input = write("s.2.exr", &[("R", [0.5; 2]), ("mask", [1.0, 0.0])]);
        let layers = [1.0, 2.0].map(|value| write(&format!("{value}.exr"), &[("R", [value; 2])]));
        let reading = Reading {
            source: &mask::Source::Auto,
            masks: &MaskFiles::default(),
            again: false,
            guides: false,
            most: 4,
            limits: Limits::default(),
        };
        let files = NeighbourFiles::default();
        for (path, value) in layers.into_iter().zip([1.0, 2.0]) {
            let layers = vec![LayerFile { name: "l".into(), path }];
            let file = NeighbourFile { number: 2, input: input.clone(), mask: None, layers };
            let found = files.read((1, &own), &[file], reading);
            assert!(found.notes.is_empty(), "{:?}", found.notes);
            let part = &found.all[0].frame.parts[0];
            let layer = part.channels.iter().position(|channel| channel.display_name() == "l.R").unwrap();
            // What was not measured is not kept.
            assert_eq!(found.all[0].floats(0, layer).unwrap(), [value, 0.0]);
        }
    }

    #[test]
    fn the_attribute_says_what_was_left_out_because_it_was_filled_or_not_to_be_had() {
        let (looked_at, filled, unread) = (vec![2, 3, 4, 5], vec![2], vec![5]);
        let found = Neighbours { looked_at, filled, unread, ..Neighbours::default() };
        let line = found.line(&[(4, "vectors filled by hand".into())]);
        assert_eq!(line, "2 filled, 3, 4 vectors filled by hand, 5 unread");
        assert_eq!(numbers(&line), [2, 3, 4, 5]);
        assert!(left_filled(&line) && !left_filled("3, 4 camera"));
        assert!(left_unread(&line) && !left_unread("2 filled, 4 camera"));
    }
}
