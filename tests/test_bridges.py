"""What the bridges to renderers refuse, in one line each, and what they leave behind: nothing. Hardly anything is rendered."""

import os
import pathlib
import re
import signal
import stat
import sys
import types

import numpy as np
import OpenEXR
import pytest

import frames
from tool import LACUNA, ROOT, SAMPLES, lacuna, run

BRIDGES = ROOT / "scripts" / "renderers"
BALL = ROOT / "tests" / "ball.xml"
SMALL = ["-D", "width=32", "-D", "height=24", "--spp", "1"]
MITSUBA, LUXCORE, BLENDER = "mitsuba_sparse.py", "luxcore_sparse.py", "blender_sparse.py"
BOTH = pytest.mark.parametrize("name", [MITSUBA, LUXCORE])


pytestmark = pytest.mark.usefixtures("renderer_scenes")


@pytest.fixture
def cfg(tmp_path):
    """The LuxCore scene in a tiny size, in a folder of its own."""
    folder = tmp_path / "scene"
    folder.mkdir()
    text = (SAMPLES / "renderers" / "still.cfg").read_text()
    text = re.sub(r"film\.width = \d+", "film.width = 32", re.sub(r"film\.height = \d+", "film.height = 24", text))
    (folder / "still.cfg").write_text(text)
    (folder / "still.scn").write_text((SAMPLES / "renderers" / "still.scn").read_text().replace("../../out", str(ROOT / "out")))
    return folder / "still.cfg"


def bridge(name, *words, python=(), **environment):
    return run([sys.executable, *python, BRIDGES / name, *words], timeout=600, environment={"LACUNA": LACUNA} | environment)


def told(result, status, *parts):
    """One line on standard error, with all of this in it, and that exit status."""
    assert result.status == status and len(result.lines()) == 1 and not result.stdout, result
    assert result.lines()[0].startswith(f"{pathlib.Path(result.command[1]).name}: error: "), result
    for part in parts:
        assert str(part) in result.stderr, result
    if status == 2:
        assert result.stderr.endswith("--help')\n"), result


def scene(name, cfg):
    return [BALL, *SMALL] if name == MITSUBA else [cfg, "--spp", "1"]


def ball(folder, name, integrator="", film="", **swaps):
    """The ball with another integrator (all of the element) and more in its film, other texts swapped."""
    text = BALL.read_text()
    text = re.sub(r"<integrator.*</integrator>", integrator, text) if integrator else text
    for old, new in swaps.items():
        text = text.replace(old, new)
    (folder / name).write_text(text.replace("</film>", f'<rfilter type="box"/>{film}</film>'))
    return folder / name


def here(folder):
    return sorted(path.relative_to(folder) for path in folder.rglob("*"))


@BOTH
def test_outputs_that_cannot_be_are_refused_before_rendering(name, cfg, tmp_path):
    (tmp_path / "file").write_text("text")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "link.exr").symlink_to("fifo")
    before = here(tmp_path)
    cases = [
        (tmp_path / "file" / "x.exr", 1, "is a file and no folder"),
        (tmp_path / "folder", 1, "this is a folder"),
        (tmp_path / "fifo", 1, "no regular file"),
        (tmp_path / "link.exr", 1, "no regular file"),
        ("", 2, "names no file"),
        ("/proc/nowhere/y.exr", 1, "/proc/nowhere/y.exr"),
        ("/proc/x.exr", 1, "-o /proc/x.exr: /proc cannot be written to"),
        (tmp_path / ("n" * 300), 1, "File name too long"),
        (tmp_path / "x.%4d.exr", 2, "write %04d"),
        (tmp_path / "x.%14d.exr", 2, "write %014d"),
    ]
    for output, status, words in cases:
        result = bridge(name, *scene(name, cfg), "-o", output, "--density", "0.5")
        assert result.status == status and words in result.stderr and len(result.lines()) == 1, result
    assert here(tmp_path) == before and stat.S_ISFIFO((tmp_path / "fifo").stat().st_mode)


@BOTH
def test_nothing_that_is_read_is_overwritten(name, cfg, tmp_path):
    for frame in (1, 2):
        lacuna("mask", "-q", "-o", tmp_path / f"m.{frame:04}.exr", "--size", "32x24", "--density", "0.5")
    (tmp_path / "link.exr").symlink_to("m.0001.exr")
    words = scene(name, cfg)
    shot = tmp_path / "shot.exr"
    shot.write_bytes(pathlib.Path(words[0]).read_bytes())
    one, several = tmp_path / "m.0001.exr", tmp_path / "m.####.exr"
    before = {path: (tmp_path / path).read_bytes() for path in here(tmp_path) if (tmp_path / path).is_file()}
    for output, more, what in [
        (one, ["--mask", one], "the mask"),
        (tmp_path / "link.exr", ["--mask", one], "the mask"),
        (one, ["--mask", tmp_path / "link.exr"], "the mask"),
        (several, ["--mask", several, "--frames", "1-2"], "the mask"),
        (several, ["--mask", tmp_path / "m.0002.exr", "--frames", "1-2"], "the mask"),
        (tmp_path / "m.%d.exr", ["--mask", several, "--frames", "1-2"], ""),
        (shot, ["--density", "0.5"], "the scene"),
    ]:
        if what:
            told(bridge(name, *([shot] if output == shot else words), "-o", output, *more), 2, output.parent, f"same file as {what}", "in place")
        else:
            assert bridge(name, *words, "-o", output, *more).status == 0
    assert all((tmp_path / path).read_bytes() == content for path, content in before.items())


@BOTH
def test_long_names_are_written(name, cfg, tmp_path):
    out = tmp_path / "out" / ("ü" * 124 + ".exr")
    for more in ([], ["--adaptive", "--rounds", "2"]):
        result = bridge(name, *scene(name, cfg), "-o", out, "--density", "0.5", *more)
        assert result.status == 0 and [path.name for path in out.parent.iterdir()] == [out.name], result


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
def test_a_full_standard_output_is_to_blame(tmp_path):
    command = 'exec "$@" > /dev/full'
    words = [sys.executable, BRIDGES / MITSUBA, BALL, *SMALL, "-o", tmp_path / "x.exr", "--density", "0.5"]
    result = run(["sh", "-c", command, "sh", *words], environment={"LACUNA": LACUNA})
    assert result.status == 1 and result.stderr == f"{MITSUBA}: error: standard output: No space left on device\n", result


@BOTH
def test_what_is_read_only_is_replaced_by_force_alone(name, cfg, tmp_path):
    """By the mode: root may write to all."""
    out = tmp_path / "x.0002.exr"
    out.write_bytes(b"of yesterday")
    out.chmod(0o444)
    words = [*scene(name, cfg), "-o", tmp_path / "x.####.exr", "--density", "0.5", "--frames", "1-2"]
    told(bridge(name, *words), 1, out, "read-only", "--force")
    assert out.read_bytes() == b"of yesterday" and not (tmp_path / "x.0001.exr").exists()
    result = bridge(name, *words, "--force")
    assert result.status == 0 and np.isfinite(frames.colour(out)).all(), result


@BOTH
def test_a_lacuna_that_is_none_is_named(name, cfg, tmp_path):
    junk = tmp_path / "junk"
    junk.write_text("junk")
    junk.chmod(0o755)
    for value, words in [
        (tmp_path, f"LACUNA names {tmp_path}, which is a folder"),
        (junk, f"{junk} cannot be run"),
        ("/nope/lacuna", "LACUNA names /nope/lacuna, which does not exist"),
        (cfg, f"LACUNA names {cfg}, which may not be run"),
        ("/bin/true", "'/bin/true mask -q -o "),
        ("/bin/true", "wrote no mask"),
        ("/bin/false", "/bin/false mask: ended with status 1"),
    ]:
        result = bridge(name, *scene(name, cfg), "-o", tmp_path / "x.exr", "--density", "0.5", LACUNA=str(value))
        assert result.status == 1 and len(result.lines()) == 1 and words in result.stderr, result
    assert not (tmp_path / "x.exr").exists()


@BOTH
def test_a_mask_that_cannot_be_read_is_named(name, cfg, tmp_path):
    lacuna("mask", "-q", "-o", tmp_path / "mask.exr", "--size", "32x24", "--density", "0.5")
    whole = (tmp_path / "mask.exr").read_bytes()
    for cut in (8, 200, len(whole) - 20):
        (tmp_path / f"cut{cut}.exr").write_bytes(whole[:cut])
    (tmp_path / "grey.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    os.mkfifo(tmp_path / "fifo")
    cases = {"none.exr": "does not exist", "grey.png": "no EXR file", "fifo": "no regular file", "scene": "no regular file"}
    cases |= {path.name: "truncated or damaged" for path in tmp_path.glob("cut*")}
    for mask, words in cases.items():
        result = bridge(name, *scene(name, cfg), "-o", tmp_path / "x.exr", "--mask", tmp_path / mask)
        told(result, 1, tmp_path / mask, words)


@BOTH
def test_usage_is_one_line(name, cfg, tmp_path):
    out = [*scene(name, cfg), "-o", tmp_path / "x.####.exr", "--density", "0.5"]
    for words, said in [
        (["--frames", "abc"], "'abc' is not a frame or a range"),
        (["--frames", "1-2x0"], "step of '1-2x0'"),
        (["--frames", "1-9999999"], "more than"),
        (["--aovs", "depth,depth"], "depth is given twice"),
        (["--aovs", "nothing"], "nothing is none of"),
        (["--seed", "-1"], "--seed -1"),
        (["--seed", str(1 << 64)], f"at most {(1 << 64) - 1}"),
        (["--density", "2"], "--density 2"),
        (["--nonsense"], "--nonsense"),
        (["--frames", "1-2", "-o", tmp_path / "x.exr"], "would hold 2 frames"),
    ]:
        told(bridge(name, *out, *words), 2, said, f"(see '{name} --help')")
    assert here(tmp_path) == [pathlib.Path(part) for part in ("scene", "scene/still.cfg", "scene/still.scn")]


def test_files_of_luxcore_that_are_wrong_are_named(cfg, tmp_path):
    out = ["-o", tmp_path / "x.exr", "--density", "0.5", "--spp", "1"]
    text = cfg.read_text()
    told(bridge(LUXCORE, "nodir/nope.cfg", *out), 1, "nodir/nope.cfg")
    for name, content, words in [
        ("word.cfg", text.replace("film.width = 32", "film.width = abc"), "film.width = abc"),
        ("zero.cfg", text.replace("film.height = 24", "film.height = 0"), "film.height = 0"),
        ("latin.cfg", f"# é\n{text}", "UTF-8"),
        ("none.cfg", text.replace('"still.scn"', '"none.scn"'), "none.scn"),
        ("junk.cfg", "nonsense", "line 1"),
    ]:
        (cfg.parent / name).write_text(content, "latin-1")
        told(bridge(LUXCORE, cfg.parent / name, *out), 1, cfg.parent, words, "" if name == "none.cfg" else name)


def test_patterns_go_frame_by_frame(cfg, tmp_path):
    """Every spelling, the folder of the scene too; a name that exists is that file."""
    for frame in (1, 2):
        folder = tmp_path / f"sd.{frame:04}"
        folder.mkdir()
        for file in (cfg, cfg.with_suffix(".scn")):
            (folder / file.name).write_text(file.read_text())
        lacuna("mask", "-q", "-o", tmp_path / f"mask.{frame:02}.exr", "--size", "32x24", "--density", "0.5", "--seed", str(frame))
    words = ("-o", tmp_path / "$F4" / "x.%02d.@@@.exr", "--mask", tmp_path / "mask.##.exr", "--frames", "1-2", "--spp", "1")
    result = bridge(LUXCORE, tmp_path / "sd.####" / "still.cfg", *words)
    assert result.status == 0, result
    for frame in (1, 2):
        mask = frames.read(tmp_path / f"mask.{frame:02}.exr")[0]["mask"] > 0
        found = frames.read(tmp_path / f"{frame:04}" / f"x.{frame:02}.{frame:03}.exr")[0]["mask"] > 0
        assert not (found & ~mask).any() and found.any()
    odd = tmp_path / "watch#@@.xml"
    odd.write_text(BALL.read_text())
    sys.path.insert(0, str(BRIDGES))
    try:
        import sequence
    finally:
        sys.path.remove(str(BRIDGES))
    assert sequence.source_name(odd, 3) == str(odd)
    spelt = {"#": "0007", "##": "07", "@@@": "007", "@": "@", "%d": "7", "%03d": "007", "$F": "7", "$F4": "0007", "$FOO": "$FOO", "a%20b": "a%20b"}
    assert {text: sequence.frame_name(text, 7) for text in spelt} == spelt
    assert sequence.frame_name("s.####.exr", -1) == "s.-001.exr"
    # Folders that exist have no place for a number, as in lacuna.
    (tmp_path / "p#1").mkdir()
    assert sequence.frame_name(tmp_path / "p#1" / "q#" / "s.#.exr", 7) == str(tmp_path / "p#1" / "q0007" / "s.0007.exr")
    assert not sequence.is_pattern(tmp_path / "p#1" / "s.exr") and sequence.is_pattern(tmp_path / "q#1" / "s.exr")
    assert sequence.frame_range("3,1-4,10-1x4") == [3, 1, 2, 4, 10, 6] and sequence.frame_range("-5--1:2") == [-5, -3, -1]


@pytest.mark.parametrize("name", [MITSUBA, LUXCORE, BLENDER])
def test_a_python_without_packages_is_told_what_to_install(name):
    result = bridge(name, "--help", python=["-S"])
    assert result.status == 1 and len(result.lines()) == 1, result
    assert re.search(rf"^{name}: error: this Python has no \w+: .*pip install ", result.stderr), result


# Ends a run in the middle of a write, or with what nobody thought of.
STOPPED = """
import os, pathlib, signal, sys
sys.path.insert(0, sys.argv[1])
import bridge, numpy, sparse

class File:
    def __init__(self, *_):
        pass
    def write(self, path):
        pathlib.Path(path).write_bytes(b"half")
        if sys.argv[3].isdigit():
            os.kill(os.getpid(), int(sys.argv[3]))
        raise {"RuntimeError": RuntimeError, "OSError": OSError}[sys.argv[3]]("no\\nway")

sparse.OpenEXR.File = File
plane = numpy.ones((2, 3), numpy.float32)
def body():
    if sys.argv[3] == "KeyError":
        raise KeyError("what\\never")
    sparse.write(sys.argv[2], {"R": plane}, plane > 0)
bridge.run(body, end=os._exit)
"""


@pytest.mark.parametrize("how, status, words", [
    (str(int(signal.SIGTERM)), 143, "stopped by SIGTERM"),
    (str(int(signal.SIGINT)), 130, "stopped by SIGINT"),
    ("RuntimeError", 1, "x.exr: cannot be written: no"),
    ("OSError", 1, "x.exr: cannot be written"),
    ("KeyError", 1, "KeyError"),
])
def test_whatever_stops_a_write_leaves_nothing(how, status, words, tmp_path):
    script, folder = tmp_path / "script.py", tmp_path / "frames"
    script.write_text(STOPPED)
    folder.mkdir()
    (folder / "x.exr").write_bytes(b"of yesterday")
    result = run([sys.executable, script, BRIDGES, folder / "x.exr", how])
    told(result, status, words)
    assert here(folder) == [pathlib.Path("x.exr")] and (folder / "x.exr").read_bytes() == b"of yesterday"


# A renderer that makes something else of a signal that comes while it is at work, as drjit does, or nothing.
WRAPPED = """
import argparse, os, pathlib, signal, sys
sys.path.insert(0, sys.argv[1])
import bridge, numpy, sparse

way, turns = sys.argv[4], []
def draw(mask, path):
    turns.append(path)
    try:
        if len(turns) == int(sys.argv[3]):
            os.kill(os.getpid(), signal.SIGTERM)
    except BaseException as error:
        if way == "raised":
            raise RuntimeError("a callback failed") from error
    clock = sparse.Clock()
    clock.stop()
    sparse.write(path, {name: numpy.arange(mask.size, dtype=numpy.float32).reshape(mask.shape) for name in "RGB"}, mask)
    return mask, clock

def body():
    parser = bridge.Parser("")
    sparse.add_arguments(parser)
    arguments = parser.parse_args(["-o", sys.argv[2], "--density", "0.3", *sys.argv[5:]])
    frames = sparse.check(arguments)
    sparse.each("scene", frames, lambda frame: sparse.frame(arguments, frame, (32, 24), draw))
bridge.run(body, end=os._exit)
"""


@pytest.mark.parametrize("turn, words", [("1", []), ("1", ["--adaptive"]), ("2", ["--adaptive"]), ("5", ["--adaptive"])])
@pytest.mark.parametrize("way", ["raised", "lost"])
def test_a_signal_that_a_renderer_turns_into_something_else_ends_the_run(turn, words, way, tmp_path):
    script, folder = tmp_path / "script.py", tmp_path / "frames"
    script.write_text(WRAPPED)
    result = run([sys.executable, script, BRIDGES, folder / "x.exr", turn, way, *words], environment={"LACUNA": LACUNA})
    told(result, 143, "stopped by SIGTERM")
    assert here(folder) == []


def test_more_rounds_than_pixels_are_refused(tmp_path):
    result = bridge(MITSUBA, BALL, "-o", tmp_path / "f.exr", *SMALL, "--density", "0.1", "--adaptive", "--rounds", "78")
    told(result, 2, "--rounds 78 is more than the 77 pixels")
    told(bridge(MITSUBA, BALL, "-o", tmp_path / "f.png", *SMALL, "--density", "0.1"), 2, "f.png: an output file ends in .exr")
    assert here(tmp_path) == []


def test_each_round_has_noise_of_its_own(tmp_path):
    """Where samples lie in their pixels: texture coordinates of a square that the film shows."""
    square = ball(tmp_path, "square.xml", **{'"perspective"': '"orthographic"', '"sphere"': '"rectangle"', "$height": "$width"})
    words = ["--density", "0.2", "--adaptive", "--rounds", "2", "--first", "0.1", "--aovs", "uv", *SMALL[:2]]
    assert bridge(MITSUBA, square, "-o", tmp_path / "f.exr", *words).status == 0
    channels = frames.read(tmp_path / "f.exr")[0]
    places = np.stack([channels[f"uv.{axis}"][channels["mask"] > 0] for axis in "UV"], 1) * 32 % 1
    assert len(np.unique(places.round(4), axis=0)) > 0.98 * len(places) > 190


# The bridge to LuxCore, telling what seed each call of the renderer has.
SEEDED = """
import os, sys
sys.path.insert(0, sys.argv.pop(1))
import luxcore_sparse, bridge

whole = luxcore_sparse.render_scene
def render_scene(*words):
    print("seed", words[-1], flush=True)
    return whole(*words)
luxcore_sparse.render_scene = render_scene
bridge.run(luxcore_sparse.main, end=os._exit)
"""


def test_each_half_of_each_round_of_luxcore_has_a_seed_of_its_own(cfg, tmp_path):
    (tmp_path / "script.py").write_text(SEEDED)
    words = [cfg, "--spp", "2", "-o", tmp_path / "x.exr", "--density", "0.4", "--adaptive", "--rounds", "3", "--halves"]
    result = run([sys.executable, tmp_path / "script.py", BRIDGES, *words], timeout=600, environment={"LACUNA": LACUNA})
    seeds = re.findall(r"^seed (\d+)$", result.stdout, re.MULTILINE)
    assert result.status == 0 and len(seeds) == len(set(seeds)) == 6 and all(0 < int(seed) < 1 << 31 for seed in seeds), result


def test_only_the_word_frame_becomes_its_number(cfg, tmp_path):
    cfg.write_text(cfg.read_text() + 'scene.note = "$frames $frame_rate $frame."\n')
    (tmp_path / "script.py").write_text("import os, sys\nsys.path.insert(0, sys.argv[1])\nimport luxcore_sparse\n"
                                        "print(luxcore_sparse.properties(sys.argv[2], 7).Get('scene.note').GetString(), flush=True)\nos._exit(0)")
    result = run([sys.executable, tmp_path / "script.py", BRIDGES, cfg])
    assert result.stdout == "$frames $frame_rate 7.\n", result


def test_views_and_devices_that_blender_would_not_mask_are_refused(monkeypatch):
    bpy = types.ModuleType("bpy")
    monkeypatch.setitem(sys.modules, "bpy", bpy)
    monkeypatch.syspath_prepend(BRIDGES)
    monkeypatch.delitem(sys.modules, "blender_sparse", raising=False)
    import blender_sparse

    preferences = types.SimpleNamespace(compute_device_type="CUDA")
    addons = {"cycles": types.SimpleNamespace(preferences=preferences)}
    bpy.context = types.SimpleNamespace(preferences=types.SimpleNamespace(addons=addons))
    scene = types.SimpleNamespace(render=types.SimpleNamespace(use_multiview=False), cycles=types.SimpleNamespace(device="CPU"))
    blender_sparse.check(scene)
    scene.cycles.device = "GPU"
    for kind in ("CUDA", "HIP", "METAL", "ONEAPI"):
        preferences.compute_device_type = kind
        with pytest.raises(blender_sparse.Failure, match=f"{kind} .*OptiX"):
            blender_sparse.check(scene)
    preferences.compute_device_type = "OPTIX"
    blender_sparse.check(scene)
    scene.render.use_multiview = True
    with pytest.raises(blender_sparse.Failure, match="Stereoscopy"):
        blender_sparse.check(scene)


def test_cameras_and_sizes_of_blender_are_followed_or_refused(monkeypatch):
    monkeypatch.setitem(sys.modules, "bpy", types.ModuleType("bpy"))
    monkeypatch.syspath_prepend(BRIDGES)
    import blender_sparse

    camera = types.SimpleNamespace(name="eye", type="PERSP")
    shown = types.SimpleNamespace(pixel_aspect_x=1.0, pixel_aspect_y=1.0, resolution_x=700, resolution_y=50, resolution_percentage=35)
    scene = types.SimpleNamespace(camera=types.SimpleNamespace(data=camera), render=shown)
    assert blender_sparse.followed(scene, 1, {}) is camera
    sizes = []
    monkeypatch.setattr(blender_sparse.sparse, "frame", lambda arguments, frame, size, draw: sizes.append(size))
    blender_sparse.render(None, scene, {}, None, 1)
    assert sizes == [(245, 17)]
    for kind in ("ORTHO", "PANO", "CUSTOM"):
        camera.type = kind
        with pytest.raises(blender_sparse.Failure, match=f"frame 2: .* type {kind}"):
            blender_sparse.followed(scene, 2, {})
    assert blender_sparse.followed(scene, 2, {"eye": (0, 0)}) is camera, "it has the shader already"
    shown.pixel_aspect_y = 2.0
    with pytest.raises(blender_sparse.Failure, match="aspect"):
        blender_sparse.followed(scene, 2, {"eye": (0, 0)})
    scene.camera = None
    with pytest.raises(blender_sparse.Failure, match="there is none"):
        blender_sparse.followed(scene, 2, {})


def test_a_link_to_a_file_stays_one(tmp_path):
    (tmp_path / "shot").mkdir()
    (tmp_path / "shot" / "x.exr").write_bytes(b"old")
    (tmp_path / "x.exr").symlink_to("shot/x.exr")
    result = bridge(MITSUBA, BALL, "-o", tmp_path / "x.exr", "--density", "0.5", *SMALL)
    assert result.status == 0 and (tmp_path / "x.exr").is_symlink(), result
    assert np.isfinite(frames.colour(tmp_path / "shot" / "x.exr")).all()
    assert here(tmp_path) == [pathlib.Path(part) for part in ("shot", "shot/x.exr", "x.exr")]


@BOTH
def test_pixels_are_chosen_in_rounds(name, cfg, tmp_path):
    out = tmp_path / "out"
    words = [*scene(name, cfg), "-o", out / "f.exr", "--density", "0.3", "--adaptive", "--rounds", "3"]
    result = bridge(name, *words)
    assert result.status == 0 and len(result.stdout.splitlines()) == 1, result
    assert here(out) == [pathlib.Path("f.exr")], "what rounds leave beside their frame"
    channels = frames.read(out / "f.exr")[0]
    mask = channels["mask"] == 1
    assert abs(mask.mean() - 0.3) < 0.05 and (channels["G"][~mask] == 0).all() and channels["G"][mask].any()
    header = OpenEXR.File(str(out / "f.exr"), separate_channels=True).header()
    assert header["lacuna/density"] == np.float32(mask.mean())
    if name == LUXCORE:
        count = channels["SAMPLECOUNT"].astype(float)
        assert header["samplesOutside"].startswith(f"{100 * count[~mask].sum() / count.sum():.1f} % of"), header
        # Three rounds, each with a twentieth of its samples a pixel in what is outside, or more.
        assert count[~mask].mean() > 0.08 * count[mask].mean()
        assert f" {count[mask].mean():.1f} samples a pixel" in header["renderer"]
    first = tmp_path / "first.exr"
    lacuna("mask", "-o", first, "--size", "32x24", "--density", "0.09")
    assert mask[frames.read(first)[0]["mask"] == 1].mean() > 0.9, "the first round is spread evenly"
    words = [*scene(name, cfg), "-o", out / "s.####.exr", "--frames", "1-2", *words[-5:]]
    assert bridge(name, *words).status == 0
    one, other = (frames.read(out / f"s.{k:04}.exr")[0]["mask"] == 1 for k in (1, 2))
    assert abs(one.mean() - 0.3) < 0.05 and (one & other).mean() < 0.7 * one.mean(), "frames in a row choose other pixels"


def test_attributes_are_set_in_the_part_with_the_mask(tmp_path):
    """The pixels stay, and so do other parts; what was there is replaced."""
    sys.path.insert(0, str(BRIDGES))
    try:
        import sparse
    finally:
        sys.path.remove(str(BRIDGES))
    plane = np.arange(70 * 50, dtype=np.float32).reshape(70, 50)
    marks = {"lacuna/mask": "mask", "note": "something much longer than what comes"}
    parts = [frames.part({"R": plane}, name="one"), frames.part({"G": plane + 1, "mask": plane % 2}, (3, -4), ((0, 0), (49, 69)), name="two", **marks)]
    for name, given in (("one.exr", parts[1:]), ("two.exr", parts)):
        path = frames.write(tmp_path / name, given)
        before = frames.read(path)
        sparse.stamp(path, {"note": "short", "lacuna/density": 0.5})
        assert here(tmp_path).count(pathlib.Path(name)) == 1 and not list(tmp_path.glob(".*"))
        after, header = frames.read(path), OpenEXR.File(str(path), separate_channels=True).parts[-1].header
        for old, new in zip(before, after, strict=True):
            assert set(old) == set(new) and all(frames.same_bits(old[channel], new[channel]) for channel in old)
        assert header["note"] == "short" and header["lacuna/density"] == 0.5
    assert "note" not in OpenEXR.File(str(path), separate_channels=True).parts[0].header
    lacuna("info", path)


@BOTH
def test_halves_average_to_the_colour(name, cfg, tmp_path):
    words = scene(name, cfg)[:-1] + ["4"]
    result = bridge(name, *words, "-o", tmp_path / "f.exr", "--density", "0.3", "--halves")
    assert result.status == 0, result
    channels = frames.read(tmp_path / "f.exr")[0]
    one, other = (channels[f"{half}.G"].astype(np.float64) for half in ("half1", "half2"))
    assert (one != other).any() and np.abs((one + other) / 2 - channels["G"]).max() <= 2e-7 * np.maximum(one, other).max()
    lacuna("fill", tmp_path / "f.exr", "-o", tmp_path / "full.exr", "--noise", "halves:half1,half2", "--no-estimate")
    told(bridge(name, *words[:-1], "3", "-o", tmp_path / "g.exr", "--density", "0.3", "--halves"), 1, "--halves", "--spp")


@BOTH
def test_a_later_round_that_fails_leaves_those_before(name, cfg, tmp_path):
    # A lacuna that makes the first mask, and no second pass.
    program = tmp_path / "lacuna"
    program.write_text(f'#!/bin/sh\nfor word; do test "$word" = --after && echo "lacuna: error: no luck" >&2 && exit 1; done\nexec {LACUNA} "$@"\n')
    program.chmod(0o755)
    out = tmp_path / "out" / "f.exr"
    result = bridge(name, *scene(name, cfg), "-o", out, "--density", "0.3", "--adaptive", LACUNA=str(program))
    told(result, 1, out, "round 2 of 5 failed", "no luck")
    assert here(out.parent) == [pathlib.Path("f.exr")] and 0.05 < (frames.read(out)[0]["mask"] == 1).mean() < 0.12


@pytest.mark.parametrize("words", [["--rounds", "3"], ["--density", "0.2", "--first", "0.1"], ["--density", "0.2", "--adaptive", "--first", "0.3"],
                                   ["--density", "0.2", "--adaptive", "--rounds", "0"], ["--density", "0.2", "--adaptive", "--rounds", "1", "--first", "0.1"],
                                   ["--mask", "m.exr", "--adaptive"]])
def test_rounds_that_cannot_be_meant_are_refused(words, tmp_path):
    mask = [] if "--density" in words or "--mask" in words else ["--density", "0.2"]
    told(bridge(MITSUBA, BALL, "-o", tmp_path / "f.exr", *mask, *words), 2, "--")
