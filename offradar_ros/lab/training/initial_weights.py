"""Start a network from the weights of another one, also of one that sees images of another size.

Convolutions do not depend on the size of the image, linear layers over the feature map do: VGG-16 at 128 pixels ends in
4 × 4 cells, at 256 in 8 × 8. Each cell covers a part of the field of view, and so a weight of a cell is passed on to
the cells of the new map that lie within it, in proportion to the area. The output is then the same for a map that is
constant within each old cell, and close for a smooth one, also where one map covers more ground than the other.
Bilinear interpolation of
the weights mixes cells, and is farther off for both.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import nn

from offradar_ros.encoders.network_config import CARTESIAN, NetworkConfig
from offradar_ros.encoders.networks.files import load_network
from offradar_ros.encoders.networks.network import Network
from offradar_ros.errors import ModelError

_SAME = ('method', 'backbone', 'dimension')


def start_from(network: Network, path: str | Path) -> None:
    """Set the weights of `network` from a weights file.

    ModelError for a file that is no network of the same method, backbone and dimension, or one of which another layer
    than those over the feature map depends on the size of the image.
    """
    source, _ = load_network(path)
    for name in _SAME:
        expected, found = getattr(network.config, name), getattr(source.config, name)
        if expected != found:
            raise ModelError(f'{path}: expected initial weights with {name} = {expected}, got {found}')
    given, state = source.state_dict(), network.state_dict()
    linear = {name for name, layer in network.named_modules() if isinstance(layer, nn.Linear)}
    for name, tensor in state.items():
        if tensor.dtype == torch.bool:  # masks of MC Dropout, which are not learned
            continue
        carried = given[name]
        for axis in range(tensor.dim()) if name.rpartition('.')[0] in linear else ():
            if _is_over_map(source, carried, axis) and _is_over_map(network, tensor, axis):
                carried = _carried(carried, axis, source, network)
        if carried.shape != tensor.shape:
            raise ModelError(
                f'{path}: tensor {name} depends on the size of the image: expected initial weights for '
                f'{network.config.image}, got {source.config.image}'
            )
        state[name] = carried.to(tensor.dtype)
    network.load_state_dict(state)


def _is_over_map(network: Network, tensor: torch.Tensor, axis: int) -> bool:
    """Whether an axis of a tensor of a linear layer runs over the flattened feature map, which is not pooled."""
    return network.features.pool is None and tensor.shape[axis] == network.features.flat


def _carried(tensor: torch.Tensor, axis: int, source: Network, network: Network) -> torch.Tensor:
    """`tensor` with the cells of one feature map along `axis` carried over to those of the other."""
    # Along the last axis are the weights of sums over the map, along the first values of each cell of a map.
    is_sum = axis == tensor.dim() - 1 and tensor.dim() == 2
    last = tensor.movedim(axis, -1).float()
    maps = last.reshape(*last.shape[:-1], *source.features.shape)
    rows, columns = (
        _shares(old, new) if is_sum else _means(old, new)
        for old, new in zip(_edges_m(source), _edges_m(network), strict=True)
    )
    carried = torch.einsum('...ij,ri,cj->...rc', maps, rows, columns).flatten(-3)
    return carried.movedim(-1, axis)


def _edges_m(network: Network) -> tuple[torch.Tensor, torch.Tensor]:
    """Edges of the cells of the feature map along rows and columns.

    They are metres from the sensor, but for the rows of polar maps, which are frequencies over azimuth.
    """
    config: NetworkConfig = network.config
    _, rows, columns = network.features.shape
    if config.backbone in CARTESIAN:
        half_m = 0.5 * config.side_px * config.resolution_m
        return torch.linspace(-half_m, half_m, rows + 1), torch.linspace(-half_m, half_m, columns + 1)
    return torch.arange(rows + 1.0), torch.linspace(0.0, config.reach_m, columns + 1)


def _overlaps(old: torch.Tensor, new: torch.Tensor) -> torch.Tensor:
    """(n, o) common lengths of n new and o old cells."""
    ends = torch.minimum(new[1:, None], old[None, 1:])
    return (ends - torch.maximum(new[:-1, None], old[None, :-1])).clamp(min=0.0)


def _shares(old: torch.Tensor, new: torch.Tensor) -> torch.Tensor:
    """(n, o) share of each old cell that is within a new one."""
    return _overlaps(old, new) / old.diff()


def _means(old: torch.Tensor, new: torch.Tensor) -> torch.Tensor:
    """(n, o) share of each new cell that is within an old one."""
    return _overlaps(old, new) / new.diff()[:, None]
