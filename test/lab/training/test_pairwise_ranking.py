"""U learns to order scans by severity, as far as that is known."""

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


def test_it_is_the_sum_that_it_says() -> None:
    rng = np.random.default_rng(1)
    u, s = rng.uniform(0.2, 2.0, 8), rng.uniform(0.0, 1.0, 8)
    s[:3] = 0.0
    loss = pairwise_ranking(torch.from_numpy(u), torch.from_numpy(s), 0.3)
    assert float(loss) == pytest.approx(slow_pairwise_ranking(u.tolist(), s.tolist(), 0.3))


def test_it_knows_the_way_down() -> None:
    rng = np.random.default_rng(2)
    u = torch.from_numpy(rng.uniform(0.2, 2.0, 6)).requires_grad_()
    s = torch.from_numpy(rng.uniform(0.0, 1.0, 6))
    assert torch.autograd.gradcheck(lambda x: pairwise_ranking(x, s, 0.5), (u,))


def test_the_right_order_costs_less_than_none_and_the_wrong_one_more() -> None:
    s = torch.tensor([0.0, 0.2, 0.9])
    right, none, wrong = (
        float(pairwise_ranking(torch.tensor(u), s, 0.1)) for u in ([0.5, 0.7, 0.9], [0.7, 0.7, 0.7], [0.9, 0.7, 0.5])
    )
    assert right < none < wrong


@pytest.mark.parametrize('severities', [[math.nan] * 3, [0.4] * 3, [math.nan, 0.2, math.nan]])
def test_where_no_two_are_known_to_differ_nothing_is_learned(severities: list[float]) -> None:
    u = torch.tensor([0.5, 1.0, 2.0], requires_grad=True)
    loss = pairwise_ranking(u, torch.tensor(severities), 0.1)
    torch.autograd.backward(loss)
    assert loss.item() == 0.0
    assert u.grad is not None
    assert not u.grad.any()
