"""Times a second build of lacuna beside the ordinary one and prints a Markdown table. Called by scripts/tarball."""

import pathlib
import statistics
import sys
import tempfile

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests"))

import frames  # noqa: E402
from tool import LACUNA, SAMPLES, run  # noqa: E402

TURNS = 15
SIZE = 768


def commands(folder):
    """A name and the words that follow lacuna; the first make what the others read."""
    whole = frames.colour(SAMPLES / "smooth.exr").astype(np.float32)
    full, sparse, filled, out = (folder / f"{name}.exr" for name in ("full", "sparse", "filled", "out"))
    tiled = np.tile(whole, (SIZE // whole.shape[0], SIZE // whole.shape[1], 1))
    frames.write(full, {name: tiled[..., k] for k, name in enumerate("RGB")})
    yield "sparsify", ("sparsify", full, "-o", sparse, "--density", "0.2")
    for name in ("ss", "tv", "edge", "cnn", "auto", "nearest", "pushpull", "linear"):
        estimate = () if name == "auto" else ("--no-estimate",)
        yield f"fill --filter {name}", ("fill", sparse, "-o", filled, "--filter", name, *estimate)
    yield "upscale --scale 2", ("upscale", full, "-o", out, "--scale", "2")
    yield "compare --measures flip", ("compare", full, sparse, "--measures", "flip")
    yield "verify", ("verify", sparse, filled)
    yield "mask", ("mask", "-o", folder / "mask.exr", "--size", "1920x1080", "--density", "0.2", "--pattern", "blue-noise")
    yield "render", ("render", SAMPLES / "scenes" / "head.toml", "-o", out)


def main():
    other = sys.argv[1]
    print(f"Seconds of processor, medians of {TURNS} runs that take turns.\n\n| command | ordinary | static | ratio |\n|---|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as name:
        for label, words in commands(pathlib.Path(name)):
            busy = {LACUNA: [], other: []}
            for _ in range(TURNS):
                for binary, seconds in busy.items():
                    result = run([binary, *words, "-q"])
                    assert result.status == 0, result
                    seconds.append(result.busy)
            ordinary, static = (statistics.median(seconds) for seconds in busy.values())
            print(f"| `{label}` | {ordinary:.3f} | {static:.3f} | {static / ordinary:.2f} |", flush=True)


if __name__ == "__main__":
    main()
