"""Pictures and figures of docs/guided.md. Called by scripts/guided; arguments: the folder of the pictures, [renders].

With a second argument, a folder, renders are kept there (gallery.exr, failures.exr) and taken from there if they exist.
"""

import os
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
import OpenEXR
from PIL import Image

ROOT = pathlib.Path(__file__).resolve().parents[2]
LACUNA = os.environ.get("LACUNA", ROOT / "target" / "release" / "lacuna")
GAP = 4


def read(path):
    file = OpenEXR.File(str(path), separate_channels=True)
    return {name: channel.pixels for name, channel in file.parts[0].channels.items()}


def write(path, planes):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {name: np.ascontiguousarray(plane) for name, plane in planes.items()}).write(str(path))


def shuffle(height, width, density):
    rows, columns = np.indices((height, width))
    return (columns * 0.7548776662466927 + rows * 0.5698402909980532 + 0.618) % 1.0 < density


def colour(planes):
    return np.stack([planes[name] for name in "RGB"], -1).astype(np.float64)


def decibels(one, other, where=...):
    squares = ((np.clip(one, 0, 1) - np.clip(other, 0, 1)) ** 2).mean(-1)[where]
    return -10 * np.log10(squares.mean())


def shown(linear):
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def sheet(path, rows):
    height, width, _ = rows[0][0].shape
    canvas = np.ones(((height + GAP) * len(rows) - GAP, (width + GAP) * len(rows[0]) - GAP, 3))
    for r, row in enumerate(rows):
        for c, picture in enumerate(row):
            canvas[r * (height + GAP) :, c * (width + GAP) :][:height, :width] = picture
    Image.fromarray((canvas * 255 + 0.5).astype(np.uint8)).quantize(255, dither=Image.Dither.NONE).save(path, optimize=True)


def fill(folder, planes, mask, *words):
    sparse = {name: np.where(mask, plane, np.float32(0)) if name in "RGB" else plane for name, plane in planes.items()}
    write(folder / "sparse.exr", sparse | {"mask": mask.astype(np.float32)})
    subprocess.run([LACUNA, "fill", "-q", folder / "sparse.exr", "-o", folder / "full.exr", *words], check=True)
    return colour(read(folder / "full.exr"))


def scene(folder, keep, name):
    path = (keep or folder) / f"{name}.exr"
    if not path.exists():
        script = pathlib.Path(__file__).with_name("guided_scene.py")
        subprocess.run([sys.executable, script, name, path], check=True)
    return read(path)


def main():
    pictures = pathlib.Path(sys.argv[1])
    keep = pathlib.Path(sys.argv[2]) if len(sys.argv) > 2 else None
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for name in ("gallery", "failures"):
            planes = scene(folder, keep, name)
            full = colour(planes)
            rows = []
            for density in (0.05, 0.1, 0.2):
                mask = shuffle(*full.shape[:2], density)
                plain = fill(folder, planes, mask, "--guides", "none", "--channels", "[!RGB]*=keep")
                guided = fill(folder, planes, mask)
                print(f"{name} {density:.2f}: unguided {decibels(plain, full):.2f} dB, guided {decibels(guided, full):.2f} dB")
            labels = np.round(planes["id"])
            for label in np.unique(labels[labels > 0]):
                where = labels == label
                if where.sum() > 100:
                    pair = (decibels(plain, full, where), decibels(guided, full, where))
                    paint = [float(planes[f"albedo.{k}"][where].mean()) for k in "RGB"]
                    print(f"  id {label:.0f}: {where.sum()} pixels, unguided {pair[0]:.2f}, guided {pair[1]:.2f}; mean albedo "
                          + " ".join(f"{value:.2f}" for value in paint))
            normal = np.stack([planes[f"N.{axis}"] for axis in "XYZ"], -1) * 0.5 + 0.5
            paint = np.stack([planes[f"albedo.{k}"] for k in "RGB"], -1)
            error = np.repeat(np.sqrt(((np.clip(guided, 0, 1) - np.clip(full, 0, 1)) ** 2).mean(-1, keepdims=True)), 3, -1)
            rows = [[shown(full * mask[..., None]), shown(plain), shown(guided)], [shown(paint), normal, shown(full)]]
            if name == "failures":
                rows[1][0] = np.clip(8 * error, 0, 1)
            sheet(pictures / f"guided-{name}.png", rows)


if __name__ == "__main__":
    main()
