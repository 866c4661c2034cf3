//! The scripts: chunks, quoting, gates.

use super::script::all;
use super::*;

fn job() -> SubmitJob {
    SubmitJob {
        task: Task {
            words: ["fill", "in/it's $x.####.exr", "-o", "out/"].map(String::from).to_vec(),
            existing: Existing::Replace,
            skip_missing: false,
            has_log: false,
            has_time_limit: false,
            sparse: Some("in/it's $x.####.exr".into()),
            mask: None,
            output: "out/".into(),
        },
        frames: vec![1, 2, 3, 4, 5, 6, 7, 9],
        chunk: 3,
        grant: Grant { cpus: 2, memory: Some("4G".into()), at_once: Some(5), ..Grant::default() },
        verify: true,
        reference: None,
        name: "shot".into(),
        logs: "logs".into(),
        program: "/opt/lacuna".into(),
        dry_run: false,
    }
}

fn texts(job: &SubmitJob) -> Vec<(String, String)> {
    all(job).into_iter().map(|script| (script.what, script.text)).collect()
}

#[test]
fn an_array_has_a_task_for_each_chunk_and_verify_all_frames() {
    let scripts = texts(&job());
    let [(fill, array), (verify, gate)] = &scripts[..] else { panic!("{scripts:?}") };
    assert_eq!((fill.as_str(), verify.as_str()), ("fill", "verify"));
    for expected in [
        "#!/bin/bash\n",
        "#SBATCH --array=0-2%5\n",
        "#SBATCH --cpus-per-task=2\n#SBATCH --mem=4G\n",
        "#SBATCH --requeue\n#SBATCH --open-mode=append\n",
        "#SBATCH --output=\"logs/shot-fill-%A_%a.log\"\n",
        "frames=(\n1-3\n4-6\n7,9\n)\n",
        "exec /opt/lacuna fill 'in/it'\\''s $x.####.exr' -o out/ -u --log=logs/shot.jsonl \
         --frames=\"${frames[$SLURM_ARRAY_TASK_ID]}\" --progress=plain\n",
    ] {
        assert!(array.contains(expected), "{expected}\n{array}");
    }
    let expected =
        "exec /opt/lacuna verify 'in/it'\\''s $x.####.exr' out/ --log=logs/shot.jsonl --frames=1-7,9\n";
    assert!(gate.ends_with(expected), "{gate}");
    assert!(gate.contains("#SBATCH --kill-on-invalid-dep=no\n") && !gate.contains("--array"), "{gate}");
}

#[test]
fn what_verify_does_not_know_is_checked_to_be_up_to_date_and_a_reference_adds_a_gate() {
    let mut job = job();
    job.task.sparse = None;
    job.task.has_log = true;
    let bounds = ["--fail-below=psnr=40".to_owned()].to_vec();
    job.reference = Some(Reference { pattern: "full/".into(), bounds });
    let scripts = texts(&job);
    let names: Vec<&str> = scripts.iter().map(|(what, _)| what.as_str()).collect();
    assert_eq!(names, ["fill", "check", "compare"]);
    assert!(!scripts[0].1.contains("--log"), "{}", scripts[0].1);
    assert!(
        scripts[1].1.contains("out/ -u -n --frames=1-7,9 | { ! grep -v -e '^skip  '; }\n"),
        "{}",
        scripts[1].1
    );
    job.task.has_time_limit = true;
    assert!(texts(&job)[1].1.contains("{ ! grep -v -e '^skip  ' -e ': it was cut short$'; }\n"));
    let compare = "compare full/ out/ --fail-below=psnr=40 --log=logs/shot.jsonl --frames=1-7,9\n";
    assert!(scripts[2].1.ends_with(compare), "{}", scripts[2].1);
    job.task.skip_missing = true;
    assert!(texts(&job)[2].1.ends_with(" --missing-frame=skip --frames=1-7,9\n"));
    job.verify = false;
    assert_eq!(texts(&job).len(), 2);
}

#[test]
fn flags_stand_before_the_inputs_and_gates_ask_for_more_than_a_file() {
    let mut job = job();
    job.task.words = ["upscale", "-o", "out/", "--no-clobber", "--", "--no-clobber", "-x.#.exr"]
        .map(String::from)
        .to_vec();
    job.task.existing = Existing::Keep;
    job.task.sparse = None;
    let scripts = texts(&job);
    let array = "upscale -o out/ --no-clobber --log=logs/shot.jsonl --frames=\"${frames[$SLURM_ARRAY_TASK_ID]}\" \
                 --progress=plain -- --no-clobber -x.#.exr\n";
    assert!(scripts[0].1.ends_with(&array.replace("-x.#.exr", "'-x.#.exr'")), "{}", scripts[0].1);
    let check = "upscale -o out/ -u -n --frames=1-7,9 -- --no-clobber '-x.#.exr' | { ! grep";
    assert!(scripts[1].1.contains(check), "{}", scripts[1].1);
    job.task.sparse = Some("-x.exr".into());
    job.task.mask = Some("m/it's.#.png:R".parse().unwrap());
    let verify =
        "verify '--mask=file:m/it'\\''s.#.png:R' --log=logs/shot.jsonl --frames=1-7,9 -- -x.exr out/\n";
    assert!(texts(&job)[1].1.ends_with(verify), "{}", texts(&job)[1].1);
}

#[test]
fn what_users_grant_is_in_every_script() {
    let mut job = job();
    job.grant = Grant {
        cpus: 1,
        time: Some("1:00:00".into()),
        partition: Some("render".into()),
        more: vec!["--account=show".into()],
        ..Grant::default()
    };
    job.logs = "100%".into();
    for (_, text) in texts(&job) {
        let options = "#SBATCH --time=1:00:00\n#SBATCH --partition=render\n";
        assert!(text.contains(options) && text.contains("#SBATCH --account=show\n"), "{text}");
        assert!(text.contains("--output=\"100%%/shot-") && !text.contains("--mem"), "{text}");
    }
}
