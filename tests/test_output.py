"""What `fill` writes: complete for the tools of others, the same bytes each time, nothing lost."""

import json
import os
import stat
import struct

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest

import frames
import header
from tool import SAMPLES, idiff, lacuna, oiio as oiio_tool, quick_fill

SIZE = 40


def picture(height=SIZE, width=SIZE, kind=np.float16):
    """A smooth picture with an edge, and a mask of 30 %."""
    rows, columns = np.indices((height, width)) / max(height, width)
    planes = [np.sin(3 * rows + k) * np.cos(4 * columns) * 0.4 + 0.5 + 0.3 * (columns > 0.6) for k in range(3)]
    return np.stack(planes, axis=-1).astype(kind), frames.shuffle(height, width, 0.3)


@pytest.fixture
def sparse(tmp_path):
    """A sparse frame, RGB and mask, with the options of `frames.write`."""

    def make(file="in.exr", kind=np.float16, size=(SIZE, SIZE), **options):
        pixels, mask = picture(*size, kind)
        planes = {key: np.where(mask, pixels[..., k], pixels.dtype.type(0)) for k, key in enumerate("RGB")}
        return frames.write(tmp_path / file, planes | {"mask": mask.astype(kind)}, **options)

    return make


def fill(source, *words, out=None):
    """Fills one frame, and holds it to what every output must be: accepted by others, finite, measured bits kept."""
    out = out or source.with_name("out.exr")
    quick_fill(source, "-o", out, *words)
    accepted(out)
    before, after = frames.read(source), frames.read(out)
    for one, other in zip(before, after, strict=True):
        measured = one["mask"] > 0 if "mask" in one else None
        for key in one:
            if measured is not None and key in other:
                assert frames.same_bits(one[key][measured], other[key][measured]), key
    return out


def accepted(path, finite=True):
    """oiiotool opens every part, and counts no NaN (idiff passes them) and no infinity."""
    result = oiio_tool("oiiotool", "-a", "--stats", path)
    assert result.status == 0 and "ERROR" not in result.stdout + result.stderr, result
    if finite:
        for word in ("Nan", "Inf"):
            counts = [line.split(":")[1].replace("(float)", "").split() for line in result.stdout.splitlines()
                      if line.strip().startswith(f"Stats {word}Count")]
            assert counts and all(int(count) == 0 for row in counts for count in row), result.stdout


def insert_attribute(path, name, kind, value):
    """Puts a raw attribute first into the header of a one-part file; the offset table moves along."""
    data = path.read_bytes()
    piece = name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<I", len(value)) + value
    parts, _ = header.read(path)
    rows = parts[0].window()[3] - parts[0].window()[1] + 1
    chunks = -(-rows // 16)
    reader = header.Reader(data)
    reader.take(8)
    while reader.text():
        reader.text()
        reader.take(struct.unpack("<I", reader.take(4))[0])
    table = struct.unpack_from(f"<{chunks}Q", data, reader.at)
    moved = struct.pack(f"<{chunks}Q", *(offset + len(piece) for offset in table))
    path.write_bytes(data[:8] + piece + data[8 : reader.at] + moved + data[reader.at + 8 * chunks :])


def test_a_key_code_survives(sparse):
    source = sparse(keyCode=OpenEXR.KeyCode(1, 2, 3, 4, 5, 4, 64))
    value = header.read(source)[0][0].attributes["keyCode"]
    assert len(value[1]) == 28
    out = fill(source)
    assert header.read(out)[0][0].attributes["keyCode"] == value
    assert OpenEXR.File(str(out)).header()["keyCode"].perfsPerCount == 64
    assert oiio.ImageInput.open(str(out)) is not None


def test_text_in_utf8_and_attributes_of_unknown_types_survive(sparse):
    source = sparse()
    insert_attribute(source, "note", "string", "Größe 3 × π, 填充".encode())
    insert_attribute(source, "studio/thing", "ourOwnType", bytes(range(256)))
    insert_attribute(source, "zeta", "string", b"")
    frames.read(source)  # the file that this test made is sound
    before = header.read(source)[0][0].attributes
    after = header.read(fill(source))[0][0].attributes
    for key in ("note", "studio/thing", "zeta"):
        assert after[key] == before[key]


def test_the_attributes_say_what_was_done(sparse):
    attributes = header.read(fill(sparse()))[0][0].attributes
    for key in ("version", "filter", "settings", "density", "mask"):
        assert f"lacuna/{key}" in attributes, key
    assert attributes["lacuna/filter"] == ("string", b"ss")


@pytest.mark.parametrize("method", ["ss", "tv", "pushpull", "nearest"])
def test_threads_and_memory_never_change_a_byte(method, tmp_path):
    for sample in ("parts.exr", "sequence/shot.0001.exr"):
        results = set()
        for words in (["--threads", "1"], ["--threads", "2"], ["--threads", "5"], ["--threads", "2", "--memory", "64M"], []):
            out = tmp_path / "out.exr"
            quick_fill(SAMPLES / sample, "-o", out, "--filter", method, *words)
            results.add(out.read_bytes())
            out.unlink()
        assert len(results) == 1, sample


def test_the_umask_is_obeyed(sparse):
    source = sparse()
    for mask in (0o022, 0o027, 0o077):
        out = source.with_name(f"{mask:o}.exr")
        quick_fill(source, "-o", out, before=lambda: os.umask(mask))
        assert stat.S_IMODE(out.stat().st_mode) == 0o666 & ~mask


@pytest.mark.parametrize("origin", [(0, 0), (-7, -13), (100, 50), (-20, 5)])
def test_data_windows_may_lie_anywhere(sparse, origin):
    display = ((0, 0), (29, 29))
    source = sparse(origin=origin, display=display)
    out = fill(source)
    for key in ("dataWindow", "displayWindow"):
        assert header.read(out)[0][0].window(key) == header.read(source)[0][0].window(key)
    # The window only names the pixels: the result is that of the same frame at the origin.
    plain = fill(sparse("plain.exr"), out=source.with_name("plain-out.exr"))
    for key, plane in frames.read(plain)[0].items():
        assert frames.same_bits(plane, frames.read(out)[0][key]), key
    # oiiotool sees the overscan where it is, and can crop to the display window.
    spec = oiio.ImageBuf(str(out)).spec()
    assert (spec.x, spec.y, spec.full_width, spec.full_height) == (*origin, 30, 30)
    assert oiio_tool("oiiotool", out, "--croptofull", "-o", source.with_name("crop.exr")).status == 0


@pytest.mark.parametrize("size", [(1, 1), (1, 17), (17, 1), (2, 2), (3, 5)])
@pytest.mark.parametrize("method", ["ss", "tv", "pushpull", "nearest"])
def test_the_smallest_frames(tmp_path, size, method):
    for count in {1, 2, max(1, size[0] * size[1] // 3)}:
        pixels = np.linspace(0.1, 0.9, size[0] * size[1] * 3).reshape(*size, 3).astype(np.float16)
        mask = np.arange(size[0] * size[1]).reshape(size) < count
        fill(frames.write_sparse(tmp_path / "in.exr", pixels, mask), "--filter", method)


@pytest.mark.parametrize("compression", ["NO", "RLE", "ZIPS", "ZIP", "PIZ"])
@pytest.mark.parametrize("kind", [np.float16, np.float32])
def test_lossless_compressions_are_kept(sparse, compression, kind):
    wanted = getattr(OpenEXR, f"{compression}_COMPRESSION")
    out = fill(sparse(kind=kind, compression=wanted))
    assert header.read(out)[0][0].compression == header.COMPRESSIONS.index(compression.lower().replace("no", "none"))


@pytest.mark.parametrize("compression", ["PXR24", "B44", "B44A", "DWAA", "DWAB"])
def test_lossy_compressions_become_zip(sparse, compression):
    out = fill(sparse(kind=np.float32, compression=getattr(OpenEXR, f"{compression}_COMPRESSION")))
    assert header.COMPRESSIONS[header.read(out)[0][0].compression] == "zip"


@pytest.mark.parametrize("compression", ["B44", "DWAA"])
def test_lossy_renders_are_united_without_loss(sparse, compression):
    lossy = getattr(OpenEXR, f"{compression}_COMPRESSION")
    a = sparse("a.exr", compression=lossy, preview=OpenEXR.PreviewImage(2, 2))
    b = sparse("b.exr")
    for one, other in ((a, b), (b, a)):
        out = a.with_name(f"of-{one.name}")
        result = lacuna("mask", "--merge", one, other, "-o", out)
        assert header.COMPRESSIONS[header.read(out)[0][0].compression] == "zip"
        assert frames.same_bits(frames.read(out)[0]["R"], frames.read(one)[0]["R"])
        assert ("would change measured pixels: written as zip" in result.stderr) == (one == a)
        assert ("dropped preview: the pixels are others now" in result.stderr) == (one == a)


def test_renders_by_other_cameras_are_doubted(sparse):
    eye = np.eye(4, dtype=np.float32)
    a, b, c = (sparse(f"{name}.exr", worldToCamera=matrix) for name, matrix in (("a", eye), ("b", eye), ("c", 2 * eye)))
    doubt = "the renders differ in worldToCamera: are they of one frame?"
    for other, doubted in ((b, False), (c, True)):
        result = lacuna("mask", "--merge", a, other, "-o", a.with_name(f"of-{other.name}"))
        assert (doubt in result.stderr) == doubted, result.stderr


def test_complete_frames_beside_a_matte_are_not_united(tmp_path):
    rows, columns = np.mgrid[:20, :30]
    planes = {name: np.sin(rows / 5 + columns / 3).astype(np.float16) for name in "RGB"}
    planes["mask"] = (np.hypot(rows - 10, columns - 15) < 6).astype(np.float32)
    a, b = (frames.write(tmp_path / f"{name}.exr", planes) for name in "ab")
    result = lacuna("mask", "--merge", a, b, "-o", tmp_path / "both.exr", ok=False)
    assert result.status == 1 and "nothing is missing in it" in result.stderr and "taken for a matte" in result.stderr
    assert not (tmp_path / "both.exr").exists()
    # The next pixels of such a frame: the same is said.
    assert "taken for a matte" in lacuna("mask", "--after", a, "--add", "0.1", "-o", tmp_path / "next.exr", ok=False).stderr


@pytest.mark.parametrize("compression", [OpenEXR.ZIP_COMPRESSION, OpenEXR.PXR24_COMPRESSION, OpenEXR.DWAA_COMPRESSION])
def test_complete_colour_beside_a_matte_is_copied(tmp_path, compression):
    rows, columns = np.mgrid[:32, :48]
    planes = {name: (2 + np.sin(rows / 5 + columns / 3)).astype(np.float32) for name in "RGB"}
    planes["mask"] = (np.hypot(rows - 16, columns - 24) < 9).astype(np.float32)
    given = frames.write(tmp_path / "in.exr", planes, compression=compression)
    result = lacuna("fill", given, "-o", tmp_path / "out.exr", "--filter", "ss")
    assert result.status == 0 and "taken for a matte" in result.stderr, result
    assert np.array_equal(frames.colour(tmp_path / "out.exr"), frames.colour(given))


def test_a_mask_of_zeros_beside_sparse_colour_is_an_error(tmp_path):
    sparse = frames.shuffle(32, 48, 0.2)
    planes = {name: np.where(sparse, 0.5, 0).astype(np.float32) * (1 + np.arange(48, dtype=np.float32)) for name in "RGB"}
    given = frames.write(tmp_path / "in.exr", planes | {"mask": np.zeros((32, 48), np.float32)})
    result = lacuna("fill", given, "-o", tmp_path / "out.exr", ok=False)
    assert result.status == 1 and "the mask (mask) has no measured pixel" in result.stderr and not (tmp_path / "out.exr").exists()


def test_drop_mask_says_what_it_does_not_drop(tmp_path):
    sparse = frames.shuffle(32, 48, 0.2).astype(np.float32)
    planes = {"R": sparse * (1 + np.arange(48, dtype=np.float32)), "A": sparse, "mask": sparse, "SAMPLECOUNT": 4 * sparse}
    given, out = frames.write(tmp_path / "in.exr", planes), tmp_path / "out.exr"
    for mask, said in (
        ("auto", None),
        (f"file:{given}", "is no channel of the frame"),
        ("alpha", "is no channel of the frame"),
        ("count:SAMPLECOUNT:4", "counts samples and stays"),
    ):
        for command in (["fill", "--filter", "ss"], ["upscale", "--scale", "2"]):
            result = lacuna(*command, given, "-o", out, "--mask", mask, "--drop-mask")
            assert result.status == 0, result
            assert set(frames.read(out)[0]) == set(planes) - ({"mask"} if said is None else set()), (mask, command)
            told = [line for line in result.lines() if "--drop-mask leaves nothing out" in line]
            assert command[0] != "fill" or lacuna("verify", given, out).status == 0
            assert len(told) == (said is not None) and all(said in line for line in told), result


def test_pairs_do_not_complete_each_other(tmp_path):
    words = ["--size", "8x8", "--density", "0.25", "--frames", "1-4", "--temporal", "complementary", "--paired"]
    result = lacuna("mask", *words, "-o", tmp_path / "m.####.png", ok=False)
    assert result.status == 2 and "--temporal offset" in result.stderr


def test_a_pattern_of_masks_needs_frames(tmp_path):
    result = lacuna("mask", "--size", "8x8", "--density", "0.5", "-o", tmp_path / "new" / "m.####.png", "--create-dir", ok=False)
    assert result.status == 2 and "a pattern needs --frames" in result.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", [np.float16, np.float32])
@pytest.mark.parametrize("compression", ["B44", "B44A", "DWAA", "DWAB"])
def test_what_a_lossy_compression_made_of_zeros_is_filled(tmp_path, compression, kind):
    rows, columns = np.indices((SIZE, SIZE))
    mask = frames.shuffle(SIZE, SIZE, 0.3)
    full = {f"albedo.{name}": np.where(columns // 9 % 2, 0.3 + 0.2 * k, 0.8 - 0.2 * k) for k, name in enumerate("RGB")}
    full |= {name: 0.5 + 0.4 * np.sin(rows / 9) for name in "RGB"} | {"A": np.full(mask.shape, 0.9)}
    planes = {name: np.where(mask, plane, 0).astype(kind) for name, plane in full.items()}
    source = frames.write(tmp_path / "in.exr", planes | {"mask": mask.astype(np.float32)},
                          compression=getattr(OpenEXR, f"{compression}_COMPRESSION"))
    [filled] = frames.read(fill(source, "--guides", "auto"))
    for name, plane in full.items():
        assert abs(filled[name][~mask].mean() - plane[~mask].mean()) < 0.1, name


def test_tiles_stay_tiles(sparse):
    tiles = OpenEXR.TileDescription()
    tiles.xSize, tiles.ySize = 16, 24
    source = sparse(type=OpenEXR.tiledimage, tiles=tiles)
    assert header.read(source)[0][0].attributes["tiles"][1] == struct.pack("<IIB", 16, 24, 0)
    out = fill(source)
    assert header.read(out)[0][0].attributes["tiles"] == header.read(source)[0][0].attributes["tiles"]


def test_measured_nans_are_filled_and_counted(tmp_path):
    pixels, mask = picture(kind=np.float32)
    rows, columns = np.nonzero(mask)
    pixels[rows[:3], columns[:3], 0] = [np.nan, np.inf, -np.inf]
    source = frames.write_sparse(tmp_path / "in.exr", pixels, mask)
    out, report = tmp_path / "out.exr", tmp_path / "report.json"
    result = quick_fill(source, "-o", out, "--json", report)
    assert json.loads(report.read_text())["frames"][0]["non_finite"] == 3
    assert "finite" in result.stderr, result
    accepted(out)


def test_every_sample_is_filled_and_accepted(tmp_path):
    for sample in sorted((SAMPLES / "sequence").glob("*.exr")):
        fill(sample, out=tmp_path / sample.name)
    out = tmp_path / "parts.exr"
    quick_fill(SAMPLES / "parts.exr", "-o", out)
    accepted(out, finite=False)  # depth is infinite where nothing is


def test_a_full_frame_comes_back_equal(tmp_path):
    pixels, _ = picture()
    source = frames.write_sparse(tmp_path / "in.exr", pixels, np.ones(pixels.shape[:2], bool))
    idiff(source, fill(source))


def test_a_half_that_overflows_is_clamped(tmp_path):
    rows, columns = np.indices((SIZE, SIZE))
    pixels = np.where((rows - 20) ** 2 + (columns - 20) ** 2 < 60, 65000, 0.1).astype(np.float16)
    mask = frames.shuffle(SIZE, SIZE, 0.3)
    source = frames.write_sparse(tmp_path / "in.exr", np.repeat(pixels[..., None], 3, axis=-1), mask)
    fill(source, "--limit", "off", "--domain", "linear")
