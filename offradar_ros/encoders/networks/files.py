"""Networks to and from weights files. Needs torch."""

from __future__ import annotations

from pathlib import Path

import torch

from offradar_ros.encoders.networks.network import Network
from offradar_ros.encoders.networks.registry import make_network
from offradar_ros.encoders.weights import load_weights, save_weights
from offradar_ros.encoders.weights_header import WeightsHeader
from offradar_ros.errors import ModelError


def save_network(path: str | Path, network: Network, description: str = '', half: bool = False) -> WeightsHeader:
    """Write a network's weights and settings, with `half` in half precision (see `save_weights`)."""
    tensors = {name: tensor.detach().cpu().numpy() for name, tensor in network.state_dict().items()}
    return save_weights(path, network.config, tensors, description, half)


def load_network(path: str | Path) -> tuple[Network, WeightsHeader]:
    """The network of a weights file, in evaluation mode and single precision; ModelError if tensors do not match."""
    header, tensors = load_weights(path)
    network = make_network(header.config)
    expected = network.state_dict()
    for name, tensor in expected.items():
        if name not in tensors:
            raise ModelError(f'{path}: tensor {name} is missing')
        if tensors[name].shape != tuple(tensor.shape):
            raise ModelError(f'{path}: tensor {name}: expected shape {tuple(tensor.shape)}, got {tensors[name].shape}')
    unknown = sorted(tensors.keys() - expected.keys())
    if unknown:
        raise ModelError(
            f'{path}: tensor {unknown[0]} is not part of a {header.config.backbone} {header.config.method} network'
        )
    network.load_state_dict(
        {name: torch.from_numpy(tensors[name]).to(tensor.dtype) for name, tensor in expected.items()}, assign=True
    )
    return network.eval(), header
