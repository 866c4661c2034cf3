"""Frames, masks and what the filter `edge` makes of them: the data that the network of the filter `cnn` is trained and validated on.

All frames are procedural; none is one that lacuna is measured on. Frames, masks and fills are kept as NumPy files for the next time.
"""

import dataclasses
import pathlib
import shutil
import tempfile

import numpy as np

import images
import volumes
from tool import channels, lacuna, read, write_sparse

SIZE = 256
# How many frames there are of each kind, of a thousand for training.
TRAINING = {"image": 320, "render": 280, "lamps": 150, "noise": 150, "smooth": 100}
VALIDATION = {"image": 32, "render": 32, "lamps": 16, "noise": 16, "smooth": 16}
WHOLE = sum(TRAINING.values())
# Every frame of the validation is filled at each of these.
DENSITIES = (0.05, 0.1, 0.2, 0.5)
# One for training at two densities, each somewhere between one of these and SPREAD times that.
LOWEST, SPREAD = (0.04, 0.09, 0.18, 0.4), 2.1
# Masks are thresholds of these rankings of pixels.
PATTERNS, RANKINGS = ("shuffle", "shuffle", "random", "blue-noise"), 12
# Frames that one call of lacuna fills.
CALL = 100


@dataclasses.dataclass
class Data:
    """Complete frames with their kinds; for each fill the frame that it is of, the density, the mask and the result."""

    frames: np.ndarray
    kinds: np.ndarray
    frame_of: np.ndarray
    densities: np.ndarray
    masks: np.ndarray
    fills: np.ndarray


def load(work, name, frames):
    """The data for `training` or `validation`, made if they are not there; frames: how many for training, the validation in proportion."""
    folder = work / f"{name}-{frames}"
    if not folder.exists():
        work.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=work) as scratch:
            made = make(pathlib.Path(scratch), name, frames)
            complete = pathlib.Path(scratch) / "complete"
            complete.mkdir()
            for field in dataclasses.fields(Data):
                np.save(complete / f"{field.name}.npy", getattr(made, field.name))
            shutil.move(complete, folder)
    return Data(**{field.name: np.load(folder / f"{field.name}.npy") for field in dataclasses.fields(Data)})


def make(scratch, name, frames):
    validation = name == "validation"
    seed = 1 if validation else 2
    random = np.random.default_rng(seed)
    counts = {kind: max(1, round(count * frames / WHOLE)) for kind, count in (VALIDATION if validation else TRAINING).items()}
    complete = originals(scratch, random, counts)
    frame_of, densities, masks = choose_pixels(random, rankings(scratch, seed), len(complete), validation)
    calls = [slice(first, first + CALL) for first in range(0, len(masks), CALL)]
    filled = np.concatenate([fill(scratch, complete[frame_of[call]], masks[call]) for call in calls])
    kinds = np.repeat(list(counts), list(counts.values()))
    print(f"{name}: {len(complete)} frames, {len(masks)} fills", flush=True)
    return Data(complete, kinds, frame_of, densities, masks, filled)


def originals(scratch, random, counts):
    """The complete frames, kind by kind."""
    frames = [images.image(random, SIZE).astype(np.float32) for _ in range(counts["image"])]
    frames += renders(scratch, random, counts["render"])
    plain = len(frames)

    def base():
        return frames[random.integers(plain)] if random.random() < 0.5 else images.image(random, SIZE)

    for _ in range(counts["lamps"]):
        frames.append(images.lamps(random, base()).astype(np.float32))
    for _ in range(counts["noise"]):
        image = base() if random.random() < 0.7 else images.smooth(random, SIZE)
        image = images.lamps(random, image) if random.random() < 0.1 else image
        frames.append(images.noisy(random, image).astype(np.float32))
    frames += [images.smooth(random, SIZE).astype(np.float32) for _ in range(counts["smooth"])]
    return np.stack(frames)


def renders(scratch, random, count):
    """Renders of procedural volumes, five of each in the mean, that show something."""
    paths = [scratch / f"volume-{index}.nrrd" for index in range(max(2, count // 5))]
    for index, path in enumerate(paths):
        volumes.write(path, volumes.KINDS[index % len(volumes.KINDS)](random, int(random.choice([80, 112]))))
    scene, target, frames = scratch / "scene.toml", scratch / "render.exr", []
    while len(frames) < count:
        scene.write_text(volumes.scene(random, paths[random.integers(len(paths))].resolve(), SIZE))
        lacuna("render", scene, "--threads", 1, "-o", target)
        frame = read(target)
        if (frame.max(-1) > 1e-3).mean() > 0.04 and frame.std() > 1e-3:
            frames.append(frame)
    return frames


def rankings(scratch, seed):
    """For each pixel the density from which on it is measured, several times."""
    path, found = scratch / "ranking.exr", []
    for index in range(RANKINGS):
        pattern = PATTERNS[index % len(PATTERNS)]
        lacuna("mask", "--size", f"{SIZE}x{SIZE}", "--rank", "--pattern", pattern, "--seed", seed * 100 + index, "-o", path)
        found.append(next(iter(channels(path).values())))
    return found


def choose_pixels(random, ranked, frames, validation):
    """For each fill its frame, density and mask. For training some masks are shifted, and some are denser here than there."""
    jobs, masks = [], []
    for frame in range(frames):
        densities = DENSITIES
        if not validation:
            several = np.exp(np.log(LOWEST) + random.uniform(0, 1, len(LOWEST)) * np.log(SPREAD))
            densities = several[random.permutation([0, 1, 2, 2, 3])[:2]]
        for index, density in enumerate(densities, start=2 * frame):
            ranking, threshold = ranked[index % RANKINGS], density
            if not validation and index % len(PATTERNS) == 3:
                ranking = np.roll(ranking, random.integers(0, SIZE, 2), (0, 1))
            if not validation and random.random() < 0.15:
                threshold = np.clip(density * np.exp(random.uniform(0.3, 1) * images.field(random, SIZE, SIZE / 3)), 0.02, 0.9)
            mask = ranking < threshold
            mask[0, 0] = True
            jobs.append((frame, density))
            masks.append(mask)
    frame_of, densities = zip(*jobs)
    return np.array(frame_of), np.array(densities), np.stack(masks)


def fill(scratch, frames, masks):
    """What `edge` makes of these frames, each on its own."""
    sparse, filled = scratch / "sparse.####.exr", scratch / "filled.####.exr"
    numbered = range(1, len(frames) + 1)
    for number, frame, mask in zip(numbered, frames, masks):
        write_sparse(str(sparse).replace("####", f"{number:04}"), frame, mask)
    span = f"{numbered[0]}-{numbered[-1]}"
    lacuna("fill", sparse, "-o", filled, "--frames", span, "--filter", "edge", "--guides", "none", "--no-estimate", "--threads", 1)
    return np.stack([read(str(filled).replace("####", f"{number:04}")) for number in numbered])
