"""The filter that held-out samples choose, and the error that a fill is estimated to have: figures, channel, gate."""

import json
import math

import numpy as np
import OpenImageIO as oiio
import pytest

import frames
from tool import SAMPLES, lacuna

COMPLETE = SAMPLES / "full" / "sequence" / "shot.0001.exr"


def read(path, *names):
    image = oiio.ImageBuf(str(path))
    channels = list(image.spec().channelnames)
    return image.get_pixels(oiio.FLOAT)[..., [channels.index(name) for name in names]]


def sparse(folder, source=COMPLETE, density=0.2):
    path = folder / f"sparse-{source.stem}.exr"
    lacuna("sparsify", source, "-o", path, "--density", density)
    return path


def fill(folder, source, *flags, status=0):
    output, report = folder / "full.exr", folder / "report.json"
    output.unlink(missing_ok=True)
    result = lacuna("fill", source, "-o", output, "--json", report, *flags, ok=False)
    assert result.status == status, result
    return output, json.loads(report.read_text())["frames"][0], result


def most(told):
    return told["rmse"]["high"] if "rmse" in told else told["rmse_at_most"]


def true_error(output, source, mask_of, complete=COMPLETE, names="RGB"):
    missing = read(mask_of, "mask")[..., 0] < 0.5
    difference = read(output, *names).clip(0, 1) - read(complete, *names).clip(0, 1)
    return math.sqrt(float((difference[missing].astype(np.float64) ** 2).mean()))


@pytest.mark.parametrize("flags", [[], ["--filter", "ss"], ["--filter", "edge"], ["--filter", "cnn"], ["--filter", "tv"]], ids=["auto", "ss", "edge", "cnn", "tv"])
@pytest.mark.parametrize("density", [0.1, 0.3])
def test_the_estimate_holds_the_truth(tmp_path, flags, density):
    source = sparse(tmp_path, density=density)
    output, record, result = fill(tmp_path, source, "-v", *flags)
    found = next(item for item in record["estimates"] if "R" in item["channels"])
    truth = true_error(output, COMPLETE, source)
    assert found["rmse"]["low"] <= truth <= found["rmse"]["high"], (truth, found)
    assert abs(20 * math.log10(found["rmse"]["estimate"] / truth)) < 4, (truth, found)
    assert "missing pixels by estimate" in result.stderr
    assert "dB" in oiio.ImageBuf(str(output)).spec().getattribute("lacuna/estimate")


# A part of the table of docs/measurements/methods.md: edges, shading, and a texture finer than the samples.
@pytest.mark.parametrize("name", ["ss", "edge", "cnn", "tv", "auto"])
@pytest.mark.parametrize("frame", ["edges", "smooth", "texture", "shot"])
def test_at_even_samples_the_estimate_is_within_two_and_a_half_decibels(tmp_path, frame, name):
    complete = COMPLETE if frame == "shot" else SAMPLES / f"{frame}.exr"
    source = sparse(tmp_path, complete)
    output, record, _ = fill(tmp_path, source, "--filter", name)
    names = "Y" if frame == "texture" else "RGB"
    found = next(item for item in record["estimates"] if names[0] in item["channels"])
    truth = true_error(output, complete, source, complete, names)
    assert found["rmse"]["low"] <= truth <= found["rmse"]["high"], (truth, found)
    assert abs(20 * math.log10(found["rmse"]["estimate"] / truth)) < 2.5, (truth, found)


def test_errors_above_1_are_no_missing_errors(tmp_path):
    y, x = np.mgrid[0:96, 0:128].astype(np.float32)
    light = (1.5 + np.sin(x / 7) * np.cos(y / 6)).astype(np.float32)
    for name, image in (("hidden", 4 * light), ("half", light)):
        complete = frames.write(tmp_path / f"{name}.exr", dict.fromkeys("RGB", image))
        source = sparse(tmp_path, complete, 0.3)
        output, record, result = fill(tmp_path, source, "--filter", "ss", "-v")
        found = next(item for item in record["estimates"] if "R" in item["channels"])
        missing = read(source, "mask")[..., 0] < 0.5
        truth = math.sqrt(np.mean((read(output, "R")[..., 0] - image)[missing].astype(np.float64) ** 2))
        assert 0.5 < found["unclipped_rmse"]["estimate"] / truth < 2, (found, truth)
        assert ("clipped" in found["unknown"]) if name == "hidden" else found["rmse"]["estimate"] > 0
        assert ("no error" not in result.stderr) and (name == "half" or "cannot be told" in result.stderr)
    fill(tmp_path, tmp_path / "sparse-hidden.exr", "--filter", "ss", "--min-psnr", "20", status=1)


def test_another_peak_is_another_white(tmp_path):
    y, x = np.mgrid[0:96, 0:128].astype(np.float32)
    light = (6 + 4 * np.sin(x / 7) * np.cos(y / 6)).astype(np.float32)
    complete = frames.write(tmp_path / "bright.exr", dict.fromkeys("RGB", light))
    source = sparse(tmp_path, complete, 0.3)
    plain, hidden, _ = fill(tmp_path, source, "--filter", "ss")
    pixels = read(plain, "R")
    output, record, result = fill(tmp_path, source, "--filter", "ss", "--peak", 10, "--error-channel", "--min-psnr", 20)
    found, report = record["estimates"][0], tmp_path / "compared.json"
    assert "unknown" in hidden["estimates"][0] and "unclipped_rmse" not in found
    assert abs(found["psnr"]["estimate"] - 20 * math.log10(10 / found["rmse"]["estimate"])) < 1e-6
    lacuna("compare", complete, output, "--peak", 10, "--json", report)
    regions = json.loads(report.read_text())["frames"][0]["groups"][0]["regions"]
    truth = next(region["measures"]["psnr"] for region in regions if region["region"] == "missing")
    assert found["psnr"]["low"] <= truth <= found["psnr"]["high"], (truth, found)
    assert (read(output, "R") == pixels).all() and read(output, "error").max() > 0
    assert "peak=10" in oiio.ImageBuf(str(output)).spec().getattribute("lacuna/settings")
    lacuna("verify", source, output)
    again = lambda *flags: lacuna("fill", source, "-o", output, "--filter", "ss", "--error-channel", "-u", *flags).stderr
    assert "1 skipped" in again("--peak", 10) and "1 of 1 frame filled" in again()


def test_the_white_of_an_alpha_is_always_1(tmp_path):
    y, x = np.mgrid[0:64, 0:64].astype(np.float32)
    light = (50 + 40 * np.sin(x / 7) * np.cos(y / 6)).astype(np.float32)
    alpha = (0.5 + 0.3 * np.sin(x * 1.7) * np.cos(y * 2.1)).astype(np.float32)
    complete = frames.write(tmp_path / "bright.exr", dict.fromkeys("RGB", light) | {"A": alpha})
    source = sparse(tmp_path, complete, 0.3)
    found = []
    for peak in (1, 100):
        output, record, _ = fill(tmp_path, source, "--filter", "ss", "--peak", peak)
        found.append(next(item for item in record["estimates"] if item["channels"] == ["A"]))
        lacuna("verify", source, output)
        report = tmp_path / "compared.json"
        lacuna("compare", complete, output, "--peak", peak, "--json", report)
        group = next(group for group in json.loads(report.read_text())["frames"][0]["groups"] if group["channels"] == ["A"])
        found[-1]["true"] = group["regions"][0]["measures"]["psnr"]
    assert found[0] == found[1] and found[0]["psnr"]["estimate"] < 30, found
    *_, result = fill(tmp_path, source, "--filter", "ss", "--peak", 100, "--min-psnr", 35, status=1)
    assert "A: about" in result.stderr


def test_the_default_chooses_and_is_never_far_behind(tmp_path):
    for source in (COMPLETE, SAMPLES / "edges.exr"):
        mask_of = sparse(tmp_path, source)
        error = {}
        for name in ("auto", "ss", "edge", "cnn", "tv"):
            output, record, _ = fill(tmp_path, mask_of, "--filter", name, "--no-estimate")
            assert "estimates" not in record
            error[name] = true_error(output, source, mask_of, source)
        output, record, _ = fill(tmp_path, mask_of, "--no-estimate")
        assert record["chosen"]
        assert true_error(output, source, mask_of, source) == error["auto"]
        assert 20 * math.log10(error["auto"] / min(error.values())) < 0.15, error


def test_the_error_channel_is_zero_where_measured_and_as_large_as_the_error_elsewhere(tmp_path):
    source = sparse(tmp_path)
    output, _, _ = fill(tmp_path, source, "--error-channel")
    error, mask = read(output, "error")[..., 0], read(source, "mask")[..., 0]
    assert (error[mask > 0.5] == 0).all() and np.isfinite(error).all() and (error >= 0).all()
    truth = true_error(output, COMPLETE, source)
    mean = math.sqrt(float((error[mask < 0.5].astype(np.float64) ** 2).mean()))
    assert abs(20 * math.log10(mean / truth)) < 4, (mean, truth)
    assert any(line.split()[:1] == ["error"] and "estimated errors" in line for line in lacuna("info", output).stdout.splitlines())
    plain, _, _ = fill(tmp_path, source)
    assert "error" not in oiio.ImageBuf(str(plain)).spec().channelnames
    lacuna("verify", source, output)
    own = frames.write(tmp_path / "own.exr", {"R": read(source, "R")[..., 0], "error": error, "mask": mask})
    named, _, result = fill(tmp_path, own, "--error-channel=error")
    assert "there is one of that name" in result.stderr


def test_estimated_errors_of_an_earlier_fill_are_no_light(tmp_path):
    source, quick = sparse(tmp_path), ["--filter", "ss"]
    first = fill(tmp_path, source, *quick, "--error-channel")[0].rename(tmp_path / "first.exr")
    told, error = fill(tmp_path, source, *quick)[1]["estimates"], read(first, "error")
    again, record, result = fill(tmp_path, first, *quick, "--again")
    assert record["estimates"] == told and "dropped error" in result.stderr
    assert "error" not in oiio.ImageBuf(str(again)).spec().channelnames
    lacuna("verify", first, again)
    again, record, _ = fill(tmp_path, first, *quick, "--again", "--error-channel")
    assert record["estimates"] == told and (read(again, "error") == error).all()
    lacuna("verify", first, again)
    larger = tmp_path / "larger.exr"
    lacuna("upscale", first, "-o", larger, "--scale", 2)
    assert "error" not in oiio.ImageBuf(str(larger)).spec().channelnames
    # The renderer's own channel of that name is no estimate.
    image = {name: read(source, name)[..., 0] for name in ["R", "mask"]}
    own = frames.write(tmp_path / "own.exr", {**image, "error": (0.1 + image["R"]) * image["mask"]})
    filled = fill(tmp_path, own, *quick, "--error-channel")[0].rename(tmp_path / "filled.exr")
    again, _, result = fill(tmp_path, filled, *quick, "--again")
    assert "dropped" not in result.stderr and (read(again, "error") == read(filled, "error")).all()


def test_scalars_beside_the_colour_change_nothing_that_is_told_of_it(tmp_path):
    source = sparse(tmp_path)
    names = ["R", "G", "B", "mask"]
    image = dict(zip(names, np.moveaxis(read(source, *names), -1, 0), strict=True))
    noise = np.random.default_rng(1).random(image["mask"].shape, dtype=np.float32)
    scalars = {"AO": image["mask"], "cputime": 1e4 * (1 + noise) * image["mask"]}
    told = []
    for name, beside in (("alone", {}), ("beside", scalars)):
        path = frames.write(tmp_path / f"{name}.exr", {**image, **beside})
        output, record, _ = fill(tmp_path, path, "--error-channel", "--min-psnr", 10)
        estimates = {tuple(one["channels"]): one for one in record["estimates"]}
        told.append((estimates, read(output, "R", "G", "B", "error")))
    (alone, pixels), (beside, same) = told
    colours = ("B", "G", "R")
    assert beside[colours] == alone[colours] and (pixels == same).all()
    assert set(beside) == {colours, ("AO",)}


def test_a_gate_writes_the_frame_and_fails(tmp_path):
    source, quick = sparse(tmp_path), ["--filter", "ss"]
    for flags, words in ((["--min-psnr", 90], "below --min-psnr 90"), (["--max-rmse", "1e-6"], "above --max-rmse")):
        output, record, result = fill(tmp_path, source, *quick, *flags, status=1)
        assert output.exists() and record["state"] == "failed"
        assert "written, but doubtful" in record["message"] and words in record["message"]
        assert words in result.stderr
    _, record, _ = fill(tmp_path, source, *quick, "--min-psnr", 5, "--max-rmse", 0.5)
    assert record["state"] == "done"
    # What is up to date is held to the gate, too.
    again = lambda bound: lacuna("fill", source, "-o", output, *quick, "-u", "--min-psnr", bound, ok=False)
    assert again(5).status == 0 and "1 skipped" in again(5).stderr and again(90).status == 1
    made = output.stat().st_mtime_ns
    for flag in ("-u", "--no-clobber"):
        # The figure that is told is the one that counts, once the frame is there and when it is made.
        told = record["estimates"][0]["psnr"]["estimate"]
        for bound, passes in ((5, True), (round(told, 1), True), (round(told, 1) + 0.01, False), (90, False)):
            words = ["fill", source, *quick, "--min-psnr", bound]
            kept = lacuna(*words, "-o", output, flag, ok=False)
            assert kept.status == (0 if passes else 1), kept
            assert ("1 skipped" if passes else "there already, but doubtful") in kept.stderr
            assert lacuna(*words, "-o", tmp_path / "anew.exr", ok=False).status == kept.status
    assert output.stat().st_mtime_ns == made
    # Nothing is known of one that was not estimated.
    lacuna("fill", source, "-o", output, *quick, "--no-estimate")
    kept = lacuna("fill", source, "-o", output, *quick, "--no-clobber", "--min-psnr", 5, ok=False)
    assert kept.status == 1 and "not estimated" in kept.stderr


@pytest.mark.parametrize("flags", [["--min-psnr", "x"], ["--max-rmse", "-1"], ["--max-rmse", "nan"], ["--no-estimate", "--min-psnr", "3"], ["--error-channel=a b"], ["--error-channel=mask"]])
def test_senseless_bounds_are_refused(tmp_path, flags):
    source = sparse(tmp_path)
    result = lacuna("fill", source, "-o", tmp_path / "full.exr", *flags, ok=False)
    assert result.status == 2, result
    assert not (tmp_path / "full.exr").exists() and len(result.lines()) <= 2


def test_a_second_pass_leaves_a_bound_or_an_estimate_that_is_true(tmp_path):
    first, after, more, both = (tmp_path / f"{name}.exr" for name in ("first", "after", "more", "both"))
    lacuna("sparsify", COMPLETE, "-o", first, "--density", "0.08")
    lacuna("mask", "--after", first, "--add", "0.1", "-o", after)
    lacuna("sparsify", COMPLETE, "-o", more, "--mask", f"file:{after}")
    lacuna("mask", "--merge", first, more, "-o", both)
    output, record, _ = fill(tmp_path, both)
    told = next(item for item in record["estimates"] if "R" in item["channels"])
    assert "unknown" not in told, told
    assert true_error(output, both, both) <= most(told)
    # A bound that is good enough passes the gate.
    fill(tmp_path, both, "--max-rmse", str(1.1 * max(most(item) for item in record["estimates"])))


def test_render_tells_how_wrong_what_it_filled_is(tmp_path):
    words = ["render", SAMPLES / "scenes" / "head.toml", "--size", "96x64", "--density", "0.2", "--fill", "ss", "-o"]
    result = lacuna(*words, tmp_path / "a.exr", "--json", tmp_path / "report.json")
    assert "missing pixels by estimate" in result.stderr
    assert json.loads((tmp_path / "report.json").read_text())["frames"][0]["estimates"]
    assert "by estimate" in lacuna("info", tmp_path / "a.exr").stdout
    assert "by estimate" not in lacuna(*words, tmp_path / "b.exr", "--no-estimate").stderr


def test_normals_that_some_pixels_lack_have_no_estimate(tmp_path):
    y, x = np.indices((64, 64), np.float32) / 32 - 1
    inside = x * x + y * y < 0.6
    z = np.sqrt(np.maximum(1 - x * x - y * y, 0))
    whole = np.stack([x, y, z], axis=-1)
    for name, normals in (("whole", np.where((x * x + y * y < 1)[..., None], whole, [0, 0, 1])), ("part", np.where(inside[..., None], whole, 0))):
        normals = normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-6)
        frames.write_sparse(tmp_path / f"{name}.exr", normals.astype(np.float32), frames.shuffle(64, 64, 0.3), ["N.X", "N.Y", "N.Z"])
        _, record, _ = fill(tmp_path, tmp_path / f"{name}.exr")
        assert bool(record.get("estimates")) == (name == "whole"), record


def test_hints_name_what_would_help(tmp_path):
    noise = np.random.default_rng(7).normal(0.5, 0.2, (96, 96, 3)).astype(np.float32)
    frames.write_sparse(tmp_path / "noisy.exr", noise, frames.shuffle(96, 96, 0.25))
    result = lacuna("fill", tmp_path / "noisy.exr", "-o", tmp_path / "out.exr", "--filter", "ss")
    assert "--noise auto" in result.stderr, result
    result = lacuna("fill", sparse(tmp_path), "-o", tmp_path / "out.exr", "--filter", "ss")
    assert "--noise" not in result.stderr and "--temporal" not in result.stderr, result
