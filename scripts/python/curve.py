"""PSNR against missing pixels, as CSV lines while it runs and as Markdown tables at its end. Called by scripts/curve.

Every method fills the same masks of `lacuna mask`. cs-gradient has masks of its own: as dense, but of pairs (`--paired`); its row
"restored" is what it recovers at measured pixels, too (`--csg-restore`), its rows "rendered" take the layers dx and dy that
`lacuna render --gradients` writes for the scene, at the mask's pixels, and are compared with that render.
"""

import argparse
import pathlib
import sys
import tempfile

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

import frames  # noqa: E402
from tool import DATA, lacuna  # noqa: E402

PLAIN = {
    **{name: [name] for name in ("ss", "tv", "pushpull", "nearest", "linear", "cubic", "cs-wavelet")},
    "cs-wavelet, literal inverse": ["cs-wavelet", "--csw-wiener", "0"],
}
PAIRED, RENDERED = "cs-gradient, pairs", "cs-gradient, rendered"
METHODS = [*PLAIN, PAIRED, RENDERED]
# frame: scene, volume
SCENES = {"engine": ("engine", "engine"), "engine-soft": ("engine-soft", "engine"), "tooth": ("tooth", "tooth"),
          "head": ("cthead", "cthead"), "aneurism-iso": ("aneurism", "aneurism")}


def mask(folder, size, pattern, missing, paired=False):
    path = folder / f"{pattern}-{missing}-{paired}.exr"
    if not path.exists():
        words = ["--paired"] if paired else []
        density = 1 - missing / 100
        lacuna("mask", "-q", "-o", path, "--size", f"{size}x{size}", "--density", f"{density:.4f}", "--pattern", pattern, *words,
               timeout=600)
    return frames.colour(path, ["mask"])[..., 0] > 0.5


def rendered(folder, name, size, height, width):
    """The crop of the scene with its layers dx and dy; only the crop's pixels are rendered."""
    scene, volume = SCENES[name]
    inside = np.zeros((height, width), np.float16)
    top, left = (height - size) // 2, (width - size) // 2
    inside[top : top + size, left : left + size] = 1
    region, out = folder / "region.exr", folder / f"{name}.exr"
    frames.write(region, {"mask": inside})
    lacuna("render", "-q", ROOT / "samples" / "scenes" / f"{scene}.toml", "--volume", DATA / "volumes" / f"{volume}.nrrd", "-o", out,
           "--mask", region, "--gradients", timeout=3600)
    names = ["R", "G", "B", "dx.R", "dx.G", "dx.B", "dy.R", "dy.G", "dy.B"]
    return frames.colour(out, names)[top : top + size, left : left + size]


def fill(folder, planes, words):
    source, out = folder / "sparse.exr", folder / "filled.exr"
    frames.write(source, planes)
    lacuna("fill", "-q", source, "-o", out, "--filter", *words, timeout=3600)
    return frames.colour(out)


def planes_of(pixels, chosen, names="RGB"):
    sparse = np.where(chosen[..., None], pixels, 0).astype(np.float32)
    planes = {name: np.ascontiguousarray(sparse[..., k]) for k, name in enumerate(names)}
    return planes | {"mask": chosen.astype(np.float16)}


def measure(folder, full, gradients, pattern, missing, method):
    """Rows of the table and their PSNR."""
    chosen = mask(folder, len(full), pattern, missing, paired=method == PAIRED)
    if method in PLAIN:
        yield method, frames.psnr(fill(folder, planes_of(full, chosen), PLAIN[method]), full)
        return
    if method == PAIRED:
        reference, planes = full, planes_of(full, chosen)
    else:
        reference = gradients[..., :3]
        names = ["R", "G", "B", "dx.R", "dx.G", "dx.B", "dy.R", "dy.G", "dy.B"]
        planes = planes_of(gradients, chosen, names)
    restored = fill(folder, planes, ["cs-gradient", "--csg-restore"])
    yield method, frames.psnr(np.where(chosen[..., None], reference, restored), reference)
    yield f"{method}, restored", frames.psnr(restored, reference)


def literal(folder):
    """What the blur does to cs-wavelet: the objective that is reached and that of the complete render."""
    import json

    import sensing_reference as reference

    size, levels = 256, 4
    full = frames.colour(DATA / "frames" / "engine.exr", "G")
    top, left = (full.shape[0] - size) // 2, (full.shape[1] - size) // 2
    full = full[top : top + size, left : left + size]
    chosen = mask(folder, size, "shuffle", 50)
    source, out, report = folder / "sparse.exr", folder / "filled.exr", folder / "report.json"
    frames.write(source, planes_of(full, chosen, "Y"))
    cases = [("db4", 0, 0)] + [("db4", sigma, kappa) for kappa in (0, 1e-4) for sigma in (256, 128, 64, 20, 4.27)]
    cases += [(wavelet, 0, 0) for wavelet in ("haar", "db2", "db8", "sym8", "coif2", "cdf97")]
    print("| wavelet | sigma | kappa | PSNR | objective reached | of the complete render |\n|---|---:|---:|---:|---:|---:|")
    for wavelet, sigma, kappa in cases:
        words = ["--csw-wavelet", wavelet, "--csw-blur", sigma, "--csw-wiener", kappa, "--csw-tolerance", "1e-5", "--csw-iterations", 4000]
        lacuna("fill", "-q", source, "-o", out, "--filter", "cs-wavelet", "--limit", "off", *words, "--json", report, timeout=3600)
        blur = reference.gain(size, size, sigma, kappa) if sigma else 1.0
        blurred = np.fft.ifft2(np.fft.fft2(full[..., 0].astype(float)) * blur).real
        own = np.abs(reference.transform(blurred, wavelet, "periodic", levels)).sum()
        reached = json.loads(report.read_text())["frames"][0]["objective"]
        quality = frames.psnr(frames.colour(out, "Y"), full)
        print(f"| {wavelet} | {sigma or 'none'} | {kappa} | {quality:.2f} | {reached:.1f} | {own:.1f} |", flush=True)


def picture(folder, path):
    """Results and eight times their errors at 80 % missing: cs-wavelet, cs-gradient, ss; random, then shuffle."""
    from PIL import Image

    full = frames.colour(DATA / "frames" / "engine.exr")[400:800, 400:800]
    sheet = []
    for method in ("cs-wavelet", "cs-gradient", "ss"):
        row = []
        for pattern in ("random", "shuffle"):
            chosen = mask(folder, 400, pattern, 80, paired=method == "cs-gradient")
            filled = fill(folder, planes_of(full, chosen), [method])
            row += [np.clip(image[120:280, 120:280], 0, 1) for image in (filled, 8 * np.abs(filled - full))]
            power = np.abs(np.fft.fft2((filled - full)[..., 1])) ** 2
            high = np.hypot(np.fft.fftfreq(400)[:, None], np.fft.fftfreq(400)[None]) > 0.15
            strongest = np.sort(power[high])[::-1]
            share = strongest[: len(strongest) // 1000].sum() / strongest.sum()
            print(f"{method}, {pattern}: {frames.psnr(filled, full):.2f} dB; the strongest thousandth of the frequencies above 0.15 "
                  f"cycles per pixel holds {share:.2f} of the error's power there")
        sheet.append(np.concatenate(row, 1))
    Image.fromarray((np.concatenate(sheet) ** (1 / 2.2) * 255).astype(np.uint8)).save(path)


def tables(rows):
    """One table a frame: methods by pattern and share of missing pixels; the best of a column in bold."""
    for name in dict.fromkeys(row[0] for row in rows):
        found = {row[1:4]: row[4] for row in rows if row[0] == name}
        columns = [(pattern, m) for pattern in dict.fromkeys(key[0] for key in found) for m in sorted({key[1] for key in found})]
        best = {column: max(value for key, value in found.items() if key[:2] == column) for column in columns}
        print(f"\n| {name} | {' | '.join(f'{pattern} {m} %' for pattern, m in columns)} |\n|---|{'---:|' * len(columns)}")
        for method in dict.fromkeys(key[2] for key in found):
            cells = [found.get((*column, method)) for column in columns]
            words = ["" if cell is None else f"**{cell:.2f}**" if cell == best[column] else f"{cell:.2f}"
                     for cell, column in zip(cells, columns)]
            print(f"| {method} | {' | '.join(words)} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=600, help="side of the crop from the middle of each frame")
    parser.add_argument("--frames", default=",".join(SCENES))
    parser.add_argument("--missing", default="20,50,80,90")
    parser.add_argument("--patterns", default="random,shuffle")
    parser.add_argument("--methods", default=";".join(METHODS), help="separated by semicolons")
    parser.add_argument("--literal", action="store_true", help="print what the blur does to cs-wavelet instead")
    parser.add_argument("--picture", help="write the picture of docs/measurements/methods.md to this PNG instead")
    chosen = parser.parse_args()
    if chosen.literal:
        with tempfile.TemporaryDirectory() as folder:
            literal(pathlib.Path(folder))
        return
    if chosen.picture:
        with tempfile.TemporaryDirectory() as folder:
            picture(pathlib.Path(folder), chosen.picture)
        return
    methods, rows = chosen.methods.split(";"), []
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for name in chosen.frames.split(","):
            full = frames.colour(DATA / "frames" / f"{name}.exr")
            height, width = full.shape[:2]
            top, left, size = (height - chosen.size) // 2, (width - chosen.size) // 2, chosen.size
            gradients = rendered(folder, name, size, height, width) if RENDERED in methods else None
            full = full[top : top + size, left : left + size]
            for pattern in chosen.patterns.split(","):
                for missing in map(int, chosen.missing.split(",")):
                    for method in methods:
                        for row, quality in measure(folder, full, gradients, pattern, missing, method):
                            rows.append((name, pattern, missing, row, quality))
                            print(",".join(map(str, [name, pattern, missing, f'"{row}"', round(quality, 2)])), file=sys.stderr, flush=True)
    tables(rows)


if __name__ == "__main__":
    main()
