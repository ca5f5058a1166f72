"""The pairwise ranking loss against a slow loop, and its gradients."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip('torch')

import torch

from offradar_ros.lab.training.losses.pairwise_ranking import pairwise_ranking


def slow_pairwise_ranking(uncertainties: list[float], severities: list[float], margin: float) -> float:
    total = weights = 0.0
    for u, s in zip(uncertainties, severities, strict=True):
        for other_u, other_s in zip(uncertainties, severities, strict=True):
            if s > other_s:
                weights += s - other_s
                total += (s - other_s) * math.log1p(math.exp((math.log(other_u) - math.log(u)) / margin))
    return total / weights


def test_the_loss_equals_its_formula() -> None:
    rng = np.random.default_rng(1)
    u, s = rng.uniform(0.2, 2.0, 8), rng.uniform(0.0, 1.0, 8)
    s[:3] = 0.0
    loss = pairwise_ranking(torch.from_numpy(u), torch.from_numpy(s), 0.3)
    assert float(loss) == pytest.approx(slow_pairwise_ranking(u.tolist(), s.tolist(), 0.3))


def test_the_gradient_is_that_of_finite_differences() -> None:
    rng = np.random.default_rng(2)
    u = torch.from_numpy(rng.uniform(0.2, 2.0, 6)).requires_grad_()
    s = torch.from_numpy(rng.uniform(0.0, 1.0, 6))
    assert torch.autograd.gradcheck(lambda x: pairwise_ranking(x, s, 0.5), (u,))


def test_the_right_order_has_a_lower_loss_than_none_and_the_wrong_one_a_higher() -> None:
    s = torch.tensor([0.0, 0.2, 0.9])
    right, none, wrong = (
        float(pairwise_ranking(torch.tensor(u), s, 0.1)) for u in ([0.5, 0.7, 0.9], [0.7, 0.7, 0.7], [0.9, 0.7, 0.5])
    )
    assert right < none < wrong


@pytest.mark.parametrize('severities', [[math.nan] * 3, [0.4] * 3, [math.nan, 0.2, math.nan]])
def test_without_known_differences_the_loss_and_its_gradient_are_zero(severities: list[float]) -> None:
    u = torch.tensor([0.5, 1.0, 2.0], requires_grad=True)
    loss = pairwise_ranking(u, torch.tensor(severities), 0.1)
    torch.autograd.backward(loss)
    assert loss.item() == 0.0
    assert u.grad is not None
    assert not u.grad.any()
