"""What Mitsuba's bridge renders: integrators, variants, names and numbers of samples."""

import numpy as np
import OpenEXR
import pytest

import frames
from test_bridges import BALL, MITSUBA, SMALL, ball, bridge, told

pytestmark = pytest.mark.usefixtures("renderer_scenes")


def test_usage_of_mitsuba_alone(tmp_path):
    out = [BALL, "-o", tmp_path / "x.exr", "--density", "0.5"]
    told(bridge(MITSUBA, *out, "-D", "width"), 2, "-D", "NAME=VALUE", "'width'")
    told(bridge(MITSUBA, *out, "--aovs", "depth,depth:depth"), 2, "--aovs: depth is given twice")
    told(bridge(MITSUBA, *out, *SMALL, "-D", "width=16"), 2, "-D: width is given twice")
    for count in ("0", "-3"):
        told(bridge(MITSUBA, *out, "--aovs", "N", "--dense-aovs", "--dense-spp", count), 2, f"--dense-spp {count}")
    told(bridge(MITSUBA, *out, "-D", "nothing=1"), 1, "nothing")


INSIDE = '<integrator type="path" name="img"/>'
# An integrator around others, and the channels beside colour, depth and normals.
AROUND = {
    "named": (INSIDE, ()),
    "unnamed": ('<integrator type="path"/>', ()),
    "two": (f'{INSIDE}<integrator type="direct" name="direct"/>', ("direct.R", "direct.G", "direct.B", "direct.A")),
    "nested": (f'<integrator type="aov" name="in"><string name="aovs" value="tint:albedo"/>{INSIDE}</integrator>',
               ("in.tint.R", "in.tint.G", "in.tint.B")),
    "none": ("", ()),
}


@pytest.mark.parametrize("density", ["0.4", "1"])
@pytest.mark.parametrize("alpha", [False, True])
@pytest.mark.parametrize("way", AROUND)
def test_integrators_around_others_give_colour_and_aovs(way, alpha, density, tmp_path):
    inside, more = AROUND[way]
    film = f'<string name="pixel_format" value="{"rgba" if alpha else "rgb"}"/>'
    scene = ball(tmp_path, "ball.xml", f'<integrator type="aov"><string name="aovs" value="dd:depth,nn:sh_normal"/>{inside}</integrator>', film)
    result = bridge(MITSUBA, scene, "-o", tmp_path / "f.exr", "--density", density, *SMALL, "--spp", "64")
    assert result.status == 0, result
    found = frames.read(tmp_path / "f.exr")[0]
    colour = "" if way == "none" else "RGBA" if alpha else "RGB"
    assert set(found) == {*colour, "dd.Z", "nn.X", "nn.Y", "nn.Z", *more, "mask"}
    mask = found["mask"] == 1
    middle = np.zeros_like(mask)
    middle[10:14, 14:18] = mask[10:14, 14:18]
    # A ball of radius 1, 4 away, grey under a white sky.
    assert np.abs(found["dd.Z"][middle] - 3).max() < 0.1 and (found["nn.Z"][middle] > 0.9).all()
    for name in colour:
        assert abs(found[name][middle].mean() - (1 if name == "A" else 0.5)) < 0.05, name
    for name in more:
        assert abs(found[name][middle].mean() - (1 if name == "direct.A" else 0.5)) < 0.05, name


@pytest.mark.parametrize("variant, integrator", [("scalar_rgb", ""), ("scalar_spectral", ""), ("llvm_ad_mono", ""), ("llvm_ad_mono_polarized", ""),
                                                 ("llvm_ad_rgb", '<integrator type="prb"></integrator>')])
def test_every_variant_and_integrators_in_python_keep_to_the_mask(variant, integrator, tmp_path):
    scene = ball(tmp_path, "ball.xml", integrator)
    words = ("--density", "0.3", *SMALL, "--spp", "64", "--aovs", "depth", "--variant", variant, "--halves")
    result = bridge(MITSUBA, scene, "-o", tmp_path / "f.exr", *words)
    assert result.status == 0, result
    found = frames.read(tmp_path / "f.exr")[0]
    colour = "Y" if "mono" in variant else "RGB"
    assert set(found) - {"A", "mask", "depth.Z"} == {f"{half}{name}" for half in ("", "half1.", "half2.") for name in colour}
    mask, (rows, columns) = found["mask"] == 1, np.indices((24, 32))
    distance = np.hypot(rows - 11.5, columns - 15.5)
    ball_seen, sky = mask & (distance < 9), mask & (distance > 13)
    assert ball_seen.sum() > 20 and sky.sum() > 50
    assert (found["depth.Z"][ball_seen] > 2).all() and not found["depth.Z"][sky | ~mask].any()
    # Grey under white, and each pixel at its place.
    assert np.abs(found[colour[0]][ball_seen] - 0.5).max() < 0.25 and np.abs(found[colour[-1]][sky] - 1).max() < 0.3


def test_what_mitsuba_cannot_render_sparsely_is_named(tmp_path):
    words = ["-o", tmp_path / "f.exr", "--density", "0.5", *SMALL]
    told(bridge(MITSUBA, ball(tmp_path, "p.xml", '<integrator type="ptracer"></integrator>'), *words), 1, "p.xml", "ParticleTracer", "at the lights", "path")
    bands = '<film type="specfilm"><spectrum name="one" value="450:0, 500:1, 550:0"/>'
    scene = ball(tmp_path, "s.xml", **{'<film type="hdrfilm">': bands})
    told(bridge(MITSUBA, scene, *words, "--variant", "llvm_ad_spectral"), 1, "s.xml", "SpecFilm", "bands", "hdrfilm")
    told(bridge(MITSUBA, BALL, *words, "--variant", "scalar_rgb", "--motion"), 1, "--motion", "scalar_rgb", "llvm")
    none = ball(tmp_path, "n.xml", '<integrator type="aov"><string name="aovs" value="dd:depth"/></integrator>')
    told(bridge(MITSUBA, none, *words, "--spp", "2", "--halves"), 1, "--halves", "path")
    assert not (tmp_path / "f.exr").exists()


def test_names_that_are_taken_are_refused(tmp_path):
    words = ["-o", tmp_path / "f.exr", "--density", "0.5", *SMALL, "--spp", "2"]
    inside = f'<integrator type="aov"><string name="aovs" value="tint:albedo,motion:depth"/>{INSIDE}</integrator>'
    scene = ball(tmp_path, "aov.xml", inside)
    for file, more, parts in [
        (BALL, ["--halves", "--aovs", "half1:albedo"], ["--aovs half1", "--halves has that name"]),
        (BALL, ["--aovs", "R:shape_index"], ["--aovs R", "the frame itself"]),
        (BALL, ["--aovs", "mask:shape_index"], ["--aovs mask"]),
        (BALL, ["--motion", "--aovs", "depth,motion:albedo"], ["--aovs motion", "--motion has"]),
        (scene, ["--aovs", "tint:uv"], ["--aovs tint", scene, "name:uv"]),
        (scene, ["--motion"], [scene, "its AOV motion"]),
    ]:
        told(bridge(MITSUBA, file, *words, *more), 1, *parts)
    assert not (tmp_path / "f.exr").exists()
    result = bridge(MITSUBA, scene, *words, "--aovs", "half1:albedo")
    assert result.status == 0, result
    assert {"tint.R", "half1.R", "motion.Z"} < set(frames.read(tmp_path / "f.exr")[0])


@pytest.mark.parametrize("sampler, halves, took", [("independent", False, 10), ("multijitter", False, 12), ("stratified", False, 16), ("multijitter", True, 12)])
def test_samples_are_told_that_were_taken(sampler, halves, took, tmp_path):
    """Samplers of strata round them up: 10 to 12 or 16, and two halves of 5 to 6 each."""
    scene = ball(tmp_path, "ball.xml", **{"independent": sampler})
    result = bridge(MITSUBA, scene, "-o", tmp_path / "f.exr", "--density", "0.5", *SMALL, "--spp", "10", *(["--halves"] if halves else []))
    assert result.status == 0, result
    header = OpenEXR.File(str(tmp_path / "f.exr"), separate_channels=True).header()
    assert f", {took} samples a pixel" in header["renderer"]
    sky = frames.read(tmp_path / "f.exr")[0]["G"][0, :4]
    assert np.allclose(sky[sky > 0], sky.max()), "the mean is over as many"
