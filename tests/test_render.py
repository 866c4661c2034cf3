"""`lacuna render` beside VTK, and as a process that is interrupted and goes on."""

import json
import math
import os
import signal
import subprocess
import sys
import time

import numpy
import OpenEXR
import pytest

import frames
import tool
from tool import lacuna

# A volume whose voxels are no cubes and whose corner is not the origin, a camera that is not symmetric to it.
SPACING, ORIGIN = (1.0, 1.2, 0.9), (-5.0, 3.0, 7.0)
SCENE = {
    "size": [200, 200], "eye": [120.0, 95.0, 150.0], "target": [27.0, 41.0, 34.0], "up": [0.1, 1.0, 0.0],
    "angle": 26.0, "step": 0.45, "unit": 0.9, "spacing": SPACING, "origin": ORIGIN,
    "points": [[0, 0.1, 0.2, 0.9, 0.0], [6000, 0.2, 0.5, 0.9, 0.0], [20000, 0.9, 0.4, 0.1, 0.06],
               [40000, 1.0, 0.9, 0.5, 0.25], [65535, 1.0, 1.0, 1.0, 0.3]],
}


def blobs(n=64):
    """Smooth blobs of different sizes, 16 bits; z, y, x."""
    z, y, x = numpy.mgrid[:n, :n, :n] / (n - 1.0)
    values = numpy.zeros((n, n, n))
    for cx, cy, cz, radius, height in [(0.3, 0.35, 0.4, 0.13, 0.9), (0.68, 0.6, 0.3, 0.09, 0.7),
                                       (0.5, 0.72, 0.7, 0.16, 0.8), (0.8, 0.25, 0.75, 0.06, 1.0)]:
        values += height * numpy.exp(-((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) / (2 * radius ** 2))
    return (65535 * numpy.clip(values, 0, 1)).astype(numpy.uint16)


def nrrd(voxels, path, origin):
    header = ("NRRD0004\ntype: ushort\ndimension: 3\nsizes: 64 64 64\nendian: little\nencoding: raw\n"
              f"space dimension: 3\nspace directions: ({SPACING[0]},0,0) (0,{SPACING[1]},0) (0,0,{SPACING[2]})\n"
              f"space origin: ({','.join(map(str, origin))})\n\n")
    path.write_bytes(header.encode() + voxels.astype("<u2").tobytes())


def colours(path, names="RGB"):
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return numpy.stack([channels[name].pixels for name in names], axis=-1)


def ours(voxels, folder, origin=ORIGIN, unit=SCENE["unit"], narrower=1.0):
    """lacuna's opacities and steps are per shortest edge of a voxel: 0.9, VTK's are per world unit with a unit of opacity."""
    nrrd(voxels, folder / "blobs.nrrd", origin)
    angle = 2 * math.degrees(math.atan(math.tan(math.radians(SCENE["angle"] / 2)) * narrower))
    points = [[*point[:4], 1 - (1 - point[4]) ** (min(SPACING) / unit)] for point in SCENE["points"]]
    (folder / "blobs.toml").write_text(f"""
volume = "blobs.nrrd"
[transfer]
data-units = true
points = {json.dumps(points)}
[shading]
enabled = false
[camera]
eye = {SCENE["eye"]}
target = {SCENE["target"]}
up = {SCENE["up"]}
angle = {angle}
[march]
step = {SCENE["step"] / min(SPACING)}
interpolation = "trilinear"
opaque = 1.0
[image]
size = {SCENE["size"]}
""")
    lacuna("render", folder / "blobs.toml", "-o", folder / "ours.exr", "-q")
    return colours(folder / "ours.exr")


def vtk(voxels, folder):
    numpy.save(folder / "voxels.npy", voxels)
    (folder / "job.json").write_text(json.dumps(SCENE | {"voxels": str(folder / "voxels.npy")}))
    script = tool.ROOT / "tests" / "vtk_picture.py"
    result = tool.run([sys.executable, script, folder / "job.json", folder / "vtk.npy"])
    assert result.status == 0, f"VTK found no OpenGL: install Mesa's (libegl1 on Debian)\n{result}"
    return numpy.load(folder / "vtk.npy") / 255.0


def test_the_picture_is_that_of_vtk(tmp_path):
    """The same camera, transfer function, opacity unit and trilinear interpolation: a mean error below 0.0015.

    What may differ: VTK's picture is read in 8 bits (0.001 in the mean), colours and opacities have 15 bits, and every
    product is rounded up (0.003 for 100 samples at most), samples lie elsewhere along the ray (second order in the step).
    VTK's ray caster spreads its n rows over n - 1: its pictures of 100, 200 and 400 squared agree best with a field of view
    that is 1/n narrower, so that is what they are compared with. What would be another convention stands out: pixels one
    aside, voxel centres half a voxel aside, another unit of opacity.
    """
    voxels = blobs()
    expected = vtk(voxels, tmp_path)
    assert expected.max() > 0.5 and (expected.max(axis=-1) > 0.02).mean() > 0.3
    narrower = 1 - 1 / SCENE["size"][0]

    def error(found):
        return numpy.abs(expected - found)[1:-1, 1:-1].mean()

    found = ours(voxels, tmp_path, narrower=narrower)
    same = error(found)
    print(f"mean error {same:.6f}, largest {numpy.abs(expected - found).max():.4f}")
    assert same < 0.0015
    for axis in (0, 1):
        for shift in (-1, 1):
            assert error(numpy.roll(found, shift, axis)) > 2.5 * same, (axis, shift)
    for axis in range(3):
        origin = [place + 0.5 * SPACING[axis] * (k == axis) for k, place in enumerate(ORIGIN)]
        assert error(ours(voxels, tmp_path, origin=origin, narrower=narrower)) > 2.5 * same, axis
    assert error(ours(voxels, tmp_path, unit=1.0, narrower=narrower)) > 2.5 * same
    assert error(ours(voxels, tmp_path)) > 2.5 * same


def test_an_interrupt_leaves_no_file_and_an_update_goes_on(tmp_path):
    words = ["render", "procedural:head:48", "-o", tmp_path / "o.###.exr", "--frames", "1-40", "--size", "400x400",
             "--step", "0.05", "--set", "camera.orbit=9", "--threads", "1"]
    process = subprocess.Popen([tool.LACUNA, *map(str, words)], stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not (tmp_path / "o.001.exr").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 128 + signal.SIGINT
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left and len(left) < 40 and all(name.startswith("o.") and name.endswith(".exr") for name in left), left
    # What is there is whole, and is not made again.
    times = {name: (tmp_path / name).stat().st_mtime_ns for name in left}
    for name in left:
        assert colours(tmp_path / name, "A").max() > 0
    words[words.index("1-40")] = f"1-{len(left) + 1}"
    result = lacuna(*words, "--update")
    assert f"{len(left)} skipped" in result.stderr, result
    assert times == {name: (tmp_path / name).stat().st_mtime_ns for name in left}
    assert (tmp_path / f"o.{len(left) + 1:03}.exr").exists()


def test_what_a_surface_or_a_maximum_shows_has_its_distance_normal_and_motion(tmp_path):
    """Thin vessels in steps of an eighth of a voxel: a coarser march would miss some."""
    for mode in ["iso", "mip"]:
        path = tmp_path / f"{mode}.0001.exr"
        lacuna("render", "procedural:vessels:48", "-o", tmp_path / f"{mode}.####.exr", "--frames", "1", "--mode", mode, "--step", "0.125",
               "--size", "64x64", "--set", "camera.orbit=5", "--set", "camera.zoom=2", "--depth", "--normals", "--dense-aovs", "--motion", "-q")
        seen = numpy.isfinite(colours(path, "Z")[..., 0])
        assert seen.sum() > 300, mode
        numpy.testing.assert_array_equal(colours(path, "Z"), colours(path, ["dense.Z"]))
        names = ["N.X", "N.Y", "N.Z"]
        numpy.testing.assert_array_equal(colours(path, names), colours(path, [f"dense.{name}" for name in names]))
        moves = (colours(path, ["motion.X", "motion.Y"]) != 0).any(axis=-1)
        # What lies on the axis of the orbit stays.
        assert (moves == seen).mean() > 0.999 and not moves[~seen].any(), mode
        normals = colours(path, names)[seen]
        lengths = numpy.linalg.norm(normals, axis=-1)
        assert (numpy.isclose(lengths, 1, atol=1e-5) | (lengths == 0)).all() and (lengths > 0).mean() > 0.9, mode


def test_motion_and_angle_do_not_depend_on_where_the_world_begins(tmp_path):
    """Map coordinates: millions of metres from the origin."""
    voxels, found = blobs(), {}
    for name, origin in [("near", (0, 0, 0)), ("far", (500_000, 5_000_000, 100))]:
        nrrd(voxels, tmp_path / f"{name}.nrrd", origin)
        lacuna("render", tmp_path / f"{name}.nrrd", "-o", tmp_path / f"{name}.####.exr", "--frames", "1-2", "--size", "60x40", "--density", "0.5",
               "--set", "camera.orbit=5", "--set", "camera.angle=30", "--dense-aovs", "--motion", "-q")
        found[name] = colours(tmp_path / f"{name}.0001.exr", ["motion.X", "motion.Y"])
        header = OpenEXR.File(str(tmp_path / f"{name}.0001.exr")).header()
        assert math.isclose(header["screenWindowWidth"], 1.5 * 2 * math.tan(math.radians(15)), rel_tol=1e-6)
    assert abs(found["near"]).max() > 0.5
    numpy.testing.assert_allclose(found["far"], found["near"], atol=0.01)
    told = lacuna("fill", tmp_path / "far.0001.exr", "-o", tmp_path / "filled.exr", "--temporal", "1", "--motion", "camera", "-v").stderr
    assert "cannot be inverted" not in told, told


def test_values_past_the_largest_half_are_told(tmp_path):
    words = ["render", "procedural:head:16", "-o", tmp_path / "o.exr", "--size", "40x40", "--set", "shading.ambient=1e6", "--force"]
    for pixels in [[], ["--density", "0.5", "--fill", "auto"], ["--density", "0.5", "--adaptive"]]:
        for kind in ["half", "float"]:
            result = lacuna(*words, *pixels, "-d", kind, "--json", tmp_path / "o.json")
            frame, = json.loads((tmp_path / "o.json").read_text())["frames"]
            assert (frame["clamped_halves"] > 100) == (kind == "half"), (pixels, kind, frame)
            if not pixels and kind == "half":
                assert frame["clamped_halves"] == (colours(tmp_path / "o.exr") == 65504).sum()
            assert (f"{frame['clamped_halves']} values past the largest half" in result.stderr) == (kind == "half"), result


def test_memory_that_is_not_there_is_one_line(tmp_path):
    with open(tmp_path / "huge.raw", "wb") as file:
        file.truncate(10 ** 9)
    limit = "ulimit -v 1500000; exec \"$0\" \"$@\""
    for words in [["procedural:head:1000"], [tmp_path / "huge.raw", "--raw", "1000x1000x1000:u8"],
                  ["procedural:head:8", "--size", "20000x20000"]]:
        command = ["bash", "-c", limit, tool.LACUNA, "render", *map(str, words), "-o", tmp_path / "o.exr", "-q"]
        result = subprocess.run(command, capture_output=True, text=True, timeout=100)
        assert result.returncode == 1 and result.stderr.count("\n") == 1, result
        assert "memory, which the system does not give" in result.stderr, result


def test_a_path_that_is_not_utf_8_is_refused_as_such(tmp_path):
    nrrd(blobs(), tmp_path / "ok.nrrd", ORIGIN)
    odd = tmp_path / os.fsdecode(b"\xff.nrrd")
    odd.write_bytes((tmp_path / "ok.nrrd").read_bytes())
    for words in [[odd], ["procedural:head:8", "--volume", odd]]:
        command = [tool.LACUNA, "render", *words, "-o", tmp_path / "o.exr", "-q"]
        result = subprocess.run(command, capture_output=True, timeout=100)
        assert result.returncode == 2 and b"is not UTF-8" in result.stderr, result


def test_what_is_set_to_no_number_is_refused(tmp_path):
    for value in ["camera.orbit=nan", "camera.elevation=inf", "camera.eye=[nan, 0, 0]", "camera.up=[0, inf, 0]"]:
        result = lacuna("render", "procedural:head:8", "-o", tmp_path / "o.exr", "--set", value, ok=False)
        assert result.status == 2 and "finite" in result.stderr and value.split("=")[0] in result.stderr, result


def test_preintegrated_segments_agree_whatever_the_domain(tmp_path):
    header = "NRRD0004\ntype: float\nsizes: 2 2 2\nendian: little\nencoding: raw\n\n"
    (tmp_path / "cell.nrrd").write_bytes(header.encode() + numpy.float32([0] * 4 + [100] * 4).tobytes())
    values = ["camera.azimuth=0", "camera.elevation=0", "camera.projection=orthographic", "camera.zoom=4", "shading.enabled=false",
              "transfer.data-units=true", "transfer.opacity=[[0, 0], [1, 0.9]]", "march.opaque=1", "march.preintegrated=true"]
    words = [word for value in values for word in ("--set", value)]
    for high in (1, 10, 100):
        lacuna("render", tmp_path / "cell.nrrd", "-o", tmp_path / "o.exr", "--size", "9x9", "--interpolation", "trilinear", "--step", 1,
               "--set", f"transfer.domain=[0, {high}]", *words, "--force")
        # By steps of 0.001.
        assert abs(colours(tmp_path / "o.exr", "A")[4, 4, 0] - 0.8986) < 5e-4, high


def test_what_a_colour_map_asks_for_in_vain_is_told_once(tmp_path):
    one = {"ColorSpace": "Lab/CIEDE2000", "Name": "warm", "Points": [0, 0, 0.5, 0, 1, 0.5, 0.5, 0], "RGBPoints": [0, 0, 0, 1, 1, 1, 0, 0]}
    words = ["render", "procedural:head:16", "-o", tmp_path / "o.#.exr", "--frames", "1-3", "--size", "20x20", "--force",
             "--set", f"transfer.paraview={tmp_path / 'map.json'}", "--json", tmp_path / "o.json"]
    for maps, told in [([one, one], True), ([one | {"ColorSpace": "RGB"}], False)]:
        (tmp_path / "map.json").write_text(json.dumps(maps))
        result = lacuna(*words)
        assert result.stderr.count("map.json: not followed: ColorSpace Lab/CIEDE2000") == told, result
        frames = json.loads((tmp_path / "o.json").read_text())["frames"]
        assert [any("1 further maps" in text for text in frame["warnings"]) for frame in frames] == [told] * 3


def joined_by_vtk(map, value):
    """What VTK's colour transfer function has at a value."""
    from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

    found = vtkColorTransferFunction()
    getattr(found, f"SetColorSpaceTo{map['ColorSpace']}")()
    found.SetHSVWrap(map.get("HSVWrap", 1))
    for at, *colour in zip(*[iter(map["RGBPoints"])] * 4):
        found.AddRGBPoint(at, *colour)
    if map.get("UseLogScale"):
        found.SetScaleToLog10()
    return found.GetColor(value)


@pytest.mark.parametrize("more", [
    {"ColorSpace": "RGB"}, {"ColorSpace": "RGB", "UseLogScale": 1}, {"ColorSpace": "HSV"}, {"ColorSpace": "HSV", "HSVWrap": 0},
    {"ColorSpace": "Lab"}, {"ColorSpace": "Lab", "UseLogScale": 1}, {"ColorSpace": "Diverging"}, {"ColorSpace": "Step"},
], ids=lambda more: "-".join(map(str, more.values())))
def test_colour_maps_are_joined_as_vtk_joins_them(tmp_path, more):
    """Seen in volumes of one value each."""
    map = more | {"RGBPoints": [1, 0.9, 0.2, 0.05, 3, 0.231, 0.298, 0.753, 6, 0.865, 0.865, 0.865, 9, 0.706, 0.016, 0.349]}
    (tmp_path / "map.json").write_text(json.dumps(map | {"Points": [1, 1, 0.5, 0, 9, 1, 0.5, 0]}))
    values = numpy.linspace(1, 9, 12, dtype="<f4")
    for value in values:
        numpy.full((4, 4, 4), value, "<f4").tofile(tmp_path / "v.raw")
        lacuna("render", tmp_path / "v.raw", "--raw", "4x4x4:f32:le", "-o", tmp_path / "o.exr", "--size", "9x9", "--force", "-d", "float",
               "--set", f"transfer.paraview={tmp_path / 'map.json'}", "--set", "transfer.domain=[1,9]", "--set", "shading.enabled=false")
        [frame] = frames.read(tmp_path / "o.exr")
        seen = [float(frame[name][4, 4] / frame["A"][4, 4]) for name in "RGB"]
        # Tables of both have finite steps.
        assert numpy.allclose(seen, joined_by_vtk(map, float(value)), atol=3e-3), (value, seen)
