"""Several drives: learned coefficients and a gate, or the paper's rule with its threshold on U."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from offradar_ros.calibration.error_control import ErrorLimit
from offradar_ros.calibration.gate_choice import GateChoice
from offradar_ros.calibration.parameters import shipped_confidence
from offradar_ros.calibration.road import calibrate_road
from offradar_ros.calibration.threshold_choice import ThresholdChoice
from offradar_ros.config import Config, load_config
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import DataError
from offradar_ros.recordings.bags.writer import write_bag
from offradar_ros.recordings.road import PositionedDrive, open_road
from offradar_ros.retrieval.confidence import TERMS
from offradar_ros.retrieval.thresholds import threshold_at

LIMIT = ErrorLimit(0.3, 0.75)
LOOSE = ErrorLimit(0.2, 0.95, 0.1)
RING_KEY = load_config(overrides={'encoder.name': 'ring_key', 'query.levels': 20, 'query.level': 20})
PAPER = load_config(overrides={'encoder.name': 'ring_key', 'query.gate': 'paper'})


@pytest.fixture
def drives(street_bag: Callable[..., Path]) -> list[PositionedDrive]:
    paths = [street_bag(f'drive_{i}', count=12 + i, lane_m=1.0 * i, noise_seed=i) for i in range(2)]
    return open_road(paths).drives


@pytest.fixture(scope='module')
def long_drives(tmp_path_factory: pytest.TempPathFactory, street: Callable[..., Any]) -> list[PositionedDrive]:
    """Three drives of 150 m, a scan every 2.5 m."""
    folder = tmp_path_factory.mktemp('long')
    made = [street(count=120, lane_m=1.0 * i, noise_seed=i, name=f'drive_{i}') for i in range(3)]
    road = open_road([write_bag(drive, folder / drive.name) for drive in made])
    return [drive.subsampled(2.5) for drive in road.drives]


def test_scale_and_progress_are_over_all_drives(drives: list[PositionedDrive]) -> None:
    reported: list[tuple[int, int]] = []
    calibration, choice = calibrate_road(drives, PAPER, LIMIT, lambda done, total: reported.append((done, total)))
    encoder = make_encoder(load_config(overrides=calibration.values).encoder)
    uncertainties = [encoder.encode(drive.scan(i)).uncertainty for drive in drives for i in range(len(drive))]
    assert np.mean(uncertainties) == pytest.approx(1.0, abs=1e-6)
    assert isinstance(choice, ThresholdChoice)
    assert choice.queries.uncertainties == pytest.approx(uncertainties, rel=1e-5)
    assert calibration.values['query.level'] == choice.level
    assert calibration.source == '25 scans of drive_0, drive_1'
    assert reported[-1] == (25, 25)
    assert reported == sorted(reported)


def test_with_the_rule_on_u_the_shipped_coefficients_are_kept(drives: list[PositionedDrive]) -> None:
    calibration, _ = calibrate_road(drives, PAPER, LIMIT)
    query = load_config(overrides=calibration.values).query
    shipped = shipped_confidence(PAPER, query.confidence.usual_uncertainty)
    assert shipped is not None
    assert query.confidence == dataclasses.replace(shipped, model=query.model)
    assert 'query.min_probability' not in calibration.values


@pytest.mark.parametrize('rings', [RING_KEY.encoder.ring_key.rings, 64])
def test_coefficients_and_gate_are_learned_with_or_without_shipped_ones(
    long_drives: list[PositionedDrive], rings: int
) -> None:
    config = load_config(
        overrides={'encoder.name': 'ring_key', 'encoder.ring_key.rings': rings, 'query.levels': 20, 'query.level': 20}
    )
    shipped = shipped_confidence(config, 1.0)
    assert (shipped is None) == (rings == 64)
    calibration, choice = calibrate_road(long_drives, config, LOOSE)
    assert isinstance(choice, GateChoice)
    query = load_config(overrides=calibration.values).query
    assert query.min_probability == choice.min_probability
    assert query.confidence.model == query.model
    assert query.confidence == dataclasses.replace(choice.fit.coefficients, model=query.model)
    assert all(getattr(query.confidence, name) <= 0.0 for name in TERMS)
    assert shipped is None or query.confidence.unrelated_distance == shipped.unrelated_distance
    assert choice.wrong / choice.answered <= 0.2
    assert choice.off_map_answered / choice.off_map_scans <= 0.1
    report = '\n'.join(calibration.lines)
    assert f'min_probability {choice.min_probability:g}: {choice.wrong} of {choice.answered} answers' in report
    assert ('shipped coefficients: ECE' in report) == (shipped is not None)
    assert f'model {query.model[:12]}' in report


def test_the_threshold_on_u_refuses_no_file_where_the_probability_is_the_gate(
    long_drives: list[PositionedDrive],
) -> None:
    limit = ErrorLimit(0.1, 0.95, 0.1)
    with pytest.raises(DataError, match='no threshold is sure'):
        calibrate_road(long_drives[:2], _paper(RING_KEY), ErrorLimit(0.03, 0.75))
    calibration, choice = calibrate_road(long_drives, RING_KEY, limit)
    assert isinstance(choice, GateChoice)
    right = choice.fit.queries.evidence.uncertainty[choice.fit.queries.right]
    assert np.mean(right > threshold_at(load_config(overrides=calibration.values).query)) <= 0.01


def _paper(config: Config) -> Config:
    return dataclasses.replace(config, query=dataclasses.replace(config.query, gate='paper'))


def test_drives_of_different_roads_are_refused_before_anything_is_encoded(street_bag: Callable[..., Path]) -> None:
    reported: list[int] = []
    road = open_road([street_bag('here', count=4), street_bag('aside', count=4, lane_m=400.0)])
    with pytest.raises(DataError, match='here: no scan within 25 m of another drive, the nearest 400 m away'):
        calibrate_road(road.drives, RING_KEY, LIMIT, lambda done, _: reported.append(done))
    assert reported == []


def test_a_drive_that_cannot_be_encoded_is_named(street_bag: Callable[..., Path]) -> None:
    road = open_road([street_bag('loud', count=4), street_bag('quiet', count=3, silent=True)])
    with pytest.raises(DataError, match='quiet: none of its 3 scans can be encoded'):
        calibrate_road(road.drives, RING_KEY, LIMIT)
