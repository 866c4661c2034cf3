"""What the bridges to renderers share: frames and their names, masks in, sparse EXR frames out.

Needs numpy and OpenEXR (PyPI), or for masks alone OpenImageIO; masks from a density need `lacuna` itself: the environment's LACUNA, the PATH, or
target/release of the checkout that this file lies in.
"""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

import numpy as np

try:
    import OpenEXR
except ImportError:  # Blender has OpenImageIO instead
    OpenEXR = None

ROOT = pathlib.Path(__file__).resolve().parents[2]


class Failure(Exception):
    """What stops a frame or a run, in one line for people."""


def frame_name(pattern, frame):
    """The path of a frame: #### (a single # is four digits), %04d, or a plain name."""
    text = str(pattern)
    if re.search(r"%0?\d*d", text):
        return re.sub(r"%0?(\d*)d", lambda found: str(frame).zfill(int(found.group(1) or 1)), text)
    digits = lambda found: str(frame).zfill(4 if len(found.group()) == 1 else len(found.group()))
    return re.sub(r"#+", digits, text)


def is_pattern(text):
    return bool(re.search(r"#|%0?\d*d", str(text)))


def frame_range(text):
    """1-10, 1-10x2 and 1,5,9-12 as a list of numbers."""
    frames = []
    for piece in text.split(","):
        found = re.fullmatch(r"(-?\d+)(?:-(-?\d+)(?:[x:](\d+))?)?", piece.strip())
        if not found:
            raise ValueError(f"'{text}' is no range of frames: write 1-10, 1-10x2 or 1,5,9-12")
        first, last, step = (int(part) if part else None for part in found.groups())
        last = first if last is None else last
        frames += range(first, last + 1, step or 1) if last >= first else range(first, last - 1, -(step or 1))
    return frames


def add_arguments(parser):
    """The arguments that every bridge has."""
    parser.add_argument("-o", "--output", required=True, metavar="PATTERN", help="the sparse frames, frame.####.exr")
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--mask", metavar="PATTERN", help="pixels to render: an EXR mask, or a pattern that goes frame by frame")
    which.add_argument("--density", type=float, metavar="D", help="share of the pixels to render, by `lacuna mask`")
    parser.add_argument("--frames", type=frame_range, default=None, metavar="RANGE", help="1-10, 1-10x2 or 1,5,9-12")
    parser.add_argument("--spp", type=int, metavar="N", help="samples a pixel [default: what the scene says]")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the mask and of the renderer's noise [default: 0]")


def check(arguments):
    """Frames to do; refuses arguments that do not fit together."""
    if arguments.density is not None and not 0 < arguments.density <= 1:
        raise Failure(f"--density {arguments.density} is not above 0 and at most 1")
    if arguments.spp is not None and arguments.spp < 1:
        raise Failure(f"--spp {arguments.spp} is not 1 or more")
    if arguments.seed < 0:
        raise Failure(f"--seed {arguments.seed} is not 0 or more")
    frames = arguments.frames or [1]
    if len(frames) > 1 and not is_pattern(arguments.output):
        raise Failure(f"{arguments.output} would hold {len(frames)} frames: write frame.####.exr")
    return frames


def run(body, end=sys.exit):
    """Runs a bridge: a failure is one line and exit status 1. `end` takes the status."""
    status = 0
    try:
        body()
    except Failure as failure:
        print(f"{pathlib.Path(sys.argv[0]).name}: {failure}", file=sys.stderr)
        status = 1
    sys.stdout.flush()
    end(status)


def lacuna():
    """The binary."""
    found = os.environ.get("LACUNA") or shutil.which("lacuna") or ROOT / "target" / "release" / "lacuna"
    if not os.access(found, os.X_OK):
        raise Failure("no lacuna to make the mask: set LACUNA, put it on the PATH, or give --mask")
    return str(found)


def mask_of(arguments, frame, width, height, origin=(0, 0)):
    """The pixels to render, `(height, width)` of bool; `origin` is the data window's first pixel (x, y)."""
    if arguments.density is None:
        return read_mask(frame_name(arguments.mask, frame), width, height, origin)
    if arguments.density == 1:
        return np.ones((height, width), bool)
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "mask.exr"
        size = f"{width}x{height}{origin[0]:+d}{origin[1]:+d}"
        words = [lacuna(), "mask", "-q", "-o", path, f"--size={size}", "--density", arguments.density, "--seed", arguments.seed]
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True)
        if done.returncode != 0:
            raise Failure(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "lacuna mask failed")
        return read_mask(path, width, height, origin)


def read_mask(path, width, height, origin=(0, 0)):
    """The channel `mask`, or the only one, by absolute pixel coordinates: one half or more is measured."""
    try:
        channels, x, y = (read_part if OpenEXR else read_subimage)(str(path))
    except Exception as error:
        raise Failure(f"{path}: cannot be read as an EXR mask ({error})") from None
    name = "mask" if "mask" in channels else next(iter(channels)) if len(channels) == 1 else None
    if name is None:
        raise Failure(f"{path}: no channel 'mask' among {', '.join(channels)}")
    pixels = channels[name]
    top, left = origin[1] - y, origin[0] - x
    if top < 0 or left < 0 or top + height > pixels.shape[0] or left + width > pixels.shape[1]:
        raise Failure(f"{path}: the mask does not cover {width}x{height} at {origin}: make it with lacuna mask --size")
    mask = pixels[top : top + height, left : left + width] >= 0.5
    if not mask.any():
        raise Failure(f"{path}: no pixel is to be rendered")
    return mask


def read_part(path):
    """Channels of the first part, and the first pixel (x, y) of its data window."""
    part = OpenEXR.File(path, separate_channels=True).parts[0]
    return {name: channel.pixels for name, channel in part.channels.items()}, *part.header["dataWindow"][0]


def read_subimage(path):
    """The same by OpenImageIO."""
    import OpenImageIO

    image = OpenImageIO.ImageBuf(path)
    spec, pixels = image.spec(), image.get_pixels("float")
    if image.has_error or pixels is None:
        raise OSError(image.geterror())
    return {name: pixels[..., k] for k, name in enumerate(spec.channelnames)}, spec.x, spec.y


def scatter(values, mask):
    """Values of the masked pixels, row by row, as an image; zero elsewhere."""
    image = np.zeros((*mask.shape, *values.shape[1:]), values.dtype)
    image[mask] = values
    return image


def write(path, planes, mask, dense=(), origin=(0, 0), display=None, kind=np.float32, attributes=None, whole=()):
    """Writes a sparse frame: `planes` (name to `(height, width)`), zero where nothing was rendered, the channel `mask`,
    and lacuna's attributes. Names in `dense` are complete and said to be; those in `whole` are written as they are. The
    file appears complete or not at all."""
    height, width = mask.shape
    x, y = origin
    shown = display or (x, y, x + width - 1, y + height - 1)
    corner = lambda x, y: np.array([x, y], np.int32)
    header = {
        "type": OpenEXR.scanlineimage,
        "compression": OpenEXR.ZIP_COMPRESSION,
        "dataWindow": (corner(x, y), corner(x + width - 1, y + height - 1)),
        "displayWindow": (corner(*shown[:2]), corner(*shown[2:])),
        "lacuna/mask": "mask",
        "lacuna/density": float(mask.mean()),
    }
    header |= {"lacuna/dense": ",".join(dense)} if dense else {}
    header |= attributes or {}
    channels = {}
    for name, plane in planes.items():
        if name not in dense and name not in whole:
            plane = np.where(mask, plane, plane.dtype.type(0))
        is_float = plane.dtype.kind == "f"
        channels[name] = np.ascontiguousarray(plane, kind if is_float and not exact(name) else plane.dtype)
    channels["mask"] = mask.astype(np.float16)
    path = pathlib.Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        OpenEXR.File(header, channels).write(str(temporary))
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def exact(name):
    """Whether a channel needs all of a float: depths, positions, counts and identifiers."""
    return re.split(r"[.]", name)[0].lower() in ("depth", "z", "p", "position", "samplecount", "id", "uv")


class Clock:
    """Seconds since it was made, and seconds that this process has kept processors busy since."""

    def __init__(self):
        self.wall, self.busy = time.perf_counter(), time.process_time()

    def stop(self):
        self.wall, self.busy = time.perf_counter() - self.wall, time.process_time() - self.busy
        return self


def seed_of(arguments, frame):
    """A seed of 31 bits that every frame of every --seed has for itself, as good as."""
    return int(np.random.SeedSequence([arguments.seed, frame & 0xFFFFFFFF]).generate_state(1)[0] >> 1)


def say(path, mask, clock):
    share = f"{int(mask.sum())} of {mask.size} pixels ({100 * mask.mean():.1f} %)"
    print(f"{path}: {share} in {clock.wall:.2f} s, {clock.busy:.2f} s of processors", flush=True)
