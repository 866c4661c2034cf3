//! The files beside a frame: those of its name with other numbers, each with the files that belong to it.

use std::path::{Path, PathBuf};

use crate::files::error::PlanError;
use crate::files::inputs::{Input, Selection};
use crate::files::layers::LayerFile;
use crate::files::patterns::{self, Pattern};
use crate::files::plan::{Item, MaskPattern, Targets};

/// A frame beside another one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NeighbourFile {
    /// Its number.
    pub number: i64,
    /// The file.
    pub input: PathBuf,
    /// The file with its mask, if masks come from files.
    pub mask: Option<PathBuf>,
    /// The files whose channels become layers of it.
    pub layers: Vec<LayerFile>,
}

impl NeighbourFile {
    /// Its file and those that belong to it, and what they are.
    pub fn sources(&self) -> impl Iterator<Item = (&Path, &'static str)> {
        let mask = self.mask.as_deref().map(|mask| (mask, "mask"));
        let layers = self.layers.iter().map(|layer| (&*layer.path, "layer"));
        std::iter::once((&*self.input, "neighbour")).chain(mask).chain(layers)
    }

    /// Whether all of these are there; it is left out otherwise.
    pub fn is_complete(&self) -> bool {
        self.sources().all(|(path, _)| path.exists())
    }
}

/// Gives every frame those beside it that exist, whichever of them this run fills: a chunk sees what the whole sequence does.
pub(super) fn add(items: &mut [Item], selection: &Selection, targets: &Targets) -> Result<(), PlanError> {
    let each = targets.neighbours as i64;
    if each == 0 {
        return Ok(());
    }
    let masks = targets.mask.as_deref().map(MaskPattern::parse).transpose()?;
    let layers = targets.layers.iter().map(|layer| MaskPattern::parse(&layer.pattern));
    let layers: Vec<MaskPattern> = layers.collect::<Result<_, _>>()?;
    let pattern = |input: &PathBuf| Pattern::of(input).ok().flatten();
    let patterns: Vec<Pattern> = selection.inputs.iter().filter_map(pattern).collect();
    for item in items {
        // Whoever asks for the frames beside a single file asks for its number.
        let named = patterns::number_in_name(&item.input);
        item.number = item.number.or(named);
        let asked = item.number.and_then(|number| {
            patterns.iter().find(|pattern| pattern.number_of(&item.input) == Some(number))
        });
        // What a pattern calls the number is it, wherever it stands in the name.
        let own = item.number.filter(|number| asked.is_some() || named == Some(*number));
        let Some(own) = own else { continue };
        for number in (own.saturating_sub(each)..=own.saturating_add(each)).filter(|&other| other != own) {
            let Some(path) = file_of((&item.input, own), number, asked) else { continue };
            let input = Input { path, number: Some(number) };
            let mask = masks.as_ref().map(|masks| masks.of(&input)).transpose()?;
            let layer = |(own_file, pattern): (&LayerFile, &MaskPattern)| {
                let path = match pattern {
                    MaskPattern::PerFrame(_) => pattern.of(&input)?,
                    MaskPattern::One(path) => layer_beside(path, own, number),
                };
                Ok(LayerFile { name: own_file.name.clone(), path })
            };
            let layers = item.layers.iter().zip(&layers).map(layer).collect::<Result<_, PlanError>>()?;
            item.neighbours.push(NeighbourFile { number, input: input.path, mask, layers });
        }
    }
    Ok(())
}

/// The file of another number beside a frame: as the pattern that was asked for pads it, else as the frame's own name lets expect. A
/// link that leads nowhere is one, and so is what the system does not show, so that what is missing is said.
fn file_of((own, own_number): (&Path, i64), number: i64, asked: Option<&Pattern>) -> Option<PathBuf> {
    let of_pattern =
        asked.into_iter().flat_map(|pattern| [Some(pattern.path(number)), pattern.alternative(number)]);
    let here = of_pattern.flatten().filter(|path| path.parent() == own.parent());
    let is_named = patterns::number_in_name(own) == Some(own_number);
    let named = is_named.then(|| patterns::beside(own, number)).into_iter().flatten();
    let all: Vec<PathBuf> = here.chain(named).collect();
    let may_be = |path: &&PathBuf| {
        path.symlink_metadata()
            .map_or_else(|error| lacuna_exr::is_refusal(&error), |found| found.is_symlink())
    };
    all.iter().find(|path| path.exists()).or_else(|| all.iter().find(may_be)).cloned()
}

/// A neighbour's file of a layer that is named for one frame: that of its number, if the name has the frame's, else the same one.
fn layer_beside(path: &Path, own: i64, number: i64) -> PathBuf {
    if patterns::number_in_name(path) != Some(own) {
        return path.into();
    }
    let names = patterns::beside(path, number);
    names.iter().find(|name| name.exists()).or(names.first()).cloned().unwrap_or_else(|| path.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::layers::LayerSource;
    use crate::files::plan::plan;

    /// What stands beside the frames of a run with these inputs, in a folder with these files: `10: 8 9 11`.
    fn beside(files: &[&str], inputs: &[&str], layers: &[&str]) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        for name in files {
            std::fs::write(path(name), "").unwrap();
        }
        std::fs::create_dir(path("out")).unwrap();
        let inputs = inputs.iter().map(|name| path(name)).collect();
        let layer = |text: &&str| LayerSource { name: "l".into(), pattern: path(text).display().to_string() };
        let targets = Targets {
            output: path("out"),
            neighbours: 3,
            layers: layers.iter().map(layer).collect(),
            ..Targets::default()
        };
        let name = |path: &Path| path.file_name().unwrap().display().to_string();
        let all = |file: &NeighbourFile| {
            let names: Vec<String> = file.sources().map(|(path, _)| name(path)).collect();
            names.join("+")
        };
        let items = plan(&Selection { inputs, ..Selection::default() }, &targets).unwrap().items;
        let line = |item: &Item| {
            let files: Vec<String> = item.neighbours.iter().map(all).collect();
            format!("{}: {}", item.number.unwrap(), files.join(" "))
        };
        items.iter().map(line).collect()
    }

    #[test]
    fn neighbours_have_fewer_digits_where_numbers_are_not_padded() {
        let files = ["s.8.exr", "s.9.exr", "s.10.exr", "s.11.exr"];
        for inputs in [&["s.%d.exr"][..], &["s.*.exr"], &["s.8.exr", "s.9.exr", "s.10.exr"]] {
            let lines = beside(&files, inputs, &[]);
            assert!(lines.contains(&"10: s.8.exr s.9.exr s.11.exr".into()), "{lines:?}");
            assert!(lines.contains(&"9: s.8.exr s.10.exr s.11.exr".into()), "{lines:?}");
        }
        let outgrown = ["s.9998.exr", "s.9999.exr", "s.10000.exr"];
        assert_eq!(beside(&outgrown, &["s.####.exr"], &[])[2], "10000: s.9998.exr s.9999.exr");
    }

    #[test]
    fn one_number_is_one_file_of_the_padding_asked_for() {
        let files = ["s.9.exr", "s.09.exr", "s.10.exr"];
        assert_eq!(beside(&files, &["s.%d.exr"], &[])[1], "10: s.9.exr");
        assert_eq!(beside(&files, &["s.##.exr"], &[])[1], "10: s.09.exr");
        assert_eq!(beside(&files, &["s.10.exr"], &[])[0], "10: s.09.exr");
        // A name that shows its padding has neighbours of the same.
        assert_eq!(beside(&["s.08.exr", "s.9.exr"], &["s.08.exr"], &[])[0], "8: ");
    }

    #[test]
    fn versions_are_no_neighbours() {
        let files = ["s_0001_v2.exr", "s_0002_v1.exr", "s_0002_v2.exr", "s_0002_v3.exr", "s_0003_v2.exr"];
        let of_two = "2: s_0001_v2.exr s_0003_v2.exr";
        assert_eq!(beside(&files, &["s_0002_v2.exr"], &[])[0], of_two);
        assert!(beside(&files, &["s_*_v2.exr"], &[]).contains(&of_two.into()));
        assert_eq!(beside(&files, &["s_####_v2.exr"], &[])[1], of_two);
        // A pattern says what counts.
        assert_eq!(beside(&files, &["s_0002_v%d.exr"], &[])[0], "1: s_0002_v2.exr s_0002_v3.exr");
    }

    #[cfg(unix)]
    #[test]
    fn a_link_that_leads_nowhere_is_a_neighbour_that_lacks_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("s.1.exr"), "").unwrap();
        std::os::unix::fs::symlink(path("gone.exr"), path("s.2.exr")).unwrap();
        std::fs::create_dir(path("out")).unwrap();
        let targets = Targets { output: path("out"), neighbours: 1, ..Targets::default() };
        let selection = Selection { inputs: vec![path("s.1.exr")], ..Selection::default() };
        let items = plan(&selection, &targets).unwrap().items;
        assert_eq!(items[0].neighbours[0].input, path("s.2.exr"));
        assert!(!items[0].neighbours[0].is_complete());
    }

    #[test]
    fn neighbours_have_layers_of_their_own() {
        let files = ["s.1.exr", "s.2.exr", "a.1.exr", "a.2.exr", "all.exr"];
        assert_eq!(beside(&files, &["s.%d.exr"], &["a.%d.exr"])[0], "1: s.2.exr+a.2.exr");
        assert_eq!(beside(&files, &["s.2.exr"], &["a.2.exr", "all.exr"])[0], "2: s.1.exr+a.1.exr+all.exr");
    }
}
