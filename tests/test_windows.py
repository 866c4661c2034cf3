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


def compare(reference, test, folder, *words, **options):
    """The frames of the report, and what was said."""
    result = lacuna("compare", reference, test, "--json", folder / "report.json", *words, **options)
    return json.loads((folder / "report.json").read_text())["frames"], result


def measures(frame, region="all"):
    [found] = [one for one in frame["groups"][0]["regions"] if one["region"] == region]
    return found["measures"]


def test_images_are_compared_by_absolute_coordinates_as_idiff_does(tmp_path):
    image = np.random.default_rng(1).random((HEIGHT, WIDTH, 3)).astype(np.float32)
    noisy = image + np.random.default_rng(2).normal(0, 0.05, image.shape).astype(np.float32)
    one = write(tmp_path / "one.exr", colours(image), (20, 10, 99, 59))
    for name, window in (("moved", (27, 10, 106, 59)), ("larger", (11, 5, 120, 70)), ("smaller", (30, 20, 80, 50))):
        other = write(tmp_path / f"{name}.exr", colours(noisy), window)
        for a, b in ((one, other), (other, one)):
            [frame], result = compare(a, b, tmp_path, "--no-clip")
            assert result.stderr.count("the data windows differ") == 1, result.stderr
            judge = oiio("idiff", "-a", a, b).stdout
            rmse = float(judge.split("RMS error = ")[1].split()[0])
            assert abs(measures(frame)["rmse"] - rmse) < 1e-4 * rmse, (name, measures(frame), judge)
    # Another resolution is another image.
    frames.write(tmp_path / "half.exr", colours(noisy[::2, ::2]))
    result = lacuna("compare", one, tmp_path / "half.exr", ok=False)
    assert result.status == 1 and "of another display window" in result.stderr, result.stderr


def test_a_background_that_was_cropped_is_no_error_and_a_lost_one_is_told(tmp_path):
    image, _ = disc(3)
    whole, cropped = write(tmp_path / "whole.exr", colours(image)), write(tmp_path / "cropped.exr", colours(image), box(3))
    [frame], result = compare(whole, cropped, tmp_path, "--fail-below", "psnr=90")
    assert measures(frame)["psnr"] == "inf" and measures(frame)["pixels"] == HEIGHT * WIDTH and "not 0" not in result.stderr
    x_min, y_min, x_max, y_max = box(3)
    lost = write(tmp_path / "lost.exr", colours(image), (x_min, y_min, x_max - 20, y_max))
    [frame], result = compare(whole, lost, tmp_path, "--fail-below", "psnr=90", ok=False)
    assert result.status == 1 and "psnr" in result.stderr and "values that are not 0 lie in one of the data windows only" in result.stderr
    count = np.count_nonzero(image[:, x_max - 19 :])
    assert frame["groups"][0]["beyond"] == count and f"RGB: {count} values" in result.stderr
    # A bound over what the test image has does not see it, and is not enough.
    mask = frames.full_mask(tmp_path / "mask.exr", (0, 0, WIDTH - 1, HEIGHT - 1))
    planes = frames.read(mask)[0]
    planes["mask"][::2] = 0
    frames.write(mask, planes)
    _, result = compare(whole, lost, tmp_path, "--fail-below", "missing.psnr=90", "--mask", f"file:{mask}", ok=False)
    assert result.status == 1 and "no bound sees" in result.stderr, result.stderr


def test_flicker_of_frames_whose_windows_move_is_that_of_whole_ones(tmp_path):
    """The background is black in both, so that the sums are the same over fewer pixels."""
    for frame in range(1, 4):
        image, inside = disc(frame)
        error = np.random.default_rng(frame).normal(0, 0.02, image.shape) * inside[..., None]
        wrong = np.clip(image + error, 0.01, 1) * inside[..., None]
        for name, window in (("whole", None), ("cropped", box(frame))):
            for kind, planes in (("reference", image), ("test", wrong.astype(np.float16))):
                (tmp_path / name / kind).mkdir(parents=True, exist_ok=True)
                write(tmp_path / name / kind / f"s.{frame:04}.exr", colours(planes), window)
    found = {}
    for name in ("whole", "cropped"):
        report, _ = compare(tmp_path / name / "reference" / "s.####.exr", tmp_path / name / "test" / "s.####.exr", tmp_path, "--measures", "flicker,flicker-along")
        found[name] = [measures(frame) for frame in report]
    for frame in (2, 3):
        [left, top, right, bottom], [x_min, y_min, x_max, y_max] = box(frame - 1), box(frame)
        own, before = np.zeros((2, HEIGHT, WIDTH), bool)
        own[y_min : y_max + 1, x_min : x_max + 1] = before[top : bottom + 1, left : right + 1] = True
        pixels = np.count_nonzero(own | before)
        for measure in ("flicker", "change"):
            whole, cropped = (found[name][frame - 1][measure] for name in ("whole", "cropped"))
            assert abs(cropped - whole * np.sqrt(HEIGHT * WIDTH / pixels)) < 1e-6 * cropped, (measure, whole, cropped)
        along = {name: found[name][frame - 1]["change-along"] / found[name][frame - 1]["change"] for name in found}
        assert along["cropped"] < 0.5 and along["whole"] < 0.5, along


def test_what_lies_elsewhere_is_refused_in_a_line(tmp_path):
    """A mask, guides and a filled frame of another window."""
    image, _ = disc(3)
    own = np.random.default_rng(3).random((HEIGHT, WIDTH)) < DENSITY
    sparse = {name: np.where(own, plane, np.float16(0)) for name, plane in colours(image).items()} | {"mask": own.astype(np.float16)}
    here, there = (20, 20, 89, 69), (24, 23, 93, 72)
    one, other = (write(tmp_path / f"{name}.exr", sparse, window) for name, window in (("one", here), ("other", there)))
    filled = lambda path: lacuna("fill", path, "-o", tmp_path / f"filled.{path.name}", "--filter", "ss", "--no-estimate") and tmp_path / f"filled.{path.name}"
    a, b = filled(one), filled(other)
    result = lacuna("verify", one, b, ok=False)
    assert result.status == 1 and result.stderr.count("(24, 23)-(93, 72), not (20, 20)-(89, 69)") == 1 and "pixel" not in result.stderr.split("data window")[1]
    mask = write(tmp_path / "mask.exr", {"mask": own.astype(np.float16)}, there)
    for words in (["compare", one, a, "--mask", f"file:{mask}"], ["fill", one, "-o", tmp_path / "x.exr", "--mask", f"file:{mask}"]):
        result = lacuna(*words, ok=False)
        assert result.status == 1 and result.stderr.count("the mask does not cover pixel (20, 20)") == 1, result.stderr
    # A larger one serves by absolute coordinates.
    larger = write(tmp_path / "larger.exr", {"mask": own.astype(np.float16)})
    [frame], _ = compare(one, a, tmp_path, "--mask", f"file:{larger}")
    assert frame["groups"][0]["measured_different"] == 0
    albedo = {f"albedo.{name}": plane for name, plane in colours(image).items()}
    guides = write(tmp_path / "guides.exr", albedo, there)
    result = lacuna("fill", one, "-o", tmp_path / "x.exr", "--guides-from", guides, ok=False)
    assert result.status == 1 and "data window" in result.stderr and not (tmp_path / "x.exr").exists(), result.stderr


def test_neighbours_of_no_common_pixel_are_left_out(tmp_path):
    """And windows wherever they are, of a single pixel as well."""
    for frame, window in enumerate(((0, 0, 39, 39), (60, 0, 99, 39), (100, 60, 100, 60), (-30, -20, 9, 19)), 1):
        x, y = window[:2]
        own = np.random.default_rng(frame).random((window[3] - y + 1, window[2] - x + 1)) < 0.5
        own[0, 0] = True
        planes = {name: np.where(own, np.float16(0.1 * frame), np.float16(0)) for name in "RGB"} | {"mask": own.astype(np.float16)}
        frames.write(tmp_path / f"s.{frame:04}.exr", planes, origin=(x, y), display=DISPLAY)
    for motion in ("flow", "none"):
        log = fill(tmp_path / "s.####.exr", tmp_path / motion, "--temporal", "3", "--motion", motion)
        assert "filled without frame 2 (s.0002.exr): none of its samples lies in this frame" in log, log
        for frame in range(1, 5):
            source, filled = tmp_path / f"s.{frame:04}.exr", tmp_path / motion / f"s.{frame:04}.exr"
            assert lacuna("verify", source, filled).status == 0
