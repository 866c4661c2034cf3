//! VTK image data: XML with inline text or base64, or appended raw or base64; plain or zlib.
//!
//! Source: VTK file formats, docs.vtk.org (XML, appended data, compressed blocks).

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use roxmltree::{Document, Node};

use super::{
    Affine, Coding, Element, Error, Grid, Header, Limits, build, check_memory, checked_count, damaged,
    inflate, rest, three,
};
use crate::vector::{Vector, scale};

pub(super) fn read(path: &Path, limits: &Limits) -> Result<Grid, Error> {
    let whole = super::Place { file: path.into(), offset: Some(0), coding: Coding::Plain };
    let bytes = rest(&whole, limits)?;
    let wrong = |why: String| damaged(path, why);
    let (xml, appended) = split(&bytes).map_err(wrong)?;
    let document = Document::parse(&xml).map_err(|error| wrong(format!("not XML: {error}")))?;
    let file = File::new(document.root_element(), appended).map_err(wrong)?;
    let count = checked_count(path, &file.header)?;
    check_memory(path, &file.header, 0, limits)?;
    let values = file.values(count).map_err(wrong)?;
    build(path, &file.header, &values)
}

/// The XML without appended data, and those data behind their underscore.
fn split(bytes: &[u8]) -> Result<(String, Option<&[u8]>), String> {
    let find = |from: usize, what: &[u8]| {
        bytes[from..].windows(what.len()).position(|window| window == what).map(|at| from + at)
    };
    let text =
        |bytes: &[u8]| String::from_utf8(bytes.to_vec()).map_err(|_| "the XML is not UTF-8".to_owned());
    let Some(start) = find(0, b"<AppendedData") else { return Ok((text(bytes)?, None)) };
    let open = find(start, b">").ok_or("truncated: the appended data are missing")?;
    let data = find(open, b"_").ok_or("truncated: the appended data are missing")? + 1;
    let mut xml = text(&bytes[..=open])?;
    if xml.ends_with("/>") {
        return Err("the appended data are empty".into());
    }
    xml.push_str("</AppendedData></VTKFile>");
    Ok((xml, Some(&bytes[data..])))
}

/// How lengths before data are written.
#[derive(Clone, Copy)]
struct Lengths {
    bytes: usize,
    big_endian: bool,
}

struct File<'a> {
    header: Header,
    array: Node<'a, 'a>,
    appended: Option<(&'a [u8], bool)>,
    lengths: Lengths,
    zlib: bool,
}

impl<'a> File<'a> {
    fn new(root: Node<'a, 'a>, appended: Option<&'a [u8]>) -> Result<Self, String> {
        if root.tag_name().name() != "VTKFile" || root.attribute("type") != Some("ImageData") {
            return Err("not VTK image data (VTKFile of type ImageData)".into());
        }
        let big_endian = root.attribute("byte_order") == Some("BigEndian");
        let wide = root.attribute("header_type") == Some("UInt64");
        let zlib = match root.attribute("compressor") {
            None | Some("") => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => return Err(format!("compressor {other} is not read; write with zlib")),
        };
        let named = |name: &'static str| root.descendants().filter(move |node| node.has_tag_name(name));
        let image = named("ImageData").next().ok_or("there is no ImageData")?;
        let mut pieces = named("Piece");
        let piece = pieces.next().ok_or("there is no Piece")?;
        if pieces.next().is_some() {
            return Err("several pieces are not read; write one".into());
        }
        let extent = piece.attribute("Extent").or_else(|| image.attribute("WholeExtent"));
        let (size, first) = extent.and_then(self::extent).ok_or("the extent cannot be read")?;
        let points = named("PointData")
            .next()
            .ok_or("there is no PointData: values of cells are not read, convert them to points")?;
        let wanted = points.attribute("Scalars");
        let arrays = || points.children().filter(|node| node.has_tag_name("DataArray"));
        let chosen = arrays().find(|node| wanted.is_some() && node.attribute("Name") == wanted);
        let array = chosen.or_else(|| arrays().next()).ok_or("there is no DataArray over the points")?;
        if array.attribute("NumberOfComponents").is_some_and(|n| n.trim() != "1") {
            return Err("its array has several components: write one of a single component".into());
        }
        let element = element(array.attribute("type").unwrap_or_default())?;
        let placement = placement(image, first)?;
        let base64 = named("AppendedData").any(|node| node.attribute("encoding") == Some("base64"));
        Ok(Self {
            header: Header { size, element, big_endian, placement, rescale: None },
            array,
            appended: appended.map(|data| (data, base64)),
            lengths: Lengths { bytes: if wide { 8 } else { 4 }, big_endian },
            zlib,
        })
    }

    fn values(&self, count: usize) -> Result<crate::Values, String> {
        let element = self.header.element;
        let expected = count.checked_mul(element.bytes()).ok_or("the extent is beyond all memory")?;
        let text = self.array.text().unwrap_or_default();
        let data = match self.array.attribute("format") {
            Some("ascii") => return element.parse(text.as_bytes(), count),
            Some("binary") => self.decode64(text.trim().as_bytes(), expected)?,
            Some("appended") => {
                let (data, base64) = self.appended.ok_or("truncated: the appended data are missing")?;
                let offset = self.array.attribute("offset").and_then(|text| text.trim().parse().ok());
                let offset: usize = offset.ok_or("the array's offset cannot be read")?;
                let data =
                    data.get(offset..).ok_or("truncated: the array lies behind the end of the file")?;
                if base64 { self.decode64(data, expected)? } else { self.unpack(data, expected)?.0 }
            }
            other => return Err(format!("data of format {other:?} are not read")),
        };
        Ok(element.decode(data, self.header.big_endian))
    }

    /// Data behind their length or table of lengths.
    fn unpack(&self, data: &[u8], expected: usize) -> Result<(Vec<u8>, usize), String> {
        if !self.zlib {
            let length = self.lengths.get(data, 0)?;
            if length != expected {
                return Err(format!("{length} bytes of voxels where the extent promises {expected}"));
            }
            let start = self.lengths.bytes;
            let plain = start.checked_add(length).and_then(|end| data.get(start..end));
            let plain =
                plain.ok_or_else(|| format!("truncated: fewer than the {expected} bytes of voxels"))?;
            return Ok((plain.to_vec(), start));
        }
        let (sizes, start) = self.blocks(data, expected)?;
        Self::inflate_blocks(&sizes, &data[start..], expected).map(|plain| (plain, start))
    }

    /// Plain and packed length of every block, and where the first one begins.
    fn blocks(&self, data: &[u8], expected: usize) -> Result<(Vec<(usize, usize)>, usize), String> {
        let word = |k: usize| self.lengths.get(data, k);
        let (count, full, last) = (word(0)?, word(1)?, word(2)?);
        if count > data.len() / self.lengths.bytes {
            return Err(format!("truncated: {count} compressed blocks are promised"));
        }
        let plain = |k: usize| if k + 1 == count && last != 0 { last } else { full };
        let sizes: Vec<_> =
            (0..count).map(|k| word(3 + k).map(|packed| (plain(k), packed))).collect::<Result<_, _>>()?;
        let sum = sizes.iter().try_fold(0_usize, |sum, size| sum.checked_add(size.0));
        if sum != Some(expected) {
            let sum = sum.map_or_else(|| "too many".into(), |sum| sum.to_string());
            return Err(format!("blocks of {sum} bytes where the extent promises {expected}"));
        }
        Ok((sizes, (3 + count) * self.lengths.bytes))
    }

    fn inflate_blocks(sizes: &[(usize, usize)], data: &[u8], expected: usize) -> Result<Vec<u8>, String> {
        let mut plain = Vec::new();
        let mut at: usize = 0;
        for &(full, packed) in sizes {
            let end = at.checked_add(packed).filter(|&end| end <= data.len());
            let end =
                end.ok_or_else(|| format!("truncated after {} of {expected} bytes of voxels", plain.len()))?;
            plain.append(&mut inflate::inflate(&data[at..end], Coding::Zlib, full)?);
            at = end;
        }
        Ok(plain)
    }

    /// Base64 data: the lengths are encoded apart from the data if these are compressed.
    fn decode64(&self, text: &[u8], expected: usize) -> Result<Vec<u8>, String> {
        let decode = |text: &[u8]| STANDARD.decode(text).map_err(|error| format!("damaged base64: {error}"));
        let encoded = |bytes: usize| bytes.div_ceil(3) * 4;
        let take = |from: usize, length: usize| {
            let end = from.checked_add(length).filter(|&end| end <= text.len());
            end.map(|end| &text[from..end]).ok_or_else(|| "truncated: the base64 data end early".to_owned())
        };
        if !self.zlib {
            let all = self.lengths.bytes.checked_add(expected).ok_or("the extent is beyond all memory")?;
            return self.unpack(&decode(take(0, encoded(all))?)?, expected).map(|(plain, _)| plain);
        }
        let word = self.lengths.bytes;
        let count = self.lengths.get(&decode(take(0, encoded(3 * word))?)?, 0)?;
        let table = count.checked_add(3).and_then(|n| n.checked_mul(word)).ok_or("too many blocks")?;
        let head = encoded(table);
        let (sizes, _) = self.blocks(&decode(take(0, head)?)?, expected)?;
        let packed = sizes.iter().try_fold(0_usize, |sum, size| sum.checked_add(size.1)).ok_or("too long")?;
        Self::inflate_blocks(&sizes, &decode(take(head, encoded(packed))?)?, expected)
    }
}

impl Lengths {
    fn get(self, data: &[u8], k: usize) -> Result<usize, String> {
        let start = k * self.bytes;
        let word = data.get(start..start + self.bytes).ok_or("truncated: the lengths are missing")?;
        let mut bytes = [0; 8];
        bytes[..self.bytes].copy_from_slice(word);
        if self.big_endian {
            bytes[..self.bytes].reverse();
        }
        usize::try_from(u64::from_le_bytes(bytes)).map_err(|_| "a length is beyond all memory".into())
    }
}

/// Voxels along each axis and the index of the first one.
fn extent(text: &str) -> Option<([usize; 3], Vector)> {
    let ends: [i64; 6] = super::numbers(text)?.try_into().ok()?;
    let axis = |k: usize| usize::try_from(ends[2 * k + 1].checked_sub(ends[2 * k])?.checked_add(1)?).ok();
    Some(([axis(0)?, axis(1)?, axis(2)?], [0, 1, 2].map(|k| ends[2 * k] as f64)))
}

fn placement(image: Node<'_, '_>, first: Vector) -> Result<Affine, String> {
    let vector = |name: &str, default: Vector| match image.attribute(name) {
        None => Ok(default),
        Some(text) => three(text).ok_or_else(|| format!("{name} cannot be read")),
    };
    let spacing: Vector = vector("Spacing", [1.0; 3])?;
    let mut placement = Affine::spacing(spacing);
    if let Some(text) = image.attribute("Direction") {
        let rows: Vec<f64> =
            super::numbers(text).filter(|m: &Vec<f64>| m.len() == 9).ok_or("Direction cannot be read")?;
        for axis in 0..3 {
            placement.axes[axis] = scale([rows[axis], rows[3 + axis], rows[6 + axis]], spacing[axis]);
        }
    }
    placement.origin = vector("Origin", [0.0; 3])?;
    placement.origin = placement.point(first);
    Ok(placement)
}

fn element(name: &str) -> Result<Element, String> {
    Ok(match name {
        "Int8" => Element::I8,
        "UInt8" => Element::U8,
        "Int16" => Element::I16,
        "UInt16" => Element::U16,
        "Int32" => Element::I32,
        "UInt32" => Element::U32,
        "Float32" => Element::F32,
        "Float64" => Element::F64,
        _ => return Err(format!("voxels of type '{name}' are not read")),
    })
}
