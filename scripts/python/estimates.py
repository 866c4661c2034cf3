"""Holds estimated errors against true ones over many cases and writes the table of docs/measurements/methods.md; scripts/estimates says how it is used.

A case is a complete frame, a density, a pattern and a filter. Truth is the error of the missing pixels over red, green and blue, clipped
to 0 and 1 as `lacuna compare` does. Frames are those of the data beside the project, the samples, renders of scenes of
`samples/scenes`, and path-traced ones by the bridges to Mitsuba and LuxCore. The settings of the model were chosen on the frames of
TUNED and crops of them, those for rounds on scenes of ROUNDS as well; all other cases are blind.
"""

import argparse
import json
import math
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile

import numpy as np
import OpenImageIO as oiio

ROOT = pathlib.Path(__file__).parents[2]
LACUNA = pathlib.Path(os.environ.get("LACUNA", ROOT / "target" / "release" / "lacuna"))
FRAMES = ROOT.parent / "shared" / "data" / "frames"
PAGE = ROOT / "docs" / "measurements" / "methods.md"
BEGIN, END = "<!-- measured: scripts/estimates writes from here -->", "<!-- measured: to here -->"
NOISE = ROOT.parent / "shared" / "data" / "noise"
VOLUMES = ROOT.parent / "shared" / "data" / "volumes"
SCENES = {"foot": "foot.nrrd", "chest": "chest.nrrd", "cthead": "cthead.nrrd", "vessels": None, "marschner-lobb": None}
BRIDGES = {"watch": ("mitsuba_sparse.py", "watch.xml", 64), "still": ("luxcore_sparse.py", "still.cfg", 32)}
IMAGES = ROOT.parent / "shared" / "data" / "exr" / "openexr-images"
# Photographs, most of long range: how light is compared was chosen with them in sight, nothing else.
PHOTOGRAPHS = ("ScanLines/Desk", "ScanLines/CandleGlass", "ScanLines/StillLife", "ScanLines/Tree", "ScanLines/MtTamWest", "ScanLines/Cannon", "ScanLines/Carrots", "Tiles/GoldenGate", "Chromaticities/Rec709")
TUNED = ("engine", "engine-soft", "tooth", "head", "aneurism-iso", "edges", "smooth", "texture", "hdr", "shot.0001", "engine-aov", "aneurism-iso-aov", "gloss_reference", "cloud_reference")
ROUNDS = ("foot", "chest")
# Frames whose error channel is held against the truth, and the least error that counts there.
BINNED, VISIBLE = ("engine", "head", "aneurism-iso"), 1e-4
SINGLE = ("ss", "cnn", "edge", "tv")
# Densities at which the filter that chooses is held against these.
CHOICE = (0.05, 0.2, 0.5)
# Pixels chosen in rounds.
ADAPTIVE = "adaptive"
# What is done with every frame: density, pattern, filters.
CASES = [
    (0.2, "shuffle", ("ss", "edge", "cnn", "tv", "auto")),
    (0.05, "shuffle", ("auto",)),
    (0.1, "shuffle", ("tv", "auto")),
    (0.5, "shuffle", ("auto",)),
    (0.2, "random", ("auto",)),
    (0.1, ADAPTIVE, ("auto",)),
]


def frames(folder, wanted):
    """The complete frames, those of these names or all; what is rendered goes into the folder."""
    found = [FRAMES / f"{name}.exr" for name in ("engine", "engine-soft", "tooth", "head", "aneurism-iso")]
    guided = [FRAMES / f"{name}-aov.exr" for name in ("engine", "aneurism-iso")]
    noise = [NOISE / f"{name}_reference.exr" for name in ("gloss", "cloud")]
    samples = ROOT / "samples"
    own = [samples / "edges.exr", samples / "smooth.exr", samples / "texture.exr", samples / "hdr.exr", samples / "full" / "sequence" / "shot.0001.exr"]
    paths = [path for path in [*found, *own, *guided, *noise] if path.exists() and (not wanted or path.stem in wanted)]
    for name, volume in SCENES.items():
        if (not wanted or name in wanted) and (volume is None or (VOLUMES / volume).exists()):
            paths.append(folder / f"{name}.exr")
            run("render", ROOT / "samples" / "scenes" / f"{name}.toml", "--size", "480x360", *(["--volume", VOLUMES / volume] if volume else []), "-o", paths[-1])
    bridges = [name for name in BRIDGES if not wanted or name in wanted]
    if bridges:
        subprocess.run([sys.executable, ROOT / "samples" / "renderers" / "make.py"], check=True, capture_output=True)
    for name in bridges:
        bridge, scene, spp = BRIDGES[name]
        paths.append(folder / f"{name}.exr")
        rendered = folder / f"{name}-masked.exr"
        words = [ROOT / "scripts" / "renderers" / bridge, ROOT / "samples" / "renderers" / scene, "-o", rendered, "--density", 1, "--spp", spp]
        subprocess.run([sys.executable, *map(str, words)], check=True, capture_output=True, env={**os.environ, "LACUNA": str(LACUNA)})
        run("fill", rendered, "--drop-mask", "-o", paths[-1])
    return paths


def read(path):
    image = oiio.ImageBuf(str(path))
    names = list(image.spec().channelnames)
    return image.get_pixels(oiio.FLOAT), names


def run(*command):
    subprocess.run([str(LACUNA), *map(str, command)], check=True, capture_output=True)


def colours(names):
    return [names.index(name) for name in ("R", "G", "B") if name in names] or [names.index("Y")]


def psnr(error):
    return -10 * math.log10(max(float((error.astype(np.float64) ** 2).mean()), 1e-30))


def sparsify(folder, path, density, pattern):
    """The frame with only some of its pixels."""
    mask, sparse = folder / "mask.exr", folder / "sparse.exr"
    for old in (mask, sparse):
        old.unlink(missing_ok=True)
    if pattern == ADAPTIVE:
        run("sparsify", path, "--density", density, "--adaptive", "-o", sparse)
    else:
        pixels, _ = read(path)
        run("mask", "--size", f"{pixels.shape[1]}x{pixels.shape[0]}", "--density", density, "--pattern", pattern, "-o", mask)
        run("sparsify", path, "--mask", f"file:{mask}", "-o", sparse)
    return sparse


def difference(path, full):
    """What is filled less what is true, colours clipped to 0 and 1."""
    (truth, names), (filled, filled_names) = read(path), read(full)
    return filled[..., colours(filled_names)].clip(0, 1) - truth[..., colours(names)].clip(0, 1)


def case(folder, path, density, pattern, filter_name, guides):
    """Truth and estimate of one case in decibels."""
    _, names = read(path)
    full, report = (folder / name for name in ("full.exr", "report.json"))
    for old in (full, report):
        old.unlink(missing_ok=True)
    sparse = sparsify(folder, path, density, pattern)
    command = ["fill", sparse, "-o", full, "--filter", filter_name, "--json", report]
    run(*command, *(["--guides-from", path] if guides else ["--guides", "none"]))
    flags, flag_names = read(sparse)
    missing = flags[..., flag_names.index("mask")] < 0.5
    record = json.loads(report.read_text())["frames"][0]
    wanted = {"R", "G", "B"} if "R" in names else {"Y"}
    found = next(item for item in record["estimates"] if wanted & set(item["channels"]))
    # A bound is an interval without an upper end or a middle.
    told = found.get("psnr") or ("psnr_at_least" in found and {"low": found["psnr_at_least"], "high": math.inf}) or None
    return psnr(difference(path, full)[missing]), told, found.get("unknown"), record.get("chosen", "")


def is_blind(row):
    """Whether nothing was chosen on a case like this."""
    return row[0] not in TUNED and not (row[0] in ROUNDS and row[2] == ADAPTIVE)


def estimates(folder, paths, cases):
    rows = []
    for path in paths:
        guided = path.stem.endswith("-aov")
        for density, pattern, filters in cases:
            for filter_name in ("auto",) if guided else filters:
                truth, found, unknown, chosen = case(folder, path, density, pattern, filter_name, guided)
                rows.append((path.stem, density, pattern, filter_name, truth, found, unknown))
                shown = " | ".join(words(found, unknown))
                print(f"{path.stem:16} {density:<5} {pattern:8} {filter_name:5} {truth:6.2f} {shown} {chosen}", flush=True)
    return rows


def words(found, unknown):
    """The estimate and its interval."""
    if not found:
        return "-", f"cannot be told: {unknown}"
    if "estimate" not in found:
        return "-", f"at least {found['low']:.1f}"
    return f"{found['estimate']:.1f}", f"{found['low']:.1f} to {found['high']:.1f}"


def summary(rows):
    told = [(row[4], row[5]) for row in rows if row[5]]
    bounds = sum("estimate" not in found for _, found in told)
    off = [abs(found["estimate"] - truth) for truth, found in told if "estimate" in found]
    within = sum(found["low"] <= truth <= found["high"] for truth, found in told)
    return (
        f"{len(rows)} cases, {len(rows) - len(told)} of which cannot be told and {bounds} of which have a bound. Median of the difference {statistics.median(off):.2f} dB, "
        f"{100 * sum(value <= 2 for value in off) / len(off):.0f} % within 2 dB, largest {max(off):.2f} dB; "
        f"the interval or the bound holds the truth in {100 * within / len(told):.0f} %."
    )


def table(rows):
    lines = ["| frame | density | pattern | filter | true (dB) | estimated (dB) | interval |", "|---|---:|---|---|---:|---:|---|"]
    for name, density, pattern, filter_name, truth, found, unknown in rows:
        estimated = " | ".join(words(found, unknown))
        mark = "" if is_blind((name, density, pattern)) else " (tuned)"
        lines.append(f"| {name}{mark} | {density} | {pattern} | {filter_name} | {truth:.1f} | {estimated} |")
    blind = [row for row in rows if is_blind(row)]
    chosen = [row for row in rows if row[2] == ADAPTIVE]
    parts = [summary(rows)] + ["Without the cases that settings were chosen on: " + summary(blind)] * bool(blind)
    parts += ["Pixels chosen in rounds: " + summary(chosen)] if chosen and len(chosen) < len(rows) else []
    return "\n".join(["", *parts, "", *lines, ""])


def choice(folder, paths, densities):
    """The filter that chooses against the best single one, whole frames."""
    lines = [f"| frame | density | {' | '.join(SINGLE)} | auto | auto over the best |", "|---|" + "---:|" * (len(SINGLE) + 3)]
    full = folder / "full.exr"
    for path in (path for path in paths if not path.stem.endswith("-aov")):
        for density in densities:
            sparse, values = sparsify(folder, path, density, "shuffle"), []
            for filter_name in (*SINGLE, "auto"):
                full.unlink(missing_ok=True)
                run("fill", sparse, "-o", full, "--filter", filter_name, "--guides", "none", "--no-estimate")
                values.append(psnr(difference(path, full)))
            shown = " | ".join(f"{value:.2f}" for value in values)
            lines.append(f"| {path.stem} | {density} | {shown} | {values[-1] - max(values[:-1]):+.2f} |")
            print(lines[-1], flush=True)
    return "\n".join(["", *lines, ""])


def bins(folder, paths):
    """The error channel: over ten equal bins of predicted error, measured over predicted root mean square error."""
    lines = ["| frame | " + " | ".join(str(k) for k in range(1, 11)) + " |", "|---|" + "---:|" * 10]
    for path in (path for path in paths if path.stem in BINNED):
        sparse, full = folder / "sparse.exr", folder / "full.exr"
        run("sparsify", path, "--density", 0.2, "-o", sparse)
        run("fill", sparse, "-o", full, "--guides", "none", "--error-channel")
        (filled, filled_names), (flags, flag_names) = read(full), read(sparse)
        predicted = filled[..., filled_names.index("error")].astype(np.float64)
        asked = (flags[..., flag_names.index("mask")] < 0.5) & (predicted >= VISIBLE)
        squared, predicted = (difference(path, full).astype(np.float64) ** 2).mean(-1)[asked], predicted[asked]
        parts = np.array_split(np.argsort(predicted, kind="stable"), 10)
        ratios = [math.sqrt(squared[part].mean() / (predicted[part] ** 2).mean()) for part in parts]
        lines.append(f"| {path.stem} | " + " | ".join(f"{ratio:.2f}" for ratio in ratios) + " |")
    return "\n".join(["", "The error channel at 20 % shuffle by `auto`: measured over predicted RMSE of the pixels predicted to be off by 1e-4 or more, in ten bins of equally many:", "", *lines, ""])


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--densities", type=float, nargs="+", help="these instead of the documented cases")
    parser.add_argument("--patterns", nargs="+", default=["shuffle"], help="with --densities: shuffle, random, adaptive, ...")
    parser.add_argument("--filters", nargs="+", default=["ss", "edge", "cnn", "tv", "auto"], help="with --densities")
    parser.add_argument("--frames", nargs="+", help="only frames of these names")
    parser.add_argument("--write", action="store_true", help="write the tables into docs/measurements/methods.md")
    arguments = parser.parse_args()
    several = [(density, pattern, arguments.filters) for density in arguments.densities or [] for pattern in arguments.patterns]
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        paths = frames(folder, arguments.frames)
        photographs = [path for name in PHOTOGRAPHS if (path := IMAGES / f"{name}.exr").exists() and (not arguments.frames or path.stem in arguments.frames)]
        chosen = choice(folder, [*paths, *photographs], arguments.densities or CHOICE)
        rows = estimates(folder, paths, several or CASES)
        paths = frames(folder, [*BINNED])
        channel = bins(folder, paths) if not arguments.frames or set(arguments.frames) & set(BINNED) else ""
    text = f"{chosen}\n{channel}\n{table(rows)}"
    print(text)
    if arguments.write:
        page = PAGE.read_text()
        marked = re.compile(f"{re.escape(BEGIN)}.*{re.escape(END)}", re.S)
        PAGE.write_text(marked.sub(lambda _: f"{BEGIN}\n{text}\n{END}", page))


main()
