"""`lacuna compare` beside idiff and `oiiotool --flipdiff` on pairs of 1200x1200 frames: medians. Called by scripts/compare-speed."""

import os
import pathlib
import statistics
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests"))

from tool import DATA, LACUNA, OIIO_BIN, lacuna, run  # noqa: E402

FRAMES = ["engine", "engine-soft", "tooth", "head", "aneurism-iso"]


def pairs(folder, count):
    """References and filled frames; the first five are made, the others are links to them."""
    for number in range(count):
        reference, test = folder / f"r.{number:04}.exr", folder / f"t.{number:04}.exr"
        os.symlink(DATA / "frames" / f"{FRAMES[number % 5]}.exr", reference)
        if number < 5:
            lacuna("sparsify", "-q", reference, "-o", folder / "s.exr", "--density", "0.2", timeout=600)
            lacuna("fill", "-q", folder / "s.exr", "-o", test, timeout=600)
        else:
            os.symlink(folder / f"t.{number % 5:04}.exr", test)
        yield reference, test


def ours(folder, *words):
    result = run([LACUNA, "compare", "-q", folder / "r.####.exr", folder / "t.####.exr", *words], timeout=3600)
    assert result.status == 0, result
    return [(result.seconds, result.busy)]


def theirs(all_pairs, command):
    return [(result.seconds, result.busy) for result in (run(command(*pair), timeout=600) for pair in all_pairs)]


def median(what, repeats):
    """Median over the repeats of the sum over the pairs: seconds by the clock, seconds of processors."""
    sums = [[sum(column) for column in zip(*what())] for _ in range(repeats)]
    return [statistics.median(column) for column in zip(*sums)]


def main():
    count, repeats = (int(word) for word in (sys.argv[1:] + ["50", "3"][len(sys.argv) - 1:]))
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        all_pairs = list(pairs(folder, count))
        flip = lambda a, b: [OIIO_BIN / "oiiotool", a, "--ch", "R,G,B", b, "--ch", "R,G,B", "--flipdiff:hdr=0"]  # noqa: E731
        rows = [
            ("MSE, PSNR, SSIM, counts", lambda: ours(folder), "idiff", lambda: theirs(all_pairs, lambda a, b: [OIIO_BIN / "idiff", a, b])),
            ("the same and LDR-FLIP", lambda: ours(folder, "--measures", "flip"), "oiiotool --flipdiff:hdr=0", lambda: theirs(all_pairs, flip)),
        ]
        print(f"{count} pairs of 1200x1200, medians of {repeats}, load {os.getloadavg()[0]:.1f}; clock (processors) in seconds\n")
        print("| lacuna compare | | other | | ratio |\n|---|---:|---|---:|---:|")
        for words, own, name, other in rows:
            a, b = median(own, repeats), median(other, repeats)
            print(f"| {words} | {a[0]:.2f} ({a[1]:.2f}) | {name} | {b[0]:.2f} ({b[1]:.2f}) | {a[0] / b[0]:.2f} ({a[1] / b[1]:.2f}) |", flush=True)


if __name__ == "__main__":
    main()
