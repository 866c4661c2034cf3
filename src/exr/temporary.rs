//! Outputs that appear complete or not at all: a temporary file beside the destination, renamed at the end.
//!
//! Temporary files in work are registered, so that a signal's thread can remove them before the process ends.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File, OpenOptions};
use std::hash::{BuildHasher, RandomState};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::Error;
use super::stale::{ENDING, MARK, host, sweep};

/// File systems take names of 255 bytes; the rest is for what is added.
const LONGEST_NAME: usize = 180;
/// As many as Linux follows.
const MOST_LINKS: usize = 40;

static IN_WORK: Registry = Registry::new();
/// Reports are small, and written after a signal too.
static REPORTS: Registry = Registry::new();

/// Removes all temporary files in work; writers that are still at it fail. For the end of a process, after a
/// signal: no output can be begun any more.
pub fn remove_temporaries() {
    IN_WORK.close();
}

/// Writes a small file, complete or not at all, also after [`remove_temporaries`]. A symbolic link is followed. What is
/// not a regular file (a device, a pipe) is written into, and so is an open file that is named by its descriptor.
///
/// # Errors
/// For a folder and for what the system refuses.
pub fn write_whole(destination: &Path, content: &[u8]) -> Result<(), Error> {
    if is_stream(destination) {
        let mut file = OpenOptions::new().append(true).open(destination).map_err(Error::io("open"))?;
        return file.write_all(content).map_err(Error::io("write"));
    }
    let (temporary, mut file) = Temporary::create_in(&REPORTS, destination, Over::Replace)?;
    file.write_all(content).map_err(Error::io("write"))?;
    temporary.commit(file)
}

/// Whether [`write_whole`] could begin with that file, as far as can be told without making one.
///
/// # Errors
/// If it is a folder or read-only, or its folder takes no files.
pub fn check_whole(destination: &Path) -> Result<(), Error> {
    if is_stream(destination) { Ok(()) } else { check_destination(destination, Over::Replace) }
}

/// Whether a file is written into, as it is no regular one or an open file's name.
fn is_stream(destination: &Path) -> bool {
    fs::metadata(destination).is_ok_and(|found| !found.is_file() && !found.is_dir())
        || ["/dev/stdout", "/dev/stderr", "/dev/fd", "/proc"]
            .iter()
            .any(|folder| destination.starts_with(folder))
}

/// Whether [`write`](super::write()) could begin with that file, as far as can be told without making one.
///
/// # Errors
/// If the destination is there and stays, is read-only or not a regular file, or its folder (where that is missing, the one that it would be
/// made in) takes no files.
pub fn check_destination(destination: &Path, over: Over) -> Result<(), Error> {
    let path = resolve(destination, over)?;
    // Folders are made where outputs are named, not where links lead.
    if path != destination && !folder_of(&path).is_dir() {
        let text = format!("it is a link to {}, whose folder does not exist", path.display());
        return Err(Error::io("write")(std::io::Error::new(ErrorKind::NotFound, text)));
    }
    #[cfg(unix)]
    {
        use rustix::fs::{Access, access};
        let folder = path.ancestors().skip(1).find(|folder| folder.as_os_str().is_empty() || folder.exists());
        let folder = folder.filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let failed = |error| Error::io("create a file in the output's folder")(error);
        access(folder, Access::WRITE_OK | Access::EXEC_OK).map_err(|error| failed(error.into()))?;
        // The name of the temporary file is no longer than that of the output, or short.
        match fs::symlink_metadata(folder.join(path.file_name().unwrap_or_default())) {
            Err(error) if error.kind() == ErrorKind::InvalidFilename => return Err(failed(error)),
            _ => {}
        }
    }
    Ok(())
}

/// What happens to a file that is there already.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Over {
    /// It is replaced unless it is read-only.
    #[default]
    Replace,
    /// It is replaced.
    Force,
    /// It stays, and writing fails.
    Keep,
}

impl Over {
    /// What flags without force say.
    pub fn unless(no_clobber: bool) -> Self {
        if no_clobber { Self::Keep } else { Self::Replace }
    }
}

/// Whether this process writes a temporary file of that name.
pub(super) fn is_in_work(name: &OsStr) -> bool {
    let has = |registry: &Registry| registry.lock().paths.iter().any(|path| path.file_name() == Some(name));
    has(&IN_WORK) || has(&REPORTS)
}

/// The temporary files of this process.
struct Registry(Mutex<State>);

struct State {
    paths: Vec<PathBuf>,
    closed: bool,
}

impl Registry {
    const fn new() -> Self {
        Self(Mutex::new(State { paths: Vec::new(), closed: false }))
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn close(&self) {
        let mut state = self.lock();
        state.closed = true;
        for path in state.paths.drain(..) {
            // It may be renamed or removed already; at the end of a process nothing else can be done.
            let _ = fs::remove_file(path);
        }
    }
}

/// A file in work; removed when dropped unless [`Temporary::commit`] succeeded.
pub(super) struct Temporary {
    registry: &'static Registry,
    path: PathBuf,
    destination: PathBuf,
    over: Over,
}

impl Temporary {
    /// Creates the temporary file for that destination, with the permissions that the umask leaves.
    pub(super) fn create(destination: &Path, over: Over) -> Result<(Self, File), Error> {
        Self::create_in(&IN_WORK, destination, over)
    }

    fn create_in(registry: &'static Registry, destination: &Path, over: Over) -> Result<(Self, File), Error> {
        let destination = resolve(destination, over)?;
        sweep(destination.parent().unwrap_or(Path::new("")));
        // Created and registered under one lock: no signal comes between.
        let mut state = registry.lock();
        if state.closed {
            return Err(Error::Io { action: "write", source: ErrorKind::Interrupted.into() });
        }
        for _ in 0..16 {
            let path =
                destination.with_file_name(temporary_name(destination.file_name().unwrap_or_default()));
            match create_new(&path, &destination) {
                Ok(file) => {
                    // Tells other processes that it is in work; not every file system can.
                    let _ = file.try_lock();
                    state.paths.push(path.clone());
                    return Ok((Self { registry, path, destination, over }, file));
                }
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(Error::io("create a file in the output's folder")(error)),
            }
        }
        Err(Error::Io {
            action: "create a file in the output's folder",
            source: ErrorKind::AlreadyExists.into(),
        })
    }

    /// Gives the file its final name; whatever had that name before is replaced. Its content is on the disk before the
    /// name is, so that no crash leaves half a file under it, and a server that is out of space says so now.
    pub(super) fn commit(self, file: File) -> Result<(), Error> {
        match file.sync_all() {
            // The file system cannot tell.
            Err(error) if matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => {}
            result => result.map_err(Error::io("write"))?,
        }
        drop(file);
        self.name()?;
        keep_names(&self.destination);
        Ok(())
    }

    fn name(&self) -> Result<(), Error> {
        let rename = || fs::rename(&self.path, &self.destination).map_err(Error::io("rename the output"));
        if self.over != Over::Keep {
            return rename();
        }
        // A hard link fails if the name is taken, which a rename does not. Dropping removes the temporary name.
        match fs::hard_link(&self.path, &self.destination) {
            Ok(()) => Ok(()),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => Err(Error::Exists),
            Err(_) if fs::symlink_metadata(&self.destination).is_ok() => Err(Error::Exists),
            // The file system has no hard links.
            Err(_) => rename(),
        }
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let mut state = self.registry.lock();
        // After a rename there is nothing under that name.
        let _ = fs::remove_file(&self.path);
        state.paths.retain(|path| *path != self.path);
    }
}

fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Puts the names of a file's folder on the disk, so that no crash takes a new one back. Not every file system can, and a folder
/// that may not be listed cannot be opened; the file itself is whole either way.
fn keep_names(file: &Path) {
    let _ = File::open(folder_of(file)).and_then(|folder| folder.sync_all());
}

/// Creates a file that is not there, with group and permissions of the one that it will replace, or those that the umask leaves.
fn create_new(path: &Path, destination: &Path) -> std::io::Result<File> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    let Ok(old) = fs::metadata(destination) else { return options.open(path) };
    #[cfg(unix)]
    {
        use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt, fchown};
        // Nobody may read what nobody could before, not even for a moment.
        let mode = old.permissions().mode() & 0o777;
        let file = options.mode(mode & !0o070).open(path)?;
        let own = file.metadata()?.gid();
        // Where the group is another one, it may do no more than everybody.
        let kept = own == old.gid() || fchown(&file, None, Some(old.gid())).is_ok();
        let mode = if kept { mode } else { mode & (0o707 | (mode & 0o007) << 3) };
        // Not every file system has permissions.
        let _ = file.set_permissions(fs::Permissions::from_mode(mode));
        Ok(file)
    }
    #[cfg(not(unix))]
    {
        let _ = old;
        options.open(path)
    }
}

/// The path to replace: behind a symbolic link its target, so that the link stays.
fn resolve(destination: &Path, over: Over) -> Result<PathBuf, Error> {
    if destination.file_name().is_none() {
        return Err(Error::Io { action: "write", source: ErrorKind::IsADirectory.into() });
    }
    let Ok(metadata) = fs::symlink_metadata(destination) else {
        return Ok(destination.into());
    };
    if over == Over::Keep {
        return Err(Error::Exists);
    }
    let path = if metadata.is_symlink() { behind(destination) } else { destination.into() };
    if path.is_symlink() {
        return Err(Error::io("write")(std::io::Error::other("it is a link that leads back to itself")));
    }
    let Ok(found) = fs::metadata(&path) else { return Ok(path) };
    if !found.is_file() {
        let reason = std::io::Error::other("the output exists and is not a regular file");
        return Err(Error::Io { action: "write", source: reason });
    }
    if over != Over::Force && is_read_only(&path, &found) {
        return Err(Error::ReadOnly);
    }
    Ok(path)
}

/// Whether nobody may write a file, or this process may not.
fn is_read_only(path: &Path, found: &fs::Metadata) -> bool {
    #[cfg(unix)]
    let refused = rustix::fs::access(path, rustix::fs::Access::WRITE_OK).is_err();
    #[cfg(not(unix))]
    let refused = {
        let _ = path;
        false
    };
    refused || found.permissions().readonly()
}

/// What a symbolic link leads to in the end, whether that exists or not: what is written in its place. A loop of links leads to
/// itself.
pub fn behind(link: &Path) -> PathBuf {
    if let Ok(path) = fs::canonicalize(link) {
        return path;
    }
    let mut path = link.to_path_buf();
    for _ in 0..MOST_LINKS {
        let Ok(target) = fs::read_link(&path) else { return path };
        path = path.parent().unwrap_or(Path::new("")).join(target);
    }
    link.into()
}

/// `.NAME.lacuna-HOST-PROCESS-RANDOM.tmp`.
pub(super) fn temporary_name(name: &OsStr) -> OsString {
    let random = RandomState::new().hash_one(std::process::id());
    let mut temporary = OsString::from(".");
    if name.len() <= LONGEST_NAME {
        temporary.push(name);
    } else {
        temporary.push(name.to_string_lossy().chars().take(LONGEST_NAME / 4).collect::<String>());
    }
    temporary.push(format!("{MARK}{}-{}-{random:016x}{ENDING}", host(), std::process::id()));
    temporary
}

#[cfg(test)]
mod tests;
