//! What writers that were killed left behind: their temporary files, removed by the next writer in the folder.
//!
//! The name of a temporary file tells the machine and the process that write it: `.NAME.lacuna-HOST-PROCESS-RANDOM.tmp`. Its
//! writer holds a lock on it, which ends with the process; a file that is locked is never removed.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs::{self, DirEntry, File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use super::temporary::is_in_work;

pub(super) const MARK: &str = ".lacuna-";
pub(super) const ENDING: &str = ".tmp";
/// Another machine's file that changed within this time may be in work: some file systems lock on one machine only.
const YOUNG: Duration = Duration::from_mins(2);
/// A clock is ahead by less; what is later still has a wrong time.
const AHEAD: Duration = Duration::from_hours(24);
/// What has not changed for so long is not in work, though a process of its writer's number is there: numbers are used again.
const OLD: Duration = Duration::from_hours(1);
/// How long a folder is not looked through again.
const REST: Duration = Duration::from_mins(5);

/// When this process last looked through each folder.
static SWEPT: Mutex<BTreeMap<PathBuf, Instant>> = Mutex::new(BTreeMap::new());

/// Eight digits that tell this machine since it was started (and, in a container, its numbering of processes) from others.
pub(super) fn host() -> &'static str {
    static HOST: OnceLock<String> = OnceLock::new();
    HOST.get_or_init(|| {
        let kernel = Path::new("/proc/sys/kernel");
        let read = |name: &str| fs::read(kernel.join(name)).unwrap_or_default();
        // Machines may share a name, and the numbering of processes that all begin with has the same number everywhere.
        let mut bytes = [read("hostname"), read("random/boot_id")].concat();
        let processes = fs::read_link("/proc/self/ns/pid").unwrap_or_default();
        bytes.extend(processes.as_os_str().as_encoded_bytes());
        // FNV-1a, which stays the same from build to build.
        let hash = bytes
            .iter()
            .fold(0x811c_9dc5_u32, |hash, &byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
        format!("{hash:08x}")
    })
}

/// The host and the process that wrote the temporary file of that name; `None` if it is not the name of one.
fn owner(name: &OsStr) -> Option<(&str, u32)> {
    let name = name.to_str()?.strip_prefix('.')?.strip_suffix(ENDING)?;
    let (_, owner) = name.rsplit_once(MARK)?;
    let (host, rest) = owner.split_once('-')?;
    let (process, random) = rest.split_once('-')?;
    u64::from_str_radix(random, 16).ok()?;
    Some((host, process.parse().ok()?))
}

/// Removes the temporary files in `folder` that killed processes left behind: of this host when the process is gone, of
/// others when nothing has changed for a while. Once in a few minutes, as a folder may have many files.
pub(super) fn sweep(folder: &Path) {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let mut swept = SWEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if swept.get(folder).is_none_or(|at| at.elapsed() >= REST) {
        swept.insert(folder.into(), Instant::now());
        drop(swept);
        remove_stale(folder);
    }
}

fn remove_stale(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let Some((host, process)) = owner(&name) else { continue };
        let dead = if host == self::host() {
            is_gone(process) || (is_old(&entry) && !is_in_work(&name))
        } else {
            !is_young(&entry)
        };
        if dead && !is_locked(&entry.path()) {
            // Another run may have been faster, or the file may be another user's.
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Whether this system has no such process; without the system's list none is known to be gone.
fn is_gone(process: u32) -> bool {
    let list = Path::new("/proc");
    list.join("self").exists() && !list.join(process.to_string()).exists()
}

/// Whether a process holds the file. Where the file system has no locks, none does; what cannot be opened (another user's, who
/// may still write it) counts as held.
fn is_locked(path: &Path) -> bool {
    // Network file systems lock only what is open for writing. A pipe of that name would wait for a reader, and is not ours.
    if !fs::symlink_metadata(path).is_ok_and(|found| found.is_file()) {
        return true;
    }
    let mut options = File::options();
    options.write(true);
    #[cfg(unix)]
    {
        use rustix::fs::OFlags;
        use std::os::unix::fs::OpenOptionsExt;
        options.custom_flags((OFlags::NONBLOCK | OFlags::NOFOLLOW).bits() as i32);
    }
    let file = options.open(path);
    file.map_or(true, |file| matches!(file.try_lock(), Err(TryLockError::WouldBlock)))
}

/// A time in the future has no age.
fn age(entry: &DirEntry) -> Option<Duration> {
    entry.metadata().and_then(|metadata| metadata.modified()).ok()?.elapsed().ok()
}

fn is_young(entry: &DirEntry) -> bool {
    let modified = entry.metadata().and_then(|metadata| metadata.modified());
    modified.is_ok_and(|modified| match modified.elapsed() {
        Ok(age) => age < YOUNG,
        // Its machine's clock is ahead.
        Err(ahead) => ahead.duration() < AHEAD,
    })
}

fn is_old(entry: &DirEntry) -> bool {
    age(entry).is_some_and(|age| age >= OLD)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::temporary::temporary_name;

    #[test]
    fn owners_are_read_from_names_only_of_temporaries() {
        let own = temporary_name(OsStr::new("shot.lacuna-0-1-2.tmp"));
        assert_eq!(owner(&own), Some((host(), std::process::id())));
        assert_eq!(owner(OsStr::new(".a.exr.lacuna-0badcafe-77-00ff.tmp")), Some(("0badcafe", 77)));
        for other in [
            "a.exr",
            ".a.exr.tmp",
            "a.lacuna-00-77-00ff.tmp",
            ".a.lacuna-77-00ff.tmp",
            ".a.lacuna-00-x-00ff.tmp",
        ] {
            assert_eq!(owner(OsStr::new(other)), None, "{other}");
        }
        let long = temporary_name(OsStr::new(&"ä".repeat(127)));
        assert!(long.len() < 255 && owner(&long).is_some());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_is_no_file_stays_and_is_not_opened() {
        let folder = tempfile::tempdir().unwrap();
        let mut child = std::process::Command::new("true").spawn().unwrap();
        child.wait().unwrap();
        let name = |letter: char| format!(".{letter}.exr.lacuna-{}-{}-01.tmp", host(), child.id());
        let (pipe, link) = (folder.path().join(name('p')), folder.path().join(name('l')));
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        std::os::unix::fs::symlink(&pipe, &link).unwrap();
        let (done, waits) = std::sync::mpsc::channel();
        let path = folder.path().to_path_buf();
        std::thread::spawn(move || {
            remove_stale(&path);
            done.send(()).unwrap();
        });
        assert!(waits.recv_timeout(Duration::from_secs(20)).is_ok(), "waits for the pipe");
        assert!(pipe.symlink_metadata().is_ok() && link.symlink_metadata().is_ok());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn only_what_nobody_writes_any_more_goes() {
        let mut child = std::process::Command::new("true").spawn().unwrap();
        child.wait().unwrap();
        let (dead, alive, here) = (child.id(), std::process::id(), host());
        let folder = tempfile::tempdir().unwrap();
        let add = |name: String, seconds: u64| {
            let file = File::create(folder.path().join(&name)).unwrap();
            file.set_modified(std::time::SystemTime::now() - Duration::from_secs(seconds)).unwrap();
            (name, file)
        };
        let hour = 3600;
        let (held, lock) = add(format!(".a.exr.lacuna-{here}-{dead}-01.tmp"), hour);
        lock.lock().unwrap();
        let (elsewhere, other_lock) = add(format!(".b.exr.lacuna-other-{dead}-01.tmp"), hour);
        other_lock.lock().unwrap();
        let stay = [
            held,
            elsewhere,
            add(format!(".c.exr.lacuna-{here}-{alive}-01.tmp"), hour / 2).0,
            add(format!(".d.exr.lacuna-other-{dead}-01.tmp"), 5).0,
            // The other machine's clock is ahead.
            {
                let (name, file) = add(format!(".j.exr.lacuna-other-{dead}-01.tmp"), 0);
                file.set_modified(std::time::SystemTime::now() + Duration::from_secs(30)).unwrap();
                name
            },
            add("e.exr".into(), hour).0,
        ];
        add(format!(".f.exr.lacuna-{here}-{dead}-01.tmp"), 0);
        add(format!(".g.exr.lacuna-other-{dead}-01.tmp"), hour);
        // Its number has another process now.
        add(format!(".i.exr.lacuna-{here}-{alive}-01.tmp"), 2 * hour);
        let names = || {
            let entries = fs::read_dir(folder.path()).unwrap();
            let mut names: Vec<_> =
                entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
            names.sort();
            names
        };
        sweep(folder.path());
        assert_eq!(names(), stay);
        // The folder rests now.
        let (late, _) = add(format!(".h.exr.lacuna-{here}-{dead}-01.tmp"), 0);
        sweep(folder.path());
        assert!(names().contains(&late));
    }
}
