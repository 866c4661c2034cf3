"""The domain in which lacuna fills a group of channels: linear, or asinh(value / scale) where the range is long, as filters/src/domain.rs has it."""

import numpy as np

# The largest absolute value over the scale above which the range is long.
LONG_RANGE = 50


def scale_of(measured):
    """The scale for a group with these measured values, all channels together; 0 for linear."""
    measured = np.abs(measured[measured != 0].astype(np.float64))
    scale = np.sqrt(np.sqrt(measured)).mean() ** 4 if len(measured) else 0
    return scale if scale > 0 and measured.max() > LONG_RANGE * scale else 0


def forward(values, scale):
    return np.arcsinh(values / scale).astype(np.float32) if scale else values


def back(values, scale):
    return (scale * np.sinh(values)).astype(np.float32) if scale else values
