"""EXR files that others wrote: the valid ones pass through unchanged, the unsupported and the hostile are refused in one line."""

import struct

import numpy as np
import pytest

import frames
import header
from tool import DATA, idiff, quick_fill

pytestmark = pytest.mark.data

MIB = 1 << 20
BUDGET = 200 * MIB
# For the program, its threads, and what the allocator loses.
BESIDE = 64 * MIB
HOSTILE = ("Damaged", "invalid", "fuzzed")
# Attributes that are derived from the pixels, or from how the chunks lie in the file, and are dropped or made anew.
DERIVED = {"preview", "oiio:SHA-1", "oiio:AverageColor", "chunkCount"}


def files():
    found = sorted(path for path in (DATA / "exr").rglob("*") if path.is_file() and path.suffix not in (".rst", ".md"))
    hostile = [path for path in found if any(word in path.parts for word in HOSTILE)]
    sound = [path for path in found if path not in hostile]
    refused = [path for path in sound if header.unsupported(path)]
    return [path for path in sound if path not in refused], refused, hostile


SOUND, REFUSED, HOSTILE_FILES = files() if DATA.is_dir() else ([], [], [])


def name(path):
    return path.relative_to(DATA / "exr").as_posix()


def union(parts):
    """The smallest window that holds every part."""
    windows = np.array([part.window() for part in parts], np.int64)
    return (*windows[:, :2].min(axis=0), *windows[:, 2:].max(axis=0))


@pytest.fixture(scope="session")
def full_mask(tmp_path_factory):
    """Makes mask files in which all of a window is measured; one file a window."""
    folder, made = tmp_path_factory.mktemp("masks"), {}

    def make(window):
        window = tuple(int(edge) for edge in window)
        if window not in made:
            made[window] = frames.full_mask(folder / f"{len(made)}.exr", window)
        return made[window]

    return make


def has_levels(part):
    tiles = part.attributes.get("tiles")
    return tiles is not None and tiles[1][8] & 15 != 0


def check_attributes(before, after):
    """Every attribute of a part has its type, bytes and order, but for those that follow from what was done."""
    changed = set(DERIVED)
    if before.compression in header.LOSSY and after.compression not in header.LOSSY:
        assert header.COMPRESSIONS[after.compression] == "zip"
        changed.add("compression")
    if has_levels(before):
        assert after.attributes["tiles"][1][:8] == before.attributes["tiles"][1][:8]
        assert not has_levels(after)
        changed.add("tiles")
    kept = {key: value for key, value in before.attributes.items() if key not in changed}
    for key, value in kept.items():
        assert after.attributes.get(key) == value, key
    assert [key for key in after.attributes if key in kept] == list(kept), "the order of the attributes"
    added = set(after.attributes) - set(before.attributes)
    assert all(key.startswith("lacuna/") or key == "chunkCount" for key in added), added


def check_pixels(before, after, decoded_loosely):
    """Nothing is missing: every pixel has its bits, NaN and infinities included."""
    assert list(before) == list(after)
    for key in before:
        old, new = before[key], after[key]
        assert old.dtype == new.dtype and old.shape == new.shape, key
        if decoded_loosely:
            np.testing.assert_allclose(new, old, rtol=4e-3, atol=2e-3, err_msg=key)
        else:
            assert frames.same_bits(old, new), key


@pytest.mark.parametrize("path", SOUND, ids=name)
def test_a_full_mask_returns_the_file(path, full_mask, tmp_path):
    before, _ = header.read(path)
    out = tmp_path / "out.exr"
    quick_fill(path, "-o", out, "--mask", f"file:{full_mask(union(before))}")
    after, _ = header.read(out)
    assert len(before) == len(after)
    for one, other in zip(before, after):
        check_attributes(one, other)
    # Decoders of DWA agree up to rounding only.
    loosely = any(header.COMPRESSIONS[part.compression].startswith("dwa") for part in before)
    for one, other in zip(frames.read(path), frames.read(out), strict=True):
        check_pixels(one, other, loosely)
    if not loosely and not any(has_levels(part) for part in before):
        idiff(path, out)


@pytest.mark.parametrize("path", REFUSED, ids=name)
def test_what_is_unsupported_is_refused_by_name(path, full_mask, tmp_path):
    reason = header.unsupported(path)
    window = union(header.read(path)[0])
    result = quick_fill(path, "-o", tmp_path / "out.exr", "--mask", f"file:{full_mask(window)}", "-q", ok=False)
    assert result.status == 1, result
    lines = result.lines()
    assert len(lines) == 1 and path.name in lines[0] and reason in lines[0].lower(), result
    assert not (tmp_path / "out.exr").exists()


def window_of(path):
    """The window that a damaged file claims, if it is of a size that a mask can have here."""
    try:
        x_min, y_min, x_max, y_max = union(header.read(path)[0])
        if 0 < x_max - x_min + 1 <= 8192 and 0 < y_max - y_min + 1 <= 8192 and (x_max - x_min + 1) * (y_max - y_min + 1) <= 1 << 24:
            return x_min, y_min, x_max, y_max
    except (ValueError, KeyError, struct.error):
        pass
    return 0, 0, 63, 63


@pytest.mark.parametrize("mask", ["nan", "full"])
@pytest.mark.parametrize("path", HOSTILE_FILES, ids=name)
def test_a_hostile_file_costs_one_line(path, mask, full_mask, tmp_path):
    source = "nan" if mask == "nan" else f"file:{full_mask(window_of(path))}"
    words = ("-o", tmp_path / "out.exr", "--mask", source, "-q", "--memory", str(BUDGET))
    result = quick_fill(path, *words, ok=False, timeout=300)
    assert result.status in (0, 1), result
    assert result.peak_bytes <= BUDGET + BESIDE, f"{result.peak_bytes / MIB:.0f} MiB\n{result}"
    assert (tmp_path / "out.exr").exists() == (result.status == 0)
    assert [entry.name for entry in tmp_path.iterdir()] in ([], ["out.exr"]), "something was left behind"
    if result.status == 1:
        assert len(result.lines()) == 1 and path.name in result.lines()[0], result
