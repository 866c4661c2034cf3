"""`lacuna compare` against independent implementations: numpy, scikit-image, OpenImageIO. Every test prints both numbers."""

import csv
import json

import numpy as np
import pytest
from skimage.color import xyz2luv
from skimage.metrics import structural_similarity

import frames
import tool

FRAMES = ["engine", "engine-soft", "tooth", "head", "aneurism-iso"]
# The one that is compared in its full size.
WHOLE = "engine"
# ITU-R BT.709 under D65, from the primaries.
TO_XYZ = np.array([[0.4123908, 0.3575843, 0.1804808], [0.2126390, 0.7151687, 0.0721923], [0.0193308, 0.1191948, 0.9505322]])
SSIM = dict(gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1.0)


def compare(reference, test, folder, *words, ok=True):
    """The JSON report of one pair, and the process."""
    out = folder / "report.json"
    result = tool.lacuna("compare", reference, test, "--json", out, *words, ok=ok, timeout=600)
    return json.loads(out.read_text()), result


def measures(report, region="all", group=0, frame=0):
    regions = report["frames"][frame]["groups"][group]["regions"]
    return next(found["measures"] for found in regions if found["region"] == region)


def show(name, ours, theirs):
    print(f"{name:14} lacuna {ours:.9g}   twin {theirs:.9g}   difference {abs(ours - theirs):.2e}")


def hdr_pair():
    """Smooth light with highlights up to 60, and the same with errors; and a little negative light in the test image."""
    rows, columns = np.indices((200, 260)) / 50.0
    base = 0.4 + 0.4 * np.sin(rows * 1.3) * np.cos(columns)
    light = np.stack([base, 0.7 * base + 0.05, 0.5 * base], axis=-1)
    light += 60 * np.exp(-((rows - 1.5) ** 2 + (columns - 2.5) ** 2) * 8)[..., None] * (1, 0.8, 0.5)
    noise = np.random.default_rng(7).normal(size=light.shape)
    other = light * (1 + 0.02 * noise) + 0.004 * noise
    return light.astype(np.float32), other.astype(np.float32)


def numbers(one, other):
    """The twins of the errors, in float64."""
    a, b = (np.clip(image.astype(np.float64), 0, 1) for image in (one, other))
    mse = np.mean((a - b) ** 2)
    lin = [image.astype(np.float64) for image in (one, other)]
    log = [np.sign(image) * np.log2(1 + np.abs(image)) for image in lin]
    return {
        "mse": mse, "rmse": np.sqrt(mse), "psnr": -10 * np.log10(mse), "max": np.abs(a - b).max(),
        "relative-mse": np.mean((lin[1] - lin[0]) ** 2 / (lin[0] ** 2 + 0.01)),
        "log-psnr": 10 * np.log10(np.log2(1 + np.abs(lin[0]).max()) ** 2 / np.mean((log[1] - log[0]) ** 2)),
        "different": np.count_nonzero(frames.bits(one) != frames.bits(other)),
    }


def check_errors(found, one, other):
    for name, twin in numbers(one, other).items():
        show(name, found[name], twin)
        assert found[name] == pytest.approx(twin, rel=1e-12), name


def check_ssim(found, one, other):
    a, b = (np.clip(image, 0, 1).astype(np.float64) for image in (one, other))
    twin = np.mean([structural_similarity(a[..., k], b[..., k], **SSIM) for k in range(3)])
    show("ssim", found["ssim"], twin)
    assert found["ssim"] == pytest.approx(twin, abs=1e-6)


def test_ssim_of_light_without_clipping(tmp_path):
    rows, columns = np.indices((60, 70))
    texture = (rows * 37 + columns * 57) % 23 / 22
    bright = np.where(columns < 35, 0, 1000)
    pair = [(texture + bright).astype(np.float32), (texture[::-1] + bright).astype(np.float32)]
    paths = [frames.write(tmp_path / f"{k}.exr", dict.fromkeys("RGB", image)) for k, image in enumerate(pair)]
    found = measures(compare(*paths, tmp_path, "--no-clip")[0])["ssim"]
    assert found == pytest.approx(structural_similarity(*(image.astype(np.float64) for image in pair), **SSIM), abs=1e-6)
    # Whatever the peak, equal images are alike.
    for peak in ("1e30", "1e-30"):
        report, result = compare(paths[0], paths[0], tmp_path, "--no-clip", "--peak", peak, "--fail-below", "ssim=0.9")
        assert result.status == 0 and measures(report)["ssim"] == 1, peak


def check_cieluv(found, one, other):
    luv = [xyz2luv(np.clip(image, 0, 1).astype(np.float64) @ TO_XYZ.T) for image in (one, other)]
    twin = np.mean(np.linalg.norm(luv[0] - luv[1], axis=-1))
    show("cieluv", found["cieluv"], twin)
    # scikit-image rounds the white point to four digits.
    assert found["cieluv"] == pytest.approx(twin, rel=1e-3)


def check_flip(found, reference, test):
    for name, option in (("flip", "hdr=0"), ("hdr-flip", "hdr=1")):
        result = tool.run([tool.OIIO_BIN / "oiiotool", reference, "--ch", "R,G,B", test, "--ch", "R,G,B", f"--flipdiff:{option}"], timeout=300)
        twin = float(next(line.split("=")[1] for line in result.stdout.splitlines() if "Mean FLIP" in line))
        show(name, found[name], twin)
        # oiiotool prints four significant digits.
        assert found[name] == pytest.approx(twin, abs=2e-6, rel=1e-3)


def test_flip_counts_in_the_unit_of_the_peak(tmp_path):
    base = np.abs(np.sin(np.indices((40, 50)).sum(0) / 9.0)).astype(np.float32)
    found = []
    for scale in (1, 64):
        images = {"r": scale * base, "t": scale * (base + np.float32(0.0625))}
        paths = [frames.write(tmp_path / f"{name}{scale}.exr", dict.fromkeys("RGB", image)) for name, image in images.items()]
        found.append(measures(compare(*paths, tmp_path, "--measures", "flip", "--peak", scale)[0])["flip"])
    assert found[0] > 0.01 and found[0] == pytest.approx(found[1], rel=1e-6)


def test_flip_takes_negative_light_as_openimageio_does(tmp_path):
    rows, columns = np.indices((90, 110)) / 20.0
    base = np.sin(rows * 1.3) * np.cos(columns)
    one = np.stack([2 * base - 1, base[::-1] + 0.3, 1.5 * np.cos(rows) * np.sin(columns)], axis=-1).astype(np.float32)
    other = (one + 0.2 * np.random.default_rng(1).normal(size=one.shape)).astype(np.float32)
    assert np.mean(one < 0) > 0.5
    paths = [frames.write(tmp_path / f"{name}.exr", dict(zip("RGB", np.moveaxis(image, -1, 0)))) for name, image in (("r", one), ("t", other))]
    report, _ = compare(*paths, tmp_path, "--measures", "flip,hdr-flip", "--hdr-range", "0.18,2")
    check_flip(measures(report), *paths)


def check_all(reference, test, one, other, folder):
    # The exposures that oiiotool takes for every image.
    report, _ = compare(reference, test, folder, "--measures", "cieluv,flip,hdr-flip", "--hdr-range", "0.18,2")
    found = measures(report)
    check_errors(found, one, other)
    check_ssim(found, one, other)
    check_cieluv(found, one, other)
    check_flip(found, reference, test)


def middle(path, source, size):
    """The middle of a render: what its pixels are like does not depend on how many there are, and the twins are slow."""
    pixels = frames.colour(source, "RGBA")
    top, left = ((length - size) // 2 for length in pixels.shape[:2])
    crop = pixels[top : top + size, left : left + size]
    return frames.write(path, dict(zip("RGBA", np.moveaxis(crop, -1, 0))))


@pytest.mark.data
@pytest.mark.parametrize("name", FRAMES)
def test_measures_agree_with_their_twins_on_renders(name, tmp_path):
    reference = tool.DATA / "frames" / f"{name}.exr"
    if name != WHOLE:
        reference = middle(tmp_path / "middle.exr", reference, 500)
    sparse, filled = tmp_path / "sparse.exr", tmp_path / "filled.exr"
    tool.lacuna("sparsify", reference, "-o", sparse, "--density", "0.2")
    tool.quick_fill(sparse, "-o", filled)
    check_all(reference, filled, frames.colour(reference), frames.colour(filled), tmp_path)


def test_measures_agree_with_their_twins_on_hdr(tmp_path):
    one, other = hdr_pair()
    paths = [frames.write(tmp_path / f"{k}.exr", dict(zip("RGB", np.moveaxis(image, -1, 0)))) for k, image in enumerate((one, other))]
    check_all(*paths, one, other, tmp_path)


def test_display_and_peak_mean_what_they_say(tmp_path):
    one, other = hdr_pair()
    paths = [frames.write(tmp_path / f"{k}.exr", dict(zip("RGB", np.moveaxis(image, -1, 0)))) for k, image in enumerate((one, other))]
    curve = lambda v: np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)
    shown = [curve(np.clip(image.astype(np.float64), 0, 1)) for image in (one, other)]
    linear = [image.astype(np.float64) for image in (one, other)]
    for words, (a, b), peak in [(["--display"], shown, 1), (["--no-clip"], linear, 1), (["--peak", "20"], np.clip(linear, 0, 20), 20)]:
        found = measures(compare(*paths, tmp_path, *words)[0])["psnr"]
        twin = 10 * np.log10(peak**2 / np.mean((a - b) ** 2))
        show(words[0], found, twin)
        assert found == pytest.approx(twin, abs=1e-4)


def test_regions_leave_out_what_flatters(tmp_path):
    one, other = hdr_pair()
    one[:, 130:] = other[:, 130:] = 0
    mask = frames.shuffle(*one.shape[:2], 0.3)
    other = np.where(mask[..., None], one, other)
    alpha = (np.indices(one.shape[:2])[1] < 130).astype(np.float32)
    planes = lambda image: dict(zip("RGB", np.moveaxis(image, -1, 0))) | {"A": alpha}
    reference = frames.write(tmp_path / "r.exr", planes(one))
    test = frames.write(tmp_path / "t.exr", planes(other) | {"mask": mask.astype(np.float32)})
    report, _ = compare(reference, test, tmp_path)
    for region, inside in [("all", np.ones_like(mask)), ("missing", ~mask), ("alpha", alpha > 0)]:
        found, twin = measures(report, region), numbers(one[inside], other[inside])
        show(f"psnr {region}", found["psnr"], twin["psnr"])
        assert found["psnr"] == pytest.approx(twin["psnr"], abs=1e-9)
        assert found["pixels"] == np.count_nonzero(inside)
    group = report["frames"][0]["groups"][0]
    assert (group["measured_max"], group["measured_different"]) == (0, 0)
    other[10, np.flatnonzero(mask[10])[0], 1] += 0.5
    test = frames.write(tmp_path / "t.exr", planes(other) | {"mask": mask.astype(np.float32)})
    group = compare(reference, test, tmp_path)[0]["frames"][0]["groups"][0]
    assert group["measured_max"] == pytest.approx(0.5, abs=1e-6) and group["measured_different"] == 1


def test_a_sparse_reference_is_told(tmp_path):
    tool.lacuna("sparsify", tool.SAMPLES / "smooth.exr", "-o", tmp_path / "sparse.exr", "--density", 0.5)
    result = tool.lacuna("compare", tmp_path / "sparse.exr", tool.SAMPLES / "smooth.exr")
    assert "the reference is sparse" in result.stderr
    assert "sparse" not in tool.lacuna("compare", tool.SAMPLES / "smooth.exr", tmp_path / "sparse.exr").stderr


def test_flicker_is_of_colours_as_they_are_compared(tmp_path):
    rows, columns = np.indices((40, 50))
    images = []
    for number in (1, 2):
        truth = (1.2 + np.sin((rows + columns + number) / 9.0)).astype(np.float32)
        test = truth + np.float32(0.1 * number) * np.cos(rows).astype(np.float32)
        for name, image in (("r", truth), ("t", test)):
            frames.write(tmp_path / f"{name}.{number:04}.exr", dict.fromkeys("RGB", image))
        images.append((truth.astype(np.float64), test.astype(np.float64)))
    for words, shown in (([], lambda image: np.clip(image, 0, 1)), (["--no-clip"], lambda image: image), (["--peak", 2], lambda image: np.clip(image, 0, 2))):
        report, _ = compare(tmp_path / "r.####.exr", tmp_path / "t.####.exr", tmp_path, "--measures", "flicker", *words)
        errors = [shown(test) - shown(truth) for truth, test in images]
        assert measures(report, frame=1)["flicker"] == pytest.approx(np.sqrt(np.mean((errors[1] - errors[0]) ** 2)), rel=1e-5)


def sequence(folder, count=3):
    rows, columns = np.indices((40, 50))
    errors = []
    for number in range(1, count + 1):
        image = (0.5 + 0.3 * np.sin((rows + columns + number) / 9.0)).astype(np.float32)
        error = np.float32(0.01 * number) * np.cos(rows + 3.0 * number).astype(np.float32)
        errors.append((image + error).astype(np.float64) - image)
        frames.write(folder / f"r.{number:04}.exr", dict.fromkeys("RGB", image))
        frames.write(folder / f"t.{number:04}.exr", dict.fromkeys("RGB", image + error))
    return errors


@pytest.mark.parametrize("asked", ["flicker", "change"])
def test_flicker_is_the_change_of_the_error_beside_that_of_the_reference(tmp_path, asked):
    errors = sequence(tmp_path)
    truths = [frames.colour(tmp_path / f"r.{number:04}.exr")[..., 0].astype(np.float64) for number in range(1, 4)]
    report, _ = compare(tmp_path / "r.####.exr", tmp_path / "t.####.exr", tmp_path, "--measures", asked)
    assert not {"flicker", "change"} & measures(report, frame=0).keys()
    for number in (1, 2):
        for measure, images in (("flicker", errors), ("change", truths)):
            found, twin = measures(report, frame=number)[measure], np.sqrt(np.mean((images[number] - images[number - 1]) ** 2))
            show(measure, found, twin)
            assert found == pytest.approx(twin, rel=1e-5)


def test_along_the_motion_only_what_changes_on_surfaces_flickers(tmp_path):
    rows, columns = np.mgrid[0:40, 0:64].astype(np.float64)
    errors, truths = [], []
    for number in range(1, 4):
        across = columns - 2 * number
        truth = (0.5 + 0.2 * np.sin(rows / 3.0) * np.cos(across / 4.0)).astype(np.float32)
        # Most of the error moves with the surface.
        error = np.float32(0.05 * np.sin(rows + across) + 0.004 * number * np.cos(rows / 2.0))
        vectors = {"motionvector.R": np.full_like(truth, 2.0), "motionvector.G": np.zeros_like(truth)}
        frames.write(tmp_path / f"r.{number:04}.exr", dict.fromkeys("RGB", truth) | vectors)
        frames.write(tmp_path / f"t.{number:04}.exr", dict.fromkeys("RGB", truth + error) | vectors)
        errors.append((truth + error).astype(np.float64) - truth)
        truths.append(truth.astype(np.float64))
    report, _ = compare(tmp_path / "r.####.exr", tmp_path / "t.####.exr", tmp_path, "--measures", "flicker,flicker-along")
    assert not {"flicker-along", "change-along"} & measures(report, frame=0).keys()
    for number in (1, 2):
        found = measures(report, frame=number)
        for measure, images in (("flicker-along", errors), ("change-along", truths)):
            twin = np.sqrt(np.mean((images[number][:, 2:] - images[number - 1][:, :-2]) ** 2))
            show(measure, found[measure], twin)
            assert found[measure] == pytest.approx(twin, rel=1e-5, abs=1e-7)
        assert found["flicker-along"] < 0.2 * found["flicker"]
    # Beyond a cut nothing moves from one frame to the next, and nothing is told.
    noise = np.random.default_rng(5).random((40, 64)).astype(np.float32)
    for name in ("r", "t"):
        frames.write(tmp_path / f"{name}.0004.exr", dict.fromkeys("RGB", noise))
    report, _ = compare(tmp_path / "r.####.exr", tmp_path / "t.####.exr", tmp_path, "--measures", "flicker-along")
    assert "flicker" in measures(report, frame=3) and "flicker-along" not in measures(report, frame=3)


def test_a_bound_on_changes_takes_a_sequence_and_no_region(tmp_path):
    sequence(tmp_path)
    for number in range(1, 4):
        planes = frames.read(tmp_path / f"t.{number:04}.exr")[0]
        frames.write(tmp_path / f"t.{number:04}.exr", planes | {"mask": np.float16(np.indices((40, 50)).sum(0) % 2)})
    pair = (tmp_path / "r.####.exr", tmp_path / "t.####.exr")
    for measure in ("flicker", "missing.flicker", "flicker-along"):
        assert compare(*pair, tmp_path, "--fail-above", f"{measure}=1")[1].status == 0
        report, result = compare(*pair, tmp_path, "--fail-above", f"{measure}=0.001", ok=False)
        assert result.status == 1 and [bool(frame["failures"]) for frame in report["frames"]] == [False, True, True]
        assert "is above 0.001" in result.stderr and "no flicker" not in result.stderr
        # A single frame has none.
        for alone in (pair + ("--frames", "2"), (tmp_path / "r.0002.exr", tmp_path / "t.0002.exr")):
            report, result = compare(*alone[:2], tmp_path, *alone[2:], "--fail-above", f"{measure}=1", ok=False)
            assert result.status == 1 and result.stderr.count("takes a sequence") == 1, result.stderr


def test_flicker_goes_by_frame_numbers(tmp_path):
    sequence(tmp_path, 7)
    pair = (tmp_path / "r.####.exr", tmp_path / "t.####.exr")
    found = lambda report: {frame["frame"]: measures(report, frame=k).get("flicker") for k, frame in enumerate(report["frames"])}
    noted = lambda report: [frame["frame"] for frame in report["frames"] if any("no flicker" in note for note in frame["notes"])]
    whole = found(compare(*pair, tmp_path, "--measures", "flicker")[0])
    asked = ["--measures", "flicker", "--fail-above", "flicker=1"]
    # The order of frames means nothing, and beyond a gap there is no frame before.
    for numbers, alone, skipped in (("7-1", [], []), ("1,2,6,7", [6], [6]), ("5-7,1-2", [5], [1, 5])):
        report, result = compare(*pair, tmp_path, "--frames", numbers, *asked)
        expected = {frame["frame"]: None if frame["frame"] in skipped else whole[frame["frame"]] for frame in report["frames"]}
        assert (found(report), noted(report)) == (expected, alone), numbers
        assert all(f"its own (1 of {len(found(report))} frames: {number})" in result.stdout for number in alone), result
    report, result = compare(*pair, tmp_path, "--frames", "1-7x2", *asked, ok=False)
    assert result.status == 1 and "no frame has flicker" in result.stderr, result
    assert not any(found(report).values()) and noted(report) == [3, 5, 7]
    # Where the frame before was compared, its absence is no excuse.
    frames.write(tmp_path / "r.0003.exr", {"Z": np.ones((40, 50), np.float32)})
    frames.write(tmp_path / "t.0003.exr", {"Z": np.ones((40, 50), np.float32)})
    report, _ = compare(*pair, tmp_path, *asked, ok=False)
    assert [frame["frame"] for frame in report["frames"] if frame["failures"]] == [3, 4]


def test_the_gate_decides_the_exit_status_and_names_the_frames(tmp_path):
    sequence(tmp_path)
    pair = (tmp_path / "r.####.exr", tmp_path / "t.####.exr")
    assert compare(*pair, tmp_path, "--fail-below", "psnr=20,ssim=0.5", "--fail-above", "nan=0")[1].status == 0
    report, result = compare(*pair, tmp_path, "--fail-below", "psnr=40", ok=False)
    assert result.status == 1
    named = [line for line in result.lines() if "is below" in line]
    assert len(named) == 2 and "t.0002.exr" in named[0] and "t.0003.exr" in named[1], result
    assert [bool(frame["failures"]) for frame in report["frames"]] == [False, True, True]
    assert tool.lacuna("compare", *pair, "--fail-below", "psnr", ok=False).status == 2
    assert tool.lacuna("compare", *pair, "--peak", "0", ok=False).status == 2
    (tmp_path / "t.0002.exr").write_bytes(b"no frame")
    report, result = compare(*pair, tmp_path, ok=False)
    assert result.status == 1 and report["frames"][1]["error"] and report["frames"][2]["groups"], result


def test_a_mask_that_was_left_out_is_missed(tmp_path):
    rows, columns = np.indices((16, 16)).astype(np.float32)
    complete = frames.write(tmp_path / "r.exr", {"R": rows / 16})
    sparse = frames.write(tmp_path / "in.exr", {"R": rows / 16, "mask": (rows + columns) % 2})
    for flags, said in ((["--drop-mask"], True), ([], False)):
        tool.quick_fill(sparse, "-o", tmp_path / "t.exr", *flags)
        report, result = compare(complete, tmp_path / "t.exr", tmp_path)
        regions = [region["region"] for region in report["frames"][0]["groups"][0]["regions"]]
        lines = [line for line in result.lines() if "left out of the file by --drop-mask" in line]
        assert (len(lines) == 1, "missing" in regions) == (said, not said), result
        assert bool(report["frames"][0]["notes"]) == said
        _, named = compare(complete, tmp_path / "t.exr", tmp_path, "--mask", f"file:{sparse}:mask")
        assert "left out" not in named.stderr


@pytest.mark.parametrize("gate", ["compare", "verify"])
def test_nothing_passes_by_absence(gate, tmp_path):
    pair = (tmp_path / "r.####.exr", tmp_path / "t.####.exr")
    result = tool.lacuna(gate, "-q", *pair, "--frames", "1-4", "--missing-frame", "skip", ok=False)
    (line,) = result.lines()
    assert result.status == 1 and line.startswith(f"lacuna: error: no frame was {'compared' if gate == 'compare' else 'verified'}"), result
    # One of them is enough; then all of the progress is made, too.
    flags = np.indices((8, 9)).sum(0) % 2
    frames.write(tmp_path / "r.0002.exr", {"R": np.ones((8, 9), np.float32), "mask": flags.astype(np.float32)})
    tool.quick_fill(tmp_path / "r.0002.exr", "-o", tmp_path / "t.0002.exr")
    result = tool.lacuna(gate, *pair, "--frames", "1-4", "--missing-frame", "skip")
    assert "Progress: 100%" in result.stderr, result


def test_every_format_has_the_same_numbers(tmp_path):
    sequence(tmp_path, 2)
    for path in tmp_path.glob("t.*"):
        channels = frames.read(path)[0]
        frames.write(path, channels | {"mask": (np.indices((40, 50)).sum(0) % 2).astype(np.float32)})
    files = {name: tmp_path / f"out.{name}" for name in ("csv", "md", "html")}
    words = [word for name, path in files.items() for word in (f"--{name}", path)]
    report, result = compare(tmp_path / "r.####.exr", tmp_path / "t.####.exr", tmp_path, *words)
    rows = list(csv.DictReader(files["csv"].open(newline="")))
    found = [float(row["psnr"]) for row in rows if row["channels"] == "R G B" and row["region"] == "all"]
    assert found == [measures(report, frame=k)["psnr"] for k in (0, 1)]
    groups = [group for frame in report["frames"] for group in frame["groups"]]
    assert {row["measured_different"] for row in rows} == {str(group["measured_different"]) for group in groups}
    assert f"{sum(group['measured_different'] for group in groups)} values whose bits differ" in result.stdout
    assert files["md"].read_text() == result.stdout
    for value in found:
        assert f"{value:.2f}" in result.stdout and f"{value:.2f}" in files["html"].read_text()


def test_every_format_names_what_misses_the_gate(tmp_path):
    sequence(tmp_path, 2)
    files = {name: tmp_path / f"out.{name}" for name in ("csv", "md", "html", "json")}
    words = [word for name, path in files.items() for word in (f"--{name}", path)]
    words += ["--fail-below", "psnr=40,ssim=0.5"]
    assert tool.lacuna("compare", tmp_path / "r.####.exr", tmp_path / "t.####.exr", *words, ok=False).status == 1
    failures = {frame["frame"]: "; ".join(frame["failures"]) for frame in json.loads(files["json"].read_text())["frames"]}
    assert any(failures.values()), failures
    rows = list(csv.DictReader(files["csv"].open(newline="")))
    assert {int(row["frame"]): row["failures"] for row in rows} == failures
    for failure in filter(None, failures.values()):
        assert failure in files["md"].read_text() and failure in files["html"].read_text(), failure


def test_a_report_on_standard_output_takes_the_place_of_the_tables(tmp_path):
    sequence(tmp_path, 2)
    words = ["compare", tmp_path / "r.####.exr", tmp_path / "t.####.exr"]
    tables = tool.lacuna(*words, folder=tmp_path).stdout
    assert tool.lacuna(*words, "--md", "-", folder=tmp_path).stdout == tables
    assert len(json.loads(tool.lacuna(*words, "--json", "-", folder=tmp_path).stdout)["frames"]) == 2
    rows = list(csv.DictReader(tool.lacuna(*words, "-q", "--csv", "-", folder=tmp_path).stdout.splitlines()))
    assert {row["region"] for row in rows} >= {"all"}
    assert tool.lacuna(*words, "--html", "-", folder=tmp_path).stdout.lower().startswith("<!doctype html>")
    for flags in (["--csv", "-", "--md", "-"], ["--json", "-", "--html", "-"], ["--csv", "r", "--md", "r"], ["--csv", "-", "--progress", "openjd"]):
        refused = tool.lacuna(*words, *flags, ok=False, folder=tmp_path)
        assert refused.status == 2 and len(refused.lines()) == 1, refused
    assert not (tmp_path / "-").exists() and not (tmp_path / "r").exists()


def test_maps_hold_the_errors(tmp_path):
    one, other = hdr_pair()
    paths = [frames.write(tmp_path / f"{k}.exr", dict(zip("RGB", np.moveaxis(image, -1, 0)))) for k, image in enumerate((one, other))]
    compare(*paths, tmp_path, "--maps", tmp_path / "maps")
    maps = frames.read(tmp_path / "maps" / "1.maps.exr")[0]
    assert np.array_equal(maps["error.G"], np.abs(other[..., 1] - one[..., 1]))
    assert set(maps) == {f"{kind}.{c}" for kind in ("error", "ssim") for c in "RGB"} | {"cieluv", "flip"}
    found = sorted(path.name for path in (tmp_path / "maps").glob("*.png"))
    assert found == [f"1.RGB.{kind}.png" for kind in ("cieluv", "error", "flip", "ssim")]


def test_light_beyond_white_is_seen_by_no_clipped_measure(tmp_path):
    light = 1.5 + np.random.default_rng(3).random((40, 50, 3)).astype(np.float32)
    pair = [frames.write(tmp_path / f"{k}.exr", dict(zip("RGB", np.moveaxis(light * by, -1, 0)))) for k, by in enumerate((1, 10))]
    for measure in ("cieluv", "flip"):
        report, _ = compare(*pair, tmp_path, "--fail-above", f"{measure}=0.5", ok=False)
        assert "which no bound sees" in " ".join(report["frames"][0]["failures"]), measure
    # On the scale of the peak both see it.
    report, _ = compare(*pair, tmp_path, "--peak", 30, "--measures", "cieluv")
    assert measures(report)["cieluv"] > 20
    scaled = [frames.write(tmp_path / f"s{k}.exr", dict(zip("RGB", np.moveaxis(light * np.float32(by / 30), -1, 0)))) for k, by in enumerate((1, 10))]
    assert measures(compare(*scaled, tmp_path, "--measures", "cieluv")[0])["cieluv"] == pytest.approx(measures(report)["cieluv"], rel=1e-4)


def test_what_is_missing_says_what_it_is(tmp_path):
    sequence(tmp_path, 2)
    (tmp_path / "t.0002.exr").unlink()
    words = ["compare", tmp_path / "r.####.exr", tmp_path / "t.####.exr", "--missing-frame", "skip"]
    result = tool.lacuna(*words, "-q", ok=False)
    assert result.status == 1 and "the test image does not exist" in result.stderr, result
    (tmp_path / "r.0002.exr").unlink()
    page = tmp_path / "page.html"
    tool.lacuna(*words, "--frames", "1-2", "--fail-below", "psnr=1", "--html", page)
    assert "1 frame passes, 1 skipped: psnr &gt;= 1" in page.read_text()


def test_an_input_is_never_overwritten(tmp_path):
    sequence(tmp_path, 1)
    reference, test = tmp_path / "r.0001.exr", tmp_path / "t.0001.exr"
    before = test.read_bytes()
    assert tool.lacuna("compare", reference, test, "--csv", test, ok=False).status == 2
    assert test.read_bytes() == before


def test_pairs_without_missing_pixels_flicker_by_all(tmp_path):
    errors = sequence(tmp_path)
    for number in range(1, 4):
        planes = frames.read(tmp_path / f"t.{number:04}.exr")[0]
        frames.write(tmp_path / f"t.{number:04}.exr", planes | {"mask": np.ones((40, 50), np.float16)})
    report, _ = compare(tmp_path / "r.####.exr", tmp_path / "t.####.exr", tmp_path, "--fail-above", "flicker=1")
    region = lambda frame: "missing" if any(r["region"] == "missing" for r in report["frames"][frame]["groups"][0]["regions"]) else "all"
    for frame in (1, 2):
        truth = np.sqrt(np.mean((errors[frame] - errors[frame - 1]) ** 2))
        assert measures(report, region(frame), frame=frame)["flicker"] == pytest.approx(truth, rel=1e-5)
    # Frames that are the same do not flicker.
    for number in range(1, 4):
        (tmp_path / f"r.{number:04}.exr").write_bytes((tmp_path / f"t.{number:04}.exr").read_bytes())
    compare(tmp_path / "r.####.exr", tmp_path / "t.####.exr", tmp_path, "--fail-above", "flicker=0", "--fail-above", "missing.flicker=0")


def test_a_cut_has_no_motion_and_the_gate_says_so(tmp_path):
    sequence(tmp_path)
    for name in ("r", "t"):
        noise = np.random.default_rng(5).random((40, 50)).astype(np.float32)
        frames.write(tmp_path / f"{name}.0004.exr", dict.fromkeys("RGB", noise))
    pair = (tmp_path / "r.####.exr", tmp_path / "t.####.exr")
    report, _ = compare(*pair, tmp_path, "--fail-above", "flicker-along=1", ok=False)
    failures = [frame["failures"] for frame in report["frames"]]
    assert failures[:3] == [[], [], []] and "motion since the frame before is not known, as beyond a cut" in failures[3][0]


def test_no_frame_waits_for_one_that_does_not_come(tmp_path):
    noise = np.random.default_rng(5).random((500, 500)).astype(np.float32)
    for number in range(1, 41, 2):
        for name in ("r", "t"):
            frames.write(tmp_path / f"{name}.{number:04}.exr", dict.fromkeys("RGB", noise))
    words = ["compare", tmp_path / "r.####.exr", tmp_path / "t.####.exr", "--measures", "flicker", "--missing-frame", "skip", "--threads", "1"]
    few, many = (tool.lacuna(*words, "--frames", last).peak_bytes for last in ("1-6", "1-40"))
    print(f"{few / 1e6:.0f} MB, {many / 1e6:.0f} MB")
    assert many < few + 20e6
    # What is kept of three frames counts.
    most = tool.lacuna(*words, "--frames", "1-6", "--memory", "80M", ok=False)
    assert most.status == 1 and "more than the bound" in most.stderr
    tool.lacuna("compare", *words[1:3], "--missing-frame", "skip", "--frames", "1-6", "--memory", "80M")


def test_progress_ends_with_the_work(tmp_path):
    sequence(tmp_path)
    result = tool.lacuna("compare", tmp_path / "r.####.exr", tmp_path / "t.####.exr", "--measures", "flicker", "--progress", "plain")
    told = [line for line in result.lines() if line.startswith("Progress: ")]
    assert [int(line.split()[1].rstrip("%")) for line in told] == [100 * step // 12 for step in range(1, 13)]
