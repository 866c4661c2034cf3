"""The examples and the README's blocks run as they stand. Needs OpenImageIO, Mitsuba and matplotlib beside lacuna."""

import json
import pathlib
import re
import runpy
import sys

import numpy as np
import OpenImageIO as oiio
import pytest

HERE = pathlib.Path(__file__).parent
SAMPLES = HERE.parents[2] / "samples"


def program(monkeypatch, name, *arguments):
    monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
    runpy.run_path(str(HERE / name), run_name="__main__")


def test_buffers_of_openimageio(tmp_path, monkeypatch, capsys):
    program(monkeypatch, "openimageio_buffers.py", SAMPLES / "sequence" / "shot.0001.exr", tmp_path / "filled.exr")
    filled = oiio.ImageBuf(str(tmp_path / "filled.exr")).get_pixels(oiio.FLOAT)
    truth = oiio.ImageBuf(str(SAMPLES / "full" / "sequence" / "shot.0001.exr")).get_pixels(oiio.FLOAT)
    error = np.clip(filled[:, :, :3], 0, 1) - np.clip(truth[:, :, :3], 0, 1)
    assert -10 * np.log10(np.mean(error**2)) > 38 and " dB" in capsys.readouterr().out


def test_rounds_with_mitsuba(tmp_path, monkeypatch, capsys):
    program(monkeypatch, "mitsuba_rounds.py", tmp_path / "filled.exr")
    filled = oiio.ImageBuf(str(tmp_path / "filled.exr")).get_pixels(oiio.FLOAT)
    assert filled.shape == (64, 64, 3) and np.isfinite(filled).all() and filled.max() > 0.5
    assert capsys.readouterr().out.startswith("20% of the pixels")


def test_the_notebook(monkeypatch):
    import matplotlib

    matplotlib.use("Agg")
    monkeypatch.chdir(HERE)
    names = {}
    cells = json.loads((HERE / "fill.ipynb").read_text())["cells"]
    for cell in cells:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    assert names["psnr"] > 30
    pictures = [output for cell in cells for output in cell.get("outputs", []) if "image/png" in output.get("data", {})]
    assert pictures and (HERE / "fill.ipynb").stat().st_size < 200_000


@pytest.mark.parametrize("page", ["README.md"])
def test_blocks_of_a_page(page):
    names = {}
    blocks = re.findall(r"```python\n(.*?)```", (HERE.parent / page).read_text(), re.DOTALL)
    assert len(blocks) > 3
    for block in blocks:
        exec(block, names)
