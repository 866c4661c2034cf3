"""What the bridges to renderers share: arguments, masks in, sparse EXR frames out.

Needs numpy and OpenEXR (PyPI), or for masks alone OpenImageIO; masks from a density need `lacuna` itself: the environment's
LACUNA, the PATH, or target/release of the checkout that this file lies in.
"""

import argparse
import contextlib
import functools
import io
import os
import pathlib
import re
import shlex
import shutil
import struct
import subprocess
import sys
import tempfile
import time

import numpy as np

from bridge import Failure, Misuse, brief, check_signal
from sequence import frame_name, frame_range, is_pattern, source_name

try:
    import OpenEXR
except ImportError:  # Blender has OpenImageIO instead
    OpenEXR = None

ROOT = pathlib.Path(__file__).resolve().parents[2]
# Rounds in which pixels are chosen, and what the first has of them: fewer and more than in `lacuna render --adaptive`, as each is a call of the renderer.
ROUNDS, FIRST = 5, 0.3
# Of `lacuna mask`.
MOST_SEED = (1 << 64) - 1


def add_arguments(parser):
    """The arguments that every bridge has."""
    parser.add_argument("-o", "--output", required=True, metavar="PATTERN", help="the sparse frames, frame.####.exr")
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--mask", metavar="PATTERN", help="pixels to render: an EXR mask, or a pattern that goes frame by frame")
    which.add_argument("--density", type=float, metavar="D", help="share of the pixels to render, by `lacuna mask`")
    parser.add_argument("--frames", type=frame_range, default=None, metavar="RANGE", help="1-10, 1-10x2 or 1,5,9-12")
    parser.add_argument("--spp", type=int, metavar="N", help="samples a pixel [default: what the scene says]")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the mask and of the renderer's noise [default: 0]")
    parser.add_argument("--force", action="store_true", help="replace outputs that are read-only, too")
    parser.add_argument("--adaptive", action="store_true", help="choose the pixels of --density in rounds, by the estimated error of the fill so far")
    parser.add_argument("--rounds", type=int, metavar="N", help=f"of --adaptive, the first spread evenly [default: {ROUNDS}]")
    parser.add_argument("--first", type=float, metavar="D", help=f"density of the first round [default: {FIRST} of --density]")


def add_halves(parser):
    """The argument of bridges that can render a frame as two."""
    parser.add_argument("--halves", action="store_true",
                        help="the colour of either half of the samples too, as layers half1 and half2: lacuna fill --noise halves:half1,half2")


def in_halves(draw, spp):
    """`draw(spp, turn)` called for each half of the samples: the planes of both, and both colours as layers. Depths and what else must
    not be averaged are those of the first."""
    if spp % 2:
        raise Failure(f"--halves wants an even number of samples a pixel, not {spp}: give --spp")
    one, other = draw(spp // 2, 0), draw(spp // 2, 1)
    names = [name for name in ("R", "G", "B", "Y") if name in one]
    if not names:
        raise Failure("--halves wants colour, and the scene's integrator makes none: put one into it that does, such as path")
    planes = {name: plane if exact(name) or plane.dtype.kind != "f" else (plane + other[name]) / 2 for name, plane in one.items()}
    for layer, half in (("half1", one), ("half2", other)):
        planes |= {f"{layer}.{name}": half[name] for name in names}
    return planes


def check(arguments, scene=None):
    """Frames to do; refuses arguments that do not fit together. `scene` is the file, or the pattern, that is read."""
    if arguments.density is not None and not 0 < arguments.density <= 1:
        raise Misuse(f"--density {arguments.density} is not above 0 and at most 1")
    if arguments.spp is not None and arguments.spp < 1:
        raise Misuse(f"--spp {arguments.spp} is not 1 or more")
    if not 0 <= arguments.seed <= MOST_SEED:
        raise Misuse(f"--seed {arguments.seed} is not 0 or more and at most {MOST_SEED}")
    check_rounds(arguments)
    frames = arguments.frames or [1]
    if len(frames) > 1 and not is_pattern(arguments.output):
        raise Misuse(f"{arguments.output} would hold {len(frames)} frames: write frame.####.exr")
    names = [frame_name(arguments.output, frame) for frame in frames]
    written = {os.path.realpath(place(name, arguments.force)): name for name in names}
    for what, pattern in (("the mask", arguments.mask), ("the scene", scene)):
        for frame in frames if pattern else []:
            output = written.get(os.path.realpath(source_name(pattern, frame)))
            if output:
                raise Misuse(f"-o {output}: the output is the same file as {what}; nothing is overwritten in place: name another file")
    return frames


def check_rounds(arguments):
    """Fills in what --adaptive takes; refuses what has no meaning."""
    if not arguments.adaptive:
        if arguments.rounds is not None or arguments.first is not None:
            raise Misuse("--rounds and --first are about --adaptive: give that as well")
        return
    if arguments.density is None:
        raise Misuse("--adaptive needs --density, which counts all rounds")
    if arguments.rounds == 1 and arguments.first is not None:
        raise Misuse(f"--first {arguments.first}: the only round of --rounds 1 takes all pixels")
    arguments.rounds = ROUNDS if arguments.rounds is None else arguments.rounds
    arguments.first = FIRST * arguments.density if arguments.first is None else arguments.first
    if arguments.rounds < 1:
        raise Misuse(f"--rounds {arguments.rounds} is not 1 or more")
    if not 0 < arguments.first <= arguments.density:
        raise Misuse(f"--first {arguments.first} is not above 0 and at most --density {arguments.density}")
    arguments.adaptive = arguments.rounds > 1


def place(text, force=False):
    """The path to write, links followed; refuses what cannot be written or must not be replaced, with `force` not what is read-only.
    Makes nothing yet."""
    if not text or text.endswith(os.sep):
        raise Misuse(f"-o '{text}' names no file: write frame.####.exr")
    path = pathlib.Path(os.path.realpath(text) if os.path.islink(text) else text)
    try:
        if path.is_dir():
            raise Failure(f"-o {text}: this is a folder: name a file in it")
        if path.exists() and not path.is_file():
            raise Failure(f"-o {text}: this exists and is no regular file: name another one")
        # By the mode as well: root may write to all.
        if path.exists() and not force and not (os.access(path, os.W_OK) and path.stat().st_mode & 0o222):
            raise Failure(f"-o {text}: this exists and is read-only: make it writable or remove it, or give --force")
        above = next(folder for folder in path.absolute().parents if folder.exists())
        if not above.is_dir():
            raise Failure(f"-o {text}: {above} is a file and no folder: name another path")
        check_folder(above)
    except OSError as error:
        raise Failure(f"-o {text}: {error.strerror}: name another path") from None
    if not text.lower().endswith(".exr"):
        raise Misuse(f"-o {text}: an output file ends in .exr")
    return path


@functools.cache
def check_folder(folder):
    """Refuses one that takes no file, by trying: root may write to all, and still not to /proc."""
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise OSError(error.errno, f"{folder} cannot be written to ({error.strerror})") from None


def ready(text, force=False):
    """The same before a frame is rendered: its folder is made."""
    path = place(os.fspath(text), force)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise Failure(f"-o {text}: its folder cannot be made ({error.strerror}): name another path") from None
    return path


def each(what, frames, render, line=0):
    """Renders frame after frame; the first that fails ends it, and is named with `what` (the scene)."""
    for frame in frames:
        try:
            render(frame)
        except Failure:
            raise
        except Exception as error:
            raise Failure(f"{what}, frame {frame}: {brief(error, line)}") from None


def once(flag, names):
    """Refuses names given twice."""
    for name in names:
        if names.count(name) > 1:
            raise Misuse(f"{flag}: {name} is given twice")


def lacuna():
    """The binary."""
    named = os.environ.get("LACUNA")
    if named:
        found = shutil.which(named)
        if not found:
            why = "is a folder" if os.path.isdir(named) else "may not be run" if os.path.exists(named) else "does not exist"
            raise Failure(f"LACUNA names {named}, which {why}: let it name the binary, or give --mask")
        return found
    found = shutil.which("lacuna") or shutil.which(ROOT / "target" / "release" / "lacuna")
    if not found:
        raise Failure("no lacuna to make the mask: set LACUNA, put it on the PATH, or give --mask")
    return str(found)


def frame(arguments, frame, size, draw, origin=(0, 0), finish=None):
    """Makes one frame of `(width, height)` pixels: `draw(mask, path)` renders the pixels of a mask into a sparse frame, and returns what it
    took. With --adaptive in rounds, each where the estimated error of the fill so far is largest; what fails in a later round leaves
    the frame of those before. `finish(path, mask)` gives attributes of all rounds, by name."""
    path = ready(frame_name(arguments.output, frame), arguments.force)
    if not arguments.adaptive:
        mask = mask_of(arguments, frame, *size, origin)
        say(path, *draw(mask, path))
        return
    most = max(1, round(arguments.density * size[0] * size[1]))
    if arguments.rounds > max(most, ROUNDS):
        raise Misuse(f"--rounds {arguments.rounds} is more than the {most} pixels that are measured")
    # Beside the target, so that the last step is a rename.
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{beginning(path)}.") as folder:
        so_far, mask, clock = in_rounds(arguments, frame, size, origin, draw, pathlib.Path(folder), path, finish)
        complete(so_far, mask, finish)
        check_signal()
        so_far.replace(path)
    say(path, mask, clock)


def complete(path, mask, finish):
    """Gives the frame of several rounds the attributes that `lacuna mask --merge` leaves out, or takes from the first."""
    stamp(path, {"lacuna/density": float(mask.mean())} | (finish(path, mask) if finish else {}))


def in_rounds(arguments, frame, size, origin, draw, folder, path, finish):
    """The file of all rounds, its mask, and what rendering took."""
    next_mask, so_far = folder / f"mask.{frame}.exr", folder / f"frame.{frame}.exr"
    # By its number, a frame of a sequence chooses other pixels of the same places than those beside it.
    numbered, before, output = ([f"--frames={frame}"], folder / "frame.%d.exr", folder / "mask.%d.exr") if arguments.frames else ([], so_far, None)
    mask, clock = draw(even_mask(arguments, frame, arguments.first, *size, origin), so_far)
    for turn in range(1, arguments.rounds):
        more, both = folder / "more.exr", folder / "both.exr"
        # What renderers gave no samples is asked for again.
        add = (arguments.first + (arguments.density - arguments.first) * turn / (arguments.rounds - 1)) - mask.mean()
        if add * mask.size < 1:
            continue
        next_mask.unlink(missing_ok=True)
        try:
            make_mask(next_mask, "--after", before, f"--add={add:.9f}", "--seed", arguments.seed, *numbered, output=output)
            found, took = draw(read_mask(next_mask, *size, origin), more)
            make_mask(both, "--merge", so_far, more)
        except Exception as error:
            check_signal()
            complete(so_far, mask, finish)
            so_far.replace(path)
            reason = str(error) if isinstance(error, Failure) else brief(error)
            raise Failure(f"{path}: round {turn + 1} of {arguments.rounds} failed, the frame has those before it: {reason}") from None
        more.unlink()
        both.replace(so_far)
        mask, clock = mask | found, clock.and_of(took)
    return so_far, mask, clock


def make_mask(path, *words, output=None):
    """Runs `lacuna mask`, which writes `path`; told so by a pattern, if there is one."""
    command = [lacuna(), "mask", "-q", "-o", str(output or path), *map(str, words)]
    way = "let LACUNA name the binary of lacuna, or give --mask"
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace")
    except OSError as error:
        raise Failure(f"{command[0]} cannot be run ({error.strerror}): {way}") from None
    if done.returncode != 0:
        said = done.stderr.strip().splitlines()
        raise Failure(f"{command[0]} mask: {said[-1] if said else f'ended with status {done.returncode}: {way}'}")
    if not path.is_file():
        raise Failure(f"'{shlex.join(command)}' wrote no mask: {way}")


def mask_of(arguments, frame, width, height, origin=(0, 0)):
    """The pixels to render, `(height, width)` of bool; `origin` is the data window's first pixel (x, y)."""
    if arguments.density is None:
        return read_mask(source_name(arguments.mask, frame), width, height, origin)
    return even_mask(arguments, frame, arguments.density, width, height, origin)


def even_mask(arguments, frame, density, width, height, origin):
    """A part of the pixels, spread evenly."""
    if density == 1:
        return np.ones((height, width), bool)
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / f"mask.{frame}.exr"
        size = f"{width}x{height}{origin[0]:+d}{origin[1]:+d}"
        # Masks of frames in a row complete each other.
        number = [f"--frames={frame}", "--temporal=complementary"] if arguments.frames else []
        pattern = path.with_name("mask.%d.exr") if number else path
        make_mask(path, f"--size={size}", "--density", density, "--seed", arguments.seed, *number, output=pattern)
        return read_mask(path, width, height, origin)


def read_mask(path, width, height, origin=(0, 0)):
    """The channel `mask`, or the only one, by absolute pixel coordinates: one half or more is measured."""
    check_exr(path)
    try:
        with quiet():
            channels, x, y = (read_part if OpenEXR else read_subimage)(str(path))
    except Exception:
        raise Failure(f"{path}: the mask is truncated or damaged: make it again with lacuna mask") from None
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


def check_exr(path):
    """Refuses what is no EXR file, before a library does at length."""
    try:
        if not pathlib.Path(path).is_file():
            why = "is no regular file" if pathlib.Path(path).exists() else "does not exist"
            raise Failure(f"{path}: the mask {why}: make one with lacuna mask, or give --density")
        with open(path, "rb") as file:
            if file.read(4) != b"\x76\x2f\x31\x01":
                raise Failure(f"{path}: the mask is no EXR file: make one with lacuna mask, or give --density")
    except OSError as error:
        raise Failure(f"{path}: the mask cannot be read: {error.strerror}") from None


@contextlib.contextmanager
def quiet():
    """Nothing is said meanwhile: OpenEXR tells what it raises on both outputs as well."""
    if sys.stderr is None:
        yield
        return
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        with open(os.devnull, "wb") as nothing:
            os.dup2(nothing.fileno(), 2)
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


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
    between = "\n" if any("," in name for name in dense) else ","
    header |= {"lacuna/dense": between.join(dense)} if dense else {}
    header |= attributes or {}
    channels = {}
    for name, plane in planes.items():
        if name not in dense and name not in whole:
            plane = np.where(mask, plane, plane.dtype.type(0))
        is_float = plane.dtype.kind == "f"
        channels[name] = np.ascontiguousarray(plane, kind if is_float and not exact(name) else plane.dtype)
    channels["mask"] = mask.astype(np.float16)
    path = ready(path, force=True)  # asked before
    with temporary(path, ".tmp") as part, quiet():
        OpenEXR.File(header, channels).write(str(part))


def stamp(path, attributes):
    """Sets attributes, numbers and texts, in the parts of an EXR file that have `lacuna/mask`. The pixels are copied as they are."""
    with open(path, "rb") as file, temporary(path, ".stamped") as part, open(part, "wb") as new:
        start = file.read(8)
        parts = list(headers(file, several=start[5] & 0x10))
        # The places of the chunks go up to the first of them.
        places, first = [], sys.maxsize
        while file.tell() < first:
            places += struct.unpack("<Q", file.read(8))
            first = min(first, places[-1])
        for header in parts:
            if "lacuna/mask" in header:
                for name, value in attributes.items():
                    header[name] = ("string", value.encode()) if isinstance(value, str) else ("float", struct.pack("<f", value))
        new.write(start)
        for header in parts:
            for name, (kind, value) in header.items():
                new.write(b"%s\0%s\0%s%s" % (name.encode(), kind.encode(), struct.pack("<i", len(value)), value))
            new.write(b"\0")
        new.write(b"\0" if start[5] & 0x10 else b"")
        moved = new.tell() + 8 * len(places) - file.tell()
        new.write(struct.pack(f"<{len(places)}Q", *(place + moved for place in places)))
        shutil.copyfileobj(file, new)


def headers(file, several):
    """Each part's attributes, of an EXR file that is read up to them: name to type and value."""
    word = lambda: b"".join(iter(lambda: file.read(1), b"\0")).decode()
    while True:
        header = {}
        while name := word():
            kind = word()
            header[name] = kind, file.read(struct.unpack("<i", file.read(4))[0])
        if header:
            yield header
        if not (header and several):
            return


def beginning(path):
    """So much of a name, in bytes, that more may be put to it."""
    return os.fsencode(path.name)[:200].decode(errors="ignore")


@contextlib.contextmanager
def temporary(path, ending):
    """A file beside `path` to write, which then becomes `path`; gone if anything stops that."""
    part = path.with_name(f".{beginning(path)}.{os.getpid()}{ending}")
    try:
        yield part
        check_signal()
        part.replace(path)
    except Failure:
        raise
    except Exception as error:
        raise Failure(f"{path}: cannot be written: {brief(error)}") from None
    finally:
        part.unlink(missing_ok=True)


def exact(name):
    """Whether a channel needs all of a float: depths, positions, counts and identifiers."""
    return re.split(r"[.]", name)[0].lower() in ("depth", "z", "p", "position", "samplecount", "id", "uv", "motion")


class Clock:
    """Seconds since it was made, and seconds that this process has kept processors busy since."""

    def __init__(self):
        self.wall, self.busy = time.perf_counter(), time.process_time()

    def stop(self):
        self.wall, self.busy = time.perf_counter() - self.wall, time.process_time() - self.busy
        return self

    def and_of(self, other):
        """Both together, once they are stopped."""
        self.wall, self.busy = self.wall + other.wall, self.busy + other.busy
        return self


def seed_of(arguments, frame):
    """A seed of 31 bits that every frame of every --seed has for itself, as good as."""
    return int(np.random.SeedSequence([arguments.seed, frame & 0xFFFFFFFF]).generate_state(1)[0] >> 1)


def say(path, mask, clock):
    share = f"{int(mask.sum())} of {mask.size} pixels ({100 * mask.mean():.1f} %)"
    tell(f"{path}: {share} in {clock.wall:.2f} s, {clock.busy:.2f} s of processors")


def tell(line):
    """A line on standard output, which is to blame for what goes wrong with it."""
    try:
        print(line, flush=True)
    except OSError as error:
        raise Failure(f"standard output: {brief(error)}") from None
