"""Pictures of the documentation, from the samples. Called by scripts/pictures; argument: the folder to write to."""

import os
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
import OpenEXR
from PIL import Image

ROOT = pathlib.Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "samples"
LACUNA = os.environ.get("LACUNA", ROOT / "target" / "release" / "lacuna")
GAP = 4


def channels(path, part=0):
    file = OpenEXR.File(str(path), separate_channels=True)
    return {name: channel.pixels for name, channel in file.parts[part].channels.items()}


def srgb(linear):
    """Scene-linear colour, clipped to [0, 1], as the bytes of a display."""
    linear = np.clip(np.nan_to_num(linear, posinf=1.0), 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def colour(planes):
    names = "RGB" if "R" in planes else "YYY"
    return srgb(np.stack([planes[name].astype(np.float64) for name in names], axis=-1))


def normals(planes):
    vectors = np.stack([planes[name].astype(np.float64) for name in ("N.x", "N.y", "N.z")], axis=-1)
    return np.where((vectors**2).sum(-1, keepdims=True) > 0, vectors * (0.5, -0.5, -0.5) + 0.5, 0)


def depth(planes):
    near, far = 2.0, 9.0
    shade = np.clip((far - planes["Z"]) / (far - near), 0, 1)
    return np.where((planes["Z"] != 0)[..., None], shade[..., None] * np.ones(3), 0)


def identifiers(planes):
    paint = np.random.default_rng(3).uniform(0.2, 1, (16, 3))
    paint[0] = 0
    return paint[planes["objectId"] % 16]


def sheet(path, rows, scale):
    """Rows of pictures, each enlarged without interpolation, as a PNG of a few colours more than it needs."""
    height, width, _ = rows[0][0].shape
    canvas = np.ones(((height + GAP) * len(rows) - GAP, (width + GAP) * len(rows[0]) - GAP, 3))
    for r, row in enumerate(rows):
        for c, picture in enumerate(row):
            canvas[r * (height + GAP) :, c * (width + GAP) :][:height, :width] = picture
    image = Image.fromarray((canvas * 255 + 0.5).astype(np.uint8))
    image = image.resize((image.width * scale, image.height * scale), Image.Resampling.NEAREST)
    image.save(path, optimize=True)
    print(f"{path.relative_to(ROOT)}  {path.stat().st_size // 1024} KiB")


def fill(source, out, *words):
    subprocess.run([LACUNA, "fill", "-q", source, "-o", out, *words], check=True)
    return channels(out)


def tool(*words):
    subprocess.run([LACUNA, *words], check=True, stderr=subprocess.DEVNULL)


def cut(picture, top, left, side):
    return picture[top : top + side, left : left + side]


def enlarged(folder, scratch):
    """A frame rendered small, enlarged, and rendered large."""
    scene = SAMPLES / "scenes" / "head.toml"
    small, large, native = (scratch / name for name in ("small.exr", "large.exr", "native.exr"))
    tool("render", scene, "-o", small, "--size", "180x180", "--samples", "16", "-q")
    tool("render", scene, "-o", native, "--size", "360x360", "--samples", "16", "-q")
    tool("upscale", small, "-o", large, "--scale", "2", "-q")
    before = colour(channels(small)).repeat(2, axis=0).repeat(2, axis=1)
    pictures = [before, colour(channels(large)), colour(channels(native))]
    sheet(folder / "upscale.png", [[cut(picture, 60, 60, 240) for picture in pictures]], 1)


def error(picture, reference):
    """Ten times the difference, from black to yellow."""
    size = np.clip(10 * np.abs(picture - reference).mean(axis=-1), 0, 1)
    return np.stack([size, size**2, 0 * size], axis=-1)


def sequence(folder, scratch):
    """A frame of a turntable filled by itself and along with its neighbours, the error of both, and the complete frame."""
    scene = SAMPLES / "scenes" / "vessels.toml"
    words = ("--size", "240x240", "--samples", "4", "--frames", "1-5", "--set", "camera.orbit=0.5", "--create-dir", "-q")
    tool("render", scene, "-o", scratch / "full" / "s.####.exr", *words)
    tool("render", scene, "-o", scratch / "sparse" / "s.####.exr", *words, "--density", "0.2", "--depth")
    alone, along = scratch / "alone.exr", scratch / "along" / "s.####.exr"
    middle = scratch / "sparse" / "s.0003.exr"
    tool("fill", middle, "-o", alone, "-q")
    tool("fill", scratch / "sparse" / "s.####.exr", "-o", along, "--temporal", "auto", "--create-dir", "-q")
    full = colour(channels(scratch / "full" / "s.0003.exr"))
    fills = [colour(channels(path)) for path in (alone, scratch / "along" / "s.0003.exr")]
    row = [colour(channels(middle)), *fills, *(error(fill, full) for fill in fills)]
    sheet(folder / "sequence.png", [row], 1)


def page(folder, scratch):
    """The page of `compare --html`, where there is a browser."""
    sys.path.insert(0, str(ROOT / "tests"))
    import chromium

    if chromium.find() is None:
        print("no Chromium: the picture of compare's page is left out")
        return
    tool("compare", SAMPLES / "full" / "sequence" / "shot.####.exr", scratch / "shots", "--html", scratch / "page.html", "-q")
    with chromium.Page((scratch / "page.html").as_uri(), width=1100, height=720) as opened:
        opened.wait("document.body.dataset.ready !== undefined")
        opened.picture(scratch / "page.png")
    image = Image.open(scratch / "page.png").convert("RGB").quantize(256, dither=Image.Dither.NONE)
    image.save(folder / "compare.png", optimize=True)
    print(f"compare.png  {(folder / 'compare.png').stat().st_size // 1024} KiB")


def main():
    folder = ROOT / sys.argv[1]
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        out = pathlib.Path(scratch) / "out.exr"
        shot = SAMPLES / "sequence" / "shot.0001.exr"
        full = channels(SAMPLES / "full" / "sequence" / "shot.0001.exr")
        sheet(folder / "fill.png", [[colour(channels(shot)), colour(fill(shot, out)), colour(full)]], 2)

        parts = SAMPLES / "parts.exr"
        frames = [channels(parts), fill(parts, out), channels(SAMPLES / "full" / "parts.exr")]
        views = (colour, normals, depth, identifiers)
        sheet(folder / "rules.png", [[view(frame) for view in views] for frame in frames], 1)

        sparse = pathlib.Path(scratch) / "sparse.exr"
        rows = []
        for sample in ("edges.exr", "texture.exr"):
            subprocess.run([LACUNA, "sparsify", "-q", SAMPLES / sample, "-o", sparse,
                            "--density", "0.2"], check=True)
            filled = [fill(sparse, out, "--filter", method) for method in ("ss", "tv")]
            rows.append([colour(frame) for frame in (channels(sparse), *filled, channels(SAMPLES / sample))])
        sheet(folder / "limits.png", rows, 1)
        enlarged(folder, pathlib.Path(scratch))
        sequence(folder, pathlib.Path(scratch))
        tool("fill", SAMPLES / "sequence" / "shot.####.exr", "-o", pathlib.Path(scratch) / "shots" / "shot.####.exr", "--create-dir", "-q")
        page(folder, pathlib.Path(scratch))


if __name__ == "__main__":
    main()
