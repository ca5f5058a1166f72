"""The network of a learned method. Needs torch."""

from __future__ import annotations

import pkgutil

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.network import Network
from offradar_ros.encoders.registry import ENCODERS


def make_network(config: NetworkConfig) -> Network:
    """The network of `config.method`, initialised randomly with torch's generator."""
    network: Network = pkgutil.resolve_name(ENCODERS[config.method].network)(config)
    return network
