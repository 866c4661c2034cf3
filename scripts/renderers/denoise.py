#!/usr/bin/env python3
"""Denoises the measured pixels of a grid with Intel's Open Image Denoise, then fills with lacuna, for path-traced frames.

    lacuna mask -o grid.exr --size 1920x1080 --density 0.25 --pattern grid
    mitsuba_sparse.py scene.xml -o noisy.exr --mask grid.exr --spp 16 --aovs albedo,N,depth,id --dense-aovs
    denoise.py noisy.exr -o filled.exr                   # pack, denoise, put back, fill guided
    denoise.py noisy.exr -o filled.exr -- --noise auto   # what follows -- goes to lacuna fill

A denoiser wants noise of its own in every pixel and neighbours side by side, so that the measured pixels of a grid are packed into a small
image, with `albedo` and `N` of the same pixels where the frame has them. Never the other way round: what was filled has noise
that correlates, which no denoiser takes for noise. A frame of which every pixel is measured is denoised, and nothing is filled.

Needs Python 3.11 or newer with pyoidn, numpy and OpenEXR, none of which lacuna itself needs: pip install pyoidn numpy OpenEXR.
"""

import pathlib
import subprocess
import sys
import tempfile

import bridge
from bridge import Failure

with bridge.needing("pyoidn numpy OpenEXR", "a Python that has them"):
    import numpy as np
    import OpenEXR
    import pyoidn

    import sparse

COLOUR, ALBEDO, NORMAL = "R G B".split(), "albedo.R albedo.G albedo.B".split(), "N.X N.Y N.Z".split()


def grid(mask, path):
    """The rows and columns of the measured pixels, which must be all crossings of evenly spaced ones."""
    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    even = all(len(set(np.diff(line))) <= 1 for line in (rows, columns))
    if not (len(rows) and even and mask[np.ix_(rows, columns)].all()):
        raise Failure(f"{path}: its measured pixels are no grid: render those of lacuna mask --pattern grid")
    return np.ix_(rows, columns)


def packed(planes, names, at):
    """The named planes at the pixels of a grid, one behind the other; nothing where any is missing."""
    if not all(name in planes for name in names):
        return None
    return np.ascontiguousarray(np.stack([planes[name][at] for name in names], -1), np.float32)


def denoise(planes, mask, path):
    """Replaces the colour of the measured pixels."""
    at = grid(mask, path)
    colour, albedo, normal = (packed(planes, names, at) for names in (COLOUR, ALBEDO, NORMAL))
    if colour is None:
        raise Failure(f"{path}: no channels R, G and B: name the frame's colour so")
    if not np.isfinite(colour).all():
        raise Failure(f"{path}: R, G or B is not finite at a measured pixel: render it again, or set it to 0")
    guides = {"albedo": None if albedo is None else np.clip(albedo, 0, 1), "normal": normal}
    guides = {name: np.nan_to_num(image) for name, image in guides.items() if image is not None}
    if "albedo" not in guides:
        guides = {}  # a normal alone is nothing that the library takes
    smooth = pyoidn.denoise(colour, hdr=True, **guides)
    for k, name in enumerate(COLOUR):
        most = np.finfo(planes[name].dtype).max
        planes[name][at] = np.clip(smooth[..., k], -most, most)


def main():
    words = sys.argv[1:]
    more = words[words.index("--") + 1 :] if "--" in words else []
    parser = bridge.Parser(__doc__)
    parser.add_argument("frame", help="noisy.exr: R, G, B and mask, and complete guides where there are any")
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="filled.exr")
    parser.add_argument("--force", action="store_true", help="replace an output that is read-only, too")
    arguments = parser.parse_args(words[: words.index("--")] if "--" in words else words)
    path = arguments.frame
    sparse.place(arguments.output, arguments.force)
    try:
        with sparse.quiet():
            file = OpenEXR.File(path, separate_channels=True)
        part = file.parts[0]
    except Exception as error:
        raise Failure(f"{path}: cannot be read: {bridge.brief(error)}") from None
    planes = {name: channel.pixels for name, channel in part.channels.items()}
    if "mask" not in planes:
        raise Failure(f"{path}: no channel mask: which pixels were measured?")
    mask = planes["mask"] >= 0.5
    denoise(planes, mask, path)
    # Halves are those of the noise that is gone.
    for name in [name for name in planes if name.split(".")[0] in ("half1", "half2")]:
        del part.channels[name]
    part.header["denoiser"] = f"Open Image Denoise by pyoidn, {'grid of measured pixels' if not mask.all() else 'all pixels'}"

    def write(to):
        to = sparse.ready(to, arguments.force)
        with sparse.temporary(to, ".tmp") as new, sparse.quiet():
            file.write(str(new))

    if mask.all():
        write(arguments.output)
        return
    with tempfile.TemporaryDirectory() as folder:
        thin = pathlib.Path(folder) / pathlib.Path(path).with_suffix(".exr").name
        write(thin)
        if subprocess.run([sparse.lacuna(), "fill", "-q", thin, "-o", arguments.output, *(["--force"] if arguments.force else []), *more]).returncode:
            raise Failure(f"{path}: the denoised grid was not filled")


if __name__ == "__main__":
    bridge.run(main)
