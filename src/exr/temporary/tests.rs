//! Temporary files: names, permissions, what is left after success, failure and a signal.

use std::io::Write;

use super::*;

fn registry() -> &'static Registry {
    Box::leak(Box::new(Registry::new()))
}

fn names(folder: &Path) -> Vec<OsString> {
    let mut names: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    names
}

#[test]
fn commit_replaces_and_drop_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("täst frame.0001.exr");
    fs::write(&path, "old").unwrap();
    let (temporary, mut file) = Temporary::create(&path, Over::Replace).unwrap();
    file.write_all(b"new").unwrap();
    drop(temporary);
    assert_eq!(fs::read(&path).unwrap(), b"old");
    assert_eq!(names(folder.path()).len(), 1);

    let (temporary, mut file) = Temporary::create(&path, Over::Replace).unwrap();
    file.write_all(b"new").unwrap();
    assert_eq!(names(folder.path()).len(), 2);
    temporary.commit(file).unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"new");
    assert_eq!(names(folder.path()).len(), 1);
}

#[test]
fn no_clobber_keeps_what_is_there_and_what_comes_meanwhile() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let (temporary, file) = Temporary::create(&path, Over::Keep).unwrap();
    fs::write(&path, "meanwhile").unwrap();
    assert!(matches!(temporary.commit(file), Err(Error::Exists)));
    assert!(matches!(Temporary::create(&path, Over::Keep), Err(Error::Exists)));
    assert_eq!(fs::read(&path).unwrap(), b"meanwhile");
    assert_eq!(names(folder.path()), ["a.exr"]);

    let free = folder.path().join("b.exr");
    let (temporary, file) = Temporary::create(&free, Over::Keep).unwrap();
    temporary.commit(file).unwrap();
    assert_eq!(names(folder.path()), ["a.exr", "b.exr"]);
}

#[test]
fn closing_removes_files_in_work_and_refuses_new_ones() {
    let folder = tempfile::tempdir().unwrap();
    let registry = registry();
    let path = folder.path().join("a.exr");
    let (temporary, file) = Temporary::create_in(registry, &path, Over::Replace).unwrap();
    registry.close();
    assert!(names(folder.path()).is_empty());
    assert!(temporary.commit(file).is_err());
    assert!(Temporary::create_in(registry, &path, Over::Replace).is_err());
    assert!(names(folder.path()).is_empty());
}

#[cfg(unix)]
#[test]
fn permissions_links_and_devices() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    // A file that the standard library creates has what the umask leaves.
    fs::write(folder.path().join("plain"), "").unwrap();
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
    let (temporary, file) = Temporary::create(&path, Over::Replace).unwrap();
    temporary.commit(file).unwrap();
    assert_eq!(mode(&path), mode(&folder.path().join("plain")));

    let link = folder.path().join("link.exr");
    symlink(&path, &link).unwrap();
    let (temporary, mut file) = Temporary::create(&link, Over::Replace).unwrap();
    file.write_all(b"through").unwrap();
    temporary.commit(file).unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(fs::read(&path).unwrap(), b"through");

    assert!(Temporary::create(Path::new("/dev/null"), Over::Replace).is_err());
    assert!(Temporary::create(folder.path(), Over::Replace).is_err());
}

#[cfg(unix)]
#[test]
fn links_are_followed_to_files_that_do_not_exist_yet() {
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    symlink("second", at("first")).unwrap();
    symlink("new.json", at("second")).unwrap();
    for content in ["one", "two"] {
        write_whole(&at("first"), content.as_bytes()).unwrap();
        assert_eq!(fs::read(at("new.json")).unwrap(), content.as_bytes());
        assert_eq!(names(folder.path()), ["first", "new.json", "second"]);
        assert!(fs::symlink_metadata(at("first")).unwrap().is_symlink());
    }
    symlink("loop", at("loop")).unwrap();
    symlink("loop", at("to-loop")).unwrap();
    assert!(write_whole(&at("loop/x.json"), b"").is_err());
    for name in ["loop", "to-loop"] {
        let error = check_destination(&at(name), Over::Force).unwrap_err().to_string();
        assert!(error.contains("leads back to itself") && write_whole(&at(name), b"").is_err(), "{error}");
        assert!(at(name).is_symlink());
    }
}

#[cfg(unix)]
#[test]
fn names_that_the_system_does_not_take_are_found_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    for (length, fits) in [(255, true), (256, false)] {
        for above in ["", "new/"] {
            let path = folder.path().join(format!("{above}{}", "n".repeat(length)));
            assert_eq!(check_destination(&path, Over::Replace).is_ok(), fits, "{length} {above}");
        }
    }
}

#[cfg(unix)]
#[test]
fn what_is_no_regular_file_is_written_into() {
    use std::os::unix::fs::FileTypeExt;
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let reader = {
        let pipe = pipe.clone();
        std::thread::spawn(move || fs::read(pipe).unwrap())
    };
    write_whole(&pipe, b"report").unwrap();
    assert_eq!(reader.join().unwrap(), b"report");
    assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
    assert!(write_whole(folder.path(), b"report").is_err());
}

#[cfg(unix)]
#[test]
fn permissions_are_kept_and_read_only_files_only_replaced_by_force() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
    for asked in [0o600, 0o664, 0o444] {
        fs::write(&path, "old").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(asked)).unwrap();
        let read_only = asked == 0o444;
        assert_eq!(matches!(check_destination(&path, Over::Replace), Err(Error::ReadOnly)), read_only);
        assert_eq!(matches!(write_whole(&path, b"no"), Err(Error::ReadOnly)), read_only);
        let (temporary, mut file) = Temporary::create(&path, Over::Force).unwrap();
        assert_eq!(mode(&temporary.path), asked);
        file.write_all(b"new").unwrap();
        temporary.commit(file).unwrap();
        assert_eq!((fs::read(&path).unwrap(), mode(&path)), (b"new".to_vec(), asked));
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
    }
}

#[cfg(unix)]
#[test]
fn the_group_is_kept_or_gets_no_more_than_everybody() {
    use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    for asked in [0o664, 0o640] {
        fs::write(&path, "old").unwrap();
        // Only root gives files to any group.
        let other = fs::metadata(&path).unwrap().gid() + 1234;
        if chown(&path, None, Some(other)).is_err() {
            return;
        }
        fs::set_permissions(&path, fs::Permissions::from_mode(asked)).unwrap();
        let (temporary, file) = Temporary::create(&path, Over::Replace).unwrap();
        temporary.commit(file).unwrap();
        let found = fs::metadata(&path).unwrap();
        assert_eq!((found.gid(), found.permissions().mode() & 0o777), (other, asked));
        fs::remove_file(&path).unwrap();
    }
}

#[cfg(unix)]
#[test]
fn a_link_into_a_missing_folder_says_where_it_leads() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("a.exr");
    std::os::unix::fs::symlink("gone/b.exr", &link).unwrap();
    let text = check_destination(&link, Over::Replace).unwrap_err().to_string();
    assert!(text.contains("a link to") && text.contains("gone/b.exr, whose folder does not exist"), "{text}");
    assert!(check_destination(&folder.path().join("new/b.exr"), Over::Replace).is_ok());
}
