"""Reference values of the compressed-sensing filters, from PyWavelets and Clarabel, as files that the tests in Rust read.

Usage: .venv/bin/python scripts/python/sensing_reference.py      (tests/test_sensing.py compares the files with a new run)

The images are given by a formula that both sides know, so that the files hold results only.
"""

import pathlib

import clarabel
import numpy as np
import pywt
import scipy.sparse as sp

DATA = pathlib.Path(__file__).resolve().parents[2] / "filters" / "tests" / "data"
WAVELETS = ["haar"] + [f"db{n}" for n in range(2, 11)] + [f"sym{n}" for n in range(2, 11)] + [f"coif{n}" for n in range(1, 6)] + ["cdf97"]
MODES = {"periodic": "periodization", "symmetric": "symmetric"}


def image(height, width):
    count = np.arange(height * width)
    return ((count * 7919 + 13) % 101 / 64 - 0.75).reshape(height, width)


def half(length, taps, boundary):
    if length == 1:
        return 1
    return -(-length // 2) if boundary == "periodic" else (length + taps - 1) // 2


def levels_of(height, width, taps, boundary, most):
    """Levels until one would not make the image smaller."""
    for level in range(most):
        new = half(height, taps, boundary), half(width, taps, boundary)
        if any(b >= a > 1 for a, b in zip((height, width), new)) or height * width == 1:
            return level
        height, width = new
    return most


def transform(x, name, boundary, levels):
    """Details of level 1 (beside, below, both), of level 2, ..., then the approximation."""
    wavelet, mode, out = pywt.Wavelet("bior4.4" if name == "cdf97" else name), MODES[boundary], []
    for _ in range(levels):
        x, (below, beside, both) = pywt.dwt2(x, wavelet, mode)
        out += [beside.ravel(), below.ravel(), both.ravel()]
    return np.concatenate([*out, x.ravel()])


def wavelet_lines():
    for name in WAVELETS:
        taps = pywt.Wavelet("bior4.4" if name == "cdf97" else name).dec_len
        for boundary in MODES:
            for height, width, most in [(8, 12, 2), (13, 11, 2), (21, 32, 1), (5, 4, 1), (46, 43, 3)]:
                levels = levels_of(height, width, taps, boundary, most)
                if levels:
                    values = transform(image(height, width), name, boundary, levels)
                    # Every n-th coefficient, n odd so that all phases are seen.
                    step = len(values) // 40 | 1
                    some = " ".join(f"{value:.6f}" for value in values[::step])
                    yield f"{name} {boundary} {height} {width} {levels} {len(values)} {step} : {some}"


def matrix(operator, pixels):
    """The matrix of a linear map, column by column."""
    return np.stack([operator(column) for column in np.eye(pixels)], axis=1)


def gain(height, width, sigma, kappa):
    """The blur of `filters/src/sensing/cs_wavelet.rs` by its formula."""
    y, x = np.fft.fftfreq(height) * height, np.fft.fftfreq(width) * width
    phi = np.exp(-(y[:, None] ** 2 + x[None] ** 2) / (2 * sigma**2))
    return np.minimum((phi + kappa / np.maximum(phi, 1e-300)) / (1 + kappa), 8.0) if kappa else phi


def least(operator, x, measured, groups=1):
    """min |U x|_1 with x fixed at measured pixels, by Clarabel: `groups` = 2 where pairs of rows are complex numbers."""
    fixed, free = operator[:, measured] @ x[measured], operator[:, ~measured]
    rows, columns = free.shape
    count = rows // groups
    cost = np.concatenate([np.zeros(columns), np.ones(count)])
    if groups == 1:
        a = np.block([[free, -np.eye(rows)], [-free, -np.eye(rows)]])
        b, cones = np.concatenate([-fixed, fixed]), [clarabel.NonnegativeConeT(2 * rows)]
    else:
        a, b = np.zeros((3 * count, columns + count)), np.zeros(3 * count)
        a[0::3, columns:] = -np.eye(count)
        for part in range(2):
            a[part + 1 :: 3, :columns], b[part + 1 :: 3] = free[part::2], -fixed[part::2]
            a[part + 1 :: 3, :columns] *= -1
            b[part + 1 :: 3] *= -1
        cones = [clarabel.SecondOrderConeT(3)] * count
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    zeros = sp.csc_matrix((len(cost), len(cost)))
    solution = clarabel.DefaultSolver(zeros, cost, sp.csc_matrix(a), b, cones, settings).solve()
    assert str(solution.status) == "Solved", solution.status
    return solution.obj_val


def mask(height, width, density):
    count = np.arange(height * width)
    return ((count * 2_654_435_761) % 4_294_967_296 / 4_294_967_296 < density).reshape(height, width)


def optimum_lines():
    for name, boundary, height, width, levels, sigma, kappa, density in [
        ("db4", "periodic", 16, 16, 2, 4.0, 0.0, 0.5), ("db4", "periodic", 16, 16, 2, 4.0, 1e-1, 0.5),
        ("cdf97", "symmetric", 12, 15, 1, 6.0, 1e-1, 0.4), ("haar", "periodic", 13, 10, 2, 5.0, 0.0, 0.6),
    ]:
        blur = gain(height, width, sigma, kappa)
        operator = matrix(lambda x: transform(np.fft.ifft2(np.fft.fft2(x.reshape(height, width)) * blur).real, name, boundary, levels),
                          height * width)
        value = least(operator, image(height, width).ravel(), mask(height, width, density).ravel())
        yield f"wavelet {name} {boundary} {height} {width} {levels} {sigma} {kappa} {density} : {value:.9f}"
    for height, width, density in [(12, 12, 0.5), (9, 14, 0.4), (8, 11, 0.7)]:
        def fourier(x, shape=(height, width)):
            return np.fft.fft2(x.reshape(shape), norm="ortho").ravel().view(float)
        value = least(matrix(fourier, height * width), image(height, width).ravel(), mask(height, width, density).ravel(), groups=2)
        yield f"fourier {height} {width} {density} : {value:.9f}"


def files():
    """Name and lines of each reference file."""
    return {"wavelets.txt": list(wavelet_lines()), "optima.txt": list(optimum_lines())}


if __name__ == "__main__":
    DATA.mkdir(parents=True, exist_ok=True)
    for file, lines in files().items():
        (DATA / file).write_text("# Made by scripts/python/sensing_reference.py\n" + "\n".join(lines) + "\n")
