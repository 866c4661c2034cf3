"""The table of docs/measurements/noise.md: noisy frames at equal samples, filled, smoothed, denoised. Called by scripts/renderers/noise;
arguments: the scenes to do, default all.

Every way has the same number of samples: N in a quarter of the pixels, or N / 4 in all of them. PSNR is that of the mean of (x - a)(x - b),
a and b two references of their own noise, which so cancels, all clipped to 0 and 1; FLIP is that of `lacuna compare` against the mean
of both. PYOIDN names a Python with pyoidn; without one, those columns stay empty. Rendered files stay in out/noise and are used again.
"""

import os
import pathlib
import subprocess
import sys

import numpy as np
import OpenEXR

import measure
import sparse

HERE = pathlib.Path(__file__).resolve().parent
OUT = sparse.ROOT / "out" / "noise"
PAGE = sparse.ROOT / "docs" / "measurements" / "noise.md"
SIZE = (480, 270)
SAMPLES = (4, 16, 64, 256)
REFERENCE = 256
GUIDES = ["--aovs", "albedo,N,depth,id", "--dense-aovs", "--dense-spp", "16"]
SCENES = {"cloud": [], "interior": GUIDES, "glass": GUIDES, "watch": GUIDES}
WAYS = ("today", "`--noise`", "OIDN", "packed, OIDN", "both")


def render(scene, name, spp, seed, *more):
    path = OUT / f"{scene}.{name}.exr"
    if not path.exists():
        words = [sys.executable, HERE / "mitsuba_sparse.py", sparse.ROOT / "samples" / "renderers" / f"{scene}.xml", "-o", path, "--spp", spp]
        words += ["--seed", seed, "-D", f"width={SIZE[0]}", "-D", f"height={SIZE[1]}", *more]
        subprocess.run([str(word) for word in words], check=True, stdout=subprocess.DEVNULL)
    return path


def colour(path):
    channels = OpenEXR.File(str(path), separate_channels=True).parts[0].channels
    return np.stack([np.clip(channels[name].pixels.astype(np.float64), 0, 1) for name in "RGB"], -1)


def references(scene):
    """Two of their own noise, and the file of their mean."""
    halves = [colour(render(scene, f"reference{k}", REFERENCE, 100 + k, "--density", 1)) for k in (1, 2)]
    mean = OUT / f"{scene}.reference.exr"
    if not mean.exists():
        both = [OpenEXR.File(str(OUT / f"{scene}.reference{k}.exr"), separate_channels=True).parts[0].channels for k in (1, 2)]
        planes = {name: (both[0][name].pixels + both[1][name].pixels) / 2 for name in "RGB"}
        sparse.write(str(mean), planes, np.ones(planes["R"].shape, bool))
    return halves, mean


def fill(source, *flags):
    target = OUT / f"{source.stem}.filled.exr"
    subprocess.run([sparse.lacuna(), "fill", "-q", source, "-o", target, "--no-estimate", *flags], check=True)
    return target


def denoise(source, *flags):
    python = os.environ.get("PYOIDN")
    if not python:
        return None
    target = OUT / f"{source.stem}.denoised.exr"
    subprocess.run([python, HERE / "denoise.py", source, "-o", target, "--", "--no-estimate", *flags], check=True)
    return target


def ways(scene, n):
    """The images of the five ways, one after the other."""
    guides = SCENES[scene]
    thin = render(scene, f"thin{n}", n, 1, "--density", 0.25, "--halves", *guides)
    yield fill(thin)
    yield fill(thin, "--noise", "halves:half1,half2")
    yield denoise(render(scene, f"all{n}", n // 4, 2, "--density", 1, *guides))
    grid = render(scene, f"grid{n}", n, 3, "--mask", OUT / "grid.exr", *guides)
    yield denoise(grid)
    yield denoise(grid, "--noise", "auto")


def measured(scene, n):
    """PSNR and FLIP of each way."""
    (a, b), mean = references(scene)
    cells = []
    for image in ways(scene, n):
        if image is None:
            cells.append(("", ""))
            continue
        x = colour(image)
        psnr = -10 * np.log10(max(np.mean((x - a) * (x - b)), 1e-9))
        cells.append((f"{psnr:.2f}", f"{measure.compare(mean, image, OUT)[1]:.4f}"))
    return cells


def main():
    OUT.mkdir(parents=True, exist_ok=True)
    mask = [sparse.lacuna(), "mask", "-o", OUT / "grid.exr", "--size", f"{SIZE[0]}x{SIZE[1]}", "--density", "0.25", "--pattern", "grid"]
    subprocess.run(mask, check=True, stdout=subprocess.DEVNULL)
    rows = []
    for scene in sys.argv[1:] or SCENES:
        for n in SAMPLES:
            rows.append(f"| {scene} | {n} | " + " | ".join(f"{psnr} ({flip})" if psnr else "" for psnr, flip in measured(scene, n)) + " |")
            print(rows[-1], flush=True)
    if not sys.argv[1:]:
        head = "| scene | N | " + " | ".join(WAYS) + " |\n|---|---:|" + "---:|" * len(WAYS)
        measure.put("noise", "\n".join([head, *rows]), PAGE)


if __name__ == "__main__":
    main()
