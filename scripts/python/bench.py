"""Times lacuna beside its peers and writes the measured part of docs/measurements/performance.md; scripts/bench says how it is used.

Processes take turns, so that what else the machine does falls on all of them alike. A figure is the median over the runs of
the time on the wall, `cpu` that of user and system time of the process.
"""

import argparse
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np
import OpenImageIO as oiio

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from tool import LACUNA, OIIO_BIN, run as run_tool  # noqa: E402

RENDER = ROOT.parent / "shared" / "data" / "frames" / "engine.exr"
SAMPLE = ROOT / "samples" / "smooth.exr"
PAGE = ROOT / "docs" / "measurements" / "performance.md"
BEGIN, END = "<!-- measured: scripts/bench writes from here -->", "<!-- measured: to here -->"
OIIOTOOL = OIIO_BIN / "oiiotool"
SEQUENCE = 50
# Most seconds of processor time, where a bound was promised: the run fails beyond it, once everything is measured.
BOUNDS = {"fill --filter ss": 1.0, "fill --filter cs-wavelet": 20.0, "fill --filter cs-gradient": 20.0, "a page of ten renders": 2.0}


def read(path, names="RGB"):
    image = oiio.ImageBuf(str(path))
    channels = list(image.spec().channelnames)
    return image.get_pixels(oiio.FLOAT)[..., [channels.index(name) for name in names]]


def write(path, pixels, names, kind="float"):
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    spec.channelnames = names
    spec["compression"] = "zip"
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), spec)
    out.write_image(np.ascontiguousarray(pixels, dtype=np.float32))
    out.close()


def shuffle(height, width, density):
    """Low-discrepancy samples: an additive recurrence with the plastic number."""
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    return (x * 0.7548776662466927 + y * 0.5698402909980532 + 0.618) % 1.0 < density


def run(command, output):
    """Seconds on the wall and of the processor, peak memory in MB."""
    for path in output if isinstance(output, list) else [output]:
        path.unlink(missing_ok=True)
    result = run_tool(command)
    if result.status:
        sys.exit(f"bench: {result}")
    return result.seconds, result.busy, result.peak_bytes / 2**20


def race(commands, runs):
    """Medians of commands that take turns: name -> (wall, cpu, memory)."""
    results = {name: [] for name, _, _ in commands}
    for _ in range(runs):
        for name, command, output in commands:
            results[name].append(run(command, output))
    return {name: tuple(statistics.median(column) for column in zip(*rows)) for name, rows in results.items()}


def psnr(pixels, full):
    error = np.mean((np.clip(pixels, 0, 1).astype(np.float64) - np.clip(full, 0, 1)) ** 2)
    return -10 * np.log10(error)


def whole_process(folder, full, runs):
    height, width, _ = full.shape
    mask = shuffle(height, width, 0.2)
    flags = mask[..., None].astype(np.float32)
    sparse = np.concatenate([full * flags, flags], -1)
    write(folder / "sparse.exr", sparse, ("R", "G", "B", "mask"))
    write(folder / "alpha.exr", sparse, ("R", "G", "B", "A"))
    write(folder / "dense.exr", np.concatenate([full, flags], -1), ("R", "G", "B", "mask"))
    out = folder / "out.exr"
    fill = [LACUNA, "fill", "-q", folder / "sparse.exr", "-o", out, "--filter"]
    commands = [(f"fill --filter {name}", [*fill, name], out) for name in ("ss", "tv", "pushpull")]
    commands.append(("oiiotool copy", [OIIOTOOL, folder / "dense.exr", "-o", out], out))
    commands.append(("oiiotool --fillholes", [OIIOTOOL, folder / "alpha.exr", "--fillholes", "-o", out], out))
    results = race(commands, runs)
    run([*fill, "ss"], out)
    quality = psnr(read(out), full)
    image = oiio.ImageBuf(oiio.ImageSpec(width, height, 4, "float"))
    image.specmod().alpha_channel = 3
    image.set_pixels(oiio.ROI(), np.ascontiguousarray(sparse))
    times = []
    for _ in range(runs):
        start, busy = time.perf_counter(), time.process_time()
        oiio.ImageBufAlgo.fillholes_pushpull(image)
        times.append((time.perf_counter() - start, time.process_time() - busy))
    peer = tuple(statistics.median(column) for column in zip(*times))
    return results, quality, peer


def large(folder, full, runs):
    """3840 x 2160 RGBA half ZIP, 25 %; the peer copies the filled file."""
    tiles = np.tile(full, (2160 // full.shape[0] + 1, 3840 // full.shape[1] + 1, 1))[:2160, :3840]
    mask = shuffle(2160, 3840, 0.25)[..., None].astype(np.float32)
    names = ("R", "G", "B", "A", "mask")
    alpha = np.clip(tiles.sum(-1, keepdims=True), 0, 1)
    write(folder / "sparse4k.exr", np.concatenate([tiles * mask, alpha * mask, mask], -1), names, "half")
    filled, copy = folder / "filled4k.exr", folder / "copy4k.exr"
    fill = [LACUNA, "fill", "-q", folder / "sparse4k.exr", "-o", filled, "--filter", "ss"]
    run(fill, filled)
    commands = [("oiiotool copy", [OIIOTOOL, filled, "-o", copy], copy), ("fill --filter ss", fill, filled)]
    # The copy reads what the fill before it wrote.
    return race(commands, runs)


def sequence(folder, full, runs):
    """Frame time of a sequence with one mask against single runs of the same frames."""
    (folder / "in").mkdir()
    (folder / "out").mkdir()
    mask = shuffle(*full.shape[:2], 0.2)[..., None].astype(np.float32)
    for frame in range(1, SEQUENCE + 1):
        pixels = np.roll(full, 3 * frame, axis=1) * mask
        write(folder / "in" / f"f.{frame:04}.exr", np.concatenate([pixels, mask], -1), ("R", "G", "B", "mask"))
    outputs = [folder / "out" / f"f.{frame:04}.exr" for frame in range(1, SEQUENCE + 1)]
    whole = [LACUNA, "fill", "-q", folder / "in" / "f.####.exr", "-o", folder / "out" / "f.####.exr", "--filter", "ss"]
    together, single = [], []
    for _ in range(max(1, runs // 5)):
        together.append([value / SEQUENCE for value in run(whole, outputs)[:2]])
        for frame in range(1, 11):
            name = f"f.{frame:04}.exr"
            out = folder / "single.exr"
            single.append(run([LACUNA, "fill", "-q", folder / "in" / name, "-o", out, "--filter", "ss"], out)[:2])
    return [tuple(statistics.median(column) for column in zip(*rows)) for rows in (together, single)]


def sensing(folder, full):
    """Compressed sensing at half of the pixels, on two threads: name -> (wall, cpu, memory), each of one run."""
    mask = shuffle(*full.shape[:2], 0.5)[..., None].astype(np.float32)
    write(folder / "half.exr", np.concatenate([full * mask, mask], -1), ("R", "G", "B", "mask"))
    out = folder / "sensed.exr"
    fill = [LACUNA, "fill", "-q", folder / "half.exr", "-o", out, "--threads", "2", "--filter"]
    return {f"fill --filter {name}": run([*fill, name], out) for name in ("cs-wavelet", "cs-gradient")}


def report_page(folder, full):
    """Seconds until a browser has loaded the report on ten renders, and those that the page's thread works; None without one."""
    import chromium

    if not chromium.find():
        return None
    mask = shuffle(*full.shape[:2], 0.2)[..., None].astype(np.float32)
    for number in range(1, 11):
        pixels = np.roll(full, 37 * number, axis=1)
        write(folder / f"r.{number:04}.exr", pixels, ("R", "G", "B"))
        write(folder / f"s.{number:04}.exr", np.concatenate([pixels * mask, mask], -1), ("R", "G", "B", "mask"))
    page, filled = folder / "report.html", [folder / f"t.{number:04}.exr" for number in range(1, 11)]
    run([LACUNA, "fill", "-q", folder / "s.####.exr", "-o", folder / "t.####.exr"], filled)
    run([LACUNA, "compare", "-q", folder / "r.####.exr", folder / "t.####.exr", "--html", page], page)
    with chromium.Page(page.as_uri()) as opened:
        opened.wait("document.body.dataset.ready !== undefined")
        return opened.seconds_to_load, opened.busy()


UNITS = {"ns": 1e-9, "µs": 1e-6, "ms": 1e-3, "s": 1.0}


def solves(path):
    """Medians that divan printed: (benchmark, argument) -> seconds."""
    found, group = {}, ""
    for line in pathlib.Path(path).read_text().splitlines():
        head = re.match(r"^[├╰]─ (\w+)", line)
        if head:
            group = head.group(1)
        name = re.match(r"^[│├╰─ ]*([\w.%-]+)", line)
        columns = re.split(r"│", re.sub(r"^[│├╰─ ]*", "", line))
        values = [re.search(r"([\d.]+) (ns|µs|ms|s)\b", column) for column in columns]
        if name and len(values) >= 3 and values[2]:
            argument = "" if name.group(1) == group else name.group(1)
            found[group, argument] = float(values[2].group(1)) * UNITS[values[2].group(2)]
    return found


def machine():
    text = pathlib.Path("/proc/cpuinfo").read_text() if os.path.exists("/proc/cpuinfo") else ""
    model = re.search(r"model name\s*:\s*(.*)", text)
    sets = [name for name in ("avx2", "avx512f") if re.search(rf"\b{name}\b", text)]
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    version = subprocess.run(["rustc", "--version"], capture_output=True, text=True).stdout.strip()
    return (
        f"Measured on {time.strftime('%Y-%m-%d')}: {model.group(1) if model else 'an unknown processor'}, "
        f"{os.cpu_count()} processors, {' '.join(sets)}; {version}; OpenImageIO {oiio.__version__}; load before (1, 5, 15 minutes): {load}."
    )


def solve_rows(found, peer):
    rows = []
    base = found.get(("ss_reconstruct", "shuffle"))
    for key, seconds in found.items():
        name = " ".join(part for part in key if part)
        ratio = f"{seconds / base:.2f} x ss shuffle" if base and key[0] in ("ss_reconstruct", "ss_third_order") else ""
        if key == ("ss_reconstruct", "shuffle"):
            ratio = f"{seconds / peer[0]:.2f} x OpenImageIO"
        rows.append(f"| solve | {name} | {seconds:.4f} | | {ratio} |")
    sides = [found.get(("ss_side", str(side))) for side in (1024, 8192)]
    if all(sides):
        rows.append(f"| solve | time a pixel, 8192 over 1024 a side | | | {sides[1] / sides[0] / 64:.2f} |")
    threads = [found.get(("ss_threads", str(count))) for count in (1, 2)]
    if all(threads):
        rows.append(f"| solve | one thread over two | | | {threads[0] / threads[1]:.2f} |")
    return rows


def table(arguments):
    full = read(RENDER if RENDER.exists() else SAMPLE)
    lines = [machine(), "", "| what | | wall, s | cpu, s | ratio |", "|---|---|---|---|---|"]
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        results, quality, peer = whole_process(folder, full, arguments.runs)
        copy, holes = results["oiiotool copy"], results["oiiotool --fillholes"]
        for name, (wall, cpu, _) in results.items():
            ratio = f"{wall / copy[0]:.2f} x copy ({cpu / copy[1]:.2f} cpu), {wall / holes[0]:.2f} x --fillholes ({cpu / holes[1]:.2f} cpu)"
            lines.append(f"| process | {name} | {wall:.3f} | {cpu:.3f} | {ratio} |")
        spent = {name: cpu for name, (_, cpu, _) in results.items()}
        lines.append(f"| process | quality of ss: {quality:.2f} dB | | | |")
        lines.append(f"| solve | OpenImageIO fillholes_pushpull | {peer[0]:.4f} | {peer[1]:.4f} | |")
        lines += solve_rows(solves(arguments.solves), peer) if arguments.solves else []
        results = large(folder, full, arguments.runs)
        copy = results["oiiotool copy"]
        for name, (wall, cpu, memory) in results.items():
            ratio = f"{wall / copy[0]:.2f} x copy ({cpu / copy[1]:.2f} cpu), {memory:.0f} MB"
            lines.append(f"| 3840 x 2160 RGBA half | {name} | {wall:.3f} | {cpu:.3f} | {ratio} |")
        together, single = sequence(folder, full, arguments.runs)
        lines.append(f"| {SEQUENCE} frames | a frame of the sequence | {together[0]:.3f} | {together[1]:.3f} | {together[0] / single[0]:.2f} x single ({together[1] / single[1]:.2f} cpu) |")
        lines.append(f"| {SEQUENCE} frames | a single run | {single[0]:.3f} | {single[1]:.3f} | |")
        for name, (wall, cpu, memory) in sensing(folder, full).items():
            spent[name] = cpu
            lines.append(f"| half of the pixels | {name} | {wall:.2f} | {cpu:.2f} | at most {BOUNDS[name]:.0f} s of cpu; {memory:.0f} MB |")
        if opened := report_page(folder, full):
            name = "a page of ten renders"
            spent[name] = opened[1]
            lines.append(f"| report | {name} | {opened[0]:.2f} | {opened[1]:.2f} | at most {BOUNDS[name]:.0f} s of cpu |")
    return "\n".join(lines), [f"{name}: {spent[name]:.2f} s of {bound}" for name, bound in BOUNDS.items() if spent.get(name, 0) > bound]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=7, help="runs of each process")
    parser.add_argument("--solves", help="what `cargo bench` printed")
    parser.add_argument("--print", action="store_true", help="only print, leave docs/measurements/performance.md alone")
    parser.add_argument("--planes", help="only write the render's planes there, for the solver benches")
    arguments = parser.parse_args()
    if arguments.planes:
        if RENDER.exists():
            np.ascontiguousarray(np.moveaxis(read(RENDER), -1, 0), dtype="<f4").tofile(arguments.planes)
        return
    measured, beyond = table(arguments)
    print(measured)
    if not arguments.print:
        before, _, rest = PAGE.read_text().partition(BEGIN)
        _, _, after = rest.partition(END)
        PAGE.write_text(f"{before}{BEGIN}\n\n{measured}\n\n{END}{after}")
    if beyond:
        sys.exit(f"bench: beyond its bound: {'; '.join(beyond)}")


if __name__ == "__main__":
    main()
