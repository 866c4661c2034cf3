#!/usr/bin/env python3
"""Renders mostly the masked pixels of a LuxCore scene, for `lacuna fill`: one multi-layer EXR file a frame.

    luxcore_sparse.py scene.cfg -o frame.####.exr --frames 1-24 --density 0.25 --spp 64
    luxcore_sparse.py scene.cfg -o frame.exr --mask mask.exr --aovs albedo,N,depth

The mask becomes the film's user importance. LuxCore still gives a pixel outside the mask 5 % of the samples of one
inside: they are paid for, so that those inside get --spp in the mean. The channel `SAMPLECOUNT` says how many samples each pixel got, and `mask` is where the mask asked for the pixel and at least
half of --spp arrived. Pixels are boxes (film.filter.type NONE). The sampler is SOBOL or RANDOM, the engine any of LuxCore's that
sample by pixels (PATHCPU).

In a sequence `$frame` in scene.cfg, and in the file that its scene.file names, is the number of the frame; or
SCENE is a pattern of files, scene.####.cfg. Paths in both files are relative to the folder of SCENE.
Needs pyluxcore, numpy and OpenEXR.
"""

import argparse
import contextlib
import functools
import io
import itertools
import os
import pathlib
import re
import time

import bridge
from bridge import Failure

with bridge.needing("numpy OpenEXR pyluxcore"):
    import numpy as np
    import OpenEXR

    import sparse

    with contextlib.redirect_stdout(io.StringIO()):
        import pyluxcore  # last, as what is loaded after its allocator crashes; it tells of its libraries

# Seconds between looks at the counts, at most; more only where looking would take more than a twentieth of them.
NAP = 0.1
# Frames have seeds below it.
SEEDS = 1000000
# Short name: LuxCore's output, the channels that it becomes, and the type of its numbers.
AOVS = {
    "alpha": ("ALPHA", ["A"], float),
    "depth": ("DEPTH", ["depth.Z"], float),
    "N": ("AVG_SHADING_NORMAL", ["N.X", "N.Y", "N.Z"], float),
    "Ng": ("GEOMETRY_NORMAL", ["Ng.X", "Ng.Y", "Ng.Z"], float),
    "P": ("POSITION", ["P.X", "P.Y", "P.Z"], float),
    "uv": ("UV", ["uv.U", "uv.V"], float),
    "albedo": ("ALBEDO", ["albedo.R", "albedo.G", "albedo.B"], float),
    "direct_diffuse": ("DIRECT_DIFFUSE", ["direct_diffuse.R", "direct_diffuse.G", "direct_diffuse.B"], float),
    "direct_glossy": ("DIRECT_GLOSSY", ["direct_glossy.R", "direct_glossy.G", "direct_glossy.B"], float),
    "indirect_diffuse": ("INDIRECT_DIFFUSE", ["indirect_diffuse.R", "indirect_diffuse.G", "indirect_diffuse.B"], float),
    "indirect_glossy": ("INDIRECT_GLOSSY", ["indirect_glossy.R", "indirect_glossy.G", "indirect_glossy.B"], float),
    "indirect_specular": ("INDIRECT_SPECULAR", ["indirect_specular.R", "indirect_specular.G", "indirect_specular.B"], float),
    "emission": ("EMISSION", ["emission.R", "emission.G", "emission.B"], float),
    "objectId": ("OBJECT_ID", ["objectId"], int),
    "materialId": ("MATERIAL_ID", ["materialId"], int),
}
ALWAYS = {"colour": ("RGB", ["R", "G", "B"], float), "count": ("SAMPLECOUNT", ["SAMPLECOUNT"], int)}


def properties(path, frame):
    """A file of LuxCore's, with the frame's number put in."""
    found = pyluxcore.Properties()
    try:
        found.SetFromString(re.sub(r"\$frame\b", str(frame), pathlib.Path(path).read_text("utf-8")))
    except OSError as error:
        raise Failure(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise Failure(f"{path}: this is no text in UTF-8: save it as such") from None
    except RuntimeError as error:
        raise Failure(f"{path}: {bridge.brief(error)}") from None
    return found


def whole(config, path, key, default):
    """A number from 1 of a configuration; LuxCore takes any text for one."""
    text = config.Get(key, [default]).GetString()
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise Failure(f"{path}: {key} = {text}: write a whole number from 1")
    return int(text)


def size_of(config, path):
    """Width and height of the film."""
    if config.IsDefined("film.subregion"):
        raise Failure(f"{path}: film.subregion: leave it out; a mask does what a region does")
    return [whole(config, path, f"film.{side}", default) for side, default in (("width", 640), ("height", 480))]


def prepare(config, outputs, density):
    """What sparse rendering needs of a configuration."""
    sampler = config.Get("sampler.type", ["SOBOL"]).GetString()
    if sampler not in ("SOBOL", "RANDOM"):
        raise Failure(f"sampler.type {sampler} knows no user importance: write SOBOL or RANDOM")
    words = [
        f'sampler.type = "{sampler}"',
        f"sampler.{sampler.lower()}.adaptive.strength = {0 if density == 1 else 1}",
        f"sampler.{sampler.lower()}.adaptive.userimportanceweight = 1",
        'film.filter.type = "NONE"',
        "film.noiseestimation.warmup = 1",
        "batch.haltspp = 0",  # which would count whole samples over all of the film
        "batch.halttime = 0",
    ]
    # Nothing is saved under these names, but LuxCore wants them, and other ones for identifiers.
    files = [(output, "png" if output.endswith("_ID") else "exr") for output, _, _ in outputs]
    for at, (name, ending) in enumerate([*files, ("USER_IMPORTANCE", "exr")]):
        words += [f'film.outputs.{at}.type = "{name}"', f'film.outputs.{at}.filename = "{name}.{ending}"']
    config.DeleteAll(config.GetAllNames("film.outputs"))
    config.DeleteAll(config.GetAllNames("film.filter"))
    config.SetFromString("\n".join(words) + "\n")


def trace(config, scene, importance, spp):
    """Renders until pixels inside have `spp` samples in the mean; returns the film's session."""
    session = pyluxcore.RenderSession(pyluxcore.RenderConfig(config, scene))
    session.Start()
    film = session.GetFilm()
    if importance is not None:
        film.UpdateOutputFloat(pyluxcore.FilmOutputType.USER_IMPORTANCE, importance)
    counts = np.zeros(film.GetWidth() * film.GetHeight(), np.uint32)
    begun = then = time.monotonic()
    before = 0
    while not session.HasDone():
        looked = time.monotonic()
        session.UpdateStats()
        film.GetOutputUInt(pyluxcore.FilmOutputType.SAMPLECOUNT, counts, 0, False)
        mean = (counts if importance is None else counts[importance > 0]).mean()
        if mean >= spp:
            break
        # Half of what is left at the pace since the last look, which says little at first: late looks give more samples than were wanted.
        left = (looked - then) * (spp - mean) / (mean - before) if mean > before else 0
        before, then = mean, looked
        now = time.monotonic()
        time.sleep(max(min(left / 2, max(min((now - begun) / 100, NAP), 20 * (now - looked))), 0.001))
    session.Stop()
    return session


def fetch(film, output, channels, kind, width, height):
    """The planes of an output by channel name, top row first."""
    what = getattr(pyluxcore.FilmOutputType, output)
    if kind is int:
        buffer = np.zeros(width * height * len(channels), np.uint32)
        film.GetOutputUInt(what, buffer)
    else:
        buffer = np.zeros(width * height * len(channels), np.float32)
        film.GetOutputFloat(what, buffer)
    planes = buffer.reshape(height, width, len(channels))[::-1]
    return {name: planes[..., k] for k, name in enumerate(channels)}


def render(arguments, frame):
    path = pathlib.Path(sparse.source_name(arguments.scene, frame))
    config = properties(path, frame)
    if not config.IsDefined("scene.file"):
        raise Failure(f"{path}: names no scene (scene.file)")
    scene_file = properties(path.parent / config.Get("scene.file").GetString(), frame)
    width, height = size_of(config, path)
    spp = arguments.spp or whole(config, path, "batch.haltspp", 64)
    outputs = list(ALWAYS.values()) + [AOVS[name] for name in arguments.aovs]
    seed, streams = sparse.seed_of(arguments, frame) % SEEDS, itertools.count()
    scene = pyluxcore.Scene()
    with contextlib.chdir(path.parent):  # what the scene names is relative to it
        scene.Parse(scene_file)

    # Samples of all rounds.
    total = np.zeros((height, width), np.uint32)

    def draw(asked, output):
        clock = sparse.Clock()
        counts = []

        def trace_once(spp, _):
            with contextlib.chdir(path.parent):
                planes = render_scene(config, scene, asked, outputs, spp, stream_of(seed, next(streams)))
            counts.append(planes.pop("SAMPLECOUNT"))
            return planes

        planes = sparse.in_halves(trace_once, spp) if arguments.halves else trace_once(spp, 0)
        clock.stop()
        count = sum(counts)
        measured = asked & np.all([one >= 0.5 * spp / len(counts) for one in counts], axis=0)
        total[:] += count
        planes["SAMPLECOUNT"] = count
        sparse.write(output, planes, measured, attributes=note(count, asked), whole=["SAMPLECOUNT"])
        if measured.sum() < asked.sum():
            sparse.tell(f"{output}: {int(asked.sum() - measured.sum())} pixels of the mask got too few samples and are missing")
        return measured, clock

    def finish(output, mask):
        # Of pixels outside, the union of the rounds has the first one's counts.
        with sparse.quiet():
            file = OpenEXR.File(str(output), separate_channels=True)
            count = np.where(mask, file.channels()["SAMPLECOUNT"].pixels, total)
            file.channels()["SAMPLECOUNT"].pixels = count
            file.write(str(output))
        return note(count, mask)

    sparse.frame(arguments, frame, (width, height), draw, finish=finish)


def stream_of(seed, number):
    """The seed of LuxCore for each half of each round: 31 bits, not 0."""
    return (seed + number * SEEDS) % ((1 << 31) - 1) + 1


def note(count, mask):
    """What a frame says of its samples."""
    return {"renderer": f"LuxCore {pyluxcore.Version()}, {count[mask].mean():.1f} samples a pixel",
            "samplesOutside": f"{100 * count[~mask].sum() / max(1, count.sum()):.1f} % of the samples fell outside the mask"}


def render_scene(config, scene, asked, outputs, spp, seed):
    """The planes of the outputs."""
    density = float(asked.mean())
    prepare(config, outputs, density)
    config.SetFromString(f"renderengine.seed = {seed}\n")
    importance = None if density == 1 else np.ascontiguousarray(asked[::-1], np.float32).ravel()
    film = trace(config, scene, importance, spp).GetFilm()
    planes = {}
    for name, channels, kind in outputs:
        planes |= fetch(film, name, channels, kind, asked.shape[1], asked.shape[0])
    return planes


def aov_list(text):
    names = [name.strip() for name in text.split(",") if name.strip()]
    unknown = [name for name in names if name not in AOVS]
    if unknown:
        raise argparse.ArgumentTypeError(f"{unknown[0]} is none of {', '.join(AOVS)}")
    sparse.once("--aovs", names)
    return names


def parse():
    parser = bridge.Parser(__doc__)
    parser.add_argument("scene", help="scene.cfg, or scene.####.cfg, one file a frame")
    sparse.add_arguments(parser)
    sparse.add_halves(parser)
    parser.add_argument("--aovs", type=aov_list, default=[], metavar="LIST", help=", ".join(AOVS))
    return parser.parse_args()


def main():
    arguments = parse()
    frames = sparse.check(arguments, arguments.scene)
    pyluxcore.Init(lambda message: None)
    sparse.each(arguments.scene, frames, functools.partial(render, arguments))


if __name__ == "__main__":
    # LuxCore may crash while Python takes itself apart.
    bridge.run(main, end=os._exit)
