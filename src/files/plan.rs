//! What is to be done, frame by frame, checked before any work: every output has one input, and none is an input.

use std::collections::{BTreeSet, HashMap};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::files::destinations::Destination;
use crate::files::error::PlanError;
use crate::files::identity::{Places, Sources};
use crate::files::inputs::{Input, Selection, frame_among, resolve};
use crate::files::layers::{LayerFile, LayerSource};
use crate::files::names::folder_of;
use crate::files::neighbours::{self, NeighbourFile};
use crate::files::patterns::Pattern;
use crate::files::reports::is_standard_output;

/// One frame's files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Item {
    /// The frame number, if the name has one.
    pub number: Option<i64>,
    /// Read from here; may not exist.
    pub input: PathBuf,
    /// Written here.
    pub output: PathBuf,
    /// The file with the mask, if the mask comes from a file.
    pub mask: Option<PathBuf>,
    /// The file with the guides, if they come from another one.
    pub guides: Option<PathBuf>,
    /// The files whose channels become layers of the frame.
    pub layers: Vec<LayerFile>,
    /// The frames beside it whose samples it may take.
    pub neighbours: Vec<NeighbourFile>,
    /// Further files that it is made from, with what they are.
    pub made_from: Vec<(&'static str, PathBuf)>,
}

impl Item {
    /// What is made of what.
    fn made(&self) -> (&Path, &Path) {
        (&self.input, &self.output)
    }

    /// The files that the output is made from, and what they are.
    pub fn sources(&self) -> impl Iterator<Item = (&Path, &'static str)> {
        self.own_sources().chain(self.neighbours.iter().flat_map(NeighbourFile::sources))
    }

    /// The same without neighbours that are left out because something of them is missing.
    pub fn used_sources(&self) -> impl Iterator<Item = (&Path, &'static str)> {
        let neighbours = self.neighbours.iter().filter(|file| file.is_complete());
        self.own_sources().chain(neighbours.flat_map(NeighbourFile::sources))
    }

    /// Without the frames beside it.
    fn own_sources(&self) -> impl Iterator<Item = (&Path, &'static str)> {
        let further = self.made_from.iter().map(|(what, path)| (&**path, *what));
        std::iter::once((&*self.input, "input")).chain(self.added()).chain(further)
    }

    /// The files that are read with the input, each named by a flag of its own.
    pub fn added(&self) -> impl Iterator<Item = (&Path, &'static str)> {
        let one = [(self.mask.as_deref(), "mask"), (self.guides.as_deref(), "guides")];
        let one = one.into_iter().filter_map(|(path, what)| Some((path?, what)));
        one.chain(self.layers.iter().map(|layer| (&*layer.path, "layer")))
    }

    /// The files that are read where the output is one of them: two frames are held against each other.
    pub fn compared(&self) -> impl Iterator<Item = (&Path, &'static str)> {
        self.sources().chain(std::iter::once((&*self.output, "other frame")))
    }
}

/// All frames, in the order asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// The frames.
    pub items: Vec<Item>,
    /// Folders of outputs that do not exist yet.
    pub new_folders: BTreeSet<PathBuf>,
}

/// What a plan is made from, besides the selection.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Targets {
    /// File, pattern or folder.
    pub output: PathBuf,
    /// Path or pattern of the mask's file.
    pub mask: Option<String>,
    /// Path or pattern of the guides' file.
    pub guides: Option<String>,
    /// Files whose channels become layers of the frames.
    pub layers: Vec<LayerSource>,
    /// Frames on either side whose samples a frame may take.
    pub neighbours: usize,
    /// Other files that the run reads, with what they are.
    pub also_read: Vec<(&'static str, PathBuf)>,
    /// Other files that the run writes (a report, say).
    pub also_written: Vec<PathBuf>,
    /// Whether folders are made where they are missing.
    pub create_dir: bool,
}

/// Plans a run. Looks at names and folders, opens no frame, changes nothing.
pub fn plan(selection: &Selection, targets: &Targets) -> Result<Plan, PlanError> {
    let mut items = pair(selection, &targets.output, targets.mask.as_deref())?;
    add_guides(&mut items, targets.guides.as_deref())?;
    add_layers(&mut items, &targets.layers)?;
    neighbours::add(&mut items, selection, targets)?;
    let mut places = Places::default();
    check_one_input_each(items.iter().map(Item::made), &mut places)?;
    check_links(&items, selection, &mut places)?;
    checked(items, targets, &mut places)
}

/// Plans a run that makes frames of one file: every number its output, in a folder `NAME.exr` or `NAME.0001.exr`. Looks at
/// names and folders, changes nothing.
pub fn outputs(
    (source, name): (&Path, &str),
    numbers: &[Option<i64>],
    targets: &Targets,
) -> Result<Plan, PlanError> {
    let destination = Destination::parse(&targets.output)?;
    let shown = targets.output.display();
    match (&destination, numbers) {
        (Destination::File(_), [Some(_), ..]) => {
            return Err(PlanError::Usage(format!(
                "{shown}: --frames needs an output pattern (shot.####.exr) or a folder (ends in /)"
            )));
        }
        (Destination::Pattern(_), [None, ..]) => {
            return Err(PlanError::Usage(format!(
                "{shown}: a pattern needs --frames, such as --frames 1-10"
            )));
        }
        _ => {}
    }
    let mask = targets.mask.as_deref().map(MaskPattern::parse).transpose()?;
    let item = |&number: &Option<i64>| {
        let path = number.map_or_else(|| format!("{name}.exr"), |number| format!("{name}.{number:04}.exr"));
        let frame = Input { path: path.into(), number };
        let output = destination.of(&frame)?;
        let mask = mask.as_ref().map(|mask| mask.of(&frame)).transpose()?;
        Ok(Item {
            number,
            input: source.into(),
            output,
            mask,
            guides: None,
            layers: Vec::new(),
            neighbours: Vec::new(),
            made_from: Vec::new(),
        })
    };
    let items: Vec<Item> = numbers.iter().map(item).collect::<Result<_, _>>()?;
    let mut places = Places::default();
    check_one_input_each(items.iter().map(Item::made), &mut places)?;
    checked(items, targets, &mut places)
}

impl Plan {
    /// The plan once every frame is known to be made from these files as well, none of which is written.
    pub fn with_files(
        mut self,
        files: &[(&'static str, PathBuf)],
        targets: &Targets,
    ) -> Result<Self, PlanError> {
        let mut read = Sources::new(files.iter().map(|(what, path)| (&**path, *what)));
        let outputs = self.items.iter().map(|item| &item.output);
        outputs.chain(also_written(targets)).try_for_each(|written| read.check(written))?;
        self.items.iter_mut().for_each(|item| item.made_from = files.to_vec());
        Ok(self)
    }
}

/// The reports that are files.
fn also_written(targets: &Targets) -> impl Iterator<Item = &PathBuf> {
    targets.also_written.iter().filter(|path| !is_standard_output(path))
}

/// The plan of these frames, once nothing that is read is written and every folder is there or may be made.
fn checked(items: Vec<Item>, targets: &Targets, places: &mut Places) -> Result<Plan, PlanError> {
    let also_written: Vec<PathBuf> = also_written(targets).cloned().collect();
    check_no_input_is_written(&items, (&targets.also_read, &also_written), places)?;
    let mut new_folders = BTreeSet::new();
    let mut checked = BTreeSet::new();
    for written in items.iter().map(|item| &item.output).chain(&also_written) {
        if checked.insert(folder_of(written)) {
            check_folder(written, targets.create_dir, &mut new_folders)?;
        }
    }
    Ok(Plan { items, new_folders })
}

/// Every input with its output and mask file, without any check of the file system's state.
pub fn pair(selection: &Selection, output: &Path, mask: Option<&str>) -> Result<Vec<Item>, PlanError> {
    let inputs = resolve(selection)?;
    let destination = Destination::parse(output)?;
    // A list names its files one by one, so that one line is one frame.
    let alone = selection.inputs.is_empty() && inputs.frames.len() == 1;
    if inputs.is_set && !alone && !destination.holds_many() {
        return Err(PlanError::Usage(format!(
            "{0}: several frames need a pattern here, such as shot.####.exr, or a folder ('{0}/')",
            output.display()
        )));
    }
    let mask = mask.map(MaskPattern::parse).transpose()?;
    // A single plain file is not a frame of a sequence, whatever digits its name has, unless its number is asked for.
    let numbered =
        inputs.is_set || destination.is_numbered() || matches!(mask, Some(MaskPattern::PerFrame(_)));
    let item = |input: Input| {
        let output = destination.of(&input)?;
        let mask = mask.as_ref().map(|mask| mask.of(&input)).transpose()?;
        Ok(Item {
            number: input.number.filter(|_| numbered),
            input: input.path,
            output,
            mask,
            guides: None,
            layers: Vec::new(),
            neighbours: Vec::new(),
            made_from: Vec::new(),
        })
    };
    inputs.frames.into_iter().map(item).collect()
}

/// Every frame with the file of its guides.
fn add_guides(items: &mut [Item], guides: Option<&str>) -> Result<(), PlanError> {
    let Some(guides) = guides.map(MaskPattern::parse).transpose()? else { return Ok(()) };
    for item in items {
        item.guides = Some(beside(&guides, item, "--guides-from")?);
    }
    Ok(())
}

/// Every frame with the files of its layers.
fn add_layers(items: &mut [Item], layers: &[LayerSource]) -> Result<(), PlanError> {
    for layer in layers {
        let file = MaskPattern::parse(&layer.pattern)?;
        for item in items.iter_mut() {
            let path = beside(&file, item, "--layers")?;
            item.layers.push(LayerFile { name: layer.name.clone(), path });
        }
    }
    Ok(())
}

/// The file that belongs to a frame, by the number in the frame's name.
fn beside(file: &MaskPattern, item: &Item, flag: &str) -> Result<PathBuf, PlanError> {
    let number = item.number.or_else(|| super::patterns::number_in_name(&item.input));
    let input = Input { path: item.input.clone(), number };
    file.of(&input).map_err(|_| {
        PlanError::Usage(format!(
            "{}: no frame number in the name for the pattern of {flag}",
            item.input.display()
        ))
    })
}

/// The file of the mask: one for all frames, or one a frame.
pub(super) enum MaskPattern {
    One(PathBuf),
    PerFrame(Pattern),
}

impl MaskPattern {
    pub fn parse(text: &str) -> Result<Self, PlanError> {
        if Path::new(text).exists() {
            return Ok(Self::One(text.into()));
        }
        let pattern =
            Pattern::of(Path::new(text)).map_err(|error| PlanError::Usage(format!("{text}: {error}")))?;
        Ok(pattern.map_or_else(|| Self::One(text.into()), Self::PerFrame))
    }

    pub fn of(&self, input: &Input) -> Result<PathBuf, PlanError> {
        match (self, input.number) {
            (Self::One(path), _) => Ok(path.clone()),
            (Self::PerFrame(pattern), Some(number)) => Ok(pattern.file(number)),
            (Self::PerFrame(_), None) => Err(PlanError::Usage(format!(
                "{}: no frame number in the name for the mask's pattern; name one mask file",
                input.path.display()
            ))),
        }
    }
}

/// Checks the reports of a run that makes no frames: they replace no file that the run reads, are no folders, and their own folders
/// exist.
pub fn check_reports<'a>(
    items: &[Item],
    reports: impl IntoIterator<Item = &'a Path>,
) -> Result<(), PlanError> {
    let mut read = Sources::new(items.iter().flat_map(Item::compared));
    for report in reports.into_iter().filter(|path| !is_standard_output(path)) {
        read.check(report)?;
        if report.is_dir() {
            return Err(PlanError::Usage(format!("{}: it is a folder; name a file", report.display())));
        }
        let mut missing = BTreeSet::new();
        check_folder(report, true, &mut missing)?;
        if let Some(folder) = missing.first() {
            let (report, folder) = (report.display(), folder.display());
            return Err(PlanError::Usage(format!(
                "{report}: the folder {folder} does not exist; make it first"
            )));
        }
    }
    Ok(())
}

/// Refuses a run, before it writes anything, in which two inputs have one output, or an output is a file that is read: `made` has
/// every input with an output of it.
pub fn check_apart<'a>(
    made: impl IntoIterator<Item = (&'a Path, &'a Path)>,
    read: impl IntoIterator<Item = (&'a Path, &'static str)>,
) -> Result<(), PlanError> {
    let made: Vec<_> = made.into_iter().collect();
    check_one_input_each(made.iter().copied(), &mut Places::default())?;
    let mut read = Sources::new(read);
    made.iter().try_for_each(|(_, output)| read.check(output))
}

/// Refuses two inputs that would be written to one place; `made` has every input with its output.
fn check_one_input_each<'a>(
    made: impl IntoIterator<Item = (&'a Path, &'a Path)>,
    places: &mut Places,
) -> Result<(), PlanError> {
    let mut owners: HashMap<PathBuf, (&Path, &Path)> = HashMap::new();
    for (input, output) in made {
        let place = places.of(output);
        let Some(other) = owners.insert(place.clone(), (input, output)) else { continue };
        let (own, others) = if other.0 == input { (output, other.1) } else { (input, other.0) };
        if own != others {
            let place = if other.1 == output { output } else { &place };
            return Err(PlanError::Usage(format!(
                "{} and {} would both be written to {}",
                others.display(),
                own.display(),
                place.display()
            )));
        }
    }
    Ok(())
}

/// Refuses to write through a link onto a frame that this run need not have been asked for, as it may be another chunk's.
fn check_links(items: &[Item], selection: &Selection, places: &mut Places) -> Result<(), PlanError> {
    let links = items.iter().map(|item| &item.output).filter(|output| output.is_symlink());
    let links: HashMap<PathBuf, &PathBuf> = links.map(|link| (places.of(link), link)).collect();
    let Some((input, target)) = frame_among(selection, &links) else { return Ok(()) };
    Err(PlanError::Usage(format!(
        "{}: it is a link to {}, a frame of {}; nothing is overwritten in place, remove the link or name another output",
        links[target].display(),
        target.display(),
        input.display()
    )))
}

fn check_no_input_is_written(
    items: &[Item],
    (also_read, also_written): (&[(&'static str, PathBuf)], &[PathBuf]),
    places: &mut Places,
) -> Result<(), PlanError> {
    let also_read = also_read.iter().map(|(what, path)| (&**path, *what));
    let mut read = Sources::new(items.iter().flat_map(Item::sources).chain(also_read));
    for written in items.iter().map(|item| &item.output).chain(also_written) {
        read.check(written)?;
    }
    // An output that is a folder is the failure of its frame.
    if let Some(folder) = also_written.iter().find(|written| written.is_dir()) {
        return Err(PlanError::Usage(format!("{}: it is a folder; name a file", folder.display())));
    }
    let outputs: BTreeSet<PathBuf> = items.iter().map(|item| places.of(&item.output)).collect();
    match also_written.iter().find(|written| outputs.contains(&places.of(written))) {
        Some(written) => Err(PlanError::Usage(format!("{}: would be written twice", written.display()))),
        None => Ok(()),
    }
}

/// Checks that the folder of an output is there, or may be made, and enters one that is to be made.
pub fn check_folder(output: &Path, create_dir: bool, new: &mut BTreeSet<PathBuf>) -> Result<(), PlanError> {
    let folder = folder_of(output);
    match folder.metadata() {
        Ok(found) if found.is_dir() => return Ok(()),
        Err(error) if lacuna_exr::is_refusal(&error) && error.kind() != ErrorKind::NotADirectory => {
            return Err(PlanError::Failed(format!(
                "{}: cannot reach the folder {}: {error}",
                output.display(),
                folder.display()
            )));
        }
        _ => {}
    }
    // Once the folder is made, it would be another place than the one that was checked.
    if folder.ancestors().any(|ancestor| ancestor.ends_with("..") && !ancestor.exists()) {
        return Err(PlanError::Usage(format!(
            "{}: .. stands behind a folder that does not exist; name the folder without it",
            output.display()
        )));
    }
    let leads_nowhere = |ancestor: &&Path| ancestor.is_symlink() && !ancestor.exists();
    if let Some(link) = folder.ancestors().find(leads_nowhere) {
        return Err(PlanError::Failed(format!(
            "{}: {} is a link to {}, which does not exist",
            output.display(),
            link.display(),
            lacuna_exr::behind(link).display()
        )));
    }
    if let Some(file) = folder.ancestors().find(|ancestor| ancestor.exists() && !ancestor.is_dir()) {
        return Err(PlanError::Failed(format!(
            "{}: {} is a file, not a folder",
            output.display(),
            file.display()
        )));
    }
    if !create_dir {
        return Err(PlanError::Usage(format!(
            "{}: the folder {} does not exist (--create-dir makes it)",
            output.display(),
            folder.display()
        )));
    }
    new.insert(folder);
    Ok(())
}

#[cfg(test)]
mod tests;
