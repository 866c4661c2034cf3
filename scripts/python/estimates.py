"""Holds estimated errors against true ones over many cases and writes the table of docs/measurements/methods.md; scripts/estimates says how it is used.

A case is a complete frame, a density, a pattern and a filter. Truth is the error of the missing pixels over red, green and blue, clipped
to 0 and 1 as `lacuna compare` does. The settings of the model were chosen on the frames marked `tuned`.
"""

import argparse
import json
import math
import pathlib
import re
import statistics
import subprocess
import tempfile

import numpy as np
import OpenImageIO as oiio

ROOT = pathlib.Path(__file__).parents[2]
LACUNA = ROOT / "target" / "release" / "lacuna"
FRAMES = ROOT.parent / "shared" / "data" / "frames"
PAGE = ROOT / "docs" / "measurements" / "methods.md"
BEGIN, END = "<!-- measured: scripts/estimates writes from here -->", "<!-- measured: to here -->"
TUNED = ("engine-soft", "tooth")
SINGLE = ("ss", "edge", "tv")
# Pixels chosen in rounds.
ADAPTIVE = "adaptive"


def frames():
    """The complete frames: those of the data beside the project, and the samples."""
    found = [FRAMES / f"{name}.exr" for name in ("engine", "engine-soft", "tooth", "head", "aneurism-iso")]
    guided = [FRAMES / f"{name}-aov.exr" for name in ("engine", "aneurism-iso")]
    samples = ROOT / "samples"
    own = [samples / "edges.exr", samples / "smooth.exr", samples / "texture.exr", samples / "full" / "sequence" / "shot.0001.exr"]
    return [path for path in [*found, *own, *guided] if path.exists()]


def read(path):
    image = oiio.ImageBuf(str(path))
    names = list(image.spec().channelnames)
    return image.get_pixels(oiio.FLOAT), names


def run(*command):
    subprocess.run([str(LACUNA), *map(str, command)], check=True, capture_output=True)


def colours(names):
    return [names.index(name) for name in ("R", "G", "B") if name in names] or [names.index("Y")]


def case(folder, path, density, pattern, filter_name, guides):
    """Truth and estimate of one case in decibels, the interval, and the share of each candidate."""
    truth, names = read(path)
    mask, sparse, full, report = (folder / name for name in ("mask.exr", "sparse.exr", "full.exr", "report.json"))
    for old in (mask, sparse, full, report):
        old.unlink(missing_ok=True)
    if pattern == ADAPTIVE:
        run("sparsify", path, "--density", density, "--adaptive", "-o", sparse)
    else:
        run("mask", "--size", f"{truth.shape[1]}x{truth.shape[0]}", "--density", density, "--pattern", pattern, "-o", mask)
        run("sparsify", path, "--mask", f"file:{mask}", "-o", sparse)
    command = ["fill", sparse, "-o", full, "--filter", filter_name, "--json", report]
    run(*command, *(["--guides-from", path] if guides else ["--guides", "none"]))
    filled, filled_names = read(full)
    flags, flag_names = read(sparse)
    missing = flags[..., flag_names.index("mask")] < 0.5
    difference = filled[..., colours(filled_names)].clip(0, 1) - truth[..., colours(names)].clip(0, 1)
    psnr = lambda error: -10 * math.log10(max(float((error.astype(np.float64) ** 2).mean()), 1e-30))
    record = json.loads(report.read_text())["frames"][0]
    wanted = {"R", "G", "B"} if "R" in names else {"Y"}
    found = next(item for item in record["estimates"] if wanted & set(item["channels"]))
    # A bound is an interval without an upper end or a middle.
    told = found.get("psnr") or ("psnr_at_least" in found and {"low": found["psnr_at_least"], "high": math.inf}) or None
    return psnr(difference[missing]), psnr(difference), told, found.get("unknown"), record.get("chosen", "")


def estimates(folder, paths, densities, patterns, filters):
    rows = []
    for path in paths:
        guided = path.stem.endswith("-aov")
        for density in densities:
            for pattern in patterns:
                for filter_name in ["auto"] if guided else filters:
                    truth, whole, found, unknown, chosen = case(folder, path, density, pattern, filter_name, guided)
                    rows.append((path.stem, density, pattern, filter_name, truth, found, unknown, whole, chosen))
                    shown = " | ".join(words(found, unknown))
                    print(f"{path.stem:16} {density:<5} {pattern:8} {filter_name:5} {truth:6.2f} {shown} whole {whole:.2f} {chosen}", flush=True)
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
    for name, density, pattern, filter_name, truth, found, unknown, *_ in rows:
        estimated = " | ".join(words(found, unknown))
        mark = " (tuned)" if name in TUNED else ""
        lines.append(f"| {name}{mark} | {density} | {pattern} | {filter_name} | {truth:.1f} | {estimated} |")
    blind = [row for row in rows if row[0] not in TUNED]
    chosen = [row for row in rows if row[2] == ADAPTIVE]
    parts = [summary(rows), "Without the tuned frames: " + summary(blind)]
    parts += ["Pixels chosen in rounds: " + summary(chosen)] if chosen and len(chosen) < len(rows) else []
    return "\n".join(["", *parts, "", *lines, ""])


def auto(rows):
    """The choice against the best single filter, whole frames."""
    best = {}
    for name, density, pattern, filter_name, _, _, _, whole, _ in rows:
        best.setdefault((name, density, pattern), {})[filter_name] = whole
    lines = ["| frame | density | pattern | ss | edge | tv | auto | auto over the best |", "|---|---:|---|---:|---:|---:|---:|---:|"]
    for (name, density, pattern), of in best.items():
        if not set(SINGLE) <= set(of) or "auto" not in of:
            continue
        ahead = of["auto"] - max(of[filter_name] for filter_name in SINGLE)
        values = " | ".join(f"{of[filter_name]:.2f}" for filter_name in (*SINGLE, "auto"))
        lines.append(f"| {name} | {density} | {pattern} | {values} | {ahead:+.2f} |")
    return "\n".join(["", *lines, ""])


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--densities", type=float, nargs="+", default=[0.05, 0.2, 0.5])
    parser.add_argument("--patterns", nargs="+", default=["shuffle", "random", ADAPTIVE])
    parser.add_argument("--filters", nargs="+", default=["ss", "edge", "tv", "auto"])
    parser.add_argument("--frames", nargs="+", help="only frames of these names")
    parser.add_argument("--write", action="store_true", help="write the tables into docs/measurements/methods.md")
    arguments = parser.parse_args()
    paths = [path for path in frames() if not arguments.frames or path.stem in arguments.frames]
    with tempfile.TemporaryDirectory() as folder:
        rows = estimates(pathlib.Path(folder), paths, arguments.densities, arguments.patterns, arguments.filters)
    text = f"{auto(rows)}\n{table(rows)}"
    print(text)
    if arguments.write:
        page = PAGE.read_text()
        marked = re.compile(f"{re.escape(BEGIN)}.*{re.escape(END)}", re.S)
        PAGE.write_text(marked.sub(lambda _: f"{BEGIN}\n{text}\n{END}", page))


main()
