"""Frames filled along with those beside them: better where something is to be learned, never worse, and the same bits however a sequence is cut."""

import json
import re
import os
import time

import numpy as np
import OpenEXR
import pytest

import frames
from tool import SAMPLES, lacuna

HEIGHT, WIDTH = 72, 88
DENSITY = 0.2
COUNT = 5


def scene(dy=0.0, dx=0.0, phase=0.0):
    """Waves and a disc, moved by so many pixels."""
    y, x = np.indices((HEIGHT, WIDTH), np.float32)
    y, x = y - dy, x - dx
    waves = 0.1 * np.sin(0.9 * y + phase) * np.cos(0.7 * x) + 0.1 * np.sin((0.5 * x + 0.8 * y) / 1.3)
    disc = np.where(np.hypot(y - 36, x - 44) < 18, 0.3, 0.0)
    return np.stack([0.4 + waves + disc, 0.5 + waves, 0.3 + 0.5 * disc + waves], axis=-1).astype(np.float16)


def mask(frame):
    """Masks of frames in a row cover every pixel."""
    return frames.shuffle(HEIGHT, WIDTH, DENSITY, seed=-frame * DENSITY / 0.618)


def write(folder, shows, count=COUNT, **more):
    """A sequence; `more` are functions of the frame that give further planes."""
    for frame in range(1, count + 1):
        image, own = shows(frame), mask(frame)
        planes = {name: np.where(own, image[..., k], np.float16(0)) for k, name in enumerate("RGB")}
        planes |= {name.replace("_", "."): plane(frame) for name, plane in more.items()}
        frames.write(folder / f"shot.{frame:04}.exr", planes | {"mask": own.astype(np.float16)})
    return folder / "shot.####.exr"


def fill(source, out, *words, **options):
    out.mkdir(exist_ok=True)
    return lacuna("fill", source, "-o", f"{out}/", "--no-estimate", *words, **options)


def psnr(folder, frame, truth):
    return frames.psnr(frames.colour(folder / f"shot.{frame:04}.exr"), truth.astype(np.float32))


def content(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.exr"))}


def test_a_still_scene_is_known_wherever_some_frame_knows_it(tmp_path):
    source = write(tmp_path, lambda _: scene())
    result = fill(source, tmp_path / "out", "--temporal", "2", "--motion", "none", "--frames", "3")
    assert "along with frames 1, 2, 4, 5 by no motion" in result.stderr
    found = frames.colour(tmp_path / "out" / "shot.0003.exr")
    assert np.array_equal(found.astype(np.float16), scene())
    # That nothing moves is found out, and a single file has frames beside it as well.
    result = lacuna("fill", tmp_path / "shot.0003.exr", "-o", tmp_path / "alone.exr", "--no-estimate", "--temporal", "2")
    assert "along with frames 1, 2, 4, 5 by no motion" in result.stderr
    assert np.array_equal(frames.colour(tmp_path / "alone.exr").astype(np.float16), scene())


def test_estimated_motion_is_judged_by_samples_that_it_does_not_know(tmp_path):
    """Grain that belongs to no surface: whatever motion bends the other frames to, they help nowhere."""
    grain = lambda frame: np.random.default_rng(frame).normal(0, 0.1, (*scene().shape[:2], 1))
    shows = lambda frame: (np.clip(scene(0.6 * frame, -0.9 * frame), 0, 0.6) + 0.3 + grain(frame)).astype(np.float16)
    source = write(tmp_path, shows)
    log = tmp_path / "log.json"
    fill(source, tmp_path / "along", "--temporal", "2", "--motion", "flow", "--frames", "3", "--json", log)
    fill(source, tmp_path / "alone", "--frames", "3")
    [record] = json.loads(log.read_text())["frames"]
    gained = psnr(tmp_path / "along", 3, shows(3)) - psnr(tmp_path / "alone", 3, shows(3))
    told = [float(word) for word in re.findall(r"\(?([\d.]+) dB by estimate", record.get("neighbours") or "")]
    assert all(abs(gain - gained) < 1 for gain in told), (told, gained)


def test_estimated_motion_helps(tmp_path):
    shows = lambda frame: scene(0.6 * frame, -0.9 * frame)
    source = write(tmp_path, shows)
    fill(source, tmp_path / "alone", "--frames", "3")
    result = fill(source, tmp_path / "along", "--temporal", "auto", "--frames", "3", "--json", tmp_path / "log.json")
    assert "by flow" in result.stderr
    assert psnr(tmp_path / "along", 3, shows(3)) > psnr(tmp_path / "alone", 3, shows(3)) + 2
    [record] = json.loads((tmp_path / "log.json").read_text())["frames"]
    assert "1, 2, 4, 5 by flow" in record["neighbours"]
    before, after = frames.colour(tmp_path / "shot.0003.exr"), frames.colour(tmp_path / "along" / "shot.0003.exr")
    assert np.array_equal(before[mask(3)], after[mask(3)])


@pytest.mark.parametrize("sign, y_up, unit", [(1, False, 1), (-1, True, 1), (1, True, WIDTH)])
def test_vectors_of_any_convention_are_understood(tmp_path, sign, y_up, unit):
    dy, dx = 1.6, -2.3
    shows = lambda frame: scene(dy * frame, dx * frame)
    height = HEIGHT if unit == WIDTH else 1
    across = lambda _: np.full((HEIGHT, WIDTH), sign * dx / unit, np.float32)

    def down(frame):
        plane = np.full((HEIGHT, WIDTH), sign * dy / height * (-1 if y_up else 1), np.float32)
        plane[frame::7] = np.nan
        return plane

    source = write(tmp_path, shows, motion_X=across, motion_Y=down)
    fill(source, tmp_path / "alone", "--frames", "3")
    result = fill(source, tmp_path / "along", "--temporal", "2", "--frames", "3")
    unit = "in pixels" if unit == 1 else "in parts of the image"
    way = f"{unit} to the {'next frame' if sign == 1 else 'frame before'}, {'y up' if y_up else 'y down'}"
    assert result.stderr.count(way) == 1, result.stderr
    assert psnr(tmp_path / "along", 3, shows(3)) > psnr(tmp_path / "alone", 3, shows(3)) + 2


@pytest.mark.parametrize("factor, ways", [(1, ["vectors", "vectors"]), (0.5, ["flow", "vectors"])])
def test_vectors_give_way_to_estimated_motion_where_that_is_clearly_better(tmp_path, factor, ways):
    dy, dx = 1.2, -1.8

    def shows(frame):
        y, x = np.indices((HEIGHT, WIDTH), np.float32)
        y, x = y - dy * frame, x - dx * frame
        waves = 0.2 * np.sin(0.35 * y + 0.1 * x) * np.cos(0.3 * x)
        return np.stack([0.4 + waves, 0.5 + 0.5 * waves, 0.5 - waves], axis=-1).astype(np.float16)

    vector = lambda length: lambda _: np.full((HEIGHT, WIDTH), factor * length, np.float32)
    source = write(tmp_path, shows, motion_X=vector(dx), motion_Y=vector(dy))
    found = {}
    for motion, way in zip(("auto", "vectors"), ways):
        log = fill(source, tmp_path / motion, "--temporal", "2", "--motion", motion, "--frames", "3").stderr
        assert f"along with frames 1, 2, 4, 5 by {way}" in log, log
        line = "along by flow, not by vectors motion.X and motion.Y in pixels to the next frame, y down: it misses held-out samples by "
        assert log.count(line) == (way == "flow"), log
        found[motion] = psnr(tmp_path / motion, 3, shows(3))
    assert found["auto"] > found["vectors"] + 2 if "flow" in ways else found["auto"] == found["vectors"], found


def test_what_is_told_of_frames_along_is_true(tmp_path):
    """Where other frames know all but the grain, errors at missing pixels are those at held-out ones, which stand in emptier places of this frame's pattern."""
    dy, dx = 1.6, -2.3
    grain = lambda frame: np.random.default_rng(frame).normal(0, 0.01, scene().shape)
    shows = lambda frame: (scene(dy * frame, dx * frame) + grain(frame)).astype(np.float16)
    source = write(tmp_path, shows, motion_X=lambda _: np.full((HEIGHT, WIDTH), dx, np.float32), motion_Y=lambda _: np.full((HEIGHT, WIDTH), dy, np.float32))
    lacuna("fill", source, "-o", f"{tmp_path / 'along'}/", "--create-dir", "--temporal", "2", "--json", tmp_path / "log.json")
    missed = 0.0
    for record in json.loads((tmp_path / "log.json").read_text())["frames"]:
        frame = record["frame"]
        missing = ~mask(frame)
        error = frames.colour(tmp_path / "along" / f"shot.{frame:04}.exr")[missing] - shows(frame).astype(np.float32)[missing]
        [told] = [group["psnr"] for group in record["estimates"] if "R" in group["channels"]]
        true = -10 * np.log10(np.mean(error.astype(np.float64) ** 2))
        assert told["low"] - 0.5 <= true <= told["high"] + 0.5, (frame, told, true)
        missed += (told["estimate"] - true) / COUNT
    assert abs(missed) < 1.5, missed


def test_dense_aovs_of_the_same_rays_and_other_frames_help_each_other(tmp_path):
    """Both are better than the better one, as the guides of other frames are known where these were measured; wrong ones cost nothing."""
    render = ("render", "procedural:vessels:48", "--mode", "iso", "--frames", "1-5", "--size", "240x200", "--samples", "4", "--depth",
              "--dense-aovs", "--set", "march.dense-samples=4", "--set", "camera.orbit=0.5", "--set", "camera.zoom=1.8", "-q")
    lacuna(*render, "--density", "0.2", "-o", tmp_path / "shot.####.exr")
    lacuna(*render, "-o", tmp_path / "full.####.exr")
    truth = frames.colour(tmp_path / "full.0003.exr")
    ways = {"guides": [], "time": ["--temporal", "2", "--guides", "none"], "both": ["--temporal", "2"]}
    found = {}
    for way, words in ways.items():
        fill(tmp_path / "shot.####.exr", tmp_path / way, "--frames", "3", "--channels", "A=keep", *words)
        found[way] = psnr(tmp_path / way, 3, truth)
    assert found["both"] > max(found["guides"], found["time"]) + 0.5, found
    # The other frames' guides are those of others still.
    (tmp_path / "wrong").mkdir()
    for frame in range(1, 6):
        planes = frames.read(tmp_path / f"shot.{frame:04}.exr")[0]
        header = OpenEXR.File(str(tmp_path / f"shot.{frame:04}.exr")).header()
        if frame != 3:
            planes |= {name: np.roll(plane, (23, 31), (0, 1)) for name, plane in planes.items() if name.startswith("dense.") and name != "dense.Z"}
        frames.write(tmp_path / "wrong" / f"shot.{frame:04}.exr", planes, **{name: header[name] for name in ("lacuna/dense", "worldToCamera", "worldToNDC")})
    fill(tmp_path / "wrong" / "shot.####.exr", tmp_path / "of-wrong", "--frames", "3", "--channels", "A=keep", "--temporal", "2")
    assert psnr(tmp_path / "of-wrong", 3, truth) > max(found["guides"], found["time"]) - 0.1


def test_vectors_of_a_turntable_lead_to_the_next_frame(tmp_path):
    """Against the distance and the matrices of both frames."""
    lacuna("render", SAMPLES / "scenes" / "vessels.toml", "-o", tmp_path / "shot.####.exr", "--frames", "1-3", "--size", "96x80", "--density", "0.3",
           "--dense-aovs", "--motion", "--set", "camera.orbit=1.5")
    first, second = (OpenEXR.File(str(tmp_path / f"shot.{frame:04}.exr"), separate_channels=True).parts[0] for frame in (1, 2))
    one, header, later = ({name: channel.pixels for name, channel in first.channels.items()}, first.header, second.header)
    assert header["lacuna/dense"].startswith("motion.X,motion.Y,dense.albedo.R")
    rows, columns = np.indices((80, 96))
    ndc = np.stack([2 * (columns + 0.5) / 96 - 1, 1 - 2 * (rows + 0.5) / 80, np.zeros((80, 96)), np.ones((80, 96))], -1)
    matrix = lambda header, name: np.asarray(header[name], np.float64).reshape(4, 4)
    behind = ndc + [0, 0, 0.5, 0]
    near, far = (place @ np.linalg.inv(matrix(header, "worldToNDC")) for place in (ndc, behind))
    near, far = (place[..., :3] / place[..., 3:] for place in (near, far))
    eye = np.linalg.inv(matrix(header, "worldToCamera"))[3, :3]
    ray = (near - eye) / np.linalg.norm(near - eye, axis=-1, keepdims=True)
    assert np.abs(np.cross(ray, far - eye)).max() < 1e-3 * np.linalg.norm(far - eye, axis=-1).max()
    seen = np.isfinite(one["dense.Z"])
    point = eye + ray * np.where(seen, one["dense.Z"], 1)[..., None]
    # Between where both matrices put it, as what they are rounded by is the same for both.
    here, there = (np.concatenate([point, np.ones((80, 96, 1))], -1) @ matrix(one, "worldToNDC") for one in (header, later))
    here, there = (place[..., :2] / place[..., 3:] for place in (here, there))
    across, down = (there[..., 0] - here[..., 0]) * 48, (here[..., 1] - there[..., 1]) * 40
    for name, moved in (("motion.X", across), ("motion.Y", down)):
        # The matrices of the file are rounded to 24 bits.
        assert np.abs(one[name] - moved)[seen].max() < 2e-3 and not one[name][~seen].any()
    assert np.abs(across[seen]).max() > 0.5


def disc(frame, height=96, width=168):
    """A disc with a texture of its own that moves by 12 pixels a frame before a background that stands still; and where it is."""
    y, x = np.indices((height, width), np.float32)
    u, v = x - 48 - 12 * frame, y - 48
    inside = np.hypot(u, v) < 30
    behind = 0.5 + 0.2 * np.sin(0.7 * x) * np.cos(0.5 * y)
    front = 0.4 + 0.3 * np.sin(0.8 * u) * np.sin(0.6 * v)
    return np.repeat(np.where(inside, front, behind)[..., None], 3, axis=-1).astype(np.float16), inside


def test_what_moves_before_what_stands_is_known_by_one_reading(tmp_path):
    """In parts of the image these vectors lead out of it: what is not compared must not speak for them."""
    rng = np.random.default_rng(5)
    for frame in range(1, COUNT + 1):
        image, inside = disc(frame)
        own = rng.random(inside.shape) < DENSITY
        planes = {name: np.where(own, image[..., k], np.float16(0)) for k, name in enumerate("RGB")}
        planes |= {"motion.X": (12.0 * inside * own).astype(np.float32), "motion.Y": np.zeros(inside.shape, np.float32)}
        frames.write(tmp_path / f"shot.{frame:04}.exr", planes | {"mask": own.astype(np.float16)})
    source = tmp_path / "shot.####.exr"
    fill(source, tmp_path / "alone", "--frames", "3")
    log = fill(source, tmp_path / "along", "--temporal", "2", "--motion", "vectors", "--frames", "2-4").stderr
    for numbers in ("1, 3, 4", "1, 2, 4, 5", "2, 3, 5"):
        assert f"frames {numbers} by vectors motion.X and motion.Y in pixels to the next frame, y down" in log, log
    truth, inside = disc(3)
    within = np.roll(inside, 4, 1) & np.roll(inside, -4, 1)
    for place, least in ((within, 6), (~inside, 3)):
        alone, along = (frames.colour(tmp_path / name / "shot.0003.exr")[place] for name in ("alone", "along"))
        assert frames.psnr(along, truth[place]) > frames.psnr(alone, truth[place]) + least
    fill(source, tmp_path / "one", "--temporal", "2", "--motion", "vectors", "--frames", "3")
    assert content(tmp_path / "one").items() <= content(tmp_path / "along").items()


def test_vectors_of_what_stands_still_are_read_as_usual(tmp_path):
    none = lambda _: np.zeros((HEIGHT, WIDTH), np.float32)
    source = write(tmp_path, lambda _: scene(), motion_X=none, motion_Y=none)
    log = fill(source, tmp_path / "out", "--temporal", "1", "--motion", "vectors", "--frames", "3").stderr
    assert "frames 2, 4 by vectors motion.X and motion.Y in pixels to the next frame, y down" in log, log


def test_a_cut_costs_nothing(tmp_path):
    other = scene(31, 17, 2.0)[::-1]
    shows = lambda frame: scene(0.3 * frame) if frame <= 3 else other
    source = write(tmp_path, shows)
    fill(source, tmp_path / "alone")
    # That nothing moves is not true of the first three frames: a few tenths at most.
    for motion, loss in (("auto", 0.1), ("none", 0.3)):
        fill(source, tmp_path / motion, "--temporal", "2", "--motion", motion)
        for frame in range(1, COUNT + 1):
            assert psnr(tmp_path / motion, frame, shows(frame)) > psnr(tmp_path / "alone", frame, shows(frame)) - loss


def test_one_hot_pixel_of_each_frame_does_not_decide(tmp_path):
    shows = lambda frame: scene(0.6 * frame, -0.9 * frame)
    def spoiled(frame):
        image, at = shows(frame), np.argwhere(mask(frame))[400 + 97 * frame]
        image[tuple(at)] = 100
        return image
    source = write(tmp_path, spoiled)
    fill(source, tmp_path / "alone", "--frames", "3")
    for motion, gain in (("flow", 2), ("auto", 2)):
        log = fill(source, tmp_path / motion, "--temporal", "2", "--motion", motion, "--frames", "3").stderr
        assert "filled without" not in log and "along with frames 1, 2, 4, 5 by flow" in log, log
        clipped = [np.clip(frames.colour(tmp_path / name / "shot.0003.exr"), 0, 1) for name in (motion, "alone")]
        along, alone = (frames.psnr(image, np.clip(spoiled(3), 0, 1).astype(np.float32)) for image in clipped)
        assert along > alone + gain, (motion, along, alone)


def test_chunks_and_threads_change_no_bit(tmp_path):
    source = write(tmp_path, lambda frame: scene(0.4 * frame))
    fill(source, tmp_path / "all", "--temporal", "1", "--threads", "2")
    for name, chunks in (("single", ["1", "2", "3", "4", "5"]), ("chunks", ["4-5", "1-3"])):
        for chunk in chunks:
            fill(source, tmp_path / name, "--temporal", "1", "--frames", chunk, "--threads", "1")
        assert content(tmp_path / name) == content(tmp_path / "all")


def test_neighbours_that_cannot_be_used_are_left_out(tmp_path):
    source = write(tmp_path, lambda _: scene())
    (tmp_path / "shot.0001.exr").write_bytes(b"no frame at all")
    small = {name: np.zeros((8, 8), np.float16) for name in "RGB"} | {"mask": np.eye(8, dtype=np.float16)}
    frames.write(tmp_path / "shot.0002.exr", small)
    complete = scene()
    frames.write(tmp_path / "shot.0004.exr", {name: complete[..., k] for k, name in enumerate("RGB")})
    (tmp_path / "shot.0005.exr").unlink()
    result = fill(source, tmp_path / "out", "--temporal", "2", "--frames", "3")
    lines = result.stderr.splitlines()
    for words in (["shot.0001.exr", "without"], ["frame 2", "another display window, 8 x 8"], ["shot.0004.exr", "mask"]):
        assert sum(all(word in line for word in words) for line in lines) == 1, result.stderr
    fill(source, tmp_path / "alone", "--frames", "3")
    both = [frames.colour(tmp_path / name / "shot.0003.exr") for name in ("out", "alone")]
    assert np.array_equal(*both)


def stamp(folder, seconds):
    """All frames of a folder, changed at this time; by whole seconds, which every file system keeps."""
    for path in folder.glob("*.exr"):
        os.utime(path, (seconds, seconds))


def made_since(folder, seconds):
    return {path.name for path in folder.glob("*.exr") if path.stat().st_mtime != seconds}


def test_an_output_is_made_anew_when_a_neighbour_changes(tmp_path):
    source, out = write(tmp_path, lambda frame: scene(0.4 * frame), count=4), tmp_path / "out"
    again = lambda: fill(source, out, "--temporal", "1", "-u").stderr
    again()
    past = int(time.time()) - 1000
    stamp(tmp_path, past)
    stamp(out, past + 10)
    assert "4 skipped" in again()
    assert made_since(out, past + 10) == set()
    # By its content, not by its time.
    frame, before = (tmp_path / "shot.0004.exr").read_bytes(), content(out)
    os.utime(tmp_path / "shot.0004.exr", (past + 20, past + 20))
    assert "4 skipped" in again()
    (tmp_path / "shot.0004.exr").write_bytes((tmp_path / "shot.0003.exr").read_bytes())
    stamp(tmp_path, past)
    again()
    assert made_since(out, past + 10) == {"shot.0003.exr", "shot.0004.exr"}
    assert content(out) != before
    (tmp_path / "shot.0004.exr").write_bytes(frame)
    again()
    assert content(out) == before
    # One that is gone is missed, too.
    (tmp_path / "shot.0001.exr").unlink()
    stamp(tmp_path, past)
    stamp(out, past + 10)
    again()
    assert "shot.0002.exr" in made_since(out, past + 10)
    assert "shot.0003.exr" not in made_since(out, past + 10)


def test_what_does_not_go_together_is_refused(tmp_path):
    source = write(tmp_path, lambda _: scene(), count=2)
    for words, why in ((["--filter", "ss"], "--filter auto"), (["--noise", "auto"], "--noise")):
        result = lacuna("fill", source, "-o", f"{tmp_path}/out/", "--create-dir", "--temporal", "1", *words, ok=False)
        assert result.status == 2 and why in result.stderr
    result = lacuna("fill", source, "-o", f"{tmp_path}/out/", "--create-dir", "--temporal", "99", ok=False)
    assert result.status == 2 and "1 to 16" in result.stderr


def test_neighbours_with_fewer_digits_are_found(tmp_path):
    write(tmp_path, lambda _: scene(), count=4)
    for frame in range(1, 5):
        (tmp_path / f"shot.{frame:04}.exr").rename(tmp_path / f"s.{frame + 7}.exr")
    for source in ("s.%d.exr", "s.*.exr", "s.10.exr"):
        frames_asked = [] if source == "s.10.exr" else ["--frames", "10"]
        result = fill(tmp_path / source, tmp_path / "out", "--temporal", "auto", *frames_asked)
        assert "along with frames 8, 9, 11 by no motion" in result.stderr, result.stderr


def test_versions_of_a_frame_are_no_neighbours(tmp_path):
    """By its own name, a glob and a pattern alike."""
    write(tmp_path, lambda frame: scene(0.6 * frame, -0.9 * frame), count=3)
    for frame in range(1, 4):
        (tmp_path / f"shot.{frame:04}.exr").rename(tmp_path / f"sh_{frame:04}_v2.exr")
    for version in (1, 3):
        (tmp_path / f"sh_0002_v{version}.exr").write_bytes((tmp_path / "sh_0001_v2.exr").read_bytes())
    found = []
    for name in ("sh_0002_v2.exr", "sh_*_v2.exr", "sh_####_v2.exr"):
        out = tmp_path / f"out{len(found)}"
        log = fill(tmp_path / name, out, "--temporal", "auto").stderr
        assert "along with frames 1, 3 by" in log, log
        found.append((out / "sh_0002_v2.exr").read_bytes())
    assert found[0] == found[1] == found[2]


def test_neighbours_that_cannot_be_used_take_no_memory(tmp_path):
    """Nor are they decoded; the frame is made by the rest."""
    source = write(tmp_path, lambda _: scene())
    large = {name: np.zeros((3000, 3000), np.float16) for name in "RGB"} | {"mask": np.eye(3000, dtype=np.float16)}
    frames.write(tmp_path / "shot.0001.exr", large)
    damaged = bytearray((tmp_path / "shot.0002.exr").read_bytes())
    place = damaged.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    damaged[place + 8 : place + 16] = np.array([99999, 99999], "<i4").tobytes()
    (tmp_path / "shot.0002.exr").write_bytes(damaged)
    whole = (tmp_path / "shot.0004.exr").read_bytes()
    (tmp_path / "shot.0004.exr").write_bytes(whole[: len(whole) // 2])
    result = fill(source, tmp_path / "out", "--temporal", "2", "--frames", "3", "--memory", "32M")
    lines = result.stderr.splitlines()
    for words in ("frame 1 (shot.0001.exr): it has another display window, 3000 x 3000", "frame 2 (shot.0002.exr)", "frame 4 (shot.0004.exr)"):
        assert sum(f"filled without {words}" in line for line in lines) == 1, result.stderr
    assert "along with frames 5" in result.stderr


def test_a_neighbour_whose_mask_is_missing_is_left_out_until_it_comes(tmp_path):
    write(tmp_path, lambda _: scene(), count=3)
    for frame in (1, 2, 3):
        frames.write(tmp_path / f"own.{frame:04}.exr", {"mask": mask(frame).astype(np.float16)})
    kept = (tmp_path / "own.0003.exr").rename(tmp_path / "kept")
    again = lambda: lacuna("fill", tmp_path / "shot.0002.exr", "-o", tmp_path / "out.exr", "--no-estimate", "--temporal", "1", "-u",
                           "--mask", f"file:{tmp_path}/own.####.exr").stderr
    assert "filled without frame 3 (shot.0003.exr): its mask" in again()
    os.utime(tmp_path / "out.exr", (time.time() + 100,) * 2)
    assert "1 skipped" in again()
    kept.rename(tmp_path / "own.0003.exr")
    assert "along with frames 1, 3" in again()


def test_again_takes_neighbours_that_were_filled(tmp_path):
    source = write(tmp_path, lambda _: scene(), count=3)
    fill(source, tmp_path / "once")
    filled = tmp_path / "once" / "shot.####.exr"
    fill(filled, tmp_path / "twice", "--again", "--temporal", "1")
    fill(source, tmp_path / "sparse", "--temporal", "1")
    for frame in (1, 2, 3):
        same = [frames.colour(tmp_path / name / f"shot.{frame:04}.exr") for name in ("twice", "sparse")]
        assert np.array_equal(*same)
    # Without --again the frame is made alone, and with it once more, although nothing has changed.
    (tmp_path / "once" / "shot.0002.exr").write_bytes((tmp_path / "shot.0002.exr").read_bytes())
    update = lambda *words: fill(filled, tmp_path / "mixed", "--temporal", "1", "-u", "--frames", "2", *words).stderr
    assert update().count("--again takes the pixels") == 2
    os.utime(tmp_path / "mixed" / "shot.0002.exr", (time.time() + 100,) * 2)
    assert "1 skipped" in update()
    assert "along with frames 1, 3" in update("--again")


def test_neighbours_have_the_layers_of_their_number(tmp_path):
    write(tmp_path, lambda _: scene(), count=3)
    for frame in (1, 2, 3):
        own = mask(frame)
        planes = {name: np.where(own, scene()[..., k], np.float16(0)) for k, name in enumerate("RGB")}
        frames.write(tmp_path / f"light.{frame:04}.exr", planes)
    words = ["--temporal", "1", "--motion", "flow", "--frames", "2", "--layers", f"direct={tmp_path}/light.####.exr"]
    log = fill(tmp_path / "shot.####.exr", tmp_path / "out", *words).stderr
    assert "along with frames 1, 3 by flow" in log and "filled without" not in log
    # A layer's samples are carried as well.
    assert "direct.R" in log.split("along with frames")[1].splitlines()[0], log
    (tmp_path / "light.0001.exr").unlink()
    log = fill(tmp_path / "shot.####.exr", tmp_path / "out", *words).stderr
    assert "filled without frame 1 (shot.0001.exr): its layer" in log and "along with frames 3" in log


def moved(frame):
    return scene(0.6 * frame, -0.9 * frame)


def test_what_is_wrong_with_motion_is_named(tmp_path):
    """Which frame lacks what, and what it has instead."""
    across = lambda frame: np.full((HEIGHT, WIDTH), 1 if frame == 2 else np.nan, np.float32)
    source = write(tmp_path, moved, count=3, motion_X=across, motion_Y=across, Z=lambda _: np.full((HEIGHT, WIDTH), 2, np.float32))
    log = fill(source, tmp_path / "out", "--temporal", "1", "--motion", "vectors", "--frames", "2").stderr
    assert log.count("none of its motion vectors is finite") == 2, log
    whole = np.eye(4, dtype=np.float32)
    broken, flat = whole.copy(), np.zeros((4, 4), np.float32)
    broken[0, 0] = np.nan
    for here, there, why in (
        ({}, {}, "this frame has no worldToCamera"),
        ({"worldToCamera": whole, "worldToNDC": whole}, {"worldToCamera": whole}, "it has no worldToNDC"),
        ({"worldToCamera": whole, "worldToNDC": broken}, {"worldToCamera": whole, "worldToNDC": whole}, "this frame has a worldToNDC that is not finite"),
        ({"worldToCamera": whole, "worldToNDC": whole}, {"worldToCamera": flat, "worldToNDC": whole}, "it has a worldToCamera or worldToNDC that cannot be inverted"),
        ({"worldToCamera": whole, "worldToNDC": whole}, {"worldToCamera": "none", "worldToNDC": whole}, "it has a worldToCamera of type string, not m44f or m44d"),
    ):
        for frame, header in ((1, there), (2, here), (3, there)):
            frames.write(tmp_path / f"shot.{frame:04}.exr", frames.read(tmp_path / f"shot.{frame:04}.exr")[0], **header)
        log = fill(source, tmp_path / "out", "--temporal", "1", "--motion", "camera", "--frames", "2").stderr
        assert log.count(why) == 2, (why, log)
        # By default motion is found by other means, and what is wrong with a camera is told, not that there is none.
        log = fill(source, tmp_path / "out", "--temporal", "1", "--frames", "2").stderr
        assert log.count(f", not by camera: {why}") == (2 if here else 0), (why, log)


def test_another_display_window_is_called_so(tmp_path):
    source = write(tmp_path, lambda _: scene(), count=3)
    frames.write(tmp_path / "shot.0001.exr", frames.read(tmp_path / "shot.0001.exr")[0], display=((0, 0), (199, 99)))
    log = fill(source, tmp_path / "out", "--temporal", "1", "--frames", "2").stderr
    assert "filled without frame 1 (shot.0001.exr): it has another display window, 200 x 100 pixels from 0, 0" in log


def test_that_there_are_no_neighbours_is_told_once(tmp_path):
    write(tmp_path, lambda _: scene(), count=3)
    names = {1: "s.0001.exr", 2: "s.0011.exr", 3: "s.0021.exr"}
    for frame, name in names.items():
        (tmp_path / f"shot.{frame:04}.exr").rename(tmp_path / name)
    log = fill(tmp_path / "s.####.exr", tmp_path / "out", "--temporal", "auto").stderr
    assert log.count("no frame has a neighbour") == 1 and "s.0002.exr" in log and "at most 3 away" in log
    log = fill(tmp_path / "s.####.exr", tmp_path / "out", "--temporal", "10").stderr
    assert "no frame has a neighbour" not in log
    for flags in ([], ["--temporal", "none"]):
        result = fill(tmp_path / "s.####.exr", tmp_path / "out", *flags, "--motion", "flow", ok=False)
        assert result.status == 2 and "--motion goes with --temporal auto" in result.stderr


def test_depth_and_vectors_may_stand_in_another_part(tmp_path):
    """As renderers write them that give each output a part."""
    down, across = (np.full((HEIGHT, WIDTH), value, np.float32) for value in (1.6, -2.3))
    shows = lambda frame: scene(1.6 * frame, -2.3 * frame)
    for frame in (1, 2, 3):
        image, own = shows(frame), mask(frame)
        colours = {name: np.where(own, image[..., k], np.float16(0)) for k, name in enumerate("RGB")} | {"mask": own.astype(np.float16)}
        parts = [frames.part(colours, name="beauty"), frames.part({"motion.X": across, "motion.Y": down}, name="vectors")]
        frames.write(tmp_path / f"shot.{frame:04}.exr", parts)
    source = tmp_path / "shot.####.exr"
    fill(source, tmp_path / "alone", "--frames", "2")
    log = fill(source, tmp_path / "along", "--temporal", "1", "--motion", "vectors", "--frames", "2").stderr
    assert "by vectors motion.X and motion.Y of part 1 (vectors) in pixels to the next frame, y down" in log, log
    assert psnr(tmp_path / "along", 2, shows(2)) > psnr(tmp_path / "alone", 2, shows(2)) + 2
    for frame in (1, 2, 3):
        image, own = scene(), mask(frame)
        colours = {name: np.where(own, image[..., k], np.float16(0)) for k, name in enumerate("RGB")} | {"mask": own.astype(np.float16)}
        camera = dict.fromkeys(("worldToCamera", "worldToNDC"), np.eye(4, dtype=np.float32))
        parts = [frames.part(colours, name="beauty", **camera), frames.part({"Z": np.full((HEIGHT, WIDTH), 2, np.float32)}, name="depth")]
        frames.write(tmp_path / f"shot.{frame:04}.exr", parts)
    log = fill(source, tmp_path / "along", "--temporal", "1", "--motion", "camera", "--frames", "2").stderr
    assert "along with frames 1, 3 by camera" in log, log
