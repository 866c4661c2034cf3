//! What writers that were killed left behind: their temporary files, removed by the next writer in the folder.
//!
//! The name of a temporary file tells the machine and the process that write it: `.NAME.lacuna-HOST-PROCESS-RANDOM.tmp`.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs::{self, DirEntry};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::Duration;

pub(super) const MARK: &str = ".lacuna-";
pub(super) const ENDING: &str = ".tmp";
/// A file that changed within this time may be a writer's that this process cannot see.
const YOUNG: Duration = Duration::from_mins(1);

/// The folders that this process has looked through.
static SWEPT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Eight digits that tell this machine (and, in a container, its numbering of processes) from others.
pub(super) fn host() -> &'static str {
    static HOST: OnceLock<String> = OnceLock::new();
    HOST.get_or_init(|| {
        let name = fs::read("/proc/sys/kernel/hostname").unwrap_or_default();
        let processes = fs::read_link("/proc/self/ns/pid").unwrap_or_default();
        // FNV-1a, which stays the same from build to build.
        let bytes = name.iter().chain(processes.as_os_str().as_encoded_bytes());
        let hash =
            bytes.fold(0x811c_9dc5_u32, |hash, &byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
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

/// Removes the temporary files in `folder` that a process of this host left behind; once for each folder, as a folder
/// may have many files. Those of other hosts stay: nothing here tells whether they are in work.
pub(super) fn sweep(folder: &Path) {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    if SWEPT.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.into()) {
        remove_stale(folder);
    }
}

fn remove_stale(folder: &Path) {
    // Without the system's list of processes every one would seem dead.
    if !Path::new("/proc/self").exists() {
        return;
    }
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let Some((host, process)) = owner(&name) else { continue };
        let dead = || !Path::new("/proc").join(process.to_string()).exists();
        if host == self::host() && dead() && !is_young(&entry) {
            // Another run may have been faster, or the file may be another user's.
            let _ = fs::remove_file(entry.path());
        }
    }
}

fn is_young(entry: &DirEntry) -> bool {
    let changed = entry.metadata().and_then(|metadata| metadata.modified());
    // A time in the future has no age.
    changed.is_ok_and(|changed| changed.elapsed().is_ok_and(|age| age < YOUNG))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::temporary::temporary_name;

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
    fn only_what_a_dead_process_of_this_host_left_a_while_ago_goes() {
        let mut child = std::process::Command::new("true").spawn().unwrap();
        child.wait().unwrap();
        let (dead, alive, here) = (child.id(), std::process::id(), host());
        let folder = tempfile::tempdir().unwrap();
        let add = |name: String, seconds: u64| {
            let file = fs::File::create(folder.path().join(&name)).unwrap();
            file.set_modified(std::time::SystemTime::now() - Duration::from_secs(seconds)).unwrap();
            name
        };
        let stay = [
            add(format!(".a.exr.lacuna-{here}-{dead}-01.tmp"), 5),
            add(format!(".b.exr.lacuna-{here}-{alive}-01.tmp"), 1000),
            add(format!(".c.exr.lacuna-other-{dead}-01.tmp"), 1_000_000),
            add("d.exr".into(), 1000),
        ];
        add(format!(".e.exr.lacuna-{here}-{dead}-01.tmp"), 1000);
        sweep(folder.path());
        let mut names: Vec<_> = fs::read_dir(folder.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        assert_eq!(names, stay);
    }
}
