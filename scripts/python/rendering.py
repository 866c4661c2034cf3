"""Times and quality of `lacuna render`, as Markdown tables, and its pictures. Called by scripts/rendering."""

import argparse
import json
import os
import pathlib
import statistics
import sys
import tempfile

import numpy as np
from PIL import Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests"))

import frames  # noqa: E402
from pictures import srgb  # noqa: E402
from tool import DATA, ROOT, lacuna  # noqa: E402

SCENES = ROOT / "samples" / "scenes"
# Scene: its volume (nothing: made by the tool) and, if there is one, the frame made elsewhere from the same scene.
VOLUMES = {
    "engine": ("engine", "engine"), "engine-soft": ("engine", "engine-soft"), "tooth": ("tooth", "tooth"),
    "cthead": ("cthead", "head"), "aneurism-steep": ("aneurism", "aneurism-iso"), "aneurism": ("aneurism", None),
    "chest": ("chest", None), "foot": ("foot", None), "head": (None, None), "vessels": (None, None),
    "marschner-lobb": (None, None),
}
SHOWN = ["engine", "engine-soft", "tooth", "aneurism", "cthead", "foot", "chest", "head", "vessels", "marschner-lobb"]
# Seconds in table 4.2 of the thesis.
THESIS = {"engine": {600: 1093.61, 900: 2442.28, 1200: 4249.44}, "cthead": {600: 1754.92, 900: 3955.13, 1200: 7067.32}}
FILL = ["--density", "0.2", "--fill", "ss"]
# Scenes that take as many seconds must gain from being rendered sparsely.
SLOW = 4.0
# The tables stand between these in docs/measurements/rendering.md.
BEGIN, END = "<!-- scripts/rendering --docs -->", "<!-- end -->"
BEGIN_DENSE = "<!-- scripts/rendering --dense --docs -->"
DENSE = ["engine", "engine-soft", "tooth", "foot"]


def render(scene, out, *words):
    volume = VOLUMES[scene][0]
    where = ["--volume", DATA / "volumes" / f"{volume}.nrrd"] if volume else []
    report = out.with_suffix(".json")
    result = lacuna("render", SCENES / f"{scene}.toml", "-o", out, "-q", "--json", report, *where, *words, timeout=1200)
    frame = json.loads(report.read_text())["frames"][0]
    return {"wall": result.seconds, "busy": result.busy, "march": frame["rendered"], "fill": frame.get("filled")}


def measured(scene, size, runs, folder):
    """Medians of some runs: everything, a fifth, a fifth filled; dB of the filled one and against a frame made elsewhere."""
    words = ["--size", f"{size}x{size}"] if size else []
    whole, some, filled = folder / "whole.exr", folder / "some.exr", folder / "filled.exr"
    rows = {"all": [], "fifth": [], "filled": []}
    for _ in range(runs):
        rows["all"].append(render(scene, whole, *words))
        rows["fifth"].append(render(scene, some, *words, "--density", "0.2"))
        rows["filled"].append(render(scene, filled, *words, *FILL))
    found = {kind: {name: statistics.median(row[name] for row in taken) for name in taken[0] if taken[0][name] is not None}
             for kind, taken in rows.items()}
    picture = frames.colour(whole, "RGBA")
    found["dB"] = frames.psnr(frames.colour(filled, "RGBA"), picture)
    found["size"] = list(picture.shape[:2])
    frame = DATA / "frames" / f"{VOLUMES[scene][1]}.exr"
    if VOLUMES[scene][1] and not size and frame.exists():
        other = frames.colour(frame, "RGBA")
        found["other dB"] = frames.psnr(picture, other)
        found["other largest"] = float(np.abs(picture - other).max())
    found["load"] = os.getloadavg()[0]
    return found


def tables(results):
    """The tables as lines of Markdown."""
    lines = ["Wall seconds of the whole process, and the seconds that it kept processors busy (medians):", "",
             "| scene | size | all | 20 % and ss | times faster | march: 20 % over all | busy: all | 20 % | 20 % and ss | times faster | "
             "PSNR of the filling |",
             "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|"]
    for key, row in results.items():
        whole, fifth, filled = row["all"], row["fifth"], row["filled"]
        if "@" not in key:
            lines.append(f"| {key} | {row['size'][1]}x{row['size'][0]} | {whole['wall']:.2f} s | {filled['wall']:.2f} s | "
                         f"{whole['wall'] / filled['wall']:.1f} | {fifth['march'] / whole['march']:.3f} | {whole['busy']:.2f} s | {fifth['busy']:.2f} s | "
                         f"{filled['busy']:.2f} s | {whole['busy'] / filled['busy']:.1f} | {row['dB']:.2f} dB |")
    lines += ["", "The sizes of the thesis's table 4.2 (one thread of another machine, other transfer functions):", "",
              "| scene | size | thesis | all | 20 % and ss | busy: all | 20 % and ss | PSNR of the filling |",
              "|---|---|---:|---:|---:|---:|---:|---:|"]
    for scene, sizes in THESIS.items():
        for size, seconds in sizes.items():
            row = results.get(f"{scene}@{size}") or (results.get(scene) if size == 1200 else None)
            if row:
                lines.append(f"| {scene} | {size}x{size} | {seconds} s | {row['all']['wall']:.2f} s | "
                             f"{row['filled']['wall']:.2f} s | {row['all']['busy']:.2f} s | {row['filled']['busy']:.2f} s | "
                             f"{row['dB']:.2f} dB |")
    lines += ["", "Against frames that another ray caster made from the same scenes (samples as far apart, other arithmetic):", "",
              "| scene | frame | PSNR (RGBA, peak 1) | largest difference |", "|---|---|---:|---:|"]
    lines += [f"| {key} | {VOLUMES[key][1]}.exr | {row['other dB']:.1f} dB | {row['other largest']:.4f} |"
              for key, row in results.items() if "other dB" in row]
    loads = [row["load"] for row in results.values()]
    return [*lines, "", f"Load of the machine while measuring, on {os.cpu_count()} cores: {min(loads):.1f} to {max(loads):.1f}."]


def published(lines, begin=BEGIN):
    """Writes the tables into the documentation, between its two marks."""
    page = ROOT / "docs" / "measurements" / "rendering.md"
    before, rest = page.read_text().split(begin)
    _, after = rest.split(END, 1)
    page.write_text(before + "\n".join([begin, *lines, END]) + after)


def dense(options):
    """What dense AOVs cost and what they gain, in seconds that the whole process kept processors busy."""
    kinds = {"all": [], "fifth": ["--density", "0.2"], "dense": ["--density", "0.2", "--dense-aovs"], "ss": FILL,
             "guided": [*FILL, "--dense-aovs"]}
    lines = ["| scene | all | 20 % | 20 % and dense AOVs | these over all | 20 % and ss | with guides | PSNR | with guides |",
             "|---|---:|---:|---:|---:|---:|---:|---:|---:|"]
    for scene in DENSE:
        with tempfile.TemporaryDirectory() as folder:
            out = {kind: pathlib.Path(folder) / f"{kind}.exr" for kind in kinds}
            rows = [{kind: render(scene, out[kind], *words)["busy"] for kind, words in kinds.items()}
                    for _ in range(options.runs)]
            picture = frames.colour(out["all"], "RGBA")
            decibels = [frames.psnr(frames.colour(out[kind], "RGBA"), picture) for kind in ("ss", "guided")]
        busy = {kind: statistics.median(row[kind] for row in rows) for kind in kinds}
        share = (busy["dense"] - busy["fifth"]) / busy["all"]
        lines.append(f"| {scene} | {busy['all']:.2f} s | {busy['fifth']:.2f} s | {busy['dense']:.2f} s | {share:.2f} | "
                     f"{busy['ss']:.2f} s | {busy['guided']:.2f} s | {decibels[0]:.2f} dB | {decibels[1]:.2f} dB |")
        print(lines[-1], file=sys.stderr, flush=True)
    lines += ["", f"Medians of {options.runs}; load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."]
    print("\n".join(lines))
    if options.docs:
        published(lines, BEGIN_DENSE)


def measure(options):
    store = pathlib.Path(options.results) if options.results else None
    results = json.loads(store.read_text()) if store and store.exists() else {}
    wanted = [scene for scene, (volume, _) in VOLUMES.items() if not volume or DATA.is_dir()]
    keys = wanted + [f"{scene}@{size}" for scene in THESIS if scene in wanted for size in (600, 900)]
    with tempfile.TemporaryDirectory() as folder:
        for key in keys:
            scene, _, size = key.partition("@")
            if key in results or (options.only and scene != options.only):
                continue
            results[key] = measured(scene, int(size or 0), options.runs, pathlib.Path(folder))
            print(f"{key}: {json.dumps(results[key])}", file=sys.stderr, flush=True)
            if store:
                store.write_text(json.dumps(results, indent=1))
    lines = tables(results)
    print("\n".join(lines))
    if options.docs:
        published(lines)


def targets(options):
    """What was asked of the renderer, as a Markdown table of what is measured; 1 if something does not hold."""
    lines = []
    with tempfile.TemporaryDirectory() as folder:
        for scene in (scene for scene, (volume, _) in VOLUMES.items() if volume):
            slow = render(scene, pathlib.Path(folder) / "whole.exr")["wall"] >= SLOW
            if not slow and scene != "engine":
                continue
            row = measured(scene, 0, options.runs, pathlib.Path(folder))
            whole, fifth, filled = row["all"], row["fifth"], row["filled"]
            if scene == "engine":
                share = fifth["march"] / whole["march"]
                lines += [("engine, all of it, whole process", "<= 4 s", f"{whole['wall']:.2f} s", whole["wall"] <= 4.0),
                          ("engine against engine.exr", ">= 35 dB", f"{row['other dB']:.1f} dB", row["other dB"] >= 35.0),
                          ("engine, the march of 20 % over that of all", "<= 0.22", f"{share:.3f}", share <= 0.22)]
            if whole["wall"] >= SLOW:
                ratio, busy = whole["wall"] / filled["wall"], whole["busy"] / filled["busy"]
                lines.append((f"{scene}, all over 20 % and ss, whole process", ">= 3",
                              f"{ratio:.2f} ({whole['wall']:.2f} and {filled['wall']:.2f} s; busy {busy:.2f}; {row['dB']:.2f} dB)",
                              ratio >= 3.0))
    print("| what | asked | measured | holds |\n|---|---|---|---|")
    for what, asked, found, holds in lines:
        print(f"| {what} | {asked} | {found} | {'yes' if holds else 'no'} |")
    print(f"\nMedians of {options.runs} runs in turn; load of the machine at the end {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores.")
    return int(not all(holds for *_, holds in lines))


def shown(path):
    return Image.fromarray((srgb(frames.colour(path)) * 255 + 0.5).astype(np.uint8))


def pasted(rows, path, colours):
    """Rows of pictures of one size as a PNG."""
    width, height = rows[0][0].size
    canvas = Image.new("RGB", (width * len(rows[0]), height * len(rows)))
    for r, row in enumerate(rows):
        for c, picture in enumerate(row):
            canvas.paste(picture, (c * width, r * height))
    canvas = canvas.quantize(colours, dither=Image.Dither.NONE) if colours else canvas
    canvas.save(path, optimize=True)


def pictures():
    images = ROOT / "docs" / "images"
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "out.exr"
        if DATA.is_dir():
            found = []
            for scene in SHOWN:
                # Twice as large and halved, so that edges are smooth.
                render(scene, out, "--size", "320x320")
                found.append(shown(out).resize((160, 160), Image.Resampling.BOX))
            pasted([found[:5], found[5:]], images / "volumes.png", None)
        story = []
        chosen = ["--density", "0.1", "--adaptive"]
        for words in (chosen, [*chosen, "--fill", "auto"], []):
            render("head", out, "--size", "360x360", *words)
            story.append(shown(out).crop((60, 30, 300, 350)))
        pasted([story], images / "story.png", None)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--results")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--only", choices=list(VOLUMES))
    parser.add_argument("--docs", action="store_true")
    parser.add_argument("--targets", action="store_true")
    parser.add_argument("--dense", action="store_true")
    parser.add_argument("--pictures", action="store_true")
    options = parser.parse_args()
    if options.targets:
        sys.exit(targets(options))
    if options.dense:
        return dense(options)
    return pictures() if options.pictures else measure(options)


if __name__ == "__main__":
    main()
