"""Fills the pixels that a renderer skipped, enlarges, chooses the pixels to render, and says how wrong the rest is.

Images are NumPy arrays of float32 or float16, (height, width) or (height, width, channels), scene-linear, row 0 at the top. Masks are
(height, width), True where a pixel was measured. Arrays may have any strides and may be read-only; none is ever written to.

    >>> import lacuna, numpy as np
    >>> complete = np.linspace(0, 1, 96 * 128, dtype=np.float32).reshape(96, 128)
    >>> measured = lacuna.mask((96, 128), 0.2)
    >>> filled = lacuna.fill(np.where(measured, complete, np.nan), measured)
    >>> lacuna.compare(complete, filled)["psnr"] > 60
    True

Every call works without the interpreter's lock in threads of its own (``threads``; 0: one a processor), whose number changes no bit of
a result, and ends with KeyboardInterrupt after Ctrl-C: ``upscale`` and fills by iterations soon, what takes none when it is done. What
cannot be done raises ValueError, the argument's name first.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import Any, Literal, Optional, Union, overload

import numpy as np
import numpy.typing as npt

from . import _arguments as arguments
from . import _lacuna
from ._estimate import Estimate, estimated, warn_of_the_distance, warn_of_the_limit
from ._lacuna import __version__

__all__ = ["Estimate", "compare", "estimate", "fill", "filters", "mask", "next_mask", "upscale", "__version__"]

Image = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]
Noise = Union[None, str, npt.ArrayLike, tuple[npt.ArrayLike, npt.ArrayLike]]

# Values, result and the planes of the solvers.
_SOLVING = 24
# Images that noise is smoothed by.
_CANDIDATES = 12


@overload
def fill(
    image: npt.ArrayLike,
    mask: Optional[npt.ArrayLike] = ...,
    guides: Optional[Mapping[str, npt.ArrayLike]] = ...,
    filter: str = ...,
    *,
    settings: Optional[Mapping[str, Any]] = ...,
    values: str = ...,
    domain: str = ...,
    limit: bool = ...,
    weights: Optional[npt.ArrayLike] = ...,
    twin: Optional[npt.ArrayLike] = ...,
    noise: Noise = ...,
    estimate: Literal[False] = ...,
    peak: float = ...,
    threads: int = ...,
) -> Image: ...
@overload
def fill(
    image: npt.ArrayLike,
    mask: Optional[npt.ArrayLike] = ...,
    guides: Optional[Mapping[str, npt.ArrayLike]] = ...,
    filter: str = ...,
    *,
    settings: Optional[Mapping[str, Any]] = ...,
    values: str = ...,
    domain: str = ...,
    limit: bool = ...,
    weights: Optional[npt.ArrayLike] = ...,
    twin: Optional[npt.ArrayLike] = ...,
    noise: Noise = ...,
    estimate: Literal[True],
    peak: float = ...,
    threads: int = ...,
) -> tuple[Image, Estimate]: ...
@overload
def fill(
    image: npt.ArrayLike,
    mask: Optional[npt.ArrayLike] = ...,
    guides: Optional[Mapping[str, npt.ArrayLike]] = ...,
    filter: str = ...,
    *,
    settings: Optional[Mapping[str, Any]] = ...,
    values: str = ...,
    domain: str = ...,
    limit: bool = ...,
    weights: Optional[npt.ArrayLike] = ...,
    twin: Optional[npt.ArrayLike] = ...,
    noise: Noise = ...,
    estimate: bool,
    peak: float = ...,
    threads: int = ...,
) -> Union[Image, tuple[Image, Estimate]]: ...
def fill(
    image: npt.ArrayLike,
    mask: Optional[npt.ArrayLike] = None,
    guides: Optional[Mapping[str, npt.ArrayLike]] = None,
    filter: str = "auto",
    *,
    settings: Optional[Mapping[str, Any]] = None,
    values: str = "light",
    domain: str = "auto",
    limit: bool = True,
    weights: Optional[npt.ArrayLike] = None,
    twin: Optional[npt.ArrayLike] = None,
    noise: Noise = None,
    estimate: bool = False,
    peak: float = 1.0,
    threads: int = 0,
) -> Union[Image, tuple[Image, Estimate]]:
    """Fills the missing pixels of an image, with the same bits as ``lacuna fill``.

    image
        float32 or float16, (height, width) or (height, width, channels). All channels are filled together: pass colour as one
        image, alpha, depth, normals and positions as others. Put NaN or 0 at missing pixels: what stands there is read only to
        recognise a wrong mask, where all measured light is 0. A measured value that is NaN or infinite counts as missing (with
        ``values="other", filter="nearest"`` it stays, and is not copied), and so does a pixel of a masked array that is masked in
        any channel.
    mask
        (height, width): bool, whole numbers (not 0: measured) or floats (0.5 or more: measured). Without it, the pixels at which
        any channel is NaN or infinite are missing. A mask of all pixels says that nothing is to be filled: such values then stay.
    guides
        Complete arrays by their names, (height, width) or (height, width, channels): normals, depth, albedo. Arrays of whole
        numbers, (height, width), are identifiers of surfaces. Guides that do not predict are ignored; filters other than ``auto``
        and ``ss`` take none. Their order does not matter, their names do, as it does in files: channels are taken by name, those of
        three that are nowhere negative as R, G, B, others as X, Y, Z. One that is sparse like ``image`` (blank or the same at
        missing pixels) is refused.
    filter, settings
        One of ``lacuna.filters()``, and its settings as a dict: ``filter="ss", settings={"lambda": 1e-3}``. The default blends
        several by their errors at held-out samples.
    values
        ``light``; ``matte`` for alpha and coverage, which stay within 0 and 1; ``other`` for positions, texture coordinates and
        motion (which the tool also moves onto one surface of the measured ones around); ``directions`` for the components of
        normals (which the tool also brings to unit length).
    domain
        Whether light is filled as it is (``linear``), as logarithms (``log``), or as its range asks for (``auto``).
    limit
        Whether overshoot beside edges is held back.
    weights
        (height, width): how much each measured pixel counts, such as its number of samples; finite, 0 or more, of which only ratios
        matter. Only where settings smooth (``lambda`` of ``ss``, ``epsilon`` of ``tv``), or with ``noise="auto"``, where pixels of weight
        0 are missing; refused elsewhere, as every pixel is kept there.
    twin
        A complete array of the shape of ``image`` that may hold its values, such as an alpha that was rendered everywhere. A channel
        of which it equals all measured values (as the dtype of ``image``, enough of them and not all the same) takes the missing ones
        from it, if it is not sparse itself and they are finite and within the bounds of ``values``; otherwise it counts for nothing. The tool looks for such channels among its guides by their names.
    noise
        What tells the noise of measured pixels, which are then smoothed with the rest as far as it asks for: a variance of each pixel's
        mean, (height, width) or of the shape of ``image``; a tuple of two images, half buffers of which ``image`` is the mean; or
        ``"auto"``, held-out samples of light, which take detail finer than them for noise, too. A complete noisy image is smoothed
        without a mask. Where noise is not finite it counts as unknown. Filters of its own smooth, whatever ``filter`` says, which is for an image without
        noise. If nothing is smoothed, there is a UserWarning.
    estimate
        Whether to return an ``Estimate`` beside the image: two fills more, of a part of the samples.
    peak
        The value that counts as white in the ``Estimate``: it clips light to 0 and ``peak``, as ``compare`` does. Give yours for values
        of other ranges, 4000 say.
    threads
        0: one a processor.

    Returns a new array of the shape and the dtype of ``image``, or that and an ``Estimate``. Measured, finite values keep their
    bits, unless settings or ``noise`` smooth.

    Raises ValueError, which begins with the argument's name, for shapes that do not fit, other dtypes, arrays without pixels or with
    more than the memory holds, masks without a measured pixel or with NaNs, channels without a finite measured value, and unknown
    names, and masked values in anything but ``image``; KeyboardInterrupt after Ctrl-C. Warns with RuntimeWarning where the solver stops
    before it has converged.
    """
    asked = arguments.flag("estimate", estimate)
    told = _fill(image, mask, guides, twin, filter, settings, values, domain, limit, weights, noise, "pixels" if asked else "no", peak, threads)
    return told if asked else told[0]


def estimate(
    image: npt.ArrayLike,
    mask: Optional[npt.ArrayLike] = None,
    guides: Optional[Mapping[str, npt.ArrayLike]] = None,
    filter: str = "auto",
    *,
    settings: Optional[Mapping[str, Any]] = None,
    values: str = "light",
    domain: str = "auto",
    limit: bool = True,
    weights: Optional[npt.ArrayLike] = None,
    twin: Optional[npt.ArrayLike] = None,
    noise: Noise = None,
    peak: float = 1.0,
    threads: int = 0,
) -> Estimate:
    """Says how wrong ``fill`` with the same arguments is, without a reference.

    Takes what ``fill`` takes, raises what it raises, and returns an ``Estimate``.
    """
    return _fill(image, mask, guides, twin, filter, settings, values, domain, limit, weights, noise, "pixels", peak, threads)[1]


def upscale(
    image: npt.ArrayLike,
    scale: Optional[Union[float, tuple[float, float]]] = None,
    *,
    size: Optional[tuple[int, int]] = None,
    mask: Optional[npt.ArrayLike] = None,
    guides: Optional[Mapping[str, npt.ArrayLike]] = None,
    sampling: Optional[str] = None,
    filter: str = "ss",
    settings: Optional[Mapping[str, Any]] = None,
    values: str = "light",
    domain: str = "auto",
    limit: bool = True,
    threads: int = 0,
) -> Image:
    """Enlarges an image, and fills it if pixels are missing, with the same bits as ``lacuna upscale``.

    image
        float32 or float16, (height, width) or (height, width, channels). NaN or 0 at missing pixels, as in ``fill``.
    scale or size
        A factor above 1 up to 16, or two, of (height, width); or (height, width) of the result.
    mask
        As in ``fill``; without it, what is not finite is missing. Values that are not finite are filled with a mask of all pixels, too.
    guides
        As in ``fill``, but of the size of the result, for ``ss``, and no identifiers: whole numbers are refused. An image with a side
        below 32 says nothing about them; there is a UserWarning, and they steer missing pixels only.
    sampling
        What a pixel of ``image`` is: ``box`` (the mean over its area; the default), ``point`` (the value at its centre), ``grid``
        (every n-th pixel of the result), ``gaussian:R`` (R is 0.5 to 1.5 pixels) or ``mitchell``. For ``ss`` and ``tv``.
    filter, settings
        ``tv`` with settings, or ``ss``, ``lanczos3``, ``cubic``, ``linear`` without.
    values, domain, limit, threads
        As in ``fill``.

    Returns a new array of the dtype of ``image``, (height, width) or (height, width, channels).

    Raises ValueError, which begins with the argument's name, where ``fill`` does, and for factors and models out of range. Warns
    with RuntimeWarning where ``tv`` stops before it has converged, and where bounds keep the result a hundredth of the
    largest value or more from its input (not with ``ss`` and ``box``).
    """
    array, deep = arguments.image("image", image)
    height, width, channels = array.shape
    rows, columns = _enlarged((height, width), scale, size)
    flags = arguments.mask(mask, image, (height, width))
    steering = arguments.guides(guides, (rows, columns), "result")
    for key, guide in steering:
        if guide.dtype == np.uint32:
            raise ValueError(f"guides[{key!r}]: whole numbers are identifiers, which steer no enlarging; pass what was measured as float32")
    arguments.afford("size", (rows, columns), channels * _SOLVING)
    name = arguments.word("filter", filter)
    model = arguments.word("sampling", "box" if sampling is None else sampling)
    if sampling is not None and name in ("lanczos3", "cubic", "linear"):
        raise ValueError(f"sampling: '{model}' is a model of a pixel, which {name} has none of: ss and tv have")
    large, end = _lacuna.upscale(
        array,
        rows,
        columns,
        flags,
        steering,
        model,
        name,
        arguments.settings(settings),
        arguments.word("values", values),
        arguments.word("domain", domain),
        arguments.flag("limit", limit),
        _threads(threads),
    )
    if steering and min(height, width) < _lacuna.FEWEST_GUIDED:
        line = f"guides: an image of {width} x {height} is enlarged without them, as a side is below {_lacuna.FEWEST_GUIDED}"
        warnings.warn(line, UserWarning, stacklevel=2)
    if end["stop"] == "iteration-limit" and end["gap"] is not None:
        warn_of_the_limit(name, end, 2)
    warn_of_the_distance(name, model, end, 2)
    return large if deep else large[:, :, 0]


def _enlarged(
    shape: tuple[int, int], scale: Optional[Union[float, tuple[float, float]]], size: Optional[tuple[int, int]]
) -> tuple[int, int]:
    """Height and width of the result."""
    if (scale is None) == (size is None):
        raise ValueError("scale: give it or size, one of the two")
    if size is None:
        factors = arguments.factors("scale", scale)
        shown = " and ".join(f"{factor:g}" for factor in dict.fromkeys(factors))
        if not all(1 <= factor <= 16 for factor in factors) or factors == (1, 1):
            raise ValueError(f"scale: {shown} is not above 1 and at most 16")
        rows, columns = arguments.size("scale", tuple(math.floor(side * factor + 0.5) for side, factor in zip(shape, factors)))
        asked = f"scale: {shown}"
    else:
        rows, columns = arguments.size("size", size)
        asked = f"size: {(rows, columns)}"
        if not all(side <= new <= 16 * side for side, new in zip(shape, (rows, columns))):
            raise ValueError(f"{asked} is not one to 16 times {shape}, the image's (height, width), along both axes")
    if (rows, columns) == shape:
        raise ValueError(f"{asked} leaves the image of {shape} as large as it is; fill it instead")
    return rows, columns


def mask(
    size: tuple[int, int],
    density: float,
    pattern: str = "shuffle",
    *,
    seed: int = 0,
    temporal: str = "fixed",
    frame: int = 0,
    threads: int = 0,
) -> Mask:
    """Says which pixels to render: the mask that ``lacuna mask`` makes.

    size
        (height, width).
    density
        The part of the pixels, 0 to 1.
    pattern
        ``shuffle`` (low-discrepancy), ``blue-noise``, ``poisson``, ``random`` or ``grid``: every n-th pixel of every n-th row, so that
        only the densities 1, 1/4, 1/9, ... come out, the one whose n is nearest (0.25 for 0.2); if it is more than a tenth off, there is a
        UserWarning, as there is for a density above 0 of which no pixel comes.
    seed
        Another pattern of the same kind.
    temporal, frame
        How the masks of a sequence are related: ``fixed`` (all the same), ``offset`` (each by itself), ``complementary`` (they
        cover every pixel as early as possible); and the number of the frame.
    threads
        0: one a processor.

    Returns an array of bool, (height, width), True where a pixel is to be rendered.

    Raises ValueError, which begins with the argument's name.
    """
    height, width = arguments.size("size", size)
    arguments.afford("size", (height, width), 16)
    part, kind = arguments.real("density", density), arguments.word("pattern", pattern)
    made = _lacuna.mask(
        height,
        width,
        part,
        kind,
        arguments.count("seed", seed, 0, 2**64 - 1),
        arguments.word("temporal", temporal),
        arguments.count("frame", frame, -(2**62), 2**62),
        _threads(threads),
    )
    if kind == "grid" and abs(made.mean() - part) > 0.1 * part:
        line = f"density: the grid has {made.mean():.3g}, not {part:g}; other patterns have any density"
        warnings.warn(line, UserWarning, stacklevel=2)
    elif part > 0 and not made.any():
        line = f"density: none of {width} x {height} pixels is in the mask"
        warnings.warn(line, UserWarning, stacklevel=2)
    return made


def next_mask(
    image: npt.ArrayLike,
    mask: Optional[npt.ArrayLike] = None,
    density: Optional[float] = None,
    *,
    count: Optional[int] = None,
    allowed: Optional[npt.ArrayLike] = None,
    seed: int = 0,
    frame: Optional[int] = None,
    threads: int = 0,
) -> Mask:
    """Says which pixels to render next, where more samples help most: as ``lacuna mask --after``.

    image, mask
        What was rendered so far, sparse or filled, as in ``fill``.
    density or count
        How many pixels to add: a part of all pixels, 0 to 1, or their number.
    allowed
        (height, width): the pixels that may be chosen, of those that are missing; all of these without it.
    seed
        That of the first mask; it decides between pixels that would help as much.
    frame
        The number of the frame, if it is one of a sequence: frames in a row choose other pixels of the same places.
    threads
        0: one a processor.

    Returns an array of bool, (height, width), True at the new pixels alone: ``mask |= new`` once they are rendered. There are fewer of
    them only if fewer are missing and ``allowed``.

    Raises ValueError, which begins with the argument's name.
    """
    array, _ = arguments.image("image", image)
    height, width, channels = array.shape
    flags = arguments.mask(mask, image, (height, width))
    if (density is None) == (count is None):
        raise ValueError("density: give it or count, one of the two")
    if count is None:
        part = arguments.real("density", density)
        if not 0 <= part <= 1:
            raise ValueError(f"density: {part:g} is not between 0 and 1")
        count = math.floor(part * height * width + 0.5)
    open_to = arguments.flags("allowed", allowed, (height, width))
    closed = None if open_to is None else (open_to == 0).view(np.uint8)
    arguments.afford("image", array.shape, 64 + channels * _SOLVING)
    return _lacuna.next_mask(
        array,
        flags,
        arguments.count("count", count),
        closed,
        arguments.count("seed", seed, 0, 2**64 - 1),
        None if frame is None else arguments.count("frame", frame, -(2**62), 2**62),
        _threads(threads),
    )


def compare(
    reference: npt.ArrayLike,
    image: npt.ArrayLike,
    region: Optional[npt.ArrayLike] = None,
    *,
    peak: float = 1.0,
    clip: bool = True,
    flip: bool = False,
    threads: int = 0,
) -> dict[str, Optional[float]]:
    """Measures how far an image is from its reference, as ``lacuna compare`` does it for colours.

    reference, image
        float32 or float16, both (height, width) or both (height, width, channels).
    region
        (height, width): the pixels that count, such as ``~mask``; all without it.
    peak, clip
        The value that counts as white, also in ``flip``, and whether values are clipped to 0 and it first.
    flip
        Whether to compute LDR-FLIP as well, of one or three channels.
    threads
        0: one a processor.

    Returns a dict: ``psnr`` and ``log_psnr`` in decibels (inf for equal images), ``mse``, ``rmse``, ``relative_mse``, ``max``,
    ``ssim``, ``flip``, and the counts ``pixels``, ``different``, ``nan``, ``inf``. Measures that do not apply, or were not asked for,
    are None. Values that are NaN or infinite in either image are left out, with a RuntimeWarning (``ssim`` and ``flip`` take them for
    0): what is left is never inf then, but NaN, and so is every measure where nothing is left. There is one, too, where more than a
    twentieth of the values differ only outside 0 to ``peak``, so that clipping hides it.

    Raises ValueError, which begins with the argument's name.
    """
    one, _ = arguments.image("reference", reference, may_hide=False)
    other, _ = arguments.image("image", image, may_hide=False)
    if one.shape != other.shape:
        raise ValueError(f"image: its shape is {np.shape(image)}, that of the reference {np.shape(reference)}")
    flags = arguments.flags("region", region, one.shape[:2])
    arguments.afford("image", one.shape, 64 + 8 * one.shape[2])
    white, clipped, seen = arguments.peak(peak), arguments.flag("clip", clip), arguments.flag("flip", flip)
    found = dict(_lacuna.compare(one, other, flags, white, clipped, seen, _threads(threads)))
    left_out, values = found.pop("left_out"), found["pixels"] * one.shape[2]
    hidden = found.pop("hidden")
    if hidden is not None:
        line = f"image: {100 * hidden:.0f} % of its values differ from the reference only outside 0 to peak, {white:g}, and clipping hides it"
        warnings.warn(line, RuntimeWarning, stacklevel=2)
    if left_out == values:
        warnings.warn("image: there is no value to compare: none is finite in it and the reference, in the region", RuntimeWarning, stacklevel=2)
        found = {name: math.nan if value is None else value for name, value in found.items()}
    elif left_out:
        line = f"image: {left_out:.0f} of {values:.0f} values are NaN or infinite in it or in the reference, and left out"
        warnings.warn(line, RuntimeWarning, stacklevel=2)
        found = {name: math.nan if value == math.inf else value for name, value in found.items()}
    found.setdefault("flip", None)
    return found


def filters() -> dict[str, dict[str, Any]]:
    """What there is to fill with: by name, ``help`` and ``settings``, each with its ``values``, ``default`` and ``help``."""
    rows = ("values", "default", "help")
    return {
        name: {"help": help, "settings": {setting: dict(zip(rows, row)) for setting, *row in settings}}
        for name, help, settings in _lacuna.filters()
    }


def _fill(
    image: npt.ArrayLike,
    mask: Optional[npt.ArrayLike],
    guides: Optional[Mapping[str, npt.ArrayLike]],
    twin: Optional[npt.ArrayLike],
    filter: str,
    settings: Optional[Mapping[str, Any]],
    values: str,
    domain: str,
    limit: bool,
    weights: Optional[npt.ArrayLike],
    noise: Noise,
    estimate: str,
    peak: float,
    threads: int,
) -> tuple[Image, Estimate]:
    array, deep = arguments.image("image", image)
    height, width, channels = array.shape
    flags = arguments.mask(mask, image, (height, width))
    name = arguments.word("filter", filter)
    steering = arguments.guides(guides, (height, width))
    complete = arguments.twin(twin, array)
    noisy, known = arguments.noise(noise, array)
    white = arguments.peak(peak)
    bytes_per_pixel = channels * _SOLVING + 4 * sum(1 if guide.ndim == 2 else guide.shape[2] for _, guide in steering)
    bytes_per_pixel += 0 if complete is None else 4 * channels
    bytes_per_pixel += 0 if noisy == "none" else 4 * channels * (_CANDIDATES + len(known))
    arguments.afford("image", array.shape, _lacuna.bytes_per_pixel(name) + bytes_per_pixel)
    filled, told = _lacuna.fill(
        array,
        flags,
        steering,
        complete,
        name,
        arguments.settings(settings),
        arguments.word("values", values),
        arguments.word("domain", domain),
        arguments.flag("limit", limit),
        arguments.weights(weights, array, flags),
        noisy,
        known,
        estimate,
        white,
        _threads(threads),
    )
    if told["end"]["stop"] == "iteration-limit":
        warn_of_the_limit(name, told["end"], 3)
    if told["clipped"] > 0.5:
        line = f"peak: {100 * told['clipped']:.0f} % of the measured values are above {white:g}, where errors do not count; give the value of white"
        warnings.warn(line, UserWarning, stacklevel=3)
    if told["smoothed"] and name != "auto":
        line = f"noise: it is smoothed by filters of its own, not by {name}"
        warnings.warn(line, UserWarning, stacklevel=3)
    if noisy != "none" and not told["smoothed"]:
        line = "noise: none that could be told from detail, so that nothing is smoothed; where there is some, half buffers tell it"
        if noisy != "auto":
            line = "noise: too little, or known at too few pixels, so that nothing is smoothed"
        warnings.warn(line, UserWarning, stacklevel=3)
    return filled if deep else filled[:, :, 0], estimated(told, white)


def _threads(threads: int) -> int:
    return arguments.count("threads", threads, 0, 2**31)
