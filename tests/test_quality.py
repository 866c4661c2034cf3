"""How good the result is: figures that were promised, and independent implementations beside ours."""

import numpy as np
import pytest

import frames
from tool import DATA, SAMPLES, quick_fill

PROMISED = [  # frame, filter, least PSNR in dB at 20 % low-discrepancy samples
    ("engine", "ss", 55.3),
    ("engine", "tv", 48.1),
    ("engine-soft", "ss", 64.8),
    ("tooth", "ss", 69.4),
    ("head", "ss", 52.4),
    ("aneurism-iso", "ss", 33.34),
]


def filled(folder, pixels, mask, method, *words):
    """The pixels that `fill` returns, the measured ones checked bit for bit, and the process."""
    source = frames.write_sparse(folder / "in.exr", pixels, mask)
    result = quick_fill(source, "-o", folder / "out.exr", "--filter", method, *words)
    out = frames.colour(folder / "out.exr")
    assert frames.same_bits(out[mask], pixels[mask].astype(np.float32))
    assert np.isfinite(out).all()
    return out, result


@pytest.mark.data
@pytest.mark.parametrize("frame, method, least", PROMISED)
def test_the_promised_figures(tmp_path, frame, method, least):
    full = frames.colour(DATA / "frames" / f"{frame}.exr")
    mask = frames.shuffle(*full.shape[:2], 0.2)
    out, _ = filled(tmp_path, full, mask, method)
    quality = frames.psnr(out, full)
    assert quality >= least


@pytest.mark.data
def test_a_lost_bucket_is_on_a_par_with_openimageio(tmp_path):
    """No energy of derivatives does better here: solved exactly in f64, first order alone gives 34.97 dB, second order
    with 0.004 of the first 34.22, and the best mixture tried 35.2, where OpenImageIO's pyramid gives 34.95. What the
    lost square held cannot be told from its rim, and it makes up nearly all of the error."""
    full = frames.colour(DATA / "frames" / "engine.exr")
    mask = frames.shuffle(*full.shape[:2], 0.2, hole=256)
    out, _ = filled(tmp_path, full, mask, "ss")
    our_quality, their_quality = frames.psnr(out, full), frames.psnr(frames.openimageio(full, mask), full)
    assert our_quality >= their_quality - 0.05


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


def test_splines_are_not_worse_than_a_triangulation(tmp_path):
    """Clough and Tocher's cubic pieces come close. Judged from eight pixels within the border on: at it a spline has a
    free end, and a triangulation knows no answer everywhere."""
    from scipy.interpolate import CloughTocher2DInterpolator

    ahead = []
    for name in ["smooth.exr", "edges.exr", "full/sequence/shot.0001.exr", "full/sequence/shot.0003.exr"]:
        full = sample(name)[48:144, 48:144]
        mask = frames.shuffle(*full.shape[:2], 0.2)
        rows, columns = np.nonzero(mask)
        grid = np.mgrid[: full.shape[0], : full.shape[1]]
        theirs = CloughTocher2DInterpolator(np.c_[rows, columns], full[mask])(*grid)
        ours, _ = filled(tmp_path, full, mask, "ss")
        our_quality, their_quality = (frames.psnr(result[8:-8, 8:-8], full[8:-8, 8:-8]) for result in (ours, theirs))
        assert our_quality >= their_quality - 0.1, name
        ahead.append(our_quality - their_quality)
    assert np.mean(ahead) > 0


def push_pull(plane, mask):
    """The definition at the head of push_pull.rs, in f64: means of the known pixels of 2x2 blocks, up to a single one;
    on the way back an unknown pixel takes the bilinear sample of the level above."""
    if mask.all():
        return plane
    height, width = plane.shape

    def blocks(values):
        padded = np.pad(values, ((0, height % 2), (0, width % 2)))
        return padded.reshape((height + 1) // 2, 2, (width + 1) // 2, 2).sum(axis=(1, 3))

    def magnify(values, count, axis):
        at = np.arange(count)
        near = at // 2 + 1
        far = np.where(at % 2 == 0, near - 1, near + 1)
        return 0.75 * np.take(values, near, axis) + 0.25 * np.take(values, far, axis)

    count, total = blocks(mask.astype(np.float64)), blocks(np.where(mask, plane, 0.0))
    above = push_pull(total / np.maximum(count, 1), count > 0)
    above = np.pad(above, 1, mode="edge")
    return np.where(mask, plane, magnify(magnify(above, height, 0), width, 1))


@pytest.mark.parametrize("width", [192, 101])
@pytest.mark.parametrize("density", [0.2, 0.01])
@pytest.mark.parametrize("name", ["smooth.exr", "edges.exr", "full/sequence/shot.0001.exr"])
def test_push_pull_is_what_its_definition_says(tmp_path, name, density, width):
    full = sample(name)[:, :width]
    mask = frames.shuffle(*full.shape[:2], density)
    ours, _ = filled(tmp_path, full, mask, "pushpull", "--domain", "linear", "--limit", "off")
    theirs = np.stack([push_pull(full[..., k].astype(np.float64), mask) for k in range(3)], axis=-1)
    # Each of up to 8 levels rounds its mean and its sample, two lerps each.
    assert np.abs(ours - theirs).max() <= 8 * 3 * np.finfo(np.float32).eps / 2 * full.max()


@pytest.mark.parametrize("name", ["smooth.exr", "edges.exr", "full/sequence/shot.0001.exr"])
def test_push_pull_errs_at_most_twice_as_much_as_openimageio(tmp_path, name):
    """A sanity bound: OpenImageIO's pyramid has wider filters, and twice our root mean square error is 6 dB."""
    full = sample(name)
    mask = frames.shuffle(*full.shape[:2], 0.2)
    ours, _ = filled(tmp_path, full, mask, "pushpull")
    assert frames.psnr(ours, full) >= frames.psnr(frames.openimageio(full, mask), full) - 20 * np.log10(2)


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


@pytest.mark.parametrize("density", [0.2, 0.01])
@pytest.mark.parametrize("method", ["ss", "tv", "pushpull", "nearest", "linear", "cubic"])
def test_highlights_do_not_ring(tmp_path, method, density):
    """Nothing missing is darker than half the darkest measured pixel within eight pixels, where there is one."""
    full = sample("hdr.exr")
    assert full.max() >= 1000 and full.min() <= 0.1
    mask = frames.shuffle(*full.shape[:2], density)
    out, _ = filled(tmp_path, full, mask, method)
    assert (out >= 0).all()
    darkest = nearby_minimum(np.where(mask[..., None], full, np.inf), 8)
    judged = ~mask[..., None] & np.isfinite(darkest)
    assert judged.sum() > full.size / 2
    assert (out[judged] >= 0.5 * darkest[judged]).all()


def nearby_minimum(planes, radius):
    """The least value within `radius` pixels, per channel."""
    from scipy.ndimage import minimum_filter

    rows, columns = np.indices((2 * radius + 1,) * 2) - radius
    disc = rows**2 + columns**2 <= radius**2
    near = [minimum_filter(planes[..., k], footprint=disc, mode="constant", cval=np.inf) for k in range(planes.shape[-1])]
    return np.stack(near, axis=-1)
