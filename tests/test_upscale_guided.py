"""lacuna upscale with guides of the larger size, what is taken from their file, and motion vectors."""

import numpy as np
import OpenEXR
import pytest

import frames
from tool import lacuna

SIDE = 160


def means(image, factor):
    height, width = image.shape
    return image.reshape(height // factor, factor, width // factor, factor).mean((1, 3)).astype(np.float32)


def large():
    """Two surfaces with a slanted edge and a disc, and what a renderer knows of them."""
    y, x = (np.mgrid[0:SIDE, 0:SIDE] + 0.5) / SIDE
    inside = (x + 0.37 * y > 0.73) | (np.hypot(x - 0.25, y - 0.65) < 0.12)
    depth = np.where(inside, 5 + y, 9 - x)
    light = np.where(inside, 0.8 - 0.3 * y, 0.1 + 0.2 * x)
    colour = {"R": light, "G": 0.5 * light, "B": light**2}
    known = {"Z": depth, "A": np.ones_like(x), "N.X": 0.6 * inside, "N.Y": np.zeros_like(x), "N.Z": np.where(inside, 0.8, 1)}
    return colour, {name: plane.astype(np.float32) for name, plane in known.items()}


@pytest.fixture
def given(tmp_path):
    colour, known = large()
    small = {name: means(plane, 2) for name, plane in (colour | known).items()}
    frames.write(tmp_path / "small.exr", small)
    frames.write(tmp_path / "aovs.exr", known)
    return tmp_path


def upscale(folder, *words, source="small.exr", **options):
    return lacuna("upscale", folder / source, "-o", folder / "out.exr", "--scale", "2", *words, **options)


def error(folder):
    got, (colour, _) = frames.read(folder / "out.exr")[0], large()
    return np.sqrt(np.mean([(got[name] - colour[name]) ** 2 for name in "RGB"]))


def test_guides_sharpen_edges_and_means_stay(given):
    upscale(given)
    without = error(given)
    told = upscale(given, "--guides-from", given / "aovs.exr").stderr
    assert "guided by" in told and error(given) < 0.5 * without
    small, got = frames.read(given / "small.exr")[0], frames.read(given / "out.exr")[0]
    for name in "RGB":
        assert np.abs(means(got[name].astype(np.float64), 2) - small[name]).max() < 2e-6
    assert "Z" in OpenEXR.File(str(given / "out.exr")).header()["lacuna/guides"]


@pytest.mark.parametrize("wrong", ["constant", "noise", "foreign"])
def test_wrong_guides_cost_at_most_a_tenth_of_a_decibel(given, wrong):
    upscale(given)
    without, known = error(given), large()[1]
    noise = np.random.default_rng(3)
    change = {"constant": lambda plane: np.full_like(plane, 2), "noise": lambda plane: noise.random(plane.shape, np.float32),
              "foreign": lambda plane: np.ascontiguousarray(plane[::-1, ::-1].T)}[wrong]
    frames.write(given / "wrong.exr", {name: change(plane) for name, plane in known.items()})
    before = frames.read(given / "out.exr")[0]
    upscale(given, "--guides-from", given / "wrong.exr")
    assert error(given) < 1.0116 * without
    if wrong == "constant":
        after = frames.read(given / "out.exr")[0]
        assert all(frames.same_bits(before[name], plane) for name, plane in after.items())


def test_sparse_small_frames_are_guided_too(given):
    small = frames.read(given / "small.exr")[0]
    mask = np.random.default_rng(5).random(small["R"].shape) < 0.5
    frames.write_sparse(given / "sparse.exr", np.stack([small[name] for name in "RGB"], -1), mask)
    upscale(given, source="sparse.exr")
    without = error(given)
    upscale(given, "--guides-from", given / "aovs.exr", source="sparse.exr")
    assert error(given) < 0.8 * without


def test_what_is_no_light_is_taken_as_it_is(given):
    told = upscale(given, "--guides-from", given / "aovs.exr", "--take-guides").stderr
    got, known = frames.read(given / "out.exr")[0], large()[1]
    assert "taken from the guides' file" in told and "warning" not in told
    assert all(frames.same_bits(got[name], plane) for name, plane in known.items())


def test_no_mask_is_taken_whatever_its_name(given):
    small, known = frames.read(given / "small.exr")[0], large()[1]
    mask = (np.random.default_rng(5).random(small["R"].shape) < 0.5).astype(np.float16)
    frames.write(given / "sparse.exr", {name: np.where(mask > 0, plane, plane.dtype.type(0)) for name, plane in small.items()} | {"Mask": mask})
    frames.write(given / "aovs.exr", known | {"Mask": np.ones_like(known["Z"])})
    told = upscale(given, "--guides-from", given / "aovs.exr", "--take-guides", source="sparse.exr").stderr
    assert "Mask" not in told.split("taken from the guides' file", 1)[1].splitlines()[0]


def test_what_is_sparse_is_not_taken(given):
    mask = np.random.default_rng(5).random(large()[1]["Z"].shape) < 0.5
    known = large()[1] | {"Z": np.where(mask, large()[1]["Z"], np.float32(0)), "mask": mask.astype(np.float32)}
    frames.write(given / "aovs.exr", known)
    told = upscale(given, "--guides-from", given / "aovs.exr", "--take-guides").stderr
    got = frames.read(given / "out.exr")[0]
    assert "Z: sparse in the guides' file, and no guide" in told and "--take-guides: Z: sparse" in told
    alone = upscale(given, "--guides-from", given / "aovs.exr", "--take-guides", "--guides", "none", "--channels", "N.*,A=fill").stderr
    assert "no channel of this frame" not in alone
    assert got["Z"].min() > 0
    assert all(frames.same_bits(got[name], plane) for name, plane in known.items() if name not in ("Z", "mask"))


def flat(side, value):
    return np.full((side, side), value, np.float32)


def parts(path, planes):
    # Parts of a file share a display window.
    side = max(len(plane) for channels in planes.values() for plane in channels.values())
    display = ((0, 0), (side - 1, side - 1))
    OpenEXR.File([frames.part(planes[name], display=display, name=name) for name in planes]).write(str(path))


def test_a_channel_is_taken_from_the_part_of_its_name(tmp_path):
    light = {name: large()[0][name].astype(np.float32) for name in "RGB"}
    parts(tmp_path / "small.exr", {name: light | {"Z": flat(SIDE, z)} for name, z in (("a", 1), ("b", 2), ("c", 3))})
    taken = lambda: [part.channels["Z"].pixels[0, 0] for part in OpenEXR.File(str(tmp_path / "out.exr"), separate_channels=True).parts]
    words = ["--guides-from", tmp_path / "aovs.exr", "--guides", "none", "--take-guides"]
    parts(tmp_path / "aovs.exr", {name: {"Z": flat(2 * SIDE, z)} for name, z in (("c", 30), ("b", 20), ("a", 10))})
    assert "other parts" not in upscale(tmp_path, *words).stderr and taken() == [10, 20, 30]
    parts(tmp_path / "aovs.exr", {name: {"Z": flat(2 * SIDE, z)} for name, z in (("x", 10), ("y", 20))})
    told = upscale(tmp_path, *words).stderr
    assert taken() == [10, 20, 10] and told.count("other parts of the guides' file have that name") == 3 and "Z of part 1 (y): taken" in told, told
    # A part of other pixels is passed over, and named, as long as another one fits.
    parts(tmp_path / "aovs.exr", {"a": {"Z": flat(SIDE, 10)}, "x": {"Z": flat(2 * SIDE, 20)}})
    told = upscale(tmp_path, *words).stderr
    assert taken() == [20] * 3 and "Z of part 1 (x): taken" in told, told
    parts(tmp_path / "aovs.exr", {"a": {"Z": flat(SIDE, 10)}, "x": {"albedo.R": flat(2 * SIDE, 20)}})
    told = upscale(tmp_path, *words).stderr
    assert taken() == [1, 2, 3] and "Z of part 0 (a): of other pixels" in told and "but light" not in told, told


def test_channels_of_other_pixels_are_not_passed_over(given):
    frames.write(given / "cropped.exr", {"Z": large()[1]["Z"][: SIDE // 2].copy()})
    frames.write(given / "depth.exr", {"Z": frames.read(given / "small.exr")[0]["Z"]})
    words = ["--guides-from", given / "cropped.exr", "--take-guides"]
    for options in ({"source": "depth.exr"}, {"words": ["--guides", "none"]}):
        result = upscale(given, *words, *options.pop("words", []), **options, ok=False)
        assert result.status == 1 and "the pixels of the output" in result.stderr, result
    frames.write(given / "other.exr", {"elsewhere": large()[1]["Z"]})
    told = upscale(given, "--guides-from", given / "other.exr", "--guides", "none", "--take-guides").stderr
    assert "no channel of this frame but light" in told
    # Once for the frame, and not where another part takes something.
    parts(given / "small.exr", {"colour": {"R": flat(SIDE, 1)}, "depth": {"Z": flat(SIDE, 1)}})
    for channel, count in (("Z", 0), ("albedo", 1)):
        parts(given / "aovs.exr", {"depth": {channel: flat(2 * SIDE, 3)}, "more": {"albedo": flat(2 * SIDE, 3)}})
        told = upscale(given, "--guides-from", given / "aovs.exr", "--guides", "none", "--take-guides").stderr
        assert told.count("no channel of this frame but light") == count, told


def test_guides_that_can_steer_nothing_are_told(given):
    frames.write(given / "ids.exr", {"id": (large()[1]["Z"] > 8).astype(np.uint32)})
    told = upscale(given, "--guides-from", given / "ids.exr", "--guides", "id").stderr
    assert told.count("identifiers steer nothing") == 1, told
    frames.write(given / "tiny.exr", {name: plane[:20, :30].copy() for name, plane in frames.read(given / "small.exr")[0].items()})
    frames.write(given / "crop.exr", {name: plane[:40, :60].copy() for name, plane in large()[1].items()})
    told = upscale(given, "--guides-from", given / "crop.exr", source="tiny.exr").stderr
    assert told.count("enlarged without guides") == 1, told


def test_motion_in_pixels_grows_with_the_frame(tmp_path):
    rng = np.random.default_rng(7)
    # Nearest copies, so that only the factors differ.
    planes = {name: rng.normal(size=(20, 30)).astype(np.float32) for name in
              ("Vector.X", "Vector.Y", "Vector.Z", "Vector.W", "velocity.X", "motion.Z", "Motion.red", "Motion.green")}
    frames.write(tmp_path / "small.exr", planes | {"R": np.abs(planes["Vector.X"])})
    out = tmp_path / "out.exr"
    told = lacuna("upscale", tmp_path / "small.exr", "-o", out, "--scale", "2x3", "--channels", "*.*=nearest").stderr
    assert "Vector.W" in told and "times 2.0000 across and 3.0000 down" in told
    factors = {"Vector.X": 2, "Vector.Y": 3, "Vector.Z": 2, "Vector.W": 3, "velocity.X": 1, "motion.Z": 1, "Motion.red": 2, "Motion.green": 3}
    got = frames.read(out)[0]
    for name, factor in factors.items():
        assert np.array_equal(got[name][1::3, ::2], planes[name] * np.float32(factor)), name
    lacuna("upscale", tmp_path / "small.exr", "-o", out, "--scale", "2x3", "--vectors", "keep", "--channels", "*.*=nearest")
    assert np.array_equal(frames.read(out)[0]["Vector.X"][1::3, ::2], planes["Vector.X"])
    others = ("motion_blur.R", "motion_blur.G", "motion_blur.B", "vector_displacement.X", "vector_displacement.Y", "vector_displacement.Z")
    huge = {name: np.full((20, 30), 4e4, np.float16) for name in ("flow.X", "flow.Y")}
    frames.write(tmp_path / "other.exr", {name: planes["Vector.X"] for name in others} | huge)
    told = lacuna("upscale", tmp_path / "other.exr", "-o", out, "--scale", "2x3", "--channels", "*.*=nearest").stderr
    got = frames.read(out)[0]
    assert all(np.array_equal(got[name][1::3, ::2], planes["Vector.X"]) for name in others)
    assert "past the largest" in told and (got["flow.X"] == np.finfo(np.float16).max).all()
    lacuna("upscale", tmp_path / "small.exr", "-o", out, "--scale", "2x3", "--limit", "off")
    got = frames.read(out)[0]
    for name, factor in factors.items():
        means = got[name].reshape(20, 3, 30, 2).mean((1, 3))
        assert np.abs(means - factor * planes[name]).max() < 1e-5 * factor * np.abs(planes[name]).max(), name


@pytest.mark.parametrize("words, status, reason", [
    (["--guides", "Z"], 2, "name it with --guides-from"),
    (["--take-guides"], 2, "--guides-from"),
    (["--filter", "tv", "--guides-from", "aovs.exr"], 2, "only --filter ss"),
    (["--guides-from", "small.exr"], 1, "the pixels of the output"),
    (["--guides-from", "sparse.exr"], 1, "render the guides for every pixel"),
    (["--guides-from", "nan.exr"], 1, "render the guides for every pixel"),
    (["--guides-from", "half.exr"], 1, "render the guides for every pixel"),
    (["--guides-from", "aovs.exr", "--guides", "albedo.*"], 1, "no channel of that name"),
    (["--guides-from", "nothing.exr"], 1, "nothing.exr"),
])
def test_guides_that_do_not_fit_are_refused_in_one_line(given, words, status, reason):
    known = large()[1]
    mask = np.random.default_rng(5).random(known["Z"].shape) < 0.5
    sparse = lambda mask, clear: {name: np.where(mask, plane, np.float32(clear)) for name, plane in known.items()}
    frames.write(given / "sparse.exr", sparse(mask, 0) | {"Mask": mask.astype(np.float32)})
    frames.write(given / "nan.exr", sparse(mask, np.nan))
    left = np.indices(mask.shape)[1] < 20
    frames.write(given / "half.exr", sparse(left, 0) | {"mask": left.astype(np.float32)})
    words = [str(given / word) if word.endswith(".exr") else word for word in words]
    result = upscale(given, "-q", *words, ok=False)
    lines = [line for line in result.lines() if "rror" in line or reason in line]
    assert result.status == status and any(reason in line for line in lines), result
    assert not (given / "out.exr").exists()
