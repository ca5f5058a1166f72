"""The level of U over clean scans against a loop, and its effect in the second stage."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

torch = pytest.importorskip('torch')

from offradar_ros.encoders.network_config import NetworkConfig  # noqa: E402
from offradar_ros.encoders.networks.variational import VariationalNetwork, uncertainty  # noqa: E402
from offradar_ros.lab.training.config import RefinementConfig  # noqa: E402
from offradar_ros.lab.training.losses.clean_level import clean_level  # noqa: E402
from offradar_ros.lab.training.refinement import SearchedScans, train_variance  # noqa: E402


def test_the_level_against_a_loop_over_pairs() -> None:
    rng = np.random.default_rng(3)
    u, worlds, counts = np.exp(rng.normal(0.2, 0.5, 40)), rng.integers(0, 6, 40), rng.random(40) < 0.6
    worlds[0], counts[0] = 9, True  # alone in its world
    squares = []
    for world in range(10):
        own = [math.log(value) for value, w, c in zip(u, worlds, counts, strict=True) if w == world and c]
        products = [a * b for i, a in enumerate(own) for j, b in enumerate(own) if i != j]
        if products:
            squares.append(sum(products) / len(products))
    found = clean_level(torch.from_numpy(u), torch.from_numpy(worlds), torch.from_numpy(counts))
    assert found.item() == pytest.approx(sum(squares) / len(squares))


def test_the_square_of_a_level_is_estimated_without_bias() -> None:
    generator = torch.Generator().manual_seed(1)
    worlds, counts = torch.zeros(4, dtype=torch.long), torch.ones(4, dtype=torch.bool)
    drawn = [clean_level((0.3 + torch.randn(4, generator=generator)).exp(), worlds, counts) for _ in range(20_000)]
    assert torch.stack(drawn).mean().item() == pytest.approx(0.3**2, abs=0.01)


def test_without_scans_that_count_it_is_zero_with_a_gradient() -> None:
    u = torch.ones(5, requires_grad=True)
    loss = clean_level(u, torch.arange(5), torch.ones(5, dtype=torch.bool))
    torch.autograd.backward(loss)
    assert loss.item() == 0.0
    assert u.grad is not None and not u.grad.any()


def test_clean_scans_of_every_world_get_a_u_of_one_and_others_keep_theirs() -> None:
    """Three worlds whose radars shift a feature: their clean U differ before, and not after; faults stay apart."""
    torch.manual_seed(1)
    config = NetworkConfig(backbone='compact', dimension=8, azimuths=16, range_bins=16)
    network = VariationalNetwork(config).eval()
    rng = np.random.default_rng(4)
    count, flat = 240, network.features.flat
    worlds, faults = np.arange(count) % 3, np.arange(count) % 2 == 1
    features = rng.random((count, flat)) * 0.5
    features[:, 0] += 2.0 * worlds
    features[:, 1] += 2.0 * faults
    with torch.no_grad():
        network.log_variance.weight[:, 0] = 0.3
        network.log_variance.weight[:, 1] = 0.3
    severities = faults * rng.random(count)
    scans = SearchedScans(
        torch.from_numpy(features).half(),
        torch.from_numpy(faults.astype(np.float32)),
        torch.from_numpy(np.where(faults, -0.5, 0.5).astype(np.float32)),
        torch.from_numpy(severities.astype(np.float32)),
        torch.from_numpy(worlds),
    )

    def u_of() -> np.ndarray:
        with torch.inference_mode():
            return uncertainty(network.log_variance_of(scans.features.float())).numpy()

    def medians() -> np.ndarray:
        return np.array([np.median(u_of()[(worlds == world) & ~faults]) for world in range(3)])

    before = medians()
    assert before.max() / before.min() > 2.0
    settings = RefinementConfig(steps=300, scans=120, learning_rate=1e-2, clean_weight=3.0, kl_weight=0.0)
    terms = list(train_variance(network, scans, settings, 1))
    assert terms[-1]['clean'] < terms[0]['clean']
    assert medians() == pytest.approx(1.0, abs=0.1)
    after = u_of()
    assert np.mean(after[faults][:, None] > after[~faults][None]) > 0.95
    plain = dataclasses.replace(settings, clean_weight=0.0)
    assert 'clean' not in next(train_variance(network, scans, plain, 1))
