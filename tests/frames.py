"""Frames as numpy arrays: reading, writing, masks and the quality of a reconstruction."""

import numpy as np
import OpenEXR
import OpenImageIO as oiio

BITS = {np.dtype(np.float16): np.uint16, np.dtype(np.float32): np.uint32, np.dtype(np.uint32): np.uint32}


def read(path):
    """Per part a dict: channel name -> array in the type of the file."""
    file = OpenEXR.File(str(path), separate_channels=True)
    return [{name: channel.pixels for name, channel in part.channels.items()} for part in file.parts]


def colour(path, names="RGB", part=0):
    """Channels of one part as (h, w, n) float32."""
    channels = read(path)[part]
    return np.stack([channels[name].astype(np.float32) for name in names], axis=-1)


def part(channels, origin=(0, 0), display=None, **header):
    """A part for `write`; `origin` (x, y) places the data window."""
    height, width = next(iter(channels.values())).shape
    x, y = origin
    data = (np.array([x, y], np.int32), np.array([x + width - 1, y + height - 1], np.int32))
    shown = data if display is None else tuple(np.array(corner, np.int32) for corner in display)
    header = dict(type=OpenEXR.scanlineimage, compression=OpenEXR.ZIP_COMPRESSION, dataWindow=data, displayWindow=shown) | header
    planes = {name: OpenEXR.Channel(np.ascontiguousarray(plane)) for name, plane in channels.items()}
    return OpenEXR.Part(header, planes, header.get("name", ""))


def write(path, channels, **options):
    """Writes one part, or several if `channels` is a list of parts."""
    parts = channels if isinstance(channels, list) else [part(channels, **options)]
    OpenEXR.File(parts).write(str(path))
    return path


def bits(plane):
    """The same memory as unsigned integers, so that NaN equals itself and 0 is not -0."""
    return np.ascontiguousarray(plane).view(BITS[plane.dtype])


def same_bits(one, other):
    """Whether two arrays have the same type, shape and bits."""
    return one.dtype == other.dtype and one.shape == other.shape and np.array_equal(bits(one), bits(other))


def full_mask(path, window):
    """A mask file in which every pixel of the window (x_min, y_min, x_max, y_max) is measured."""
    x_min, y_min, x_max, y_max = window
    plane = np.ones((y_max - y_min + 1, x_max - x_min + 1), np.float16)
    return write(path, {"mask": plane}, origin=(x_min, y_min))


def shuffle(height, width, density, seed=1, hole=0):
    """Low-discrepancy mask, that of `lacuna mask` but for rounding; optionally one lost square."""
    rows, columns = np.indices((height, width))
    mask = (columns * 0.7548776662466927 + rows * 0.5698402909980532 + seed * 0.618) % 1.0 < density
    if hole:
        top, left = (height - hole) // 2, (width - hole) // 2
        mask[top : top + hole, left : left + hole] = False
    return mask


def write_sparse(path, pixels, mask, names="RGB"):
    """Missing pixels 0 and the channel `mask`, in the type of the pixels."""
    planes = {name: np.where(mask, pixels[..., k], pixels.dtype.type(0)) for k, name in enumerate(names)}
    return write(path, planes | {"mask": mask.astype(pixels.dtype)})


def openimageio(full, mask):
    """OpenImageIO's push-pull on the same samples: an independent reconstruction."""
    height, width, _ = full.shape
    image = oiio.ImageBuf(oiio.ImageSpec(width, height, 4, "float"))
    image.specmod().alpha_channel = 3
    weighted = np.concatenate([full * mask[..., None], mask[..., None]], axis=-1)
    image.set_pixels(oiio.ROI(), np.ascontiguousarray(weighted, dtype=np.float32))
    filled = oiio.ImageBufAlgo.fillholes_pushpull(image).get_pixels(oiio.FLOAT)[..., :3]
    return np.where(mask[..., None], full, filled)


def psnr(one, other):
    """Peak 1, both clipped to [0, 1]; in dB."""
    error = np.mean((np.clip(one, 0, 1).astype(np.float64) - np.clip(other, 0, 1)) ** 2)
    return np.inf if error == 0 else -10 * np.log10(error)
