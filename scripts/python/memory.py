"""Peak memory of `lacuna fill` by filter and frame size, as a Markdown table. Called by scripts/memory."""

import pathlib
import re
import sys
import tempfile

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests"))

import frames  # noqa: E402
from tool import LACUNA, SAMPLES, lacuna, run  # noqa: E402

SIZES = [(600, 600), (1200, 1200), (1920, 1080)]


def filters():
    """What `--filter` takes."""
    said = lacuna("fill", "x.exr", "-o", "y.exr", "--filter", "?", ok=False).stderr
    return re.search(r"possible values: ([^]]+)\]", said).group(1).split(", ")


def peak(*words):
    """Bytes; nothing if the filter cannot do it alone. By GNU time: a child of this process would count what Python holds."""
    result = run(["/usr/bin/time", "-f", "%M", LACUNA, *words], timeout=1800)
    return int(result.lines()[-1]) * 1024 if result.status == 0 else None


def main():
    whole = frames.colour(SAMPLES / "smooth.exr").astype(np.float32)
    names = filters()
    print("Peak resident memory in MB (10^6 bytes) of `lacuna fill --threads 2`, R G B as floats, 20 % shuffle samples; in brackets")
    print("bytes a pixel of the frame, three channels together.\n")
    print(f"| size | {' | '.join(names)} |\n|---|{'---:|' * len(names)}")
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for width, height in SIZES:
            full = np.tile(whole, (height // 192 + 1, width // 192 + 1, 1))[:height, :width]
            frames.write_sparse(folder / "sparse.exr", full, frames.shuffle(height, width, 0.2))
            cells = []
            for name in names:
                words = ("fill", "-q", "--threads", "2", folder / "sparse.exr", "-o", folder / "out.exr", "--filter", name)
                found = peak(*words)
                cells.append(f"{found / 1e6:.0f} ({found / (width * height):.0f})" if found else "–")
            print(f"| {width}x{height} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
