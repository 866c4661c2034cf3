//! Voxels without a header: `--raw 256x256x128:u8`.

use std::path::Path;
use std::str::FromStr;

use super::{Affine, Coding, Element, Error, Header, Place, damaged, io, open};

/// What the command line says about a file without a header.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RawLayout {
    /// Voxels along x (fastest), y, z.
    pub size: [usize; 3],
    /// The type of a voxel.
    pub element: Element,
    /// Whether the most significant byte goes first.
    pub big_endian: bool,
    /// Lengths of a voxel.
    pub spacing: [f64; 3],
}

impl FromStr for RawLayout {
    type Err = String;

    /// `WxHxD:type[:be][:spacing,spacing,spacing]`.
    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.split(':');
        let sizes = parts.next().unwrap_or_default();
        let size: Vec<usize> = sizes.split('x').filter_map(|n| n.parse().ok()).filter(|&n| n > 0).collect();
        let size: [usize; 3] = match size.try_into() {
            Ok(size) if sizes.split('x').count() == 3 => size,
            _ => return Err(format!("'{sizes}' is not a size such as 256x256x128")),
        };
        let element = parts.next().ok_or("a type is missing, such as 256x256x128:u8")?.parse()?;
        let mut layout = Self { size, element, big_endian: false, spacing: [1.0; 3] };
        for part in parts {
            match part {
                "be" => layout.big_endian = true,
                "le" => layout.big_endian = false,
                spacing => {
                    layout.spacing = super::three(spacing)
                        .filter(|spacing: &[f64; 3]| spacing.iter().all(|&s| s > 0.0 && s.is_finite()))
                        .ok_or_else(|| {
                            format!("'{spacing}' is neither le, be nor a spacing such as 1,1,2")
                        })?;
                }
            }
        }
        Ok(layout)
    }
}

impl RawLayout {
    pub(super) fn header(&self) -> Header {
        Header {
            size: self.size,
            element: self.element,
            big_endian: self.big_endian,
            placement: Affine::spacing(self.spacing),
            rescale: None,
        }
    }

    /// A file without a header holds its voxels alone: one of another length is of another size or type.
    pub(super) fn check_length(&self, path: &Path) -> Result<(), Error> {
        let length = open(path)?.metadata().map_err(io(path, "read"))?.len();
        let sizes = self.size.iter().map(|&n| n as u64);
        let bytes = sizes.fold(self.element.bytes() as u64, u64::saturating_mul);
        if length != bytes && Self::place(path).coding == Coding::Plain {
            let [x, y, z] = self.size;
            return Err(damaged(
                path,
                format!(
                    "{length} bytes where {x}x{y}x{z} voxels have {bytes}: give its size and type (--raw) as they are"
                ),
            ));
        }
        Ok(())
    }

    /// A gzipped file is told by its name.
    pub(super) fn place(path: &Path) -> Place {
        let gzip = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("gz"));
        Place { file: path.into(), offset: Some(0), coding: if gzip { Coding::Gzip } else { Coding::Plain } }
    }
}
