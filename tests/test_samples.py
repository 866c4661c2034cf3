"""The samples: made by their script, and each channel of the two-part frame gets its rule."""

import subprocess
import sys

import numpy as np
import pytest

import frames
from tool import ROOT, SAMPLES, lacuna, quick_fill


def test_the_script_makes_the_samples(tmp_path):
    """Same files; same bits, but for a last place where another processor's mathematics differs."""
    subprocess.run([sys.executable, SAMPLES / "make.py", tmp_path], check=True, stdout=subprocess.DEVNULL)
    committed = {path.relative_to(SAMPLES) for path in SAMPLES.rglob("*.exr")}
    assert {path.relative_to(tmp_path) for path in tmp_path.rglob("*.exr")} == committed
    for path in committed:
        for ours, theirs in zip(frames.read(tmp_path / path), frames.read(SAMPLES / path), strict=True):
            assert list(ours) == list(theirs)
            for name in ours:
                assert ours[name].dtype == theirs[name].dtype
                np.testing.assert_allclose(ours[name], theirs[name], rtol=2e-3, atol=1e-6, err_msg=f"{path} {name}")


def test_the_samples_stay_small():
    assert sum(path.stat().st_size for path in SAMPLES.rglob("*") if path.is_file()) < 1.2e6


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    """The two-part frame: sparse, filled and full."""
    out = tmp_path_factory.mktemp("parts") / "filled.exr"
    quick_fill(SAMPLES / "parts.exr", "-o", out)
    return frames.read(SAMPLES / "parts.exr"), frames.read(out), frames.read(SAMPLES / "full" / "parts.exr")


def test_both_parts_are_filled_by_one_mask(parts):
    sparse, filled, full = parts
    assert "mask" not in sparse[1] and "mask" not in filled[1]
    for names, part in (("RGB", 0), (("diffuse.R", "diffuse.G", "diffuse.B"), 1)):
        images = [np.stack([source[part][name].astype(np.float32) for name in names], axis=-1) for source in parts]
        before, after = frames.psnr(images[0], images[2]), frames.psnr(images[1], images[2])
        assert after > before + 6


def test_identifiers_are_copied(parts):
    sparse, filled, full = (frame[0]["objectId"] for frame in parts)
    assert filled.dtype == np.uint32
    assert set(np.unique(filled)) <= set(np.unique(full))
    assert (filled == full).mean() > 0.97


def test_depths_are_never_between_surfaces(parts):
    measured = parts[0][0]["mask"] > 0
    filled = parts[1][0]["Z"]
    assert np.isin(filled, np.unique(parts[0][0]["Z"][measured])).all()
    assert np.isinf(filled).any()


def test_normals_have_unit_length(parts):
    measured = parts[0][0]["mask"] > 0
    planes = np.stack([parts[1][0][name].astype(np.float64) for name in ("N.x", "N.y", "N.z")], axis=-1)
    length = np.sqrt((planes**2).sum(axis=-1))[~measured]
    # In the background the measured normals are zero; that length may stay.
    assert np.all((np.abs(length - 1) < 3e-3) | (length < 1e-3))


def test_alpha_stays_within_its_range(parts):
    alpha = parts[1][0]["A"]
    assert alpha.min() >= 0 and alpha.max() <= 1


def test_info_names_every_channel_and_its_rule():
    import json

    text = lacuna("info", SAMPLES / "parts.exr").stdout
    for name, rule in (("objectId", "nearest"), ("Z", "depth"), ("N.x", "normal"), ("diffuse.R", "fill"), ("mask", "keep")):
        assert any(name in line and rule in line for line in text.splitlines()), (name, rule, text)
    json.loads(lacuna("info", SAMPLES / "parts.exr", "--json").stdout)


def test_info_describes_several_and_goes_on_after_one_that_fails(tmp_path):
    import json

    pattern, broken = SAMPLES / "sequence" / "shot.####.exr", tmp_path / "broken.exr"
    broken.write_bytes(b"no EXR file")
    result = lacuna("info", pattern, broken, ok=False)
    assert result.status == 1 and len(result.lines()) == 1 and "broken.exr" in result.stderr, result
    assert [line for line in result.stdout.splitlines() if line.endswith("exr:")] == [
        f"{SAMPLES}/sequence/shot.{frame:04d}.exr:" for frame in range(1, 5)]
    told = json.loads(lacuna("info", pattern, "--json").stdout)
    assert len(told) == 4 and told[0]["file"].endswith("shot.0001.exr") and abs(told[3]["density"] - 0.2) < 0.001


def test_info_knows_what_was_filled_from_what_was_complete(tmp_path):
    lacuna("sparsify", SAMPLES / "full" / "parts.exr", "-o", tmp_path / "s.exr", "--density", "0.3", "--channels", "N.*=keep")
    quick_fill(tmp_path / "s.exr", "-o", tmp_path / "f.exr")
    sparse, filled = ([line for line in lacuna("info", tmp_path / name).stdout.splitlines() if line.split()[1:2] == ["float"] or "guides" in line]
                      for name in ("s.exr", "f.exr"))
    assert sparse == filled and any("guides" in line for line in sparse), (sparse, filled)


def test_masks_of_frames_in_a_row_complete_each_other(tmp_path):
    full = SAMPLES / "full" / "sequence" / "shot.####.exr"
    lacuna("sparsify", full, "-o", tmp_path / "s.####.exr", "--density", "0.25")
    masks = sum(frames.read(tmp_path / f"s.{frame:04d}.exr")[0]["mask"].astype(int) for frame in range(1, 5))
    assert (masks == 1).all()
    lacuna("sparsify", SAMPLES / "full" / "sequence" / "shot.0003.exr", "-o", tmp_path / "alone.exr", "--density", "0.25")
    lacuna("mask", "-o", tmp_path / "mask.exr", "--size", "192x192", "--density", "0.25")
    alone, mask = (frames.read(tmp_path / name)[0]["mask"] for name in ("alone.exr", "mask.exr"))
    assert np.array_equal(alone, mask), "one frame alone has the mask of lacuna mask"
    words = ["render", SAMPLES / "scenes" / "marschner-lobb.toml", "--size", "32x24", "--density", "0.5", "--frames", "6-7"]
    lacuna(*words, "-o", tmp_path / "r.####.exr")
    one, other = (frames.read(tmp_path / f"r.{frame:04d}.exr")[0]["mask"] for frame in (6, 7))
    assert (one + other == 1).all()


def test_the_command_of_the_readme_fills_the_sequence(tmp_path):
    """The pattern of the README's first command, run from the root of the project."""
    quick_fill("samples/sequence/shot.####.exr", "-o", tmp_path / "out" / "shot.####.exr", "--create-dir", folder=ROOT)
    out = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert out == [f"shot.{frame:04d}.exr" for frame in range(1, 5)]
    for name in out:
        ours, full = (frames.colour(folder / name) for folder in (tmp_path / "out", SAMPLES / "full" / "sequence"))
        quality = frames.psnr(ours, full)
        assert quality > 30, name
