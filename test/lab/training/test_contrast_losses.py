"""Losses compared with slow loops, and their gradients with finite differences."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip('torch')

import torch

from offradar_ros.lab.training.losses.batch_contrast import batch_contrast
from offradar_ros.lab.training.losses.hedged_contrast import hedged_contrast
from offradar_ros.lab.training.losses.nt_xent import nt_xent
from offradar_ros.lab.training.losses.prior_divergence import prior_divergence
from offradar_ros.lab.training.losses.reconstruction import reconstruction_error


def points(rows: int = 8, dimension: int = 5, seed: int = 0) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).normal(0.0, 3.0, (rows, dimension)))


def cosine(a: list[float], b: list[float]) -> float:
    dot = sum(x * y for x, y in zip(a, b, strict=True))
    return dot / math.sqrt(sum(x * x for x in a)) / math.sqrt(sum(x * x for x in b))


def slow_batch_contrast(rows: list[list[float]], temperature: float, weight: float) -> float:
    count = len(rows)
    total = 0.0
    for i in range(count):
        other = (i + count // 2) % count
        exponentials = [math.exp(cosine(rows[i], row) / temperature) for row in rows]
        negatives = [j for j in range(count) if j not in (i, other)]
        denominator = exponentials[other] + weight * sum(exponentials[j] for j in negatives)
        total -= math.log(exponentials[other] / denominator)
        for j in negatives:
            total -= weight * math.log(1.0 - exponentials[j] / denominator)
    return total / count


def slow_nt_xent(rows: list[list[float]], uncertainties: list[float], temperature: float) -> float:
    count = len(rows)
    total = 0.0
    for i in range(count):
        other = (i + count // 2) % count
        exponentials = {
            j: math.exp(cosine(rows[i], rows[j]) / (temperature * uncertainties[i])) for j in range(count) if j != i
        }
        total -= math.log(exponentials[other] / sum(exponentials.values()))
    return total / count


@pytest.mark.parametrize(('temperature', 'weight'), [(0.1, 1.0), (0.5, 1.0), (1.0, 1.0), (2.0, 0.5)])
def test_batch_contrast_equals_its_formula(temperature: float, weight: float) -> None:
    x = points()
    assert float(batch_contrast(x, temperature, weight)) == pytest.approx(
        slow_batch_contrast(x.tolist(), temperature, weight), rel=1e-9
    )


def test_batch_contrast_has_the_known_values_of_the_papers_setting() -> None:
    """m = 8, τ = 1, ω = 0.1: 1.630 for equal points, at best 0.718 (each place a corner of a simplex)."""
    alike = torch.ones(16, 8, dtype=torch.float64)
    assert float(batch_contrast(alike, 1.0, 0.1)) == pytest.approx(1.630, abs=1e-3)
    corners = torch.eye(8, dtype=torch.float64) - 1.0 / 8.0
    assert float(batch_contrast(torch.cat([corners, corners]), 1.0, 0.1)) == pytest.approx(0.718, abs=0.01)


@pytest.mark.parametrize('weight', [0.1, 1.0])
def test_batch_contrast_has_the_gradient_of_finite_differences(weight: float) -> None:
    x = points(6, 4).requires_grad_()
    assert torch.autograd.gradcheck(lambda p: batch_contrast(p, 0.7, weight), (x,))


def test_batch_contrast_is_finite_for_extreme_points() -> None:
    for extreme in (torch.zeros(6, 4), torch.ones(6, 4), torch.cat([torch.eye(3), -torch.eye(3)]) * 1e6):
        x = extreme.requires_grad_()
        for temperature in (0.01, 1.0):
            loss = batch_contrast(x, temperature, 0.1)
            (gradient,) = torch.autograd.grad(loss, x)
            assert torch.isfinite(loss)
            assert torch.isfinite(gradient).all()


def test_negatives_of_weight_zero_have_no_loss() -> None:
    assert float(batch_contrast(points(), 0.5, 0.0)) == pytest.approx(0.0)


def test_nt_xent_equals_its_formula() -> None:
    x = points(seed=1)
    u = np.random.default_rng(2).uniform(0.2, 3.0, len(x))
    assert float(nt_xent(x, torch.from_numpy(u), 0.3)) == pytest.approx(
        slow_nt_xent(x.tolist(), u.tolist(), 0.3), rel=1e-9
    )


def test_nt_xent_has_the_gradient_of_finite_differences() -> None:
    x = points(6, 4).requires_grad_()
    u = torch.from_numpy(np.random.default_rng(3).uniform(0.3, 2.0, 6)).requires_grad_()
    assert torch.autograd.gradcheck(lambda p, v: nt_xent(p, v, 0.5), (x, u))


def test_gradients_raise_u_of_a_confused_scan_and_lower_u_of_a_distinct_one() -> None:
    """Row 0 is nearer to row 1 than to its other view, row 2; row 3 is near its own."""
    x = torch.tensor([[1.0, 0.0], [1.0, 0.1], [0.0, 1.0], [0.9, 0.2]], dtype=torch.float64)
    u = torch.ones(4, dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(nt_xent(x, u, 0.1), u)
    assert gradient[0] < 0.0
    assert gradient[3] > 0.0


def test_the_greater_u_may_be_used_for_both_views() -> None:
    x = points(seed=1)
    u = np.random.default_rng(2).uniform(0.2, 3.0, len(x))
    greater = np.maximum(u, np.roll(u, len(u) // 2))
    assert float(nt_xent(x, torch.from_numpy(u), 0.3, 'greater')) == pytest.approx(
        slow_nt_xent(x.tolist(), greater.tolist(), 0.3), rel=1e-9
    )


@pytest.mark.parametrize('answers', ['greater', 'worse'])
def test_the_lower_u_then_has_no_gradient(answers: str) -> None:
    x = points(6, 4)
    u = torch.tensor([0.5, 2.0, 0.7, 1.5, 0.3, 1.1], dtype=torch.float64, requires_grad=True)
    loss = nt_xent(x, u, 0.3, answers)
    (gradient,) = torch.autograd.grad(loss, u)
    assert (gradient != 0.0).tolist() == [False, True, False, True, False, True]
    if answers == 'worse':
        assert float(loss.detach()) == pytest.approx(float(nt_xent(x, u.detach(), 0.3)))


def test_hedged_contrast_is_the_log_of_the_mean_over_samples() -> None:
    centres, log_variances = points(6, 4), points(6, 4, seed=4) / 6.0
    noise = torch.Generator().manual_seed(7)
    draws = [torch.randn(centres.shape, generator=noise, dtype=torch.float64) for _ in range(3)]
    expected = 0.0
    for i in range(6):
        probability = 0.0
        for draw in draws:
            z = (centres + torch.exp(0.5 * log_variances) * draw).tolist()
            exponentials = {j: math.exp(cosine(z[i], z[j]) / 0.4) for j in range(6) if j != i}
            probability += exponentials[(i + 3) % 6] / sum(exponentials.values()) / len(draws)
        expected -= math.log(probability) / 6
    loss = hedged_contrast(centres, log_variances, 0.4, 3, torch.Generator().manual_seed(7))
    assert float(loss) == pytest.approx(expected, rel=1e-9)


def test_hedged_contrast_has_the_gradient_of_finite_differences() -> None:
    inputs = points(4, 3).requires_grad_(), (points(4, 3, seed=5) / 6.0).detach().requires_grad_()
    assert torch.autograd.gradcheck(
        lambda c, v: hedged_contrast(c, v, 0.6, 2, torch.Generator().manual_seed(1)), inputs
    )


def test_without_variance_hedged_contrast_equals_nt_xent() -> None:
    x = points()
    certain = hedged_contrast(x, torch.full_like(x, -80.0), 0.3, 2)
    assert float(certain) == pytest.approx(float(nt_xent(x, torch.ones(len(x), dtype=x.dtype), 0.3)))


def test_divergence_equals_that_of_torch() -> None:
    mu, log_variance = points(), points(seed=6) / 4.0
    prior = torch.distributions.Normal(torch.zeros_like(mu), torch.ones_like(mu))
    posterior = torch.distributions.Normal(mu, torch.exp(0.5 * log_variance))
    expected = torch.distributions.kl_divergence(posterior, prior).sum(dim=1).mean()
    assert float(prior_divergence(mu, log_variance)) == pytest.approx(float(expected), rel=1e-9)
    assert float(prior_divergence(torch.zeros(3, 4), torch.zeros(3, 4))) == 0.0


def test_dimensions_below_the_free_nats_have_no_gradient() -> None:
    mu, log_variance = points().requires_grad_(), torch.zeros(8, 5, dtype=torch.float64)
    each = 0.5 * mu.detach().square().mean(dim=0)
    free = float(each.median())
    loss = prior_divergence(mu, log_variance, free)
    assert float(loss.detach()) == pytest.approx(float(each.clamp(min=free).sum()))
    (gradient,) = torch.autograd.grad(loss, mu)
    assert (gradient[:, each < free] == 0.0).all()
    assert (gradient[:, each > free] != 0.0).all()


def test_divergence_has_the_gradient_of_finite_differences() -> None:
    assert torch.autograd.gradcheck(prior_divergence, (points().requires_grad_(), points(seed=8).requires_grad_()))


@pytest.mark.parametrize('kind', ['mse', 'l2'])
def test_reconstruction_equals_its_formula_and_has_gradients_for_the_decoder_alone(kind: str) -> None:
    rng = np.random.default_rng(0)
    decoded = torch.from_numpy(rng.normal(size=(3, 2, 4, 4))).requires_grad_()
    features = torch.from_numpy(rng.normal(size=(3, 2, 4, 4))).requires_grad_()
    loss = reconstruction_error(decoded, features, kind)
    squares = [
        sum(float(d) ** 2 for d in (a - b).flatten()) for a, b in zip(decoded.detach(), features.detach(), strict=True)
    ]
    expected = sum(squares) / 96 if kind == 'mse' else sum(map(math.sqrt, squares)) / 3
    assert float(loss.detach()) == pytest.approx(expected, rel=1e-9)
    torch.autograd.backward(loss)
    assert features.grad is None
    assert decoded.grad is not None
    assert torch.autograd.gradcheck(lambda d: reconstruction_error(d, features, kind), (decoded,))


@pytest.mark.parametrize('rows', [2, 5])
def test_a_batch_that_does_not_have_two_views_of_two_places_is_refused(rows: int) -> None:
    with pytest.raises(ValueError, match='two views each of two places'):
        batch_contrast(points(rows), 1.0, 1.0)
