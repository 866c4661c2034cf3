"""Noisy pixels: smoothed as far as what is known of their noise asks for, and not where there is none."""

import numpy as np
import OpenEXR
import pytest

import frames
from tool import SAMPLES, lacuna

COMPLETE = SAMPLES / "full" / "sequence" / "shot.0001.exr"
DENSITY = 0.3


def noisy(folder, size=0.1, **more):
    """A sparse frame with two half buffers, and the truth."""
    truth = frames.colour(COMPLETE)
    random = np.random.default_rng(1)
    halves = [truth + np.float32(size * np.sqrt(2)) * random.standard_normal(truth.shape).astype(np.float32) for _ in range(2)]
    mask = frames.shuffle(*truth.shape[:2], DENSITY)
    planes = {"mask": mask.astype(np.float32)}
    for layer, image in (("", (halves[0] + halves[1]) * np.float32(0.5)), ("half1.", halves[0]), ("half2.", halves[1])):
        planes |= {layer + name: np.where(mask, image[..., k], np.float32(0)) for k, name in enumerate("RGB")}
    return frames.write(folder / "noisy.exr", planes | more), truth


def error(path, truth):
    return float(np.sqrt(np.mean((frames.colour(path).astype(np.float64) - truth) ** 2)))


@pytest.mark.parametrize("noise", ["halves:half1,half2", "auto", "variance:v"])
def test_noise_is_smoothed(tmp_path, noise):
    source, truth = noisy(tmp_path, v=np.full(frames.colour(COMPLETE).shape[:2], 0.01, np.float32))
    lacuna("fill", source, "-o", tmp_path / "plain.exr", "--filter", "ss", "--no-estimate", "--guides", "none")
    result = lacuna("fill", source, "-o", tmp_path / "smooth.exr", "--noise", noise, "--no-estimate", "--guides", "none")
    assert error(tmp_path / "smooth.exr", truth) < 0.7 * error(tmp_path / "plain.exr", truth)
    assert "measured pixels are smoothed" in result.stderr
    # What tells the noise has none to smooth by, and is filled as without.
    lacuna("fill", source, "-o", tmp_path / "plain.exr", "--no-estimate", "--guides", "none")
    [plain], [after] = frames.read(tmp_path / "plain.exr"), frames.read(tmp_path / "smooth.exr")
    for name in ["v"] if noise == "variance:v" else [f"half{k}.{name}" for k in (1, 2) for name in "RGB"]:
        assert np.allclose(plain[name], after[name], atol=1e-6), name


@pytest.mark.parametrize("noise", ["variance:variance", "auto"])
def test_the_only_colour_of_a_variance_serves_all(tmp_path, noise):
    """Grey stays grey."""
    truth = frames.colour(COMPLETE)[..., 1]
    mask, random = frames.shuffle(*truth.shape, DENSITY), np.random.default_rng(1)
    grey = np.where(mask, truth + random.normal(0, 0.1, truth.shape), 0).astype(np.float32)
    planes = dict.fromkeys("RGB", grey) | {"mask": mask.astype(np.float32), "variance.R": np.where(mask, np.float32(0.01), np.float32(0))}
    source = frames.write(tmp_path / "grey.exr", planes)
    result = lacuna("fill", source, "-o", tmp_path / "smooth.exr", "--noise", noise, "--no-estimate")
    assert "B, G: smoothed by variance.R, the only colour of its layer" in result.stderr
    [out] = frames.read(tmp_path / "smooth.exr")
    assert np.abs(out["R"] - out["G"]).max() < 1e-3 and np.abs(out["R"] - out["B"]).max() < 1e-3


def test_smoothed_colour_stays_within_its_alpha(tmp_path):
    truth = frames.colour(COMPLETE) + np.float32(0.2)
    rows, columns = np.indices(truth.shape[:2])
    disc = np.hypot(rows - truth.shape[0] / 2, columns - truth.shape[1] / 2) < truth.shape[0] / 3
    random = np.random.default_rng(1)
    halves = [np.where(disc[..., None], truth + np.float32(0.3) * random.standard_normal(truth.shape).astype(np.float32), np.float32(0)) for _ in range(2)]
    mask = frames.shuffle(*truth.shape[:2], DENSITY)
    planes = {"mask": mask.astype(np.float32), "A": np.where(mask & disc, np.float32(1), np.float32(0))}
    for layer, image in (("", (halves[0] + halves[1]) * np.float32(0.5)), ("half1.", halves[0]), ("half2.", halves[1])):
        planes |= {layer + name: np.where(mask, image[..., k], np.float32(0)) for k, name in enumerate("RGB")}
    source = frames.write(tmp_path / "noisy.exr", planes)
    result = lacuna("fill", source, "-o", tmp_path / "smooth.exr", "--noise", "auto", "--no-estimate")
    assert "measured pixels are smoothed" in result.stderr
    [out] = frames.read(tmp_path / "smooth.exr")
    assert all((out[name][out["A"] == 0] == 0).all() for name in "RGB")
    assert (out["R"][mask & ~disc] == 0).all() and (out["A"][mask & ~disc] == 0).all()
    # Light without alpha is somebody's wish.
    frames.write(source, planes | {"R": np.where(mask & ~disc, np.float32(0.05), planes["R"])})
    lacuna("fill", source, "-o", tmp_path / "smooth.exr", "--noise", "auto", "--no-estimate", "--force")
    [out] = frames.read(tmp_path / "smooth.exr")
    assert (out["R"][out["A"] == 0] > 0).mean() > 0.9


def test_a_frame_without_noise_keeps_its_bits(tmp_path):
    truth = frames.colour(COMPLETE)
    source = frames.write_sparse(tmp_path / "in.exr", truth, frames.shuffle(*truth.shape[:2], DENSITY))
    flags = ["--filter", "ss", "--no-estimate"]
    lacuna("fill", source, "-o", tmp_path / "plain.exr", *flags)
    result = lacuna("fill", source, "-o", tmp_path / "out.exr", "--noise", "auto", *flags)
    assert "no noise that could be told from detail, and nothing is smoothed" in result.stderr
    [plain], [out] = frames.read(tmp_path / "plain.exr"), frames.read(tmp_path / "out.exr")
    assert all(frames.same_bits(plain[name], out[name]) for name in "RGB")


def test_what_is_no_noise_is_refused(tmp_path):
    source, truth = noisy(tmp_path)
    [planes] = frames.read(source)
    flat = {"v": np.zeros(truth.shape[:2], np.float32), "w": np.full(truth.shape[:2], -1, np.float32)}
    cases = [
        (planes | {f"half2.{name}": planes[f"half1.{name}"] for name in "RGB"}, "halves:half1,half2", "are the same"),
        (planes | {f"half2.{name}": 2 * planes[f"half1.{name}"] for name in "RGB"}, "halves:half1,half2", "do not average to"),
        (planes | {f"half{k}.{name}": np.full_like(planes["R"], np.nan) for k in (1, 2) for name in "RGB"}, "halves:half1,half2", "not finite at any"),
        (planes, "halves:a,b", "no such layer"),
        (planes, "variance:R", "a colour, no variance"),
        (planes | flat, "variance:v", "nowhere above 0"),
        (planes | flat, "variance:w", "no variance"),
        (planes, "count:n", "no such channel"),
    ]
    for number, (channels, noise, words) in enumerate(cases):
        path = frames.write(tmp_path / f"{number}.exr", channels)
        result = lacuna("fill", path, "-o", tmp_path / "out.exr", "--noise", noise, "-q", ok=False)
        assert result.status == 1 and words in result.stderr and len(result.lines()) <= 2, result
        assert not (tmp_path / "out.exr").exists()
    for flags in (["--noise", "half1"], ["--noise", "auto", "--ss-lambda", "1"]):
        assert lacuna("fill", source, "-o", tmp_path / "out.exr", *flags, ok=False).status == 2


def test_what_has_no_noise_in_one_colour_or_at_all_is_no_mistake(tmp_path):
    """A colour that is black in both halves, as in a fade."""
    source, truth = noisy(tmp_path)
    [planes] = frames.read(source)
    black = {layer + "B": np.zeros_like(planes["B"]) for layer in ("", "half1.", "half2.")}
    path = frames.write(tmp_path / "blue.exr", planes | black)
    for flags in (["--noise", "auto"], ["--noise", "halves:half1,half2"], ["--filter", "ss", "--ss-lambda", "auto"]):
        lacuna("fill", path, "-o", tmp_path / "out.exr", "--force", *flags, "--no-estimate")
        [out] = frames.read(tmp_path / "out.exr")
        assert not out["B"].any() and out["R"].std() > 0
    path = frames.write(tmp_path / "black.exr", {name: plane if name == "mask" else np.zeros_like(plane) for name, plane in planes.items()})
    lacuna("fill", path, "-o", tmp_path / "out.exr", "--force", "--noise", "halves:half1,half2")
    [out] = frames.read(tmp_path / "out.exr")
    assert not any(out[name].any() for name in "RGB")


def test_auto_ignores_what_tells_no_noise(tmp_path):
    source, truth = noisy(tmp_path)
    [planes] = frames.read(source)
    alone = {name: plane for name, plane in planes.items() if not name.startswith("half")}
    lacuna("fill", frames.write(tmp_path / "alone.exr", alone), "-o", tmp_path / "expected.exr", "--noise", "auto", "--no-estimate")
    [expected] = frames.read(tmp_path / "expected.exr")
    variance = {f"variance.{name}": np.full_like(planes["R"], np.inf) for name in "RGB"}
    cases = [
        (planes | {f"half2.{name}": planes[f"half1.{name}"] for name in "RGB"}, "same: ignored"),
        (planes | {f"half2.{name}": 2 * planes[f"half1.{name}"] for name in "RGB"}, "average to B: ignored"),
        (alone | variance, "nowhere above 0 and finite at measured pixels: ignored"),
    ]
    for number, (channels, words) in enumerate(cases):
        path = frames.write(tmp_path / f"{number}.exr", channels)
        result = lacuna("fill", path, "-o", tmp_path / f"out{number}.exr", "--noise", "auto", "--no-estimate")
        [out] = frames.read(tmp_path / f"out{number}.exr")
        assert words in result.stderr and all(frames.same_bits(out[name], expected[name]) for name in "RGB"), result.stderr
    # A variance of one layer tells nothing of another.
    albedo = {f"albedo.{name}": planes[name] for name in "RGB"} | {"variance": np.full_like(planes["R"], 0.01)}
    path = frames.write(tmp_path / "layers.exr", alone | albedo)
    result = lacuna("fill", path, "-o", tmp_path / "layers.out.exr", "--filter", "ss", "--ss-lambda", "auto", "--no-estimate")
    [colour], [other] = ([line for line in result.stderr.splitlines() if f"chosen for {name}" in line] for name in ("R", "albedo.R"))
    assert colour.endswith("by known noise") and other.endswith("by generalised cross-validation")


def test_a_bad_pixel_of_a_half_changes_nothing_elsewhere(tmp_path):
    """As where a renderer clamps fireflies in the colour and not in its halves."""
    source, truth = noisy(tmp_path)
    [planes] = frames.read(source)
    row, column = np.argwhere(planes["mask"] > 0)[100]
    planes["half1.R"][row, column] = 60000
    path = frames.write(tmp_path / "bad.exr", planes)
    for number, flags in enumerate((["--noise", "auto"], ["--filter", "ss", "--ss-lambda", "auto"], ["--filter", "tv", "--tv-epsilon", "auto"])):
        for name, frame in (("good", source), ("bad", path)):
            lacuna("fill", frame, "-o", tmp_path / f"{name}{number}.exr", "--force", *flags, "--no-estimate", "--domain", "linear")
        good, bad = (error(tmp_path / f"{name}{number}.exr", truth) for name in ("good", "bad"))
        assert bad < 1.02 * good


def test_fireflies_are_left_out_where_smoothness_is_chosen(tmp_path):
    source, truth = noisy(tmp_path)
    lacuna("fill", source, "-o", tmp_path / "good.exr", "--filter", "ss", "--ss-lambda", "auto", "--no-estimate", "--domain", "linear")
    [planes] = frames.read(source)
    for row, column in np.argwhere(planes["mask"] > 0)[::500]:
        for name in "RGB":
            planes[f"half1.{name}"][row, column] += 40
            planes[name][row, column] += 20
    path = frames.write(tmp_path / "bad.exr", planes)
    lacuna("fill", path, "-o", tmp_path / "bad.out.exr", "--filter", "ss", "--ss-lambda", "auto", "--no-estimate", "--domain", "linear")
    # One sample of 500 is lost to its limit, which lies within a few times the light.
    assert error(tmp_path / "bad.out.exr", truth) < 2 * error(tmp_path / "good.exr", truth)


def test_names_that_renderers_write_are_found(tmp_path):
    source, _ = noisy(tmp_path)
    [planes] = frames.read(source)
    beauty = {f"beauty.{name}" if name in "RGB" else name: plane for name, plane in planes.items()}
    path = frames.write(tmp_path / "beauty.exr", beauty)
    lacuna("fill", path, "-o", tmp_path / "beauty.out.exr", "--filter", "ss", "--noise", "auto", "--no-estimate")
    lacuna("fill", source, "-o", tmp_path / "plain.out.exr", "--filter", "ss", "--noise", "auto", "--no-estimate")
    [found], [expected] = frames.read(tmp_path / "beauty.out.exr"), frames.read(tmp_path / "plain.out.exr")
    assert all(frames.same_bits(found[f"beauty.{name}"], expected[name]) for name in "RGB")
    alone = {name: plane for name, plane in planes.items() if not name.startswith("half")}
    alone |= {f"Variance.{name}": np.full_like(planes["R"], 0.01) for name in "RGB"}
    path = frames.write(tmp_path / "variance.exr", alone)
    result = lacuna("fill", path, "-o", tmp_path / "variance.out.exr", "--filter", "ss", "--ss-lambda", "auto", "--no-estimate")
    assert "by known noise" in result.stderr


def test_what_was_smoothed_before_is_told(tmp_path):
    source, _ = noisy(tmp_path)
    lacuna("fill", source, "-o", tmp_path / "once.exr", "--noise", "auto", "--no-estimate")
    result = lacuna("fill", tmp_path / "once.exr", "-o", tmp_path / "twice.exr", "--again")
    assert "measured pixels were smoothed when it was filled before" in result.stderr
    result = lacuna("fill", tmp_path / "once.exr", "-o", tmp_path / "gate.exr", "--again", "--min-psnr", "1", ok=False)
    assert result.status == 1 and not (tmp_path / "gate.exr").exists()


def test_half_buffers_that_lack_a_colour_are_told(tmp_path):
    source, _ = noisy(tmp_path)
    [planes] = frames.read(source)
    del planes["half2.G"]
    path = frames.write(tmp_path / "in.exr", planes)
    result = lacuna("fill", path, "-o", tmp_path / "out.exr", "--noise", "halves:half1,half2", "--no-estimate")
    assert "G: --noise halves:half1,half2 has nothing for it" in result.stderr


def test_none_keeps_half_buffers_out(tmp_path):
    source, _ = noisy(tmp_path)
    result = lacuna("fill", source, "-o", tmp_path / "out.exr", "--filter", "ss", "--ss-lambda", "auto", "--noise", "none", "--no-estimate")
    assert "by generalised cross-validation" in result.stderr and "known noise" not in result.stderr
    assert b"noise=none" in (tmp_path / "out.exr").read_bytes()[:4000]


def test_the_error_of_what_is_smoothed_cannot_be_told(tmp_path):
    source, _ = noisy(tmp_path)
    for number, flags in enumerate((["--noise", "auto"], ["--filter", "ss", "--ss-lambda", "auto"], ["--filter", "ss", "--ss-lambda", "1"])):
        out = tmp_path / f"{number}.exr"
        result = lacuna("fill", source, "-o", out, "--guides", "none", *flags, "--min-psnr", "1", ok=False)
        assert result.status == 1 and out.exists() and "cannot be told: measured pixels are smoothed" in result.stderr
        result = lacuna("fill", source, "-o", out, "--force", "--guides", "none", *flags, "--error-channel")
        assert "no estimated errors: measured pixels are smoothed" in result.stderr


@pytest.mark.parametrize("guided", [False, True])
def test_pixels_that_count_no_sample_are_missing(tmp_path, guided):
    truth = frames.colour(COMPLETE)
    random = np.random.default_rng(3)
    image = truth + np.float32(0.1) * random.standard_normal(truth.shape).astype(np.float32)
    mask = frames.shuffle(*truth.shape[:2], 0.5)
    counts = mask & (random.random(mask.shape) < 0.6)
    more = {"N." + name: truth[..., k] for k, name in enumerate("XYZ")} if guided else {}

    def fill(name, flags, measured, samples):
        planes = {channel: np.where(measured, samples[..., k], np.float32(0)) for k, channel in enumerate("RGB")}
        planes |= {"mask": measured.astype(np.float32), "n": np.where(counts, np.float32(16), np.float32(0))}
        path = frames.write(tmp_path / f"{name}.exr", planes | more)
        # What is named as a count is kept, whatever its name.
        words = [] if flags == "count:n" else ["--channels", "n=keep"]
        result = lacuna("fill", path, "-o", tmp_path / f"{name}.out.exr", "--noise", flags, "--no-estimate", *words)
        [out] = frames.read(tmp_path / f"{name}.out.exr")
        assert frames.same_bits(out["n"], planes["n"])
        return result, np.stack([out[channel] for channel in "RGB"], -1)

    garbage = np.where(counts[..., None], image, np.float32(9))
    result, found = fill("counted", "count:n", mask, garbage)
    assert "count no sample and are filled like missing ones" in result.stderr
    _, expected = fill("dropped", "auto", counts, image)
    assert np.allclose(found, expected, atol=1e-4)


@pytest.mark.parametrize(("name", "setting", "flag"), [("ss", "lambda", "--ss-lambda"), ("tv", "epsilon", "--tv-epsilon")])
@pytest.mark.parametrize("halves", [True, False])
def test_how_much_to_smooth_is_chosen(tmp_path, name, setting, flag, halves):
    source, truth = noisy(tmp_path)
    if not halves:
        [planes] = frames.read(source)
        source = frames.write(tmp_path / "alone.exr", {n: plane for n, plane in planes.items() if not n.startswith("half")})
    flags = ["--filter", name, "--no-estimate", "--domain", "linear"]
    lacuna("fill", source, "-o", tmp_path / "plain.exr", *flags)
    result = lacuna("fill", source, "-o", tmp_path / "out.exr", *flags, flag, "auto")
    by = "known noise" if halves else "generalised cross-validation"
    [line] = [line for line in result.stderr.splitlines() if f"for R, G, B: {setting}=" in line]
    assert line.endswith(f"by {by}"), line
    assert error(tmp_path / "out.exr", truth) < 0.7 * error(tmp_path / "plain.exr", truth)
    header = (tmp_path / "out.exr").read_bytes()[:4000]
    assert b"lacuna/settled" in header and f"{setting}={line.split(f'{setting}=')[1]}".encode() in header, header
    # The number that was chosen gives the same image.
    value = line.split(f"{setting}=")[1].split(" by ")[0]
    lacuna("fill", source, "-o", tmp_path / "again.exr", *flags, flag, value)
    [out], [again] = frames.read(tmp_path / "out.exr"), frames.read(tmp_path / "again.exr")
    assert all(np.allclose(out[n], again[n], atol=1e-5) for n in "RGB")
    if name == "tv" and halves:
        # The root of the summed squares of half the difference: noise of a tenth.
        assert abs(float(value) / (0.1 * np.sqrt(DENSITY * truth[..., 0].size)) - 1) < 0.05


def test_auto_is_one_of_the_values(tmp_path):
    source, _ = noisy(tmp_path)
    result = lacuna("fill", source, "-o", tmp_path / "out.exr", "--filter", "ss", "--ss-lambda", "x", ok=False)
    assert result.status == 2 and "a number of 0 or more, or auto" in result.stderr


def test_smoothed_normals_are_of_unit_length(tmp_path):
    rows, columns = np.indices((64, 64))
    random = np.random.default_rng(4)
    truth = np.stack([0.5 * np.sin(columns / 15), 0.5 * np.cos(rows / 15), np.ones((64, 64))], axis=-1)
    unit = lambda vectors: vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    normals = unit(unit(truth) + random.normal(0, 0.1, truth.shape)).astype(np.float32)
    mask = frames.shuffle(64, 64, 0.5)
    planes = {"mask": mask.astype(np.float32)} | {name: np.where(mask, np.float32(0.5), np.float32(0)) for name in "RGB"}
    planes |= {f"N.{name}": np.where(mask, normals[..., k], np.float32(0)) for k, name in enumerate("XYZ")}
    variance = {f"N.variance.{name}": np.full((64, 64), 0.01, np.float32) for name in "XYZ"}
    out = tmp_path / "out.exr"
    for known in ({}, variance):
        source = frames.write(tmp_path / "in.exr", planes | known)
        lacuna("fill", source, "-o", out, "--noise", "auto", "--no-estimate", "--force")
        [filled] = frames.read(out)
        lengths = np.sqrt(sum(filled[f"N.{name}"].astype(np.float64) ** 2 for name in "XYZ"))
        assert np.abs(lengths - 1).max() < 1e-6
        # Where nothing tells their noise they keep their bits.
        assert frames.same_bits(filled["N.X"][mask], planes["N.X"][mask]) == (not known)
        lacuna("verify", source, out)
    # A smoothed one of another length is found.
    file = OpenEXR.File(str(out), separate_channels=True)
    file.parts[0].channels["N.Z"].pixels[tuple(np.argwhere(mask)[50])] *= np.float32(1.01)
    file.write(str(tmp_path / "longer.exr"))
    result = lacuna("verify", source, tmp_path / "longer.exr", ok=False)
    assert result.status == 1 and "unit length" in result.stdout + result.stderr, result


def test_a_measured_lamp_keeps_its_light(tmp_path):
    rows, columns = np.indices((64, 64))
    lamp = np.hypot(rows - 32, columns - 32) < 7
    random = np.random.default_rng(11)
    halves = [np.where(lamp, 10 + random.normal(0, 2, lamp.shape), 0.2 + random.normal(0, 0.05, lamp.shape)).astype(np.float32) for _ in range(2)]
    mask = frames.shuffle(64, 64, 0.5)
    planes = {"mask": mask.astype(np.float32)}
    for layer, image in (("", (halves[0] + halves[1]) * np.float32(0.5)), ("half1.", halves[0]), ("half2.", halves[1])):
        planes |= {layer + name: np.where(mask, image, np.float32(0)) for name in "RGB"}
    source = frames.write(tmp_path / "lamp.exr", planes)
    lacuna("fill", source, "-o", tmp_path / "out.exr", "--noise", "auto", "--no-estimate")
    [out] = frames.read(tmp_path / "out.exr")
    assert frames.same_bits(out["R"][mask & lamp], planes["R"][mask & lamp])


@pytest.mark.parametrize("layers", [["variance"], ["half1", "half2"]])
def test_noise_that_is_unknown_in_a_part_is_taken_as_that_of_others(tmp_path, layers):
    """Not as none, with weights of a thousand."""
    source, truth = noisy(tmp_path)
    [planes] = frames.read(source)
    if layers == ["variance"]:
        planes = {name: plane for name, plane in planes.items() if not name.startswith("half")}
        planes |= {f"variance.{name}": np.full_like(planes["R"], 0.01) for name in "RGB"}
    middle = truth.shape[1] // 2
    errors = []
    for value in (None, np.nan, np.inf):
        for name in [] if value is None else [f"{layers[-1]}.{name}" for name in "RGB"]:
            planes[name][:, middle:] = value
        path = frames.write(tmp_path / "in.exr", planes)
        result = lacuna("fill", path, "-o", tmp_path / "out.exr", "--noise", "auto", "--no-estimate", "--force", "--guides", "none")
        errors.append(float(np.sqrt(np.mean((frames.colour(tmp_path / "out.exr")[:, middle:] - truth[:, middle:]) ** 2))))
        unknown = int((planes["mask"][:, middle:] > 0).sum())
        assert (f"the noise of {unknown} of" in result.stderr) == (value is not None), result.stderr
    assert max(errors) < 1.2 * errors[0], errors
