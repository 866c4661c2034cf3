"""Data windows that differ: between the frames of a sequence, and between two images that are held against each other."""

import json

import numpy as np
import pytest

import frames
from tool import lacuna, oiio

HEIGHT, WIDTH = 96, 168
DISPLAY = ((0, 0), (WIDTH - 1, HEIGHT - 1))
DY, DX = 1.4, 7.3
DENSITY = 0.25


def disc(frame, moves=True):
    """A disc with a texture of its own that moves before black; and where it is."""
    y, x = np.indices((HEIGHT, WIDTH), np.float32)
    time = frame if moves else 3
    u, v = x - 44 - DX * time, y - 40 - DY * time
    inside = np.hypot(u, v) < 26
    front = 0.4 + 0.2 * np.sin(0.8 * u) * np.sin(0.6 * v) + 0.1 * np.sin(0.35 * u + 0.9 * v)
    return np.repeat(np.where(inside, front, 0)[..., None], 3, axis=-1).astype(np.float16), inside


def box(frame):
    """What an automatic crop leaves of it: x_min, y_min, x_max, y_max."""
    rows, columns = np.nonzero(disc(frame)[1])
    return columns.min() - 1, rows.min() - 1, columns.max() + 1, rows.max() + 1


def cut(planes, window):
    x_min, y_min, x_max, y_max = window
    return {name: plane[y_min : y_max + 1, x_min : x_max + 1] for name, plane in planes.items()}


def write(path, planes, window=None, **header):
    """A frame of the display window, or what lies in a window of it."""
    window = window or (0, 0, WIDTH - 1, HEIGHT - 1)
    return frames.write(path, cut(planes, window), origin=window[:2], display=DISPLAY, **header)


def colours(image):
    return {name: image[..., k] for k, name in enumerate("RGB")}


def sequence(folder, crop, moves=True, header=lambda frame: {}, **more):
    """Five sparse frames, cropped to the disc of their number or whole; `more` are functions of the frame that give further planes."""
    folder.mkdir()
    for frame in range(1, 6):
        image, _ = disc(frame, moves)
        own = np.random.default_rng(frame).random((HEIGHT, WIDTH)) < DENSITY
        planes = {name: np.where(own, plane, np.float16(0)) for name, plane in colours(image).items()} | {"mask": own.astype(np.float16)}
        planes |= {name.replace("_", "."): plane(frame) for name, plane in more.items()}
        write(folder / f"shot.{frame:04}.exr", planes, box(frame) if crop else None, **header(frame))
    return folder / "shot.####.exr"


def fill(source, out, *words):
    return lacuna("fill", source, "-o", f"{out}/", "--create-dir", "--no-estimate", *words).stderr


def quality(path, frame, whole=False):
    """Within the crop of the frame."""
    found, truth = colours(frames.colour(path)), colours(disc(frame)[0].astype(np.float32))
    found, truth = (cut(found, box(frame)) if whole else found), cut(truth, box(frame))
    return frames.psnr(np.stack(list(found.values())), np.stack(list(truth.values())))


def vectors(scale=(1, 1)):
    axis = lambda by: lambda frame: (by * disc(frame)[1]).astype(np.float32)
    return {"motion_X": axis(DX * scale[0]), "motion_Y": axis(DY * scale[1])}


def camera(frame):
    """One that moves along a plane at distance 1, so that what it shows moves by `DX` and `DY` pixels of the display window a frame."""
    to_camera = np.eye(4, dtype=np.float32)
    to_camera[3, :2] = 2 * DX * frame / WIDTH, -2 * DY * frame / HEIGHT
    projection = np.zeros((4, 4), np.float32)
    projection[0, 0] = projection[1, 1] = 1
    projection[2, 2:] = -1, -1
    return {"worldToCamera": to_camera, "worldToNDC": to_camera @ projection}


MOTIONS = {
    "pixels": ("in pixels", {}, vectors()),
    "parts of the image": ("in parts of the image", {}, vectors((1 / WIDTH, 1 / HEIGHT))),
    "camera": ("by camera", {"header": camera}, {"Z": lambda frame: np.ones((HEIGHT, WIDTH), np.float32)}),
    "flow": ("by flow", {}, {}),
}


@pytest.mark.parametrize("motion", MOTIONS)
def test_cropped_neighbours_help_as_whole_ones_do(tmp_path, motion):
    says, header, planes = MOTIONS[motion]
    gains = []
    for crop in (True, False):
        source = sequence(tmp_path / f"{crop}", crop, **header, **planes)
        alone, along = (tmp_path / f"{crop}" / name for name in ("alone", "along"))
        fill(source, alone, "--frames", "3")
        log = fill(source, along, "--temporal", "2", "--frames", "3")
        assert "along with frames 1, 2, 4, 5 by" in log and says in log and "filled without" not in log, log
        before, after = (quality(folder / "shot.0003.exr", 3, not crop) for folder in (alone, along))
        gains.append(after - before)
    assert gains[0] > 1.5 and gains[0] > gains[1] - 0.6, gains


def test_neighbours_that_begin_elsewhere_are_where_they_lie(tmp_path):
    """Where nothing moves but the window."""
    source = sequence(tmp_path / "s", True, moves=False)
    fill(source, tmp_path / "alone", "--frames", "3")
    log = fill(source, tmp_path / "along", "--temporal", "2", "--motion", "none", "--frames", "3")
    assert "along with frames 1, 2, 4, 5 by no motion" in log, log
    after, before = (quality(tmp_path / name / "shot.0003.exr", 3) for name in ("along", "alone"))
    assert after > before + 4, (after, before)


def test_a_wrong_motion_of_cropped_frames_costs_nothing(tmp_path):
    source = sequence(tmp_path / "s", True)
    fill(source, tmp_path / "alone")
    fill(source, tmp_path / "along", "--temporal", "2", "--motion", "none")
    for frame in range(1, 6):
        after, before = (quality(tmp_path / name / f"shot.{frame:04}.exr", frame) for name in ("along", "alone"))
        assert after > before - 0.1, (frame, after, before)


def test_chunks_and_threads_change_no_bit_of_cropped_frames(tmp_path):
    source = sequence(tmp_path / "s", True, **vectors())
    content = lambda name: {path.name: path.read_bytes() for path in sorted((tmp_path / name).glob("*.exr"))}
    fill(source, tmp_path / "all", "--temporal", "1", "--threads", "2")
    for chunk in ("4-5", "1", "2-3"):
        fill(source, tmp_path / "chunks", "--temporal", "1", "--frames", chunk, "--threads", "1")
    assert content("all") == content("chunks")


def test_another_image_is_no_neighbour(tmp_path):
    source = sequence(tmp_path / "s", True, **vectors())
    planes, shape = frames.read(tmp_path / "s" / "shot.0002.exr")[0], {"origin": box(2)[:2]}
    frames.write(tmp_path / "s" / "shot.0002.exr", planes, display=((0, 0), (WIDTH, HEIGHT)), **shape)
    planes, shape = frames.read(tmp_path / "s" / "shot.0004.exr")[0], {"origin": box(4)[:2]}
    frames.write(tmp_path / "s" / "shot.0004.exr", planes, display=DISPLAY, pixelAspectRatio=2.0, **shape)
    log = fill(source, tmp_path / "out", "--temporal", "1", "--frames", "3")
    assert "frame 2 (shot.0002.exr): it has another display window, 169 x 97 pixels from 0, 0" in log, log
    assert "frame 4 (shot.0004.exr): it has another pixelAspectRatio" in log, log
