"""Makes the samples: small EXR frames, the same bytes each time.

Usage: .venv/bin/python samples/make.py [FOLDER]

Writes into FOLDER (default: the folder of this script). The frames that are sparse are also written complete, into
FOLDER/full: references to measure a filled frame against.
"""

import argparse
import pathlib

import numpy as np
import OpenEXR

import scenes

SIZE = 192
DENSITY = 0.2
FRAMES = range(1, 5)


def half(plane):
    return np.ascontiguousarray(plane, dtype=np.float16)


def layer(names, planes):
    """Planes (h, w, n) as half channels of those names."""
    return {name: half(planes[..., k]) for k, name in enumerate(names)}


def part(channels, name=None, origin=(0, 0), display=None, **attributes):
    """One ZIP part whose data window starts at `origin` (x, y)."""
    height, width = next(iter(channels.values())).shape
    x, y = origin
    window = (np.array([x, y], np.int32), np.array([x + width - 1, y + height - 1], np.int32))
    if display is None:
        display = (np.array([0, 0], np.int32), np.array([width - 1, height - 1], np.int32))
    header = dict(type=OpenEXR.scanlineimage, compression=OpenEXR.ZIP_COMPRESSION, dataWindow=window,
                  displayWindow=display, comments="made by samples/make.py", **attributes)
    if name:
        header["name"] = name
    return OpenEXR.Part(header, {key: OpenEXR.Channel(np.ascontiguousarray(value)) for key, value in channels.items()}, name or "")


def write(path, *parts):
    path.parent.mkdir(parents=True, exist_ok=True)
    file = OpenEXR.File(list(parts))
    file.write(str(path))
    print(f"{path}  {path.stat().st_size // 1024} KiB")


def sparse(channels, measured):
    """The channels with missing pixels at 0, and the channel `mask`."""
    result = {name: np.where(measured, plane, plane.dtype.type(0)) for name, plane in channels.items()}
    return result | {"mask": half(measured)}


def aov_parts(measured=None):
    """The two-part frame: `beauty` with depth, normals and identifiers, and `light` whose data window is smaller."""
    scene = scenes.balls(SIZE, SIZE)
    beauty = layer("RGB", scene["diffuse"] + scene["specular"]) | {"A": half(scene["alpha"])}
    beauty |= {"Z": scene["depth"].astype(np.float32), "objectId": scene["ident"]}
    beauty |= layer(("N.x", "N.y", "N.z"), scene["normal"])
    top, left, bottom, right = 16, 8, 184, 176
    crop = (slice(top, bottom), slice(left, right))
    light = layer(("diffuse.R", "diffuse.G", "diffuse.B"), scene["diffuse"][crop])
    light |= layer(("specular.R", "specular.G", "specular.B"), scene["specular"][crop])
    if measured is not None:
        beauty, light = sparse(beauty, measured), sparse(light, measured[crop])
        del light["mask"]  # the mask of `beauty` serves both
    display = (np.array([0, 0], np.int32), np.array([SIZE - 1, SIZE - 1], np.int32))
    return [part(beauty, "beauty", display=display), part(light, "light", (left, top), display)]


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("folder", nargs="?", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parent)
    folder = options.parse_args().folder
    full = folder / "full"

    write(folder / "smooth.exr", part(layer("RGBA", scenes.smooth(SIZE, SIZE))))
    scene = scenes.balls(SIZE, SIZE)
    write(folder / "edges.exr", part(layer("RGB", scene["diffuse"] + scene["specular"])))
    write(folder / "hdr.exr", part(layer("RGB", scenes.lamps(SIZE, SIZE))))
    write(folder / "texture.exr", part({"Y": half(scenes.texture(SIZE, SIZE))}))

    measured = scenes.shuffled(SIZE, SIZE, DENSITY, seed=0)
    write(folder / "parts.exr", *aov_parts(measured))
    write(full / "parts.exr", *aov_parts())

    for frame in FRAMES:
        channels = layer("RGBA", scenes.shells(SIZE, SIZE, (frame - 1) / 12))
        measured = scenes.shuffled(SIZE, SIZE, DENSITY, seed=frame)
        name = f"shot.{frame:04d}.exr"
        write(folder / "sequence" / name, part(sparse(channels, measured)))
        write(full / "sequence" / name, part(channels))


if __name__ == "__main__":
    main()
