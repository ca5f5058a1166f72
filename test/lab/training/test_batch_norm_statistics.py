"""Statistics of batch normalisation are means over all batches, not over the last ones."""

from __future__ import annotations

import pytest

pytest.importorskip('torch')

import torch
from torch import nn

from offradar_ros.lab.training.batch_norm_statistics import reestimate_batch_norm


def network() -> nn.Sequential:
    torch.manual_seed(0)
    return nn.Sequential(nn.Conv2d(1, 4, 3, bias=False), nn.BatchNorm2d(4), nn.ReLU())


def test_statistics_are_means_over_batches() -> None:
    net = network()
    convolution, normalisation, _ = net
    assert isinstance(normalisation, nn.BatchNorm2d)
    assert normalisation.running_mean is not None and normalisation.running_var is not None
    batches = [torch.randn(6, 1, 8, 8) * scale + scale for scale in (1.0, 5.0, 20.0)]
    normalisation.running_mean.fill_(99.0)
    reestimate_batch_norm(net, batches)
    maps = [convolution(batch) for batch in batches]
    mean = torch.stack([m.mean(dim=(0, 2, 3)) for m in maps]).mean(dim=0)
    variance = torch.stack([m.var(dim=(0, 2, 3)) for m in maps]).mean(dim=0)
    assert torch.allclose(normalisation.running_mean, mean, rtol=1e-4, atol=1e-5)
    assert torch.allclose(normalisation.running_var, variance, rtol=1e-4)


def test_weights_and_momentum_do_not_change_and_the_network_is_in_evaluation_mode() -> None:
    net = network().train()
    before = {name: value.clone() for name, value in net.named_parameters()}
    reestimate_batch_norm(net, [torch.randn(6, 1, 8, 8)])
    assert not any(part.training for part in net.modules())
    assert net[1].momentum == 0.1
    assert all(torch.equal(value, before[name]) for name, value in net.named_parameters())


def test_a_network_without_normalisation_needs_no_batch() -> None:
    net = nn.Sequential(nn.Conv2d(1, 4, 3), nn.ReLU()).train()
    reestimate_batch_norm(net, iter([]))
    assert not net.training
