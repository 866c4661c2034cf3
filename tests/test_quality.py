"""How good the result is: figures that were promised, and independent implementations beside ours."""

import numpy as np
import OpenImageIO as oiio
import pytest

import frames
from tool import DATA, SAMPLES, lacuna

PROMISED = [  # frame, filter, side of the lost square, least PSNR in dB at 20 % low-discrepancy samples
    ("engine", "ss", 0, 55.3),
    ("engine", "tv", 0, 48.1),
    ("engine-soft", "ss", 0, 64.8),
    ("tooth", "ss", 0, 69.4),
    ("head", "ss", 0, 52.4),
    ("aneurism-iso", "ss", 0, 33.34),
    ("engine", "ss", 256, 36.2),
]


def filled(folder, pixels, mask, method, *words):
    """The pixels that `fill` returns, the measured ones checked bit for bit, and the seconds of the process."""
    source = frames.write_sparse(folder / "in.exr", pixels, mask)
    result = lacuna("fill", source, "-o", folder / "out.exr", "--filter", method, *words)
    out = frames.colour(folder / "out.exr")
    assert frames.same_bits(out[mask], pixels[mask].astype(np.float32))
    assert np.isfinite(out).all()
    return out, result.seconds


@pytest.mark.data
@pytest.mark.parametrize("frame, method, hole, least", PROMISED)
def test_the_promised_figures(tmp_path, frame, method, hole, least):
    full = frames.colour(DATA / "frames" / f"{frame}.exr")
    mask = frames.shuffle(*full.shape[:2], 0.2, hole=hole)
    out, _ = filled(tmp_path, full, mask, method)
    quality = frames.psnr(out, full)
    assert quality >= least


@pytest.mark.data
def test_smoothness_splines_take_a_second_at_most(tmp_path):
    full = frames.colour(DATA / "frames" / "engine.exr")
    mask = frames.shuffle(*full.shape[:2], 0.2)
    assert min(filled(tmp_path, full, mask, "ss")[1] for _ in range(4)) <= 1.0


def sample(name, names="RGB"):
    return frames.colour(SAMPLES / name, names)


@pytest.mark.parametrize("name", ["smooth.exr", "full/sequence/shot.0001.exr"])
def test_splines_are_not_worse_than_scikit_image(tmp_path, name):
    from skimage.restoration import inpaint_biharmonic

    full = sample(name)[48:144, 48:144]
    mask = frames.shuffle(*full.shape[:2], 0.2)
    theirs = inpaint_biharmonic(full * mask[..., None], ~mask, channel_axis=-1)
    ours, _ = filled(tmp_path, full, mask, "ss")
    our_quality, their_quality = frames.psnr(ours, full), frames.psnr(theirs, full)
    assert our_quality >= their_quality - 0.05


@pytest.mark.parametrize("name", ["smooth.exr", "full/sequence/shot.0001.exr"])
def test_splines_are_better_than_a_triangulation(tmp_path, name):
    from scipy.interpolate import CloughTocher2DInterpolator

    full = sample(name)[48:144, 48:144]
    mask = frames.shuffle(*full.shape[:2], 0.2)
    rows, columns = np.nonzero(mask)
    grid = np.mgrid[: full.shape[0], : full.shape[1]]
    theirs = CloughTocher2DInterpolator(np.c_[rows, columns], full[mask])(*grid)
    inside = np.isfinite(theirs).all(axis=-1)
    ours, _ = filled(tmp_path, full, mask, "ss")
    assert inside.mean() > 0.95
    our_quality, their_quality = (frames.psnr(result[inside], full[inside]) for result in (ours, theirs))
    assert our_quality >= their_quality


@pytest.mark.parametrize("name, behind", [("smooth.exr", 6.0), ("edges.exr", 1.0), ("full/sequence/shot.0001.exr", 1.5)])
def test_push_pull_is_like_openimageio(tmp_path, name, behind):
    """OpenImageIO's pyramid has wider filters: it is better where all is smooth, and about as good at edges."""
    full = sample(name)
    height, width, _ = full.shape
    mask = frames.shuffle(height, width, 0.2)
    theirs = oiio.ImageBuf(oiio.ImageSpec(width, height, 4, "float"))
    theirs.specmod().alpha_channel = 3
    weighted = np.concatenate([full * mask[..., None], mask[..., None]], axis=-1)
    theirs.set_pixels(oiio.ROI(), np.ascontiguousarray(weighted, dtype=np.float32))
    theirs = oiio.ImageBufAlgo.fillholes_pushpull(theirs).get_pixels(oiio.FLOAT)[..., :3]
    theirs = np.where(mask[..., None], full, theirs)
    ours, _ = filled(tmp_path, full, mask, "pushpull")
    our_quality, their_quality = frames.psnr(ours, full), frames.psnr(theirs, full)
    assert our_quality >= their_quality - behind


def test_total_variation_keeps_edges_and_the_texture_defeats_everyone(tmp_path):
    """What the README says about weaknesses stays true."""
    texture = np.repeat(sample("texture.exr", "Y"), 3, axis=-1)
    mask = frames.shuffle(*texture.shape[:2], 0.2)
    for method in ("ss", "tv", "pushpull", "nearest"):
        quality = frames.psnr(filled(tmp_path, texture, mask, method)[0], texture)
        assert quality < 15, method
    cloud = sample("smooth.exr")
    mask = frames.shuffle(*cloud.shape[:2], 0.2)
    quality = {method: frames.psnr(filled(tmp_path, cloud, mask, method)[0], cloud) for method in ("ss", "tv", "nearest")}
    assert quality["ss"] > quality["tv"] > quality["nearest"]


@pytest.mark.parametrize("method", ["ss", "tv", "pushpull", "nearest"])
def test_highlights_do_not_ring(tmp_path, method):
    full = sample("hdr.exr")
    mask = frames.shuffle(*full.shape[:2], 0.2)
    out, _ = filled(tmp_path, full, mask, method)
    assert (out >= 0).all()
    darkest = nearby_minimum(np.where(mask[..., None], full, np.inf), 8)
    assert (out[~mask] >= 0.5 * darkest[~mask]).all()


def nearby_minimum(planes, radius):
    """The least value within `radius` pixels, per channel."""
    from scipy.ndimage import minimum_filter

    rows, columns = np.indices((2 * radius + 1,) * 2) - radius
    disc = rows**2 + columns**2 <= radius**2
    return np.stack([minimum_filter(planes[..., k], footprint=disc, mode="nearest") for k in range(planes.shape[-1])], axis=-1)
