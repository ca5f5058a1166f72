"""Two processes train with the mean of their gradients and the buffers of the first."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip('torch')

import torch
from torch import nn

from offradar_ros.lab.training.objective import Outputs, Views, losses_of
from offradar_ros.lab.training.parallel import Group, process_group

PROJECT = Path(__file__).resolve().parents[3]


class LineObjective:
    """Two terms of a small network with batch normalisation and a part that no term uses."""

    def __init__(self) -> None:
        torch.manual_seed(3)
        self.normalisation = nn.BatchNorm1d(3)
        self.line = nn.Sequential(nn.Linear(4, 3), self.normalisation)
        # Gradients are averaged over the parameters of any module.
        self.network: Any = nn.ModuleDict({'line': self.line, 'unused': nn.Linear(2, 2)})

    @property
    def running_mean(self) -> torch.Tensor:
        assert self.normalisation.running_mean is not None
        return self.normalisation.running_mean

    def outputs(self, images: torch.Tensor) -> Outputs:
        return (self.line(images),)

    def losses(self, outputs: Outputs, views: Views, step: int) -> dict[str, torch.Tensor]:
        (out,) = outputs
        return {'square': out.square().mean() * (step + 1), 'severity': (out[:, 0] * views.severities).mean()}


def learn(losses: dict[str, torch.Tensor]) -> None:
    torch.autograd.backward(torch.stack(list(losses.values())).sum())


def views_of(rank: int, step: int) -> Views:
    torch.manual_seed(10 * step + rank)
    return Views(torch.randn(6, 4), torch.rand(6))


def compare() -> None:
    """Run and checked by each of two processes."""
    with process_group('cpu') as group:
        assert group.size == 2
        ours, alone = LineObjective(), [LineObjective() for _ in range(2)]
        losses = group.data_parallel(ours)
        for step in range(3):
            if group.rank == 1:
                ours.running_mean.fill_(99.0)
            for objective in (ours, *alone):
                objective.network.zero_grad(set_to_none=True)
            learn(losses(views_of(group.rank, step), step))
            for rank, objective in enumerate(alone):
                learn(losses_of(objective, views_of(rank, step), step))
            used = zip(*(objective.line.named_parameters() for objective in (ours, *alone)), strict=True)
            for (name, found), (_, first), (_, second) in used:
                assert found.grad is not None and first.grad is not None and second.grad is not None
                assert torch.allclose(found.grad, (first.grad + second.grad) / 2, rtol=1e-5, atol=1e-7), name
            assert all(parameter.grad is None for parameter in ours.network['unused'].parameters())
            # Each process starts from the first one's statistics and adds its own batch to them.
            expected = alone[group.rank].running_mean
            assert torch.allclose(ours.running_mean, expected, rtol=1e-5, atol=1e-7)
            alone[1].normalisation.load_state_dict(alone[0].normalisation.state_dict())
        compare_frozen(group)
        assert group.broadcast((1.0 + group.rank, 2.0)) == (1.0, 2.0)
        assert group.any(group.rank == 1)
        assert not group.any(False)
        print('agreed', flush=True)


def compare_frozen(group: Group) -> None:
    """Gradients are averaged over the parameters that are left after some were frozen during the run."""
    ours, alone = LineObjective(), [LineObjective() for _ in range(2)]
    learn(group.data_parallel(ours)(views_of(group.rank, 0), 0))
    for objective in (ours, *alone):
        objective.line[0].requires_grad_(False)
        objective.network.zero_grad(set_to_none=True)
    alone[0].normalisation.load_state_dict(ours.normalisation.state_dict())
    alone[1].normalisation.load_state_dict(ours.normalisation.state_dict())
    losses = group.data_parallel(ours)
    for step in range(1, 3):
        for objective in (ours, *alone):
            objective.network.zero_grad(set_to_none=True)
        learn(losses(views_of(group.rank, step), step))
        for rank, objective in enumerate(alone):
            learn(losses_of(objective, views_of(rank, step), step))
        weights = [objective.normalisation.weight.grad for objective in (ours, *alone)]
        assert weights[0] is not None and weights[1] is not None and weights[2] is not None
        assert torch.allclose(weights[0], (weights[1] + weights[2]) / 2, rtol=1e-5, atol=1e-7)
        assert all(parameter.grad is None for parameter in ours.line[0].parameters())


def test_one_process_uses_the_losses_directly() -> None:
    with process_group('cpu') as group:
        objective, views = LineObjective(), views_of(0, 0)
        terms = group.data_parallel(objective)(views, 2)
        assert terms == losses_of(objective, views, 2)


@pytest.mark.timeout(600)
def test_two_processes_average_their_gradients() -> None:
    command = [sys.executable, '-m', 'torch.distributed.run', '--standalone', '--nproc-per-node', '2', __file__]
    environment = {**os.environ, 'PYTHONPATH': str(PROJECT), 'OMP_NUM_THREADS': '1'}
    done = subprocess.run(command, cwd=PROJECT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count('agreed') == 2


if __name__ == '__main__':
    compare()
