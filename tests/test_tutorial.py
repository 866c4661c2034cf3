"""The tutorial: every block runs as it stands, and comes to what the page says."""

import os
import pathlib
import re
import subprocess

import numpy as np

import frames
from tool import LACUNA, ROOT, SAMPLES


def test_the_blocks_run_as_they_stand(tmp_path):
    (tmp_path / "samples").symlink_to(SAMPLES)
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "lacuna").symlink_to(pathlib.Path(LACUNA).resolve())
    path = os.pathsep.join([str(tmp_path / "bin"), os.environ["PATH"]])
    text = (ROOT / "docs" / "tutorial.md").read_text()
    blocks = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == text.count("```") // 2 > 5
    for block in blocks:
        result = subprocess.run(["bash", "-euc", block], cwd=tmp_path, env=os.environ | {"PATH": path}, capture_output=True, text=True)
        assert result.returncode == 0, (block, result.stderr)
    out = tmp_path / "out"
    assert (out / "compare.html").stat().st_size > 10_000 and (out / "shot.html").exists()
    full, filled, adaptive = (frames.colour(out / f"{name}.exr") for name in ("full", "filled", "adaptive"))
    assert frames.psnr(filled, full) > 25 and frames.psnr(adaptive, full) > frames.psnr(filled, full)
    large = frames.read(out / "large.exr")[0]
    assert large["R"].shape == (360, 640) and np.isfinite(large["R"].astype(np.float32)).all()
    assert len(list((out / "shot").iterdir())) == 4 and not (out / "farm").exists()
