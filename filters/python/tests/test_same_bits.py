"""The package and the tool come to the same bits."""

import json

import lacuna
import numpy as np
import pytest
from conftest import picture, read, same_bits, write


def sparse(tmp_path, dtype=np.float32, **more):
    """A picture, a fifth of it as a file, and its mask."""
    image = picture().astype(dtype)
    mask = lacuna.mask(image.shape[:2], 0.2, seed=7)
    samples = np.where(mask[:, :, None], image, dtype(0))
    channels = {name: samples[:, :, c] for c, name in enumerate("RGB")} | {"mask": mask.astype(np.float16)} | more
    return write(tmp_path / "sparse.exr", channels), image, samples, mask


@pytest.mark.parametrize("dtype", [np.float32, np.float16])
@pytest.mark.parametrize("filter", ["auto", "ss", "tv", "pushpull"])
def test_fill(tmp_path, tool, dtype, filter):
    path, image, samples, mask = sparse(tmp_path, dtype)
    tool("fill", path, "-o", tmp_path / "out.exr", "--filter", filter)
    filled = lacuna.fill(samples, mask, filter=filter, threads=1)
    assert filled.dtype == dtype and same_bits(filled, read(tmp_path / "out.exr"))
    assert same_bits(filled[mask], image[mask])
    assert same_bits(filled, lacuna.fill(np.where(mask[:, :, None], samples, dtype(np.nan)), filter=filter, threads=3))


@pytest.mark.parametrize("filter", ["auto", "ss", "cubic"])
@pytest.mark.parametrize("values, limit", [("other", "on"), ("directions", "off")])
def test_vectors_stand_in_files_by_their_own_names(tmp_path, tool, values, limit, filter):
    image, mask, names = picture() * np.float32(3) - 1, lacuna.mask((72, 88), 0.2, seed=7), ("v.X", "v.Y", "v.Z")
    samples = np.where(mask[:, :, None], image, np.float32(0))
    path = write(tmp_path / "in.exr", {name: samples[:, :, c] for c, name in enumerate(names)} | {"mask": mask.astype(np.float16)})
    tool("fill", path, "-o", tmp_path / "out.exr", "--filter", filter, "--channels", "v.*=fill", "--limit", limit)
    assert same_bits(lacuna.fill(samples, mask, values=values, filter=filter), read(tmp_path / "out.exr", names))
    if limit == "on":
        path = write(tmp_path / "in.exr", {name: image[:, :, c] for c, name in enumerate(names)})
        tool("upscale", path, "-o", tmp_path / "large.exr", "--scale", "2")
        assert same_bits(lacuna.upscale(image, 2, values=values), read(tmp_path / "large.exr", names))


@pytest.mark.parametrize("names", ["Z", ("v.X", "v.Y", "v.Z")])
def test_what_is_copied_stays_where_it_is_not_finite(tmp_path, tool, names):
    image, mask = picture(channels=3), lacuna.mask((72, 88), 0.2, seed=7)
    image[:, 60:, 0], image[9:12, :30, 2] = np.inf, np.nan
    image = image[:, :, 0] if names == "Z" else image
    samples = np.where(mask if names == "Z" else mask[:, :, None], image, np.float32(0))
    channels = {"Z": samples} if names == "Z" else {name: samples[:, :, c] for c, name in enumerate(names)}
    path = write(tmp_path / "in.exr", channels | {"mask": mask.astype(np.float16)})
    tool("fill", path, "-o", tmp_path / "out.exr", "--channels", f"{names[0].split('.')[0]}*=nearest")
    copied = lacuna.fill(samples, mask, values="other", filter="nearest")
    assert same_bits(copied, read(tmp_path / "out.exr", names)) and same_bits(copied[mask], image[mask])
    assert np.isfinite(lacuna.fill(samples, mask, values="other", filter="ss")).all()


def test_fill_with_settings_and_guides(tmp_path, tool):
    # What predicts the image best is the image, in other values; some of them negative, as those of colours are not.
    normal = np.ascontiguousarray(picture()[:, :, ::-1] ** 2 - 0.25)
    path, _, samples, mask = sparse(tmp_path, **{f"N.{name}": normal[:, :, c] for c, name in enumerate("XYZ")})
    tool("fill", path, "-o", tmp_path / "out.exr", "--filter", "ss", "--guides", "N.*", "--ss-order", "3")
    said = lacuna.fill(samples, mask, {"N": normal}, "ss", settings={"order": 3}, estimate=True)
    assert same_bits(said[0], read(tmp_path / "out.exr"))
    assert said[1].guides == ("N",)
    assert not same_bits(said[0], lacuna.fill(samples, mask, filter="ss", settings={"order": 3}))


@pytest.mark.parametrize("noise", ["auto", "halves", "variance", "one variance", "counts"])
def test_noise_is_smoothed(tmp_path, tool, noise):
    random, clean = np.random.default_rng(5), picture()
    mask = lacuna.mask(clean.shape[:2], 0.4, seed=7)
    halves = [np.where(mask[:, :, None], clean + random.normal(0, 0.2, clean.shape), 0).astype(np.float32) for _ in range(2)]
    samples = (halves[0] + halves[1]) / np.float32(2)
    variance = np.where(mask, np.float32(0.02), np.float32(0))
    layers = lambda name, image: {f"{name}.{c}": image[:, :, at] for at, c in enumerate("RGB")}
    more, word, given, weights = {
        "auto": ({}, "auto", "auto", None),
        "halves": (layers("half1", halves[0]) | layers("half2", halves[1]), "auto", tuple(halves), None),
        "variance": (layers("variance", np.repeat(variance[:, :, None], 3, 2)), "variance:variance", np.repeat(variance[:, :, None], 3, 2), None),
        "one variance": ({"mse": variance}, "variance:mse", variance, None),
        "counts": ({"count": np.where(mask, np.float32(4), np.float32(0))}, "count:count", "auto", np.where(mask, 4, 0)),
    }[noise]
    channels = {c: samples[:, :, at] for at, c in enumerate("RGB")} | {"mask": mask.astype(np.float16)} | more
    path = write(tmp_path / "noisy.exr", channels)
    tool("fill", path, "-o", tmp_path / "out.exr", "--noise", word, "--channels", "count=keep")
    filled, said = lacuna.fill(samples, mask, noise=given, weights=weights, estimate=True)
    assert same_bits(filled, read(tmp_path / "out.exr"))
    psnr = lambda image: lacuna.compare(clean, image, peak=2)["psnr"]
    assert psnr(filled) > psnr(lacuna.fill(samples, mask)) + 3 and not same_bits(filled[mask], samples[mask])
    assert said.psnr is None and "smoothed" in said.reason
    # A complete image has no missing pixel, and noise all the same.
    if noise == "auto":
        noisy = clean + np.float32(0.2) * random.standard_normal(clean.shape, np.float32)
        assert psnr(lacuna.fill(noisy, noise=given)) > psnr(noisy) + 5


@pytest.mark.parametrize("dtype", [np.float32, np.float16])
@pytest.mark.parametrize("off", [0, 0.25])
def test_fill_with_a_twin(tmp_path, tool, dtype, off):
    alpha = np.clip(picture()[:, :, 0] - 0.4, 0, 1)
    mask = lacuna.mask(alpha.shape, 0.2, seed=7)
    twin = alpha.copy()
    twin[tuple(np.argwhere(mask)[7])] += off
    samples = np.where(mask, alpha, 0).astype(dtype)
    path = write(tmp_path / "in.exr", {"A": samples, "mask": mask.astype(np.float16), "R": samples, "a.A": twin})
    tool("fill", path, "-o", tmp_path / "out.exr", "--guides", "a.A")
    filled, told = lacuna.fill(samples, mask, {"a.A": twin}, values="matte", twin=twin, estimate=True)
    assert same_bits(filled, read(tmp_path / "out.exr", "A"))
    assert same_bits(filled, alpha.astype(dtype)) == (off == 0) == (told.filters == {"copy": 1})
    if off == 0:
        assert told.psnr is None and told.low is None and told.rmse is None
        assert told.reason == f"copied from the twin, equal at all {mask.sum()} measured pixels"


@pytest.mark.parametrize(("dtype", "beyond"), [(np.float32, 1.5), (np.float32, np.inf), (np.float16, 1e6)])
def test_a_twin_beyond_what_may_be_filled_is_none(recwarn, dtype, beyond):
    alpha = np.clip(picture()[:, :, 0] - 0.4, 0, 1)
    mask = lacuna.mask(alpha.shape, 0.2, seed=7)
    twin = alpha.copy()
    twin[tuple(np.argwhere(~mask)[7])] = beyond
    samples = np.where(mask, alpha, 0).astype(dtype)
    filled = lacuna.fill(samples, mask, values="matte", twin=twin)
    assert same_bits(filled, lacuna.fill(samples, mask, values="matte"))
    assert not recwarn.list


@pytest.mark.parametrize("filter", ["auto", "ss"])
def test_fill_with_guides_that_are_colours(tmp_path, tool, filter):
    albedo = np.sqrt(picture()) * np.float32([1, 0.5, 0.25])
    normal = picture()[:, :, ::-1] ** 2 - 0.25
    more = {f"albedo.{name}": albedo[:, :, c] for c, name in enumerate("RGB")}
    more |= {f"N.{name}": normal[:, :, c] for c, name in enumerate("XYZ")}
    path, _, samples, mask = sparse(tmp_path, **{name: np.ascontiguousarray(plane) for name, plane in more.items()})
    tool("fill", path, "-o", tmp_path / "out.exr", "--filter", filter, "--guides", "N.*,albedo.*")
    filled = read(tmp_path / "out.exr")
    assert same_bits(lacuna.fill(samples, mask, {"albedo": albedo, "N": normal}, filter), filled)


def test_estimate_and_errors(tmp_path, tool):
    path, image, samples, mask = sparse(tmp_path)
    report = tmp_path / "report.json"
    tool("fill", path, "-o", tmp_path / "out.exr", "--error-channel", "--json", report)
    filled, said = lacuna.fill(samples, mask, estimate=True)
    assert said.low < said.psnr < said.high and said.reason is None and said.stop in ("converged", "iteration-limit")
    written = next(name for name in ("error", "lacuna.error", "error.RGB") if has(tmp_path / "out.exr", name))
    assert same_bits(said.errors, read(tmp_path / "out.exr", written).astype(np.float32))
    assert not said.errors[mask].any() and said.errors[~mask].any()
    assert abs(sum(said.filters.values()) - 1) < 1e-6 and set(said.filters) <= set(lacuna.filters())
    again = lacuna.estimate(samples, mask)
    assert again[:4] == said[:4]
    told = json.loads(report.read_text())["frames"][0]
    assert any(abs(value - said.psnr) < 0.01 for value in numbers(told)), "the report says the same"
    assert abs(lacuna.compare(image, filled, ~mask)["psnr"] - said.psnr) < 6


@pytest.mark.parametrize("scale", [1, 1e-20, 1e25])
def test_errors_are_those_of_all_colours(tmp_path, tool, scale):
    image, mask = picture() * np.float32(scale / 2), lacuna.mask((72, 88), 0.2, seed=7)
    samples = np.where(mask[:, :, None], image, np.float32(0))
    whole = lacuna.estimate(samples, mask, filter="ss", peak=scale).errors
    # Is solved by itself.
    samples[(*np.argwhere(mask)[40], 1)] = np.nan
    path = write(tmp_path / "in.exr", {name: samples[:, :, c] for c, name in enumerate("RGB")} | {"mask": mask.astype(np.float16)})
    tool("fill", path, "-o", tmp_path / "out.exr", "--filter", "ss", "--error-channel", "--peak", scale)
    errors = lacuna.estimate(samples, mask, filter="ss", peak=scale).errors
    assert same_bits(errors, read(tmp_path / "out.exr", "error"))
    assert np.isfinite(errors).all() and errors.max() == pytest.approx(whole.max(), rel=0.5)


def numbers(tree):
    """All numbers of a report."""
    if isinstance(tree, dict):
        tree = list(tree.values())
    if isinstance(tree, list):
        return [number for part in tree for number in numbers(part)]
    return [tree] if isinstance(tree, float) else []


def has(path, name):
    import OpenEXR

    return name in OpenEXR.File(str(path), separate_channels=True).channels()


@pytest.mark.parametrize("scale, sampling, filter", [(2, "box", "ss"), (1.5, "point", "ss"), (2, "gaussian:1", "tv"), (2, None, "cubic")])
def test_upscale(tmp_path, tool, scale, sampling, filter):
    path, _, samples, mask = sparse(tmp_path)
    model = {} if sampling is None else {"sampling": sampling}
    flags = [word for name, value in model.items() for word in (f"--{name}", value)]
    tool("upscale", path, "-o", tmp_path / "out.exr", "--scale", scale, "--filter", filter, *flags)
    large = lacuna.upscale(samples, scale, mask=mask, filter=filter, **model)
    assert large.shape[:2] == (round(72 * scale), round(88 * scale))
    assert same_bits(large, read(tmp_path / "out.exr"))


def test_upscale_with_guides(tmp_path, tool):
    y, x = (np.mgrid[0:160, 0:160] + 0.5) / 160
    inside = (x + 0.37 * y > 0.73) | (np.hypot(x - 0.25, y - 0.65) < 0.12)
    light = np.where(inside, 0.8 - 0.3 * y, 0.1 + 0.2 * x)
    small = np.stack([light, light / 2, light**2], -1).reshape(80, 2, 80, 2, 3).mean((1, 3)).astype(np.float32)
    depth = np.where(inside, 5 + y, 9 - x).astype(np.float32)
    normal = np.stack([0.6 * inside, -0.1 * x, np.where(inside, 0.8, 1)], -1).astype(np.float32)
    write(tmp_path / "small.exr", {name: small[:, :, c] for c, name in enumerate("RGB")})
    write(tmp_path / "known.exr", {f"N.{name}": normal[:, :, c] for c, name in enumerate("XYZ")} | {"Z": depth})
    tool("upscale", tmp_path / "small.exr", "-o", tmp_path / "out.exr", "--scale", "2", "--guides-from", tmp_path / "known.exr")
    large = lacuna.upscale(small, 2, guides={"Z": depth, "N": normal})
    assert same_bits(large, read(tmp_path / "out.exr"))
    assert not same_bits(large, lacuna.upscale(small, 2))


@pytest.mark.parametrize("pattern", ["shuffle", "blue-noise", "poisson", "random", "grid"])
def test_masks(tmp_path, tool, pattern):
    flags = ("--size", "88x72", "--density", "0.25", "--pattern", pattern, "--seed", "5")
    tool("mask", "-o", tmp_path / "mask.exr", *flags)
    mask = lacuna.mask((72, 88), 0.25, pattern, seed=5)
    assert mask.dtype == np.bool_ and np.array_equal(mask, read(tmp_path / "mask.exr", "mask") >= 0.5)


def test_next_pixels(tmp_path, tool):
    path, _, samples, mask = sparse(tmp_path)
    tool("mask", "--after", path, "--add", "0.05", "--seed", "7", "-o", tmp_path / "next.exr")
    new = lacuna.next_mask(samples, mask, 0.05, seed=7)
    assert new.sum() == round(0.05 * mask.size) and not (new & mask).any()
    assert np.array_equal(new, read(tmp_path / "next.exr", "mask") >= 0.5)
    (tmp_path / "f.0003.exr").write_bytes(path.read_bytes())
    tool("mask", "--after", tmp_path / "f.####.exr", "--add", "0.05", "--seed", "7", "-o", tmp_path / "next.####.exr")
    third = lacuna.next_mask(samples, mask, 0.05, seed=7, frame=3)
    assert (third != new).any() and np.array_equal(third, read(tmp_path / "next.0003.exr", "mask") >= 0.5)
    half = np.zeros_like(mask)
    half[:, :40] = True
    assert not (lacuna.next_mask(samples, mask, count=50, allowed=half) & ~half).any()


def test_measures(tmp_path, tool):
    image, mask = picture(), lacuna.mask((72, 88), 0.2)
    filled = lacuna.fill(image, mask, filter="pushpull")
    for name, array in (("full", image), ("filled", filled)):
        write(tmp_path / f"{name}.exr", {key: array[:, :, c] for c, key in enumerate("RGB")})
    tool("compare", tmp_path / "full.exr", tmp_path / "filled.exr", "--measures", "flip", "--json", tmp_path / "report.json")
    text = json.loads((tmp_path / "report.json").read_text())
    told = text["frames"][0]["groups"][0]["regions"][0]["measures"]
    found = lacuna.compare(image, filled, flip=True)
    for name, value in found.items():
        assert abs(told[name.replace("_", "-")] - value) <= 1e-12 * abs(value), name
    inner = lacuna.compare(image, filled, ~mask)
    assert inner["pixels"] == (~mask).sum() and inner["psnr"] < found["psnr"]
    assert lacuna.compare(image, image)["psnr"] == np.inf
