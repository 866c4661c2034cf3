"""`--filter linear` and `--filter cubic` against scipy's interpolators on the same triangles. Every test prints both numbers."""

import numpy as np
import pytest
from scipy.interpolate import CloughTocher2DInterpolator, LinearNDInterpolator, NearestNDInterpolator
from scipy.spatial import Delaunay

import frames
from tool import SAMPLES, quick_fill

PURE = ("--domain", "linear", "--limit", "off")


def filled(folder, full, mask, method, *words):
    quick_fill(frames.write_sparse(folder / "in.exr", full, mask), "-o", folder / "out.exr", "--filter", method, *words)
    out = frames.colour(folder / "out.exr")
    assert frames.same_bits(out[mask], full[mask])
    return out


def wave(height, width):
    rows, columns = np.indices((height, width))
    base = np.sin(rows / 17.0) * np.cos(columns / 23.0) + 0.3 * np.sin(rows * columns / 900.0)
    # Far from 0: `fill` keeps light from getting negative, and cubics overshoot.
    return np.stack([base + 5, 0.5 * base + 5, base**2 + 5], axis=-1).astype(np.float32)


def unique(triangles, points):
    """Per triangle, whether no site beyond its edges lies on its circumcircle: elsewhere a triangulation is a choice. Exact in
    integers."""
    result = np.ones(len(triangles.simplices), bool)
    for index, (corners, beyond) in enumerate(zip(triangles.simplices, triangles.neighbors)):
        for other in beyond[beyond >= 0]:
            apex = next(site for site in triangles.simplices[other] if site not in corners)
            rows = [[*(points[site] - points[apex]), ((points[site] - points[apex]) ** 2).sum()] for site in corners]
            (a, b, c), (d, e, f), (g, h, i) = np.array(rows, dtype=object)
            result[index] &= a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) != 0
    return result


def sites(mask):
    return np.argwhere(mask).astype(np.int64)


@pytest.mark.parametrize("density", [0.5, 0.2, 0.02])
def test_linear_is_scipys_wherever_the_triangulation_is_unique(tmp_path, density):
    full = wave(60, 80)
    mask = np.random.default_rng(3).random(full.shape[:2]) < density
    ours = filled(tmp_path, full, mask, "linear", *PURE)
    points = sites(mask)
    triangles = Delaunay(points)
    at = np.argwhere(np.ones_like(mask))
    found = triangles.find_simplex(at)
    theirs = LinearNDInterpolator(triangles, full[mask].astype(np.float64))(at).reshape(full.shape)
    judged = ((found >= 0) & unique(triangles, points)[found]).reshape(mask.shape) & ~mask
    largest = np.abs(ours - theirs)[judged].max()
    print(f"{judged.sum()} of {(~mask).sum()} missing pixels judged, largest difference {largest:.2e}")
    assert judged.sum() > 0.5 * (~mask).sum()
    # One rounding to float of values below 8; scipy's barycentric coordinates are doubles as ours.
    assert largest <= 8 * np.finfo(np.float32).eps
    outside = (found < 0).reshape(mask.shape)
    nearest = NearestNDInterpolator(points, full[mask])(at).reshape(full.shape)
    distance = np.abs(ours - nearest).max(axis=-1)[outside]
    # Where two measured pixels are equally near either may be taken.
    assert np.mean(distance == 0) > 0.8


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_cubic_is_scipys_on_sites_with_one_triangulation(tmp_path, seed):
    full = wave(211, 197)
    for attempt in range(100):
        mask = np.zeros(full.shape[:2], bool)
        mask.flat[np.random.default_rng((seed, attempt)).choice(mask.size, 60, replace=False)] = True
        points = sites(mask)
        triangles = Delaunay(points)
        if unique(triangles, points).all():
            break
    else:
        pytest.fail("no set of sites without four on a circle")
    ours = filled(tmp_path, full, mask, "cubic", *PURE)
    at = np.argwhere(np.ones_like(mask))
    inside = (triangles.find_simplex(at) >= 0).reshape(mask.shape) & ~mask
    theirs = CloughTocher2DInterpolator(triangles, full[mask].astype(np.float64), tol=1e-12, maxiter=10_000)(at).reshape(full.shape)
    inside &= np.isfinite(theirs).all(axis=-1)  # scipy leaves out a few pixels on the hull
    largest = np.abs(ours - theirs)[inside].max()
    print(f"{inside.sum()} pixels, largest difference {largest:.2e} of values up to {np.abs(full).max():.1f}")
    # Our sweeps end at changes of 1e-5 of the range a pixel; triangles are up to a hundred pixels long.
    assert largest <= 1e-4 * np.ptp(full)


@pytest.mark.parametrize("name", ["smooth", "full/sequence/shot.0001"])
def test_quality_is_that_of_scipy_where_triangles_are_a_choice(tmp_path, name):
    full = frames.colour(SAMPLES / f"{name}.exr")[48:144, 48:144]
    mask = frames.shuffle(*full.shape[:2], 0.2)
    at = np.argwhere(np.ones_like(mask))
    inside = (Delaunay(sites(mask)).find_simplex(at) >= 0).reshape(mask.shape)
    for method, twin in (("linear", LinearNDInterpolator), ("cubic", CloughTocher2DInterpolator)):
        ours = filled(tmp_path, full, mask, method, *PURE)
        theirs = twin(sites(mask), full[mask].astype(np.float64))(at).reshape(full.shape)
        qualities = [frames.psnr(image[inside], full[inside]) for image in (ours, theirs)]
        print(f"{name} {method}: lacuna {qualities[0]:.2f} dB, scipy {qualities[1]:.2f} dB")
        # Square grids of samples leave the choice of diagonals, which is worth some tenths of a decibel either way.
        assert qualities[0] == pytest.approx(qualities[1], abs=0.5)


def test_cubic_beats_linear_beats_nearest_on_smooth_shading(tmp_path):
    full = frames.colour(SAMPLES / "smooth.exr")
    mask = frames.shuffle(*full.shape[:2], 0.2)
    quality = [frames.psnr(filled(tmp_path, full, mask, method), full) for method in ("cubic", "linear", "nearest")]
    print(quality)
    assert quality == sorted(quality, reverse=True)
