"""Statistics of batch normalisation are those of all batches alike, not of the last ones."""

from __future__ import annotations

import pytest

torch = pytest.importorskip('torch')

from torch import nn  # noqa: E402

from offradar_ros.lab.training.batch_norm_statistics import reestimate_batch_norm  # noqa: E402


def network() -> nn.Sequential:
    torch.manual_seed(0)
    return nn.Sequential(nn.Conv2d(1, 4, 3, bias=False), nn.BatchNorm2d(4), nn.ReLU())


def test_statistics_are_means_over_batches_whatever_was_there() -> None:
    net = network()
    batches = [torch.randn(6, 1, 8, 8) * scale + scale for scale in (1.0, 5.0, 20.0)]
    net[1].running_mean.fill_(99.0)
    reestimate_batch_norm(net, batches)
    maps = [net[0](batch) for batch in batches]
    mean = torch.stack([m.mean(dim=(0, 2, 3)) for m in maps]).mean(dim=0)
    variance = torch.stack([m.var(dim=(0, 2, 3)) for m in maps]).mean(dim=0)
    assert torch.allclose(net[1].running_mean, mean, rtol=1e-4, atol=1e-5)
    assert torch.allclose(net[1].running_var, variance, rtol=1e-4)


def test_weights_and_momentum_stay_and_the_network_is_left_in_evaluation() -> None:
    net = network().train()
    before = {name: value.clone() for name, value in net.named_parameters()}
    reestimate_batch_norm(net, [torch.randn(6, 1, 8, 8)])
    assert not any(part.training for part in net.modules())
    assert net[1].momentum == 0.1
    assert all(torch.equal(value, before[name]) for name, value in net.named_parameters())


def test_a_network_without_normalisation_takes_no_batch() -> None:
    net = nn.Sequential(nn.Conv2d(1, 4, 3), nn.ReLU()).train()
    reestimate_batch_norm(net, iter([]))
    assert not net.training
