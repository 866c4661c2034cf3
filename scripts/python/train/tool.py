"""Runs lacuna, and reads and writes EXR files, for the training of the filter `cnn`. LACUNA names another binary than that of the release build."""

import os
import pathlib
import subprocess

import numpy as np
import OpenEXR

ROOT = pathlib.Path(__file__).resolve().parents[3]
LACUNA = os.environ.get("LACUNA", str(ROOT / "target" / "release" / "lacuna"))


def lacuna(*words):
    done = subprocess.run([LACUNA, *map(str, words), "-q"], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"lacuna {' '.join(map(str, words))}: ended with status {done.returncode}: {done.stderr.strip()}")


def channels(path):
    found = OpenEXR.File(str(path), separate_channels=True).channels()
    return {name: channel.pixels.astype(np.float32) for name, channel in found.items()}


def read(path):
    """Red, green and blue."""
    found = channels(path)
    return np.stack([found[name] for name in "RGB"], -1)


def write_sparse(path, image, measured):
    """A frame of which some pixels were measured, as `lacuna fill` reads it."""
    written = {name: np.ascontiguousarray((image * measured[..., None])[..., index]) for index, name in enumerate("RGB")}
    written["mask"] = measured.astype(np.float32)
    OpenEXR.File({"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}, written).write(str(path))
