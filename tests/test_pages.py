"""Every command on a page runs as it stands, in the order of the page, in a folder that has the frames that it speaks of.

A block that is run elsewhere says so with `<!-- tested: NAME -->` before it, one that cannot be run with `<!-- not run: REASON -->`."""

import os
import pathlib
import re
import shutil
import subprocess
import sys

import numpy as np
import OpenEXR
import pytest

import frames
from tool import LACUNA, ROOT, SAMPLES, lacuna, quick_fill

PAGES = ["README.md", "CONTRIBUTING.md", "samples/README.md", *(f"docs/{page.name}" for page in (ROOT / "docs").glob("*.md"))]
# What stands before a block, and the block.
BLOCK = re.compile(r"(?:<!-- (tested|not run): (.*?) -->\n)?```sh\n(.*?)```", re.DOTALL)
# Names of walk-throughs that tests of their own run, and those tests.
ELSEWHERE = {"rounds": "test_adaptive", "mitsuba": "test_renderers", "luxcore": "test_renderers", "recipes": "test_renderers",
             "ledger": "test_farm", "parallel": "test_farm"}


def blocks(page):
    """The blocks to be run, and the names of those that others run."""
    text = (ROOT / page).read_text()
    named = re.findall(r"<!-- tested: (\w+) -->", text)
    text = re.sub(r"<!-- tested: \w+ -->\n(?:(?!```).)*?(```sh\n.*?)<!-- end of test -->", "", text, flags=re.DOTALL)
    return [block for kind, _, block in BLOCK.findall(text) if not kind], named


def render(folder, name, size=(96, 128), **channels):
    """A complete frame: smooth colour with an edge, normals and a depth; `channels` beside them."""
    y, x = np.mgrid[0:size[0], 0:size[1]] / size[0]
    inside = (x - 0.6) ** 2 + (y - 0.5) ** 2 < 0.1
    planes = {c: np.where(inside, 0.8 - 0.3 * x * k, 0.2 + 0.3 * y) for k, c in enumerate("RGB", 1)}
    planes |= {"N.X": np.where(inside, x - 0.6, 0), "N.Y": np.where(inside, y - 0.5, 0)}
    planes["N.Z"] = np.sqrt(1 - planes["N.X"] ** 2 - planes["N.Y"] ** 2)
    planes |= {"Z": np.where(inside, 2 - planes["N.Z"], 4)} | channels
    OpenEXR.File({}, {c: np.ascontiguousarray(plane, np.float32) for c, plane in planes.items()}).write(str(folder / name))


def sequence(folder, part=slice(48, 144)):
    """Sparse frames of the samples, or a part of each."""
    for name in (f"shot.{number:04d}.exr" for number in range(1, 5)):
        [channels] = frames.read(SAMPLES / "sequence" / name)
        frames.write(folder / name, {channel: plane[part, part] for channel, plane in channels.items()})


def complete(folder):
    render(folder, "full.exr")
    render(folder, "small.exr", (48, 64))
    lacuna("sparsify", folder / "full.exr", "-o", folder / "sparse.exr", "--density", "0.2", "--channels", "N.*=keep", "--channels", "Z=keep")
    quick_fill(folder / "sparse.exr", "-o", folder / "filled.exr")


def readme(folder):
    sequence(folder)
    render(folder, "full.exr")
    render(folder, "small.exr", (48, 64))
    lacuna("sparsify", folder / "full.exr", "-o", folder / "made.exr", "--density", "0.2")
    quick_fill(folder / "made.exr", "-o", folder / "filled.exr")
    (folder / "study.toml").write_text('patterns = ["shuffle"]\ndensities = [0.2]\nfilters = ["ss"]\n\n[[frames]]\nname = "full"\nfile = "full.exr"\n')


def layers(folder):
    """One file a layer, as LuxCore writes them."""
    render(folder, "full.exr")
    size = (96, 128)
    lacuna("mask", "-o", folder / "mask.0001.exr", "--size", f"{size[1]}x{size[0]}", "--density", "0.3")
    for name in ("RGB", "ALBEDO", "DEPTH", "NORMAL", "AVG_SHADING_NORMAL", "SAMPLECOUNT"):
        y, x = np.mgrid[0:size[0], 0:size[1]].astype(np.float32) / size[0]
        single = name in ("DEPTH", "SAMPLECOUNT")
        OpenEXR.File({}, {c: (x + y) / 2 for c in ("R" if single else "RGB")}).write(str(folder / f"{name}.0001.exr"))


def guided(folder):
    complete(folder)
    lacuna("sparsify", folder / "full.exr", "-o", folder / "s.0001.exr", "--density", "0.2", "--channels", "N.*=keep")
    render(folder, "aov.0001.exr")


def upscaling(folder):
    complete(folder)
    # The page asks for sizes that are no more than 16 times as large.
    sequence(folder, slice(None))
    render(folder, "aovs.exr", (96, 128))


def dictionary(folder):
    complete(folder)
    (folder / "views").mkdir()
    for k in range(3):
        render(folder, f"views/{k}.exr", (160, 160 + 8 * k))


def noisy(folder):
    random = np.random.default_rng(1)
    halves = {f"half{k}.{c}": 0.5 + 0.1 * random.standard_normal((64, 64)) for k in (1, 2) for c in "RGB"}
    mean = {c: (halves[f"half1.{c}"] + halves[f"half2.{c}"]) / 2 for c in "RGB"}
    mask = (np.indices((64, 64)).sum(0) % 3 == 0).astype(np.float32)
    planes = {c: plane * mask for c, plane in (mean | halves).items()} | {"mask": mask}
    OpenEXR.File({}, {c: plane.astype(np.float32) for c, plane in planes.items()}).write(str(folder / "noisy.exr"))


def rendering(folder):
    header = "NRRD0005\ntype: uint8\ndimension: 3\nsizes: 24 24 24\nencoding: raw\n\n".encode()
    z, y, x = np.indices((24, 24, 24)) - 12
    (folder / "engine.nrrd").write_bytes(header + np.clip(255 - 16 * np.sqrt(x * x + y * y + z * z), 0, 255).astype(np.uint8).tobytes())
    shutil.copy(folder / "samples" / "scenes" / "vessels.toml", folder / "scene.toml")


PREPARED = {"README.md": readme, "docs/guided.md": guided, "docs/upscaling.md": upscaling, "docs/dictionary.md": dictionary, "docs/noise.md": noisy,
            "docs/rendering.md": rendering, "docs/files.md": layers, "docs/farm.md": sequence, "docs/sequences.md": sequence, "docs/renderers.md": layers}


def samples(folder):
    """The samples, with fewer pixels where much is computed from them: pages say what is done, not with how many."""
    for name in ("scenes", "sequence"):
        (folder / name).mkdir(parents=True)
    sequence(folder / "sequence")
    for scene in (SAMPLES / "scenes").glob("*.toml"):
        text, changed = re.subn(r"^size = .*", "size = [128, 96]", scene.read_text(), flags=re.MULTILINE)
        assert changed == 1, scene
        (folder / "scenes" / scene.name).write_text(text)
    for path in SAMPLES.iterdir():
        if not (folder / path.name).exists():
            (folder / path.name).symlink_to(path)


def place(folder):
    """A folder as the project's, with programs in `bin`: the tool, `cargo run` as the tool, a Slurm that takes every job."""
    for name in ("scripts", ".venv"):
        (folder / name).symlink_to(ROOT / name)
    samples(folder / "samples")
    programs = folder / "bin"
    programs.mkdir()
    (folder / "target" / "release").mkdir(parents=True)
    for link in (programs / "lacuna", folder / "target" / "release" / "lacuna"):
        link.symlink_to(pathlib.Path(LACUNA).resolve())
    for name, text in (("cargo", 'test "$1 $2 $3" = "run --release --" && shift 3 && exec lacuna "$@"'), ("sbatch", "echo 117"), ("scontrol", "exit 0")):
        (programs / name).write_text(f"#!/bin/sh\n{text}\n")
        (programs / name).chmod(0o755)
    return os.environ | {"PATH": os.pathsep.join([str(programs), str(pathlib.Path(sys.executable).parent), os.environ["PATH"]])}


def play(page, folder):
    todo, named = blocks(page)
    for name in named:
        assert (ROOT / "tests" / f"{ELSEWHERE[name]}.py").exists(), name
    environment = place(folder)
    PREPARED.get(page, lambda _: None)(folder)
    result = subprocess.run(["bash", "-euxo", "pipefail", "-c", "\n".join(todo)], cwd=folder, env=environment, stdin=subprocess.DEVNULL,
                            capture_output=True, text=True, timeout=600)
    assert result.returncode == 0, result.stderr[-3000:]
    return len(todo)


@pytest.mark.parametrize("page", [page for page in PAGES if page != "docs/tutorial.md"])
def test_the_commands_run_as_they_stand(page, tmp_path):
    play(page, tmp_path)
    prose = re.sub(r"```.*?```", "", (ROOT / page).read_text(), flags=re.DOTALL)
    indented = [line for line in prose.splitlines() if re.match(r"    lacuna [a-z]+ [^A-Z(]*$", line)]
    assert not indented, "a command in a block that is not run"


def test_the_tutorial_comes_to_what_it_says(tmp_path):
    assert play("docs/tutorial.md", tmp_path) > 5
    out = tmp_path / "out"
    assert (out / "compare.html").stat().st_size > 10_000 and (out / "shot.html").exists()
    full, filled, adaptive = (frames.colour(out / f"{name}.exr") for name in ("full", "filled", "adaptive"))
    assert frames.psnr(filled, full) > 25 and frames.psnr(adaptive, full) > frames.psnr(filled, full)
    large = frames.read(out / "large.exr")[0]
    assert large["R"].shape == (360, 640) and np.isfinite(large["R"].astype(np.float32)).all()
    assert len(list((out / "shot").iterdir())) == 4 and not (out / "farm").exists()


def test_the_rules_and_the_study_of_the_pages_are_read(tmp_path):
    rules, study = (re.search(r"```toml\n(.*?)```", (ROOT / "docs" / page).read_text(), re.DOTALL)[1] for page in ("fill.md", "study.md"))
    (tmp_path / "show.toml").write_text(rules)
    quick_fill(SAMPLES / "sequence" / "shot.0001.exr", "-o", tmp_path / "filled.exr", "--rules", tmp_path / "show.toml")
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "study.toml").write_text(study)
    (tmp_path / "smooth.exr").symlink_to(SAMPLES / "smooth.exr")
    lacuna("study", tmp_path / "study" / "study.toml", "-o", tmp_path / "out", "-n")
