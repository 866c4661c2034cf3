"""Arrays as they come: any strides, types and shapes, and what is refused."""

import inspect
import math
import os
import signal
import subprocess
import sys
import threading
import time
import warnings

import lacuna
import numpy as np
import pytest
from conftest import picture, same_bits

IMAGE = picture(40, 52)
MASK = lacuna.mask((40, 52), 0.3, seed=2)
FILLED = lacuna.fill(IMAGE, MASK, filter="ss")


def layouts():
    fortran = np.asfortranarray(IMAGE)
    wide = np.zeros((40, 104, 4), np.float32)
    wide[:, ::2, :3] = IMAGE
    planar = np.ascontiguousarray(IMAGE.transpose(2, 0, 1))
    fixed = IMAGE.copy()
    fixed.flags.writeable = False
    record = np.zeros((40, 52, 3), np.dtype([("pad", np.uint8), ("value", np.float32)]))
    record["value"] = IMAGE
    return {
        "fortran": fortran,
        "part of a larger one": wide[:, ::2, :3],
        "channels first": planar.transpose(1, 2, 0),
        "turned twice": IMAGE[::-1, ::-1][::-1, ::-1],
        "stored upside down": np.ascontiguousarray(IMAGE[::-1])[::-1],
        "stored from right to left": np.ascontiguousarray(IMAGE[:, ::-1])[:, ::-1],
        "blue first": np.ascontiguousarray(IMAGE[:, :, ::-1])[:, :, ::-1],
        "read-only": fixed,
        "unaligned": record["value"],
        "other byte order": IMAGE.astype(">f4"),
        "a list": IMAGE.tolist(),
    }


@pytest.mark.parametrize("name", layouts())
def test_any_layout_gives_the_same_bits(name):
    array = layouts()[name]
    if name == "a list":
        with pytest.raises(ValueError, match="^image: values are float64"):
            lacuna.fill(array, MASK)
        return
    before = np.array(array)
    assert same_bits(lacuna.fill(array, MASK, filter="ss"), FILLED), name
    assert np.array_equal(before, array)


def test_masks_of_any_kind():
    turned = np.ascontiguousarray(MASK[::-1])[::-1]
    fixed = MASK.copy()
    fixed.flags.writeable = False
    odd = (MASK * np.uint8(2)).view(np.bool_)
    kinds = [MASK.astype(kind) for kind in (np.uint8, np.int64, np.float16, np.float32, np.float64)]
    for mask in (turned, fixed, odd, np.asfortranarray(MASK), MASK.tolist(), *kinds):
        assert same_bits(lacuna.fill(IMAGE, mask, filter="ss"), FILLED)


def test_shapes_and_types_come_back():
    for shape in ((40, 52), (40, 52, 1), (40, 52, 2), (40, 52, 5)):
        for dtype in (np.float32, np.float16):
            image = picture(*shape[:2], shape[2] if len(shape) == 3 else 1).reshape(shape).astype(dtype)
            filled = lacuna.fill(image, MASK, filter="pushpull")
            assert filled.shape == shape and filled.dtype == dtype and filled.flags.writeable
            assert lacuna.upscale(image, 2, filter="cubic").shape == (80, 104, *shape[2:])
            for factors in ((2, 1.5), np.array([2, 1.5])):
                assert same_bits(lacuna.upscale(image, factors), lacuna.upscale(image, size=(80, 78)))
    assert same_bits(lacuna.fill(IMAGE[:, :, 0], MASK, filter="pushpull"), lacuna.fill(IMAGE[:, :, :1], MASK, filter="pushpull")[:, :, 0])


def test_a_lone_plane_is_not_copied_on_its_way_out():
    filled = lacuna.fill(IMAGE[:, :, 0], MASK, filter="pushpull")
    assert filled.base is not None and filled.flags.c_contiguous


def test_halves_stay_finite_and_measured_values_keep_their_bits():
    image = np.full((24, 24), 60000, np.float16)
    image[::2] = 65504
    image[3, 3] = np.inf
    filled = lacuna.fill(image, np.indices((24, 24)).sum(0) % 3 == 0, filter="ss")
    assert np.isfinite(filled).all()
    full = lacuna.fill(image, np.ones((24, 24), bool), filter="ss")
    assert same_bits(full, image), "an image that misses nothing is left as it is"


def test_non_finite_values():
    image = IMAGE.copy()
    image[~MASK] = np.nan
    assert same_bits(lacuna.fill(image, filter="ss"), FILLED)
    image[np.nonzero(MASK)[0][0], np.nonzero(MASK)[1][0], 1] = np.inf
    filled, said = lacuna.fill(image, MASK, filter="ss", estimate=True)
    assert np.isfinite(filled).all() and said.filters == {"ss": pytest.approx(1)}
    one = np.full((8, 8), np.nan, np.float32)
    one[2, 3] = 5
    assert (lacuna.fill(one) == 5).all()


def test_masked_pixels_are_missing():
    hidden = np.ma.array(IMAGE, mask=np.repeat(~MASK[:, :, None], 3, axis=2))
    assert same_bits(lacuna.fill(hidden, filter="ss"), FILLED)
    assert same_bits(lacuna.fill(hidden, np.ones_like(MASK), filter="ss"), FILLED)
    fewer = MASK & (np.arange(52) != 7)
    some = np.ma.array(IMAGE, mask=False)
    some[:, 7, 1] = np.ma.masked
    assert same_bits(lacuna.fill(some, MASK, filter="ss"), lacuna.fill(IMAGE, fewer, filter="ss"))
    half = np.ma.array(IMAGE.astype(np.float16), mask=hidden.mask)
    assert same_bits(lacuna.fill(half, filter="ss"), lacuna.fill(IMAGE.astype(np.float16), MASK, filter="ss"))
    assert same_bits(lacuna.fill(np.ma.array(IMAGE), MASK, filter="ss"), FILLED), "nothing is masked"
    assert same_bits(lacuna.upscale(hidden, 2), lacuna.upscale(IMAGE, 2, mask=MASK))


def test_identifiers_of_64_bits_stay_apart():
    columns = np.arange(52) > 25
    small = np.broadcast_to(columns, MASK.shape).astype(np.uint32)
    image = np.where(columns[:, None], IMAGE, 1 - IMAGE)
    filled = lacuna.fill(image, MASK, {"id": small}, "ss")
    assert not same_bits(filled, lacuna.fill(image, MASK, filter="ss"))
    for large in (small.astype(np.uint64) << 32, small * np.int64(-(2**40)), small.astype(np.int64)):
        two = lacuna.fill(image, MASK, {"id": large}, "ss")
        assert same_bits(two, filled), large.max()
        assert same_bits(lacuna.fill(image, MASK, {"id": large[:, :, None]}, "ss"), filled)


def test_the_order_of_guides_does_not_matter():
    edge = (np.arange(52) > 30) * np.float32(0.5) + np.zeros((40, 1), np.float32)
    guides = {"N": IMAGE * 2 - 1, "albedo": IMAGE[:, ::-1] * edge[:, :, None], "Z": edge, "id": edge > 0}
    turned = dict(reversed(guides.items()))
    assert same_bits(lacuna.fill(IMAGE, MASK, guides), lacuna.fill(IMAGE, MASK, turned))


def test_why_no_error_is_told():
    for filter in ("cs-wavelet", "dct"):
        told = lacuna.estimate(IMAGE, MASK, filter=filter)
        assert told.psnr is None and filter in told.reason
    smooth = lacuna.estimate(IMAGE, MASK, filter="ss", settings={"lambda": 1e-3})
    assert smooth.psnr is None and "smoothed" in smooth.reason
    assert lacuna.estimate(IMAGE, np.ones_like(MASK)).reason == "nothing is missing"


def test_what_cannot_be_compared_is_like_nothing():
    everything, nothing = np.full_like(IMAGE, np.nan), np.zeros_like(MASK)
    for image, region in ((everything, None), (IMAGE, nothing)):
        with pytest.warns(RuntimeWarning, match="^image: there is no value to compare") as warned:
            found = lacuna.compare(IMAGE, image, region, flip=True)
        assert len(warned) == 1 and all(math.isnan(found[name]) for name in ("psnr", "log_psnr", "mse", "rmse", "max", "ssim", "flip")), found


@pytest.mark.filterwarnings("ignore:image. .* outside 0 to peak")
def test_there_is_always_a_place_for_flip():
    assert lacuna.compare(IMAGE, FILLED)["flip"] is None and lacuna.compare(IMAGE, FILLED, flip=True)["flip"] > 0
    assert lacuna.compare(IMAGE[:, :, :2], FILLED[:, :, :2], flip=True)["flip"] is None


def test_values_that_are_not_finite_are_told():
    broken = IMAGE.copy()
    broken[:, 3, 1], broken[:, 4, 2] = np.nan, -np.inf
    with pytest.warns(RuntimeWarning, match="^image: 80 of 6240 values are NaN or infinite") as told:
        found = lacuna.compare(IMAGE, broken)
    assert len(told) == 1 and told[0].filename == __file__
    assert math.isnan(found["psnr"]) and found["mse"] == 0 and (found["nan"], found["inf"]) == (40, 40)
    with pytest.warns(RuntimeWarning):
        assert 20 < lacuna.compare(IMAGE, broken + np.float32(0.01))["psnr"] < 80
    with pytest.warns(RuntimeWarning):
        assert math.isnan(lacuna.compare(broken, broken)["psnr"])


def test_what_clipping_hides_is_told():
    bright = IMAGE + np.float32(2)
    with pytest.warns(RuntimeWarning, match="^image: 100 % of its values differ .* outside 0 to peak, 1,") as told:
        assert lacuna.compare(bright, bright * 2)["psnr"] == math.inf
    assert len(told) == 1 and told[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert lacuna.compare(bright, bright * 2, peak=8)["psnr"] < 20
        assert lacuna.compare(bright, bright * 2, clip=False)["psnr"] < 20


def test_flip_counts_in_the_unit_of_the_peak():
    other = IMAGE + np.float32(0.05)
    found = lacuna.compare(IMAGE, other, flip=True)["flip"]
    assert found > 0.01 and lacuna.compare(IMAGE * 64, other * 64, peak=64, flip=True)["flip"] == found


def test_weights_count_where_they_are_0_or_more():
    smooth = {"filter": "ss", "settings": {"lambda": 1e-3}}
    weights = 1 + 3.0 * (np.arange(52) > 25) + np.zeros((40, 1))
    weighed = lacuna.fill(IMAGE, MASK, weights=weights, **smooth)
    assert not same_bits(weighed, lacuna.fill(IMAGE, MASK, **smooth))
    assert same_bits(weighed, lacuna.fill(IMAGE, MASK, weights=np.where(MASK, weights, np.nan), **smooth)), "not read elsewhere"
    some = np.where(np.arange(52) > 4, weights, 0)
    assert same_bits(lacuna.fill(IMAGE, MASK, weights=some, **smooth), lacuna.fill(IMAGE, MASK, weights=2 * some, **smooth))


@pytest.mark.parametrize("unit", [2.0**1000, 2.0**-200])
def test_only_ratios_of_weights_matter(unit):
    smooth = {"filter": "ss", "settings": {"lambda": 1e-3}}
    weights = 1 + 3.0 * (np.arange(52) > 25) + np.zeros((40, 1))
    weighed = lacuna.fill(IMAGE, MASK, weights=weights, **smooth)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert same_bits(weighed, lacuna.fill(IMAGE, MASK, weights=weights * unit, **smooth))
        assert same_bits(weighed, lacuna.fill(IMAGE, MASK, weights=np.where(MASK, weights, 1e300), **smooth)), "not read elsewhere"


def test_the_numbers_of_settings():
    three = lacuna.fill(IMAGE, MASK, filter="ss", settings={"order": 3})
    for same in (3.0, np.float64(3), np.int8(3), "3"):
        assert same_bits(lacuna.fill(IMAGE, MASK, filter="ss", settings={"order": same}), three)
    assert lacuna.filters()["ss"]["settings"]["lambda"]["values"].endswith(", or auto")


def test_the_density_of_a_grid_is_told():
    with pytest.warns(UserWarning, match="^density: the grid has 0.25, not 0.2") as told:
        assert lacuna.mask((40, 52), 0.2, "grid").mean() == 0.25
    assert told[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lacuna.mask((40, 52), 0.25, "grid")
        lacuna.mask((40, 52), 0.2)
    with pytest.warns(UserWarning, match="^density: none of 3 x 7 pixels is in the mask"):
        assert not lacuna.mask((7, 3), 0.05, "blue-noise", seed=3).any()


class Broken:
    """What some libraries have for arrays on other devices."""

    def __array__(self, *_, **__):
        raise RuntimeError("on another device:\ncopy it")


def test_names_of_filters_that_python_lacks_are_not_offered():
    with pytest.raises(ValueError, match="there is no filter 'magic'") as raised:
        lacuna.fill(IMAGE, MASK, filter="magic")
    assert "dictionary" not in str(raised.value) and "cnn" in str(raised.value)


NAN_MASK = np.full((40, 52), np.nan, np.float32)
HUGE = np.broadcast_to(np.float32(0), (10**6, 10**6))
LARGE = np.broadcast_to(np.float32(0), (60000, 60000))
REFUSED = {
    "one axis": ("image", lambda: lacuna.fill(np.zeros(5, np.float32))),
    "four axes": ("image", lambda: lacuna.fill(np.zeros((2, 2, 2, 2), np.float32))),
    "a number": ("image", lambda: lacuna.fill(1.0)),
    "nothing": ("image", lambda: lacuna.fill(None)),
    "ragged": ("image", lambda: lacuna.fill([[1], [2, 3]])),
    "float64": ("image", lambda: lacuna.fill(IMAGE.astype(np.float64), MASK)),
    "uint8": ("image", lambda: lacuna.fill(np.zeros((4, 4), np.uint8))),
    "complex": ("image", lambda: lacuna.fill(IMAGE.astype(np.complex64))),
    "no rows": ("image", lambda: lacuna.fill(np.zeros((0, 4), np.float32))),
    "no channels": ("image", lambda: lacuna.fill(np.zeros((4, 4, 0), np.float32))),
    "too many pixels": ("image", lambda: lacuna.fill(HUGE)),
    "more than the memory": ("image", lambda: lacuna.fill(np.broadcast_to(np.float32(0), (60000, 60000, 4000)), None)),
    "more than the memory has": ("image", lambda: lacuna.fill(LARGE, None)),
    "all NaN": ("image", lambda: lacuna.fill(np.full((4, 4), np.nan, np.float32))),
    "a channel of NaN": ("image: channel 1 ", lambda: lacuna.fill(np.stack([IMAGE[:, :, 0], NAN_MASK], -1), MASK)),
    "red of NaN": ("image: channel 0 ", lambda: lacuna.fill(np.stack([NAN_MASK, *IMAGE.T[:2].swapaxes(1, 2)], -1), MASK)),
    "z of NaN, larger": ("image: channel 2 ", lambda: lacuna.upscale(np.stack([*IMAGE.T[:2].swapaxes(1, 2), NAN_MASK], -1), 2, mask=MASK, values="other")),
    "no pairs": ("mask: cs-gradient", lambda: lacuna.fill(IMAGE, np.indices((40, 52)).sum(0) % 2 == 0, filter="cs-gradient")),
    "empty mask": ("mask", lambda: lacuna.fill(IMAGE, np.zeros((40, 52), bool))),
    "another size": ("mask", lambda: lacuna.fill(IMAGE, MASK[:, :-1])),
    "a mask of channels": ("mask", lambda: lacuna.fill(IMAGE, IMAGE > 0)),
    "NaN mask": ("mask", lambda: lacuna.fill(IMAGE, NAN_MASK)),
    "a mask of texts": ("mask", lambda: lacuna.fill(IMAGE, np.full((40, 52), "x"))),
    "unknown filter": ("filter", lambda: lacuna.fill(IMAGE, MASK, filter="magic")),
    "a filter that needs files": ("filter", lambda: lacuna.fill(IMAGE, MASK, filter="dictionary")),
    "no text": ("filter", lambda: lacuna.fill(IMAGE, MASK, filter=3)),
    "unknown setting": ("settings", lambda: lacuna.fill(IMAGE, MASK, filter="ss", settings={"x": 1})),
    "out of range": ("settings", lambda: lacuna.fill(IMAGE, MASK, filter="ss", settings={"lambda": -1})),
    "no dict": ("settings", lambda: lacuna.fill(IMAGE, MASK, settings=[1])),
    "unknown values": ("values", lambda: lacuna.fill(IMAGE, MASK, values="x")),
    "unknown domain": ("domain", lambda: lacuna.fill(IMAGE, MASK, domain="x")),
    "weights of another size": ("weights", lambda: lacuna.fill(IMAGE, MASK, filter="ss", weights=MASK[1:])),
    "no weight": ("weights", lambda: lacuna.fill(IMAGE, MASK, filter="ss", settings={"lambda": 1}, weights=MASK * 0)),
    "a twin of another size": ("twin: an array of shape (40, 52, 1)", lambda: lacuna.fill(IMAGE, MASK, twin=IMAGE[:, :, :1])),
    "a twin without channels": ("twin: an array of shape (40, 52),", lambda: lacuna.fill(IMAGE, MASK, twin=IMAGE[:, :, 0])),
    "guides of another size": ("guides", lambda: lacuna.fill(IMAGE, MASK, {"n": IMAGE[1:]})),
    "guides by numbers": ("guides", lambda: lacuna.fill(IMAGE, MASK, {1: IMAGE})),
    "guides without a name": ("guides", lambda: lacuna.fill(IMAGE, MASK, {None: IMAGE})),
    "two guides of a name": ("guides['n.R']", lambda: lacuna.fill(IMAGE, MASK, {"n": IMAGE, "n.R": IMAGE[:, :, 0]})),
    "guides in a list": ("guides", lambda: lacuna.fill(IMAGE, MASK, [IMAGE])),
    "an inverted mask": ("mask", lambda: lacuna.fill(np.where(MASK[..., None], IMAGE + 1, 0), ~MASK)),
    "an inverted mask, next": ("mask", lambda: lacuna.next_mask(np.where(MASK[..., None], IMAGE + 1, 0), ~MASK, 0.1)),
    "an inverted mask, larger": ("mask", lambda: lacuna.upscale(np.where(MASK[..., None], IMAGE + 1, 0), 2, mask=~MASK)),
    "nothing missing, next": ("image", lambda: lacuna.next_mask(IMAGE, density=0.1)),
    "labels with channels": ("guides", lambda: lacuna.fill(IMAGE, MASK, {"id": IMAGE.astype(np.int32)})),
    "threads below 0": ("threads", lambda: lacuna.fill(IMAGE, MASK, threads=-1)),
    "half a thread": ("threads", lambda: lacuna.fill(IMAGE, MASK, threads=0.5)),
    "no scale": ("scale", lambda: lacuna.upscale(IMAGE)),
    "scale and size": ("scale", lambda: lacuna.upscale(IMAGE, 2, size=(80, 104))),
    "scale 1": ("scale", lambda: lacuna.upscale(IMAGE, 1)),
    "scale NaN": ("scale", lambda: lacuna.upscale(IMAGE, float("nan"))),
    "smaller": ("size", lambda: lacuna.upscale(IMAGE, size=(20, 26))),
    "larger than 16 times": ("size", lambda: lacuna.upscale(IMAGE, size=(641, 52))),
    "the same size": ("size", lambda: lacuna.upscale(IMAGE, size=(40, 52))),
    "a scale too small to matter": ("scale", lambda: lacuna.upscale(IMAGE[:5, :5], 1.05)),
    "upscale with small guides": ("guides", lambda: lacuna.upscale(IMAGE, 2, guides={"n": IMAGE})),
    "upscale with identifiers": ("guides['id']: whole numbers", lambda: lacuna.upscale(IMAGE, 2, guides={"id": np.ones((80, 104), np.int32)})),
    "upscale with flags": ("guides", lambda: lacuna.upscale(IMAGE, 2, guides={"id": np.ones((80, 104), bool)})),
    "upscale by tv with guides": ("guides", lambda: lacuna.upscale(IMAGE[:20, :26], 2, guides={"n": IMAGE}, filter="tv")),
    "infinite weights": ("weights", lambda: lacuna.fill(IMAGE, MASK, filter="ss", settings={"lambda": 1}, weights=np.where(MASK, np.inf, 0))),
    "negative weights": ("weights", lambda: lacuna.fill(IMAGE, MASK, filter="ss", settings={"lambda": 1}, weights=-1.0 * MASK)),
    "NaN as weights": ("weights", lambda: lacuna.fill(IMAGE, MASK, filter="ss", settings={"lambda": 1}, weights=MASK * np.nan)),
    "weights where nothing is smoothed": ("weights", lambda: lacuna.fill(IMAGE, MASK, weights=MASK)),
    "weights by another solver": ("weights", lambda: lacuna.fill(IMAGE, MASK, filter="tv", settings={"epsilon": 1, "solver": "nesta"}, weights=MASK)),
    "half a text": ("filter", lambda: lacuna.fill(IMAGE, MASK, filter="\ud800")),
    "half a setting": ("settings", lambda: lacuna.fill(IMAGE, MASK, filter="ss", settings={"order": "\ud800"})),
    "half a guide": ("guides", lambda: lacuna.fill(IMAGE, MASK, {"\ud800": IMAGE})),
    "half a pattern": ("pattern", lambda: lacuna.mask((4, 4), 0.5, "\ud800")),
    "no array at all": ("image: no array", lambda: lacuna.fill(Broken(), MASK)),
    "no mask at all": ("mask: no array", lambda: lacuna.fill(IMAGE, Broken())),
    "peak of an estimate 0": ("peak", lambda: lacuna.estimate(IMAGE, MASK, peak=0)),
    "huge size": ("size", lambda: lacuna.upscale(IMAGE, size=(10**6, 10**6))),
    "broken grid": ("sampling", lambda: lacuna.upscale(IMAGE, 1.5, sampling="grid")),
    "a model for a filter without": ("sampling", lambda: lacuna.upscale(IMAGE, 2, filter="lanczos3", sampling="point")),
    "three factors": ("scale", lambda: lacuna.upscale(IMAGE, (2, 2, 2))),
    "two factors of 1": ("scale", lambda: lacuna.upscale(IMAGE, (1, 1))),
    "a factor below 1": ("scale", lambda: lacuna.upscale(IMAGE, (2, 0.5))),
    "unknown sampling": ("sampling", lambda: lacuna.upscale(IMAGE, 2, sampling="x")),
    "upscale with auto": ("filter", lambda: lacuna.upscale(IMAGE, 2, filter="auto")),
    "upscale smoothed": ("settings", lambda: lacuna.upscale(IMAGE, 2, settings={"lambda": 1})),
    "density 2": ("density", lambda: lacuna.mask((4, 4), 2)),
    "density as a text": ("density", lambda: lacuna.mask((4, 4), "0.5")),
    "a scale as a text": ("scale", lambda: lacuna.upscale(IMAGE, "2")),
    "peak as a text": ("peak", lambda: lacuna.estimate(IMAGE, MASK, peak="1")),
    "peak in bytes": ("peak", lambda: lacuna.compare(IMAGE, IMAGE, peak=b"1")),
    "density NaN": ("density", lambda: lacuna.mask((4, 4), float("nan"))),
    "size 0": ("size", lambda: lacuna.mask((0, 4), 0.5)),
    "size of one": ("size", lambda: lacuna.mask(4, 0.5)),
    "mask too large": ("size", lambda: lacuna.mask((10**6, 10**6), 0.5)),
    "unknown pattern": ("pattern", lambda: lacuna.mask((4, 4), 0.5, "x")),
    "unknown relation": ("temporal", lambda: lacuna.mask((4, 4), 0.5, temporal="x")),
    "poisson in turn": ("temporal", lambda: lacuna.mask((4, 4), 0.5, "poisson", temporal="complementary")),
    "seed below 0": ("seed", lambda: lacuna.mask((4, 4), 0.5, seed=-1)),
    "neither density nor count": ("density", lambda: lacuna.next_mask(IMAGE, MASK)),
    "count below 0": ("count", lambda: lacuna.next_mask(IMAGE, MASK, count=-1)),
    "allowed of another size": ("allowed", lambda: lacuna.next_mask(IMAGE, MASK, 0.1, allowed=MASK[1:])),
    "images of two shapes": ("image", lambda: lacuna.compare(IMAGE, IMAGE[1:])),
    "peak 0": ("peak", lambda: lacuna.compare(IMAGE, IMAGE, peak=0)),
    "all NaN, larger": ("image", lambda: lacuna.upscale(NAN_MASK, 2)),
    "all NaN, next": ("image", lambda: lacuna.next_mask(NAN_MASK, density=0.1)),
    "all measured NaN, next": ("image", lambda: lacuna.next_mask(NAN_MASK, MASK, density=0.1)),
    "a masked mask": ("mask", lambda: lacuna.fill(IMAGE, np.ma.masked_equal(MASK, True))),
    "a masked twin": ("twin", lambda: lacuna.fill(IMAGE, MASK, twin=np.ma.masked_less(IMAGE, 0.5))),
    "masked guides": ("guides", lambda: lacuna.fill(IMAGE, MASK, {"n": np.ma.masked_less(IMAGE, 0.5)})),
    "masked weights": ("weights", lambda: lacuna.fill(IMAGE, MASK, weights=np.ma.masked_equal(MASK, True))),
    "a masked region": ("region", lambda: lacuna.compare(IMAGE, IMAGE, np.ma.masked_equal(MASK, True))),
    "a masked reference": ("reference", lambda: lacuna.compare(np.ma.masked_less(IMAGE, 0.5), IMAGE)),
    "everything masked": ("image", lambda: lacuna.fill(np.ma.masked_greater(IMAGE, -1))),
    "everything masked and a mask": ("mask", lambda: lacuna.fill(np.ma.masked_greater(IMAGE, -1), MASK)),
    "guides that tv does not take": ("guides", lambda: lacuna.fill(IMAGE, MASK, {"n": IMAGE}, "tv")),
    "guides where it smooths": ("guides", lambda: lacuna.fill(IMAGE, MASK, {"n": IMAGE}, "ss", settings={"lambda": 1})),
    "limit as a text": ("limit", lambda: lacuna.fill(IMAGE, MASK, limit="no")),
    "limit as an array": ("limit", lambda: lacuna.fill(IMAGE, MASK, limit=MASK)),
    "estimate as an array": ("estimate", lambda: lacuna.fill(IMAGE, MASK, estimate=MASK)),
    "clip as a number": ("clip", lambda: lacuna.compare(IMAGE, IMAGE, clip=2)),
    "hundreds of digits": ("density", lambda: lacuna.mask((4, 4), 10**400)),
    "thousands of digits": ("seed", lambda: lacuna.mask((4, 4), 0.5, seed=10**5000)),
    "a setting of thousands of digits": ("settings", lambda: lacuna.fill(IMAGE, MASK, settings={"x": 10**5000})),
    "a setting of rows": ("settings", lambda: lacuna.fill(IMAGE, MASK, filter="ss", settings={"lambda": np.eye(2)})),
    "rows of threads": ("threads", lambda: lacuna.fill(IMAGE, MASK, threads=np.eye(2))),
    "peak too small": ("peak", lambda: lacuna.compare(IMAGE, IMAGE, peak=1e-60)),
    "peak too large": ("peak", lambda: lacuna.compare(IMAGE, IMAGE, peak=1e300)),
    "region of another size": ("region", lambda: lacuna.compare(IMAGE, IMAGE, MASK[1:])),
}


def test_guides_of_an_image_too_small_for_them_are_told():
    guides = {"n": lacuna.upscale(IMAGE, 2)}
    with pytest.warns(UserWarning, match="^guides: an image of 52 x 31 is enlarged without them, as a side is below 32") as told:
        small = lacuna.upscale(IMAGE[:31], 2, guides={"n": guides["n"][:62]})
    assert told[0].filename == __file__ and same_bits(small, lacuna.upscale(IMAGE[:31], 2))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lacuna.upscale(IMAGE[:32], 2, guides={"n": guides["n"][:64]})


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_done_names_the_argument(name):
    argument, call = REFUSED[name]
    with pytest.raises(ValueError) as raised:
        call()
    line = str(raised.value)
    assert line.startswith(argument) and "\n" not in line, line


def test_the_likelier_reason_of_a_wrong_mask_comes_first():
    image = np.where(MASK[..., None], IMAGE + 1, 0)
    other = ~MASK & lacuna.mask((40, 52), 0.4, seed=3)
    for mask, words in ((~MASK, "seems inverted, or"), (other, "seems that of another frame or seed, or")):
        with pytest.raises(ValueError, match=f"{MASK.sum()} of {(~mask).sum()} missing ones have values: the mask {words}"):
            lacuna.fill(image, mask)


def test_every_call_is_documented_and_listed():
    for name in lacuna.__all__:
        assert inspect.getdoc(getattr(lacuna, name)), name
    for call in (lacuna.fill, lacuna.upscale, lacuna.mask, lacuna.next_mask, lacuna.compare):
        text = inspect.getdoc(call)
        assert "Raises ValueError" in text and "Returns" in text, call
        for argument in inspect.signature(call).parameters:
            assert argument in text, f"{call.__name__}: {argument}"
    listed = lacuna.filters()
    assert "auto" in listed and listed["ss"]["settings"]["lambda"]["default"] == "0"
    for name in listed:
        if name not in ("cs-wavelet", "cs-gradient", "dct"):
            assert np.isfinite(lacuna.fill(IMAGE, MASK, filter=name)).all(), name


def test_the_doctest_of_the_package():
    import doctest

    assert doctest.testmod(lacuna).failed == 0


@pytest.mark.filterwarnings("ignore:filter. tv stopped")
def test_other_threads_of_python_go_on():
    """They do if the lock is given back: this one counts while the other fills."""
    large = np.tile(IMAGE, (5, 5, 1))
    mask = lacuna.mask(large.shape[:2], 0.1)
    worker = threading.Thread(target=lambda: lacuna.fill(large, mask, filter="tv", settings={"gap": 1e-9}))
    worker.start()
    turns = 0
    while worker.is_alive():
        time.sleep(0.001)
        turns += 1
    # With the lock held there would be a turn before and one after.
    assert turns > 5


@pytest.mark.parametrize(
    "call",
    [
        "lacuna.fill(image, mask, filter='tv', settings={'gap': 1e-12, 'max_iterations': 10000000})",
        "lacuna.upscale(image, 2, filter='tv', settings={'gap': 1e-12, 'max_iterations': 10000000})",
        "[lacuna.upscale(image, 1.5) for _ in range(10000)]",
    ],
)
def test_an_interrupt_ends_it(call):
    program = (
        "import lacuna, numpy as np, signal\n"
        # A job in the background of a shell is born deaf to it.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "image = np.random.default_rng(1).random((1500, 1500, 3), np.float32)\n"
        "mask = lacuna.mask((1500, 1500), 0.05)\n"
        "print('ready', flush=True)\n"
        "try:\n"
        f"    {call}\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', flush=True)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    try:
        assert process.communicate(timeout=600)[0] == "interrupted\n" and process.returncode == 0
    finally:
        process.kill()


def test_a_child_after_fork_fills():
    if not hasattr(os, "fork"):
        pytest.skip("no fork")
    child = os.fork()
    if child == 0:
        os._exit(0 if same_bits(lacuna.fill(IMAGE, MASK, filter="ss"), FILLED) else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
