"""Files as renderers write them go through `fill` without flags; names, layers from other files, and weights from counts."""

import json
import re
import shutil

import numpy as np
import OpenEXR
import pytest

import frames
from tool import ROOT, lacuna, quick_fill

HEIGHT, WIDTH = 48, 64
ROWS, COLUMNS = np.indices((HEIGHT, WIDTH))
MASK = frames.shuffle(HEIGHT, WIDTH, 0.3)


def plane(seed=0.0):
    """Something smooth."""
    return (0.5 + 0.4 * np.sin(COLUMNS / 9 + seed) * np.cos(ROWS / 7 - seed)).astype(np.float32)


def sparse(values):
    return np.where(MASK, values, values.dtype.type(0))


def normals(names):
    x, y = 0.5 * np.sin(COLUMNS / 9), 0.5 * np.cos(ROWS / 7)
    return {name: values.astype(np.float32) for name, values in zip(names, (x, y, np.sqrt(1 - x * x - y * y)))}


def rules(path):
    parts = json.loads(lacuna("info", "--json", path).stdout)["parts"]
    return {channel["name"]: channel["rule"] for part in parts for channel in part["channels"]}


def named_in_the_page():
    """The rows of docs/renderers.md that name channels: renderer, and the rule that each name has."""
    table = (ROOT / "docs" / "renderers.md").read_text().split("## Channel names")[1].split("\n\n")[2]
    heads = ["fill", "normal", "depth", "nearest", "keep"]
    for line in table.splitlines()[2:]:
        renderer, *cells = (cell.strip() for cell in line.strip().strip("|").split("|"))
        found = {}
        for rule, cell in zip(heads, cells, strict=True):
            found |= dict.fromkeys(re.findall(r"`([^`]+)`", cell), rule)
        yield renderer, found


@pytest.mark.parametrize("renderer, expected", named_in_the_page(), ids=lambda value: value if isinstance(value, str) else "")
def test_names_have_the_rules_of_the_page(renderer, expected, tmp_path):
    assert len(expected) >= 5, renderer
    values = {name: sparse(plane(at)) for at, name in enumerate(expected)}
    path = frames.write(tmp_path / "names.exr", values | {"mask": MASK.astype(np.float16)})
    found = rules(path)
    assert {name: found[name] for name in expected} == expected
    quick_fill(path, "-o", tmp_path / "full.exr")


def test_mitsuba_doubles_its_colour(tmp_path):
    colour = {name: sparse(plane(at)) for at, name in enumerate("RGBA")}
    depth = {"depth.T": sparse(2 + plane(9)), **{name: sparse(values) for name, values in normals(["N.X", "N.Y", "N.Z"]).items()}}
    doubled = {f"img.{name}": values for name, values in colour.items()}
    path = frames.write(tmp_path / "m.exr", colour | doubled | depth, compression=OpenEXR.PIZ_COMPRESSION)
    frames.write(tmp_path / "mask.exr", {"mask": MASK.astype(np.float16)})
    quick_fill(path, "-o", tmp_path / "full.exr", "--mask", f"file:{tmp_path / 'mask.exr'}")
    full = frames.read(tmp_path / "full.exr")[0]
    for name in "RGBA":
        assert frames.same_bits(full[name], full[f"img.{name}"])
    assert frames.psnr(full["R"], plane(0)) > 40
    assert np.isin(full["depth.T"], depth["depth.T"][MASK]).all()


def test_blender_writes_a_part_a_pass(tmp_path):
    identifiers = np.where(COLUMNS < 30, np.float32(3.7e-20), np.float32(-8.1e12))
    passes = {
        "ViewLayer.Combined": {f"ViewLayer.Combined.{name}": plane(at) for at, name in enumerate("RGB")},
        "ViewLayer.Depth": {"ViewLayer.Depth.Z": np.where(COLUMNS < 30, np.float32(4), np.float32(1e10))},
        "ViewLayer.CryptoObject00": {f"ViewLayer.CryptoObject00.{name}": identifiers for name in "rgba"},
        "ViewLayer.Diffuse Direct": {f"ViewLayer.Diffuse Direct.{name}": plane(at + 4) for at, name in enumerate("RGB")},
    }
    parts = [frames.part({key: sparse(values) for key, values in planes.items()}, name=name) for name, planes in passes.items()]
    parts.append(frames.part({"mask": MASK.astype(np.float16)}, name="mask"))
    path = frames.write(tmp_path / "b.exr", parts)
    quick_fill(path, "-o", tmp_path / "full.exr")
    lacuna("verify", path, tmp_path / "full.exr")
    full = frames.read(tmp_path / "full.exr")
    assert len(full) == 5
    assert frames.psnr(full[0]["ViewLayer.Combined.G"], plane(1)) > 40
    assert set(np.unique(full[1]["ViewLayer.Depth.Z"])) == {np.float32(4), np.float32(1e10)}
    assert set(np.unique(full[2]["ViewLayer.CryptoObject00.r"])) == set(np.unique(identifiers))


def luxcore_files(folder, number):
    """One file an output, channels R, G and B whatever they hold."""
    def write(name, values):
        frames.write(folder / f"{name}.{number:04}.exr", {channel: sparse(v) for channel, v in zip("RGB", values)})

    write("RGB", [plane(number + at) for at in range(3)])
    write("DEPTH", [np.where(COLUMNS < 20, np.float32(np.inf), 3 + plane(2))] * 3)
    write("NORMAL", list(normals("xyz").values()))
    write("SAMPLECOUNT", [np.float32(16) + 0 * plane()] * 3)
    frames.write(folder / f"mask.{number:04}.exr", {"mask": MASK.astype(np.float16)})


def layered(folder, *words, ok=True):
    layers = [f"{name}={folder / file}.####.exr" for name, file in (("depth", "DEPTH"), ("N", "NORMAL"), ("n", "SAMPLECOUNT"))]
    flags = [word for layer in layers for word in ("--layers", layer)]
    out = ("-o", folder / "full.####.exr", "--mask", f"file:{folder / 'mask.####.exr'}")
    return quick_fill(folder / "RGB.####.exr", *out, *flags, "--channels", "n.*=keep", *words, ok=ok)


def test_files_of_luxcore_come_together(tmp_path):
    for number in (1, 2):
        luxcore_files(tmp_path, number)
    layered(tmp_path)
    for number in (1, 2):
        full = frames.read(tmp_path / f"full.{number:04}.exr")[0]
        assert set(full) == {*"RGB", *(f"{layer}.{name}" for layer in ("depth", "N", "n") for name in "RGB")}
        assert frames.psnr(full["G"], plane(number + 1)) > 40
        assert np.isinf(full["depth.R"][:, :15]).all() and np.isfinite(full["depth.R"][:, 25:]).all()
        length = sum(full[f"N.{name}"].astype(float) ** 2 for name in "RGB")
        assert np.abs(length - 1).max() < 1e-5
        assert not full["n.R"][~MASK].any()
    assert "2 skipped" in layered(tmp_path, "-u").stderr
    luxcore_files(tmp_path, 2)
    assert "2 skipped" in layered(tmp_path, "-u").stderr
    shutil.copy2(tmp_path / "SAMPLECOUNT.0002.exr", tmp_path / "NORMAL.0002.exr")
    assert "1 skipped" in layered(tmp_path, "-u").stderr
    (tmp_path / "DEPTH.0001.exr").unlink()
    failed = layered(tmp_path, "-q", ok=False)
    assert failed.status == 1 and len(failed.lines()) == 1 and "DEPTH.0001.exr" in failed.lines()[0], failed
    frames.write(tmp_path / "DEPTH.0001.exr", {"R": plane()[:5]})
    assert "data window" in layered(tmp_path, "-q", ok=False).stderr


def rough(seed=2):
    """A smooth picture whose pixels had 1 to 64 samples each, and the counts."""
    rng = np.random.default_rng(seed)
    height, width = 96, 120
    rows, columns = np.indices((height, width))
    truth = (0.5 + 0.4 * np.sin(columns / 12) * np.cos(rows / 10)).astype(np.float32)
    counts = rng.choice([1, 4, 64], (height, width)).astype(np.uint32)
    noisy = truth + 0.2 * rng.standard_normal(truth.shape) / np.sqrt(counts)
    return truth, noisy.astype(np.float32), counts, rng.random(truth.shape) < 0.5


@pytest.mark.parametrize("words, settings", [
    (("--filter", "ss", "--ss-lambda"), ["1", "10", "100"]),
    (("--filter", "tv", "--tv-epsilon"), ["1.5", "3", "6", "10"]),
], ids=["ss", "tv"])
def test_pixels_weigh_by_their_samples(words, settings, tmp_path):
    """The best setting with weights is nearer to the truth than the best one without."""
    truth, noisy, counts, mask = rough()
    planes = {name: np.where(mask, noisy, np.float32(0)) for name in "RGB"}
    path = frames.write(tmp_path / "in.exr", planes | {"mask": mask.astype(np.float16), "SAMPLECOUNT": counts})
    weights, best = ("--weights", "count:SAMPLECOUNT"), {}
    for name, more in (("plain", ()), ("weighted", weights)):
        errors = []
        for setting in settings:
            quick_fill(path, "-o", tmp_path / f"{name}.exr", *words, setting, *more)
            full = frames.read(tmp_path / f"{name}.exr")[0]
            assert frames.same_bits(full["SAMPLECOUNT"], counts)
            errors.append(np.sqrt(np.mean((full["R"] - truth) ** 2, dtype=np.float64)))
        best[name] = min(errors)
    assert best["weighted"] < 0.75 * best["plain"], best
    lacuna("verify", path, tmp_path / "weighted.exr")
    same = quick_fill(path, "-o", tmp_path / "weighted.exr", "-u", *words, settings[-1], *weights)
    assert "1 skipped" in same.stderr, same
    other = quick_fill(path, "-o", tmp_path / "weighted.exr", "-u", *words, settings[-1])
    assert "skipped" not in other.stderr, other


def test_weights_that_are_of_no_use_are_refused(tmp_path):
    truth, _, counts, mask = rough()
    path = frames.write(tmp_path / "in.exr", {"R": truth, "mask": mask.astype(np.float16), "n": counts * 0})
    out = ("fill", path, "-o", tmp_path / "out.exr")
    for words, status, what in (
        (["--weights", "count:n"], 2, "only where measured pixels are smoothed"),
        (["--weights", "n", "--ss-lambda", "1"], 2, "count:CHANNEL"),
        (["--weights", "count:n", "--filter", "tv", "--tv-epsilon", "1", "--tv-solver", "nesta"], 2, "nesta"),
        (["--weights", "count:m", "--ss-lambda", "1"], 1, "no such channel"),
        (["--weights", "count:n", "--ss-lambda", "1"], 1, "no sample"),
    ):
        result = lacuna(*out, *words, "-q", ok=False)
        assert result.status == status and what in result.stderr, result


def test_a_layer_keeps_what_its_file_says(tmp_path):
    """Lossy zeros, complete channels, fills before and other masks."""
    colours = {channel: sparse(plane(at)) for at, channel in enumerate("RGB")}
    base = frames.write(tmp_path / "base.exr", colours | {"mask": MASK.astype(np.float16)})
    position = {channel: 2 + plane(at).astype(np.float16) for at, channel in enumerate("RGB")}
    lossy = frames.write(tmp_path / "lossy.exr", {c: sparse(v) for c, v in position.items()}, compression=OpenEXR.DWAA_COMPRESSION)
    quick_fill(base, "-o", tmp_path / "full.exr", "--layers", f"P={lossy}")
    full = frames.read(tmp_path / "full.exr")[0]
    assert np.abs(full["P.R"].astype(np.float32) - position["R"])[~MASK].max() < 0.5
    half = np.where(COLUMNS < 20, 0, plane()).astype(np.float32)
    dense = frames.write(tmp_path / "dense.exr", {"R": half}, **{"lacuna/dense": "R"})
    quick_fill(base, "-o", tmp_path / "full.exr", "--force", "--layers", f"extra={dense}")
    assert (frames.read(tmp_path / "full.exr")[0]["extra.R"] == half).all()
    quick_fill(base, "-o", tmp_path / "filled.exr")
    other = frames.write(tmp_path / "other.exr", colours | {"mask": (~MASK).astype(np.float16)})
    for path, why in ((tmp_path / "filled.exr", "filled by"), (other, "mask")):
        ran = quick_fill(base, "-o", tmp_path / "no.exr", "--layers", f"Q={path}", ok=False)
        assert why in ran.stderr and path.name in ran.stderr
