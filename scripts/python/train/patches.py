"""Batches of patches that the network of the filter `cnn` is trained on, drawn from fills of procedural frames."""

import numpy as np
import torch

import domain
from data import SIZE

PATCH, BATCH = 64, 32
# Pixels at the borders of a patch that do not count, but for those where the image ends.
MARGIN = 8
# How far from an image a patch may be asked for: it then lies at the border.
BEYOND = 24
UNLIMITED = 1e9


def mean_square(filled, truth, limit):
    return ((np.minimum(filled, limit) - np.minimum(truth, limit)) ** 2).mean()


class Patches:
    """Draws patches of fills that have an error at all.

    A value is linear, or as lacuna's fill has it where the range is long (long_range). Of linear frames with highlights or noise, some patches
    are judged after clipping to 1, as they are looked at.
    """

    def __init__(self, data, long_range, seed):
        self.data, self.random = data, np.random.default_rng(seed)
        jobs = range(len(data.frame_of))
        self.scales = np.array([domain.scale_of(data.frames[data.frame_of[job]][data.masks[job]]) if long_range else 0 for job in jobs])
        self.clipped = np.isin(data.kinds[data.frame_of], ("lamps", "noise")) & (self.scales == 0)
        whole = slice(0, SIZE)
        self.errors = np.array([mean_square(*self.values(job, whole, whole), UNLIMITED) for job in jobs])
        self.clipped_errors = np.array([mean_square(*self.values(job, whole, whole), 1.0) if self.clipped[job] else self.errors[job] for job in jobs])
        variances = np.array([self.values(job, whole, whole)[1].var() for job in jobs])
        self.usable = np.where((self.errors > 1e-9 * variances) & (self.clipped_errors > 0))[0]

    def values(self, job, rows, columns):
        """Of a part of a fill, the fill and the truth."""
        scale = self.scales[job]
        filled, truth = self.data.fills[job, rows, columns], self.data.frames[self.data.frame_of[job], rows, columns]
        return domain.forward(filled, scale), domain.forward(truth, scale)

    def patch(self):
        """[filled, truth, measured, counted] of one channel, the frame's error 1, and the value that is white then."""
        random = self.random
        job = int(random.choice(self.usable))
        limit = 1.0 if self.clipped[job] and random.random() < 0.6 else UNLIMITED
        error = self.clipped_errors[job] if limit == 1 else self.errors[job]
        for _ in range(4):  # where there is something to learn
            top, left = random.integers(-BEYOND, SIZE - PATCH + BEYOND + 1, 2).clip(0, SIZE - PATCH)
            part = slice(top, top + PATCH), slice(left, left + PATCH)
            filled, truth = self.values(job, *part)
            if mean_square(filled, truth, limit) > 0.3 * error:
                break
        # One channel, or some mixture of them.
        mixed = random.dirichlet(np.ones(3)) if limit > 1 and random.random() < 0.4 else np.eye(3)[random.integers(3)]
        white = 1 / np.sqrt(error)
        values = np.stack([filled @ mixed * white, truth @ mixed * white, self.data.masks[job][part], counted(top, left)])
        if limit > 1 and random.random() < 0.3:
            values[:2] *= -1
        if random.random() < 0.5:
            values = values[:, ::-1]
        if random.random() < 0.5:
            values = values[:, :, ::-1]
        if random.random() < 0.5:
            values = values.swapaxes(1, 2)
        return values, white if limit == 1 else UNLIMITED

    def batch(self):
        """Four tensors [batch, 1, height, width] and the white of each patch."""
        patches, whites = np.empty((4, BATCH, 1, PATCH, PATCH), np.float32), np.empty((BATCH, 1, 1, 1), np.float32)
        for index in range(BATCH):
            patches[:, index, 0], whites[index] = self.patch()
        return *map(torch.from_numpy, patches), torch.from_numpy(whites)


def counted(top, left):
    """1 at the pixels of a patch that count: within the margin, and as far as the border where the image ends."""
    counts = np.zeros((PATCH, PATCH))
    rows, columns = (slice(MARGIN * (start > 0), PATCH - MARGIN * (start < SIZE - PATCH)) for start in (top, left))
    counts[rows, columns] = 1
    return counts
