#!/usr/bin/env python3
"""Renders only the masked pixels of a Mitsuba 3 scene, with any of its integrators, for `lacuna fill`.

    mitsuba_sparse.py scene.xml -o frame.####.exr --frames 1-24 --density 0.25 --spp 64
    mitsuba_sparse.py scene.xml -o frame.exr --mask mask.exr --aovs albedo,depth,N --dense-aovs
    mitsuba_sparse.py scene.xml -o frame.####.exr --frames 1-24 --density 0.2 --motion

The scene's sensor is wrapped in one whose film is a small rectangle with a pixel for each masked one, so that nothing else is
sampled. The film's pixel filter is a box, whatever the scene says: a wider one would spread samples into their
neighbours. The output holds the colour, the AOVs and the channel `mask`; lacuna's attributes say the rest.

In a sequence the scene's parameter $frame is the number of the frame; or SCENE is a pattern of files, scene.####.xml.
Needs Mitsuba 3.6 or newer, numpy, OpenEXR and a libLLVM that Mitsuba takes (Debian: libllvm19).
"""

import argparse
import collections
import functools
import itertools
import pathlib
import re
import zlib

import bridge
from bridge import Failure, Misuse

with bridge.needing("numpy OpenEXR mitsuba"):
    import drjit as dr
    import mitsuba as mi
    import mitsuba_motion
    import numpy as np
    import OpenEXR  # noqa: F401, sparse can do without

    import sparse

# AOVs by their short names; others as name:type, in Mitsuba's words.
AOVS = {
    "albedo": "albedo:albedo",
    "depth": "depth:depth",
    "N": "N:sh_normal",
    "Ng": "Ng:geo_normal",
    "P": "P:position",
    "uv": "uv:uv",
    "id": "id:shape_index",
    "prim": "primId:prim_index",
}
# Numbers that must not be averaged.
LABELS = ("shape_index", "prim_index")
# The film's own channels by their number.
COLOURS = {1: "Y", 2: "YA", 3: "RGB", 4: "RGBA"}
# Numbers of shapes, 0 aside: as many as floats hold.
MOST_SHAPES = (1 << 24) - 1
# Share of a pixel's side that samples keep from its rim, above the rounding of positions on films of 4000 pixels.
RIM = 1e-3
# Samples of one pass: what a wavefront may hold.
WAVEFRONT = 1 << 22


def sensor_class():
    """The sensor that samples a list of pixels; a class of the variant that is set."""

    class PixelList(mi.Sensor):
        """Its film has a pixel for each entry of a list; rays are those of the inner sensor, through that pixel."""

        def __init__(self, inner, pixels, film, sampler):
            props = mi.Properties("pixel_list")
            props["shutter_open"] = float(inner.shutter_open())
            props["shutter_close"] = float(inner.shutter_open() + inner.shutter_open_time())
            props["film"], props["sampler"] = film, sampler
            super().__init__(props)
            size = inner.film().crop_size()
            self.inner = inner
            self.count = len(pixels)
            # Scalar variants have no arrays of their own.
            self.list = mi.UInt32(pixels.astype(np.uint32)) if dr.is_jit_v(mi.Float) else pixels.tolist()
            self.width = int(size[0])
            self.scale = mi.Vector2f(1 / int(size[0]), 1 / int(size[1]))
            self.across, self.down = (int(n) for n in film.size())
            self.m_needs_sample_3 = inner.needs_aperture_sample()

        def place(self, position):
            """The position on the inner film, each side from 0 to 1, of one on this film."""
            x, y = position.x * self.across, position.y * self.down
            column, row = dr.minimum(mi.UInt32(x), self.across - 1), dr.minimum(mi.UInt32(y), self.down - 1)
            entry = dr.minimum(row * self.across + column, self.count - 1)
            pixel = dr.gather(mi.UInt32, self.list, entry) if dr.is_jit_v(mi.Float) else self.list[entry]
            inside = mi.Point2f(x - mi.Float(column), y - mi.Float(row))
            corner = mi.Point2f(mi.Float(pixel % self.width), mi.Float(pixel // self.width))
            # Nearer to its rim a position might be rounded into the pixel beside it.
            return (corner + dr.clip(inside, RIM, 1 - RIM)) * self.scale

        # Names as Mitsuba's: its integrators in Python give arguments by them. 1 is for the wavelength, 2 the place, 3 the aperture.
        def sample_ray(self, time, sample1, sample2, sample3, active=True):
            return self.inner.sample_ray(time, sample1, self.place(sample2), sample3, active)

        def sample_ray_differential(self, time, sample1, sample2, sample3, active=True):
            return self.inner.sample_ray_differential(time, sample1, self.place(sample2), sample3, active)

        def bbox(self):
            return self.inner.bbox()

        def to_string(self):
            return f"PixelList[{self.count} pixels of {self.inner}]"

    return PixelList


def film(width, height, pixel_format):
    return mi.load_dict({
        "type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"},
        "pixel_format": pixel_format, "component_format": "float32",
    })


def render_pixels(scene, integrator, mask, spp, seeds, alpha=False, took=None):
    """The masked pixels, row by row: `(count, channels)` of float32, the film's own channels before the integrator's AOVs; with
    alpha if asked for. `seeds` are that of the frame and the number of the round in which its pixels are chosen: entries of lists have the
    same noise otherwise.

    Passes that fit into a wavefront are averaged by their numbers of samples. All pixels need no list. Samplers of strata take more
    samples than they are asked for: `took`, if there is one, is told how many a pixel."""
    inner = scene.sensors()[0]
    pixels = np.flatnonzero(mask)
    across = max(1, int(np.ceil(np.sqrt(len(pixels)))))
    down = -(-len(pixels) // across)
    format = "luminance" if mi.is_monochromatic else "rgba" if alpha else "rgb"
    if mask.all() and f"pixel_format = {format}," in str(inner.film()) and "BoxFilter" in str(inner.film().rfilter()):
        across, down, sensor = mask.shape[1], mask.shape[0], inner
    else:
        own = film(across, down, format)
        sensor = sensor_class()(inner, pixels, own, inner.sampler().clone())
    most = max(1, WAVEFRONT // (across * down))
    total, done, turn = 0.0, 0, 0
    while done < spp:
        sampler = sensor.sampler().clone()
        sampler.set_sample_count(min(most, spp - done))
        now = sampler.sample_count()
        # 32 bits, and another stream for every pass of every round and frame.
        seed, number = seeds
        stream = int(np.random.SeedSequence([seed, turn, number]).generate_state(1)[0])
        mi.render(scene, sensor=sensor, integrator=integrator, spp=now, seed=stream)
        # Not what render returns: of integrators inside others that has the channels in another order, and not all of them.
        part = np.array(sensor.film().develop(), np.float64).reshape(across * down, -1)[: len(pixels)]
        total, done, turn = total + part * now, done + now, turn + 1
    if took is not None:
        took.append(done)
    return (total / done).astype(np.float32)


def aov_list(text):
    """Names and types of --aovs, split into those that may be averaged and labels."""
    aovs = []
    for word in filter(None, (word.strip() for word in text.split(","))):
        aov = AOVS.get(word, word)
        if ":" not in aov:
            raise argparse.ArgumentTypeError(f"{word} is none of {', '.join(AOVS)}, nor name:type in Mitsuba's words")
        aovs.append(aov)
    sparse.once("--aovs", [aov.split(":")[0] for aov in aovs])
    labels = [aov for aov in aovs if aov.split(":")[1] in LABELS]
    return [aov for aov in aovs if aov not in labels], labels


def first_hits(scene, aovs, mask, spp, seeds):
    """Planes of AOVs at the masked pixels, by name, and nothing else traced; labels take one sample, and are whole numbers."""
    planes = {}
    for some, samples in zip(aovs, (spp, 1), strict=True):
        if some:
            integrator = mi.load_dict({"type": "aov", "aovs": ",".join(some)})
            names = [channel_name(name) for name in integrator.aov_names()]
            values = render_pixels(scene, integrator, mask, samples, seeds)[:, -len(names) :]
            if some is aovs[1]:
                values = np.stack([number_shapes(scene, plane) if aov.endswith(":shape_index") else plane
                                   for aov, plane in zip(some, values.T.astype(np.uint32), strict=True)], axis=1)
            planes |= {name: sparse.scatter(values[:, k], mask) for k, name in enumerate(names)}
    return planes


def number_shapes(scene, found):
    """Numbers of shapes that are the same in every frame and run. Mitsuba's own are those of its registry, where shapes come in the
    order in which threads have loaded them."""
    shapes = scene.shapes()
    own = [own_number(shape) for shape in shapes] if dr.is_jit_v(mi.Float) else range(1, len(shapes) + 1)
    nameless, names = collections.Counter(), []
    for shape in shapes:
        kind = kind_of(shape)
        nameless[kind] += not named(shape)
        names.append(shape.id() if named(shape) else f"{kind} {nameless[kind]}")
    taken, numbers = set(), {0: 0}
    for name, number in sorted(zip(names, own, strict=True)):
        numbers[number] = checksum(name, taken)
        taken.add(numbers[number])
    for number in set(np.unique(found).tolist()) - set(numbers):
        # In a group that instances show, which is no shape of the scene.
        shape = dr.reinterpret_array(mi.ShapePtr, mi.UInt32(number))[0]
        numbers[number] = checksum(shape.id() if named(shape) else kind_of(shape), taken)
    raw, back = np.unique(found, return_inverse=True)
    return np.array([numbers[number] for number in raw.tolist()], np.uint32)[back]


def own_number(shape):
    return int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))[0])


def named(shape):
    """Whether the scene gives a shape an id; Mitsuba makes some itself."""
    return bool(shape.id()) and not shape.id().startswith(("_unnamed", "_arg"))


def checksum(name, taken):
    """A number from 1 that floats hold, the next that is free."""
    number = zlib.crc32(name.encode()) % MOST_SHAPES + 1
    while number in taken:
        number = number % MOST_SHAPES + 1
    return number


def channel_name(name):
    """Names as `lacuna info` knows them: one depth a pixel is `Z` in its layer, one identifier the name itself."""
    return re.sub(r"\.T$", ".Z", re.sub(r"^(id|primId)\.[A-Z]$", r"\1", name))


def layer_of(name):
    return name.rpartition(".")[0]


def images(names):
    """The layers of AOVs that are colour and alpha: those of integrators inside others."""
    return [layer for layer in dict.fromkeys(map(layer_of, names)) if layer and {f"{layer}.{component}" for component in "RGBA"} <= set(names)]


def repeated(names):
    """The layers that repeat the film's colour: that of the first integrator inside, of the first inside that one, and so on."""
    found = []
    for layer in images(names):
        if not found or layer.startswith(f"{found[-1]}."):
            found.append(layer)
    return found


def colour(scene, mask, spp, seeds, alpha, took):
    """Planes of the colour, and of AOVs that the scene's integrator writes itself; `took` is told the samples a pixel."""
    integrator = scene.integrator()
    names = list(integrator.aov_names())
    values = render_pixels(scene, integrator, mask, spp, seeds, alpha, took)
    base = COLOURS[values.shape[1] - len(names)]
    again = repeated(names)
    planes = dict(zip([*base, *map(channel_name, names)], values.T, strict=True))
    # AOVs of no integrator have no light.
    left_out = [name for name in names if layer_of(name) in again] or (list(base) if kind_of(integrator) == "AOVIntegrator" else [])
    return {name: sparse.scatter(plane, mask) for name, plane in planes.items() if name not in left_out}


def kind_of(thing):
    """The name of a plugin's class, which Mitsuba before 3.7 has elsewhere."""
    return thing.class_name() if hasattr(thing, "class_name") else thing.class_().name()


def check_names(arguments, scene, path):
    """Refuses AOVs, those of the scene and those of --aovs, whose layers another one has: channels would take each other's place."""
    taken = dict.fromkeys(["mask", *"RGBAY"], "the frame itself")
    taken |= dict.fromkeys(["half1", "half2"], "--halves") if arguments.halves else {}
    taken |= {"motion": "--motion"} if arguments.motion else {}
    names = list(scene.integrator().aov_names())
    again = repeated(names)
    own = dict.fromkeys(layer_of(name) or name for name in names if layer_of(name) not in again)
    for layer in own:
        if layer in taken:
            raise Failure(f"{path}: its AOV {layer} has the name of what {taken[layer]} writes: name it otherwise")
    taken |= dict.fromkeys(own, path)
    for aov in [*arguments.aovs[0], *arguments.aovs[1]]:
        layer, _, kind = aov.partition(":")
        if layer in taken:
            raise Failure(f"--aovs {layer}: {taken[layer]} has that name already: write it as another one, name:{kind}")


def definition(text):
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"'{text}' is no parameter: write -D NAME=VALUE")
    return name, value


def scene_path(arguments, frame):
    return pathlib.Path(sparse.source_name(arguments.scene, frame))


def load(arguments, frame):
    path = scene_path(arguments, frame)
    try:
        text = path.read_bytes()
    except OSError as error:
        raise Failure(f"{path}: {error.strerror}") from None
    parameters = dict(arguments.define)
    if re.search(rb"\$frame\b", text):
        parameters["frame"] = str(frame)
    # Mitsuba would join meshes of one material, which then are one shape.
    apart = any(aov.endswith(":shape_index") for aov in arguments.aovs[1]) and "optimize" in str(mi.load_file.__doc__)
    try:
        scene = mi.load_file(str(path), **({"optimize": False} if apart else {}), **parameters)
    except Exception as error:
        raise Failure(f"{path}: {bridge.brief(error)}") from None
    if not scene.sensors() or scene.integrator() is None:
        raise Failure(f"{path}: a scene needs a sensor and an integrator")
    if isinstance(scene.integrator(), mi.AdjointIntegrator):
        kind = kind_of(scene.integrator())
        raise Failure(f"{path}: its integrator ({kind}) starts at the lights, not at pixels: take path or another that starts at the sensor")
    kind = kind_of(scene.sensors()[0].film())
    if kind != "HDRFilm":
        raise Failure(f"{path}: its film ({kind}) has bands or other channels that would be lost: take hdrfilm")
    return scene


def motion_of(arguments, frame, scene, size):
    """Vectors to the next frame; in the last one of a sequence of files those to the frame before, turned around."""
    there = [step for step in (1, -1) if scene_path(arguments, frame + step).is_file()]
    if not there:
        sparse.tell(f"{scene_path(arguments, frame)}: no motion, as there is no scene of the frame after or before it")
        return {}
    step = there[0]
    planes = mitsuba_motion.vectors(scene, load(arguments, frame + step), size)
    if step == -1:
        sparse.tell(f"{scene_path(arguments, frame)}: motion as from the frame before, as there is no scene of the next one")
    return {name: step * plane for name, plane in planes.items()}


def render(arguments, frame):
    scene = load(arguments, frame)
    check_names(arguments, scene, scene_path(arguments, frame))
    screen = scene.sensors()[0].film()
    width, height = (int(n) for n in screen.crop_size())
    x, y = (int(n) for n in screen.crop_offset())
    spp = arguments.spp or scene.sensors()[0].sampler().sample_count()
    seed = sparse.seed_of(arguments, frame)
    complete, rounds = {}, itertools.count()
    full = (0, 0, int(screen.size()[0]) - 1, int(screen.size()[1]) - 1)
    kind = np.float16 if arguments.half else np.float32
    motion = motion_of(arguments, frame, scene, (width, height)) if arguments.motion else {}

    def draw(mask, path):
        clock, took, number = sparse.Clock(), [], next(rounds)
        alpha = bool(screen.flags() & int(mi.FilmFlags.Alpha))
        if arguments.halves:
            # Seeds of frames have 31 bits.
            planes = sparse.in_halves(lambda spp, turn: colour(scene, mask, spp, (seed + (turn << 31), number), alpha, took), spp)
        else:
            planes = colour(scene, mask, spp, (seed, number), alpha, took)
        if arguments.dense_aovs and not complete:
            complete.update(first_hits(scene, arguments.aovs, np.ones_like(mask), arguments.dense_spp, (seed + 1, number)))
        hits = complete or first_hits(scene, arguments.aovs, mask, min(spp, 16), (seed + 1, number))
        clock.stop()
        note = {"renderer": f"Mitsuba {mi.__version__}, {sum(took)} samples a pixel, seed {seed}"}
        sparse.write(path, planes | hits | motion, mask, [*complete, *motion], (x, y), full, kind, note)
        return mask, clock

    sparse.frame(arguments, frame, (width, height), draw, (x, y))


def parse():
    parser = bridge.Parser(__doc__)
    parser.add_argument("scene", help="scene.xml, or scene.####.xml, one file a frame")
    sparse.add_arguments(parser)
    sparse.add_halves(parser)
    parser.add_argument("--aovs", type=aov_list, default=([], []), metavar="LIST", help=f"first-hit AOVs: {', '.join(AOVS)}, or name:type")
    parser.add_argument("--dense-aovs", action="store_true", help="render the AOVs for every pixel: guides for lacuna fill")
    parser.add_argument("--dense-spp", type=int, default=4, metavar="N", help="samples a pixel of dense AOVs [default: 4]")
    parser.add_argument("--motion", action="store_true", help="vectors of every pixel to the next frame, motion.X and motion.Y, in pixels, y down")
    parser.add_argument("--half", action="store_true", help="16 bits for colour, albedo and normals")
    parser.add_argument("--variant", default="llvm_ad_rgb", help="of Mitsuba; scalar ones save no time [default: llvm_ad_rgb]")
    parser.add_argument("-D", "--define", type=definition, action="append", default=[], metavar="NAME=VALUE", help="a parameter of the scene")
    return parser.parse_args()


def main():
    arguments = parse()
    frames = sparse.check(arguments, arguments.scene)
    sparse.once("-D", [name for name, _ in arguments.define])
    if arguments.dense_aovs and not any(arguments.aovs):
        raise Misuse("--dense-aovs needs --aovs: which ones?")
    if arguments.dense_spp < 1:
        raise Misuse(f"--dense-spp {arguments.dense_spp} is not 1 or more")
    try:
        mi.set_variant(arguments.variant)
    except (ImportError, AttributeError, ValueError) as error:
        have = f"Mitsuba has {', '.join(mi.variants())}; llvm ones need libLLVM 17 or newer (Debian: libllvm19)"
        raise Failure(f"--variant {arguments.variant}: {error}; {have}") from None
    # The last line of Mitsuba's errors is the cause.
    sparse.each(arguments.scene, frames, functools.partial(render, arguments), line=-1)


if __name__ == "__main__":
    bridge.run(main)
