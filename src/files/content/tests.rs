use std::time::{Duration, UNIX_EPOCH};

use super::*;

struct Room(tempfile::TempDir);

impl Room {
    fn path(&self, name: &str) -> std::path::PathBuf {
        self.0.path().join(name)
    }

    /// A file of so many bytes with the time of all others, one of them changed.
    fn write(&self, name: &str, length: usize, changed: Option<usize>) {
        let mut bytes: Vec<u8> = (0..length).map(|at| ((at * at) >> 7) as u8).collect();
        if let Some(at) = changed {
            bytes[at] ^= 1;
        }
        std::fs::write(self.path(name), bytes).unwrap();
        let file = std::fs::File::options().write(true).open(self.path(name)).unwrap();
        file.set_modified(UNIX_EPOCH + Duration::from_secs(1_600_000_000)).unwrap();
    }
}

#[test]
fn a_copy_is_the_same_and_another_file_of_the_name_is_another() {
    let room = Room(tempfile::tempdir().unwrap());
    let (input, copy) = (room.path("a"), room.path("b"));
    let seen = |path| Seen::new([(path, "input")]);
    for length in [0, 1, 1000, 65_536, 65_537, 69_632, 69_633, 1 << 20] {
        room.write("a", length, None);
        room.write("b", length, None);
        let line = seen(&*input).line(&Sums::default());
        assert_eq!(seen(&*copy).line(&Sums::default()), line);
        assert_eq!(seen(&*copy).differs(&line, &Sums::default()), None, "{length}");
        for at in [0, length / 3, length / 2, length.saturating_sub(1)].into_iter().filter(|at| *at < length)
        {
            room.write("a", length, Some(at));
            let why = seen(&*input).differs(&line, &Sums::default()).unwrap();
            assert!(why.starts_with("the input ") && why.ends_with(" is another one"), "{why}");
        }
    }
}

#[test]
fn a_file_is_known_by_each_of_its_bytes() {
    let room = Room(tempfile::tempdir().unwrap());
    let input = room.path("a");
    let length = 1 << 20;
    room.write("a", length, None);
    let line = Seen::new([(&*input, "input")]).line(&Sums::default());
    let differs = |line: &str| Seen::new([(&*input, "input")]).differs(line, &Sums::default());
    for at in [70_000, 0, length - 1] {
        room.write("a", length, Some(at));
        assert!(differs(&line).is_some(), "{at}");
    }
    room.write("a", length - 1, None);
    assert!(differs(&line).is_some());
    assert!(differs("input=-").is_some());
    std::fs::remove_file(&input).unwrap();
    assert!(differs("input=-").is_none() && differs(&line).is_some());
    room.write("a", length, None);
    assert!(differs(&line).is_none());
    for other in ["", "mask=1", &format!("{line} {line}"), "input=1", "input=x:y"] {
        assert!(differs(other).is_some(), "{other}");
    }
}

#[test]
fn a_source_that_is_written_to_or_replaced_has_changed() {
    let room = Room(tempfile::tempdir().unwrap());
    let (input, mask) = (room.path("a"), room.path("m"));
    room.write("a", 10, None);
    room.write("m", 10, None);
    // Else another file gets its number within the system's tick.
    std::fs::hard_link(&mask, room.path("kept")).unwrap();
    let seen = || Seen::new([(&*input, "input"), (&*mask, "mask")]);
    let (sums, before) = (Sums::default(), seen());
    before.line(&sums);
    assert_eq!(before.changed(&sums), None);
    // As rsync does it: another file of that name, with the same size and time.
    room.write("new", 10, Some(3));
    std::fs::rename(room.path("new"), &mask).unwrap();
    assert_eq!(before.changed(&sums), Some((&*mask, "mask")));
    // The same with another number, as some mounts have it after a while.
    let before = seen();
    before.line(&sums);
    room.write("new", 10, Some(3));
    std::fs::rename(room.path("new"), &mask).unwrap();
    assert_eq!(before.changed(&sums), None);
    let before = seen();
    std::fs::write(&input, "0123456789").unwrap();
    assert_eq!(before.changed(&sums), Some((&*input, "input")));
    std::fs::remove_file(&input).unwrap();
    assert_eq!(before.changed(&sums), Some((&*input, "input")));
}
