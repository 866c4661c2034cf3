"""PSNR of each method and of OpenImageIO's push-pull, as a Markdown table. Called by scripts/figures.

The commands are those that the README names: `lacuna sparsify FRAME -o sparse.exr --density 0.2 --seed 1`, then
`lacuna fill sparse.exr -o filled.exr --filter METHOD -d float`; the PSNR is that of `lacuna compare FRAME filled.exr`."""

import pathlib
import sys
import tempfile

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests"))

import frames  # noqa: E402
from tool import DATA, SAMPLES, lacuna  # noqa: E402

METHODS = ["auto", "cnn", "edge", "ss", "tv", "pushpull", "nearest"]


def row(name, path, folder, names="RGB", hole=0):
    sparse, out = folder / "sparse.exr", folder / "out.exr"
    lacuna("sparsify", "-q", path, "-o", sparse, "--density", 0.2, "--seed", 1)
    full, mask = frames.colour(path, names), frames.read(sparse)[0]["mask"] >= 0.5
    if hole:
        top, left = ((side - hole) // 2 for side in mask.shape)
        mask[top : top + hole, left : left + hole] = False
        frames.write_sparse(sparse, full, mask, names)
    cells = []
    for method in METHODS:
        lacuna("fill", "-q", sparse, "-o", out, "--filter", method, "-d", "float", timeout=600)
        cells.append(frames.psnr(frames.colour(out, names), full))
    # It takes three channels.
    cells.append(frames.psnr(frames.openimageio(np.broadcast_to(full, (*mask.shape, 3)), mask), full))
    best = f"{max(cells):.2f}"
    words = [f"**{cell:.2f}**" if f"{cell:.2f}" == best else f"{cell:.2f}" for cell in cells]
    print(f"| {name} | {' | '.join(words)} |", flush=True)


def main():
    print(f"| frame | {' | '.join(METHODS)} | OpenImageIO |\n|---|{'---:|' * (len(METHODS) + 1)}")
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for name in ("smooth", "full/sequence/shot.0001", "edges", "texture"):
            row(f"`samples/{name}.exr`", SAMPLES / f"{name}.exr", folder, "Y" if name == "texture" else "RGB")
        if DATA.is_dir():
            for name in ("engine", "engine-soft", "tooth", "head", "aneurism-iso"):
                row(name, DATA / "frames" / f"{name}.exr", folder)
            row("engine, one 256x256 bucket lost", DATA / "frames" / "engine.exr", folder, hole=256)


if __name__ == "__main__":
    main()
