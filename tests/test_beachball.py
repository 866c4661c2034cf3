"""A production file with ten parts and two views: sparsified, filled, verified; and what `verify` must notice."""

import shutil

import numpy as np
import pytest

import frames
import header
from tool import DATA, SAMPLES, lacuna, quick_fill

FILE = DATA / "exr" / "openexr-images" / "Beachball" / "multipart.0001.exr"


@pytest.fixture(scope="module")
def beachball(tmp_path_factory):
    """The sparse and the filled file."""
    folder = tmp_path_factory.mktemp("beachball")
    sparse, out = folder / "sparse.exr", folder / "filled.exr"
    lacuna("sparsify", FILE, "-o", sparse, "--density", "0.3")
    quick_fill(sparse, "-o", out)
    return sparse, out


@pytest.mark.data
def test_sparsify_changes_nothing_else(beachball):
    before, after = frames.read(FILE), frames.read(beachball[0])
    for number, (full, sparse) in enumerate(zip(before, after, strict=True)):
        assert set(sparse) == set(full) | {"mask"}, number
        measured = sparse["mask"] > 0
        assert abs(measured.mean() - 0.3) < 0.01
        for name, plane in full.items():
            assert frames.same_bits(plane[measured], sparse[name][measured]), (number, name)
            assert not sparse[name][~measured].any(), (number, name)
    for one, other in zip(header.read(FILE)[0], header.read(beachball[0])[0], strict=True):
        kept = {key: value for key, value in one.attributes.items() if key not in ("channels", "chunkCount", "preview")}
        assert kept == {key: other.attributes.get(key) for key in kept}


@pytest.mark.data
def test_every_part_is_filled_and_measured_pixels_keep_their_bits(beachball):
    sparse, out = (frames.read(path) for path in beachball)
    for number, (before, after) in enumerate(zip(sparse, out, strict=True)):
        assert set(before) == set(after)
        measured = before["mask"] > 0
        for name, plane in before.items():
            assert frames.same_bits(plane[measured], after[name][measured]), (number, name)
            assert not np.isnan(after[name]).any(), (number, name)
    lacuna("verify", *beachball)


RULES = {"R": "fill", "G": "fill", "B": "fill", "A": "fill", "whitebarmask.mask": "fill", "mask": "keep", "Z": "depth",
         "forward.u": "fill", "forward.v": "fill"}
RULES |= {f"disparity{side}.{axis}": "fill" for side in "LR" for axis in "xy"}


@pytest.mark.data
def test_values_that_must_be_copied_are_copied(beachball):
    """Each value of the filled file stood at a measured pixel of the sparse one."""
    sparse, out = (frames.read(path) for path in beachball)
    seen = set()
    for before, after in zip(sparse, out, strict=True):
        measured = before["mask"] > 0
        for name in set(before) - {"mask"}:
            seen.add(name)
            copied = np.isin(frames.bits(after[name]), frames.bits(before[name][measured])).all()
            assert copied or RULES[name] == "fill", name
    assert seen | {"mask"} == set(RULES)


@pytest.mark.data
def test_info_says_the_rules(beachball):
    lines = [line.split() for line in lacuna("info", beachball[0]).stdout.splitlines()]
    for name, rule in RULES.items():
        rows = [words for words in lines if name in words]
        assert rows and any(rule in words for words in rows), (name, rule)


@pytest.fixture
def pair(tmp_path):
    """A sparse frame and its filled one."""
    sparse, out = SAMPLES / "parts.exr", tmp_path / "filled.exr"
    quick_fill(sparse, "-o", out)
    lacuna("verify", sparse, out)
    return sparse, out


def rewritten(path, change):
    """A copy of the file with other pixels in its first part, header unchanged as far as the library allows."""
    import OpenEXR

    file = OpenEXR.File(str(path), separate_channels=True)
    change({name: channel.pixels for name, channel in file.parts[0].channels.items()})
    changed = path.with_name("changed.exr")
    file.write(str(changed))
    return changed


def test_verify_accepts_what_another_tool_rewrote_without_change(pair):
    lacuna("verify", pair[0], rewritten(pair[1], lambda channels: None))


def test_verify_notices_one_bit(pair):
    mask = frames.read(pair[0])[0]["mask"] > 0
    row, column = np.argwhere(mask)[1000]

    def flip(channels):
        frames.bits(channels["R"])[row, column] ^= 1

    result = lacuna("verify", pair[0], rewritten(pair[1], flip), ok=False)
    assert result.status == 1
    said = result.stdout + result.stderr
    assert "R" in said and str(row) in said and str(column) in said, result


def test_verify_notices_one_bit_of_the_identifiers(pair):
    mask = frames.read(pair[0])[0]["mask"] > 0
    row, column = np.argwhere(mask)[500]

    def flip(channels):
        channels["objectId"][row, column] ^= 1

    result = lacuna("verify", pair[0], rewritten(pair[1], flip), ok=False)
    assert result.status == 1 and "objectId" in result.stdout + result.stderr, result


def test_verify_notices_a_frame_that_was_not_filled(pair, tmp_path):
    copy = tmp_path / "copy.exr"
    shutil.copy(SAMPLES / "sequence" / "shot.0001.exr", copy)
    assert lacuna("verify", pair[0], copy, ok=False).status == 1
