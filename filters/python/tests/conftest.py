"""What the tests of the wheel share: pictures, and the tool that must come to the same bits."""

import os
import subprocess

import numpy as np
import OpenEXR
import pytest


def picture(height=72, width=88, channels=3, seed=3):
    """Smooth shading with an edge, a little light above 1, float32."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    planes = [np.sin(x / (9 + c + seed)) * np.cos(y / (7 + c)) * 0.5 + 0.6 + 0.5 * (x + c > 0.6 * y + 30) for c in range(channels)]
    return np.ascontiguousarray(np.stack(planes, axis=-1).astype(np.float32))


def write(path, channels):
    """An EXR of channels, each float32, float16 or uint32."""
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, {name: np.ascontiguousarray(plane) for name, plane in channels.items()}).write(str(path))
    return path


def read(path, names="RGB"):
    """Channels of a file as (height, width, channels), or (height, width) of one."""
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    planes = [channels[name].pixels for name in ([names] if names in channels else names)]
    return planes[0] if len(planes) == 1 else np.stack(planes, axis=-1)


def same_bits(one, other):
    kinds = {np.dtype(np.float32): np.uint32, np.dtype(np.float16): np.uint16}
    assert one.dtype == other.dtype and one.shape == other.shape
    bits = [np.ascontiguousarray(array).view(kinds[array.dtype]) for array in (one, other)]
    return np.array_equal(*bits)


@pytest.fixture(scope="session")
def tool():
    """Runs lacuna."""

    def run(*arguments):
        command = [os.environ["LACUNA"], *map(str, arguments)]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stderr
        return result.stdout

    return run
