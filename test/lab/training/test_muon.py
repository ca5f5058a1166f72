"""Orthogonal steps of matrices and kernels, AdamW's of all else."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn

from offradar_ros.lab.training.checkpoint import Progress, load_checkpoint, save_checkpoint
from offradar_ros.lab.training.muon import Muon, orthogonal


@settings(max_examples=40, deadline=None)
@given(rows=st.integers(1, 40), columns=st.integers(1, 40), seed=st.integers(0, 10**6), scale=st.floats(1e-4, 1e4))
def test_directions_stay_and_large_ones_become_equal(rows: int, columns: int, seed: int, scale: float) -> None:
    matrix = scale * torch.randn(rows, columns, generator=torch.Generator().manual_seed(seed)).double()
    left, values, right = torch.linalg.svd(matrix, full_matrices=False)
    found = left.T @ orthogonal(matrix) @ right.T
    assert (found - torch.diag(torch.diag(found))).abs().max() < 1e-6
    large = values > 0.05 * values.norm()
    assert ((torch.diag(found)[large] > 0.6) & (torch.diag(found)[large] < 1.25)).all()


def test_nothing_is_learned_from_a_gradient_of_zero() -> None:
    assert (orthogonal(torch.zeros(3, 5)) == 0.0).all()


def test_a_kernel_steps_as_the_matrix_of_its_outputs() -> None:
    gradient = torch.randn(6, 2, 3, 3, generator=torch.Generator().manual_seed(1))
    kernel, matrix = nn.Parameter(torch.ones(6, 2, 3, 3)), nn.Parameter(torch.ones(6, 18))
    for weight, grad in ((kernel, gradient), (matrix, gradient.reshape(6, 18))):
        optimiser = Muon([weight], lr=1e-3, matrix_rate=0.02, weight_decay=0.0)
        for _ in range(3):
            weight.grad = grad.clone()
            optimiser.step()
    torch.testing.assert_close(kernel.reshape(6, 18), matrix)
    # Three steps of 0.02 in each of six directions.
    assert (matrix - 1.0).norm().item() == pytest.approx(3 * 0.02 * 6**0.5, rel=0.25)


def test_vectors_step_as_with_adamw() -> None:
    mine, theirs = nn.Parameter(torch.arange(5.0)), nn.Parameter(torch.arange(5.0))
    muon = Muon([mine], lr=1e-2, matrix_rate=0.02, weight_decay=0.1)
    adamw = torch.optim.AdamW([theirs], lr=1e-2, weight_decay=0.1, fused=True)
    for step in range(4):
        for weight, optimiser in ((mine, muon), (theirs, adamw)):
            weight.grad = torch.arange(5.0) - step
            optimiser.step()
    assert torch.equal(mine, theirs)


def test_the_schedule_scales_the_rate_of_matrices_too() -> None:
    weight = nn.Parameter(torch.zeros(4, 4))
    optimiser = Muon([weight], lr=1e-3, matrix_rate=0.02, weight_decay=0.0)
    optimiser.param_groups[0]['lr'] = 5e-4
    weight.grad = torch.eye(4)
    optimiser.step()
    assert torch.diag(weight).mean().item() == pytest.approx(-0.01, rel=0.3)


def test_weights_decay_without_a_gradient_that_matters() -> None:
    weight = nn.Parameter(torch.ones(4, 4))
    optimiser = Muon([weight], lr=1e-3, matrix_rate=0.02, weight_decay=0.5)
    weight.grad = torch.zeros(4, 4)
    optimiser.step()
    torch.testing.assert_close(weight.detach(), torch.full((4, 4), 1.0 - 0.02 * 0.5))


def test_a_resumed_run_takes_the_same_steps(tmp_path: Path) -> None:
    def run(network: nn.Module, optimiser: Muon, steps: range) -> None:
        for step in steps:
            images = torch.randn(3, 2, 8, 8, generator=torch.Generator().manual_seed(step))
            optimiser.zero_grad(set_to_none=True)
            torch.autograd.backward(network(images).square().mean())
            optimiser.step()

    def fresh() -> tuple[nn.Module, Muon]:
        torch.manual_seed(0)
        network = nn.Sequential(nn.Conv2d(2, 4, 3), nn.BatchNorm2d(4), nn.Flatten(), nn.Linear(144, 5))
        network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        return network, Muon(network.parameters(), lr=1e-3, matrix_rate=0.02, weight_decay=0.01)

    whole, optimiser = fresh()
    run(whole, optimiser, range(6))
    stopped, optimiser = fresh()
    run(stopped, optimiser, range(3))
    save_checkpoint(tmp_path / 'c.safetensors', stopped, optimiser, Progress(3, 0.0, 0, {}, {}))
    resumed, optimiser = fresh()
    load_checkpoint(tmp_path / 'c.safetensors', resumed, optimiser)
    run(resumed, optimiser, range(3, 6))
    for name, tensor in whole.state_dict().items():
        assert torch.equal(tensor, resumed.state_dict()[name]), name


def test_a_scaled_step_that_overflows_is_left_out() -> None:
    matrix, vector = nn.Parameter(torch.ones(3, 3)), nn.Parameter(torch.ones(3))
    optimiser = Muon([matrix, vector], lr=1e-3, matrix_rate=0.02, weight_decay=0.0)
    scaler = torch.amp.GradScaler('cpu', init_scale=8.0)
    for overflow in (torch.inf, 1.0):
        optimiser.zero_grad(set_to_none=True)
        torch.autograd.backward(scaler.scale((matrix.sum() + vector.sum()) * overflow))
        scaler.unscale_(optimiser)
        scaler.step(optimiser)
        scaler.update()
        changed = [bool((weight != 1.0).all()) for weight in (matrix, vector)]
        assert changed == [overflow == 1.0] * 2


def test_a_closure_is_refused() -> None:
    optimiser = Muon([nn.Parameter(torch.zeros(2))], lr=1e-3, matrix_rate=0.02, weight_decay=0.0)
    with pytest.raises(ValueError, match='no closure'):
        optimiser.step(lambda: 0.0)
