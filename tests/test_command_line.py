"""The command line on a farm: partial failure, repeated runs, killed runs, full disks, unusual names, refusals."""

import json
import os
import resource
import shutil
import signal
import subprocess
import time

import numpy as np
import OpenEXR
import pytest

import frames
from tool import LACUNA, SAMPLES, lacuna, quick_fill, wait_until_at_work


@pytest.fixture
def shot(tmp_path):
    """A copy of the sparse sequence, as a pattern."""
    shutil.copytree(SAMPLES / "sequence", tmp_path / "in")
    (tmp_path / "out").mkdir()
    return tmp_path / "in" / "shot.####.exr", tmp_path / "out" / "shot.####.exr"


def names(pattern):
    return sorted(path.name for path in pattern.parent.iterdir())


def numbered(*numbers):
    return [f"shot.{number:04d}.exr" for number in numbers]


@pytest.mark.parametrize("spelling", ["shot.####.exr", "shot.#.exr", "shot.%04d.exr", "shot.@@@@.exr", "shot.$F4.exr", "shot.*.exr"])
def test_spellings_of_a_pattern(shot, spelling):
    source, out = shot
    target = out if "*" in spelling else out.with_name(spelling)
    quick_fill(source.with_name(spelling), "-o", target)
    assert names(out) == numbered(1, 2, 3, 4)


@pytest.mark.parametrize("chosen, expected", [("2-3", [2, 3]), ("1-4x2", [1, 3]), ("1-4:3", [1, 4]), ("4-1x-1", [1, 2, 3, 4]), ("1,3-4", [1, 3, 4])])
def test_frame_ranges(shot, chosen, expected):
    quick_fill(shot[0], "-o", shot[1], "--frames", chosen)
    assert names(shot[1]) == numbered(*expected)


def test_one_broken_frame_does_not_stop_the_others(shot):
    broken = shot[0].with_name("shot.0002.exr")
    broken.write_bytes(broken.read_bytes()[:2000])
    result = quick_fill(shot[0], "-o", shot[1], "-q", ok=False)
    assert result.status == 1
    assert names(shot[1]) == numbered(1, 3, 4)
    assert any("shot.0002.exr" in line for line in result.lines()), result


def test_a_missing_frame_is_an_error_or_skipped(shot):
    shot[0].with_name("shot.0003.exr").unlink()
    result = quick_fill(shot[0], "-o", shot[1], "--frames", "1-4", "-q", ok=False)
    assert result.status == 1 and "3" in result.stderr and names(shot[1]) == numbered(1, 2, 4), result
    quick_fill(shot[0], "-o", shot[1], "--frames", "1-4", "--missing-frame", "skip")


def test_update_does_only_what_is_stale(shot):
    source, out = shot
    quick_fill(source, "-o", out)
    past = time.time() - 100
    for path in source.parent.iterdir():
        os.utime(path, (past - 100, past - 100))
    for path in out.parent.iterdir():
        os.utime(path, (past, past))

    def made():
        return [path.name for path in sorted(out.parent.iterdir()) if path.stat().st_mtime > past + 1]

    quick_fill(source, "-o", out, "-u")
    assert made() == []
    # Times alone change nothing, another frame of an old time does.
    os.utime(source.with_name("shot.0002.exr"))
    os.utime(source.with_name("shot.0003.exr"), (time.time() + 1000,) * 2)
    quick_fill(source, "-o", out, "-u")
    assert made() == []
    shutil.copy2(source.with_name("shot.0001.exr"), source.with_name("shot.0002.exr"))
    quick_fill(source, "-o", out, "-u")
    assert made() == numbered(2)
    quick_fill(source, "-o", out, "-u", "--filter", "pushpull")
    assert made() == numbered(1, 2, 3, 4)


def complete(path):
    """Makes all pixels of a frame measured."""
    [planes] = frames.read(path)
    frames.write(path, planes | {"mask": np.ones_like(planes["mask"])})


@pytest.mark.parametrize("flags", [[], ["--layers", "more=layer.exr"]])
def test_the_copy_of_a_complete_frame_is_up_to_date(shot, tmp_path, flags):
    source, out = shot
    shutil.copy(source.with_name("shot.0001.exr"), tmp_path / "layer.exr")
    complete(tmp_path / "layer.exr")
    complete(source.with_name("shot.0002.exr"))

    def planned(*more):
        words = ["fill", source, "-o", out, "-u", "-n", "--filter", "ss", "--no-estimate", *flags, *more]
        return [line.split()[0] for line in lacuna(*words, folder=tmp_path).stdout.splitlines()]

    quick_fill(source, "-o", out, *flags, folder=tmp_path)
    assert planned() == ["skip"] * 4
    # What this run would not copy is not up to date; nor is a sparse frame that somebody copied.
    assert planned("--compression", "none") == ["fill"] * 4
    assert planned("-d", "float" if frames.read(source.with_name("shot.0002.exr"))[0]["R"].dtype == np.float16 else "half") == ["fill"] * 4
    shutil.copy(source.with_name("shot.0003.exr"), out.with_name("shot.0003.exr"))
    # Nor is the copy of another frame that is complete, whatever its time.
    changed = source.with_name("shot.0002.exr")
    [planes] = frames.read(changed)
    frames.write(changed, planes | {"R": planes["R"] + planes["R"].dtype.type(1)})
    os.utime(changed, (0, 0))
    assert planned() == ["skip", "fill", "fill", "skip"]


def test_update_knows_other_sources_whatever_their_times(shot, tmp_path):
    source, _ = shot
    folders = [tmp_path / "v001", tmp_path / "v002"]
    for folder, number in zip(folders, (1, 2)):
        folder.mkdir()
        shutil.copy(source.with_name(f"shot.{number:04}.exr"), folder / "in.exr")
        frames.write(folder / "mask.exr", {"mask": frames.read(folder / "in.exr")[0]["mask"]})
        for path in folder.iterdir():
            os.utime(path, (1_600_000_000, 1_600_000_000))
    for name in ("latest", "masks"):
        (tmp_path / name).symlink_to(folders[0])
    time.sleep(0.05)

    def plan(*words):
        result = quick_fill("latest/in.exr", "-o", "out.exr", "--mask", "file:masks/mask.exr", "-u", *words, folder=tmp_path)
        return result.stdout + result.stderr

    def switch(name, folder):
        (tmp_path / name).unlink()
        (tmp_path / name).symlink_to(folder)

    assert "1 of 1 frame filled" in plan() and plan("-n").startswith("skip ")
    for name, what in (("latest", "the input latest/in.exr"), ("masks", "the mask masks/mask.exr")):
        switch(name, folders[1])
        assert f"{what} is another one" in plan("-n")
        switch(name, folders[0])
        assert plan("-n").startswith("skip ")
    # As cp -p, rsync -t and mv do it.
    for name, what in (("in.exr", "input"), ("mask.exr", "mask")):
        shutil.copy2(folders[0] / name, tmp_path / "kept")
        shutil.copy2(folders[1] / name, folders[0] / name)
        assert f"the {what} " in plan("-n")
        (tmp_path / "kept").rename(folders[0] / name)
        assert plan("-n").startswith("skip ")
    switch("latest", folders[1])
    switch("masks", folders[1])
    assert "made again: the input latest/in.exr is another one" in plan("-v")
    # Copies of the sources make the same bytes.
    shutil.copytree(folders[1], tmp_path / "copied")
    switch("latest", tmp_path / "copied")
    before = (tmp_path / "out.exr").read_bytes()
    assert plan("-n").startswith("skip ")
    (tmp_path / "out.exr").unlink()
    plan()
    assert (tmp_path / "out.exr").read_bytes() == before


def test_update_knows_what_only_the_file_or_its_attributes_show(shot, tmp_path):
    source = shot[0].with_name("shot.0001.exr")
    fill = lambda *words: lacuna("fill", source, "-o", tmp_path / "out.exr", "--filter", "ss", "-u", *words, ok=False)
    runs = [["--no-estimate"], [], ["--compression", "zip:1"], ["--compression", "zip:12"], ["--compression", "zip"]]
    for words in runs:
        assert "1 of 1 frame filled" in fill(*words).stderr, words
        assert "1 skipped" in fill(*words).stderr, words
    assert "skip " not in (said := fill("-n").stdout) and "compression was set otherwise" in said
    (tmp_path / "out.exr").chmod(0o444)
    refused = fill()
    assert refused.status == 1 and "read-only" in refused.stderr and "--force" not in refused.stderr


def test_an_output_without_sources_goes_by_times(shot, tmp_path):
    source, out = shot[0].with_name("shot.0001.exr"), tmp_path / "out.exr"
    quick_fill(source, "-o", out)
    raw = out.read_bytes()
    assert raw.count(b"lacuna/sources") == 1
    # The name of another attribute of the same length.
    out.write_bytes(raw.replace(b"lacuna/sources", b"somebody/elses"))
    os.utime(source, (time.time() - 100,) * 2)
    plan = lambda: quick_fill(source, "-o", out, "-u", "-n").stdout
    assert plan().startswith("skip ")
    os.utime(source, (time.time() + 100,) * 2)
    assert "is newer" in plan()


def test_an_input_that_is_replaced_while_it_is_filled_fails(shot, tmp_path):
    other = shot[0].with_name("shot.0002.exr")
    source, out = tmp_path / "in.exr", tmp_path / "out.exr"
    [planes] = frames.read(shot[0].with_name("shot.0001.exr"))
    frames.write(source, {name: np.tile(plane, (8, 8)) for name, plane in planes.items()})
    slow = ["--filter", "tv", "--tv-gap", "1e-300", "--tv-iterations", "1000000", "--time-limit", "3", "--no-estimate"]
    words = [LACUNA, "fill", source, "-o", out, *slow, "--progress", "plain"]
    running = subprocess.Popen([str(word) for word in words], stderr=subprocess.PIPE, text=True)
    wait_until_at_work(running)
    shutil.copy2(other, source)
    error = running.communicate(timeout=300)[1]
    assert running.returncode == 1 and "the input changed while the frame was made" in error, error
    assert not out.exists()


def test_a_frame_that_waits_for_its_turn_is_not_late(shot, tmp_path):
    slow = ["--filter", "tv", "--tv-gap", "1e-300", "--tv-iterations", "1000000", "--time-limit", "0.5", "--no-estimate"]
    lacuna("fill", shot[0], "-o", shot[1], *slow, "--json", tmp_path / "r.json")
    done = [frame["iterations"] for frame in json.loads((tmp_path / "r.json").read_text())["frames"]]
    assert min(done) > 0, done


def test_a_folder_in_the_place_of_an_output_stops_no_other_frame(shot):
    folder = shot[1].with_name("shot.0002.exr")
    folder.mkdir()
    for flags in [[], ["--no-clobber"]]:
        result = quick_fill(shot[0], "-o", shot[1], "-q", *flags, ok=False)
        assert result.status == 1 and len(result.lines()) == 1 and "shot.0002.exr (frame 2)" in result.stderr, result
        assert names(shot[1]) == numbered(1, 2, 3, 4) and folder.is_dir()
    result = quick_fill(shot[0], "-o", shot[1], "--json", folder, ok=False)
    assert result.status == 2 and "it is a folder" in result.stderr or "written twice" in result.stderr, result


def test_no_clobber_leaves_what_is_there(shot):
    there = shot[1].with_name("shot.0001.exr")
    there.write_bytes(b"mine")
    quick_fill(shot[0], "-o", shot[1], "--no-clobber", ok=False)
    assert there.read_bytes() == b"mine"
    assert names(shot[1]) == numbered(1, 2, 3, 4)


def test_the_input_is_never_overwritten(shot):
    before = shot[0].with_name("shot.0001.exr").read_bytes()
    assert quick_fill(shot[0], "-o", shot[0], ok=False).status in (1, 2)
    assert shot[0].with_name("shot.0001.exr").read_bytes() == before


def test_a_dry_run_writes_nothing(shot):
    result = quick_fill(shot[0], "-o", shot[1], "-n")
    assert "shot.0003.exr" in result.stdout + result.stderr
    assert names(shot[1]) == []


def test_a_list_of_files(shot):
    listed = "\n".join(str(path) for path in sorted(shot[0].parent.iterdir())[:2])
    done = subprocess.run([LACUNA, "fill", "--files-from", "-", "-o", str(shot[1])], input=listed, text=True, capture_output=True)
    assert done.returncode == 0, done.stderr
    assert names(shot[1]) == numbered(1, 2)


def begun(process, folder):
    """A file of an output is there, under whatever name."""
    while process.poll() is None and not any(folder.iterdir()):
        time.sleep(0.001)


@pytest.mark.parametrize("when", ["at once", "at work", "writing"])
@pytest.mark.parametrize("killer", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_a_killed_run_leaves_no_partial_frame(shot, killer, when):
    process = subprocess.Popen([LACUNA, "fill", str(shot[0]), "-o", str(shot[1]), "--filter", "tv", "--threads", "1"],
                               stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if when == "at work":
        wait_until_at_work(process)
    elif when == "writing":
        begun(process, shot[1].parent)
    process.send_signal(killer)
    process.communicate(timeout=300)
    status = process.returncode
    assert status in (0, -killer, 128 + killer)
    for path in shot[1].parent.iterdir():
        if path.suffix == ".exr" and not path.name.startswith("."):
            assert set(frames.read(path)[0]) == {"R", "G", "B", "A", "mask"}
    if killer != signal.SIGKILL and status != -killer:
        assert set(names(shot[1])) <= set(numbered(1, 2, 3, 4)), "a temporary file was left behind"


def test_a_full_disk_leaves_nothing(shot):
    def small_files():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))

    result = quick_fill(SAMPLES / "parts.exr", "-o", shot[1].with_name("big.exr"), "-q", ok=False, before=small_files)
    assert result.status == 1 and len(result.lines()) == 1, result
    assert names(shot[1]) == []


def test_an_output_folder_that_is_not_there(shot):
    target = shot[1].parent / "new" / "shot.####.exr"
    result = quick_fill(shot[0], "-o", target, "-q", ok=False)
    assert result.status in (1, 2) and not target.parent.exists(), result
    quick_fill(shot[0], "-o", target, "--create-dir")
    assert names(target) == numbered(1, 2, 3, 4)


@pytest.mark.parametrize("name", ["with space.exr", "größe 填充.exr", "semi;colon & 'quote'.exr", "-dash.exr"])
def test_unusual_names(shot, name):
    source = shot[0].with_name(name)
    shutil.copy(shot[0].with_name("shot.0001.exr"), source)
    quick_fill(source, "-o", shot[1].with_name(name))
    assert names(shot[1]) == [name]


@pytest.mark.parametrize("name", ["p#1", "##", "v%03d", "$F4", "d[1]"])
def test_a_folder_of_that_very_name_is_that_folder(shot, tmp_path, name):
    source, target = tmp_path / name / "shot.####.exr", tmp_path / name / "full"
    shot[0].parent.rename(source.parent)
    for inputs in ([source], [source, "--frames", "1-4"], [source.with_name("shot.*.exr")]):
        quick_fill(*inputs, "-o", target / "shot.####.exr", "--create-dir")
        assert names(target / "any") == numbered(1, 2, 3, 4)
        shutil.rmtree(target)
    alone = source.with_name("alone.exr")
    quick_fill(source.with_name("shot.0001.exr"), "-o", alone)
    assert lacuna("mask", "-o", source.with_name("m.png"), "--size", "8x8", "--density", "0.5").status == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, "out"]) and alone.exists()


def test_a_folder_that_is_not_there_has_the_number(shot, tmp_path):
    quick_fill(shot[0], "-o", tmp_path / "new/####/full.exr", "--create-dir")
    assert names(tmp_path / "new/any") == [f"{number:04d}" for number in (1, 2, 3, 4)]
    quick_fill(tmp_path / "new/####/full.exr", "--frames", "2-3", "--again", "-o", tmp_path / "again/%d/f.##.exr", "--create-dir")
    assert [path.name for path in sorted(tmp_path.glob("again/*/*"))] == ["f.02.exr", "f.03.exr"]
    result = lacuna("mask", "-o", tmp_path / "masks/##/m.png", "--size", "8x8", "--density", "0.5", "--frames", "1-2", "--create-dir")
    assert result.status == 0 and names(tmp_path / "masks/any") == ["01", "02"], result
    result = quick_fill(tmp_path / "new/####/full.exr", "-o", shot[1], ok=False)
    assert result.status == 2 and "--frames is needed" in result.stderr, result


def test_names_that_are_not_utf8(shot, tmp_path):
    for number in (1, 2):
        shutil.copy(shot[0].with_name(f"shot.{number:04d}.exr"), tmp_path / f"in/odd\udcff.{number:04d}.exr")
    report, log, page = (tmp_path / name for name in ("r.json", "l.jsonl", "page.html"))
    quick_fill(tmp_path / "in/*.exr", "-o", tmp_path / "out/", "--json", report, "--log", log, "--report", page)
    assert names(shot[1]) == sorted(names(shot[0])) and len(names(shot[1])) == 6
    assert len(json.loads(report.read_text())["frames"]) == 6
    assert all(json.loads(line)["output_sha256"] for line in log.read_text().splitlines())
    checked = lacuna("verify", tmp_path / "in/*.exr", tmp_path / "out/")
    assert "6 of 6" in checked.stderr, checked
    quick_fill(tmp_path / "in/odd\udcff.####.exr", "-o", tmp_path / "out/p\udcfe.##.exr")
    assert {"p\udcfe.01.exr", "p\udcfe.02.exr"} < set(names(shot[1]))


def test_the_json_report(shot, tmp_path):
    report = tmp_path / "report.json"
    quick_fill(shot[0], "-o", shot[1], "--json", report)
    frames_done = json.loads(report.read_text())["frames"]
    assert [frame["frame"] for frame in frames_done] == [1, 2, 3, 4]
    for frame in frames_done:
        assert frame["input"].endswith(f"in/shot.{frame['frame']:04d}.exr")
        assert abs(frame["density"] - 0.2) < 0.01
        assert set(frame) >= {"non_finite", "iterations", "residual", "gap", "seconds"}


@pytest.mark.parametrize("words", [[], ["fill"], ["fill", "a.exr"], ["fill", "a.exr", "-o", "b.exr", "--filter", "what"],
                                   ["fill", "a.exr", "-o", "b.exr", "--frames", "1-"], ["nothing"]])
def test_usage_errors_exit_with_2(words):
    assert lacuna(*words, ok=False).status == 2


def test_a_frame_without_a_mask_names_its_channels(tmp_path):
    result = quick_fill(SAMPLES / "edges.exr", "-o", tmp_path / "out.exr", "-q", ok=False)
    assert result.status == 1 and len(result.lines()) == 1, result
    for name in "RGB":
        assert name in result.lines()[0]


@pytest.mark.parametrize("name", ["HTJ2K32", "HTJ2K256", "ZSTD", "LJ2K"])
def test_new_compressions_are_refused_with_a_way_out(tmp_path, name):
    planes = {key: np.ones((20, 20), np.float16) for key in ("R", "G", "B", "mask")}
    source = frames.write(tmp_path / "in.exr", planes, compression=getattr(OpenEXR, f"{name}_COMPRESSION"))
    result = quick_fill(source, "-o", tmp_path / "out.exr", "-q", ok=False)
    assert result.status == 1 and len(result.lines()) == 1, result
    assert name.rstrip("0123456789").removesuffix("2K").lower() in result.stderr.lower() and "oiiotool" in result.stderr, result


def test_a_frame_without_a_finite_value_has_no_spectrum(tmp_path):
    nan = np.full((16, 16), np.nan, np.float32)
    for names, said in (("RGB", "R, G, B"), ("Y", "Y")):
        source = frames.write(tmp_path / "nan.exr", dict.fromkeys(names, nan))
        result = lacuna("analyze", "--spectrum", source, ok=False)
        (line,) = result.lines()
        assert result.status == 1 and "nan.exr" in line and f"{said}: no pixel is finite" in line, result
        result = lacuna("info", source)
        assert f"note: {nan.size * len(names)} values are not finite" in result.stdout, result


def test_negative_numbers_of_four_digits_are_found_wherever_files_are_read(tmp_path):
    rows, columns = np.indices((24, 32))
    image = np.repeat(np.float32(np.sin(rows / 5) * columns / 32)[..., None], 3, axis=2)
    for number in (-2, -1, 0):
        name = f"-{-number:04}" if number < 0 else "0000"
        mask = frames.shuffle(24, 32, 0.3, seed=1 - number)
        frames.write(tmp_path / f"s.{name}.exr", {c: image[..., k] * mask for k, c in enumerate("RGB")})
        frames.write(tmp_path / f"m.{name}.exr", {"Y": mask.astype(np.float32)})
        frames.write(tmp_path / f"g.{name}.exr", {f"albedo.{c}": image[..., k] for k, c in enumerate("RGB")})
        frames.write_sparse(tmp_path / f"a.{name}.exr", image, mask)
        frames.write_sparse(tmp_path / f"b.{name}.exr", image, frames.shuffle(24, 32, 0.3, seed=11 - number))
    names = ["-0001", "-0002", "0000"]
    written = lambda folder: sorted(path.name.split(".")[1] for path in (tmp_path / folder).iterdir())
    fill = ["fill", tmp_path / "s.####.exr", "-o", f"{tmp_path}/o/", "--create-dir", "--frames", "-2-0", "--no-estimate",
            "--mask", f"file:{tmp_path}/m.####.exr"]
    for more in ([], ["--guides-from", tmp_path / "g.####.exr"], ["--layers", f"n={tmp_path}/g.####.exr"], ["--temporal", "1"]):
        result = lacuna(*fill, *more)
        assert "without frame" not in result.stderr and written("o") == names, result
    for k, words in enumerate((["--merge", tmp_path / "a.####.exr", tmp_path / "b.####.exr"],
                               ["--after", tmp_path / "a.####.exr", "--add", "0.1"])):
        lacuna("mask", *words, "-o", tmp_path / f"{k}/o.####.exr", "--create-dir", "--frames", "-2-0")
        assert written(str(k)) == names
