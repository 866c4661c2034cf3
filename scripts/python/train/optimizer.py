"""Muon: momentum made orthogonal by Newton-Schulz iterations (Jordan et al. 2024), for the weights of convolutions; Adam has all others."""

import torch

# Coefficients of the iteration by its author: singular values come close to 1 in five steps.
LINEAR, CUBIC, QUINTIC, STEPS = 3.4445, -4.7750, 2.0315, 5


class Muon(torch.optim.Optimizer):
    def __init__(self, parameters, lr, momentum=0.95):
        super().__init__(parameters, {"lr": lr, "momentum": momentum})

    @torch.no_grad()
    def step(self):
        for group in self.param_groups:
            for parameter in group["params"]:
                gradient = parameter.grad.reshape(len(parameter), -1)
                mean = self.state[parameter].setdefault("mean", torch.zeros_like(gradient))
                mean.lerp_(gradient, 1 - group["momentum"])
                update = orthogonal(gradient.lerp(mean, group["momentum"]))
                # The size of a step of Adam's.
                parameter.add_(update.reshape(parameter.shape), alpha=-group["lr"] * 0.2 * max(update.shape) ** 0.5)


def orthogonal(matrix):
    matrix = matrix / (matrix.norm() + 1e-7)
    for _ in range(STEPS):
        product = matrix @ matrix.T
        matrix = LINEAR * matrix + (CUBIC * product + QUINTIC * product @ product) @ matrix
    return matrix


def optimizers(network, rate):
    matrices = [network.first.weight, *[layer.weight for layer in network.middle]]
    others = [parameter for parameter in network.parameters() if all(parameter is not matrix for matrix in matrices)]
    return Muon(matrices, rate), torch.optim.Adam(others, lr=rate)
