"""The extension behind the package; its arguments are checked there, so call that."""

from __future__ import annotations

from typing import Any, Optional, TypedDict

import numpy as np
import numpy.typing as npt

__version__: str
FEWEST_GUIDED: int

class End(TypedDict):
    stop: str
    iterations: int
    gap: Optional[float]
    residual: Optional[float]
    off_input: Optional[float]

class Report(TypedDict):
    end: End
    smoothed: bool
    filters: list[tuple[str, float]]
    guides: list[str]
    rmse: Optional[tuple[Optional[float], Optional[float], float]]
    unclipped_rmse: Optional[float]
    clipped: float
    reason: Optional[str]
    errors: Optional[npt.NDArray[np.float32]]

def fill(
    image: npt.NDArray[Any],
    mask: Optional[npt.NDArray[np.uint8]],
    guides: list[tuple[str, npt.NDArray[Any]]],
    twin: Optional[npt.NDArray[Any]],
    filter: str,
    settings: list[tuple[str, str]],
    values: str,
    domain: str,
    limit: bool,
    weights: Optional[npt.NDArray[np.float32]],
    noise: str,
    known: list[npt.NDArray[Any]],
    estimate: str,
    peak: float,
    threads: int,
) -> tuple[npt.NDArray[Any], Report]: ...
def filters() -> list[tuple[str, str, list[tuple[str, str, str, str]]]]: ...
def bytes_per_pixel(filter: str) -> int: ...
def upscale(
    image: npt.NDArray[Any],
    height: int,
    width: int,
    mask: Optional[npt.NDArray[np.uint8]],
    guides: list[tuple[str, npt.NDArray[Any]]],
    sampling: str,
    filter: str,
    settings: list[tuple[str, str]],
    values: str,
    domain: str,
    limit: bool,
    threads: int,
) -> tuple[npt.NDArray[Any], End]: ...
def mask(
    height: int,
    width: int,
    density: float,
    pattern: str,
    seed: int,
    temporal: str,
    frame: int,
    threads: int,
) -> npt.NDArray[np.bool_]: ...
def next_mask(
    image: npt.NDArray[Any],
    mask: Optional[npt.NDArray[np.uint8]],
    count: int,
    closed: Optional[npt.NDArray[np.uint8]],
    seed: int,
    frame: Optional[int],
    threads: int,
) -> npt.NDArray[np.bool_]: ...
def compare(
    reference: npt.NDArray[Any],
    image: npt.NDArray[Any],
    region: Optional[npt.NDArray[np.uint8]],
    peak: float,
    clip: bool,
    flip: bool,
    threads: int,
) -> list[tuple[str, Optional[float]]]: ...
