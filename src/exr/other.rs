//! Outputs that are no EXR files (PNG, text, JSON), which appear complete or not at all like frames do.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;

use super::Error;
use super::temporary::{Over, Temporary};

/// Writes a file by `content`; it appears under its name when that is done, or not at all.
///
/// # Errors
/// [`Error::Exists`] if `no_clobber` and the file exists, and what the system refuses.
pub fn write_other(
    path: &Path,
    no_clobber: bool,
    content: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), Error> {
    let (temporary, file) = Temporary::create(path, Over::unless(no_clobber))?;
    let mut output = BufWriter::with_capacity(1 << 20, file);
    content(&mut output).map_err(Error::io("write"))?;
    let file = output.into_inner().map_err(|error| Error::io("write")(error.into_error()))?;
    temporary.commit(file)
}
