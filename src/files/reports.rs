//! The reports of a run: each goes to a place of its own, `-` is standard output.

use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::Path;

use crate::files::error::PlanError;
use crate::files::identity::{Identity, Places};

/// A report that was asked for: its flag and its place.
pub type Asked<'a> = (&'static str, &'a Path);

/// Whether a report of that name goes to standard output.
pub fn is_standard_output(path: &Path) -> bool {
    path == Path::new("-")
}

/// Whether a file, a device or a pipe is what standard output goes to, whatever its name.
fn leads_to_standard_output(path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::fd::AsFd;
        use std::os::unix::fs::MetadataExt;
        let own = std::io::stdout().as_fd().try_clone_to_owned().map(std::fs::File::from);
        let place = |found: std::fs::Metadata| (found.dev(), found.ino());
        let own = own.and_then(|file| file.metadata()).map(place).ok();
        own.is_some_and(|own| path.metadata().map(place).is_ok_and(|other| other == own))
    }
    #[cfg(not(unix))]
    false
}

/// Whether there is a report of a run.
pub fn is_report(path: &Path) -> bool {
    path.is_file() && check_old(("--json", path)).is_ok()
}

/// Refuses reports, or what else a run writes, that would mix or replace each other; `openjd` is whether progress is told on standard output.
pub fn check(reports: &[Asked<'_>], openjd: bool) -> Result<(), PlanError> {
    for (index, (flag, path)) in reports.iter().enumerate() {
        if openjd && (is_standard_output(path) || leads_to_standard_output(path)) {
            return Err(PlanError::Usage(format!(
                "{flag} {} and --progress openjd would both write to standard output; name a file for {flag}",
                path.display()
            )));
        }
        check_old((flag, path))?;
        let same = reports[..index].iter().find(|(_, before)| is_same(before, path));
        let Some((other, _)) = same else { continue };
        return Err(PlanError::Usage(if is_standard_output(path) {
            format!("{other} - and {flag} - would both write to standard output; name a file for {flag}")
        } else {
            format!("{}: would be written twice: {other} and {flag} name the same file", path.display())
        }));
    }
    Ok(())
}

/// Refuses to put a report where none can be, or in the place of a file that is none of its kind, as far as its first and last bytes
/// tell.
fn check_old((flag, path): Asked<'_>) -> Result<(), PlanError> {
    const TOLD: usize = 4096;
    let is: fn(&str, &str) -> bool = match flag {
        // In lines of its own, which those of a ledger are not.
        "--json" => |start, _| start.starts_with("{\n") && start.contains("\n  \"lacuna\": "),
        "--log" => |start, _| start.starts_with('{'),
        "--csv" => |start, _| start.starts_with("frame,"),
        "--md" => |_, end| end.contains("\nlacuna "),
        "--html" | "--report" => |start, _| start.starts_with("<!DOCTYPE html>") && start.contains("lacuna"),
        _ => return Ok(()),
    };
    if is_standard_output(path) {
        return Ok(());
    }
    // The ledger is opened at the beginning, and is not replaced.
    if flag != "--log" {
        lacuna_exr::check_whole(path).map_err(|error| {
            PlanError::Failed(format!("{flag} {}: the report cannot be written: {error}", path.display()))
        })?;
    }
    if !path.metadata().is_ok_and(|found| found.is_file()) {
        return Ok(());
    }
    let ends = || -> std::io::Result<[String; 2]> {
        let mut file = lacuna_exr::open_regular(path)?;
        let mut start = Vec::new();
        Read::by_ref(&mut file).take(TOLD as u64).read_to_end(&mut start)?;
        let length = file.metadata()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(TOLD as u64)))?;
        let mut end = Vec::new();
        file.take(TOLD as u64).read_to_end(&mut end)?;
        Ok([start, end].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()))
    };
    match ends() {
        Ok([start, _]) if start.is_empty() => Ok(()),
        Ok([start, end]) if is(&start, &end) => Ok(()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
        Ok(_) => Err(PlanError::Usage(format!(
            "{flag} {}: there is a file that is no such report; remove it or choose another name",
            path.display()
        ))),
        Err(error) => {
            Err(PlanError::Usage(format!("{flag} {}: cannot read what is there: {error}", path.display())))
        }
    }
}

/// Whether two reports go to one file or stream. A device or a pipe takes both, one after the other.
fn is_same(one: &Path, other: &Path) -> bool {
    if is_standard_output(one) || is_standard_output(other) {
        return one == other;
    }
    if one.metadata().is_ok_and(|found| !found.is_file()) {
        return false;
    }
    let mut places = Places::default();
    let identity = Identity::of(one);
    places.of(one) == places.of(other) || (identity.is_some() && identity == Identity::of(other))
}

/// Writes to standard output; a reader that went away needs nothing.
pub fn print(text: &str) -> Result<(), PlanError> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(PlanError::Failed(format!("cannot write to standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// Writes a report, complete or not at all.
pub fn write(path: &Path, content: &[u8]) -> Result<(), String> {
    let failed =
        |error: &dyn std::fmt::Display| format!("{}: the report is not written: {error}", path.display());
    if is_standard_output(path) {
        let mut out = std::io::stdout().lock();
        return out.write_all(content).and_then(|()| out.flush()).map_err(|error| failed(&error));
    }
    lacuna_exr::write_whole(path, content).map_err(|error| failed(&error))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(reports: &[Asked<'_>], openjd: bool) -> Option<String> {
        check(reports, openjd).err().map(|error| error.to_string())
    }

    #[test]
    fn what_is_no_such_report_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r");
        for (flag, old, stays) in [
            ("--json", "", false),
            ("--json", "{\n  \"lacuna\": \"0.1.0\",", false),
            ("--json", "{\"settings\": 1}", true),
            ("--json", "{\"lacuna\":\"0.1.0\",\"frame\":1}\n", true),
            ("--json", "{\n  \"Name\": \"lacuna\",", true),
            ("--log", "{\"frame\":1}\n", false),
            ("--log", "# notes\n", true),
            ("--log", "\n{}\n", true),
            ("--csv", "frame,reference,test\n", false),
            ("--csv", "name,salary\n", true),
            ("--md", "### Whole image\n\nlacuna 0.1.0: linear values\n", false),
            ("--md", "# lacuna\n", true),
            ("--html", "<!DOCTYPE html>\n<title>lacuna compare</title>", false),
            ("--report", "<!DOCTYPE html>\n<title>home</title>", true),
            ("--report", "\x76\x2f\x31\x01 lacuna", true),
        ] {
            std::fs::write(&path, old).unwrap();
            let text = refusal(&[(flag, &path)], false);
            assert_eq!(text.is_some(), stays, "{flag} {old:?}: {text:?}");
            assert!(text.is_none_or(|text| text.contains("no such report") && text.contains(flag)));
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_report_that_cannot_be_written_is_refused_before_the_work() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r");
        std::fs::write(&path, "").unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o444)).unwrap();
        let text = refusal(&[("--json", &path)], false).unwrap();
        assert!(text.contains("--json") && text.contains("read-only"), "{text}");
    }

    #[test]
    fn each_report_has_a_place_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let (file, again) = (folder.path().join("r"), folder.path().join("./r"));
        let both = [("--json", file.as_path()), ("--report", again.as_path())];
        for _ in 0..2 {
            let text = refusal(&both, false).unwrap();
            assert!(text.contains("written twice") && text.contains("--json and --report"), "{text}");
            // The same if it is there already.
            std::fs::write(&file, "").unwrap();
        }
        #[cfg(unix)]
        {
            let link = folder.path().join("link");
            std::os::unix::fs::symlink(&file, &link).unwrap();
            assert!(refusal(&[("--json", &file), ("--log", &link)], false).is_some());
            let nowhere = Path::new("/dev/null");
            assert_eq!(refusal(&[("--json", nowhere), ("--report", nowhere)], false), None);
        }
        let out = Path::new("-");
        assert_eq!(refusal(&[("--json", out), ("--csv", &file)], false), None);
        assert!(refusal(&[("--json", out), ("--csv", out)], false).unwrap().contains("standard output"));
        assert!(refusal(&[("--csv", out)], true).unwrap().contains("--progress openjd"));
    }
}
