"""What is told of a fill: its error at any range of values, and a solver that did not converge."""

import copy
import warnings

import lacuna
import numpy as np
import pytest
from conftest import picture, same_bits

IMAGE = picture(72, 88, 1)[:, :, 0] / 2
MASK = lacuna.mask(IMAGE.shape, 0.25, seed=1)


@pytest.fixture(autouse=True)
def loud():
    """A warning that no test expects is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def told(image, **more):
    filled, said = lacuna.fill(image, MASK, filter="ss", domain="linear", estimate=True, **more)
    return said, np.sqrt(np.mean((filled - image)[~MASK].astype(np.float64) ** 2))


def test_the_peak_is_the_unit():
    one, _ = told(IMAGE)
    for scale in (2.0**12, 2.0**-20):
        other, error = told(IMAGE * np.float32(scale), peak=scale)
        assert other[:3] == pytest.approx(one[:3], abs=1e-3) and other.peak == scale
        assert other.rmse == pytest.approx(one.rmse * scale, rel=1e-3) and 0.5 < other.rmse / error < 2
        assert other.unclipped_rmse == other.rmse


@pytest.mark.parametrize("power", [-90, -60, 70])
def test_the_map_of_errors_has_the_unit_of_the_values(power):
    scale = np.float32(2.0**power)
    one, other = (lacuna.estimate(IMAGE * unit, MASK, peak=float(unit), filter="ss") for unit in (np.float32(1), scale))
    assert other.rmse / float(scale) == pytest.approx(one.rmse, rel=1e-3)
    squares = [np.sum((said.errors.astype(np.float64) / float(unit)) ** 2) for said, unit in ((one, 1), (other, scale))]
    assert squares[1] == pytest.approx(squares[0], rel=1e-2) and squares[0] > 0


def test_errors_are_those_of_the_channels_that_were_filled():
    image = picture(72, 88, 3) / 2
    twin = image.copy()
    twin[..., 0] += MASK  # Is no twin.
    _, said = lacuna.fill(image, MASK, filter="ss", twin=twin, estimate=True)
    _, alone = lacuna.fill(image[..., 0], MASK, filter="ss", estimate=True)
    assert set(said.filters) == {"copy", "ss"} and said.rmse == alone.rmse
    assert same_bits(said.errors, alone.errors)


def test_errors_above_the_peak_are_not_none():
    bright = IMAGE * 4000 + 2
    with pytest.warns(UserWarning, match="^peak: 100 % of the measured values are above 1") as warned:
        said, error = told(bright)
    assert warned[0].filename == __file__
    assert (said.psnr, said.low, said.high, said.rmse) == (None,) * 4 and "clipped" in said.reason
    assert 0.5 < said.unclipped_rmse / error < 2
    # Some of it above 1: what can be seen, and all.
    said, error = told(IMAGE * 1.75)
    assert 20 < said.psnr < 80 and said.unclipped_rmse != said.rmse and 0.5 < said.unclipped_rmse / error < 2


def test_splines_fill_what_chooses_nothing():
    few = MASK & (np.indices(MASK.shape) % 9 == 0).all(axis=0)
    filled, said = lacuna.fill(IMAGE, few, estimate=True)
    assert said.filters == {"ss": 1} and same_bits(filled, lacuna.fill(IMAGE, few, filter="ss"))


def test_no_error_at_samples_is_no_promise():
    flat = np.full_like(IMAGE, 0.5)
    said, _ = told(flat)
    assert (said.psnr, said.low, said.high, said.rmse) == (None, None, None, 0) and said.reason == "no error at held-out samples"


def test_estimates_are_compared():
    said, _ = told(IMAGE)
    same = copy.deepcopy(said)
    assert said == same and not said != same and said == said
    assert said != said._replace(errors=said.errors + 1) and said != said._replace(errors=None) and said != said._replace(stop="")
    assert said != tuple(said) and said != 3 and said in [3, same]


def test_a_fill_that_did_not_converge_is_told_once():
    with pytest.warns(RuntimeWarning, match="^filter: tv stopped by the limit of iterations after 2, relative gap .* max_iterations") as warned:
        lacuna.fill(IMAGE, MASK, filter="tv", settings={"gap": 1e-12, "max_iterations": 2})
    assert len(warned) == 1 and warned[0].filename == __file__
    for sweeps in (1, 2):
        with pytest.warns(RuntimeWarning, match="^filter: tv stopped") as warned:
            lacuna.upscale(IMAGE, 2, filter="tv", settings={"max_iterations": sweeps})
        assert len(warned) == 1 and warned[0].filename == __file__


def test_an_enlarged_image_that_bounds_keep_from_its_input_is_told():
    y, x = np.mgrid[0:40, 0:48]
    disc = np.where(np.hypot(y - 20, x - 22) < 11, 1, 0.01).astype(np.float32)
    with pytest.warns(RuntimeWarning, match="^sampling: reduced again, the result is off the image by up to .* 'box'") as warned:
        lacuna.upscale(disc, 2, sampling="gaussian:1")
    assert len(warned) == 1 and warned[0].filename == __file__
    lacuna.upscale(disc, 1.5)


def test_a_rounding_excess_frees_no_bound():
    y, x = np.mgrid[0:72, 0:88]
    matte = (np.hypot(x % 40 - 20, y % 40 - 20) < 13).astype(np.float32)
    fill = lambda matte: lacuna.fill(matte, MASK, filter="ss", values="matte", limit=False)
    exact = fill(matte)
    assert exact.min() == 0 and exact.max() == 1 and (exact[~MASK] > 0.5).any()
    inside = tuple(np.argwhere(MASK & (matte == 1))[0])
    for beyond in (np.float32(1.0000001), np.float32(1.25)):
        excess = matte.copy()
        excess[inside] = beyond
        assert fill(excess).max() <= beyond and fill(excess).min() == 0
    outside = tuple(np.argwhere(MASK & (matte == 0))[0])
    excess = matte.copy()
    excess[outside] = -1e-7
    assert fill(excess).max() == 1 and fill(excess).min() >= np.float32(-1e-7)


def test_a_black_frame_cleared_to_a_colour_is_no_inverted_mask():
    colour = np.where(MASK[:, :, None], 0, np.float32([0.1, 0.2, 0.3])).astype(np.float32)
    assert same_bits(lacuna.fill(colour, MASK, filter="ss"), np.zeros_like(colour))


@pytest.mark.parametrize("clear", [0, 0.5, np.nan])
def test_guides_and_twins_that_are_sparse_like_the_image_count_for_nothing(clear):
    y, x = np.mgrid[0:72, 0:88].astype(np.float32)
    normal = np.stack([np.sin(x / 9), np.cos(y / 7), np.sin((x + y) / 11)], axis=-1) + np.float32(2)
    sparse = np.where(MASK[:, :, None], normal, np.float32(clear))
    with pytest.raises(ValueError, match="^guides: guide 'N' is zero, NaN or the same at the missing pixels"):
        lacuna.fill(IMAGE, MASK, {"N": sparse})
    with pytest.raises(ValueError, match="^guides: guide 'N'"):
        lacuna.estimate(IMAGE, MASK, {"Z": normal[:, :, 0], "N": sparse[:, :, 1]})
    with pytest.raises(ValueError, match="^guides: guide 'id'"):
        lacuna.fill(IMAGE, MASK, {"id": np.where(MASK, x.astype(np.int32) // 9 + 1, 0)})
    assert lacuna.fill(IMAGE, MASK, {"N": normal}).shape == IMAGE.shape
    plain = lacuna.fill(IMAGE, MASK)
    assert same_bits(lacuna.fill(IMAGE, MASK, twin=np.where(MASK, IMAGE, np.float32(clear))), plain)
    assert same_bits(lacuna.fill(IMAGE, MASK, twin=IMAGE), IMAGE)


@pytest.mark.parametrize(
    ("noise", "why"),
    [
        ("halves", "noise: 'halves' is none of none, auto"),
        ((1,), "noise: a tuple of 1, not of two half buffers"),
        (np.zeros((3, 3), np.float32), "noise: an array of shape"),
        (np.zeros((72, 88), np.float32), "noise: nowhere above 0"),
        (np.full((72, 88), -1, np.float32), "noise: -1 at a measured pixel is no variance"),
        ((picture(), picture()), "noise: both halves are the same"),
        ((picture(), picture()), "noise: both halves are the same$"),
        ((np.full((72, 88), np.nan, np.float32),) * 2, "noise: not finite at any measured pixel"),
        ((picture() * 2, picture()), "noise: the halves do not average to the image"),
    ],
)
def test_noise_that_is_none_is_refused(noise, why):
    image = picture() + np.float32(0.5) * (why.endswith("same"))
    with pytest.raises(ValueError, match=f"^{why}"):
        lacuna.fill(image, lacuna.mask((72, 88), 0.3), noise=noise)


def test_nothing_is_smoothed_where_there_is_no_noise():
    image, mask = picture(), lacuna.mask((72, 88), 0.3)
    with pytest.warns(UserWarning, match="noise: none that could be told from detail"):
        filled = lacuna.fill(image, mask, noise="auto")
    assert same_bits(filled, lacuna.fill(image, mask))
    with pytest.raises(ValueError, match="noise: auto is for light"):
        lacuna.fill(image, mask, values="other", noise="auto")


def test_noise_alone_says_how_much_is_smoothed():
    image, mask = picture(), lacuna.mask((72, 88), 0.3)
    variance = np.full((72, 88), 0.02, np.float32)
    noisy = image + np.random.default_rng(2).normal(0, 0.14, image.shape).astype(np.float32)
    with pytest.raises(ValueError, match="noise: it says how much to smooth"):
        lacuna.fill(noisy, mask, noise=variance, filter="ss", settings={"lambda": 1.0})
    with pytest.raises(ValueError, match="weights: they count only where"):
        lacuna.fill(noisy, mask, noise=variance, weights=np.ones((72, 88)))
    with pytest.warns(UserWarning, match="noise: it is smoothed by filters of its own, not by nearest"):
        filled = lacuna.fill(noisy, mask, noise=variance, filter="nearest")
    assert same_bits(filled, lacuna.fill(noisy, mask, noise=variance))
