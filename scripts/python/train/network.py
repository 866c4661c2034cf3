"""The network of the filter `cnn`: what it adds to one channel that the filter `edge` filled, from that channel and its mask alone.

Scaling a channel and adding to it scales the result and adds to it: features are divided by what varies around a pixel, the correction is
multiplied by that. Everything is local: no pixel depends on one more than 20 away. filters/src/network has the same in Rust.
"""

import functools

import torch
from torch import nn
from torch.nn import functional

WIDTH, MIDDLE = 24, 2
# Features of a block of 2 x 2 pixels: four of each pixel and one of all.
FEATURES = 17
# Features of a pixel that are quotients are held within these.
MOST = 6


@functools.cache
def blur_matrix(size, sigma, reach, mirrored):
    """The Gaussian blur of a column as a matrix.

    Outside, the outermost pixel is repeated or, mirrored, twice it less the pixel as far inside: a slope goes on.
    """
    offsets = torch.arange(-reach, reach + 1).double()
    taps = torch.exp(-offsets * offsets / 2 / sigma / sigma)
    taps = (taps / taps.sum()).float()
    matrix, rows = torch.zeros(size, size), torch.arange(size)

    def add(columns, weights):
        matrix.view(-1).index_add_(0, rows * size + columns.clamp(0, size - 1), weights)

    for offset, tap in zip(range(-reach, reach + 1), taps):
        columns = rows + offset
        outside = ((columns < 0) | (columns >= size)).float() * mirrored
        add(columns, tap * (1 + outside))
        add(torch.where(columns < 0, -columns, 2 * size - 2 - columns), -tap * outside)
    return matrix


def blur(values, sigma, reach, mirrored=False):
    down, across = (blur_matrix(size, sigma, reach, mirrored) for size in values.shape[2:])
    return down @ (values @ across.T)


def hull(values):
    """The least and the largest of 3 x 3 pixels."""
    padded = functional.pad(values, (1, 1, 1, 1), mode="replicate")
    return -functional.max_pool2d(-padded, 3, 1), functional.max_pool2d(padded, 3, 1)


def convolve(layer, values):
    return layer(functional.pad(values, (1, 1, 1, 1), mode="replicate"))


class Network(nn.Module):
    """Four convolutions over blocks of 2 x 2 pixels."""

    def __init__(self):
        super().__init__()
        self.first = nn.Conv2d(FEATURES, WIDTH, 3)
        self.middle = nn.ModuleList([nn.Conv2d(WIDTH, WIDTH, 3) for _ in range(MIDDLE)])
        self.last = nn.Conv2d(WIDTH, 4, 3)
        for layer in [self.first, *self.middle]:
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
            nn.init.zeros_(layer.bias)
        for layer in self.middle:
            layer.weight.data *= 0.5
        # It starts close to changing nothing.
        nn.init.normal_(self.last.weight, 0, 1e-2)
        nn.init.zeros_(self.last.bias)

    def forward(self, filled, measured):
        """filled: [channels, 1, even height, even width]; measured: the same, 1 or 0.

        Measured pixels stay as they are; others stay between the least and the largest of their 3 x 3.
        """
        # Both are zero on planes.
        detail = filled - blur(filled, 1.5, 4, mirrored=True)
        fine = detail - blur(detail, 1.5, 4)
        near = blur(fine * fine, 1.0, 3).clamp_min(0).sqrt()
        inverse = 1 / (blur(detail * detail, 2.5, 6).clamp_min(0).sqrt() + 1e-18)
        low, high = hull(filled)
        span = high - low
        relative = (detail * inverse).clamp(-MOST, MOST)
        pixels = torch.cat([relative, relative * measured, measured - 0.5, (span * inverse).clamp(max=MOST) / MOST - 0.5], 1)
        blocks = torch.cat([functional.pixel_unshuffle(pixels, 2), functional.avg_pool2d(near * inverse, 2)], 1)
        hidden = functional.relu(convolve(self.first, blocks.contiguous(memory_format=torch.channels_last)))
        for layer in self.middle:
            hidden = functional.relu(convolve(layer, hidden) + hidden)
        added = functional.pixel_shuffle(convolve(self.last, hidden), 2) * torch.minimum(near, span)
        corrected = torch.minimum(torch.maximum(filled + added, low), high)
        return torch.where(measured > 0, filled, corrected)


def shrunk(weights, factor):
    """The weights with this share of the correction."""
    return {name: value * factor if name.startswith("last.") else value for name, value in weights.items()}


def write(path, weights):
    """Layer by layer the weights as [out][in][row][column] and then the biases: 32 bits each, little-endian, without a header."""
    flat = torch.cat([value.reshape(-1) for value in weights.values()])
    path.parent.mkdir(parents=True, exist_ok=True)
    flat.numpy().astype("<f4").tofile(path)
    return len(flat)
