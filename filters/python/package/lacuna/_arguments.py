"""What users pass, checked and brought into the one shape that the extension takes. Every refusal names its argument."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping
from typing import Any, Optional

import numpy as np
import numpy.typing as npt

# As many pixels as an index can count.
_MOST = 2**32 - 1


def image(name: str, given: Any, may_hide: bool = True) -> tuple[npt.NDArray[Any], bool]:
    """(row, column, channel), a view wherever one will do, and whether there was an axis of channels. What is masked becomes NaN."""
    array = _array(name, given, may_hide)
    if array.dtype not in (np.float32, np.float16):
        raise ValueError(f"{name}: values are {array.dtype}, not float32 or float16; convert them with astype(numpy.float32)")
    if array.ndim not in (2, 3):
        raise ValueError(f"{name}: {_axes(array)}, not (height, width) or (height, width, channels)")
    height, width = array.shape[:2]
    if array.size == 0:
        raise ValueError(f"{name}: there is no pixel in an array of shape {array.shape}")
    if height * width > _MOST:
        raise ValueError(f"{name}: {width}x{height} pixels are too many (the limit is 2^32 - 1)")
    if np.ma.is_masked(given):
        array = np.where(np.ma.getmaskarray(given), array.dtype.type(np.nan), array)
    return array.reshape(height, width, -1) if array.ndim == 2 else array, array.ndim == 3


def flags(name: str, given: Any, shape: tuple[int, ...]) -> Optional[npt.NDArray[np.uint8]]:
    """A mask as bytes: booleans, whole numbers that are not 0, and floats of 0.5 or more, as in the channels of files."""
    if given is None:
        return None
    array = _array(name, given)
    if array.shape != shape:
        raise ValueError(f"{name}: {_axes(array)}, and the image has {shape} (height, width)")
    if array.dtype.kind == "f":
        if np.isnan(array).any():
            raise ValueError(f"{name}: there is a NaN in it, which is neither measured nor missing")
        array = array >= 0.5
    elif array.dtype.kind in "iu":
        array = array != 0
    elif array.dtype != np.bool_:
        raise ValueError(f"{name}: values are {array.dtype}, not bool")
    return array.view(np.uint8)


def mask(given: Any, image: Any, shape: tuple[int, ...]) -> Optional[npt.NDArray[np.uint8]]:
    """Those of an image, without the pixels that the image itself masks; one at least."""
    array = flags("mask", given, shape)
    if array is not None and np.ma.is_masked(image):
        shown = ~np.ma.getmaskarray(image).reshape(*shape, -1).any(axis=2)
        array = np.where(shown, array, np.uint8(0))
    if array is not None and not array.any():
        raise ValueError("mask: no pixel is measured")
    return array


def weights(given: Any, like: npt.NDArray[Any], measured: Optional[npt.NDArray[np.uint8]]) -> Optional[npt.NDArray[np.float32]]:
    """A weight for each pixel of an image; those of its measured ones count, without a mask those that are finite."""
    if given is None:
        return None
    array = _array("weights", given)
    shape = like.shape[:2]
    if array.shape != shape:
        raise ValueError(f"weights: {_axes(array)}, and the image has {shape} (height, width)")
    if array.dtype.kind not in "fiub":
        raise ValueError(f"weights: values are {array.dtype}, not numbers")
    if array.dtype.kind == "f" and array.dtype.itemsize > 4:
        counting = array[np.isfinite(like).all(axis=2) if measured is None else measured != 0]
        largest = np.max(counting, where=np.isfinite(counting), initial=0)
        if largest > 0 and not np.finfo(np.float32).tiny <= largest <= np.finfo(np.float32).max:
            # Only ratios matter; the largest is 1 then.
            array = array / largest
    with np.errstate(over="ignore"):
        return array.astype(np.float32, copy=False)


def twin(given: Any, like: npt.NDArray[Any]) -> Optional[npt.NDArray[Any]]:
    """Complete values of the same channels, in the dtype of the image."""
    if given is None:
        return None
    array, deep = image("twin", given, may_hide=False)
    if array.shape != like.shape:
        raise ValueError(f"twin: an array of shape {array.shape if deep else array.shape[:2]}, and the image has {like.shape} (height, width, channels)")
    # What a half cannot hold becomes infinite, and such a twin counts for nothing.
    with np.errstate(over="ignore"):
        return array.astype(like.dtype, copy=False)


def noise(given: Any, like: npt.NDArray[Any]) -> tuple[str, list[npt.NDArray[Any]]]:
    """What tells the noise of an image: ``none``, ``auto``, ``variance`` or ``halves``, and the arrays of the latter two, of its shape."""
    if given is None:
        return "none", []
    if isinstance(given, str):
        if given not in ("none", "auto"):
            raise ValueError(f"noise: '{given}' is none of none, auto; or give an array, the variance, or a tuple of two, half buffers")
        return given, []
    if isinstance(given, tuple):
        if len(given) != 2:
            raise ValueError(f"noise: a tuple of {len(given)}, not of two half buffers")
        return "halves", [_beside(f"noise[{at}]", half, like) for at, half in enumerate(given)]
    return "variance", [_beside("noise", given, like)]


def _beside(name: str, given: Any, like: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Values for each of an image's, or one for all channels of a pixel."""
    array, deep = image(name, given, may_hide=False)
    if array.shape[:2] != like.shape[:2] or array.shape[2] not in (1, like.shape[2]):
        shown = array.shape if deep else array.shape[:2]
        raise ValueError(f"{name}: an array of shape {shown}, and the image has {like.shape} (height, width, channels)")
    return np.broadcast_to(array, like.shape)


def guides(given: Any, shape: tuple[int, ...], whose: str = "image") -> list[tuple[str, npt.NDArray[Any]]]:
    """Guides with their names, in the order of the channels of a file; whole numbers are labels of surfaces."""
    if given is None:
        return []
    if not isinstance(given, Mapping):
        raise ValueError(f"guides: a {type(given).__name__}, not a dict of arrays by their names")
    taken = []
    for key, value in given.items():
        word("guides", key)
        name = f"guides[{key!r}]"
        array = _array(name, value)
        if array.shape[:2] != shape:
            raise ValueError(f"{name}: {_axes(array)}, and the {whose} has {shape} (height, width)")
        if array.dtype.kind in "iub":
            if array.shape[2:] == (1,):
                array = array[:, :, 0]
            if array.ndim != 2:
                raise ValueError(f"{name}: labels are one whole number a pixel, not {_axes(array)}")
            array = _labels(array)
        else:
            array, _ = image(name, array)
        taken.append((key, array))
    alone = {key for key, array in taken if array.shape[2:] in ((), (1,))}
    for key in sorted(alone & {f"{key}.{part}" for key, _ in taken if key not in alone for part in "RGBXYZ"}):
        raise ValueError(f"guides[{key!r}]: it has the name of a channel of guides[{key[:-2]!r}]; give one of them another")
    return sorted(taken, key=lambda guide: guide[0] if guide[0] in alone else guide[0] + ".")


def _labels(array: npt.NDArray[Any]) -> npt.NDArray[np.uint32]:
    """Labels of 32 bits, those that differ staying different."""
    if array.size and int(array.max()) - int(array.min()) >= 2**32:
        array = np.unique(array, return_inverse=True)[1].reshape(array.shape)
    return array.astype(np.uint32)


def settings(given: Any) -> list[tuple[str, str]]:
    """Names and values as texts."""
    if given is None:
        return []
    if not isinstance(given, Mapping):
        raise ValueError(f"settings: a {type(given).__name__}, not a dict of values by their names")

    def text(value: Any) -> str:
        if isinstance(value, (bool, np.bool_)):
            return "true" if value else "false"
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
            # Settings that count take no point; others read the same number.
            value = int(value)
        return word("settings", value if isinstance(value, str) else _shown(value))

    return [(word("settings", name), text(value)) for name, value in given.items()]


def flag(name: str, given: Any) -> bool:
    """True or False."""
    if not isinstance(given, (bool, np.bool_)):
        raise ValueError(f"{name}: {_shown(given)} is neither True nor False")
    return bool(given)


def count(name: str, given: Any, least: int = 0, most: int = 2**63 - 1) -> int:
    """A whole number in a range."""
    try:
        value = operator.index(given)
    except TypeError:
        raise ValueError(f"{name}: {_shown(given)} is no whole number") from None
    if not least <= value <= most:
        raise ValueError(f"{name}: {_shown(value)} is not between {least} and {most}")
    return value


def real(name: str, given: Any, above: float = -math.inf) -> float:
    """A finite number above a bound."""
    try:
        if isinstance(given, (str, bytes, bytearray)):
            raise TypeError("Python reads numbers in texts")
        value = float(given)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: {_shown(given)} is no number of 64 bits") from None
    if not (math.isfinite(value) and value > above):
        raise ValueError(f"{name}: {value} is not a finite number" + ("" if above == -math.inf else f" above {above:g}"))
    return value


def factors(name: str, given: Any) -> tuple[float, float]:
    """One number for both axes, or two, of height and width."""
    if isinstance(given, (tuple, list)) or (isinstance(given, np.ndarray) and given.ndim == 1):
        if len(given) != 2:
            raise ValueError(f"{name}: {_shown(given)} is neither a number nor two, of (height, width)")
        return real(name, given[0], above=0), real(name, given[1], above=0)
    factor = real(name, given, above=0)
    return factor, factor


def peak(given: Any) -> float:
    """A value that is above 0 and finite in 32 bits, too."""
    value = real("peak", given, above=0)
    least, most = float(np.finfo(np.float32).tiny), float(np.finfo(np.float32).max)
    if not least <= value <= most:
        raise ValueError(f"peak: {value} is not between {least:.3g} and {most:.3g}")
    return value


def word(name: str, given: Any) -> str:
    """A text."""
    if not isinstance(given, str):
        raise ValueError(f"{name}: {_shown(given)} is no text")
    try:
        given.encode()
    except UnicodeEncodeError:
        # Half of a surrogate pair.
        raise ValueError(f"{name}: {_shown(given)} is no text in Unicode") from None
    return given


def size(name: str, given: Any) -> tuple[int, int]:
    """Height and width, of as many pixels as can be."""
    try:
        height, width = given
    except (TypeError, ValueError):
        raise ValueError(f"{name}: {_shown(given)} is not (height, width)") from None
    height, width = count(name, height, 1), count(name, width, 1)
    if height * width > _MOST:
        raise ValueError(f"{name}: {width}x{height} pixels are too many (the limit is 2^32 - 1)")
    return height, width


def afford(name: str, shape: tuple[int, ...], bytes_per_pixel: int, held: int = 0) -> None:
    """Refuses what the memory cannot hold, before something is aborted for it."""
    height, width = shape[:2]
    needed = height * width * bytes_per_pixel + held
    try:
        # Reserved and given back; a page that is not touched costs nothing.
        np.empty(needed, np.uint8)
    except (MemoryError, ValueError):
        line = f"{name}: {width}x{height} pixels need about {needed / 2**30:.1f} GiB, more than there is"
        raise ValueError(line) from None


def _array(name: str, given: Any, may_hide: bool = False) -> npt.NDArray[Any]:
    """An array whose values lie as the processor reads them; a copy only if they do not."""
    if np.ma.is_masked(given) and not may_hide:
        raise ValueError(f"{name}: values of it are masked; say what they are with numpy.ma.filled")
    try:
        array = np.asarray(given)
    except Exception as error:
        # Whatever its own conversion raises.
        why = " ".join(f"{error}".split()) or type(error).__name__
        raise ValueError(f"{name}: no array ({why})") from error
    if not (array.dtype.isnative and array.flags.aligned):
        array = np.array(array, dtype=array.dtype.newbyteorder("="))
    return array


def _shown(given: Any) -> str:
    """What was given, in a line."""
    try:
        line = " ".join(repr(given).split())
    except ValueError:
        # Python prints no whole number of more than 4300 digits.
        line = "a number of thousands of digits"
    return line if len(line) <= 60 else line[:57] + "..."


def _axes(array: npt.NDArray[Any]) -> str:
    return f"an array of shape {array.shape}"
