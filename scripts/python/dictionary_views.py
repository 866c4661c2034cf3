"""Frames, masks and pictures for dictionary.py."""

import os
import pathlib
import subprocess
import sys
import time

import numpy as np
import OpenEXR
from PIL import Image

ROOT = pathlib.Path(__file__).resolve().parents[2]
LACUNA = os.environ.get("LACUNA", ROOT / "target" / "release" / "lacuna")
GAP = 4


def lacuna(*words):
    """Runs the tool; the seconds that it took and what it said."""
    start = time.monotonic()
    done = subprocess.run([LACUNA, *map(str, words)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, words))}: {done.stderr}")
    return time.monotonic() - start, done.stdout or done.stderr


def read(path):
    file = OpenEXR.File(str(path), separate_channels=True)
    return {name: channel.pixels for name, channel in file.parts[0].channels.items()}


def write(path, planes):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    planes = {name: np.ascontiguousarray(plane, np.float32) for name, plane in planes.items()}
    OpenEXR.File(header, planes).write(str(path))


def colour(planes):
    return np.stack([planes[name] for name in "RGB"], -1).astype(np.float64)


def sparse(path, truth, mask):
    """A frame of R, G and B, or of Y, of which the mask's pixels are left."""
    names = "RGB" if truth.ndim == 3 else "Y"
    planes = {name: truth[..., at] if truth.ndim == 3 else truth for at, name in enumerate(names)}
    write(path, {name: np.where(mask, plane, 0) for name, plane in planes.items()} | {"mask": mask})


def shuffle(height, width, density):
    """The even mask of `lacuna sparsify`."""
    rows, columns = np.indices((height, width))
    return (columns * 0.7548776662466927 + rows * 0.5698402909980532) % 1.0 < density


def decibels(one, other):
    squares = (np.clip(one, 0, 1) - np.clip(other, 0, 1)) ** 2
    return -10 * np.log10(squares.mean())


def shown(linear):
    linear = np.clip(linear, 0, 1)
    if linear.ndim == 2:
        linear = linear[..., None].repeat(3, -1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def picture(path, rows, width):
    """Rows of images side by side, each so wide."""
    tiles = [[Image.fromarray((shown(image) * 255 + 0.5).astype(np.uint8)) for image in row] for row in rows]
    height = round(width * tiles[0][0].height / tiles[0][0].width)
    sheet = Image.new("RGB", ((width + GAP) * len(rows[0]) - GAP, (height + GAP) * len(rows) - GAP), "white")
    for r, row in enumerate(tiles):
        for c, tile in enumerate(row):
            sheet.paste(tile.resize((width, height), Image.Resampling.LANCZOS), ((width + GAP) * c, (height + GAP) * r))
    sheet.save(path, quality=80, optimize=True)
