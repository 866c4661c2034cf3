//! `MetaImage`: `.mhd` with its data beside it, `.mha` with both in one file.
//!
//! Source: the `MetaIO` library's documentation, itk.org/Wiki/MetaIO/Documentation.

use std::path::{Path, PathBuf};

use super::{
    Affine, Coding, Element, Error, Grid, Header, Limits, Place, beside, beside_within, damaged, head, load,
    numbers, three,
};
use crate::vector::scale;

/// What the lines of a header say, as far as it matters.
#[derive(Default)]
struct Fields {
    element: Option<Element>,
    sizes: Vec<usize>,
    big_endian: bool,
    compressed: bool,
    spacing: Option<[f64; 3]>,
    matrix: Option<Vec<f64>>,
    origin: Option<[f64; 3]>,
    header_size: i64,
    text: bool,
    channels: usize,
    data_file: Option<String>,
}

pub(super) fn read(path: &Path, limits: &Limits) -> Result<Grid, Error> {
    let bytes = head(path)?;
    let (fields, end) = parse(&bytes).map_err(|why| damaged(path, why))?;
    let header = fields.header().map_err(|why| damaged(path, why))?;
    let name = fields.data_file.as_deref().unwrap_or_default();
    let local = name.eq_ignore_ascii_case("local");
    if !local && (name.is_empty() || name.starts_with("LIST") || name.contains('%')) {
        return Err(damaged(path, "ElementDataFile must be LOCAL or one file"));
    }
    let coding = match (fields.text, fields.compressed) {
        (true, _) => Coding::Text,
        (_, true) => Coding::Zlib,
        _ => Coding::Plain,
    };
    let offset = match (local, fields.header_size) {
        (true, _) => Some(end as u64),
        (false, -1) if coding == Coding::Plain => None,
        (false, skipped) => Some(skipped.max(0) as u64),
    };
    let file = if local { path.to_path_buf() } else { beside_within(path, name, limits)? };
    load(path, &header, &Place { file, offset, coding }, limits)
}

/// The other file that has the voxels, as far as the header can be read.
pub(super) fn voxels(path: &Path) -> Option<PathBuf> {
    let (fields, _) = parse(&head(path).ok()?).ok()?;
    let name = fields.data_file.filter(|name| !name.eq_ignore_ascii_case("local"))?;
    Some(beside(path, &name))
}

/// The fields and where local data begin: behind the line `ElementDataFile`, which is the last one.
fn parse(bytes: &[u8]) -> Result<(Fields, usize), String> {
    let mut fields = Fields { channels: 1, ..Fields::default() };
    let mut at = 0;
    while at < bytes.len() && fields.data_file.is_none() {
        let length = bytes[at..].iter().position(|&byte| byte == b'\n').unwrap_or(bytes.len() - at);
        field(&mut fields, &String::from_utf8_lossy(&bytes[at..at + length]))?;
        at = (at + length + 1).min(bytes.len());
    }
    Ok((fields, at))
}

fn field(fields: &mut Fields, line: &str) -> Result<(), String> {
    let Some((name, value)) = line.split_once('=') else { return Ok(()) };
    let value = value.trim();
    let wrong = || format!("the field '{}' cannot be read", line.trim());
    let yes = value.eq_ignore_ascii_case("true") || value == "1";
    match name.trim() {
        "ElementType" => fields.element = Some(element(value)?),
        "DimSize" => fields.sizes = numbers(value).ok_or_else(wrong)?,
        "BinaryDataByteOrderMSB" | "ElementByteOrderMSB" => fields.big_endian = yes,
        "BinaryData" => fields.text = !yes,
        "CompressedData" => fields.compressed = yes,
        "ElementSpacing" => fields.spacing = Some(three(value).ok_or_else(wrong)?),
        "TransformMatrix" | "Rotation" | "Orientation" => {
            fields.matrix = Some(numbers(value).filter(|m: &Vec<f64>| m.len() == 9).ok_or_else(wrong)?);
        }
        "Offset" | "Origin" | "Position" => fields.origin = Some(three(value).ok_or_else(wrong)?),
        "HeaderSize" => fields.header_size = value.parse().map_err(|_| wrong())?,
        "ElementNumberOfChannels" => fields.channels = value.parse().map_err(|_| wrong())?,
        "ElementDataFile" => fields.data_file = Some(value.into()),
        _ => {}
    }
    Ok(())
}

fn element(name: &str) -> Result<Element, String> {
    Ok(match name {
        "MET_CHAR" => Element::I8,
        "MET_UCHAR" => Element::U8,
        "MET_SHORT" => Element::I16,
        "MET_USHORT" => Element::U16,
        "MET_INT" => Element::I32,
        "MET_UINT" => Element::U32,
        "MET_FLOAT" => Element::F32,
        "MET_DOUBLE" => Element::F64,
        _ => return Err(format!("voxels of type '{name}' are not read")),
    })
}

impl Fields {
    fn header(&self) -> Result<Header, String> {
        let Ok(size): Result<[usize; 3], _> = self.sizes.clone().try_into() else {
            return Err(format!("DimSize {:?}: a volume has three axes", self.sizes));
        };
        if self.channels != 1 {
            return Err(format!("{} channels: one is read", self.channels));
        }
        let spacing = self.spacing.unwrap_or([1.0; 3]);
        let mut placement = Affine::spacing(spacing);
        if let Some(matrix) = &self.matrix {
            for (axis, row) in matrix.chunks_exact(3).enumerate() {
                placement.axes[axis] = scale([row[0], row[1], row[2]], spacing[axis]);
            }
        }
        placement.origin = self.origin.unwrap_or_default();
        let element = self.element.ok_or("the header names no ElementType")?;
        Ok(Header { size, element, big_endian: self.big_endian, placement, rescale: None })
    }
}
