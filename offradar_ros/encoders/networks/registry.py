"""Every learned method's network by name. Needs torch."""

from __future__ import annotations

from collections.abc import Callable

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.bc_radar import BcRadarNetwork
from offradar_ros.encoders.networks.mc_dropout import McDropoutNetwork
from offradar_ros.encoders.networks.stun import StunNetwork
from offradar_ros.encoders.networks.vae import VaeNetwork
from offradar_ros.encoders.networks.variational import VariationalNetwork

Network = BcRadarNetwork | McDropoutNetwork | StunNetwork | VaeNetwork | VariationalNetwork

NETWORKS: dict[str, Callable[[NetworkConfig], Network]] = {
    'variational': VariationalNetwork,
    'bc_radar': BcRadarNetwork,
    'vae': VaeNetwork,
    'mc_dropout': McDropoutNetwork,
    'stun': StunNetwork,
}


def make_network(config: NetworkConfig) -> Network:
    """The network of `config.method`, initialised from torch's seed."""
    return NETWORKS[config.method](config)
