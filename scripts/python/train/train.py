"""Trains the network of the filter `cnn` and writes its weights; scripts/train says how it is used.

Two stages: all values linear; then, from there and more gently, frames of long range in the domain in which lacuna fills them. The weights are
means over the last some hundred steps, and the correction is shrunk by SHRINK: on the validation that gave away 0.06 dB in the mean and left 3
of 448 fills that lose more than 0.2 dB, instead of 9.

The same machine makes the same weights again: seeds are fixed, and one thread does it all. Another may round otherwise.
"""

import argparse
import dataclasses
import pathlib
import time

import numpy as np
import torch
from torch.nn import functional

import data
import network
from optimizer import optimizers
from patches import UNLIMITED, Patches
from validation import validate

ROOT = pathlib.Path(__file__).resolve().parents[3]
WEIGHTS = ROOT / "filters" / "src" / "network" / "weights.f32"


@dataclasses.dataclass
class Stage:
    """steps: how many; rate: of learning, at its largest; penalty: how much more it counts at the end if a patch got worse."""

    name: str
    steps: int
    rate: float
    penalty: float
    long_range: bool


STAGES = (Stage("linear", 22000, 3e-3, 2, False), Stage("long range", 7500, 1e-3, 4, True))
SHRINK = 0.8
# Errors below this share of their frame's count less and less.
FLOOR = 0.2
# Steps between lines of the log.
REPORT = 500


def rate_at(stage, step):
    """Up in a hundred steps, then down along a cosine to a fiftieth."""
    return stage.rate * min(1, (step + 1) / 100) * (0.5 * (1 + np.cos(np.pi * step / stage.steps)) * 0.98 + 0.02)


def penalty_at(stage, step):
    """From a fifth of the stage to a half it grows: there from the start, nothing would be learnt, as to change nothing is safest."""
    return stage.penalty * np.clip(step / stage.steps / 0.3 - 0.67, 0, 1)


def log_ratios(net, batch):
    """Of each patch, the logarithm of its error over the one before."""
    filled, truth, measured, counted, white = batch
    black = torch.where(white < UNLIMITED, 0 * white, -white)
    result, truth, filled = (torch.minimum(torch.maximum(values, black), white) for values in (net(filled, measured), truth, filled))
    after, before = (((values - truth) ** 2 * counted).sum((1, 2, 3)) / counted.sum((1, 2, 3)) for values in (result, filled))
    return torch.log((after + FLOOR) / (before + FLOOR))


def train(net, stage, patches):
    """Trains in place and returns the averaged weights."""
    several = optimizers(net, stage.rate)
    mean = {name: value.clone() for name, value in net.state_dict().items()}
    started, total = time.monotonic(), 0
    for step in range(stage.steps):
        for optimizer in several:
            optimizer.param_groups[0]["lr"] = rate_at(stage, step)
        ratios = log_ratios(net, patches.batch())
        loss = (ratios + penalty_at(stage, step) * functional.relu(ratios)).mean()
        net.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        for optimizer in several:
            optimizer.step()
        with torch.no_grad():
            decay = min(0.998, (step + 1) / (step + 20))
            for name, value in net.state_dict().items():
                mean[name].mul_(decay).add_(value, alpha=1 - decay)
        total += ratios.mean().item()
        if (step + 1) % REPORT == 0:
            decibels = total / REPORT * 10 / np.log(10)
            print(f"{stage.name}: step {step + 1} of {stage.steps}, {time.monotonic() - started:.0f} s, error {decibels:+.4f} dB", flush=True)
            total = 0
    return mean


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", type=pathlib.Path, help="folder that keeps the data for the next time")
    parser.add_argument("--output", type=pathlib.Path, default=WEIGHTS, help="where the weights go [default: filters/src/network/weights.f32]")
    parser.add_argument("--steps", type=int, default=STAGES[0].steps, help="fewer, to try it out: of the first stage, the second in proportion")
    parser.add_argument("--frames", type=int, default=data.WHOLE, help="fewer, to try it out: for training, the validation in proportion")
    parser.add_argument("--data-only", action="store_true", help="make frames, masks and fills, and stop")
    arguments = parser.parse_args()
    started = time.monotonic()
    validation, training = (data.load(arguments.work, name, arguments.frames) for name in ("validation", "training"))
    if arguments.data_only:
        return
    torch.set_num_threads(1)
    weights = None
    for stage in STAGES:
        torch.manual_seed(0)
        stage = dataclasses.replace(stage, steps=round(stage.steps * arguments.steps / STAGES[0].steps))
        net = network.Network().to(memory_format=torch.channels_last)
        if weights:
            net.load_state_dict(weights)
        patches = Patches(training, stage.long_range, seed=0)
        print(f"{stage.name}: {len(patches.usable)} of {len(patches.scales)} fills, {(patches.scales > 0).sum()} of them of long range", flush=True)
        weights = train(net, stage, patches)
        validate(stage.name, net, weights, validation, stage.long_range)
    weights = network.shrunk(weights, SHRINK)
    validate(f"shrunk to {SHRINK}", net, weights, validation, True)
    count = network.write(arguments.output, weights)
    print(f"{arguments.output}: {count} weights, after {time.monotonic() - started:.0f} s")


main()
