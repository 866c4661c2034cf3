//! Plans: pairs of files, links, places that are the same, folders.

use super::*;

struct Room(tempfile::TempDir);

impl Room {
    fn new(names: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        Self(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn plan(&self, inputs: &[&str], output: &str) -> Result<Plan, PlanError> {
        self.plan_with(inputs, output, |_| {})
    }

    fn plan_with(
        &self,
        inputs: &[&str],
        output: &str,
        more: impl Fn(&mut Targets),
    ) -> Result<Plan, PlanError> {
        let inputs = inputs.iter().map(|input| self.path(input)).collect();
        let mut targets = Targets { output: self.path(output), ..Targets::default() };
        more(&mut targets);
        plan(&Selection { inputs, ..Selection::default() }, &targets)
    }
}

fn usage(result: Result<Plan, PlanError>) -> String {
    match result {
        Err(PlanError::Usage(text)) => text,
        other => panic!("not a usage error: {other:?}"),
    }
}

#[test]
fn output_numbers_follow_the_input() {
    let room = Room::new(&["s.0003.exr", "s.0011.exr", "m.03.exr"]);
    let mask = room.path("m.##.exr").to_str().unwrap().to_owned();
    let plan =
        room.plan_with(&["s.####.exr"], "o.%d.exr", |targets| targets.mask = Some(mask.clone())).unwrap();
    let outputs: Vec<_> = plan.items.iter().map(|item| item.output.clone()).collect();
    assert_eq!(outputs, [room.path("o.3.exr"), room.path("o.11.exr")]);
    assert_eq!(plan.items[0].mask, Some(room.path("m.03.exr")));
    assert!(plan.new_folders.is_empty());
}

#[test]
fn a_set_needs_a_place_for_many() {
    let room = Room::new(&["s.0003.exr", "a.exr", "b.exr"]);
    assert!(usage(room.plan(&["s.####.exr"], "o.exr")).contains("pattern"));
    assert!(usage(room.plan(&["*.exr"], "o.exr")).contains("folder"));
    assert!(usage(room.plan(&["a.exr", "b.exr"], "o.exr")).contains("folder"));
    let listed = |lines: &str| {
        std::fs::write(room.path("list"), lines).unwrap();
        let selection = Selection { files_from: Some(room.path("list")), ..Selection::default() };
        pair(&selection, &room.path("o.exr"), None)
    };
    assert_eq!(listed("s.0003.exr\n").unwrap()[0].number, Some(3));
    assert!(listed("a.exr\nb.exr\n").unwrap_err().to_string().contains("folder"));
}

#[test]
fn two_inputs_never_share_an_output() {
    let room = Room::new(&["a.0001.exr", "b.0001.exr"]);
    assert!(usage(room.plan(&["a.0001.exr", "b.0001.exr"], "o.####.exr")).contains("both be written"));
    let plan = room.plan(&["a.0001.exr", "a.0001.exr"], "o.####.exr").unwrap();
    assert_eq!(plan.items.len(), 1);
}

#[test]
fn no_input_is_overwritten_by_any_name() {
    let room = Room::new(&["a.exr", "m.exr"]);
    std::fs::hard_link(room.path("a.exr"), room.path("hard.exr")).unwrap();
    assert!(usage(room.plan(&["a.exr"], "a.exr")).contains("in place"));
    assert!(usage(room.plan(&["a.exr"], "./a.exr")).contains("in place"));
    assert!(usage(room.plan(&["a.exr"], "hard.exr")).contains("in place"));
    assert!(usage(room.plan(&["a.exr"], "")).contains("in place"));
    let mask = room.path("m.exr").to_str().unwrap().to_owned();
    assert!(usage(room.plan_with(&["a.exr"], "m.exr", |t| t.mask = Some(mask.clone()))).contains("mask"));
    let json = |name: &str| vec![room.path(name)];
    assert!(
        usage(room.plan_with(&["a.exr"], "o.exr", |t| t.also_written = json("a.exr"))).contains("in place")
    );
    assert!(usage(room.plan_with(&["a.exr"], "o.exr", |t| t.also_written = json("o.exr"))).contains("twice"));
}

#[cfg(unix)]
#[test]
fn links_to_inputs_and_folders_are_seen_through() {
    let room = Room::new(&["a.exr"]);
    std::os::unix::fs::symlink(room.path("a.exr"), room.path("soft.exr")).unwrap();
    std::fs::create_dir(room.path("d")).unwrap();
    std::os::unix::fs::symlink(room.path("d"), room.path("e")).unwrap();
    std::fs::write(room.path("d/a.exr"), "").unwrap();
    assert!(usage(room.plan(&["a.exr"], "soft.exr")).contains("in place"));
    assert!(usage(room.plan(&["soft.exr"], "a.exr")).contains("in place"));
    assert!(usage(room.plan(&["d/a.exr"], "e")).contains("in place"));
}

#[cfg(unix)]
#[test]
fn links_to_one_file_are_one_output() {
    let room = Room::new(&["s.1.exr", "s.2.exr"]);
    std::fs::create_dir(room.path("l")).unwrap();
    std::os::unix::fs::symlink("s.1.exr", room.path("l/s.2.exr")).unwrap();
    for there in [false, true] {
        let text = usage(room.plan(&["s.%d.exr"], "l/s.%d.exr"));
        assert!(text.contains("s.1.exr and ") && text.contains("both be written to"), "{text}");
        let targets = Targets { output: room.path("l/s.%d.exr"), ..Targets::default() };
        let rendered = |numbers: &[i64]| {
            let numbers: Vec<_> = numbers.iter().map(|&number| Some(number)).collect();
            outputs((&room.path("scene"), "scene"), &numbers, &targets)
        };
        assert!(usage(rendered(&[1, 2])).contains("both be written to"));
        assert!(rendered(&[2, 3]).is_ok());
        // The target is there, or comes with the first frame.
        if !there {
            std::fs::write(room.path("l/s.1.exr"), "").unwrap();
        }
    }
    std::os::unix::fs::symlink("gone", room.path("lost")).unwrap();
    let lost = room.plan_with(&["s.1.exr"], "lost/o.exr", |targets| targets.create_dir = true);
    assert!(lost.unwrap_err().to_string().contains("which does not exist"));
}

#[test]
fn frames_that_are_still_to_come_are_not_written_in_place() {
    let room = Room::new(&[]);
    let selection = Selection {
        inputs: vec![room.path("s.%d.exr")],
        frames: Some("1-2".parse().unwrap()),
        ..Selection::default()
    };
    let to = |output: &str| plan(&selection, &Targets { output: room.path(output), ..Targets::default() });
    assert!(usage(to("./s.%d.exr")).contains("in place"));
    assert!(to("o.%d.exr").is_ok());
}

#[cfg(unix)]
#[test]
fn a_chunk_writes_through_no_link_onto_a_frame_of_another() {
    let room = Room::new(&["s.1.exr", "s.2.exr"]);
    for folder in ["l", "far"] {
        std::fs::create_dir(room.path(folder)).unwrap();
    }
    std::fs::write(room.path("far/store"), "").unwrap();
    std::os::unix::fs::symlink("far/store", room.path("s.4.exr")).unwrap();
    let chunk = |input: &str| {
        let frames = Some("2".parse().unwrap());
        let selection = Selection { inputs: vec![room.path(input)], frames, ..Selection::default() };
        plan(&selection, &Targets { output: room.path("l/s.%d.exr"), ..Targets::default() })
    };
    // The last is a frame that is still to come; a glob has those that are there.
    for (target, inputs) in [
        ("../s.1.exr", &["s.%d.exr", "s.*.exr"][..]),
        ("../far/store", &["s.%d.exr", "s.*.exr"]),
        ("../s.3.exr", &["s.%d.exr"]),
    ] {
        let link = room.path("l/s.2.exr");
        std::os::unix::fs::symlink(target, &link).unwrap();
        for input in inputs {
            let text = usage(chunk(input));
            assert!(text.contains("l/s.2.exr: it is a link to ") && text.contains(input), "{text}");
        }
        std::fs::remove_file(link).unwrap();
    }
    std::os::unix::fs::symlink("elsewhere.exr", room.path("l/s.2.exr")).unwrap();
    assert!(chunk("s.%d.exr").is_ok());
}

#[test]
fn what_a_flag_names_is_not_written() {
    let room = Room::new(&["a.exr", "rules"]);
    let also_read = vec![("file of --rules", room.path("rules"))];
    let text = usage(room.plan_with(&["a.exr"], "rules", |targets| targets.also_read = also_read.clone()));
    assert!(text.contains("the same file as the file of --rules"), "{text}");
}

#[test]
fn folders_are_made_only_when_asked() {
    let room = Room::new(&["a.exr"]);
    assert!(usage(room.plan(&["a.exr"], "x/y/o.exr")).contains("--create-dir"));
    let plan = room.plan_with(&["a.exr"], "x/y/o.exr", |targets| targets.create_dir = true).unwrap();
    assert_eq!(plan.new_folders, BTreeSet::from([room.path("x/y")]));
    let below = room.plan_with(&["a.exr"], "a.exr/o.exr", |targets| targets.create_dir = true);
    assert!(matches!(below, Err(PlanError::Failed(_))));
    // It would be the input once the folder is there.
    for (output, written) in [("new/../a.exr", "r.json"), ("o.exr", "new/../a.exr")] {
        let text = usage(room.plan_with(&["a.exr"], output, |targets| {
            (targets.create_dir, targets.also_written) = (true, vec![room.path(written)]);
        }));
        assert!(text.contains(".. stands behind a folder that does not exist"), "{text}");
    }
}

#[test]
fn numbers_are_needed_where_patterns_are() {
    let room = Room::new(&["a.exr"]);
    assert!(usage(room.plan(&["a.exr"], "o.####.exr")).contains("frame number"));
    assert!(
        usage(room.plan_with(&["a.exr"], "o.exr", |t| t.mask = Some("m.####.exr".into()))).contains("mask")
    );
}
