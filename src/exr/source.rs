//! A file that many threads read at many places.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::Error;

/// An open file and its length.
pub(super) struct Source {
    file: File,
    pub(super) length: u64,
}

/// Opens a file to read it; a pipe, on which opening would wait for a writer, is refused like a folder or a device.
pub fn open_regular(path: &Path) -> std::io::Result<File> {
    if std::fs::metadata(path)?.is_file() {
        File::open(path)
    } else {
        Err(std::io::Error::other("it is not a regular file"))
    }
}

/// The bytes of a small regular file: one of more than `most` bytes is refused.
///
/// # Errors
/// What the system says, and for what is no regular file or too large.
pub fn read_small(path: &Path, most: u64) -> std::io::Result<Vec<u8>> {
    read_most(open_regular(path)?, most)
}

/// All bytes that there are to read.
///
/// # Errors
/// What the system says, and for more than `most` bytes.
pub fn read_most(from: impl Read, most: u64) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    from.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        return Err(std::io::Error::other(format!("it has more than {most} bytes")));
    }
    Ok(bytes)
}

impl Source {
    pub(super) fn open(path: &Path) -> Result<Self, Error> {
        let file = open_regular(path).map_err(Error::io("open"))?;
        let metadata = file.metadata().map_err(Error::io("read"))?;
        Ok(Self { file, length: metadata.len() })
    }

    /// Fills `bytes` from that position on.
    pub(super) fn read(&self, position: u64, bytes: &mut [u8]) -> Result<(), Error> {
        #[cfg(unix)]
        let result = std::os::unix::fs::FileExt::read_exact_at(&self.file, bytes, position);
        #[cfg(windows)]
        let result = {
            let mut done = 0;
            loop {
                let rest = &mut bytes[done..];
                if rest.is_empty() {
                    break Ok(());
                }
                match std::os::windows::fs::FileExt::seek_read(&self.file, rest, position + done as u64) {
                    Ok(0) => break Err(std::io::ErrorKind::UnexpectedEof.into()),
                    Ok(count) => done += count,
                    Err(error) => break Err(error),
                }
            }
        };
        result.map_err(|error| match error.kind() {
            std::io::ErrorKind::UnexpectedEof => Error::Truncated { place: "the pixels".into() },
            _ => Error::Io { action: "read", source: error },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_cut_off() {
        for (length, fits) in [(0, true), (5, true), (6, false), (100, false)] {
            let read = read_most(std::io::repeat(1).take(length), 5);
            assert_eq!(read.is_ok_and(|bytes| bytes.len() as u64 == length), fits, "{length}");
        }
    }
}
