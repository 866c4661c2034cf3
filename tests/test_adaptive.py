"""Pixels chosen in rounds: by a renderer, and by a complete frame in its place."""

import json
import os
import pathlib
import re
import subprocess

import numpy
import OpenEXR
import pytest

import frames
from tool import LACUNA, ROOT, SAMPLES, lacuna

SCENE = SAMPLES / "scenes" / "marschner-lobb.toml"
SIZE = ("--size", "160x120")


def channels(path):
    return OpenEXR.File(str(path), separate_channels=True).channels()


def pixels(path, name):
    return numpy.asarray(channels(path)[name].pixels, dtype=numpy.float64)


def header(path):
    return OpenEXR.File(str(path), separate_channels=True).header()


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    path = tmp_path_factory.mktemp("adaptive") / "full.exr"
    lacuna("render", SCENE, "-o", path, *SIZE, "--seed", "3")
    return path


@pytest.mark.parametrize("kind", ["float", "half"])
def test_a_scene_and_its_complete_frame_choose_the_same_pixels(tmp_path, full, kind):
    if kind == "half":
        full = tmp_path / "half.exr"
        lacuna("render", SCENE, "-o", full, *SIZE, "--seed", "3", "-d", "half")
    flags = ("--density", "0.12", "--adaptive", "--rounds", "4")
    rendered, sparse, report = tmp_path / "rendered.exr", tmp_path / "sparse.exr", tmp_path / "report.json"
    lacuna("render", SCENE, "-o", rendered, *SIZE, "--seed", "3", "-d", kind, *flags, "--json", report)
    lacuna("sparsify", full, "-o", sparse, "--seed", "3", *flags, "--threads", "1")
    mask = pixels(sparse, "mask")
    assert mask.sum() == round(0.12 * 160 * 120)
    for name in ("mask", "R", "G", "B", "A"):
        assert numpy.array_equal(pixels(rendered, name), pixels(sparse, name)), name
    assert header(rendered)["lacuna/rounds"] == header(sparse)["lacuna/rounds"]
    assert header(rendered)["lacuna/pattern"].startswith("adaptive density=0.12 rounds=4")
    rounds = json.loads(report.read_text())["frames"][0]["rounds"]
    assert [r["pixels"] for r in rounds] == [r["rays"] for r in rounds]
    assert sum(r["pixels"] for r in rounds) == mask.sum()
    assert all(r["estimated_error"] > 0 and r["measured"] >= 0 and r["chosen"] >= 0 for r in rounds)


def test_the_pattern_has_the_rounds_that_few_pixels_take(tmp_path):
    full, sparse, rendered = (tmp_path / f"{name}.exr" for name in ("full", "sparse", "rendered"))
    size = ("--size", "8x6")
    lacuna("render", SCENE, "-o", full, *size)
    lacuna("sparsify", full, "-o", sparse, "--density", "0.1", "--adaptive")
    lacuna("render", SCENE, "-o", rendered, *size, "--density", "0.1", "--adaptive")
    for path in (sparse, rendered):
        assert header(path)["lacuna/pattern"] == "adaptive density=0.1 rounds=5 first=0.02"


def test_frames_in_a_row_choose_other_pixels(tmp_path):
    flags = ("--density", "0.12", "--adaptive", "--rounds", "4")
    still = ("render", SCENE, *SIZE, "--seed", "3", "--frames", "0-2")
    lacuna(*still, "-o", tmp_path / "full.####.exr")
    lacuna(*still, "-o", tmp_path / "rendered.####.exr", *flags)
    lacuna("sparsify", tmp_path / "full.####.exr", "-o", tmp_path / "sparse.####.exr", "--seed", "3", *flags)
    masks = [pixels(tmp_path / f"rendered.{k:04d}.exr", "mask") > 0 for k in range(3)]
    for k, mask in enumerate(masks):
        assert numpy.array_equal(mask, pixels(tmp_path / f"sparse.{k:04d}.exr", "mask") > 0), k
        # Chosen independently, they would share most: nothing moves.
        assert numpy.sum(mask & masks[k - 1]) < 0.5 * mask.sum()
    assert header(tmp_path / "sparse.0002.exr")["lacuna/pattern"].endswith(" frame=2")


def test_chosen_pixels_fill_better_than_even_ones(tmp_path, full):
    def error(*flags):
        path = tmp_path / "filled.exr"
        lacuna("render", SCENE, "-o", path, *SIZE, "--seed", "3", "--density", "0.2", "--fill", "ss", *flags)
        misses = [pixels(path, name) - pixels(full, name) for name in "RGB"]
        path.unlink()
        return numpy.sqrt(numpy.mean(numpy.square(misses)))

    assert error("--adaptive") < 0.8 * error()


def test_other_channels_come_with_the_pixels(tmp_path, full):
    path, whole = tmp_path / "sparse.exr", tmp_path / "whole.exr"
    layers = ("--depth", "--normals", "--gradients", "--samples", "2", "--seed", "3")
    lacuna("render", SCENE, "-o", whole, *SIZE, *layers)
    lacuna("render", SCENE, "-o", path, *SIZE, *layers, "--dense-aovs", "--density", "0.1", "--adaptive")
    measured = pixels(path, "mask") > 0
    for name in channels(whole):
        assert numpy.array_equal(pixels(path, name)[measured], pixels(whole, name)[measured]), name
    assert numpy.all(pixels(path, "dx.R")[~measured] == 0)
    assert "dense.A" in channels(path)


def test_a_target_ends_the_rounds(tmp_path, full):
    def run(target):
        path, report = tmp_path / "sparse.exr", tmp_path / "report.json"
        path.unlink(missing_ok=True)
        done = lacuna("sparsify", full, "-o", path, "--density", "0.2", "--adaptive", "--target-error", target,
                      "--json", report)
        return done, json.loads(report.read_text())["frames"][0]

    done, record = run("1")
    assert "at once" in done.stderr and len(record["rounds"]) == 1 and not record["warnings"]
    done, record = run("0")
    assert len(record["rounds"]) == 8 and "not reached" in record["warnings"][0]


@pytest.mark.parametrize("flags, says", [
    (("--density", "0.1", "--adaptive", "--first", "0.2"), "--first 0.2 is more than --density 0.1"),
    (("--density", "0.0001", "--adaptive", "--rounds", "8"), "rounds = 8"),
    (("--density", "0.1", "--adaptive", "--rounds", "1", "--first", "0.1"), "--first 0.1"),
    (("--density", "0.1", "--adaptive", "--first", "0"), "above 0"),
    (("--mask", "m.png", "--adaptive"), "--adaptive"),
    (("--adaptive",), "--density"),
    (("--density", "0.1", "--rounds", "3"), "--adaptive"),
    (("--density", "0.1", "--adaptive", "--rounds", "0"), "1 or more"),
    (("--density", "0.1", "--adaptive", "--target-error", "-1"), "--target-error"),
])
def test_what_cannot_be_done_is_said(tmp_path, full, flags, says):
    path = tmp_path / "sparse.exr"
    for command in (("sparsify", full), ("render", SCENE, *SIZE)):
        done = lacuna(*command, "-o", path, *flags, ok=False)
        assert done.status in (1, 2) and says in done.stderr, done
        assert "panicked" not in done.stderr and not path.exists()


def test_a_next_pass_of_no_pixel_is_refused(tmp_path, full):
    first, then = tmp_path / "first.exr", tmp_path / "then.exr"
    lacuna("sparsify", full, "-o", first, "--density", "0.1")
    nothing = tmp_path / "nothing.exr"
    OpenEXR.File({}, {"Y": numpy.zeros((120, 160), dtype=numpy.float32)}).write(str(nothing))
    for flags, says in ((["--add", "0"], "none of"), (["--add", "1e-7"], "add more"), (["--add", "0.1", "--inside", nothing], "--inside")):
        done = lacuna("mask", "--after", first, "-o", then, *flags, ok=False)
        assert done.status == 1 and says in done.stderr and not then.exists(), done


def test_frames_without_colour_are_refused(tmp_path):
    numbers = numpy.zeros((8, 9), dtype=numpy.uint32)
    OpenEXR.File({}, {"id": numbers}).write(str(tmp_path / "ids.exr"))
    out = tmp_path / "out.exr"
    done = lacuna("sparsify", tmp_path / "ids.exr", "-o", out, "--density", "0.5", "--adaptive", ok=False)
    assert done.status == 1 and "colours" in done.stderr and not out.exists(), done


def test_the_loop_of_the_page_runs_as_written(tmp_path):
    page = (ROOT / "docs" / "masks.md").read_text()
    script = re.search(r"<!-- tested: rounds -->\n```sh\n(.*?)```", page, re.S).group(1)
    (tmp_path / "samples").symlink_to(SAMPLES)
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "lacuna").symlink_to(pathlib.Path(LACUNA).resolve())
    path = f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}"
    subprocess.run(["bash", "-euc", script], cwd=tmp_path, env={**os.environ, "PATH": path}, check=True)
    mask = pixels(tmp_path / "frame.exr", "mask")
    assert abs(mask.mean() - 0.2) < 1e-3
    # One pass of as many pixels is worse.
    lacuna("sparsify", tmp_path / "full.exr", "-o", tmp_path / "even.exr", "--density", "0.2")
    lacuna("fill", tmp_path / "even.exr", "-o", tmp_path / "even-filled.exr")

    def error(name):
        pairs = ((pixels(tmp_path / name, c), pixels(tmp_path / "full.exr", c)) for c in "RGB")
        return numpy.sqrt(numpy.mean([numpy.square(a - b) for a, b in pairs]))

    assert error("filled.exr") < 0.9 * error("even-filled.exr")


def test_what_lies_between_parts_is_neither_chosen_nor_counted(tmp_path):
    rows, columns = numpy.indices((48, 64))
    disc = (numpy.hypot(rows - 24, columns - 30) < 15).astype(numpy.float32)
    parts = [frames.part(dict.fromkeys("RGB", values), (x, 0), ((0, 0), (255, 95)), name=name) for name, x, values in (("a", 0, disc), ("b", 208, 0 * disc))]
    gap = frames.write(tmp_path / "gap.exr", parts)
    lacuna("sparsify", gap, "-o", tmp_path / "sparse.exr", "--adaptive", "--density", "0.1")
    chosen = [numpy.count_nonzero(part["mask"]) for part in frames.read(tmp_path / "sparse.exr")]
    assert sum(chosen) == round(0.1 * 2 * 48 * 64), chosen


def test_a_full_mask_has_no_error(tmp_path):
    black = frames.write(tmp_path / "black.exr", dict.fromkeys("RGB", numpy.zeros((32, 32), numpy.float32)))
    words = ("sparsify", black, "-o", tmp_path / "out.exr", "--adaptive", "--target-error", "0.01", "-v", "--density")
    full, part = (lacuna(*words, density).stderr for density in ("1", "0.5"))
    assert "is reached" in full and "not" not in full.split("target error")[1], full
    assert "is not known" in part and "higher density" not in part, part


def test_both_files_of_the_next_pixels_have_their_folders_first(tmp_path):
    rows, columns = numpy.indices((32, 32))
    image = numpy.repeat(numpy.float32(rows * columns / 1000)[..., None], 3, axis=2)
    first = frames.write_sparse(tmp_path / "a.exr", image, frames.shuffle(32, 32, 0.2))
    words = ("mask", "--after", first, "--add", "0.1", "-o", tmp_path / "m/m.exr", "--error-estimate", tmp_path / "e/e.exr")
    (tmp_path / "m").mkdir()
    result = lacuna(*words, ok=False)
    assert result.status == 2 and "--create-dir" in result.stderr and not list((tmp_path / "m").iterdir()), result
    lacuna(*words, "--create-dir")
    assert (tmp_path / "m/m.exr").exists() and (tmp_path / "e/e.exr").exists()
