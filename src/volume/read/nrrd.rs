//! NRRD, attached and detached: raw, gzip and ascii.
//!
//! Source: G. Kindlmann, "Definition of NRRD File Format", teem.sourceforge.net/nrrd/format.html.

use std::path::{Path, PathBuf};

use super::{
    Affine, Coding, Element, Error, Grid, Header, LONGEST_HEADER, Limits, Place, beside, beside_within,
    damaged, head, load, numbers, rest,
};
use crate::vector::Vector;

/// What the lines of a header say, as far as it matters.
#[derive(Default)]
struct Fields {
    element: Option<Element>,
    sizes: Vec<usize>,
    encoding: String,
    big_endian: Option<bool>,
    spacings: Vec<f64>,
    /// Where axes begin and end, of their voxels' edges or, `node`, of their centres.
    mins: Vec<f64>,
    maxs: Vec<f64>,
    centers: Vec<String>,
    kinds: Vec<String>,
    directions: Vec<Option<Vector>>,
    origin: Option<Vector>,
    data_file: Option<String>,
    line_skip: usize,
    byte_skip: i64,
}

pub(super) fn read(path: &Path, limits: &Limits) -> Result<Grid, Error> {
    let bytes = head(path)?;
    let (fields, end) = parse(&bytes).map_err(|why| damaged(path, why))?;
    let header = fields.header().map_err(|why| damaged(path, why))?;
    let coding = match fields.encoding.to_ascii_lowercase().as_str() {
        "raw" => Coding::Plain,
        "gzip" | "gz" => Coding::Gzip,
        "ascii" | "text" | "txt" => Coding::Text,
        other => {
            return Err(damaged(
                path,
                format!("encoding '{other}' is not read; convert to gzip: unu save -f nrrd -e gzip"),
            ));
        }
    };
    let (file, offset) = match &fields.data_file {
        Some(name) => (beside_within(path, name, limits)?, 0),
        None => (path.to_path_buf(), end as u64),
    };
    let mut place = Place { file, offset: Some(offset), coding };
    skip(&mut place, &fields, limits)?;
    load(path, &header, &place, limits)
}

/// The other file that has the voxels, as far as the header can be read.
pub(super) fn voxels(path: &Path) -> Option<PathBuf> {
    let (fields, _) = parse(&head(path).ok()?).ok()?;
    fields.data_file.map(|name| beside(path, &name))
}

/// Passes over the lines and bytes that the header wants left out.
fn skip(place: &mut Place, fields: &Fields, limits: &Limits) -> Result<(), Error> {
    if fields.line_skip > 0 {
        let data = rest(place, limits)?;
        let ends = data.iter().enumerate().filter(|(_, byte)| **byte == b'\n').map(|(at, _)| at);
        let Some(last) = ends.take(fields.line_skip).last() else {
            return Err(damaged(&place.file, "truncated: fewer lines than are to be skipped"));
        };
        place.offset = place.offset.map(|offset| offset + last as u64 + 1);
    }
    match fields.byte_skip {
        -1 if place.coding == Coding::Plain => place.offset = None,
        0 => {}
        bytes if bytes > 0 && place.coding == Coding::Plain => {
            place.offset = place.offset.and_then(|offset| offset.checked_add(bytes as u64));
        }
        _ => return Err(damaged(&place.file, "byte skip: only for raw encoding, -1 or more")),
    }
    Ok(())
}

/// The fields and where the data of an attached header begin.
fn parse(bytes: &[u8]) -> Result<(Fields, usize), String> {
    let mut fields = Fields::default();
    let mut at = 0;
    let mut first = true;
    loop {
        let Some(length) = bytes[at..].iter().position(|&byte| byte == b'\n') else {
            if bytes.len() as u64 >= LONGEST_HEADER {
                return Err("its header is longer than 1 MiB: leave comments and keys out".into());
            }
            if at < bytes.len() {
                field(&mut fields, &String::from_utf8_lossy(&bytes[at..]))?;
            }
            // Only a detached header may end with its last line.
            if fields.data_file.is_none() {
                return Err("truncated: no blank line ends the header; copy it again".into());
            }
            at = bytes.len();
            break;
        };
        let line = String::from_utf8_lossy(&bytes[at..at + length]);
        at += length + 1;
        let line = line.trim_end();
        if line.is_empty() {
            break;
        }
        if !std::mem::take(&mut first) {
            field(&mut fields, line)?;
        }
    }
    Ok((fields, at))
}

fn field(fields: &mut Fields, line: &str) -> Result<(), String> {
    if line.starts_with('#') || line.contains(":=") {
        return Ok(());
    }
    let Some((name, value)) = line.split_once(':') else { return Ok(()) };
    let (name, value) = (name.trim().to_ascii_lowercase().replace(' ', ""), value.trim());
    let wrong = || format!("the field '{line}' cannot be read");
    match name.as_str() {
        "type" => fields.element = Some(element(value)?),
        "sizes" => fields.sizes = numbers(value).ok_or_else(wrong)?,
        "encoding" => value.clone_into(&mut fields.encoding),
        "endian" => match value.to_ascii_lowercase().as_str() {
            "little" => fields.big_endian = Some(false),
            "big" => fields.big_endian = Some(true),
            _ => return Err(format!("endian '{value}': little or big")),
        },
        "spacings" => fields.spacings = numbers(value).ok_or_else(wrong)?,
        "axismins" => fields.mins = numbers(value).ok_or_else(wrong)?,
        "axismaxs" => fields.maxs = numbers(value).ok_or_else(wrong)?,
        "centers" | "centerings" => fields.centers = words(value),
        "kinds" => fields.kinds = words(value),
        "spacedirections" => fields.directions = vectors(value).ok_or_else(wrong)?,
        "spaceorigin" => fields.origin = *vectors(value).ok_or_else(wrong)?.first().ok_or_else(wrong)?,
        "datafile" if value.starts_with("LIST") || value.contains('%') => {
            return Err("voxels spread over several files are not read; join them: unu save".into());
        }
        "datafile" => fields.data_file = Some(value.into()),
        "lineskip" => fields.line_skip = value.parse().map_err(|_| wrong())?,
        "byteskip" => fields.byte_skip = value.parse().map_err(|_| wrong())?,
        _ => {}
    }
    Ok(())
}

fn words(text: &str) -> Vec<String> {
    text.split_whitespace().map(str::to_ascii_lowercase).collect()
}

fn element(name: &str) -> Result<Element, String> {
    Ok(match name {
        "signed char" | "int8" | "int8_t" => Element::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Element::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => Element::I16,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Element::U16,
        "int" | "signed int" | "int32" | "int32_t" => Element::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Element::U32,
        "float" => Element::F32,
        "double" => Element::F64,
        _ => return Err(format!("voxels of type '{name}' are not read")),
    })
}

/// Vectors such as `(1,0,0) none (0,1,0)`.
fn vectors(text: &str) -> Option<Vec<Option<Vector>>> {
    let mut found = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        if let Some(tail) = rest.strip_prefix("none") {
            found.push(None);
            rest = tail.trim_start();
        } else {
            let (inside, tail) = rest.strip_prefix('(')?.split_once(')')?;
            let parts: Vec<f64> = numbers(inside)?;
            found.push(Some(parts.try_into().ok()?));
            rest = tail.trim_start();
        }
    }
    Some(found)
}

impl Fields {
    /// The distance of two voxels along an axis without a direction, and where the first one is if that is told with it.
    fn along(&self, axis: usize) -> Option<(f64, Option<f64>)> {
        let end = |ends: &[f64]| ends.get(axis).copied().filter(|end| end.is_finite());
        // Teem takes the ends for those of cells unless told otherwise.
        let node = self.centers.get(axis).is_some_and(|center| center == "node");
        let count = self.sizes.get(axis)?.saturating_sub(usize::from(node)).max(1);
        let (min, max) = (end(&self.mins), end(&self.maxs));
        let between = || Some((max? - min?) / count as f64).filter(|spacing| *spacing != 0.0);
        let spacing = self.spacings.get(axis).copied().filter(|spacing| spacing.is_finite());
        // A single slice may begin where it ends.
        let spacing = spacing.or_else(between).or(max.and(min).map(|_| 1.0))?;
        Some((spacing, min.map(|min| if node { min } else { min + 0.5 * spacing })))
    }

    /// Whether the voxels along an axis lie side by side, and are not the components of one.
    fn spatial(&self, axis: usize) -> bool {
        let domain = |kind: &String| matches!(kind.as_str(), "domain" | "space" | "time" | "none" | "???");
        self.sizes[axis] == 1
            || (self.kinds.get(axis).is_none_or(domain) && self.directions.get(axis) != Some(&None))
    }

    fn placement(&self, axes: [usize; 3]) -> Affine {
        let mut placement = Affine::spacing([1.0; 3]);
        for (k, axis) in axes.into_iter().enumerate() {
            if let Some(Some(direction)) = self.directions.get(axis) {
                placement.axes[k] = *direction;
            } else if let Some((spacing, first)) = self.along(axis) {
                placement.axes[k][k] = spacing;
                placement.origin[k] = first.unwrap_or_default();
            }
        }
        Affine { origin: self.origin.unwrap_or(placement.origin), ..placement }
    }

    fn header(&self) -> Result<Header, String> {
        // Axes of length 1 besides three others carry nothing: first those that have no place in space.
        let spare = self.sizes.len().saturating_sub(3);
        let placed =
            |axis: usize| matches!(self.directions.get(axis), Some(Some(_))) || self.along(axis).is_some();
        let mut dropped: Vec<usize> = (0..self.sizes.len()).filter(|&axis| self.sizes[axis] == 1).collect();
        dropped.sort_by_key(|&axis| placed(axis));
        dropped.truncate(spare);
        let axes: Vec<usize> = (0..self.sizes.len()).filter(|axis| !dropped.contains(axis)).collect();
        let Ok(axes): Result<[usize; 3], _> = axes.try_into() else {
            return Err(format!("sizes {:?}: a volume has three axes", self.sizes));
        };
        if let Some(axis) = axes.into_iter().find(|&axis| !self.spatial(axis)) {
            return Err(format!(
                "sizes {:?}: axis {axis} has components, not places (kinds, space directions); a volume has three axes of space",
                self.sizes
            ));
        }
        let element = self.element.ok_or("the header names no type")?;
        let placement = self.placement(axes);
        let text = matches!(self.encoding.to_ascii_lowercase().as_str(), "ascii" | "text" | "txt");
        if self.big_endian.is_none() && element.bytes() > 1 && !text {
            return Err("the header does not tell the byte order (endian: little or big)".into());
        }
        Ok(Header {
            size: axes.map(|axis| self.sizes[axis]),
            element,
            big_endian: self.big_endian.unwrap_or(false),
            placement,
            rescale: None,
        })
    }
}
