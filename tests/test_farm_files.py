"""Files as farms have them: links, folders and neighbours that cannot be read, reports that cannot be written, names that are no frames, and
signals that warn of the end. Nothing is left out, replaced or lost unsaid."""

import json
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile

import numpy as np
import OpenImageIO as oiio
import pytest

import frames
from tool import LACUNA, SAMPLES, Result, lacuna, quick_fill, wait_until_at_work

NOBODY = 65534
FIRST = SAMPLES / "sequence" / "shot.0001.exr"
QUICK = ["--filter", "nearest", "--no-estimate"]
ENDLESS = ["--filter", "tv", "--tv-gap", "1e-300", "--tv-iterations", "4000000000"]


@pytest.fixture
def user():
    """A folder, and a function that runs lacuna there as a user who is not root: to root no file is closed."""
    folder = pathlib.Path(tempfile.mkdtemp(prefix="lacuna-test-"))
    folder.chmod(0o777)
    other = {"user": NOBODY, "group": NOBODY, "extra_groups": []} if os.geteuid() == 0 else {}

    def lacuna_of_user(*words):
        done = subprocess.run([LACUNA, *words], cwd=folder, capture_output=True, text=True, timeout=120, **other)
        return Result([LACUNA, *words], done.returncode, done.stdout, done.stderr, 0, 0, 0)

    try:
        lacuna_of_user("--version")
    except OSError as error:
        shutil.rmtree(folder)
        pytest.skip(f"needs a user who is not root and can run lacuna: {error}")
    yield folder, lacuna_of_user
    for path in folder.rglob("*"):
        if path.is_dir() and not path.is_symlink():
            path.chmod(0o777)
    shutil.rmtree(folder)


@pytest.fixture
def shot(tmp_path):
    """Four sparse frames in a folder beside an empty one."""
    shutil.copytree(SAMPLES / "sequence", tmp_path / "in")
    (tmp_path / "out").mkdir()
    return tmp_path


def refused(result, status, *words):
    """One line says why."""
    assert result.status == status and len(result.lines()) == 1, result
    assert all(word in result.stderr for word in words), result


def test_outputs_that_are_one_file_are_refused(shot):
    (shot / "out" / "shot.0002.exr").symlink_to("shot.0001.exr")
    # Whether the file is there or comes with the first frame.
    for _ in range(2):
        result = quick_fill("in/shot.####.exr", "-o", "out/shot.####.exr", "--frames", "1-2", folder=shot, ok=False)
        refused(result, 2, "in/shot.0001.exr and in/shot.0002.exr would both be written to", "out/shot.0001.exr")
        (shot / "out" / "shot.0001.exr").write_bytes(b"")
    quick_fill("in/shot.####.exr", "-o", "out/shot.####.exr", "--frames", "2-3", folder=shot)
    assert (shot / "out" / "shot.0002.exr").is_symlink() and (shot / "out" / "shot.0001.exr").stat().st_size > 0


def test_links_that_lead_nowhere_are_told(shot):
    (shot / "off").symlink_to("/no/such/disk")
    for words in ([], ["--create-dir"]):
        refused(quick_fill("in/shot.0001.exr", "-o", "off/o.exr", *words, folder=shot, ok=False), 1, "off is a link to /no/such/disk")
    (shot / "out" / "o.exr").symlink_to("/no/such/disk/o.exr")
    result = quick_fill("in/shot.0001.exr", "-o", "out/o.exr", "-q", folder=shot, ok=False)
    refused(result, 1, "out/o.exr: cannot write: it is a link to /no/such/disk/o.exr, whose folder does not exist")
    # A frame on a disk that is not there is not one that was never rendered.
    (shot / "in" / "shot.0002.exr").unlink()
    (shot / "in" / "shot.0003.exr").unlink()
    (shot / "in" / "shot.0003.exr").symlink_to("/no/such/disk/s.exr")
    result = quick_fill("in/shot.####.exr", "-o", "out/", "--frames", "1-4", "--missing-frame", "skip", "-q", folder=shot, ok=False)
    refused(result, 1, "in/shot.0003.exr (frame 3): it is a link to /no/such/disk/s.exr, which does not exist")


def test_a_neighbour_that_cannot_be_read_is_waited_for(user):
    folder, lacuna = user
    for number in (1, 2):
        shutil.copy(FIRST, folder / f"s.{number}.exr")
        os.utime(folder / f"s.{number}.exr", (1_000_000_000,) * 2)
    closed = folder / "s.2.exr"
    closed.chmod(0)
    again = lambda: lacuna("fill", "s.1.exr", "-o", "o.exr", "--no-estimate", "--temporal", "1", "-u").stderr
    assert "filled without frame 2 (s.2.exr): cannot open: Permission denied" in again()
    closed.chmod(0o444)
    assert "1 of 1 frame filled" in again()
    assert "1 skipped" in again()
    # One that is damaged is not read again until it changes.
    closed.chmod(0o644)
    closed.write_bytes(FIRST.read_bytes()[:2000])
    os.utime(closed, (1_000_000_000,) * 2)
    (folder / "o.exr").unlink()
    assert "filled without frame 2 (s.2.exr): truncated" in again()
    assert "1 skipped" in again()


def test_folders_that_cannot_be_looked_into_are_told(user):
    folder, lacuna = user
    for name in ("p/a", "p/closed"):
        (folder / name).mkdir(parents=True)
        shutil.copy(FIRST, folder / name)
    (folder / "p" / "closed").chmod(0)
    for glob in ("p/**/*.exr", "p/*/*.exr", "p/closed/*.exr"):
        result = lacuna("fill", glob, "-o", "out/", "--create-dir", *QUICK)
        refused(result, 1, "cannot list p/closed: Permission denied")
    refused(lacuna("fill", "p/closed/shot.####.exr", "-o", "out/", "--create-dir", *QUICK), 1, "cannot list p/closed")
    for words in ([], ["--create-dir"]):
        result = lacuna("fill", "p/a/shot.0001.exr", "-o", "p/closed/out/o.exr", *words, *QUICK)
        refused(result, 1, "cannot reach the folder p/closed/out: Permission denied")
    assert not (folder / "out").exists()


def test_reports_that_cannot_be_written_are_refused_before_the_work(user):
    folder, lacuna = user
    shutil.copy(FIRST, folder / "s.exr")
    (folder / "closed").mkdir(mode=0o555)
    for flag in ("--json", "--report"):
        result = lacuna("fill", "s.exr", "-o", "o.exr", flag, "closed/r", *QUICK)
        refused(result, 1, f"{flag} closed/r: the report cannot be written", "Permission denied")
    for flag in ("--json", "--csv", "--md", "--html"):
        refused(lacuna("compare", "s.exr", "s.exr", flag, "closed/r"), 1, f"{flag} closed/r")
    (folder / "r.json").touch(mode=0o444)
    refused(lacuna("fill", "s.exr", "-o", "o.exr", "--json", "r.json", *QUICK), 1, "--json r.json", "read-only")
    assert not (folder / "o.exr").exists()


def test_a_comparison_writes_the_reports_that_it_can(tmp_path):
    result = lacuna("compare", FIRST, FIRST, "--json", "/dev/full", "--csv", "c.csv", "-q", folder=tmp_path, ok=False)
    refused(result, 1, "/dev/full: the report is not written")
    assert (tmp_path / "c.csv").read_text().startswith("frame,")


@pytest.mark.parametrize("command", ["verify", "compare"])
def test_reports_of_commands_that_make_no_folders_say_what_to_do(command, tmp_path):
    for report, text in (("gone/r.json", "the folder gone does not exist; make it first"), (".", "it is a folder; name a file")):
        refused(lacuna(command, FIRST, FIRST, "--json", report, ok=False, folder=tmp_path), 2, f"{report}: {text}")


def test_a_comparison_that_is_stopped_says_what_it_found(tmp_path):
    noise = np.random.default_rng(1).random((1024, 1024, 3), np.float32)
    frames.write(tmp_path / "s.1.exr", {name: noise[..., k] for k, name in enumerate("RGB")})
    for number in range(2, 13):
        (tmp_path / f"s.{number}.exr").symlink_to("s.1.exr")
    (tmp_path / "o").symlink_to(".")
    words = ["s.%d.exr", "o/s.%d.exr", "--json", "r.json", "--threads", "1", "--progress", "plain"]
    process = subprocess.Popen([LACUNA, "compare", *words], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    for line in process.stderr:
        if "Progress: " in line and int(line.split()[1].rstrip("%")) >= 15:
            break
    process.send_signal(signal.SIGTERM)
    assert process.wait(30) == 143
    told = json.loads((tmp_path / "r.json").read_text())["frames"]
    assert len(told) == 12 and any(frame["groups"] for frame in told)
    assert all(frame["error"] == "not compared: stopped by a signal" for frame in told if not frame["groups"])
    assert any(frame["error"] for frame in told)


@pytest.mark.parametrize("number", [signal.SIGXCPU, signal.SIGUSR1, signal.SIGUSR2, signal.SIGQUIT])
def test_signals_of_farms_end_a_run_like_a_termination(shot, number):
    words = ["in/shot.####.exr", "-o", "out/", "--json", "r.json", "--progress", "plain", *ENDLESS]
    process = subprocess.Popen([LACUNA, "fill", *words], cwd=shot, stderr=subprocess.PIPE, text=True)
    wait_until_at_work(process)
    process.send_signal(number)
    assert process.wait(30) == 128 + number
    assert "stopped by a signal" in process.stderr.read()
    assert list((shot / "out").iterdir()) == []
    assert "stopped" in {frame["state"] for frame in json.loads((shot / "r.json").read_text())["frames"]}


def test_submission_leaves_no_file_out_and_repeats_none(shot):
    submit = lambda *words, ok=True: lacuna("submit", "slurm", "-n", "--chunk", "1", "--", "fill", *words, folder=shot, ok=ok)
    shutil.copy(FIRST, shot / "in" / "other.0001.exr")
    script = submit("in/*.exr", "-o", "out/").stdout
    assert "#SBATCH --array=0-3\n" in script and "--frames=1-4" in script
    shutil.copy(FIRST, shot / "in" / "still.exr")
    refused(submit("in/*.exr", "-o", "out/", ok=False), 2, "in/still.exr: no frame number in the name")
    # Also before there are any frames.
    refused(submit("new.####.exr", "-o", "./new.####.exr", "--frames", "1-3", ok=False), 2, "the same file as the input")


def test_long_numbers_are_numbers_of_frames(shot):
    for last in (5, 6):
        shutil.copy(FIRST, shot / f"t.2024010203040{last}.exr")
    script = lacuna("submit", "slurm", "-n", "--", "fill", "t.*.exr", "-o", "out/", folder=shot).stdout
    assert "--frames=20240102030405-20240102030406" in script
    quick_fill("t.*.exr", "-o", "out/", "--frames", "20240102030405-20240102030406", folder=shot)
    assert len(list((shot / "out").iterdir())) == 2


def test_maps_have_the_number_that_only_a_folder_has(tmp_path):
    for name in ("a/0001", "a/0002", "b/0001", "b/0002"):
        (tmp_path / name).mkdir(parents=True)
        shutil.copy(FIRST, tmp_path / name / "e.exr")
    lacuna("compare", "a/####/e.exr", "b/####/e.exr", "--frames", "1-2", "--maps", "m", "-q", folder=tmp_path)
    assert {path.name for path in (tmp_path / "m").glob("*.exr")} == {"e.0001.maps.exr", "e.0002.maps.exr"}
    # What would still be called alike is refused.
    result = lacuna("compare", "a/*/e.exr", "b/0001/", "--maps", "n", folder=tmp_path, ok=False)
    refused(result, 2, "the maps of a/0001/e.exr and a/0002/e.exr would both be called e")
    assert not (tmp_path / "n").exists()


def test_no_folder_that_is_made_leads_back_to_an_input(shot):
    before = (shot / "in/shot.0001.exr").read_bytes()
    for words in (["-o", "none/../in/shot.0001.exr"], ["-o", "none/../in/"], ["-o", "out/", "--json", "none/../in/shot.0001.exr"]):
        result = quick_fill("in/shot.0001.exr", *words, "--create-dir", folder=shot, ok=False)
        refused(result, 2, ".. stands behind a folder that does not exist")
    assert (shot / "in/shot.0001.exr").read_bytes() == before and not (shot / "none").exists()


def test_files_that_are_read_by_flags_are_no_outputs(shot):
    (shot / "list.exr").write_text("in/shot.0001.exr")
    (shot / "rules.exr").write_text('[[rule]]\nglob = "B"\nrule = "fill"\n')
    refused(quick_fill("--files-from", "list.exr", "-o", "list.exr", folder=shot, ok=False), 2, "the same file as the list of --files-from")
    refused(lacuna("sparsify", "--files-from", "list.exr", "-o", "list.exr", "--density", "0.5", folder=shot, ok=False), 2, "the list of --files-from")
    refused(quick_fill("in/shot.0001.exr", "--rules", "rules.exr", "-o", "rules.exr", folder=shot, ok=False), 2, "the file of --rules")


@pytest.mark.parametrize("words, status", [
    (["fill", "none.####.exr", "-o", "out/"], 1),
    (["fill", "in/shot.####.exr", "-o", "in/"], 2),
    (["sparsify", "none.*.exr", "-o", "out/", "--density", "0.5"], 1),
    (["verify", "none.####.exr", "out/"], 1),
    (["compare", "none.####.exr", "out/"], 1),
    (["render", "procedural:vessels:8", "-o", "none/", "--frames", "1"], 2),
])
def test_a_report_does_not_outlive_a_run_that_cannot_begin(words, status, shot):
    report = shot / "r.json"
    quick_fill("in/shot.0001.exr", "-o", "out/", "--json", report, folder=shot)
    lacuna(*words, "--json", report, *(["-n"] if words[0] != "compare" else []), folder=shot, ok=False)
    if words[0] != "compare":
        assert json.loads(report.read_text())["frames"][0]["state"] == "done"
    refused(lacuna(*words, "--json", report, folder=shot, ok=False), status)
    told = json.loads(report.read_text())
    assert told["command"] == words[0] and told["frames"] == [] and told["error"], told
    # What is no report stays.
    report.write_text("mine")
    lacuna(*words, "--json", report, folder=shot, ok=False)
    assert report.read_text() == "mine"


def test_names_in_a_list_are_shown_as_they_are(shot):
    (shot / "list").write_bytes(b"\xef\xbb\xbfin/shot.0001.exr\nin/shot.0002.exr \n")
    result = quick_fill("--files-from", "list", "-o", "out/", "-q", folder=shot, ok=False)
    refused(result, 1, "'in/shot.0002.exr ' (frame 2): the frame does not exist")
    assert (shot / "out" / "shot.0001.exr").exists()


def bytes_of(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_next_passes_write_no_render_of_another_frame_and_no_file_twice(shot):
    for name, number in (("g/a.0001", 1), ("g/b.0001", 2), ("r/a.0001", 1), ("r/b.0001", 2), ("s/c.0001", 3), ("d/a/f.0001", 1), ("d/b/f.0001", 2)):
        (shot / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(shot / "in" / f"shot.000{number}.exr", shot / f"{name}.exr")
    before = bytes_of(shot)
    add = ["--add", "0.05"]
    for words, *why in (
        (["--after", "g/*.exr", "-o", "g/a.####.exr", *add], "a.0001.exr"),
        (["--after", "g/[ab].*.exr", "-o", "n.####.exr", *add], "g/a.0001.exr and g/b.0001.exr would both be written to n.0001.exr"),
        (["--after", "in/*.exr", "-o", "n.####.exr", "--error-estimate", "in/shot.####.exr", *add],
         "in/shot.0001.exr: the output is the same file as the frame"),
        (["--after", "d/*/f.0001.exr", "-o", "n.####.exr", *add], "d/a/f.0001.exr and d/b/f.0001.exr would both be written to n.0001.exr"),
        (["--merge", "r/*.exr", "s/c.####.exr", "-o", "r/a.####.exr"], "a.0001.exr"),
        (["--merge", "r/b.####.exr", "s/c.####.exr", "-o", "in/shot.####.exr", "--mask", "in/shot.0001.exr"], "the same file as the mask"),
    ):
        refused(lacuna("mask", *words, "-q", folder=shot, ok=False), 2, *why)
        assert bytes_of(shot) == before, words
    # A mask that bounds another frame is not written over either.
    for number, target in ((1, "m.0002.exr"), (2, "own.exr")):
        (shot / f"i.000{number}.exr").symlink_to(target)
    lacuna("mask", "--pattern", "random", "--density", "0.5", "--size", "8x8", "-o", "m.0002.exr", folder=shot)
    shutil.copy(shot / "m.0002.exr", shot / "own.exr")
    before = bytes_of(shot)
    words = ["--pattern", "random", "--density", "0.5", "--size", "8x8", "--inside", "i.####.exr", "--frames", "1-2"]
    refused(lacuna("mask", *words, "-o", "m.####.exr", "-q", folder=shot, ok=False), 2, "the same file as the image of --inside (i.0001.exr)")
    assert bytes_of(shot) == before


def test_no_clobber_takes_no_link_to_nowhere_for_an_output(shot):
    (shot / "out" / "shot.0001.exr").symlink_to("/no/such/disk/s.exr")
    frame, words = ["in/shot.0001.exr", "-o", "out/shot.0001.exr"], ["--no-clobber", "-q"]
    why = "out/shot.0001.exr: it is a link to /no/such/disk/s.exr, which does not exist"
    refused(quick_fill(*frame, *words, folder=shot, ok=False), 1, why)
    for command in (["mask", "--after", *frame, "--add", "0.05"], ["mask", "--merge", *frame[:1], "in/shot.0002.exr", *frame[1:]]):
        refused(lacuna(*command, *words, folder=shot, ok=False), 1, why)
    # One that leads to a frame is an output.
    (shot / "out" / "shot.0001.exr").unlink()
    (shot / "out" / "shot.0001.exr").symlink_to("../in/shot.0002.exr")
    quick_fill(*frame, *words, folder=shot)


@pytest.mark.parametrize("flag, what", [("--guides-from", "guides (--guides-from)"), ("--layers", "layer (--layers)"), ("--mask", "mask")])
def test_files_beside_the_input_that_are_missing_are_told_before_the_work(flag, what, shot):
    full = SAMPLES / "full" / "sequence"
    shutil.copy(full / "shot.0001.exr" if flag != "--mask" else FIRST, shot / "x.0001.exr")
    words = ["in/shot.####.exr", "--frames", "1", "-o", "out/", flag, "d=x.####.exr" if flag == "--layers" else "x.####.exr"]
    quick_fill(*words, folder=shot)
    (shot / "x.0001.exr").unlink()
    for more in ([], ["-n"], ["-u"], ["-u", "-n"]):
        result = quick_fill(*words, "-q", *more, folder=shot, ok=False)
        refused(result, 1, f"x.0001.exr (frame 1): cannot read the {what}: the file is missing")
        assert "-n" not in more or result.stdout.startswith("fail "), result
    (shot / "x.0001.exr").symlink_to("/no/such/disk/x.exr")
    refused(quick_fill(*words, "-q", "-n", folder=shot, ok=False), 1, f"cannot read the {what}: it is a link to /no/such/disk/x.exr")


@pytest.mark.parametrize("folder", ["what?", "a*b", "a*b/c?d"])
def test_outputs_lie_in_folders_whose_names_look_like_globs(folder, shot):
    (shot / folder).mkdir(parents=True)
    quick_fill("in/shot.0001.exr", "-o", f"{folder}/o.exr", folder=shot)
    quick_fill("in/shot.####.exr", "-o", f"{folder}/o.##.exr", "--frames", "1-2", folder=shot)
    assert {path.name for path in (shot / folder).glob("*.exr")} == {"o.exr", "o.01.exr", "o.02.exr"}
    refused(quick_fill("in/shot.0001.exr", "-o", f"{folder}/o*.exr", folder=shot, ok=False), 2, "an output cannot be a glob")
    refused(quick_fill("in/shot.0001.exr", "-o", "none?/o.exr", folder=shot, ok=False), 2, "an output cannot be a glob")


def test_update_goes_by_what_files_hold_and_not_by_their_names(tmp_path):
    tree = tmp_path / "one"
    (tree / "in").mkdir(parents=True)
    full = SAMPLES / "full" / "sequence"
    for number in (1, 2):
        [planes] = frames.read(SAMPLES / "sequence" / f"shot.000{number}.exr")
        frames.write(tree / f"in/m.000{number}.exr", {"mask": planes["mask"], "other": planes["mask"]})
        shutil.copy(SAMPLES / "sequence" / f"shot.000{number}.exr", tree / f"in/s.000{number}.exr")
        shutil.copy(full / f"shot.000{number}.exr", tree / f"in/g.000{number}.exr")
    (tree / "in/r.toml").write_text('[[rule]]\nglob = "B"\nrule = "fill"\n')

    def plan(mask="in/m.####.exr:mask", guides="in/g.####.exr", layers=("a=in/g.####.exr",), rules="in/r.toml", root=tree, more=("-u", "-n")):
        words = ["--mask", f"file:{mask}", *(["--guides-from", guides] if guides else []), *(["--rules", rules] if rules else [])]
        words += [word for layer in layers for word in ("--layers", layer)]
        return quick_fill("in/s.####.exr", "-o", "out/", "--create-dir", *words, *more, folder=root).stdout

    plan(more=())
    up_to_date = lambda said: said.count("skip ") == 2 and said.count("the output is up to date") == 2
    assert up_to_date(plan())
    # Other spellings of the same files, and a tree that was moved.
    assert up_to_date(plan(mask="in/m.%04d.exr:mask")) and up_to_date(plan(mask=f"{tree}/in/m.####.exr:mask"))
    assert up_to_date(plan(guides="./in/g.@@@@.exr", layers=["a=in/../in/g.####.exr"], rules=f"{tree}/in/r.toml"))
    tree = tree.rename(tmp_path / "two")
    assert up_to_date(plan(root=tree)) and up_to_date(plan(mask=f"{tree}/in/m.####.exr:mask", root=tree))
    # Another channel, layer or file is another setting or file.
    for words, why in (
        ({"mask": "in/m.####.exr:other"}, "mask was set otherwise"),
        ({"mask": "in/m.0001.exr:mask"}, "the mask in/m.0001.exr is another one"),
        ({"layers": ["b=in/g.####.exr"]}, "layers was set otherwise"),
        ({"guides": None}, "guides-from was set otherwise"),
        ({"guides": "in/g.0001.exr"}, "the guides in/g.0001.exr is another one"),
        ({"rules": None}, "was set otherwise"),
    ):
        assert "in/s.0002.exr (frame 2) -> out/s.0002.exr" in (said := plan(root=tree, **words)), said
        assert why in said.splitlines()[-1], said


def test_update_sees_through_switched_links_and_renamed_folders(tmp_path):
    for version in ("one", "two"):
        lacuna("sparsify", SAMPLES / "smooth.exr", "-o", f"{version}/s.exr", "--create-dir", "--density", "0.5", "--compression", "none", folder=tmp_path)
    # Both are older than the output, of one length, and differ in one byte somewhere.
    raw = bytearray((tmp_path / "two/s.exr").read_bytes())
    raw[70_000] ^= 1
    (tmp_path / "two/s.exr").write_bytes(raw)
    (tmp_path / "now").symlink_to("one")
    again = lambda: quick_fill("now/s.exr", "-o", "o.exr", "-u", "-n", folder=tmp_path).stdout.split()[0]
    quick_fill("now/s.exr", "-o", "o.exr", folder=tmp_path)
    assert again() == "skip"
    (tmp_path / "now").unlink()
    (tmp_path / "now").symlink_to("two")
    assert again() == "fill"
    (tmp_path / "now").unlink()
    (tmp_path / "two").rename(tmp_path / "now")
    assert again() == "fill"


@pytest.mark.parametrize("pattern", [[], ["--adaptive"]])
def test_a_frame_that_is_made_sparse_alone_is_told_to_have_the_mask_of_all(pattern, tmp_path):
    full = tmp_path / "full"
    shutil.copytree(SAMPLES / "full" / "sequence", full)
    (tmp_path / "out").mkdir()
    alone = "full/shot.0002.exr: a file that is named alone has the same mask"
    words = ["-o", "out/", "--density", "0.1", *pattern]
    result = lacuna("sparsify", "full/shot.0002.exr", *words, folder=tmp_path)
    assert alone in result.stderr and "a pattern with --frames 2 gives" in result.stderr
    mask = lambda: frames.read(tmp_path / "out" / "shot.0002.exr")[0]["mask"]
    first = mask()
    for inputs in (["full/shot.####.exr", "--frames", "2"], ["full/shot.0001.exr", "full/shot.0002.exr"]):
        assert "named alone" not in lacuna("sparsify", *inputs, *words, folder=tmp_path).stderr
        assert not np.array_equal(mask(), first)
    # Without others beside it, it is no frame of a sequence.
    for path in full.iterdir():
        if path.name != "shot.0002.exr":
            path.unlink()
    assert "named alone" not in lacuna("sparsify", "full/shot.0002.exr", *words, folder=tmp_path).stderr
    assert np.array_equal(mask(), first)


def test_complete_frames_pass_verify_and_sparse_ones_that_were_merely_copied_do_not(tmp_path):
    """A frame in which nothing is missing is copied without attributes: the mask is the command's, or nothing tells of missing pixels."""
    measured = frames.shuffle(24, 32, 0.4)
    light = np.random.default_rng(1).uniform(0.1, 1, (24, 32)).astype(np.float32)
    for name, missing in (("nan", np.nan), ("black", 0)):
        frames.write(tmp_path / f"{name}.0001.exr", {c: np.where(measured, light, np.float32(missing)) for c in "RGB"})
        frames.write(tmp_path / f"{name}.0002.exr", {c: light for c in "RGB"})
    for number, mask in ((1, measured), (2, np.ones_like(measured))):
        frames.write(tmp_path / f"mask.{number:04}.exr", {"mask": mask.astype(np.float32)})
    for name, mask in (("nan", "nan"), ("black", f"file:{tmp_path}/mask.####.exr")):
        pair = (tmp_path / f"{name}.####.exr", tmp_path / f"full-{name}.####.exr")
        quick_fill(pair[0], "-o", pair[1], "--mask", mask)
        assert frames.read(tmp_path / f"full-{name}.0002.exr")[0].keys() == set("RGB")
        alone = lacuna("verify", *pair)
        assert "2 of 2 frames verified" in alone.stderr and "taken for complete" in alone.stderr, alone
        result = lacuna("verify", *pair, "--mask", mask)
        assert "2 of 2 frames verified" in result.stderr and "taken for complete" not in result.stderr, result
        # The gate of a farm, with another mask in the file.
        for number in (1, 2):
            path = tmp_path / f"{name}.{number:04}.exr"
            frames.write(path, frames.read(path)[0] | {"mask": np.arange(768, dtype=np.float32).reshape(24, 32) % 2})
        words = ("fill", pair[0], "-o", pair[1], "--mask", mask, "--filter", "nearest", "--no-estimate", "--frames", "1-2")
        lacuna(*words)
        scripts = lacuna("submit", "slurm", "-n", "--logs", tmp_path, "--", *words).stdout
        gate = next(line for line in scripts.splitlines() if line.startswith("exec") and " verify " in line)
        result = subprocess.run(["bash", "-c", gate], capture_output=True, text=True, check=False)
        assert result.returncode == 0 and "2 of 2 frames verified" in result.stderr, result
        # A sparse frame that was merely copied.
        path = tmp_path / f"{name}.0001.exr"
        frames.write(path, {c: frames.read(path)[0][c] for c in "RGB"})
        copied = shutil.copy(path, tmp_path / "copied.exr")
        for flags in ((), ("--mask", mask.replace("####", "0001"))):
            result = lacuna("verify", path, copied, "-q", *flags, ok=False)
            assert result.status == 1 and len(result.lines()) == 1, result
    # And a complete one of which a bit changed.
    light[3, 4] *= 1.5
    frames.write(tmp_path / "changed.exr", {c: light for c in "RGB"})
    frames.write(tmp_path / "whole.exr", {c: np.ones_like(light) for c in "RGB"})
    result = lacuna("verify", tmp_path / "whole.exr", tmp_path / "changed.exr", ok=False)
    assert result.status == 1 and "no sampling mask found" in result.stderr, result


def test_verify_passes_what_was_filled_again_though_alpha_and_normals_were_filled_before(tmp_path):
    """Complete as they look, they are no guides of the second fill, and none of their filled pixels is promised to stay."""
    once, twice = tmp_path / "once.exr", tmp_path / "twice.exr"
    lacuna("fill", FIRST, "-o", once, *QUICK)
    lacuna("fill", once, "-o", twice, "--again", "--filter", "ss", "--no-estimate")
    assert not np.array_equal(frames.read(once)[0]["A"], frames.read(twice)[0]["A"])
    lacuna("verify", once, twice)
    # Measured pixels stay what they were.
    planes = frames.read(FIRST)[0]
    row, column = np.argwhere(planes["mask"] > 0)[7]
    pixel = oiio.ImageBuf(str(twice))
    values = list(pixel.getpixel(int(column), int(row)))
    pixel.setpixel(int(column), int(row), [value + 0.25 for value in values])
    assert pixel.write(str(twice))
    result = lacuna("verify", once, twice, ok=False)
    assert result.status == 1 and "a measured pixel has changed" in result.stderr, result


def test_a_refused_run_leaves_the_ledger_and_what_is_read(tmp_path):
    log = tmp_path / "runs.jsonl"
    lacuna("fill", FIRST, "-o", tmp_path / "one.exr", "--log", log, *QUICK)
    before = log.read_bytes()
    (tmp_path / "link.json").symlink_to(log)
    for report in (log, tmp_path / "link.json"):
        result = lacuna("fill", FIRST, "-o", tmp_path / "two.exr", "--log", log, "--json", report, *QUICK, ok=False)
        assert result.status == 2 and log.read_bytes() == before, result
    result = lacuna("fill", FIRST, "-o", tmp_path / "two.exr", "--json", log, *QUICK, ok=False)
    assert result.status == 2 and "no such report" in result.stderr and log.read_bytes() == before, result
