"""The tables of docs/measurements/sequences.md. Called by scripts/temporal; arguments: a folder for renders and fills, then names of tables.

Volumes are taken from ../shared/data/volumes; VOLUMES names another folder. PSNR is of RGB, clipped to 0 to 1, over whole frames; of a
sequence, the mean of its inner frames. Flicker is the root mean square change of the error from frame to frame, in pixels that are missing in either.
Seconds are those that processors were busy.
"""

import itertools
import json
import os
import pathlib
import re
import resource
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import OpenEXR

ROOT = pathlib.Path(__file__).resolve().parents[2]
LACUNA = os.environ.get("LACUNA", str(ROOT / "target" / "release" / "lacuna"))
VOLUMES = pathlib.Path(os.environ.get("VOLUMES", ROOT.parent / "shared" / "data" / "volumes"))
# Scenes and their volumes: those that are asked for, and further ones.
SCENES = {"engine": "engine.nrrd", "aneurism": "aneurism.nrrd", "head": None, "tooth": "tooth.nrrd"}
OTHERS = {"vessels": None, "foot": "foot.nrrd", "chest": "chest.nrrd", "engine-soft": "engine.nrrd"}
FRAMES, INNER = range(1, 10), range(3, 8)
SIZE, SAMPLES, DENSITY = 480, 4, 0.2
ALONG = ["--temporal", "auto"]
WAYS = {
    "alone, ss": ["--filter", "ss"],
    "alone": [],
    "depth and camera": [*ALONG, "--motion", "camera"],
    "flow": [*ALONG, "--motion", "flow"],
}


def lacuna(*words):
    """Runs the tool: the seconds that it kept processors busy, and the most memory that it took, in bytes."""
    process = subprocess.Popen([LACUNA, *map(str, words), "-q"])
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"lacuna {' '.join(map(str, words))}: ended with status {process.returncode}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss * 1024


def name(folder, kind, frame="####"):
    return folder / kind / (f"shot.{frame:04}.exr" if isinstance(frame, int) else f"shot.{frame}.exr")


def span(frames):
    return f"{frames[0]}-{frames[-1]}"


def masks(work, size, frames=FRAMES, density=DENSITY):
    pattern = work / (f"mask-{size}" if density == DENSITY else f"mask-{size}-{density}") / "mask.####.png"
    if not pattern.with_name(f"mask.{frames[-1]:04}.png").exists():
        pattern.parent.mkdir(parents=True, exist_ok=True)
        lacuna("mask", "-o", pattern, "--size", f"{size}x{size}", "--density", density, "--frames", span(frames), "--temporal", "complementary")
    return pattern


def render(folder, scene, frames, size, *words):
    """The complete frames, those that are not there yet."""
    volume = (SCENES | OTHERS)[scene]
    if volume and not (VOLUMES / volume).exists():
        print(f"{scene} is left out: {VOLUMES / volume} is not there", file=sys.stderr)
        return False
    (folder / "full").mkdir(parents=True, exist_ok=True)
    source = ["--volume", VOLUMES / volume] if volume else []
    lacuna("render", ROOT / "samples" / "scenes" / f"{scene}.toml", *source, "-o", name(folder, "full"), "--frames", span(frames),
           "--size", f"{size}x{size}", "--samples", SAMPLES, "--depth", "--no-clobber", *words)
    return True


def sparse(folder, work, size, frames, *words, density=DENSITY, rounds=False):
    """The kind of frames that have a part of the pixels alone: by complementary masks, or chosen in rounds."""
    kind = "-".join(["sparse", *(["rounds"] if rounds else []), *([str(density)] if density != DENSITY else [])])
    if not name(folder, kind, frames[-1]).exists():
        (folder / kind).mkdir(exist_ok=True)
        chosen = ["--density", density, "--adaptive"] if rounds else ["--mask", masks(work, size, frames, density)]
        lacuna("sparsify", name(folder, "full"), "-o", name(folder, kind), *chosen, "--frames", span(frames), *words)
    return kind


def turntable(work, scene, size=SIZE, frames=FRAMES, dense=0):
    """The folder of a turntable, with dense AOVs of so many samples a pixel; nothing if its volume is not there."""
    folder = work / f"{scene}-{size}{f'-dense-{dense}' if dense else ''}"
    if not render(folder, scene, frames, size, "--set", "camera.orbit=0.5", *(["--dense-aovs", "--set", f"march.dense-samples={dense}"] if dense else [])):
        return None
    sparse(folder, work, size, frames, *(["--channels", "dense.*=keep"] if dense else []))
    return folder


def fill(folder, way, words, frames, source="sparse", told=False):
    """Fills these frames anew: seconds a frame, and the most memory."""
    target = folder / re.sub(r"\W+", "-", way)
    shutil.rmtree(target, ignore_errors=True)
    used = lacuna("fill", name(folder, source), "-o", f"{target}/", "--create-dir", "--frames", span(frames), *([] if told else ["--no-estimate"]), "--channels", "A=keep", *words)
    return target.name, used[0] / len(frames), used[1]


def planes(path, names="RGB"):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        return np.stack([channels[one].pixels.astype(np.float64) for one in names], axis=-1)


def colour(path):
    return np.clip(planes(path), 0, 1)


def psnr(error):
    return -10 * np.log10(max(np.mean(error**2), 1e-12))


class Measures:
    """PSNR of each frame, flicker and the true change of the frames that were filled in one way."""

    def __init__(self, folder, kind, frames, source="sparse"):
        truth = [colour(name(folder, "full", frame)) for frame in frames]
        found = [colour(name(folder, kind, frame)) for frame in frames]
        missing = [planes(name(folder, source, frame), ["mask"])[..., 0] < 0.5 for frame in frames]
        errors = [a - b for a, b in zip(found, truth)]
        self.each = [psnr(error) for error in errors]
        self.mean = float(np.mean(self.each))
        pairs = [missing[k] | missing[k + 1] for k in range(len(errors) - 1)]
        change = lambda images: np.sqrt(np.mean([np.mean((images[k + 1] - images[k])[pair] ** 2) for k, pair in enumerate(pairs)]))
        self.flicker, self.change = (float(change(images)) if pairs else 0.0 for images in (errors, truth))


def along(folder, kind, frames):
    """Flicker along the motion and the change of the reference, by `lacuna compare`."""
    report = folder / "along.json"
    report.unlink(missing_ok=True)
    lacuna("compare", name(folder, "full"), name(folder, kind), "--frames", span(frames), "--measures", "flicker-along", "--json", report)
    groups = [group for frame in json.loads(report.read_text())["frames"] for group in frame["groups"] if group["channels"] == ["R", "G", "B"]]
    missing = [region["measures"] for group in groups for region in group["regions"] if region["region"] == "missing"]
    values = lambda measure: [measures[measure] for measures in missing if measure in measures]
    return [float(np.sqrt(np.mean(np.square(values(measure))))) for measure in ("flicker-along", "change-along")]


def table(*head):
    print("\n| " + " | ".join(head) + " |\n|---|" + "---:|" * (len(head) - 1), flush=True)


def row(*cells):
    print("| " + " | ".join(cells) + " |", flush=True)


def turntables(work, scenes=(*SCENES, *OTHERS)):
    """Half a degree a frame, by depth and camera and by estimated motion."""
    table("turntable", *WAYS, *(f"flicker: {way}" for way in WAYS), "true change", *(f"along the motion: {way}" for way in WAYS), "true change")
    for scene in scenes:
        folder = turntable(work, scene)
        if folder:
            kinds = [fill(folder, way, ["--guides", "none", *words], INNER)[0] for way, words in WAYS.items()]
            found = [Measures(folder, kind, INNER) for kind in kinds]
            moving = [along(folder, kind, INNER) for kind in kinds]
            row(scene, *(f"{one.mean:.2f}" for one in found), *(f"{one.flicker:.4f}" for one in found), f"{found[0].change:.4f}",
                *(f"{one[0]:.4f}" for one in moving), f"{moving[0][1]:.4f}")


def dense(work, scenes=SCENES):
    """With dense AOVs of one sample a pixel and of the picture's: guides alone, time alone, both."""
    ways = {"guides alone": [], "time alone": ["--guides", "none", *ALONG], "both": ALONG}
    table("turntable with dense AOVs", "samples", *ways)
    for scene, samples in itertools.product(scenes, (1, SAMPLES)):
        folder = turntable(work, scene, dense=samples)
        if folder:
            found = [Measures(folder, fill(folder, way, words, INNER)[0], INNER) for way, words in ways.items()]
            row(scene, f"{samples}", *(f"{one.mean:.2f}" for one in found))


def rounds(work, scenes=("engine", "aneurism", "head", "tooth", "foot", "engine-soft")):
    """Complementary masks against pixels that are chosen in rounds, alone and along."""
    ways = {"alone": [], "along": [*ALONG, "--motion", "camera"]}
    kinds = ("complementary", "in rounds")
    table("turntable", "pixels", *(f"{kind}, {way}" for kind in kinds for way in ways), *(f"flicker: {kind}, {way}" for kind in kinds for way in ways))
    for scene in scenes:
        folder = turntable(work, scene)
        for density in (DENSITY, 0.05) if folder else ():
            found = []
            for chosen in (False, True):
                source = sparse(folder, work, SIZE, FRAMES, density=density, rounds=chosen)
                for way, words in ways.items():
                    kind, *_ = fill(folder, f"{source}-{way}", ["--guides", "none", *words], INNER, source)
                    found.append(Measures(folder, kind, INNER, source))
            row(scene, f"{100 * density:g} %", *(f"{one.mean:.2f}" for one in found), *(f"{one.flicker:.4f}" for one in found))


def lit(_, k):
    """A light that goes around the camera, 6 degrees a frame."""
    return ["--set", f"light=[{{direction=[{np.sin(0.105 * k):.6f}, 0.6, {np.cos(0.105 * k):.6f}]}}]"]


def opacity(scene, k):
    """The points of a scene with opacities that grow by 3 % a frame."""
    text = (ROOT / "samples" / "scenes" / f"{scene}.toml").read_text()
    points = re.findall(r"^\s*\[([^\]]*)\],?$", text.split("points")[1].split("[camera]")[0], re.M)
    points = [[float(value) for value in point.split(",") if value.strip()] for point in points]
    scaled = [[*point[:4], min(1.0, point[4] * 1.03**k)] for point in points]
    return ["--set", f"transfer.points={scaled}"]


def still(work):
    """Names and folders of sequences whose camera stands still."""
    for scene in SCENES:
        for what, words in (("light", lit), ("opacity", opacity)):
            folder = work / f"{scene}-{what}-{SIZE}"
            if all(render(folder, scene, [k, k], SIZE, *words(scene, k)) for k in FRAMES):
                sparse(folder, work, SIZE, FRAMES)
                yield f"{scene}, {what}", folder


def light(work):
    """The camera stands still; the light or the transfer function moves."""
    ways = {"alone": [], "along": ALONG, "along, no motion": [*ALONG, "--motion", "none"]}
    table("locked camera", *ways, "least gain of a frame", "true change")
    for label, folder in still(work):
        found = [Measures(folder, fill(folder, way, ["--guides", "none", *words], INNER)[0], INNER) for way, words in ways.items()]
        least = min(b - a for a, b in zip(found[0].each, found[1].each))
        row(label, *(f"{one.mean:.2f}" for one in found), f"{least:+.2f}", f"{found[0].change:.4f}")


def estimates(work, scenes=("engine", "aneurism", "head", "tooth", "foot", "engine-soft"), frame=5):
    """What is told of a frame along with its neighbours, against the truth: PSNR of missing pixels, peak 1, not clipped."""
    camera, flow = ("--motion", "camera"), ("--motion", "flow")
    cases = []
    for scene in scenes:
        folder = turntable(work, scene)
        for density, chosen in itertools.product((DENSITY, 0.05), (False, True)) if folder else ():
            cases.append((scene, folder, sparse(folder, work, SIZE, FRAMES, density=density, rounds=chosen), camera))
        if folder and scene in SCENES:
            cases.append((f"{scene}, flow", folder, "sparse", flow))
    cases += [(label, folder, "sparse", camera) for label, folder in still(work)]
    table("frame", "pixels", "true", "told", "low", "high", "held")
    for label, folder, source, motion in cases:
        report = folder / "told.json"
        kind, *_ = fill(folder, f"{source}-told", ["--guides", "none", *ALONG, *motion, "--json", report], [frame], source, told=True)
        [told] = [one["psnr"] for one in json.loads(report.read_text())["frames"][0]["estimates"] if "R" in one["channels"]]
        missing = planes(name(folder, source, frame), ["mask"])[..., 0] < 0.5
        true = psnr((planes(name(folder, kind, frame)) - planes(name(folder, "full", frame)))[missing])
        low, high = told.get("low", float("nan")), told.get("high", float("nan"))
        row(label, source, *(f"{value:.1f}" for value in (true, told["estimate"], low, high)), "yes" if low <= true <= high else "no")


def cut(work):
    """Two turntables, one after the other: the least gain of any frame."""
    motions = ("auto", "camera", "flow", "none")
    table("cut after frame 4", *(f"least gain, {motion}" for motion in motions))
    for first, second in (("engine", "head"), ("head", "tooth"), ("tooth", "aneurism"), ("engine", "engine-soft")):
        parts = [turntable(work, first), turntable(work, second)]
        if not all(parts):
            continue
        folder = work / f"cut-{first}-{second}"
        for kind in ("full", "sparse"):
            (folder / kind).mkdir(parents=True, exist_ok=True)
            for frame in FRAMES:
                shutil.copyfile(name(parts[frame > 4], kind, frame), name(folder, kind, frame))
        alone = Measures(folder, fill(folder, "alone", ["--guides", "none"], FRAMES)[0], FRAMES)
        cells = []
        for motion in motions:
            along = Measures(folder, fill(folder, motion, ["--guides", "none", *ALONG, "--motion", motion], FRAMES)[0], FRAMES)
            gains = [b - a for a, b in zip(alone.each, along.each)]
            cells.append(f"{min(gains):+.2f} (frame {1 + int(np.argmin(gains))})")
        row(f"{first}, {second}", *cells)


def moving(work, spp=512):
    """Things that move, by Mitsuba, with vectors of the renderer and without."""
    folder, frames = work / "moving", range(1, 9)
    for kind in ("rendered", "full", "sparse"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    wanted = [frame for frame in frames if not name(folder, "rendered", frame).exists()]
    if wanted:
        subprocess.run([sys.executable, ROOT / "scripts" / "renderers" / "mitsuba_sparse.py", ROOT / "samples" / "renderers" / "moving.xml",
                        "-o", str(name(folder, "rendered")), "--frames", ",".join(map(str, wanted)), "--density", "1", "--spp", str(spp), "--motion"], check=True)
    if not name(folder, "sparse", frames[-1]).exists():
        # The bridge writes its mask, of all pixels, which a sparse frame does not keep.
        lacuna("fill", name(folder, "rendered"), "-o", name(folder, "full"), "--frames", span(frames), "--drop-mask")
        height, width = planes(name(folder, "full", 1)).shape[:2]
        pattern = folder / "mask.####.png"
        lacuna("mask", "-o", pattern, "--size", f"{width}x{height}", "--density", DENSITY, "--frames", span(frames), "--temporal", "complementary")
        lacuna("sparsify", name(folder, "full"), "-o", name(folder, "sparse"), "--mask", pattern, "--frames", span(frames))
    ways = {"alone": [], "vectors": [*ALONG, "--motion", "vectors"], "flow": [*ALONG, "--motion", "flow"], "no motion": [*ALONG, "--motion", "none"]}
    found = [Measures(folder, fill(folder, way, ["--guides", "none", *words], frames)[0], frames) for way, words in ways.items()]
    table("frame", *ways)
    for k, frame in enumerate(frames):
        row(str(frame), *(f"{one.each[k]:.2f}" for one in found))
    row("mean", *(f"{one.mean:.2f}" for one in found))
    row("flicker", *(f"{one.flicker:.4f}" for one in found))


def content(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.exr"))}


def chunks(work):
    """One run over all frames, chunks of 1 and 3, and a run that is killed and taken up again with -u."""
    folder = turntable(work, "head")
    common = ["--guides", "none", "--no-estimate", *ALONG, "--create-dir"]
    run = lambda target, *words: lacuna("fill", name(folder, "sparse"), "-o", f"{target}/", *common, *words)
    for kind in ("chunks-9", "chunks-1", "chunks-3", "killed"):
        shutil.rmtree(folder / kind, ignore_errors=True)
    run(folder / "chunks-9", "--frames", "1-9", "--threads", 2)
    for size in (1, 3):
        for first in reversed(range(1, 10, size)):
            run(folder / f"chunks-{size}", "--frames", f"{first}-{first + size - 1}", "--threads", size % 2 + 1)
    kills = 0
    while True:
        words = [LACUNA, "fill", str(name(folder, "sparse")), "-o", f"{folder / 'killed'}/", *common, "--frames", "1-9", "-u", "-q"]
        process = subprocess.Popen(words)
        try:
            process.wait(timeout=4 + kills)
            break
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            kills += 1
    whole = content(folder / "chunks-9")
    table("frames 1 to 9 of head", "same bytes as one run")
    for kind in ("chunks-1", "chunks-3", "killed"):
        label = f"killed {kills} times, then -u" if kind == "killed" else f"chunks of {kind[-1]}, last first"
        row(label, "yes" if content(folder / kind) == whole else "NO")


def cost(work, size=1200, frames=range(1, 6)):
    """Processor seconds and memory of the middle one of five frames, with the other four."""
    table(f"{size} x {size}, the middle of 5 frames", "alone", "motion given", "ratio", "estimated", "ratio", "planes a frame of the window beyond alone")
    for scene in ("engine", "aneurism"):
        folder = turntable(work, scene, size, frames)
        if not folder:
            continue
        plane = 4 * size * size
        four = lambda way: ["2" if word == "auto" else word for word in WAYS[way]]
        one = {way: fill(folder, way, ["--guides", "none", *four(way)], [3]) for way in ("alone", "depth and camera", "flow")}
        seconds = {way: used[1] for way, used in one.items()}
        more = [(used[2] - one["alone"][2]) / plane / 5 for way, used in one.items() if way != "alone"]
        row(scene, f"{seconds['alone']:.1f} s", *(cell for way in ("depth and camera", "flow")
            for cell in (f"{seconds[way]:.1f} s", f"{seconds[way] / seconds['alone']:.1f}")), f"{more[0]:.1f}, {more[1]:.1f}")


TABLES = {one.__name__: one for one in (turntables, rounds, dense, light, estimates, cut, moving, chunks, cost)}


def main():
    if len(sys.argv) < 2 or not set(sys.argv[2:]) <= set(TABLES):
        raise SystemExit(f"scripts/temporal WORK [TABLE...], of {', '.join(TABLES)}")
    work = pathlib.Path(sys.argv[1]).absolute()
    for one in sys.argv[2:] or TABLES:
        TABLES[one](work)


if __name__ == "__main__":
    main()
