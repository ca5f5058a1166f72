"""Averaged weights against a loop over numbers, and that they are what is validated and saved."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip('torch')

from offradar_ros.encoders.network_config import NetworkConfig  # noqa: E402
from offradar_ros.encoders.networks.bc_radar import BcRadarNetwork  # noqa: E402
from offradar_ros.lab.training.weight_average import WeightAverage  # noqa: E402

CONFIG = NetworkConfig(method='bc_radar', backbone='compact', dimension=4, azimuths=16, range_bins=16)


def averaged(decay: float, **layout: Any) -> tuple[Any, Any, WeightAverage]:
    """A network, that of its averaged weights, and the average."""
    torch.manual_seed(1)
    network: Any = BcRadarNetwork(CONFIG).to(**layout)
    average = WeightAverage(network, decay)
    return network, average.network, average


@pytest.mark.parametrize('decay', [0.3, 0.9])
def test_averages_against_a_loop(decay: float) -> None:
    network, mean, average = averaged(decay)
    expected = network.head.weight.detach().double().numpy().copy()
    rng = np.random.default_rng(2)
    for step in range(30):
        new = rng.standard_normal(expected.shape)
        with torch.no_grad():
            network.head.weight.copy_(torch.from_numpy(new))
            network.features.backbone.reduce.normalise.running_mean.fill_(float(step))
        average.update(network, step)
        kept = min(decay, (1 + step) / (10 + step))
        for index in np.ndindex(*expected.shape):
            expected[index] = kept * expected[index] + (1.0 - kept) * new[index]
    assert mean.head.weight.numpy() == pytest.approx(expected, abs=1e-6)
    assert (mean.features.backbone.reduce.normalise.running_mean == 29.0).all()
    assert torch.equal(network.head.weight, torch.from_numpy(new).float()), 'the network itself is not averaged'


def test_the_initial_weights_are_soon_forgotten() -> None:
    network, mean, average = averaged(0.999)
    with torch.no_grad():
        mean.head.bias.fill_(1e3)
        network.head.bias.zero_()
    for step in range(20):
        average.update(network, step)
    assert float(mean.head.bias.abs().max()) < 1e-3


def test_the_layout_of_weights_in_memory_is_kept() -> None:
    network, mean, _ = averaged(0.9, memory_format=torch.channels_last)
    for mine, theirs in zip(mean.parameters(), network.parameters(), strict=True):
        assert mine.stride() == theirs.stride()
        assert not mine.requires_grad
