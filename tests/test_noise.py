"""Noisy pixels: smoothed as far as what is known of their noise asks for, and not where there is none."""

import numpy as np
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
    if noise != "variance:v":
        [before], [after] = frames.read(source), frames.read(tmp_path / "smooth.exr")
        assert frames.same_bits(before["half1.R"], after["half1.R"])


def test_a_frame_without_noise_keeps_its_bits(tmp_path):
    truth = frames.colour(COMPLETE)
    source = frames.write_sparse(tmp_path / "in.exr", truth, frames.shuffle(*truth.shape[:2], DENSITY))
    flags = ["--filter", "ss", "--no-estimate"]
    lacuna("fill", source, "-o", tmp_path / "plain.exr", *flags)
    result = lacuna("fill", source, "-o", tmp_path / "out.exr", "--noise", "auto", *flags)
    assert "no noise, and nothing is smoothed" in result.stderr
    [plain], [out] = frames.read(tmp_path / "plain.exr"), frames.read(tmp_path / "out.exr")
    assert all(frames.same_bits(plain[name], out[name]) for name in "RGB")


def test_what_is_no_noise_is_refused(tmp_path):
    source, truth = noisy(tmp_path)
    [planes] = frames.read(source)
    flat = {"v": np.zeros(truth.shape[:2], np.float32), "w": np.full(truth.shape[:2], -1, np.float32)}
    cases = [
        (planes | {f"half2.{name}": planes[f"half1.{name}"] for name in "RGB"}, "halves:half1,half2", "are the same"),
        (planes | {f"half2.{name}": 2 * planes[f"half1.{name}"] for name in "RGB"}, "halves:half1,half2", "do not average to"),
        (planes, "halves:a,b", "no such layer"),
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
    [line] = [line for line in result.stderr.splitlines() if f"{setting}=" in line]
    assert f"{setting}=" in line and line.endswith(f"by {by}"), line
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
