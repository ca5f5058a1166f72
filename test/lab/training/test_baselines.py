"""Objectives of the methods with which ours is compared: against slow loops, and their gradients."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip('torch')

import torch

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.bc_radar import BcRadarNetwork
from offradar_ros.encoders.networks.vae import VaeNetwork
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import ConfigError, ModelError
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.training.baselines.common_contrast import common_contrast
from offradar_ros.lab.training.baselines.distillation import distillation, gaussian_distillation
from offradar_ros.lab.training.baselines.rad_vlad_codebook import fit_centres
from offradar_ros.lab.training.config import ContrastConfig, LossConfig, TeacherConfig, TrainingConfig
from offradar_ros.lab.training.config_file import read_config
from offradar_ros.lab.training.objective import Objective, Views, losses_of
from offradar_ros.lab.training.objectives import make_objective
from offradar_ros.radar.spinning import spin

CONFIGURATIONS = Path(__file__).resolve().parents[3] / 'params' / 'train'
BASELINES = ('bc_radar', 'vae', 'mc_dropout', 'stun')


def network_config(method: str, **changes: Any) -> NetworkConfig:
    small = NetworkConfig(
        method=method, backbone='compact', dimension=8, side_px=64, azimuths=64, range_bins=64, resolution_m=2.0
    )
    return dataclasses.replace(small, **changes)


def training(method: str, **changes: Any) -> TrainingConfig:
    return dataclasses.replace(TrainingConfig(network=network_config(method)), **changes)


def teacher_network() -> BcRadarNetwork:
    torch.manual_seed(5)
    network = BcRadarNetwork(network_config('bc_radar'))
    network(places())
    return network


def objective_of(method: str, **changes: Any) -> Objective:
    teacher = teacher_network() if method == 'stun' else None
    torch.manual_seed(1)
    objective = make_objective(training(method, **changes), teacher)
    objective.network.train()
    return objective


def places(count: int = 4) -> torch.Tensor:
    """(2 count, 64, 64) uint8: rows i and i + count are one pattern of reflectors under different speckle."""
    rng = np.random.default_rng(2)
    patterns = (rng.random((count, 64, 64)) < 0.03) * 180.0
    views = np.concatenate([patterns, patterns]) + rng.gamma(1.5, 6.0, (2 * count, 64, 64))
    return torch.from_numpy(np.minimum(views, 255).astype(np.uint8))


def views_of(images: torch.Tensor) -> Views:
    return Views(images, torch.full((len(images),), torch.nan))


def learn(objective: Objective, step: int) -> float:
    """The loss of `places()`, whose gradients it leaves in the network."""
    loss = torch.stack(list(losses_of(objective, views_of(places()), step).values())).sum()
    torch.autograd.backward(loss)
    return loss.item()


@pytest.fixture(params=BASELINES)
def method(request: pytest.FixtureRequest) -> str:
    name: str = request.param
    return name


def test_every_parameter_has_a_gradient(method: str) -> None:
    objective = objective_of(method)
    learn(objective, 0)
    missing = {name for name, tensor in objective.network.named_parameters() if tensor.grad is None}
    zero = {
        name
        for name, tensor in objective.network.named_parameters()
        if tensor.grad is not None and not tensor.grad.abs().sum() > 0
    }
    assert (missing, zero) == (set(), set())


def test_a_few_steps_on_one_batch_lower_the_loss(method: str) -> None:
    objective = objective_of(method)
    optimiser = torch.optim.Adam(objective.network.parameters(), 1e-3)
    losses = []
    for step in range(30):
        optimiser.zero_grad()
        losses.append(learn(objective, step))
        optimiser.step()
    assert all(math.isfinite(value) for value in losses)
    assert np.mean(losses[-5:]) < 0.9 * losses[0]


@pytest.mark.parametrize('method', ['bc_radar', 'mc_dropout'])
def test_a_network_trained_on_one_batch_recognises_it(method: str) -> None:
    contrast = ContrastConfig(on='z_i', temperature=0.1, negative_weight=1.0)
    objective = objective_of(method, loss=LossConfig(invariant=contrast))
    optimiser = torch.optim.Adam(objective.network.parameters(), 1e-3)
    for step in range(40):
        optimiser.zero_grad()
        learn(objective, step)
        optimiser.step()
    with torch.no_grad():
        descriptor, _ = objective.network.eval().embed(places())
    nearest = torch.cdist(descriptor[:4], descriptor[4:]).argmin(dim=1)
    assert nearest.tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize('criterion', ['temperature', 'hedged'])
def test_criteria_with_a_variance_reduce_to_nt_xent(criterion: str) -> None:
    points = torch.randn(6, 5, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    unit = (points / points.norm(dim=1, keepdim=True)).numpy()
    total = 0.0
    for i in range(6):
        exponentials = {j: math.exp(float(unit[i] @ unit[j]) / 0.2) for j in range(6) if j != i}
        total -= math.log(exponentials[(i + 3) % 6] / sum(exponentials.values()))
    config = ContrastConfig(criterion=criterion, temperature=0.2, weight=3.0)
    assert common_contrast(config, points).item() == pytest.approx(3.0 * total / 6)


def test_distillation_against_a_loop() -> None:
    rng = np.random.default_rng(3)
    student, teacher = rng.normal(size=(2, 4, 3))
    log_variance = rng.uniform(0, 1, (4, 3))
    total = 0.0
    for i in range(4):
        distance = math.sqrt(sum((student[i, k] - teacher[i, k]) ** 2 for k in range(3)))
        for k in range(3):
            total += distance / math.exp(log_variance[i, k]) + log_variance[i, k]
    loss = distillation(*(torch.from_numpy(part) for part in (student, log_variance, teacher)))
    assert loss.item() == pytest.approx(total / 12)


def test_distillation_is_least_if_the_variance_is_the_distance() -> None:
    student, teacher = torch.zeros(1, 2), torch.tensor([[0.0, 2.0]])
    log_variances = torch.linspace(0.0, 1.0, 101)
    losses = [distillation(student, torch.full((1, 2), float(value)), teacher).item() for value in log_variances]
    assert float(log_variances[int(np.argmin(losses))]) == pytest.approx(math.log(2.0), abs=0.01)


def test_gaussian_distillation_is_the_mean_likelihood_of_the_teacher() -> None:
    rng = np.random.default_rng(4)
    student, teacher, log_variance = (torch.from_numpy(rng.normal(size=(5, 3))) for _ in range(3))
    error = torch.nn.functional.gaussian_nll_loss(student, teacher, torch.exp(log_variance), full=True, eps=0.0)
    constant = 0.5 * math.log(2.0 * math.pi)
    loss = gaussian_distillation(student, log_variance, teacher)
    assert loss.item() == pytest.approx(float(error) - constant)


def test_a_student_that_is_its_teacher_has_finite_gradients() -> None:
    mean = torch.ones(2, 3, requires_grad=True)
    torch.autograd.backward(distillation(mean, torch.zeros(2, 3), torch.ones(2, 3)))
    assert mean.grad is not None
    assert torch.isfinite(mean.grad).all()


def test_the_teacher_does_not_change() -> None:
    teacher = teacher_network()
    before = {name: tensor.clone() for name, tensor in teacher.state_dict().items()}
    objective = make_objective(training('stun'), teacher)
    objective.network.train()
    learn(objective, 0)
    assert all(tensor.grad is None for tensor in teacher.parameters())
    for name, tensor in teacher.state_dict().items():
        assert torch.equal(tensor, before[name]), name
    assert not {id(tensor) for tensor in teacher.parameters()} & {id(p) for p in objective.network.parameters()}


def test_a_student_may_start_from_its_teacher() -> None:
    teacher = teacher_network()
    given = places()
    expected, _ = teacher.eval().embed(given)
    for start, same in (('teacher', True), ('fresh', False)):
        objective = make_objective(training('stun', teacher=TeacherConfig(student=start)), teacher)
        mean, _ = objective.network.eval().embed(given)
        assert torch.allclose(mean, expected, atol=1e-5) == same


@pytest.mark.parametrize(
    'changes, expected',
    [
        ({'dimension': 16}, "expected the student's dimension = 8, got 16"),
        ({'azimuths': 32}, r"expected the student's image = PolarGridConfig\(azimuths=64, .*, got .*=32,"),
    ],
)
def test_teachers_that_do_not_fit_are_refused(changes: dict[str, Any], expected: str) -> None:
    teacher = BcRadarNetwork(network_config('bc_radar', **changes))
    with pytest.raises(ModelError, match=expected):
        make_objective(training('stun'), teacher)


def test_a_teacher_of_another_method_is_refused() -> None:
    with pytest.raises(ModelError, match='expected a trained bc_radar network, got VaeNetwork'):
        make_objective(training('stun'), VaeNetwork(network_config('vae')))


def test_the_auto_encoders_loss_against_a_loop() -> None:
    objective = objective_of('vae', loss=LossConfig(kl_weight=0.5, kl_warmup_steps=4, reconstruction_weight=2.0))
    network = objective.network.eval()
    terms = losses_of(objective, views_of(places()), 1)
    output = network(places())
    mu, log_variance = output.mu.detach().numpy(), output.log_variance.detach().numpy()
    divergence = errors = 0.0
    for i in range(8):
        for k in range(8):
            divergence += 0.5 * (mu[i, k] ** 2 + math.exp(log_variance[i, k]) - 1 - log_variance[i, k]) / 8
        difference = (output.reconstruction - output.target)[i].detach().numpy().astype(np.float64)
        errors += (difference**2).sum() / (2 * 0.1**2) / 8
    assert terms['kl'].item() == pytest.approx(0.5 * (2 / 4) * divergence / 8, rel=1e-4)
    assert terms['reconstruction'].item() == pytest.approx(2.0 * errors / 8, rel=1e-4)


def test_the_auto_encoders_target_has_no_gradient() -> None:
    objective = objective_of('vae')
    output = objective.network(places())
    assert not output.target.requires_grad
    assert output.reconstruction.requires_grad


@pytest.mark.parametrize('method', ['bc_radar', 'mc_dropout'])
def test_a_contrastive_term_of_weight_zero_is_refused(method: str) -> None:
    with pytest.raises(ConfigError, match=f'loss.invariant.weight: {method} has no other term'):
        make_objective(training(method, loss=LossConfig(invariant=ContrastConfig(weight=0.0))))


def test_shipped_configurations_give_every_method_the_same_scans_batches_and_network() -> None:
    ours = read_config(CONFIGURATIONS / 'compact.yaml')
    for name in BASELINES:
        config = read_config(CONFIGURATIONS / f'{name}.yaml')
        assert config.method == name
        assert dataclasses.replace(config.network, method='variational') == ours.network
        assert (config.data, config.batch, config.validation) == (ours.data, ours.batch, ours.validation)
        assert config.optimiser == ours.optimiser
        student = name == 'stun'
        assert (config.teacher.steps if student else config.steps) == ours.steps
        teacher = BcRadarNetwork(dataclasses.replace(config.network, method='bc_radar')) if student else None
        assert make_objective(config, teacher).network.config == config.network
    centres = read_config(CONFIGURATIONS / 'rad_vlad.yaml')
    assert (centres.fit, centres.data, centres.network.image) == ('rad_vlad', ours.data, ours.network.image)


def test_centres_of_rad_vlad_are_fitted_to_the_drives(tmp_path: Path, make_drive: Callable[..., Drive]) -> None:
    config = dataclasses.replace(training('bc_radar'), fit='rad_vlad')
    drives = [make_drive('there'), make_drive('back', world='v')]
    path = fit_centres(config, drives, tmp_path)
    encoder = make_encoder(EncoderConfig(name='rad_vlad', weights=str(path)))
    assert encoder.info.dimension == 64 * 257
    assert float(encoder.info.metadata['max_range_m']) == config.network.reach_m == 128.0
    means = [np.array([encoder.encode(drive.scan(row)).mean for row in range(8)]) for drive in drives]
    again = np.array([encoder.encode(spin(make_drive('again').scan(row), 5)).mean for row in range(8)])
    distances = np.linalg.norm(again[:, None] - np.concatenate(means)[None], axis=2)
    assert distances.argmin(axis=1).tolist() == list(range(8))
    assert read_config(tmp_path / 'config.yaml') == config
