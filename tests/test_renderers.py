"""The bridges to renderers that others wrote: masked pixels are right, others are not traced, AOVs arrive, `fill` finishes.

The commands of docs/renderers.md are run as they stand there.
"""

import json
import os
import pathlib
import re
import sys
import zlib

import numpy as np
import pytest

import frames
from tool import LACUNA, ROOT, SAMPLES, lacuna, quick_fill, run

BRIDGES = ROOT / "scripts" / "renderers"
SCENES = SAMPLES / "renderers"
PAGE = ROOT / "docs" / "renderers.md"
SMALL = ["-D", "width=120", "-D", "height=90"]


def bridge(name, *words, ok=True):
    result = run([sys.executable, BRIDGES / name, *words], timeout=300, environment={"LACUNA": LACUNA})
    if ok:
        assert result.status == 0, result
    return result


pytestmark = pytest.mark.usefixtures("renderer_scenes")


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """The LuxCore scene in a small size."""
    folder = tmp_path_factory.mktemp("still")
    text = (SCENES / "still.cfg").read_text()
    text = re.sub(r"film\.width = \d+", "film.width = 96", re.sub(r"film\.height = \d+", "film.height = 72", text))
    (folder / "still.cfg").write_text(text)
    (folder / "still.scn").write_text((SCENES / "still.scn").read_text().replace("../../out", str(ROOT / "out")))
    return folder / "still.cfg"


def noise(one, other, where):
    """Mean squared difference of two renders at some pixels, clipped to [0, 1] so that no highlight decides."""
    return np.mean((np.clip(one, 0, 1) - np.clip(other, 0, 1))[where] ** 2, dtype=np.float64)


def check_agreement(first, second, sparse, mask):
    """Masked pixels differ from a full render as two full renders of other seeds do.

    The mean of some thousand squared differences is known to a few per cent, heavy tails included to some ten."""
    usual = noise(first, second, mask)
    here = noise(first, sparse, mask)
    assert 0.7 < here / usual < 1.4, (here, usual)
    bias = np.mean((np.clip(first, 0, 1) - np.clip(sparse, 0, 1))[mask], dtype=np.float64)
    assert abs(bias) < 4 * np.sqrt(usual / mask.sum()), (bias, usual)


def check_place(full, sparse, mask):
    """Masked pixels are not those beside them."""
    here = noise(full, sparse, mask)
    for shift in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        beside = noise(np.roll(full, shift, (0, 1)), sparse, mask)
        assert beside > 1.5 * here, (shift, beside, here)


def test_masked_pixels_of_mitsuba_are_those_of_a_full_render(tmp_path):
    scene = SCENES / "watch.xml"
    for seed in ("1", "2"):
        words = ("-o", tmp_path / f"full.{seed}.exr", "--density", "1", "--spp", "16", "--seed", seed, *SMALL)
        bridge("mitsuba_sparse.py", scene, *words)
    words = ("-o", tmp_path / "sparse.exr", "--density", "0.4", "--spp", "16", "--seed", "3", *SMALL)
    bridge("mitsuba_sparse.py", scene, *words)
    sparse = frames.read(tmp_path / "sparse.exr")[0]
    mask = sparse["mask"] > 0
    assert abs(mask.mean() - 0.4) < 0.01
    colour = frames.colour(tmp_path / "sparse.exr")
    assert not colour[~mask].any() and colour[mask].any(-1).mean() > 0.99
    full = [frames.colour(tmp_path / f"full.{seed}.exr") for seed in (1, 2)]
    check_agreement(*full, colour, mask)
    check_place(full[0], colour, mask)


def test_mitsuba_traces_no_other_pixel():
    """Counted where the wrapped sensor is asked for its rays."""
    result = run([sys.executable, ROOT / "tests" / "mitsuba_count.py", SCENES / "watch.xml"], timeout=600)
    assert result.status == 0, result
    counted = json.loads(result.stdout)
    assert counted["outside"] == 0 and counted["least"] == counted["spp"], counted
    # The rectangle of the list's film is a row longer than the list at most.
    most = counted["masked"] + int(np.ceil(np.sqrt(counted["masked"])))
    assert counted["masked"] * counted["spp"] <= counted["total"] <= most * counted["spp"], counted


def channels(path):
    """Rule of each channel and its reason, as `lacuna info` has them."""
    parts = json.loads(lacuna("info", "--json", path).stdout)["parts"]
    return {channel["name"]: (channel["rule"], channel["why"]) for part in parts for channel in part["channels"]}


def test_aovs_of_mitsuba_arrive_and_guide(tmp_path):
    lacuna("mask", "-o", tmp_path / "mask.exr", "--size", "120x90", "--density", "0.3", "-q")
    for flag, name in (([], "thin"), (["--dense-aovs"], "dense")):
        words = ("--mask", tmp_path / "mask.exr", "--spp", "8", "--aovs", "albedo,depth,N,id", *flag, *SMALL)
        bridge("mitsuba_sparse.py", SCENES / "watch.xml", "-o", tmp_path / f"{name}.exr", *words)
    thin, dense = (channels(tmp_path / f"{name}.exr") for name in ("thin", "dense"))
    names = {"R", "G", "B", "mask", "depth.Z", "id", *(f"N.{c}" for c in "XYZ"), *(f"albedo.{c}" for c in "RGB")}
    assert set(thin) == set(dense) == names
    assert thin["N.X"][0] == "normal" and thin["depth.Z"][0] == "depth" and thin["id"][0] == "nearest"
    assert thin["R"][0] == thin["albedo.G"][0] == dense["R"][0] == "fill"
    for name in ("N.X", "depth.Z", "id", "albedo.G"):
        assert dense[name] == ("keep", "listed in lacuna/dense"), dense[name]
    planes = frames.read(tmp_path / "dense.exr")[0]
    mask = planes["mask"] > 0
    assert (planes["depth.Z"] > 0).all() and np.array_equal(planes["id"], np.round(planes["id"]))
    assert not frames.read(tmp_path / "thin.exr")[0]["depth.Z"][~mask].any()
    for name in ("thin", "dense"):
        quick_fill(tmp_path / f"{name}.exr", "-o", tmp_path / f"{name}.full.exr")
        lacuna("verify", tmp_path / f"{name}.exr", tmp_path / f"{name}.full.exr")


CAMERAS = {
    "pinhole": ("perspective", ""),
    "shifted": ("perspective", '<float name="principal_point_offset_x" value="0.0$frame"/><float name="principal_point_offset_y" value="-0.0$frame"/>'),
    "lens": ("thinlens", '<float name="aperture_radius" value="0.001"/><float name="focus_distance" value="4"/>'),
}


@pytest.mark.parametrize("camera", CAMERAS)
def test_vectors_of_mitsuba_lead_to_the_next_frame(camera, tmp_path):
    """To where the same place on the same shape is seen, by the shapes' own coordinates: to a part of a pixel, balls, block and floor."""
    kind, more = CAMERAS[camera]
    fov = '<float name="fov" value="40"/>'
    text = (SCENES / "moving.xml").read_text().replace('sensor type="perspective"', f'sensor type="{kind}"').replace(fov, fov + more)
    (tmp_path / "moving.xml").write_text(text)
    words = ("--frames", "4-5", "--density", "1", "--spp", "1", "--aovs", "uv,id", "--dense-aovs", "--dense-spp", "64", "--motion", *SMALL)
    bridge("mitsuba_sparse.py", tmp_path / "moving.xml", "-o", tmp_path / "shot.####.exr", *words)
    assert channels(tmp_path / "shot.0004.exr")["motion.X"] == ("keep", "listed in lacuna/dense")
    one, two = (frames.read(tmp_path / f"shot.{frame:04}.exr")[0] for frame in (4, 5))
    rows, columns = np.indices(one["id"].shape)
    y, x = rows + one["motion.Y"], columns + one["motion.X"]
    top, left = np.floor(y).astype(int), np.floor(x).astype(int)
    inside = (top >= 0) & (left >= 0) & (top < rows.shape[0] - 1) & (left < rows.shape[1] - 1)
    corners = [(np.where(inside, top + i, 0), np.where(inside, left + j, 0), abs(y - top - 1 + i) * abs(x - left - 1 + j)) for i in (0, 1) for j in (0, 1)]
    across, compared = [np.gradient(one[f"uv.{c}"]) for c in "UV"], 0
    for shape in np.unique(one["id"][one["id"] > 0]):
        own = inside & (one["id"] == shape)
        where = own & np.all([two["id"][v, u] == shape for v, u, _ in corners], axis=0)
        if where.sum() < 50:
            continue
        off = np.hypot(*(sum(weight * two[f"uv.{c}"][v, u] for v, u, weight in corners) - one[f"uv.{c}"] for c in "UV"))
        # What a pixel is wide in these coordinates.
        pixel = np.sqrt(abs(across[0][0] * across[1][1] - across[0][1] * across[1][0])) + 1e-9
        still = np.hypot(*(two[f"uv.{c}"] - one[f"uv.{c}"] for c in "UV"))
        moved, stayed = (np.median((values / pixel)[where]) for values in (off, still))
        assert moved < 0.15 and stayed > 0.5, (shape, moved, stayed)
        compared += 1
    assert compared >= 3


def test_vectors_of_the_last_file_go_on_as_from_the_one_before(tmp_path):
    text = (SCENES / "moving.xml").read_text()
    for frame in (4, 5, 9):
        (tmp_path / f"s.{frame:04}.xml").write_text(text.replace("$frame", str(frame)))
    words = ("--density", "1", "--spp", "1", "--motion", *SMALL)
    result = bridge("mitsuba_sparse.py", tmp_path / "s.####.xml", "-o", tmp_path / "shot.####.exr", "--frames", "4,5,9", *words)
    assert "s.0005.xml: motion as from the frame before" in result.stdout and "s.0009.xml: no motion" in result.stdout
    one, two, alone = (frames.read(tmp_path / f"shot.{frame:04}.exr")[0] for frame in (4, 5, 9))
    for name in ("motion.X", "motion.Y"):
        assert np.abs(one[name]).max() > 0.5 and np.median(np.abs(one[name] - two[name])) < 0.1 * np.median(np.abs(one[name]))
        assert name not in alone


SHAPES = """<scene version="3.0.0">
    <integrator type="path"/>
    <sensor type="perspective">
        <transform name="to_world"><lookat origin="0, 0, 12" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="48"/></film>
    </sensor>
    <emitter type="constant"/>
    <bsdf type="diffuse" id="grey"/>
    <shape type="shapegroup" id="group"><shape type="sphere" id="grouped"/></shape>
    SHAPES
</scene>"""


def shape(kind, x, y, inside="", name=""):
    own = f'id="{name}"' if name else ""
    return f'<shape type="{kind}" {own}>{inside}<transform name="to_world"><translate x="{x}" y="{y}"/></transform></shape>'


def test_numbers_of_shapes_are_those_of_their_ids(tmp_path):
    """In every frame, whatever else is in it and in which order; meshes of one material stay apart."""
    grey = '<ref id="grey"/>'
    first = [shape("cube", -2, -2, grey, "left"), shape("cube", 2, -2, grey, "right"), shape("sphere", -2, 2), shape("instance", 2, 2, '<ref id="group"/>')]
    (tmp_path / "s.0001.xml").write_text(SHAPES.replace("SHAPES", "".join(first)))
    (tmp_path / "s.0002.xml").write_text(SHAPES.replace("SHAPES", "".join([shape("disk", 9, 9, name="new"), *reversed(first)])))
    words = ("--frames", "1-2", "--density", "0.5", "--spp", "1", "--aovs", "id,shapes:shape_index", "--dense-aovs", "--half")
    bridge("mitsuba_sparse.py", tmp_path / "s.####.xml", "-o", tmp_path / "f.####.exr", *words)
    one, two = (frames.read(tmp_path / f"f.{frame:04}.exr")[0] for frame in (1, 2))
    names = ("left", "right", "Sphere 1", "grouped")
    assert set(one["id"].ravel().tolist()) == {0, *(zlib.crc32(name.encode()) % (2**24 - 1) + 1 for name in names)}
    # One sample a pixel: at rims it may hit either.
    assert (one["id"] == two["id"]).mean() > 0.9 and np.array_equal(one["id"], one["shapes.I"]) and one["id"].dtype == np.uint32
    assert channels(tmp_path / "f.0001.exr")["id"][0] == "keep"


def test_a_volume_is_sampled_where_the_mask_says(tmp_path):
    words = ("--density", "0.25", "--spp", "4", "--half", "-D", "width=80", "-D", "height=60")
    bridge("mitsuba_sparse.py", SCENES / "cloud.xml", "-o", tmp_path / "cloud.exr", *words)
    planes = frames.read(tmp_path / "cloud.exr")[0]
    mask = planes["mask"] > 0
    assert planes["R"].dtype == np.float16 and set(planes) == {"R", "G", "B", "A", "mask"}
    assert (planes["B"][mask] > 0).all() and not planes["B"][~mask].any()


def test_luxcore_keeps_to_the_mask(still, tmp_path):
    names = ("one", "two", "thin")
    for seed, (name, density) in enumerate(zip(names, ("1", "1", "0.25"))):
        words = ("--density", density, "--spp", "16", "--seed", seed, "--aovs", "albedo,N,depth,objectId")
        result = bridge("luxcore_sparse.py", still, "-o", tmp_path / f"{name}.exr", *words)
        assert result.stdout.startswith(str(tmp_path)), result
    planes = frames.read(tmp_path / "thin.exr")[0]
    mask, count = planes["mask"] > 0, planes["SAMPLECOUNT"]
    assert 0.23 < mask.mean() < 0.27
    # Counted: LuxCore leaves a pixel outside 5 % of the samples of one inside, and the measured ones got what was asked for.
    assert count[~mask].mean() < 0.07 * count[mask].mean(), (count[~mask].mean(), count[mask].mean())
    # It takes a tenth of a second: on a busy machine the bridge stops it a little late.
    assert 16 <= count[mask].mean() < 1.5 * 16, count[mask].mean()
    full = [frames.colour(tmp_path / f"{name}.exr") for name in names]
    check_agreement(*full, mask)
    # The colour's noise at so few samples hides a shift; the albedo's does not.
    albedo = [frames.colour(tmp_path / f"{name}.exr", [f"albedo.{c}" for c in "RGB"]) for name in ("one", "thin")]
    check_place(*albedo, mask)
    rules = {name: rule for name, (rule, _) in channels(tmp_path / "thin.exr").items()}
    assert rules == {
        "R": "fill", "G": "fill", "B": "fill", "albedo.R": "fill", "albedo.G": "fill", "albedo.B": "fill", "N.X": "normal",
        "N.Y": "normal", "N.Z": "normal", "depth.Z": "depth", "objectId": "nearest", "SAMPLECOUNT": "keep", "mask": "keep",
    }
    plain = ("fill", tmp_path / "thin.exr", "-o", tmp_path / "thin.full.exr")
    lacuna(*plain)
    lacuna("verify", tmp_path / "thin.exr", tmp_path / "thin.full.exr")
    weights = ("--ss-lambda", "0.05", "--weights", "count:SAMPLECOUNT")
    quick_fill(tmp_path / "thin.exr", "-o", tmp_path / "smooth.exr", *weights)


@pytest.mark.parametrize("density, spp", [("0.045", 16), ("0.1", 4), ("1", 3)])
def test_pixels_of_luxcore_get_the_samples_asked_for(density, spp, tmp_path):
    """In the mean, also where that is no whole number over all of the frame."""
    bridge("luxcore_sparse.py", SCENES / "still.cfg", "-o", tmp_path / "f.exr", "--density", density, "--spp", spp)
    planes = frames.read(tmp_path / "f.exr")[0]
    mask = planes["mask"] > 0
    assert abs(mask.mean() - float(density)) < 0.01
    assert spp <= planes["SAMPLECOUNT"][mask].mean() < 1.5 * spp


@pytest.mark.parametrize("name", ["mitsuba_sparse.py", "luxcore_sparse.py"])
def test_mistakes_are_told_in_one_line(name, tmp_path):
    out = ("-o", tmp_path / "out.exr", "--density", "0.5")
    for status, words in ((1, ["no.file", *out]), (2, [SCENES / "watch.xml", "-o", tmp_path / "out.exr", "--density", "2"])):
        result = bridge(name, *words, ok=False)
        assert result.status == status and len(result.lines()) == 1 and name in result.lines()[0], result
    assert "--dense-aovs" in bridge("mitsuba_sparse.py", "--help").stdout
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif("LACUNA_BPY" not in os.environ, reason="LACUNA_BPY names no Python with Blender's package bpy")
def test_masked_pixels_of_blender_are_those_of_a_full_render(tmp_path):
    def python(*words):
        result = run([os.environ["LACUNA_BPY"], *words], timeout=600, environment={"LACUNA": LACUNA})
        assert result.status == 0, result

    python(SCENES / "make_blend.py")
    for density in ("1", "0.25"):
        words = ("-o", tmp_path / f"{density}.exr", "--density", density, "--spp", "4")
        python(BRIDGES / "blender_sparse.py", ROOT / "out" / "renderers" / "monkey.blend", *words)
    full, sparse = ({k: v for part in frames.read(tmp_path / f"{density}.exr") for k, v in part.items()} for density in ("1", "0.25"))
    mask = sparse["mask"] > 0
    assert set(full) == set(sparse) and 0.24 < mask.mean() < 0.26
    for name in ("ViewLayer.Combined.R", "ViewLayer.Normal.X", "ViewLayer.CryptoObject00.r", "ViewLayer.Object Index.X"):
        same = np.isclose(full[name], sparse[name], rtol=1e-3, atol=1e-4)
        # A sample on the rim of a pixel may fall to either side.
        assert same[mask].mean() > 0.995, name
        assert (sparse[name][~mask] == 0).mean() > 0.995, name
    quick_fill(tmp_path / "0.25.exr", "-o", tmp_path / "filled.exr")
    lacuna("verify", tmp_path / "0.25.exr", tmp_path / "filled.exr")


def commands():
    """The blocks of docs/renderers.md that a new user is to type, one text a walk-through."""
    found = re.findall(r"<!-- tested: (\w+) -->\n(.*?)<!-- end of test -->", PAGE.read_text(), re.S)
    return {name: "\n".join(re.findall(r"```sh\n(.*?)```", text, re.S)) for name, text in found}


@pytest.mark.parametrize("name", ["mitsuba", "luxcore", "recipes"])
def test_the_commands_of_the_page_work(name, tmp_path):
    for folder in ("scripts", "samples", ".venv", "tests"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "lacuna").symlink_to(pathlib.Path(LACUNA).resolve())
    path = {"PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}"}
    result = run(["bash", "-euo", "pipefail", "-c", commands()[name]], timeout=300, environment=path, folder=tmp_path)
    assert result.status == 0, result
    filled = list((tmp_path / "out").rglob("filled*/*.exr"))
    assert len(filled) >= 2, result
    for frame in filled:
        assert np.isfinite(frames.colour(frame)).all()
