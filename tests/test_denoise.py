"""scripts/renderers/denoise.py with a denoiser of our own in place of pyoidn: what is packed, denoised, put back and filled."""

import sys

import numpy as np
import OpenEXR
import pytest

import frames
import header
from tool import LACUNA, ROOT, run

SCRIPT = ROOT / "scripts" / "renderers" / "denoise.py"
# Doubles, and keeps what it was given.
DENOISER = """
import os, numpy
def denoise(colour, hdr, **guides):
    numpy.savez(os.environ["GIVEN"], colour=colour, hdr=hdr, **guides)
    return 2 * colour
"""


@pytest.fixture
def denoise(tmp_path):
    (tmp_path / "pyoidn.py").write_text(DENOISER)
    given = tmp_path / "given.npz"
    environment = {"PYTHONPATH": str(tmp_path), "GIVEN": str(given), "LACUNA": LACUNA}

    def call(source, *words):
        output = tmp_path / "out.exr"
        result = run([sys.executable, SCRIPT, source, "-o", output, *words], environment=environment)
        return result, output, dict(np.load(given)) if given.exists() else {}

    return call


def scene(height=24, width=36):
    """Colour, halves and guides of every pixel."""
    ramp = np.arange(height * width, dtype=np.float32).reshape(height, width) / 1000 + np.float32(0.1)
    planes = {name: ramp + np.float32(k) for k, name in enumerate("RGB")}
    planes |= {f"half{half}.{name}": planes[name] for half in (1, 2) for name in "RGB"}
    planes |= {f"albedo.{name}": 3 * ramp for name in "RGB"}
    return planes | {f"N.{name}": -ramp for name in "XYZ"}


def test_a_grid_is_packed_denoised_put_back_and_filled(tmp_path, denoise):
    planes = scene()
    mask = np.zeros(planes["R"].shape, bool)
    mask[1::2, ::3] = True
    source = frames.write(tmp_path / "in.exr", planes | {"mask": mask.astype(np.float32)})
    result, output, given = denoise(source, "--", "--filter", "nearest", "--no-estimate")
    assert result.status == 0, result
    assert given["hdr"] and given["colour"].shape == (12, 12, 3)
    assert np.array_equal(given["colour"][..., 1], planes["G"][1::2, ::3])
    assert np.array_equal(given["albedo"][..., 0], np.clip(planes["albedo.R"][1::2, ::3], 0, 1))
    assert np.array_equal(given["normal"][..., 2], planes["N.Z"][1::2, ::3])
    [filled] = frames.read(output)
    assert not [name for name in filled if name.startswith("half")]
    for name in "RGB":
        assert np.array_equal(filled[name][mask], 2 * planes[name][mask])
    # The filter that was asked for: every pixel has the value of some measured one.
    assert np.isin(filled["R"], 2 * planes["R"][mask]).all()


def test_a_complete_frame_is_denoised_as_it_is(tmp_path, denoise):
    planes = {name: plane for name, plane in scene().items() if not name.startswith(("albedo", "half"))}
    source = frames.write(tmp_path / "in.exr", planes | {"mask": np.ones(planes["R"].shape, np.float32)})
    result, output, given = denoise(source)
    assert result.status == 0, result
    # A normal alone is no guide that the library takes.
    assert set(given) == {"colour", "hdr"}
    [out] = frames.read(output)
    assert np.array_equal(out["B"], 2 * planes["B"])


@pytest.mark.parametrize("step", [1, 2])
def test_what_is_not_denoised_passes_through(tmp_path, denoise, step):
    """Other parts, attributes, compression and the types of channels."""
    planes = {name: plane.astype(np.float16) for name, plane in scene().items() if not name.startswith("half")}
    planes["R"][0, 0] = np.finfo(np.float16).max
    mask = np.zeros(planes["R"].shape, np.float16)
    mask[::step, ::step] = 1
    planes |= {"mask": mask, "id": np.arange(mask.size, dtype=np.uint32).reshape(mask.shape), "Z": planes["R"].astype(np.float32)}
    matrix = np.arange(16, dtype=np.float32).reshape(4, 4)
    marks = {"lacuna/dense": "id,Z", "comment": "of the renderer", "worldToCamera": matrix, "compression": OpenEXR.PIZ_COMPRESSION}
    parts = [frames.part(planes, (3, -2), ((0, 0), (49, 69)), name="beauty", **marks), frames.part({"x": planes["G"]}, (3, -2), ((0, 0), (49, 69)), name="more")]
    source = frames.write(tmp_path / "in.exr", parts)
    result, output, _ = denoise(source, *(["--", "--filter", "nearest", "--no-estimate"] if step > 1 else []))
    assert result.status == 0, result
    for before, after in zip(header.read(source)[0], header.read(output)[0], strict=True):
        assert {name: after.attributes.get(name) for name in before.attributes} == before.attributes
    before, after = frames.read(source), frames.read(output)
    assert set(before[0]) == set(after[0]) and all(before[0][name].dtype == after[0][name].dtype for name in before[0])
    assert all(frames.same_bits(before[0][name], after[0][name]) for name in ("id", "Z"))
    assert frames.same_bits(before[1]["x"][mask > 0], after[1]["x"][mask > 0])
    assert np.isfinite(after[0]["R"]).all() and np.array_equal(after[0]["G"][mask > 0], 2 * planes["G"][mask > 0])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda planes, mask: mask.__setitem__((1, 1), True), "are no grid"),
        (lambda planes, mask: planes.pop("G"), "no channels R, G and B"),
        (lambda planes, mask: planes["R"].__setitem__((0, 0), np.nan), "not finite at a measured pixel"),
    ],
)
def test_what_cannot_be_denoised_is_refused(tmp_path, denoise, change, words):
    planes = {name: plane.copy() for name, plane in scene().items()}
    mask = np.zeros(planes["R"].shape, bool)
    mask[::2, ::2] = True
    change(planes, mask)
    source = frames.write(tmp_path / "in.exr", planes | {"mask": mask.astype(np.float32)})
    result, output, _ = denoise(source)
    assert result.status != 0 and words in result.stderr and len(result.lines()) == 1, result
    assert not output.exists()
