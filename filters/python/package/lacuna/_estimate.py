"""What is told of a fill beside the image."""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING, NamedTuple, Optional

import numpy as np
import numpy.typing as npt

from . import _lacuna

if TYPE_CHECKING:
    from ._lacuna import End, Report


class Estimate(NamedTuple):
    """How wrong the missing pixels are, told from samples that were predicted without themselves.

    psnr: In decibels at ``peak``, over missing pixels and channels that were not copied; of light, clipped to 0 and ``peak``, as ``compare``
        does. None if it cannot be told, where all was copied, and where held-out samples show no error at all.
    low: The lower end of an interval that holds the truth nine times of ten; alone where samples show no more.
    high: Its upper end.
    reason: Why it, or more of it, cannot be told, or that a twin has the values.
    errors: (height, width): the root mean square error of each pixel over the channels, clipped as for ``psnr``, 0 at measured ones.
    filters: What filled, and its mean weight at missing pixels: several where the filter ``auto`` blends, ``ss`` where there are too
        few samples to choose by, ``copy`` where a twin has the values.
    guides: The guides that were believed.
    stop: How the solver ended: ``converged`` or ``iteration-limit``.
    rmse: The root mean square error that ``psnr`` is of.
    unclipped_rmse: That of values as they are, if measured light is negative or above ``peak``; else the same. None if it cannot be told.
    peak: The value that counts as white.

    Two are equal if all of this is, ``errors`` bit by bit.
    """

    psnr: Optional[float]
    low: Optional[float]
    high: Optional[float]
    reason: Optional[str]
    errors: Optional[npt.NDArray[np.float32]]
    filters: dict[str, float]
    guides: tuple[str, ...]
    stop: str
    rmse: Optional[float] = None
    unclipped_rmse: Optional[float] = None
    peak: float = 1.0

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Estimate):
            # A tuple would compare the arrays in it.
            return False
        one, two = self.errors, other.errors
        same = one is two or (one is not None and two is not None and np.array_equal(one, two))
        return same and tuple(self._replace(errors=None)) == tuple(other._replace(errors=None))

    def __ne__(self, other: object) -> bool:
        return not self == other

    # There is a dict in it, so never had one.
    __hash__ = None  # type: ignore[assignment]


def estimated(told: Report, white: float) -> Estimate:
    """What the extension tells, in decibels at that peak."""
    rmse, _, most = told["rmse"] or (None, None, None)
    # Without an error there is no ratio to it.
    decibels = [20 * math.log10(white / rmse) if rmse else None for rmse in told["rmse"] or (None, None, None)]
    psnr, high, low = decibels if most else (None, None, None)
    return Estimate(
        psnr,
        low,
        high,
        told["reason"],
        told["errors"],
        dict(told["filters"]),
        tuple(told["guides"]),
        told["end"]["stop"],
        rmse,
        told["unclipped_rmse"],
        white,
    )


def warn_of_the_distance(filter: str, sampling: str, end: End, depth: int) -> None:
    """Says how far bounds keep an enlarged image from its input, where it shows and something can be done."""
    off = end["off_input"]
    # A hundredth shows. What straddles hard edges at broken factors is far off in images that are right, too.
    if off is None or off < 0.01 or (filter, sampling) == ("ss", "box"):
        return
    remedy = "filter 'ss' takes whole pixels" if sampling == "box" else "if the renderer's filter is not this one, 'box' comes nearer"
    line = f"sampling: reduced again, the result is off the image by up to {off:.1e} of the largest value, as bounds go first beside hard edges; {remedy}"
    warnings.warn(line, RuntimeWarning, stacklevel=depth + 1)


def warn_of_the_limit(filter: str, end: End, depth: int) -> None:
    """Says that an image is not the one that the filter is made for; the user's line is so many calls away."""
    left = f", relative gap {end['gap']:.1e}" if end["gap"] is not None else ""
    if not left and end["residual"] is not None:
        left = f", residual {end['residual']:.1e}"
    limited = any(name == filter and any(row[0] == "max_iterations" for row in rows) for name, _, rows in _lacuna.filters())
    remedy = "raise its setting max_iterations" if limited else "another filter may converge"
    line = f"filter: {filter} stopped by the limit of iterations after {end['iterations']}{left}: the image is the best so far; {remedy}"
    warnings.warn(line, RuntimeWarning, stacklevel=depth + 1)
