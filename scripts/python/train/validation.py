"""Validates the network of the filter `cnn`: what it gains on procedural frames that it was not trained on."""

import numpy as np
import torch

import domain
from data import DENSITIES

# Losses that are told, in dB.
LOSSES = (0.1, 0.2)


def psnr(image, truth):
    """Values clipped to 0 and 1, all pixels; at most 120."""
    error = (image.astype(np.float64).clip(0, 1) - truth.astype(np.float64).clip(0, 1)) ** 2
    return -10 * np.log10(max(error.mean(), 1e-12))


def corrected(network, filled, measured, long_range):
    """The whole frame, as lacuna corrects it, or linear at any range."""
    scale = domain.scale_of(filled[measured]) if long_range else 0
    planes = torch.from_numpy(domain.forward(filled, scale)).permute(2, 0, 1)[:, None]
    mask = torch.from_numpy(measured.astype(np.float32))[None, None].expand(planes.shape)
    with torch.no_grad():
        result = network(planes, mask)[:, 0].permute(1, 2, 0).numpy()
    return np.where(measured[..., None], filled, domain.back(result, scale))


def validate(title, network, weights, data, long_range):
    """Prints a table of gains, the mean over all fills, how many lose, and the worst."""
    network.load_state_dict(weights)
    gains, kinds = [], data.kinds[data.frame_of]
    for job, frame in enumerate(data.frame_of):
        before = psnr(data.fills[job], data.frames[frame])
        after = psnr(corrected(network, data.fills[job], data.masks[job], long_range), data.frames[frame])
        gains.append((after - before, before))
    gained = np.array([gain for gain, _ in gains])
    print(f"{title}: dB gained, mean / least / most\n| kind | " + " | ".join(f"{density:.0%}" for density in DENSITIES) + " |")
    print("|---|" + "---|" * len(DENSITIES))
    for kind in dict.fromkeys(data.kinds):
        found = [gained[(kinds == kind) & (data.densities == density)] for density in DENSITIES]
        print(f"| {kind} | " + " | ".join(f"{part.mean():+.2f} / {part.min():+.2f} / {part.max():+.2f}" for part in found) + " |")
    losing = ", ".join(f"{(gained < -loss).sum()} lose more than {loss}" for loss in LOSSES)
    print(f"{len(gained)} fills: mean {gained.mean():+.3f}; {losing}; the worst:")
    for job in np.argsort(gained)[:6]:
        print(f"  {kinds[job]} {data.frame_of[job]} at {data.densities[job]:.0%}: {gains[job][1]:.1f} dB {gained[job]:+.2f}", flush=True)
