"""The outputs of a teacher: once for each scan, kept in files, and learnt by a student with another image."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip('torch')

from offradar_ros.encoders.network_config import NetworkConfig  # noqa: E402
from offradar_ros.encoders.networks.files import save_network  # noqa: E402
from offradar_ros.encoders.networks.registry import make_network  # noqa: E402
from offradar_ros.errors import ConfigError, DataError, ModelError  # noqa: E402
from offradar_ros.lab.drives.drive import Drive  # noqa: E402
from offradar_ros.lab.training.config import (  # noqa: E402
    ContrastConfig,
    DistillationConfig,
    LossConfig,
    TrainingConfig,
)
from offradar_ros.lab.training.images import images_of  # noqa: E402
from offradar_ros.lab.training.losses.angular_distance import angular_distance  # noqa: E402
from offradar_ros.lab.training.objective import Views, losses_of  # noqa: E402
from offradar_ros.lab.training.objectives import make_objective  # noqa: E402
from offradar_ros.lab.training.teacher_outputs import Teacher, load_teacher, teacher_outputs, weights_of  # noqa: E402

TEACHER = NetworkConfig(backbone='compact', dimension=8, azimuths=24, range_bins=16, resolution_m=4.0)
STUDENT = NetworkConfig(backbone='vgg16', dimension=8, side_px=32, resolution_m=4.0)
CPU = torch.device('cpu')


@pytest.fixture
def teacher(tmp_path: Path) -> Teacher:
    torch.manual_seed(1)
    network = make_network(TEACHER)
    torch.nn.init.normal_(network.get_parameter('log_variance.weight'), std=0.1)
    save_network(tmp_path / 'teacher.safetensors', network)
    return load_teacher(DistillationConfig(str(tmp_path / 'teacher.safetensors')), STUDENT)


@pytest.fixture
def drives(make_drive: Callable[..., Drive]) -> list[Drive]:
    return [make_drive('a'), make_drive('b', places=5, lane_m=4.0)]


def test_outputs_are_those_of_each_scan_and_are_computed_once(
    teacher: Teacher, drives: list[Drive], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[int, int]] = []
    found = teacher_outputs(teacher, drives, tmp_path, CPU, 1, lambda done, total: seen.append((done, total)))
    assert found.shape == (13, 2, 8) and found.dtype == np.float16
    assert seen == [(1, 2), (2, 2)]
    images = np.concatenate([images_of(drive, TEACHER) for drive in drives])
    for row, image in enumerate(images):
        with torch.inference_mode():
            descriptor, variance = teacher.network.embed(torch.from_numpy(image)[None])
        assert found[row, 0] == pytest.approx(descriptor[0].numpy(), abs=1e-3)
        assert found[row, 1] == pytest.approx(np.log(variance[0].numpy()), abs=5e-3)
    monkeypatch.setattr(type(teacher.network), 'embed', pytest.fail)
    assert np.array_equal(teacher_outputs(teacher, drives[::-1], tmp_path, CPU)[:5], found[8:])


def test_damaged_files_are_named(teacher: Teacher, drives: list[Drive], tmp_path: Path) -> None:
    teacher_outputs(teacher, drives, tmp_path, CPU)
    (folder,) = tmp_path.glob('teacher-*')
    whole = (folder / 'a.npy').read_bytes()
    for content, message in (
        (whole[:-40], r'a\.npy: damaged'),
        ((folder / 'b.npy').read_bytes(), r'a\.npy: expected float16 of \(8, 2, 8\), got float16 of \(5, 2, 8\)'),
    ):
        (folder / 'a.npy').write_bytes(content)
        with pytest.raises(DataError, match=message):
            teacher_outputs(teacher, drives, tmp_path, CPU)


def test_teachers_and_students_that_do_not_fit_are_refused(teacher: Teacher, tmp_path: Path) -> None:
    given = DistillationConfig(str(tmp_path / 'teacher.safetensors'))
    with pytest.raises(ModelError, match='expected a variational network of dimension 16 as the teacher, got variat'):
        load_teacher(given, dataclasses.replace(STUDENT, dimension=16))
    with pytest.raises(ConfigError, match=r'key distillation.weights: expected none, as bc_radar is not distilled'):
        load_teacher(given, dataclasses.replace(STUDENT, method='bc_radar'))
    with pytest.raises(ModelError, match='no such weights file'):
        load_teacher(DistillationConfig(str(tmp_path / 'none.safetensors')), STUDENT)


def test_the_weights_that_ship_are_a_teacher() -> None:
    shipped = load_teacher(DistillationConfig('compact'), NetworkConfig())
    assert shipped.network.config.backbone == 'compact'
    assert not any(parameter.requires_grad for parameter in shipped.network.parameters())


def objective_of(**weights: float) -> Any:
    off = ContrastConfig(weight=0.0)
    loss = LossConfig(invariant=off, variant=off, kl_weight=0.0, reconstruction_weight=0.0)
    torch.manual_seed(2)
    objective = make_objective(
        TrainingConfig(network=STUDENT, loss=loss, distillation=DistillationConfig('compact', **weights))
    )
    objective.network.train()
    return objective


def test_terms_against_a_loop() -> None:
    rng = np.random.default_rng(3)
    targets = rng.normal(0.0, 1.0, (6, 2, 8))
    objective = objective_of(descriptor_weight=2.0, variance_weight=0.5)
    images = torch.randint(0, 256, (6, 32, 32), dtype=torch.uint8)
    views = Views(images, torch.zeros(6), torch.from_numpy(targets).float())
    terms = losses_of(objective, views, 0)
    assert set(terms) == {'distilled_descriptor', 'distilled_variance'}
    with torch.no_grad():
        output = objective.network(images)
    angle = square = 0.0
    for row in range(6):
        a, b = (output.z_i + output.mu)[row].double().numpy(), targets[row, 0]
        angle += (1.0 - a @ b / np.linalg.norm(a) / np.linalg.norm(b)) / 6
        square += sum((output.log_variance[row, k].item() - targets[row, 1, k]) ** 2 for k in range(8)) / 48
    assert terms['distilled_descriptor'].item() == pytest.approx(2.0 * angle, rel=1e-4)
    assert terms['distilled_variance'].item() == pytest.approx(0.5 * square, rel=1e-4)
    assert set(losses_of(objective_of(descriptor_weight=0.0), views, 0)) == {'distilled_variance'}


def test_the_targets_get_no_gradient() -> None:
    points, targets = (torch.randn(4, 3, requires_grad=True) for _ in range(2))
    torch.autograd.backward(angular_distance(points, targets))
    assert points.grad is not None and targets.grad is None


def test_a_student_learns_what_the_teacher_sees(teacher: Teacher, drives: list[Drive], tmp_path: Path) -> None:
    targets = torch.from_numpy(teacher_outputs(teacher, drives, tmp_path, CPU)).float()
    images = torch.from_numpy(np.concatenate([images_of(drive, STUDENT) for drive in drives]))
    objective = objective_of(variance_weight=1.0)
    optimiser = torch.optim.Adam(objective.network.parameters(), 1e-3)
    lost = []
    for step in range(60):
        terms = losses_of(objective, Views(images, torch.zeros(13), targets), step)
        optimiser.zero_grad()
        torch.autograd.backward(sum(terms.values()))
        optimiser.step()
        lost.append({name: term.item() for name, term in terms.items()})
    for name in lost[0]:
        assert lost[-1][name] < 0.5 * lost[0][name]


def test_a_teacher_is_a_file_or_the_name_of_shipped_weights() -> None:
    assert weights_of(DistillationConfig(weights='compact')).name == 'compact.safetensors'
    assert weights_of(DistillationConfig(weights='runs/a.safetensors')) == Path('runs/a.safetensors')
    with pytest.raises(ConfigError, match=r'key distillation\.weights: expected a \.safetensors file or the name'):
        weights_of(DistillationConfig(weights='compactt'))
