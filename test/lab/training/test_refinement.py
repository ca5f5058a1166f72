"""The second stage trains the variance, and nothing else, with the answers of searches."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip('torch')

from offradar_ros.encoders.network_config import NetworkConfig  # noqa: E402
from offradar_ros.encoders.networks.files import load_network  # noqa: E402
from offradar_ros.encoders.networks.variational import VariationalNetwork  # noqa: E402
from offradar_ros.errors import DataError  # noqa: E402
from offradar_ros.lab.drives.drive import Drive  # noqa: E402
from offradar_ros.lab.evaluation.metrics.auroc import auroc  # noqa: E402
from offradar_ros.lab.training.config import RefinementConfig, TrainingConfig  # noqa: E402
from offradar_ros.lab.training.images import images_of  # noqa: E402
from offradar_ros.lab.training.refinement import SearchedScans, feature_maps, refine, search_scans  # noqa: E402
from offradar_ros.lab.training.run_log import read_log  # noqa: E402
from offradar_ros.lab.training.validation import ValidationDrive, validation_drives  # noqa: E402

MakeDrive = Callable[..., Drive]

CONFIG = TrainingConfig(
    network=NetworkConfig(backbone='compact', dimension=16, azimuths=24, range_bins=16, resolution_m=4.0),
    refinement=RefinementConfig(steps=60, scans=16, severity_weight=0.0, learning_rate=3e-3),
    log_steps=25,
    threads=1,
)


@pytest.fixture(scope='module')
def drives(make_drive: MakeDrive) -> list[Drive]:
    """Three drives, one with scans that are not recognised, and one through another world."""
    return [
        make_drive('a'),
        make_drive('b', lane_m=5.0, degraded=(2, 5)),
        make_drive('c', lane_m=3.0),
        make_drive('d', world='elsewhere'),
    ]


@pytest.fixture(scope='module')
def network() -> VariationalNetwork:
    torch.manual_seed(1)
    return VariationalNetwork(CONFIG.network).eval()


@pytest.fixture(scope='module')
def searched(network: VariationalNetwork, drives: list[Drive]) -> SearchedScans:
    return search_scans(network, drives, feature_maps(network, drives, 1))


@pytest.fixture(scope='module')
def validation(drives: list[Drive]) -> tuple[ValidationDrive, ...]:
    return validation_drives(drives[:3], CONFIG.network, 1)


def refined(
    searched: SearchedScans, validation: tuple[ValidationDrive, ...], out: Path, **changes: float
) -> VariationalNetwork:
    torch.manual_seed(1)
    network = VariationalNetwork(CONFIG.network).eval()
    config = dataclasses.replace(CONFIG, refinement=dataclasses.replace(CONFIG.refinement, **changes))  # type: ignore[arg-type]
    refine(config, network, searched, validation, out)
    return network


def test_wrong_answers_and_margins_are_those_of_searches(
    network: VariationalNetwork, drives: list[Drive], searched: SearchedScans
) -> None:
    with torch.inference_mode():
        descriptors = [network.embed(torch.from_numpy(images_of(drive, CONFIG.network)))[0] for drive in drives[:3]]
    # A scan of each of eight places, 60 m apart: each is searched for in two maps, which keep all scans.
    for number, own in enumerate(descriptors):
        margins = []
        for other in (descriptors[k] for k in range(3) if k != number):
            cosines = own @ other.T
            right = cosines.diagonal()
            margins.append(right - (cosines - 9.0 * torch.eye(8)).max(dim=1).values)
        expected = torch.stack(margins)
        rows = slice(8 * number, 8 * number + 8)
        assert searched.margins[rows].numpy() == pytest.approx(expected.mean(dim=0).numpy(), abs=1e-3)
        assert searched.wrong[rows].numpy() == pytest.approx((expected <= 0.0).float().mean(dim=0).numpy())
    assert 0.0 < float(searched.wrong.mean()) < 1.0
    assert len(searched.features) == 24, 'a drive alone in its world is not searched for'
    assert searched.severities.numpy() == pytest.approx(np.concatenate([drive.severities for drive in drives[:3]]))


def test_u_detects_degraded_scans_better_and_descriptors_do_not_change(
    network: VariationalNetwork, searched: SearchedScans, validation: tuple[ValidationDrive, ...], tmp_path: Path
) -> None:
    after = refined(searched, validation, tmp_path)
    images = torch.from_numpy(validation[1].images)
    with torch.inference_mode():
        (descriptor, before_u), (same, after_u) = network.embed(images), after.embed(images)
    assert torch.equal(descriptor, same)
    degraded = np.isin(np.arange(8), (2, 5))
    assert auroc(after_u.mean(dim=1).numpy(), degraded) > auroc(before_u.mean(dim=1).numpy(), degraded)
    state = network.state_dict()
    changed = {name for name, tensor in after.state_dict().items() if not torch.equal(tensor, state[name])}
    assert changed == {'log_variance.weight', 'log_variance.bias'}
    log = read_log(tmp_path / 'log.jsonl')
    assert [line['step'] for line in log] == [25, 50, 60]
    assert log[-1]['loss'] < log[0]['loss']


def test_the_better_weights_are_kept(
    searched: SearchedScans, validation: tuple[ValidationDrive, ...], tmp_path: Path
) -> None:
    better, worse = tmp_path / 'better', tmp_path / 'worse'
    for out in (better, worse):
        out.mkdir()
    refined(searched, validation, better)
    # The opposite targets: scans that are recognised well get a high U.
    refined(searched._replace(wrong=-searched.wrong, margins=-searched.margins), validation, worse)
    for out, step in ((better, 60), (worse, 0)):
        scores = {line['step']: line['score'] for line in read_log(out / 'validation.jsonl')}
        assert max(scores, key=lambda at: scores[at]) == step
        assert f'second stage, step {step}: score' in load_network(out / 'best.safetensors')[1].description


def test_drives_of_different_worlds_are_refused(network: VariationalNetwork, drives: list[Drive]) -> None:
    alone = [drives[0], drives[3]]
    with pytest.raises(DataError, match='refinement: no scan has a place of another drive'):
        search_scans(network, alone, feature_maps(network, alone, 1))
