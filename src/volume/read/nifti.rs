//! NIfTI-1 and NIfTI-2, one file, plain or gzipped.
//!
//! Source: the NIfTI-1 and NIfTI-2 headers, nifti.nimh.nih.gov (sform, qform, `scl_slope`).

use std::io::Read;
use std::path::Path;

use flate2::read::MultiGzDecoder;

use super::{
    Affine, Coding, Element, Error, Grid, Header, Limits, Place, build, check_file, check_memory,
    checked_count, damaged, head, inflate, load, rest,
};
use crate::vector::scale;

const LENGTH_1: usize = 348;
const LENGTH_2: usize = 540;
/// Where voxels may begin at the earliest: behind the header and the flags of extensions.
const FIRST_1: f64 = 352.0;
const FIRST_2: f64 = 544.0;

pub(super) fn read(path: &Path, limits: &Limits) -> Result<Grid, Error> {
    let start = head(path)?;
    let gzip = start.starts_with(&[0x1f, 0x8b]);
    let bytes = if gzip {
        let mut bytes = Vec::new();
        // What is damaged later is found when the voxels are read.
        let _ = MultiGzDecoder::new(start.as_slice()).take(LENGTH_2 as u64).read_to_end(&mut bytes);
        bytes
    } else {
        start
    };
    let (header, offset) = parse(&bytes).map_err(|why| damaged(path, why))?;
    let place = Place { file: path.into(), offset: Some(offset), coding: Coding::Plain };
    if !gzip {
        return load(path, &header, &place, limits);
    }
    // The stream holds the header too: it is decoded and dropped.
    let place = Place { offset: Some(0), coding: Coding::Gzip, ..place };
    let voxels = checked_count(path, &header)?.checked_mul(header.element.bytes());
    let Some(all) = voxels.and_then(|bytes| bytes.checked_add(usize::try_from(offset).ok()?)) else {
        return Err(damaged(path, format!("the size {:?} is beyond all memory", header.size)));
    };
    check_file(&place, all)?;
    check_memory(path, &header, header.element.bytes(), limits)?;
    let packed = rest(&place, limits)?;
    let plain = inflate::inflate(&packed, Coding::Gzip, all).map_err(|why| damaged(path, why))?;
    build(path, &header, &header.element.decode(plain[offset as usize..].to_vec(), header.big_endian))
}

/// Numbers at places of a header, in its byte order.
struct Reader<'a> {
    bytes: &'a [u8],
    big_endian: bool,
}

impl Reader<'_> {
    fn get<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut word = [0; N];
        if let Some(bytes) = self.bytes.get(at..at + N) {
            word.copy_from_slice(bytes);
        }
        if self.big_endian {
            word.reverse();
        }
        word
    }

    fn i16(&self, at: usize) -> i64 {
        i16::from_le_bytes(self.get(at)).into()
    }

    fn i32(&self, at: usize) -> i64 {
        i32::from_le_bytes(self.get(at)).into()
    }

    fn i64(&self, at: usize) -> i64 {
        i64::from_le_bytes(self.get(at))
    }

    fn f32(&self, at: usize) -> f64 {
        f32::from_le_bytes(self.get(at)).into()
    }

    fn f64(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.get(at))
    }
}

/// What both versions say, read into one shape.
struct Facts {
    dim: [i64; 8],
    kind: i64,
    offset: f64,
    pixdim: [f64; 8],
    rescale: (f64, f64),
    qform: bool,
    sform: bool,
    quaternion: [f64; 3],
    shift: [f64; 3],
    rows: [[f64; 4]; 3],
}

fn parse(bytes: &[u8]) -> Result<(Header, u64), String> {
    let little = Reader { bytes, big_endian: false };
    let (version, big_endian) = match (little.get::<4>(0), little.get::<4>(0).map(u8::swap_bytes)) {
        _ if little.i32(0) == LENGTH_1 as i64 => (1, false),
        _ if little.i32(0) == LENGTH_2 as i64 => (2, false),
        _ if little.i32(0).to_le_bytes()[..4] == (LENGTH_1 as i32).to_be_bytes() => (1, true),
        _ if little.i32(0).to_le_bytes()[..4] == (LENGTH_2 as i32).to_be_bytes() => (2, true),
        _ => return Err("not a NIfTI header".into()),
    };
    if bytes.len() < if version == 1 { LENGTH_1 } else { LENGTH_2 } {
        return Err("truncated: the header is not complete".into());
    }
    let reader = Reader { bytes, big_endian };
    let facts = if version == 1 { first(&reader) } else { second(&reader) };
    let single =
        if version == 1 { bytes.get(344..347) == Some(b"n+1") } else { bytes.get(4..7) == Some(b"n+2") };
    if !single {
        return Err("a NIfTI pair (.hdr, .img) is not read; join it to one .nii".into());
    }
    let offset = facts.offset(if version == 1 { FIRST_1 } else { FIRST_2 })?;
    Ok((facts.header(big_endian)?, offset))
}

fn first(r: &Reader<'_>) -> Facts {
    Facts {
        dim: std::array::from_fn(|k| r.i16(40 + 2 * k)),
        kind: r.i16(70),
        offset: r.f32(108),
        pixdim: std::array::from_fn(|k| r.f32(76 + 4 * k)),
        rescale: (r.f32(112), r.f32(116)),
        qform: r.i16(252) > 0,
        sform: r.i16(254) > 0,
        quaternion: std::array::from_fn(|k| r.f32(256 + 4 * k)),
        shift: std::array::from_fn(|k| r.f32(268 + 4 * k)),
        rows: std::array::from_fn(|row| std::array::from_fn(|k| r.f32(280 + 16 * row + 4 * k))),
    }
}

fn second(r: &Reader<'_>) -> Facts {
    Facts {
        dim: std::array::from_fn(|k| r.i64(16 + 8 * k)),
        kind: r.i16(12),
        offset: r.i64(168) as f64,
        pixdim: std::array::from_fn(|k| r.f64(104 + 8 * k)),
        rescale: (r.f64(176), r.f64(184)),
        qform: r.i32(344) > 0,
        sform: r.i32(348) > 0,
        quaternion: std::array::from_fn(|k| r.f64(352 + 8 * k)),
        shift: std::array::from_fn(|k| r.f64(376 + 8 * k)),
        rows: std::array::from_fn(|row| std::array::from_fn(|k| r.f64(400 + 32 * row + 8 * k))),
    }
}

impl Facts {
    /// Where the voxels begin, `first` at the earliest; 0 is not told.
    fn offset(&self, first: f64) -> Result<u64, String> {
        match self.offset {
            0.0 => Ok(first as u64),
            offset if offset >= first && offset < 2_f64.powi(48) => Ok(offset as u64),
            offset => Err(format!("vox_offset {offset}: voxels begin at {first} or behind")),
        }
    }

    /// Slope and intercept, if values are rescaled: a slope of 0 or none that is finite means that they are not.
    fn rescale(&self) -> Result<Option<(f64, f64)>, String> {
        let (slope, intercept) = self.rescale;
        if slope == 0.0 || !slope.is_finite() || self.rescale == (1.0, 0.0) {
            return Ok(None);
        }
        if intercept.is_finite() {
            Ok(Some(self.rescale))
        } else {
            Err(format!("scl_inter {intercept} is no number beside scl_slope {slope}"))
        }
    }

    fn header(&self, big_endian: bool) -> Result<Header, String> {
        let axes = self.dim[0];
        let spare = (4..=7).filter(|&k| (k as i64) <= axes).any(|k| self.dim[k] > 1);
        if !(3..=7).contains(&axes) || spare || self.dim[1..4].iter().any(|&n| n < 1) {
            return Err(format!("dimensions {:?}: a volume has three axes", self.dim));
        }
        let element = match self.kind {
            2 => Element::U8,
            4 => Element::I16,
            8 => Element::I32,
            16 => Element::F32,
            64 => Element::F64,
            256 => Element::I8,
            512 => Element::U16,
            768 => Element::U32,
            kind => return Err(format!("voxels of type {kind} are not read")),
        };
        let size = [self.dim[1] as usize, self.dim[2] as usize, self.dim[3] as usize];
        Ok(Header { size, element, big_endian, placement: self.placement(), rescale: self.rescale()? })
    }

    /// By the sform, else the qform, else the spacing alone.
    fn placement(&self) -> Affine {
        let spacing = [1, 2, 3].map(|k| if self.pixdim[k] > 0.0 { self.pixdim[k] } else { 1.0 });
        if self.sform {
            let column = |k: usize| [self.rows[0][k], self.rows[1][k], self.rows[2][k]];
            return Affine { origin: column(3), axes: [column(0), column(1), column(2)] };
        }
        if !self.qform {
            return Affine::spacing(spacing);
        }
        let [b, c, d] = self.quaternion;
        let a = (1.0 - b * b - c * c - d * d).max(0.0).sqrt();
        let mirror = if self.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
        let axes = [
            [a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c)],
            [2.0 * (b * c - a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d + a * b)],
            [2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a + d * d - b * b - c * c],
        ];
        Affine {
            origin: self.shift,
            axes: [
                scale(axes[0], spacing[0]),
                scale(axes[1], spacing[1]),
                scale(axes[2], spacing[2] * mirror),
            ],
        }
    }
}
