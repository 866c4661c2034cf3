"""lacuna as a worker of a farm: signals, repeated and doubled work, what killed workers leave, the ledger, progress, and the job
template of Open Job Description. Slurm has tests/test_slurm.py."""

import hashlib
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import frames
import slurm
from tool import LACUNA, ROOT, SAMPLES, lacuna, quick_fill, run, wait_until_at_work

# Work without an end in sight.
ENDLESS = ["--filter", "tv", "--tv-gap", "1e-300", "--tv-iterations", "4000000000"]
OPENJD = pathlib.Path(sys.executable).with_name("openjd")
TEMPLATE = SAMPLES / "farm" / "sequence.yaml"


@pytest.fixture
def shot(tmp_path):
    """Four sparse frames as a pattern, the pattern of their outputs, and a ledger."""
    shutil.copytree(SAMPLES / "sequence", tmp_path / "in")
    (tmp_path / "out").mkdir()
    return tmp_path / "in" / "shot.####.exr", tmp_path / "out" / "shot.####.exr", tmp_path / "ledger.jsonl"


def corner(number, folder):
    """A part of a sparse frame: the default filter has many to fill."""
    [part] = frames.read(SAMPLES / "sequence" / f"shot.{(number - 1) % 4 + 1:04d}.exr")
    frames.write(folder / f"shot.{number:04d}.exr", {name: plane[72:120, 72:120] for name, plane in part.items()})


def start(*words):
    return subprocess.Popen([LACUNA, *map(str, words)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def waits_for_a_reader(process):
    """Whether a thread of it opens a pipe that nobody reads, as the kernel tells."""
    try:
        return any(task.read_text() == "wait_for_partner" for task in pathlib.Path(f"/proc/{process.pid}/task").glob("*/wchan"))
    except OSError:
        return False


def ledger(path):
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def states(path):
    return sorted((entry["frame"], entry["state"]) for entry in ledger(path))


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_termination_abandons_the_frame_at_hand_and_a_rerun_does_the_rest(shot):
    source, out, log = shot
    quick_fill(source, "-o", out, "--frames", "1", "--log", log)
    process = start("fill", source, "-o", out, "--frames", "2-4", "--log", log, "--json", out.parent.parent / "r.json", *ENDLESS)
    wait_until_at_work(process)
    assert process.poll() is None, "ended before the signal"
    process.send_signal(signal.SIGTERM)
    begin = time.monotonic()
    assert process.wait(30) == 143
    assert time.monotonic() - begin < 5
    assert "stopped by a signal" in process.stderr.read()
    assert set(contents(out.parent)) == {"shot.0001.exr"}
    assert states(log)[:2] == [(1, "done"), (2, "stopped")]
    told = {frame["frame"]: frame["state"] for frame in json.loads((out.parent.parent / "r.json").read_text())["frames"]}
    assert set(states(log)[1:]) <= set(told.items()) and set(told.values()) <= {"stopped", "pending"}

    quick_fill(source, "-o", out, "-u", "--log", log)
    again = ledger(log)[-4:]
    assert {entry["frame"]: entry["state"] for entry in again} == {1: "skipped", 2: "done", 3: "done", 4: "done"}
    assert len(contents(out.parent)) == 4


@pytest.mark.parametrize("words", [["fill", "--json"], ["fill", "--report"], ["compare", "--csv"]])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_report_that_nobody_reads_holds_no_signal_up(shot, words, number):
    source, out, log = shot
    pipe = log.with_name("pipe")
    os.mkfifo(pipe)
    command, flag = words
    rest = [source, "-o", out, "--filter", "ss", "--no-estimate"] if command == "fill" else [source, source]
    process = start(command, *rest, flag, pipe, "--log", log, "--threads", "1")
    begun = time.monotonic()
    while len(ledger(log)) < 4 and time.monotonic() < begun + 60:
        time.sleep(0.05)
    begun = time.monotonic()
    while not waits_for_a_reader(process) and time.monotonic() < begun + 2:
        time.sleep(0.01)
    assert process.poll() is None, "it does not wait for a reader"
    begun = time.monotonic()
    process.send_signal(number)
    assert process.wait(timeout=60) == 128 + number
    assert time.monotonic() - begun < 5
    process.stderr.close()
    assert not [name for name in contents(out.parent) if name.startswith(".")]


def test_a_ledger_says_what_became_of_each_frame(shot):
    source, out, log = shot
    broken = source.with_name("shot.0003.exr")
    broken.write_bytes(broken.read_bytes()[:2000])
    assert quick_fill(source, "-o", out, "--log", log, ok=False).status == 1
    assert states(log) == [(1, "done"), (2, "done"), (3, "failed"), (4, "done")]
    for entry in ledger(log):
        name = f"shot.{entry['frame']:04d}.exr"
        assert (entry["input"], entry["output"]) == (str(source.with_name(name)), str(out.with_name(name)))
        assert entry["input_sha256"] == sha256(source.with_name(name))
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", entry["time"])
        assert (entry["command"], entry["filter"]) == ("fill", "ss") and "domain" in entry["settings"]
        assert entry["host"] == os.uname().nodename and entry["process"] > 0
        assert set(entry["seconds"]) == {"read", "solve", "write"}
        if entry["state"] == "done":
            assert entry["output_sha256"] == sha256(out.with_name(name)) and entry["density"] > 0.1
        else:
            assert entry["output_sha256"] is None and "shot.0003.exr" in entry["message"]


@pytest.mark.parametrize("command", ["verify", "compare", "sparsify", "upscale", "render"])
def test_every_command_keeps_the_ledger(shot, command):
    source, out, log = shot
    full = SAMPLES / "full" / "sequence" / "shot.####.exr"
    words = {
        "verify": [source, out],
        "compare": [full, out],
        "sparsify": [full, "-o", out, "--density", "0.2"],
        "upscale": [source, "-o", out, "--scale", "2"],
        "render": [SAMPLES / "scenes" / "vessels.toml", "-o", out, "--size", "32x32", "--density", "0.2"],
    }[command]
    if command in ("verify", "compare"):
        quick_fill(source, "-o", out)
    lacuna(command, *words, "--frames", "1-2", "--log", log)
    assert states(log) == [(1, "done"), (2, "done")]
    assert {entry["command"] for entry in ledger(log)} == {command}


def test_workers_that_are_given_the_same_frames_leave_one_good_file_of_each(shot):
    source, out, log = shot
    quick_fill(source, "-o", out)
    expected = contents(out.parent)
    for path in out.parent.iterdir():
        path.unlink()
    flags = ["fill", source, "-o", out, "--log", log, "--filter", "ss", "--no-estimate"]
    workers = [start(*flags, *more) for more in ([], [], ["-u"], ["-u"], ["--no-clobber"], ["--frames", "4-1"])]
    for worker in workers:
        assert worker.wait(60) == 0, worker.stderr.read()
    assert contents(out.parent) == expected
    # No line is lost, and none is mixed with another.
    assert len(ledger(log)) == 4 * len(workers)
    hashes = {(entry["frame"], entry["output_sha256"]) for entry in ledger(log) if entry["state"] == "done"}
    assert len(hashes) == 4


def test_what_a_killed_worker_leaves_is_cleaned_up_by_the_next(tmp_path):
    pixels = np.random.default_rng(1).random((900, 900, 3), np.float32)
    frames.write_sparse(tmp_path / "big.exr", pixels, frames.shuffle(900, 900, 0.9))
    shutil.copyfile(SAMPLES / "sequence" / "shot.0001.exr", tmp_path / "small.exr")
    out = tmp_path / "out"
    out.mkdir()
    worker = start("fill", tmp_path / "big.exr", "-o", out / "big.exr", "--filter", "nearest", "--compression", "zip:12")
    slurm.wait_for("a temporary file", 30, lambda: [path for path in out.iterdir() if path.name.endswith(".tmp")], pause=0.001)
    worker.kill()
    worker.wait(30)
    assert [path.suffix for path in out.iterdir()] == [".tmp"], "the worker ended before it was killed"
    quick_fill(tmp_path / "small.exr", "-o", out / "small.exr")
    assert set(contents(out)) == {"small.exr"}


def test_progress_is_told_as_asked(shot):
    source, out, log = shot
    plain = quick_fill(source, "-o", out, "-q", "--progress", "plain")
    # The expression that Deadline's plug-ins commonly use.
    percents = [int(found[1]) for line in plain.stderr.splitlines() if (found := re.match(r"Progress: (\d+)%", line))]
    assert percents == sorted(percents) and percents[-1] == 100 and plain.stdout == ""
    openjd = quick_fill(source, "-o", out, "--progress", "openjd")
    lines = openjd.stdout.splitlines()
    percents = [int(line.removeprefix("openjd_progress: ")) for line in lines if line.startswith("openjd_progress: ")]
    assert percents == sorted(percents) and percents[-1] == 100
    assert any(re.match("openjd_status: 4 of 4 frames filled", line) for line in lines), openjd
    assert "Progress" not in openjd.stderr
    assert "Progress" not in quick_fill(source, "-o", out, "--progress", "none").stderr

    source.with_name("shot.0002.exr").write_bytes(b"no frame")
    failed = quick_fill(source, "-o", out, "--progress", "openjd", "-q", ok=False)
    assert failed.status == 1
    [line] = [line for line in failed.stdout.splitlines() if line.startswith("openjd_fail: ")]
    assert "shot.0002.exr" in line


@pytest.mark.parametrize("words, reason", [
    (["--progress", "openjd", "--json", "-"], "standard output"),
    (["--log", "-"], "a ledger is a file"),
    (["--log", "in/shot.0001.exr"], "the same file as the input"),
    (["--log", "no/such/ledger.jsonl"], "does not exist"),
    (["--log", "l.jsonl", "--json", "l.jsonl"], "same file"),
    (["--report", "r", "--json", "./r"], "would be written twice"),
    (["--report", "-", "--json", "-"], "standard output"),
    (["--report", "-", "--progress", "openjd"], "standard output"),
])
def test_outputs_that_cannot_be_shared_are_refused(shot, words, reason):
    folder = shot[2].parent
    refused = quick_fill(shot[0], "-o", shot[1], *words, ok=False, folder=folder)
    assert refused.status == 2 and reason in refused.stderr and len(refused.lines()) == 1, refused
    assert contents(shot[1].parent) == {}


def jobs(folder, *words):
    """The scripts of a submission: what each is called -> a function that runs it as Slurm would and gives its exit status."""
    shown = lacuna("submit", "slurm", "-n", "--chunk", "3", *words, folder=folder).stdout
    scripts = re.findall(r"==> lacuna-logs/lacuna-(\w+)\.sbatch <==\n(.*?)\n(?=\n==>|\n*\Z)", shown, re.DOTALL)

    def shell(text):
        return lambda task="": run(["bash", "-c", text], folder=folder, environment={"SLURM_ARRAY_TASK_ID": task}).status

    return {name: shell(text) for name, text in scripts}


def test_submission_shows_its_scripts_and_says_what_is_missing(shot):
    folder = shot[2].parent
    command = ["--", "upscale", "in/shot.####.exr", "-o", "out/shot.####.exr", "--scale", "2", "--frames", "1-4"]
    scripts = jobs(folder, *command)
    assert list(scripts) == ["upscale", "check"] and not (folder / "lacuna-logs").exists()
    # The gate is closed until every frame is there.
    (folder / "lacuna-logs").mkdir()
    assert [scripts["upscale"]("0"), scripts["check"]()] == [0, 1]
    assert [scripts["upscale"]("1"), scripts["check"]()] == [0, 0]
    assert len(contents(shot[1].parent)) == len(ledger(folder / "lacuna-logs" / "lacuna.jsonl")) == 4

    refused = lacuna("submit", "slurm", *command, folder=folder, environment={"PATH": str(folder)}, ok=False)
    assert refused.status == 1 and "cannot run sbatch" in refused.stderr and len(refused.lines()) == 1, refused
    sbatch = folder / "sbatch"
    sbatch.write_text("#!/bin/sh\necho 'sbatch: error: no cluster' >&2\nexit 1\n")
    sbatch.chmod(0o755)
    refused = lacuna("submit", "slurm", *command, folder=folder, environment={"PATH": str(folder)}, ok=False)
    assert refused.status == 1 and "no cluster; -n only prints the scripts" in refused.stderr and len(refused.lines()) == 1, refused


def test_gates_open_for_whole_frames_only(shot):
    folder = shot[2].parent
    (folder / "lacuna-logs").mkdir()
    # Flags go before the inputs, and an output that merely exists is not enough.
    command = ["--", "upscale", "-o", "out/", "--scale", "2", "--frames", "1-3", "--no-clobber", "--", "in/shot.####.exr"]
    scripts = jobs(folder, *command)
    (folder / "out" / "shot.0002.exr").write_bytes(b"junk")
    assert [scripts["upscale"]("0"), scripts["check"]()] == [0, 1]
    (folder / "out" / "shot.0002.exr").unlink()
    assert [scripts["upscale"]("0"), scripts["check"]()] == [0, 0]
    assert len(ledger(folder / "lacuna-logs" / "lacuna.jsonl")) == 6


@pytest.mark.parametrize("flags, gates", [
    (["--filter", "ss", "--layers", "more=in/shot.####.exr", "--frames", "1-3"], ["check", "compare"]),
    (["--filter", "ss", "--frames", "2-6", "--missing-frame", "skip"], ["verify", "compare"]),
])
def test_gates_judge_what_the_tasks_were_asked_for(shot, flags, gates):
    folder = shot[2].parent
    (folder / "lacuna-logs").mkdir()
    reference = SAMPLES / "full" / "sequence" / "shot.####.exr"
    scripts = jobs(folder, "--reference", reference, "--fail-below", "psnr=20", "--", "fill", "in/shot.####.exr", "-o", "out/shot.####.exr", *flags)
    fill, *after = scripts.values()
    assert list(scripts) == ["fill", *gates]
    if "--layers" in flags:
        assert [fill("0"), *(gate() for gate in after)] == [0, 0, 0]
        (folder / "out" / "shot.0002.exr").write_bytes(b"junk")
        assert after[0]() == 1
    else:
        assert [fill("0"), fill("1"), *(gate() for gate in after)] == [0] * 4


def test_gates_let_pass_what_the_time_limit_of_the_command_cut_short(shot):
    folder = shot[2].parent
    (folder / "lacuna-logs").mkdir()
    slow = ["--filter", "tv", "--tv-gap", "1e-300", "--tv-iterations", "1000000", "--no-estimate", "--layers", "more=in/shot.####.exr"]
    command = ["fill", "in/shot.####.exr", "-o", "out/", *slow, "--frames", "1-2"]
    scripts = jobs(folder, "--", *command, "--time-limit", "0.2")
    assert [scripts["fill"]("0"), scripts["check"]()] == [0, 0]
    # Not what was made of another frame, nor what nothing may cut short.
    assert jobs(folder, "--", *command)["check"]() == 1
    shutil.copy(shot[0].with_name("shot.0003.exr"), shot[0].with_name("shot.0002.exr"))
    assert scripts["check"]() == 1


@pytest.mark.parametrize("words, reason", [
    (["-o", "one.exr"], "several frames need a pattern here"),
    (["-o", "notthere/"], "--create-dir makes it"),
    (["-o", "in/"], "the same file as the input"),
])
def test_what_every_task_would_refuse_is_not_submitted(shot, words, reason):
    refused = lacuna("submit", "slurm", "--", "fill", "in/shot.####.exr", "--frames", "1-4", *words, ok=False, folder=shot[2].parent)
    assert refused.status == 2 and reason in refused.stderr and len(refused.lines()) == 1, refused
    assert not shot[2].with_name("lacuna-logs").exists()


@pytest.mark.parametrize("reference", ["full.exr", "full/"])
def test_a_reference_that_compare_would_refuse_is_not_submitted(shot, reference):
    command = ["--", "fill", "in/shot.####.exr", "-o", "out/", "--create-dir", "--frames", "1-4"]
    refused = lacuna("submit", "slurm", "--reference", reference, *command, ok=False, folder=shot[2].parent)
    assert refused.status == 2 and f"--reference {reference}: " in refused.stderr and len(refused.lines()) == 1, refused
    assert not shot[2].with_name("lacuna-logs").exists()


def test_a_scene_that_cannot_be_read_is_told_of_each_frame(tmp_path):
    words = ["render", "nope.toml", "-o", "r.####.exr", "--frames", "1-3", "--log", "l.jsonl", "--progress", "openjd"]
    failed = lacuna(*words, ok=False, folder=tmp_path)
    assert failed.status == 1 and len(failed.lines()) == 1 and failed.stderr.count("nope.toml") == 1, failed
    assert failed.stdout.startswith("openjd_fail: nope.toml: cannot read the scene")
    assert states(tmp_path / "l.jsonl") == [(1, "failed"), (2, "failed"), (3, "failed")]
    usage = lacuna(*words, "--densty", "1", ok=False, folder=tmp_path)
    assert usage.status == 2 and usage.stdout.startswith("openjd_fail: ") and "--densty" in usage.stdout, usage
    assert usage.stdout.count("\n") == 1


def test_a_ledger_is_not_appended_to_another_file(shot):
    source, out, log = shot
    frame = source.with_name("shot.0004.exr")
    before = frame.read_bytes()
    log.symlink_to(frame)
    refused = quick_fill(source, "-o", out, "--frames", "1", "--log", log, ok=False)
    assert refused.status == 2 and "no such report" in refused.stderr and len(refused.lines()) == 1, refused
    assert frame.read_bytes() == before and contents(out.parent) == {}


def test_memory_that_slurm_bounds_is_asked_of_slurm(shot):
    refused = quick_fill(shot[0], "-o", shot[1], "--frames", "1", ok=False, environment={"SLURM_MEM_PER_NODE": "1"})
    assert refused.status == 1 and "the job's --mem" in refused.stderr, refused


@pytest.mark.skipif(shutil.which("jq") is None, reason="no jq")
def test_the_recipes_for_the_ledger_in_the_documentation(tmp_path):
    text = (ROOT / "docs" / "farm.md").read_text().split("### The ledger")[1]
    failed, seconds = re.findall("^jq .*$", re.search("```sh\n(.*?)```", text, re.DOTALL)[1], re.MULTILINE)

    def line(frame, state):
        return json.dumps({"command": "fill", "host": "n1", "frame": frame, "output": f"o.{frame}.exr", "state": state,
                           "message": "broken" if state == "failed" else None, "seconds": {"solve": 1.5}})

    lines = [line(1, "failed"), line(2, "failed"), '{"time":"20', line(1, "done"), line(3, "done"), line(10, "skipped"), '{"ti']
    (tmp_path / "ledger.jsonl").write_text("\n".join(lines))
    shown = [run(["bash", "-c", recipe], folder=tmp_path) for recipe in (failed, seconds)]
    assert [(result.status, result.stdout) for result in shown] == [(0, "2 n1 broken\n"), (0, "3\n")], shown


def openjd(*words):
    return run([OPENJD, *words], timeout=600)


def test_the_template_of_open_job_description(tmp_path):
    checked = openjd("check", TEMPLATE)
    assert checked.status == 0, checked
    values = {"Frames": "1-6", "ChunkSize": "4", "Density": "0.3", "Output": tmp_path / "shot", "Lacuna": LACUNA,
              "Scene": SAMPLES / "scenes" / "vessels.toml",
              "RenderFlags": "--set camera.orbit=5 --size 64x48"}
    words = ["run", TEMPLATE, *(word for name, value in values.items() for word in ("-p", f"{name}={value}"))]
    done = openjd(*words)
    assert done.status == 0, done
    names = [f"frame.{number:04d}.exr" for number in range(1, 7)]
    assert sorted(contents(tmp_path / "shot" / "full")) == names == sorted(contents(tmp_path / "shot" / "sparse"))
    entries = ledger(tmp_path / "shot" / "ledger.jsonl")
    for command in ("render", "fill", "verify"):
        of = [entry for entry in entries if entry["command"] == command]
        assert sorted(entry["frame"] for entry in of) == [1, 2, 3, 4, 5, 6]
        assert {entry["state"] for entry in of} == {"done"} and len({entry["process"] for entry in of}) == 2
    assert abs(entries[0]["density"] - 0.3) < 0.02
    # The runner reads the lines of progress and shows them.
    assert "openjd_progress: 100" in done.stdout and "openjd_status: " in done.stdout

    before = contents(tmp_path / "shot" / "full")
    (tmp_path / "shot" / "sparse" / "frame.0002.exr").write_bytes(b"no frame")
    failed = openjd(*words, "--step", "Fill")
    assert failed.status != 0 and "openjd_fail: " in failed.stdout and "frame.0002.exr" in failed.stdout, failed
    assert contents(tmp_path / "shot" / "full") == before
    again = openjd(*words)
    assert again.status == 0, again
    assert contents(tmp_path / "shot" / "full") == before


def test_no_value_of_the_template_is_a_command(tmp_path):
    trap = f"$(touch {tmp_path}/PWN)"
    values = {"Frames": "1", "Output": f"{tmp_path}/it's \"{trap}\"", "Lacuna": LACUNA, "Scene": SAMPLES / "scenes" / "vessels.toml"}

    def renders(**more):
        given = values | {"RenderFlags": "--size 16x16"} | more
        return openjd("run", TEMPLATE, "--step", "Render", *(word for name, value in given.items() for word in ("-p", f"{name}={value}")))

    done = renders()
    assert done.status == 0, done
    assert len(list(tmp_path.rglob("frame.0001.exr"))) == 1
    for more in ({"RenderFlags": f"--size 16x16; {trap} `{trap}`"}, {"Lacuna": f"no-such; {trap}"}, {"Scene": f"/no/{trap}.toml"}):
        assert renders(**more).status != 0
    assert not (tmp_path / "PWN").exists()


@pytest.mark.skipif(shutil.which("parallel") is None, reason="no GNU parallel")
def test_the_commands_for_gnu_parallel_in_the_documentation(tmp_path):
    text = (ROOT / "docs" / "farm.md").read_text().split("## GNU parallel")[1]
    first, second, verify = re.search("```sh\n(.*?)```", text, re.DOTALL)[1].splitlines()
    for number in range(1, 25):
        corner(number, tmp_path)
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "lacuna").symlink_to(pathlib.Path(LACUNA).resolve())
    (tmp_path / "shot.0007.exr").write_bytes(b"no frame")

    def shell(line):
        return run(["bash", "-c", line], timeout=300, folder=tmp_path, environment={"PATH": f"{tmp_path}/bin:{os.environ['PATH']}", "HOME": str(tmp_path)})

    assert shell(first).status == 1
    assert len(contents(tmp_path / "full")) == 23
    assert shell(verify).status == 1
    corner(7, tmp_path)
    again = shell(second)
    assert again.status == 0, again
    assert len(contents(tmp_path / "full")) == 24 and shell(verify).status == 0
    # Only the chunk that failed ran again.
    assert len(ledger(tmp_path / "ledger.jsonl")) == 24 + 4
