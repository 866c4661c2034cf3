"""Fills an image with OpenImageIO's ImageBuf: any format that it reads in, any that it writes out.

    python openimageio_buffers.py sparse.exr filled.exr

The channels R, G, B are filled where the channel `mask` is 0 (without one: where they are NaN); all others stay as they are.
"""

import sys

import lacuna
import numpy as np
import OpenImageIO as oiio


def fill(sparse: oiio.ImageBuf) -> oiio.ImageBuf:
    """The same image, complete."""
    pixels = sparse.get_pixels(oiio.FLOAT)
    names = list(sparse.spec().channelnames)
    colour = [names.index(name) for name in "RGB"]
    mask = pixels[:, :, names.index("mask")] if "mask" in names else None
    filled, said = lacuna.fill(pixels[:, :, colour], mask, estimate=True)
    pixels[:, :, colour] = filled
    if mask is not None:
        pixels[:, :, names.index("mask")] = 1
    if said.psnr is not None:
        print(f"about {said.psnr:.1f} dB (nine times of ten between {said.low:.1f} and {said.high:.1f})")
    result = oiio.ImageBuf(sparse.spec())
    result.set_pixels(oiio.ROI(), np.ascontiguousarray(pixels))
    return result


if __name__ == "__main__":
    source = oiio.ImageBuf(sys.argv[1])
    if source.has_error:
        sys.exit(source.geterror())
    result = fill(source)
    if not result.write(sys.argv[2]):
        sys.exit(result.geterror())
