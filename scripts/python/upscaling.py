"""PSNR, SSIM and time of lacuna upscale and oiiotool --resize, as Markdown tables. Called by scripts/upscaling.

The red channel of the middle 600 x 600 pixels of each frame is reduced (2x by decimation and by box averaging, 1.5x, 3x and 4x by
box averaging), enlarged again, and compared with what it was, 16 pixels from the border, clipped to [0, 1].
Seconds are those that a whole process keeps processors busy (user and system), summed over the frames.
"""

import concurrent.futures
import pathlib
import sys
import tempfile

import numpy as np
from scipy import ndimage
from skimage.metrics import structural_similarity

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests"))

import frames  # noqa: E402
from tool import DATA, OIIO_BIN, lacuna, run  # noqa: E402

CASES = [(2, "grid"), (2, "box"), (1.5, "box"), (3, "box"), (4, "box")]
OWN = ["ss", "tv", "lanczos3", "cubic", "linear"]
OIIO = ["box", "triangle", "gaussian", "sharp-gaussian", "catmull-rom", "blackman-harris", "sinc", "lanczos3",
        "radial-lanczos3", "nuke-lanczos6", "mitchell", "bspline", "disk", "cubic", "keys", "simon", "rifman"]
CROP, MARGIN = slice(300, 900), 16


def area(size, small):
    """The matrix of area means: small x size."""
    edges = np.arange(small + 1) * size / small
    overlap = np.minimum(edges[1:, None], np.arange(1, size + 1)) - np.maximum(edges[:-1, None], np.arange(size))
    return np.clip(overlap, 0, None) * small / size


def reduce(image, scale, sampling):
    if sampling == "grid":
        return image[::scale, ::scale]
    down = area(len(image), round(len(image) / scale))
    return down @ image @ down.T


def judge(image, full):
    inside = (slice(MARGIN, -MARGIN),) * 2
    image, full = np.clip(image[inside], 0, 1), np.clip(full[inside], 0, 1)
    psnr = -10 * np.log10(np.mean((image - full) ** 2))
    return psnr, structural_similarity(image, full, data_range=1.0)


def enlarge(folder, low, full, scale, sampling):
    """Per method: PSNR, SSIM, seconds."""
    small, large = folder / "small.exr", folder / "large.exr"
    frames.write(small, {"R": low.astype(np.float32)})
    results = {}
    for name in OWN:
        words = ["--filter", name, "--sampling", sampling]
        done = lacuna("upscale", "-q", "--threads", "1", small, "-o", large, "--scale", str(scale), *words, timeout=3000)
        results[name] = (*judge(frames.read(large)[0]["R"].astype(float), full), done.busy)
    for name in OIIO:
        size = "{1}x{0}".format(*full.shape)
        done = run([OIIO_BIN / "oiiotool", small, f"--resize:filter={name}", size, "-o", large], timeout=3000)
        assert done.status == 0, done
        results["oiio " + name] = (*judge(frames.read(large)[0]["R"].astype(float), full), done.busy)
    if sampling == "grid":
        places = np.mgrid[0 : full.shape[0], 0 : full.shape[1]] / scale
        spline = ndimage.map_coordinates(low, places, order=3, mode="mirror")
        results["scipy spline, true positions"] = (*judge(spline, full), float("nan"))
    return results


def table(title, columns, rows, words):
    print(f"\n{title}\n\n| filter | {' | '.join(columns)} |\n|---|{'---:|' * len(columns)}")
    best = [max(row[k] for row in rows.values()) for k in range(len(columns))]
    for name, row in rows.items():
        cells = [f"**{value:{words}}**" if value == top else f"{value:{words}}" for value, top in zip(row, best)]
        print(f"| {name} | {' | '.join(cells)} |")


def one(name, scale, sampling):
    full = red(name)
    with tempfile.TemporaryDirectory() as folder:
        return enlarge(pathlib.Path(folder), reduce(full, scale, sampling), full, scale, sampling)


def red(name):
    return frames.colour(DATA / "frames" / f"{name}.exr", "R")[CROP, CROP, 0].astype(float)


def main():
    names = sys.argv[1:] or sorted(path.stem for path in (DATA / "frames").glob("*.exr"))
    # Frames that hold the same picture (beside other channels) are measured once.
    twins = {name: next(other for other in names if np.array_equal(red(other), red(name))) for name in names}
    seconds = {}
    # The work is in processes of their own, whose time is counted by themselves.
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        jobs = {(name, case): pool.submit(one, name, *case) for case in CASES for name in names if twins[name] == name}
        for scale, sampling in CASES:
            case = {name: jobs[twins[name], (scale, sampling)].result() for name in names}
            methods = list(case[names[0]])
            for at, title, words in ((0, "PSNR in dB", ".2f"), (1, "SSIM", ".4f")):
                rows = {method: [case[name][method][at] for name in names] for method in methods}
                table(f"{scale}x `{sampling}`, {title}:", names, rows, words)
            for method in methods:
                busy = sum(case[name][method][2] for name in set(twins.values()))
                seconds.setdefault(method, {})[f"{scale}x {sampling}"] = busy
            sys.stdout.flush()
    cases = [f"{scale}x {sampling}" for scale, sampling in CASES]
    print(f"\nSeconds, all frames:\n\n| filter | {' | '.join(cases)} |\n|---|{'---:|' * len(cases)}")
    for method, row in seconds.items():
        cells = [f"{row[case]:.2f}" if case in row else "" for case in cases]
        print(f"| {method} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
