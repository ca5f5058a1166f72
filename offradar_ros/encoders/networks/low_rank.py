"""Low-rank factorisation of convolutions, fitted to their responses to real scans. Needs torch.

After Zhang et al. (Accelerating very deep convolutional networks, 2015, linear case): the d responses of a convolution
at a pixel lie near a subspace of r dimensions, given by their covariance. With the r principal directions U, the
response Wx + b becomes U(UᵀW x) + c: r filters of the same size, then d filters of 1 × 1. The ranks of all
convolutions are chosen jointly.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from offradar_ros.encoders.networks.network import Network

_BATCH = 4
_BISECTIONS = 100


class Responses(NamedTuple):
    """Statistics of the responses of a convolution of d filters to the calibration scans.

    Attributes:
        mean: (d,) float64.
        directions: (d, d) float64, principal directions in columns, strongest first.
        energy: (d,) float64, share of the variance within the first 1 … d directions.
        pixels: output pixels for one image.
    """

    mean: NDArray[np.float64]
    directions: NDArray[np.float64]
    energy: NDArray[np.float64]
    pixels: int


def factorise(network: Network, images: NDArray[np.uint8], share: float) -> None:
    """Replace convolutions of the backbone in place, so that about `share` of the multiplications remains.

    `images` (N, H, W) uint8 must represent the scans in use, degraded ones included. A convolution that would not
    become cheaper is not replaced.
    """
    backbone = network.features.backbone
    convolutions = {name: module for name, module in backbone.named_modules() if isinstance(module, nn.Conv2d)}
    found = _responses(network, convolutions, images)
    for name, rank in ranks(convolutions, found, share).items():
        parent, _, last = name.rpartition('.')
        backbone.get_submodule(parent).register_module(last, _split(convolutions[name], found[name], rank))


def ranks(convolutions: dict[str, nn.Conv2d], found: dict[str, Responses], share: float) -> dict[str, int]:
    """The rank of each convolution to split: within `share` of the multiplications, the ranks that keep most energy.

    The energy is the product of the shares of all convolutions, as in the paper. With a Lagrange multiplier λ for each
    multiplication the convolutions are independent; λ is found by bisection so that their sum is within the budget.
    """
    costs = {name: _costs(layer, found[name].pixels) for name, layer in convolutions.items()}
    losses = {name: np.append(-np.log(found[name].energy[: len(cost) - 1]), 0.0) for name, cost in costs.items()}
    budget = share * sum(cost[-1] for cost in costs.values())

    def chosen(multiplier: float) -> dict[str, int]:
        return {name: int(np.argmin(losses[name] + multiplier * costs[name] / budget)) for name in costs}

    low, high = -12.0, 12.0
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        spent = sum(costs[name][at] for name, at in chosen(10.0**middle).items())
        low, high = (low, middle) if spent <= budget else (middle, high)
    return {name: at + 1 for name, at in chosen(10.0**high).items() if at < len(costs[name]) - 1}


def round_to_half_precision(network: Network) -> None:
    """Round kernels and matrices to half precision, as in the weights that the network is derived from."""
    with torch.no_grad():
        for parameter in network.parameters():
            if parameter.ndim >= 2:
                parameter.copy_(parameter.half())


def _costs(layer: nn.Conv2d, pixels: int) -> NDArray[np.float64]:
    """Multiplications for one image at ranks 1, 2, … that are cheaper, and then of the original convolution."""
    outputs, window = layer.out_channels, layer.weight[0].numel()
    whole = outputs * window
    split = np.arange(1, -(-whole // (window + outputs))) * (window + outputs)
    return pixels * np.append(split, whole).astype(np.float64)


def _split(layer: nn.Conv2d, found: Responses, rank: int) -> nn.Sequential:
    """The two convolutions of this rank; the mean response stays exact."""
    kept = found.directions[:, :rank]
    weight = layer.weight.detach().double().numpy()
    bias = np.zeros(layer.out_channels) if layer.bias is None else layer.bias.detach().double().numpy()
    within = nn.Conv2d(
        layer.in_channels,
        rank,
        (layer.kernel_size[0], layer.kernel_size[1]),
        (layer.stride[0], layer.stride[1]),
        (int(layer.padding[0]), int(layer.padding[1])),
        bias=False,
    )
    onto = nn.Conv2d(rank, layer.out_channels, 1)
    assert onto.bias is not None
    with torch.no_grad():
        within.weight.copy_(torch.from_numpy(np.tensordot(kept.T, weight, 1)))
        onto.weight.copy_(torch.from_numpy(kept)[:, :, None, None])
        onto.bias.copy_(torch.from_numpy(found.mean + kept @ (kept.T @ (bias - found.mean))))
    return nn.Sequential(within, onto)


def _responses(network: Network, convolutions: dict[str, nn.Conv2d], images: NDArray[np.uint8]) -> dict[str, Responses]:
    """Statistics of the responses of each convolution, in one pass over the images."""
    sums: dict[str, torch.Tensor] = {}
    products: dict[str, torch.Tensor] = {}
    outputs: dict[str, int] = {}

    def watch(name: str) -> Callable[[nn.Module, tuple[torch.Tensor, ...], torch.Tensor], None]:
        def seen(_layer: nn.Module, _inputs: tuple[torch.Tensor, ...], response: torch.Tensor) -> None:
            columns = response.transpose(0, 1).flatten(1)
            sums[name] = sums.get(name, torch.zeros(())) + columns.double().sum(dim=1)
            products[name] = products.get(name, torch.zeros(())) + (columns @ columns.T).double()
            outputs[name] = outputs.get(name, 0) + columns.shape[1]

        return seen

    hooks = [layer.register_forward_hook(watch(name)) for name, layer in convolutions.items()]
    with torch.no_grad():
        for start in range(0, len(images), _BATCH):
            network.embed(torch.from_numpy(images[start : start + _BATCH]))
    for hook in hooks:
        hook.remove()
    return {
        name: _principal(sums[name] / count, products[name] / count, count // len(images))
        for name, count in outputs.items()
    }


def _principal(mean: torch.Tensor, product: torch.Tensor, pixels: int) -> Responses:
    values, directions = np.linalg.eigh((product - torch.outer(mean, mean)).numpy())
    values, directions = np.maximum(values[::-1], 0.0), directions[:, ::-1].copy()
    energy = np.cumsum(values) / max(float(values.sum()), np.finfo(float).tiny)
    return Responses(mean.numpy(), directions, np.maximum(energy, np.finfo(float).tiny), pixels)
