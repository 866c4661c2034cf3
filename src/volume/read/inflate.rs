//! Deflated voxels: memory grows as data really come, and never beyond what the header promised.

use std::io::Read;

use flate2::bufread::GzDecoder;
use flate2::read::ZlibDecoder;

use super::Coding;

/// No deflate stream holds more bytes than this per byte of its own.
const BEST_RATIO: usize = 1032;
/// The first piece of memory that is taken.
const FIRST: usize = 64 << 20;

/// That so many compressed bytes can hold `expected`.
pub(super) fn check_length(packed: u64, expected: usize) -> Result<(), String> {
    if (expected / BEST_RATIO) as u64 > packed {
        return Err(format!("truncated: {packed} compressed bytes cannot hold {expected} bytes of voxels"));
    }
    Ok(())
}

/// Exactly `expected` bytes from a gzip or zlib stream.
pub(super) fn inflate(packed: &[u8], coding: Coding, expected: usize) -> Result<Vec<u8>, String> {
    check_length(packed.len() as u64, expected)?;
    // What does not give just these bytes in one go, such as several streams in a row, goes piece by piece.
    if expected <= FIRST
        && let Some(plain) = at_once(packed, coding, expected)
    {
        return Ok(plain);
    }
    let mut plain = Vec::with_capacity(expected.min(FIRST));
    let limit = expected as u64 + 1;
    let read = match coding {
        Coding::Zlib => ZlibDecoder::new(packed).take(limit).read_to_end(&mut plain),
        _ => gunzip(packed, limit, &mut plain),
    };
    let got = plain.len();
    match read {
        _ if got > expected => Err(format!("more than the {expected} bytes of voxels that were expected")),
        Ok(_) if got == expected => Ok(plain),
        Ok(_) => Err(format!("truncated: {got} of {expected} bytes of voxels")),
        Err(error) => Err(format!("damaged after {got} of {expected} bytes of voxels: {error}")),
    }
}

/// Members one after the other up to so many bytes of voxels, each held against its checksum. Some writers leave bytes behind the last; the
/// voxels are complete all the same.
fn gunzip(mut packed: &[u8], limit: u64, plain: &mut Vec<u8>) -> std::io::Result<usize> {
    while !packed.is_empty() && plain.len() as u64 + 1 < limit {
        let mut member = GzDecoder::new(packed);
        member.by_ref().take(limit - plain.len() as u64).read_to_end(plain)?;
        packed = member.into_inner();
    }
    Ok(plain.len())
}

/// The bytes of a single stream, if it is whole and holds exactly so many.
fn at_once(packed: &[u8], coding: Coding, expected: usize) -> Option<Vec<u8>> {
    let mut plain = vec![0; expected];
    let mut decompressor = libdeflater::Decompressor::new();
    let got = match coding {
        Coding::Zlib => decompressor.zlib_decompress(packed, &mut plain),
        _ => decompressor.gzip_decompress(packed, &mut plain),
    };
    (got == Ok(expected)).then_some(plain)
}
