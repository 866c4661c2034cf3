"""lacuna upscale: what comes back when the result is reduced again, windows, rules, nonsense, quality."""

import json

import numpy as np
import OpenEXR
import pytest
from scipy import ndimage

import frames
from tool import DATA, SAMPLES, lacuna, oiio


def means(image, factor):
    height, width = image.shape
    return image.reshape(height // factor, factor, width // factor, factor).mean((1, 3))


def area(size, small):
    edges = np.arange(small + 1) * size / small
    overlap = np.minimum(edges[1:, None], np.arange(1, size + 1)) - np.maximum(edges[:-1, None], np.arange(size))
    return np.clip(overlap, 0, None) * small / size


def upscale(source, target, *words, **options):
    return lacuna("upscale", "-q", source, "-o", target, *words, **options)


def floats(path, name="R"):
    return frames.read(path)[0][name].astype(np.float64)


@pytest.fixture
def scene(tmp_path):
    """A smooth scene with a hard edge, a black half and a highlight; half floats would round it."""
    y, x = np.mgrid[0:48, 0:60] / 48
    image = np.where(x + 0.3 * y > 0.8, 0.0, 0.4 + 0.3 * np.sin(7 * x) * np.cos(5 * y))
    image[20, 10] = 1000.0
    return frames.write(tmp_path / "scene.exr", {"R": image.astype(np.float32), "A": (image > 0).astype(np.float32)})


@pytest.mark.parametrize("factor", [2, 3])
@pytest.mark.parametrize("method", ["ss", "tv"])
def test_reduced_again_it_is_the_input_and_light_stays_light(scene, tmp_path, method, factor):
    upscale(scene, tmp_path / "out.exr", "--scale", str(factor), "--filter", method)
    given, got = floats(scene), floats(tmp_path / "out.exr")
    assert got.min() >= 0 and got.shape == tuple(factor * side for side in given.shape)
    # Each pixel relative to itself: black stays black beside the highlight.
    assert np.all(np.abs(means(got, factor) - given) <= 1e-5 * np.abs(given))
    alpha = floats(tmp_path / "out.exr", "A")
    assert alpha.min() >= 0 and alpha.max() <= 1


@pytest.mark.parametrize("words", [("--filter", "ss"), ("--filter", "tv"), ("--sampling", "mitchell")])
def test_what_overflows_takes_the_nearest_value_and_is_told(tmp_path, words):
    image = np.full((24, 32), 0.25, np.float32)
    image[10, 12] = 3.3e38
    given = frames.write(tmp_path / "given.exr", {"R": image})
    result = lacuna("upscale", given, "-o", tmp_path / "out.exr", "--scale", "2", "--domain", "linear", *words)
    got = floats(tmp_path / "out.exr")
    assert np.isfinite(got).all()
    # Means need no value beyond the largest float.
    told = "values overflowed in the filter and took the nearest known one" in result.stderr
    assert told == ("mitchell" in words), result
    assert told or np.all(np.abs(means(got.astype(np.float64), 2) - image) <= 1e-5 * image.max())


@pytest.mark.parametrize("factor", [1.1, 1.25, 1.5, 2.5, 4])
def test_true_area_means_become_true_area_means(tmp_path, factor):
    def means_of(pixels):
        edges = np.linspace(0, 1, pixels + 1)
        line = np.diff(-np.cos(20 * edges) / 20) * pixels
        return (2 + line[:, None] * line[None, :]).astype(np.float32)

    frames.write(tmp_path / "in.exr", {"Y": means_of(80)})
    upscale(tmp_path / "in.exr", tmp_path / "out.exr", "--scale", str(factor))
    got = floats(tmp_path / "out.exr", "Y")
    edge = int(4 * factor) + 1
    inner = np.s_[edge:-edge, edge:-edge]
    # Fourth order: a pixel is 1/4 of a radian.
    assert np.abs(got - means_of(round(80 * factor)))[inner].max() < 5e-4


def test_a_broken_factor_keeps_the_light(scene, tmp_path):
    upscale(scene, tmp_path / "out.exr", "--scale", "1.5x1.25")
    given, got = floats(scene), floats(tmp_path / "out.exr")
    assert got.shape == (60, 90) and got.min() >= 0
    # Bounds beside a highlight, which keep its surroundings from getting dark, add a little.
    assert abs(got.mean() - given.mean()) <= 0.06 * given.mean()
    dark = given.copy()
    dark[20, 10] = given[20, 9]
    frames.write(tmp_path / "in.exr", {"R": dark.astype(np.float32)})
    upscale(tmp_path / "in.exr", tmp_path / "out.exr", "--scale", "1.5x1.25")
    assert abs(floats(tmp_path / "out.exr").mean() - dark.mean()) <= 0.01 * dark.mean()


def test_an_element_over_black_keeps_its_outline(tmp_path):
    rows, columns = np.mgrid[:40, :60]
    matte = (np.hypot(rows - 20, columns - 30) < 12).astype(np.float32)
    planes = {"R": matte * (1 + columns / 60).astype(np.float32), "A": matte, "mask": matte}
    small, out = frames.write(tmp_path / "in.exr", planes), tmp_path / "out.exr"
    done = lacuna("upscale", small, "-o", out, "--scale", "2")
    assert "taken for a matte, as alpha is 0 where it is" in done.stderr, done
    assert floats(out)[0, 0] == floats(out, "A")[0, 0] == 0
    upscale(small, out, "--scale", "2", "--mask", "channel:mask")
    assert floats(out, "A")[0, 0] > 0.5
    # fill has to guess.
    done = lacuna("fill", small, "-o", out, "--filter", "ss")
    assert "if it is a matte, --mask nan takes the frame as complete" in done.stderr, done


def test_a_frame_of_one_ray_a_pixel_is_taken_as_points(tmp_path):
    small, out, points = tmp_path / "small.exr", tmp_path / "out.exr", tmp_path / "points.exr"
    for samples in ["1", "4"]:
        done = lacuna("render", SAMPLES / "scenes" / "marschner-lobb.toml", "--size", "24x24", "--samples", samples, "-o", small)
        assert done.status == 0, done
        upscale(small, points, "--scale", "2", "--sampling", "point")
        for words in [[], ["--sampling", "box"], ["--filter", "lanczos3"]]:
            done = lacuna("upscale", "-v", small, "-o", out, "--scale", "2", *words)
            assert done.status == 0, done
            chosen = samples == "1" and not words
            assert ("--sampling point" in done.stderr) == chosen == ("lacuna/settled" in OpenEXR.File(str(out)).header()), done
            assert np.array_equal(floats(out), floats(points)) == chosen
    # A frame of another size than its scene's was resized, by whatever tool.
    lacuna("render", SAMPLES / "scenes" / "marschner-lobb.toml", "--size", "24x24", "-o", small)
    upscale(small, points, "--scale", "2")
    assert "lacuna/scene" in OpenEXR.File(str(points)).header()
    done = lacuna("upscale", "-v", points, "-o", out, "--scale", "2")
    assert done.status == 0 and "--sampling point" not in done.stderr, done


def test_the_distance_that_is_told_is_the_one_that_is_left(tmp_path):
    y, x = np.mgrid[0:40, 0:48]
    plane = np.where(np.hypot(y - 20, x - 22) < 11, 1, 0.01).astype(np.float32)
    frames.write(tmp_path / "in.exr", {"R": plane})
    done = lacuna("upscale", tmp_path / "in.exr", "-o", tmp_path / "out.exr", "--scale", "2", "--sampling", "gaussian:1")
    apart = (np.arange(96) + 0.5) / 2 - (np.arange(48)[:, None] + 0.5)
    across = np.where(np.abs(apart) < 1, np.exp(-2 * apart**2), 0)
    across /= across.sum(1, keepdims=True)
    down = across[:40, :80] / across[:40, :80].sum(1, keepdims=True)
    back = down @ floats(tmp_path / "out.exr", "R") @ across.T
    told = float(done.stderr.split("off its input by up to ")[1].split()[0])
    assert abs(told - np.abs(back - plane).max()) <= 0.06 * told and "--sampling box" in done.stderr, done


def test_a_broken_factor_is_no_solver_that_was_stopped(tmp_path):
    y, x = np.mgrid[0:48, 0:60]
    disc = (np.hypot(y - 21, x - 28) < 13).astype(np.float32)
    frames.write(tmp_path / "in.exr", {"R": means(np.kron(disc, np.ones((4, 4))), 4).astype(np.float32)})
    done = lacuna("upscale", tmp_path / "in.exr", "-o", tmp_path / "out.exr", "--scale", "1.5", "--json", tmp_path / "told.json")
    [told] = json.loads((tmp_path / "told.json").read_text())["frames"]
    assert done.status == 0 and "warning" not in done.stderr, done
    assert told["stop"] == "converged" and told["warnings"] == [] and 0 < told["off_input"] < 1, told
    assert "lacuna/stop" not in OpenEXR.File(str(tmp_path / "out.exr")).header()


def test_total_variation_says_which_gap_it_has(scene, tmp_path):
    def told(*words):
        done = lacuna("upscale", scene, "-o", tmp_path / "out.exr", "--force", "--scale", "2", "--filter", "tv", "--json", tmp_path / "told.json", *words)
        [frame] = json.loads((tmp_path / "told.json").read_text())["frames"]
        return frame, done, OpenEXR.File(str(tmp_path / "out.exr")).header().get("lacuna/stop")

    frame, done, stop = told()
    assert frame["stop"] == "converged" and frame["gap"] <= 0.01 and stop is None and "warning" not in done.stderr
    for sweeps in ("1", "2"):
        frame, done, stop = told("--tv-iterations", sweeps)
        assert frame["stop"] == stop == "iteration-limit" and frame["gap"] > 0.01, frame
        assert "stopped by the limit of iterations" in done.stderr and "--tv-iterations allows more" in done.stderr, done


def test_energy_is_promised_of_means_only(scene, tmp_path):
    told = " ".join(lacuna("upscale", "--help").stdout.split())
    assert "keep their energy where a pixel is a mean" in told and "a sample at a point says nothing of energy" in told
    given = floats(scene)
    for model, least, most in (("box", 0.999, 1.001), ("point", 0.3, 0.95)):
        upscale(scene, tmp_path / f"{model}.exr", "--scale", "2", "--sampling", model)
        assert least < floats(tmp_path / f"{model}.exr").sum() / (4 * given.sum()) < most


def test_enlarged_frames_are_called_enlarged(tmp_path):
    y, x = np.mgrid[0:20, 0:24]
    for number in (1, 2):
        frames.write(tmp_path / f"in.{number}.exr", {"R": (x + y + number).astype(np.float32)})
    upscale(tmp_path / "in.%d.exr", tmp_path / "twice.%d.exr", "--scale", "2")
    done = lacuna("upscale", tmp_path / "twice.%d.exr", "-o", tmp_path / "more.%d.exr", "--scale", "2")
    told = [line for line in done.stderr.splitlines() if "enlarged by ss already: taken as complete" in line]
    assert len(told) == 2 and all(f"twice.{number}.exr" in line for number, line in enumerate(sorted(told), 1)), done
    assert "filled by" not in done.stderr, done
    done = lacuna("verify", tmp_path / "in.1.exr", tmp_path / "twice.1.exr", ok=False)
    [line] = [line for line in done.stderr.splitlines() if "error" in line]
    assert done.status == 1 and "twice.1.exr: enlarged by ss: verify checks fills" in line and "lacuna compare" in line, done


def test_what_is_taken_from_a_file_of_guides_need_not_steer(tmp_path):
    plane = np.random.default_rng(4).random((24, 32)).astype(np.float32)
    frames.write(tmp_path / "in.exr", {"R": plane, "Z": plane})
    frames.write(tmp_path / "guides.exr", {"Z": np.kron(plane, np.float32([[1, 2], [3, 4]]))})
    out, words = tmp_path / "out.exr", ["--guides-from", tmp_path / "guides.exr", "--guides", "none"]
    for method in ["ss", "cubic"]:
        upscale(tmp_path / "in.exr", out, "--scale", "2", "--filter", method)
        plain = floats(out, "R")
        upscale(tmp_path / "in.exr", out, "--scale", "2", "--filter", method, *words, "--take-guides")
        assert np.array_equal(floats(out, "R"), plain)
        assert np.array_equal(floats(out, "Z"), floats(tmp_path / "guides.exr", "Z"))
    done = lacuna("upscale", tmp_path / "in.exr", "-o", out, "--scale", "2", "--force", *words, ok=False)
    assert done.status == 2 and "--guides none" in done.stderr, done


def test_a_grid_keeps_its_samples(scene, tmp_path):
    upscale(scene, tmp_path / "out.exr", "--scale", "3", "--sampling", "grid")
    assert frames.same_bits(frames.read(tmp_path / "out.exr")[0]["R"][::3, ::3].copy(), frames.read(scene)[0]["R"])


@pytest.mark.parametrize("words", [["--scale", "2"], ["--scale", "1.1"], ["--scale", "1.25"], ["--scale", "2.7"], ["--scale", "4"],
                                   ["--scale", "1.75", "--sampling", "point"],
                                   ["--size", "120x72", "--sampling", "mitchell"]])
def test_a_ramp_stays_that_ramp(tmp_path, words):
    y, x = np.mgrid[0:24, 0:40] + 0.5
    frames.write(tmp_path / "ramp.exr", {"Y": (1 + 0.01 * x + 0.02 * y).astype(np.float32)})
    upscale(tmp_path / "ramp.exr", tmp_path / "out.exr", *words)
    got = floats(tmp_path / "out.exr", "Y")
    y, x = np.mgrid[0 : got.shape[0], 0 : got.shape[1]] + 0.5
    expected = 1 + 0.01 * x * 40 / got.shape[1] + 0.02 * y * 24 / got.shape[0]
    assert np.abs(got - expected).max() < 1e-5


@pytest.mark.parametrize("words", [["200%"], ["150%"], ["100x77"]])
@pytest.mark.parametrize("origin, size, display", [((-5, -3), (40, 50), ((0, 0), (39, 31))), ((7, 5), (10, 20), ((2, 3), (42, 35)))])
def test_windows_are_those_of_oiiotool(tmp_path, origin, size, display, words):
    source = tmp_path / "in.exr"
    plane = np.random.default_rng(1).random(size, np.float32)
    frames.write(source, {"Y": plane}, origin=origin, display=display, pixelAspectRatio=2.0)
    size = words[0]
    asked = ["--scale", str(float(size[:-1]) / 100)] if size.endswith("%") else ["--size", size]
    upscale(source, tmp_path / "out.exr", *asked)
    assert oiio("oiiotool", source, "--resize", size, "-o", tmp_path / "theirs.exr").status == 0
    ours, theirs = (OpenEXR.File(str(tmp_path / name)).header() for name in ("out.exr", "theirs.exr"))
    for name in ("dataWindow", "displayWindow", "pixelAspectRatio"):
        assert np.array_equal(ours[name], theirs[name]), (name, ours[name], theirs[name])


def test_parts_and_channels_go_by_their_rules(tmp_path):
    source = SAMPLES / "full" / "parts.exr"
    done = lacuna("upscale", source, "-o", tmp_path / "out.exr", "--scale", "2", "--json", tmp_path / "report.json")
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["command"] == "upscale" and report["frames"][0]["state"] == "done", done
    given, got = frames.read(source), frames.read(tmp_path / "out.exr")
    info = json.loads(lacuna("info", "--json", source).stdout)
    assert len(got) == len(given)
    checked = set()
    for old, new, described in zip(given, got, info["parts"]):
        assert list(old) == list(new)
        normals = []
        for channel in described["channels"]:
            name, rule = channel["name"], channel["rule"]
            assert new[name].dtype == old[name].dtype
            assert new[name].shape == tuple(2 * side for side in old[name].shape)
            if rule in ("depth", "nearest", "keep"):
                assert np.array_equal(frames.bits(new[name][::2, ::2].copy()), frames.bits(old[name]))
                assert np.array_equal(frames.bits(new[name][1::2, 1::2].copy()), frames.bits(old[name]))
            if rule == "normal":
                normals.append(new[name].astype(float))
            checked.add(rule)
        if normals:
            length = np.sqrt(sum(plane**2 for plane in normals))
            assert np.all((np.abs(length - 1) < 2e-3) | (length < 1e-3))
    assert {"fill", "normal", "depth", "nearest"} <= checked, checked


def test_sparse_frames_are_filled_as_fill_fills_them(tmp_path):
    source, one, two = tmp_path / "sparse.exr", tmp_path / "one.exr", tmp_path / "two.exr"
    full = frames.colour(SAMPLES / "edges.exr", "RGB")[:96, :96]
    frames.write_sparse(source, full, frames.shuffle(96, 96, 0.3), names="RGB")
    upscale(source, one, "--scale", "2")
    assert lacuna("fill", source, "-o", tmp_path / "filled.exr", "-d", "float").status == 0
    upscale(tmp_path / "filled.exr", two, "--scale", "2")
    assert all(np.array_equal(floats(one, name), floats(two, name)) for name in "RGB")


def test_sparse_frames_are_filled_and_enlarged_at_once(tmp_path):
    full = frames.colour(SAMPLES / "smooth.exr", "R")[..., 0].astype(float)
    full = full[: full.shape[0] // 2 * 2, : full.shape[1] // 2 * 2]
    low = means(full, 2).astype(np.float32)
    mask = frames.shuffle(*low.shape, 0.4)
    source = tmp_path / "sparse.exr"
    frames.write_sparse(source, low[..., None], mask, names="R")
    quality = {}
    for method in ("ss", "tv"):
        upscale(source, tmp_path / "out.exr", "--scale", "2", "--filter", method)
        got = floats(tmp_path / "out.exr")
        back = means(got, 2)
        assert np.abs(back - low)[mask].max() <= 1e-5 * low.max()
        quality[method] = frames.psnr(got, full)
        lost = frames.read(tmp_path / "out.exr")[0]["mask"]
        assert np.array_equal(lost[::2, ::2].astype(bool), mask)
    assert quality["ss"] > 40 and quality["tv"] > 30, quality


def test_values_that_are_not_finite_are_filled(tmp_path):
    plane = np.full((12, 14), 0.5, np.float32)
    plane[3, 4], plane[8, 9] = np.nan, np.inf
    frames.write(tmp_path / "in.exr", {"R": plane})
    done = lacuna("upscale", tmp_path / "in.exr", "-o", tmp_path / "out.exr", "--scale", "2")
    assert "2 measured values are not finite" in done.stderr, done
    assert np.abs(floats(tmp_path / "out.exr") - 0.5).max() < 1e-6


def test_sequences_are_updated_and_threads_change_no_byte(tmp_path):
    pattern = SAMPLES / "sequence" / "shot.####.exr"
    words = ["--scale", "2", "--frames", "1-2"]
    lacuna("upscale", pattern, "-o", tmp_path / "a.####.exr", *words)
    again = lacuna("upscale", pattern, "-o", tmp_path / "a.####.exr", *words, "-u")
    assert "2 skipped" in again.stderr, again
    other = lacuna("upscale", pattern, "-o", tmp_path / "a.####.exr", *words, "-u", "--sampling", "point")
    assert "skipped" not in other.stderr, other
    lacuna("upscale", pattern, "-o", tmp_path / "b.####.exr", *words, "--sampling", "point", "--threads", "1")
    assert (tmp_path / "a.0001.exr").read_bytes() == (tmp_path / "b.0001.exr").read_bytes()


@pytest.mark.parametrize("words, reason", [
    (["--scale", "0"], "above 1"),
    (["--scale", "-1"], "above 1"),
    (["--scale", "nan"], "above 1"),
    (["--scale", "17"], "16 times"),
    (["--scale", "1"], "changes nothing"),
    (["--scale", "0.5"], "oiiotool INPUT --resize 50%x50% -o OUTPUT"),
    (["--size", "0x10"], "at least 1"),
    (["--scale", "2", "--size", "9x9"], "cannot be used with"),
    ([], "--scale"),
    (["--scale", "2", "--sampling", "gaussian:9"], "0.5 to 1.5"),
    (["--scale", "2", "--filter", "pushpull"], "pushpull"),
    (["--scale", "2", "--tv-gap", "1e-3"], "--filter tv"),
    (["--scale", "2", "--ss-lambda", "1"], "--ss-lambda"),
    (["--scale", "2", "--ss-order", "3"], "--ss-order"),
    (["--scale", "2", "--tv-epsilon", "0.1", "--filter", "tv"], "--tv-epsilon"),
    (["--scale", "2", "--filter", "lanczos3", "--sampling", "point"], "--filter lanczos3 has none"),
    (["--scale", "2", "--domain", "log", "--sampling", "box"], "point and grid"),
    (["--scale", "2", "--filter", "cubic", "--guides-from", "large.exr", "--take-guides"], "--guides none with --take-guides"),
    (["--scale", "1.5", "--sampling", "grid"], "whole factors"),
])
def test_nonsense_is_a_usage_error_of_one_line(tmp_path, words, reason):
    done = lacuna("upscale", SAMPLES / "smooth.exr", "-o", tmp_path / "out.exr", *words, ok=False)
    assert done.status == 2 and any(reason in line for line in done.lines()), done
    assert not (tmp_path / "out.exr").exists()


@pytest.mark.parametrize("words, reason", [
    (["--size", "10x10"], "oiiotool INPUT --resize"),
    (["--size", "60x48"], "that size already; lacuna fill"),
    (["--size", "16000x16000"], "more than 16 times"),
    (["--size", "90x72", "--sampling", "grid"], "scene.exr: --sampling grid needs whole factors"),
    (["--scale", "2", "--domain", "log"], "point and grid, not box"),
])
def test_what_does_not_suit_the_frame_fails_in_one_line(scene, tmp_path, words, reason):
    done = lacuna("upscale", "-q", scene, "-o", tmp_path / "out.exr", *words, ok=False)
    assert done.status == 1 and len(done.lines()) == 1 and reason in done.stderr, done


@pytest.mark.parametrize("method", ["lanczos3", "cubic", "linear"])
def test_plain_filters_are_those_of_others(tmp_path, method):
    low = means(frames.colour(SAMPLES / "smooth.exr", "R")[..., 0].astype(float)[:64, :64], 2).astype(np.float32)
    frames.write(tmp_path / "in.exr", {"R": low})
    upscale(tmp_path / "in.exr", tmp_path / "out.exr", "--scale", "2", "--filter", method)
    theirs = {"lanczos3": "lanczos3", "cubic": "catmull-rom", "linear": "triangle"}[method]
    oiio("oiiotool", tmp_path / "in.exr", f"--resize:filter={theirs}", "64x64", "-o", tmp_path / "theirs.exr")
    inside = (slice(8, -8),) * 2
    assert np.abs(floats(tmp_path / "out.exr") - floats(tmp_path / "theirs.exr"))[inside].max() < 2e-3


def judge(image, full):
    return frames.psnr(np.clip(image, 0, 1)[16:-16, 16:-16], np.clip(full, 0, 1)[16:-16, 16:-16])


@pytest.mark.data
@pytest.mark.parametrize("name, lead", [("engine", 1.5), ("engine-soft", 1.5), ("tooth", 1.5), ("aneurism-iso", 0.3)])
def test_quality_on_renders(tmp_path, name, lead):
    full = frames.colour(DATA / "frames" / f"{name}.exr", "R")[300:900, 300:900, 0].astype(float)
    box, grid, out = tmp_path / "box.exr", tmp_path / "grid.exr", tmp_path / "out.exr"
    frames.write(box, {"R": means(full, 2).astype(np.float32)})
    upscale(box, out, "--scale", "2")
    ours = judge(floats(out), full)
    assert np.abs(means(floats(out), 2) - floats(box)).max() <= 1e-4 * full.max()
    # The best of oiiotool's filters on these four, by the tables of docs/upscaling.md.
    oiio("oiiotool", box, "--resize:filter=lanczos3", "600x600", "-o", out)
    assert ours >= judge(floats(out), full) + lead
    frames.write(grid, {"R": full[::2, ::2].astype(np.float32)})
    upscale(grid, out, "--scale", "2", "--sampling", "grid")
    spline = ndimage.map_coordinates(full[::2, ::2], np.mgrid[0:600, 0:600] / 2, order=3, mode="mirror")
    margin = 0 if name == "aneurism-iso" else -0.1
    assert judge(floats(out), full) > judge(spline, full) + margin


@pytest.mark.parametrize("sampling", ["box", "point"])
def test_nothing_shines_where_alpha_is_0(tmp_path, sampling):
    y, x = np.mgrid[0:128, 0:128]
    matte = np.clip(9.0 * np.sin(x / 9.0 + np.sin(y / 7.0)), 0, 1)
    light = matte * np.where((x // 6 + y // 6) % 2, 1.0, 0.05)
    small = {"A": means(matte, 2), "R": means(light, 2), "glow.A": means(matte, 2), "glow.R": means(light + 0.01, 2)}
    small = {name: plane.astype(np.float32) for name, plane in small.items()}
    frames.write(tmp_path / "small.exr", small)
    frames.write(tmp_path / "alone.exr", {"R": small["R"]})
    for name in ["small", "alone"]:
        large = tmp_path / f"{name}.large.exr"
        done = upscale(tmp_path / f"{name}.exr", large, "--scale", "2", "--sampling", sampling)
        assert done.status == 0, done
    empty = floats(tmp_path / "small.large.exr", "A") == 0
    light = floats(tmp_path / "small.large.exr")
    assert empty.any() and (floats(tmp_path / "alone.large.exr")[empty] != 0).any()
    assert (light[empty] == 0).all()
    # A glow has light without alpha.
    assert (floats(tmp_path / "small.large.exr", "glow.R")[empty] != 0).any()
    if sampling == "box":
        np.testing.assert_allclose(means(light, 2), small["R"], atol=1e-6)
