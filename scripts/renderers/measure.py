"""Tables and pictures of docs/measurements/renderers.md. Called by scripts/renderers/measure; arguments: the scenes to do, default all, and
`rounds` for one pass against --adaptive at equal pixels on all scenes.

Everything is rendered at the same samples per pixel; the reference has four times as many and another seed. Tables go
between the markers of docs/measurements/renderers.md, pictures to docs/images/renderers-SCENE.png.
"""

import csv
import functools
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

import numpy as np
import OpenEXR
from PIL import Image

import sparse

ROOT = sparse.ROOT
PAGE = ROOT / "docs" / "measurements" / "renderers.md"
DENSITIES = (0.5, 0.3, 0.25, 0.2)
# Scene, bridge, samples a pixel, what it is, and the corner (x, y) of the detail that is shown.
SCENES = {
    "watch": ("mitsuba_sparse.py", "watch.xml", 128, "Mitsuba, path tracing, metal and fine engraving", (240, 110)),
    "cloud": ("mitsuba_sparse.py", "cloud.xml", 64, "Mitsuba, volumetric path tracing", (90, 20)),
    "still": ("luxcore_sparse.py", "still.cfg", 32, "LuxCore, path tracing", (250, 100)),
}
DETAIL = 160


def render(scene, out, density, spp, seed, *more):
    """Renders; seconds of the renderer, on the clock and of processors."""
    bridge, file = SCENES[scene][:2]
    words = [sys.executable, ROOT / "scripts" / "renderers" / bridge, ROOT / "samples" / "renderers" / file, "-o", out]
    words += ["--density", density, "--spp", spp, "--seed", seed, *more]
    said = subprocess.run([str(word) for word in words], check=True, capture_output=True, text=True).stdout
    return tuple(float(number) for number in re.search(r"in ([\d.]+) s, ([\d.]+) s of processors", said).groups())


def fill(source, target):
    before, start = os.times(), time.perf_counter()
    subprocess.run([sparse.lacuna(), "fill", "-q", source, "-o", target], check=True)
    wall, after = time.perf_counter() - start, os.times()
    return wall, after.children_user + after.children_system - before.children_user - before.children_system


def compare(reference, test, folder):
    """PSNR in dB and FLIP of the colours of the whole image."""
    table = folder / "measures.csv"
    words = [sparse.lacuna(), "compare", "-q", reference, test, "--measures", "flip", "--csv", table]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    with open(table, newline="") as lines:
        rows = [row for row in csv.DictReader(lines) if row["region"] == "all" and row["channels"] == "R G B" and not row["layer"]]
    return float(rows[0]["psnr"]), float(rows[0]["flip"])


def shown(path):
    channels = OpenEXR.File(str(path), separate_channels=True).parts[0].channels
    linear = np.clip(np.stack([channels[name].pixels for name in "RGB"], -1).astype(np.float64), 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def picture(scene, paths):
    """Details side by side: sparse, filled, all pixels."""
    x, y = SCENES[scene][4]
    tiles = [shown(path)[y : y + DETAIL, x : x + DETAIL] for path in paths]
    gap = np.ones((DETAIL, 4, 3))
    sheet = np.hstack([piece for tile in tiles for piece in (tile, gap)][:-1])
    sheet = np.kron(sheet, np.ones((2, 2, 1)))
    image = Image.fromarray((sheet * 255 + 0.5).astype(np.uint8)).quantize(128, dither=Image.Dither.NONE)
    image.save(ROOT / "docs" / "images" / f"renderers-{scene}.png", optimize=True)


def measure(scene, folder):
    spp = SCENES[scene][2]
    reference, full = folder / f"{scene}.reference.exr", folder / f"{scene}.full.exr"
    render(scene, reference, 1, 4 * spp, 1)
    wall, busy = render(scene, full, 1, spp, 2)
    psnr, flip = compare(reference, full, folder)
    rows = [f"| 0 % | {wall:.1f} ({busy:.1f}) | | {wall:.1f} | 1.00 (1.00) | {psnr:.2f} | {flip:.4f} |"]
    for density in DENSITIES:
        thin, filled = folder / f"{scene}.{density}.exr", folder / f"{scene}.{density}.filled.exr"
        part, part_busy = render(scene, thin, density, spp, 2)
        after, after_busy = fill(thin, filled)
        psnr, flip = compare(reference, filled, folder)
        ratio = f"{(part + after) / wall:.2f} ({(part_busy + after_busy) / busy:.2f})"
        rows.append(
            f"| {100 * (1 - density):.0f} % | {part:.1f} ({part_busy:.1f}) | {after:.2f} ({after_busy:.2f}) "
            f"| {part + after:.1f} | {ratio} | {psnr:.2f} | {flip:.4f} |"
        )
        print(f"{scene} at {density}: {rows[-1]}", flush=True)
        if density == 0.3:
            picture(scene, (thin, filled, full))
    head = "| missing | render, s | fill, s | together, s | of all pixels | PSNR, dB | FLIP |\n|---:|---:|---:|---:|---:|---:|---:|"
    return "\n".join([f"`{SCENES[scene][1]}` ({SCENES[scene][3]}, {spp} samples a pixel):\n", head, *rows])


def rounds(folder):
    """One pass against pixels chosen in rounds: as many pixels, the same samples a pixel."""
    rows = []
    for scene, (_, _, spp, _, _) in SCENES.items():
        reference = folder / f"{scene}.reference.exr"
        render(scene, reference, 1, 4 * spp, 1)
        cells = []
        for more in ((), ("--adaptive",)):
            thin, filled = folder / f"{scene}{len(more)}.exr", folder / f"{scene}{len(more)}.filled.exr"
            render(scene, thin, 0.25, spp, 2, *more)
            fill(thin, filled)
            psnr, flip = compare(reference, filled, folder)
            cells += [f"{psnr:.2f}", f"{flip:.4f}"]
        rows.append(f"| {scene}, {spp} samples a pixel | {' | '.join(cells)} |")
        print(rows[-1], flush=True)
    head = "| 25 % of the pixels | one pass: PSNR, dB | FLIP | in rounds: PSNR, dB | FLIP |\n|---|---:|---:|---:|---:|"
    return "\n".join([head, *rows])


def put(name, table, page=PAGE):
    """Puts a table between its markers of a page."""
    load = f"*Load of the machine, with {os.cpu_count()} processors, when this ended: {os.getloadavg()[1]:.1f}.*"
    begin, end = f"<!-- measured: {name} -->", f"<!-- end of {name} -->"
    before, rest = page.read_text().split(begin)
    page.write_text(f"{before}{begin}\n{table}\n\n{load}\n{end}{rest.split(end)[1]}")


def main():
    scenes = sys.argv[1:] or [*SCENES, "rounds"]
    with tempfile.TemporaryDirectory() as folder:
        for scene in scenes:
            put(scene, (rounds if scene == "rounds" else functools.partial(measure, scene))(pathlib.Path(folder)))


if __name__ == "__main__":
    main()
