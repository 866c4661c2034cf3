//! The ledger: its lines, several writers, lines cut short, what a signal leaves.

use super::*;

fn heading() -> Heading {
    Heading { lacuna: "1", command: "fill", filter: Some("ss".into()), settings: None }
}

fn item(folder: &Path) -> Item {
    let input = folder.join("in.exr");
    std::fs::write(&input, "abc").unwrap();
    std::fs::write(folder.join("out.exr"), "").unwrap();
    Item {
        number: Some(7),
        input,
        output: folder.join("out.exr"),
        mask: None,
        guides: None,
        layers: Vec::new(),
        neighbours: Vec::new(),
        made_from: Vec::new(),
    }
}

fn record(item: &Item, state: State) -> Record {
    Record {
        frame: item.number,
        input: item.input.display().to_string(),
        output: item.output.display().to_string(),
        state,
        ..Record::default()
    }
}

fn two() -> VecDeque<Waiting> {
    ["1", "2"].map(|frame| Waiting { frame: frame.into(), line: b"{}".into() }).into()
}

fn lines(path: &Path) -> Vec<serde_json::Value> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn a_line_has_the_hashes_that_other_tools_compute() {
    let folder = tempfile::tempdir().unwrap();
    let (item, path) = (item(folder.path()), folder.path().join("ledger.jsonl"));
    let ledger = Ledger::open(Some(&path), &heading()).unwrap();
    ledger.begin(0, &item, &record(&item, State::Pending));
    ledger.end(0, &record(&item, State::Done));
    ledger.end(0, &record(&item, State::Failed));
    ledger.end(1, &record(&item, State::Skipped));
    let lines = lines(&path);
    assert_eq!(lines.len(), 2);
    // The examples of FIPS 180-4: "abc" and the empty text.
    let known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
    assert_eq!(lines[0]["input_sha256"], known);
    let empty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
    assert_eq!(lines[0]["output_sha256"], empty);
    assert_eq!((&lines[0]["state"], &lines[0]["frame"]), (&"done".into(), &7.into()));
    assert_eq!((&lines[0]["command"], &lines[0]["filter"]), (&"fill".into(), &"ss".into()));
    assert_eq!(
        (&lines[1]["state"], &lines[1]["input_sha256"]),
        (&"skipped".into(), &serde_json::Value::Null)
    );
    assert_eq!(ledger.error(), None);
}

#[test]
fn a_signal_gives_what_was_begun_its_line_and_nothing_a_second_one() {
    let folder = tempfile::tempdir().unwrap();
    let (item, path) = (item(folder.path()), folder.path().join("ledger.jsonl"));
    let ledger = Ledger::open(Some(&path), &heading()).unwrap();
    for index in 0..2 {
        ledger.begin(index, &item, &record(&item, State::Pending));
    }
    ledger.end(0, &record(&item, State::Done));
    ledger.clone().stop();
    ledger.end(1, &record(&item, State::Done));
    let states: Vec<_> = lines(&path).iter().map(|line| line["state"].clone()).collect();
    assert_eq!(states, ["done", "stopped"]);
}

#[test]
fn lines_of_several_writers_never_mix() {
    let folder = tempfile::tempdir().unwrap();
    let (item, path) = (item(folder.path()), folder.path().join("ledger.jsonl"));
    std::thread::scope(|scope| {
        for writer in 0..8 {
            let (item, path) = (&item, &path);
            scope.spawn(move || {
                let ledger = Ledger::open(Some(path), &heading()).unwrap();
                for index in 0..25 {
                    let mut record = record(item, State::Failed);
                    record.message = Some("x".repeat(5000 + 100 * writer));
                    ledger.end(index, &record);
                }
                assert_eq!(ledger.error(), None);
            });
        }
    });
    assert_eq!(lines(&path).len(), 200);
}

#[test]
fn a_line_that_was_cut_short_is_closed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ledger.jsonl");
    std::fs::write(&path, "{}\n{\"time\":\"20").unwrap();
    append(&path, &mut two(), || PATIENCE).unwrap();
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "{}\n{\"time\":\"20\n{}\n{}\n");
}

#[test]
fn what_is_no_ledger_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.exr");
    for (text, fits) in [("", true), ("{\"time\"", true), ("v/1\u{1}", false), ("\n{}", false)] {
        std::fs::write(&path, text).unwrap();
        let opened = Ledger::open(Some(&path), &heading());
        assert_eq!(opened.is_ok(), fits, "{text:?}");
        assert!(fits || opened.unwrap_err().contains("frame.exr: the file is no ledger"));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
    }
    assert!(Ledger::open(Some(Path::new("/dev/null")), &heading()).is_ok());
}

#[cfg(unix)]
#[test]
fn a_pipe_needs_a_reader_and_keeps_it() {
    let folder = tempfile::tempdir().unwrap();
    let (item, path) = (item(folder.path()), folder.path().join("pipe"));
    assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
    let error = Ledger::open(Some(&path), &heading()).unwrap_err();
    assert!(error.contains("pipe: the ledger cannot be written: nobody reads the pipe"), "{error}");
    let reader = {
        let path = path.clone();
        std::thread::spawn(move || std::fs::read_to_string(path).unwrap())
    };
    let begun = Instant::now();
    let ledger = loop {
        match Ledger::open(Some(&path), &heading()) {
            Ok(ledger) => break ledger,
            Err(error) => assert!(begun.elapsed() < PATIENCE, "{error}"),
        }
    };
    for index in 0..3 {
        ledger.end(index, &record(&item, State::Done));
    }
    assert_eq!(ledger.close(), None);
    drop(ledger);
    assert_eq!(reader.join().unwrap().lines().count(), 3);
}

#[test]
fn a_lock_that_never_ends_and_a_missing_folder_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ledger.jsonl");
    let held = open(&path).unwrap();
    held.lock().unwrap();
    let mut waiting = two();
    let error = append(&path, &mut waiting, || Duration::from_millis(20)).unwrap_err();
    assert_eq!((error.kind(), waiting.len()), (ErrorKind::TimedOut, 2));
    let error = Ledger::open(Some(&folder.path().join("no/such.jsonl")), &heading()).unwrap_err();
    assert!(error.contains("no/such.jsonl: the ledger cannot be written"), "{error}");
}

#[test]
fn lines_wait_for_a_lock_that_is_not_given_back() {
    let folder = tempfile::tempdir().unwrap();
    let (item, path) = (item(folder.path()), folder.path().join("ledger.jsonl"));
    let ledger = Ledger::open(Some(&path), &heading()).unwrap();
    let held = open(&path).unwrap();
    held.lock().unwrap();
    // As after the first line that has waited in vain.
    ledger.0.as_ref().unwrap().attempt().late = true;
    let begun = Instant::now();
    for index in 0..3 {
        ledger.end(index, &record(&item, State::Done));
    }
    assert!(begun.elapsed() < PATIENCE / 2);
    let error = ledger.error().unwrap();
    assert!(
        error.contains("another process holds its lock; it lacks the lines of frames 7, 7, 7"),
        "{error}"
    );
    assert!(lines(&path).is_empty());
    drop(held);
    assert_eq!(ledger.close(), None);
    assert_eq!(lines(&path).len(), 3);
}

#[test]
fn the_task_is_named_as_the_farm_names_it() {
    let of = |known: &[(&str, &str)]| {
        task(|name| known.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).into()))
    };
    assert_eq!(of(&[]), None);
    assert_eq!(of(&[("SLURM_JOB_ID", "5"), ("SLURM_RESTART_COUNT", "0")]).unwrap(), "5");
    let array = [("SLURM_JOB_ID", "9"), ("SLURM_ARRAY_JOB_ID", "5"), ("SLURM_ARRAY_TASK_ID", "3")];
    assert_eq!(of(&array).unwrap(), "5_3");
    assert_eq!(of(&[&array[..], &[("SLURM_RESTART_COUNT", "2")]].concat()).unwrap(), "5_3+2");
}

#[test]
fn moments_are_written_as_calendars_have_them() {
    let at = |seconds: u64, millis: u64| {
        utc(UNIX_EPOCH + Duration::from_secs(seconds) + Duration::from_millis(millis))
    };
    assert_eq!(at(0, 0), "1970-01-01T00:00:00.000Z");
    assert_eq!(at(951_782_399, 7), "2000-02-28T23:59:59.007Z");
    assert_eq!(at(951_782_400, 0), "2000-02-29T00:00:00.000Z");
    assert_eq!(at(1_709_251_199, 999), "2024-02-29T23:59:59.999Z");
    assert_eq!(at(4_107_542_400, 0), "2100-03-01T00:00:00.000Z");
}
