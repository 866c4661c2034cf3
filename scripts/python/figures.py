"""PSNR of each method and of OpenImageIO's push-pull, as a Markdown table. Called by scripts/figures."""

import pathlib
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests"))

import frames  # noqa: E402
from tool import DATA, SAMPLES, lacuna  # noqa: E402

METHODS = ["auto", "cnn", "edge", "ss", "tv", "pushpull", "nearest"]


def row(name, full, folder, hole=0):
    mask = frames.shuffle(*full.shape[:2], 0.2, hole=hole)
    sparse, out = folder / "sparse.exr", folder / "out.exr"
    frames.write_sparse(sparse, full, mask)
    cells = []
    for method in METHODS:
        lacuna("fill", "-q", sparse, "-o", out, "--filter", method, timeout=600)
        cells.append(frames.psnr(frames.colour(out), full))
    cells.append(frames.psnr(frames.openimageio(full, mask), full))
    best = max(cells)
    words = [f"**{cell:.2f}**" if cell == best else f"{cell:.2f}" for cell in cells]
    print(f"| {name} | {' | '.join(words)} |", flush=True)


def main():
    print(f"| frame | {' | '.join(METHODS)} | OpenImageIO |\n|---|{'---:|' * (len(METHODS) + 1)}")
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for name in ("smooth", "full/sequence/shot.0001", "edges", "texture"):
            full = frames.colour(SAMPLES / f"{name}.exr", "YYY" if name == "texture" else "RGB")
            row(f"`samples/{name}.exr`", full, folder)
        if DATA.is_dir():
            for name in ("engine", "engine-soft", "tooth", "head", "aneurism-iso"):
                row(name, frames.colour(DATA / "frames" / f"{name}.exr"), folder)
            row("engine, one 256x256 bucket lost", frames.colour(DATA / "frames" / "engine.exr"), folder, hole=256)


if __name__ == "__main__":
    main()
