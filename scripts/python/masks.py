"""What the patterns and the second pass are worth, as Markdown tables, and pictures of masks. Called by scripts/masks."""

import hashlib
import json
import pathlib
import sys
import tempfile

import numpy as np
from PIL import Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests"))

import frames  # noqa: E402
from tool import DATA, LACUNA, ROOT, SAMPLES, lacuna  # noqa: E402

FRAMES = ["engine", "engine-soft", "tooth", "head", "aneurism-iso"]
DENSITIES = [0.05, 0.1, 0.2, 0.3, 0.5]
PATTERNS = ["random", "shuffle", "poisson", "blue-noise", "grid"]
# Frames that had no part in the choice of the estimate: scenes of samples/scenes, and pictures of samples.
SCENES = ["foot", "chest", "head", "vessels", "marschner-lobb"]
PICTURES = ["smooth", "edges", "full/sequence/shot.0001"]
VOLUMES = DATA / "volumes"
IMAGES = ROOT / "docs" / "images"


class Store:
    """Results of this binary by name, on disk; and the frames that were rendered for them."""

    def __init__(self):
        binary = hashlib.sha256(pathlib.Path(LACUNA).read_bytes()).hexdigest()[:16]
        self.folder = ROOT / "target" / "masks" / binary
        self.folder.mkdir(parents=True, exist_ok=True)
        self.file = self.folder / "results.json"
        self.known = json.loads(self.file.read_text()) if self.file.exists() else {}

    def get(self, name, measure):
        if name not in self.known:
            self.known[name] = measure()
            fresh = self.file.with_suffix(".new")
            fresh.write_text(json.dumps(self.known, indent=1))
            fresh.replace(self.file)
        return self.known[name]


STORE = Store()


def reference(name):
    """A complete frame by its name: of the data, of the samples, or rendered from a scene."""
    if name in FRAMES:
        return DATA / "frames" / f"{name}.exr"
    if name in PICTURES:
        return SAMPLES / f"{name}.exr"
    path = STORE.folder / f"{name.split()[0]}.exr"
    if not path.exists():
        scene = SAMPLES / "scenes" / f"{name.split()[0]}.toml"
        volume = VOLUMES / f"{scene.stem}.nrrd"
        lacuna("render", "-q", scene, *(["--volume", volume] if volume.exists() else []), "-o", path, timeout=1200)
    return path


def size(path):
    height, width, _ = frames.colour(path).shape
    return f"{width}x{height}"


def worth(full, sparse, folder):
    """PSNR of the fill of a sparse frame by ss."""
    out = folder / "out.exr"
    lacuna("fill", "-q", sparse, "-o", out, "--filter", "ss", timeout=1200)
    return frames.psnr(frames.colour(out), frames.colour(full))


def by_pattern(name, pattern, density, seed=0):
    """PSNR and true density of a pattern on a frame."""

    def measure():
        full = reference(name)
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            mask, sparse = folder / "mask.exr", folder / "sparse.exr"
            lacuna("mask", "-q", "-o", mask, "--size", size(full), "--density", density, "--pattern", pattern,
                   "--seed", seed)
            lacuna("sparsify", "-q", full, "-o", sparse, "--mask", mask)
            share = float(frames.read(mask)[0]["mask"].mean())
            return [worth(full, sparse, folder) if share < 1 else None, share]

    return STORE.get(f"{name} {pattern} {density} {seed}", measure)


def table(head, rows):
    print(f"| {' | '.join(head)} |\n|---|{'---:|' * (len(head) - 1)}")
    for row in rows:
        print(f"| {' | '.join(row)} |", flush=True)
    print()


def quality():
    def cell(value, best):
        if value is None:
            return "exact"
        return f"**{value:.2f}**" if value == best else f"{value:.2f}"

    def row(name, density):
        values = [by_pattern(name, pattern, density)[0] for pattern in PATTERNS]
        best = max(values[:-1])
        return [name, f"{100 * density:g} %", *(cell(value, best) for value in values)]

    shares = [by_pattern("engine", "grid", density)[1] for density in DENSITIES]
    print("grid has", ", ".join(f"{100 * share:.2f} %" for share in shares), "\n")
    table(["frame", "density", *PATTERNS], (row(name, density) for name in FRAMES for density in DENSITIES))
    equal = [[by_pattern(name, pattern, 0.25)[0] for name in FRAMES] for pattern in ("shuffle", "grid")]
    table(["25 %", *FRAMES], ([name, *(f"{value:.2f}" for value in row)] for name, row in zip(("shuffle", "grid"), equal)))


def seeds(count=8):
    def row(seed):
        values = [by_pattern("engine", pattern, 0.2, seed)[0] for pattern in PATTERNS[:-1]]
        return [str(seed), *(f"{value:.2f}" for value in values), f"{min(values[1:]) - values[0]:+.2f}"]

    table(["seed", *PATTERNS[:-1], "least gain over random"], (row(seed) for seed in range(count)))


def in_two_passes(name, seed):
    """PSNR of 20 % at once, and of 15 % with 5 % from the second pass."""

    def measure():
        full = reference(name)
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            first, second, filled, both, mask = (folder / f"{k}.exr" for k in ("first", "second", "filled", "both", "mask"))
            lacuna("mask", "-q", "-o", mask, "--size", size(full), "--density", 0.15, "--seed", seed)
            lacuna("sparsify", "-q", full, "-o", first, "--mask", mask)
            lacuna("fill", "-q", first, "-o", filled, "--filter", "ss", timeout=1200)
            lacuna("mask", "-q", "--after", filled, "-o", mask, "--add", 0.05, "--seed", seed, timeout=1200)
            lacuna("sparsify", "-q", full, "-o", second, "--mask", mask)
            lacuna("mask", "-q", "--merge", first, second, "-o", both)
            return worth(full, both, folder)

    return by_pattern(name, "shuffle", 0.2, seed)[0], STORE.get(f"{name} two passes {seed}", measure)


def second_pass():
    def row(name, seed):
        once, twice = in_two_passes(name, seed)
        return [name, str(seed), f"{once:.2f}", f"{twice:.2f}", f"{twice - once:+.2f}"]

    head = ["frame", "seed", "20 % at once", "15 % + 5 %", "gain"]
    table(head, (row(name, seed) for name in FRAMES for seed in (0, 1)))
    others = [f"{name} (rendered)" for name in SCENES] + PICTURES
    table(head, (row(name, 0) for name in others))


def figures():
    """How the masks lie: 20 % of 1200x1200."""

    def row(pattern):
        with tempfile.TemporaryDirectory() as folder:
            mask = pathlib.Path(folder) / "mask.png"
            lacuna("mask", "-q", "-o", mask, "--size", "1200x1200", "--density", 0.2, "--pattern", pattern)
            found = json.loads(lacuna("analyze", mask, "--json").stdout)
        near = found["nearest"]
        return [pattern, f"{100 * found['density']:.3f} %", f"{found['star_discrepancy']:.4f}", f"{near['minimum']:.2f}",
                f"{near['mean']:.2f}", f"{near['standard_deviation']:.2f}", f"{found['largest_hole']:.2f}",
                f"{found['fourier_coherence']:.3f}"]

    table(["pattern", "density", "star discrepancy", "nearest: least", "mean", "deviation", "largest hole",
           "Fourier coherence"], map(row, PATTERNS))


def coherence():
    """Figure 3.1 of the thesis: each cell is that of low-discrepancy (shuffle) and of random masks."""
    densities = [0.1, 0.2, 0.3, 0.5, 0.7, 0.9]

    def measure():
        words = ("--densities", ",".join(map(str, densities)), "--json")
        return json.loads(lacuna("analyze", "--coherence", *words, timeout=7200).stdout)["coherence"]

    found = {(line["basis"], line["sigma"], line["pattern"]): dict(map(tuple, line["values"]))
             for line in STORE.get("coherence", measure)}

    def row(basis, sigma):
        patterns = [found[basis, sigma, pattern] for pattern in ("shuffle", "random")]
        cells = (" / ".join(f"{values[density]:.3f}" if density in values else "-" for values in patterns)
                 for density in densities)
        return [basis, "-" if sigma is None else f"{sigma:g}", *cells]

    kinds = dict.fromkeys((basis, sigma) for basis, sigma, _ in found)
    table(["basis", "blur", *(f"{100 * density:g} %" for density in densities)], (row(*kind) for kind in kinds))


def speed():
    """Processor time and memory of large masks at 20 %."""

    def measure(pattern, side, form):
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder) / ("rank.exr" if form == "rank" else f"mask.{form}")
            words = ["--rank"] if form == "rank" else ["--density", 0.2]
            size = f"{side}x{side}"
            done = lacuna("mask", "-q", "-o", out, "--size", size, "--pattern", pattern, "--threads", 1, *words,
                          timeout=3600)
            return [done.busy, done.peak_bytes / 2**20, out.stat().st_size / 2**20]

    def row(pattern, side, form):
        busy, memory, size = STORE.get(f"{pattern} {side} {form}", lambda: measure(pattern, side, form))
        return [pattern, f"{side}^2", form, f"{busy:.1f} s", f"{memory:.0f} MiB", f"{size:.1f} MiB"]

    plain = [(pattern, 16384, "exr") for pattern in PATTERNS]
    others = [("shuffle", 16384, form) for form in ("png", "rank", "json", "txt")]
    cases = [("shuffle", 8192, "exr"), ("shuffle", 8192, "png"), *plain, *others]
    table(["pattern", "size", "form", "processor time", "memory", "file"], (row(*case) for case in cases))


def pictures():
    patterns_and_spectra()
    two_passes()
    rounds()


def save(name, image):
    """An array of 0 to 1 as a PNG of few colours."""
    picture = Image.fromarray((np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8))
    picture.quantize(16 if image.ndim == 2 else 128).save(IMAGES / name, optimize=True)


def enlarged(image, scale):
    return np.repeat(np.repeat(image, scale, axis=0), scale, axis=1)


def flags(path):
    return np.asarray(Image.open(path), dtype=float)


def patterns_and_spectra(side=64, scale=3, whole=256):
    """Masks of 20 % over their power spectra, one pattern beside the other; and the plots of the radial averages."""
    tiles = []
    for pattern in PATTERNS:
        with tempfile.TemporaryDirectory() as folder:
            mask = pathlib.Path(folder) / "mask.png"
            words = ("-o", mask, "--density", 0.2, "--pattern", pattern)
            lacuna("mask", "-q", *words, "--size", "1200x1200")
            lacuna("analyze", mask, "-o", IMAGES / f"spectrum-{pattern}.png")
            lacuna("mask", "-q", *words, "--size", f"{whole}x{whole}")
            taken = flags(mask)
        density = taken.mean()
        power = np.abs(np.fft.fftshift(np.fft.fft2(taken - density))) ** 2 / (taken.size * density * (1 - density))
        # White noise has power 1: mid grey.
        shade = Image.fromarray((255 * np.clip(power / 2, 0, 1)).astype(np.uint8))
        spectrum = np.asarray(shade.resize((side * scale,) * 2, Image.Resampling.BOX)) / 255
        tiles.append(np.vstack([enlarged(taken[:side, :side], scale), np.full((4, side * scale), 0.5), spectrum]))
    gap = np.full((tiles[0].shape[0], 4), 0.5)
    save("masks.png", np.hstack([part for tile in tiles for part in (tile, gap)][:-1]))


def two_passes():
    """A sample filled after its first pass, the estimated error (times four), and both passes, the second in red."""
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        first, sparse, filled, error, next_pass = (folder / name for name in ("m.png", "s.exr", "f.exr", "e.png", "n.png"))
        full = SAMPLES / "full" / "sequence" / "shot.0001.exr"
        lacuna("mask", "-q", "-o", first, "--size", size(full), "--density", 0.15)
        lacuna("sparsify", "-q", full, "-o", sparse, "--mask", first)
        lacuna("fill", "-q", sparse, "-o", filled)
        lacuna("mask", "-q", "--after", filled, "-o", next_pass, "--add", 0.05, "--error-estimate", error)
        one, two = flags(first), flags(next_pass)
        shade = np.clip(4 * flags(error) / 65535, 0, 1)
        colour = np.clip(frames.colour(filled), 0, 1) ** (1 / 2.2)
    views = [colour, np.stack([shade] * 3, axis=-1), np.stack([np.maximum(one, two), one, one], axis=-1)]
    save("second-pass.png", enlarged(np.hstack(views), 2))


# Rounds that are shown, of as many as `--adaptive` takes.
SHOWN, ROUNDS = (1, 3, 5, 8), 8


def rounds(density=0.1, side=200, crop=(20, 180)):
    """A scene after some of its rounds: all pixels so far, the last round's in red; filled; its error, four times."""
    first = density / 5
    views = []
    with tempfile.TemporaryDirectory() as folder:
        sparse, filled, whole = (pathlib.Path(folder) / f"{name}.exr" for name in ("sparse", "filled", "whole"))
        scene = ("render", "-q", ROOT / "samples/scenes/vessels.toml", "--size", f"{side}x{side}", "-o")
        lacuna(*scene, whole)
        truth = frames.colour(whole)

        def taken(count):
            # All rounds but the first have as many pixels: fewer of them are the first ones of all.
            spent = first + (density - first) * (count - 1) / (ROUNDS - 1)
            words = ("--density", f"{spent:.6f}", "--adaptive", "--rounds", count, "--first", first, "--force")
            lacuna(*scene, sparse, *words)
            lacuna(*scene, filled, *words, "--fill", "ss")
            return frames.colour(sparse, ["mask"])[..., 0] > 0

        for count in SHOWN:
            before = taken(count - 1) if count > 1 else np.zeros((side, side), bool)
            now = taken(count)
            error = np.abs(frames.colour(filled) - truth).max(axis=-1)
            psnr = -10 * np.log10(((frames.colour(filled) - truth) ** 2).mean())
            print(f"after round {count}: {100 * now.mean():.1f} % of the pixels, {psnr:.1f} dB")
            old = now & before
            picture = np.clip(frames.colour(filled), 0, 1) ** (1 / 2.2)
            column = [np.stack([now, old, old], axis=-1), picture, np.stack([np.clip(4 * error, 0, 1)] * 3, axis=-1)]
            views.append(np.vstack([part[slice(*crop), slice(*crop)] for part in column]))
    save("rounds.png", np.hstack(views))


TASKS = {"quality": quality, "seeds": seeds, "second-pass": second_pass, "figures": figures, "coherence": coherence,
         "speed": speed, "pictures": pictures, "rounds": rounds}


def main():
    words = sys.argv[1:]
    if len(words) != 1 or words[0] not in TASKS:
        sys.exit(f"usage: scripts/masks {'|'.join(TASKS)}")
    TASKS[words[0]]()


if __name__ == "__main__":
    main()
