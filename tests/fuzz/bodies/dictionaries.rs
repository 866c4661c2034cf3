//! Dictionaries and encoded frames: whole files, and files whose archive is sound and whose arrays are not.

use std::io::{Cursor, Write};

use lacuna::dictionary::{Stored, code};
use lacuna_filters::dictionary::dct;
use zip::write::SimpleFileOptions;

const ARRAYS: [&str; 15] = [
    "atoms",
    "block",
    "channels",
    "sparsity",
    "stride",
    "frames",
    "signals",
    "iterations",
    "seed",
    "blocks_max",
    "approximate",
    "errors",
    "usage",
    "data_hash",
    "code_lengths",
];

/// The first byte says what the others are.
pub fn body(data: &[u8]) {
    let Some((&what, bytes)) = data.split_first() else { return };
    match what % 3 {
        0 => drop(Stored::read(&super::file("dictionaries.npz", bytes), super::MOST)),
        1 => drop(Stored::read(&super::file("dictionaries.npz", &archive(bytes)), super::MOST)),
        _ => {
            let dictionary = dct::dictionary(4, 16).unwrap();
            drop(code::decode(bytes, &dictionary, super::MOST));
        }
    }
}

/// An archive of arrays, each with a part of the bytes: a length, then its content.
fn archive(mut bytes: &[u8]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for name in ARRAYS {
        let Some(([low, high], rest)) = bytes.split_first_chunk() else { break };
        let length = usize::from(u16::from_le_bytes([*low, *high])).min(rest.len());
        let (content, rest) = rest.split_at(length);
        bytes = rest;
        archive.start_file(format!("{name}.npy"), SimpleFileOptions::default()).unwrap();
        archive.write_all(content).unwrap();
    }
    archive.finish().unwrap().into_inner()
}
