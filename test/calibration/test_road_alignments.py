"""Calibration judges the answers that the vehicle would give: with alignments, in their order."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from offradar_ros.alignment.signature import SignatureMaker
from offradar_ros.alignment.signature_code import pack
from offradar_ros.calibration.encoded_drive import EncodedDrive, encoded_drives
from offradar_ros.calibration.error_control import ErrorLimit
from offradar_ros.calibration.gate_choice import GateChoice
from offradar_ros.calibration.left_out_queries import LeftOutQueries, left_out_queries
from offradar_ros.calibration.open_set import halves
from offradar_ros.calibration.road import calibrate_road
from offradar_ros.calibration.road_alignments import RoadAlignments
from offradar_ros.config import ConfidenceConfig, Config, QueryConfig, load_config
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import DataError
from offradar_ros.recordings.bags.writer import write_bag
from offradar_ros.recordings.road import PositionedDrive, open_road
from offradar_ros.stages.query import QueryStage
from offradar_ros.types import Embedding, Match, PlaceTable, Rejection, ScanKey

CONFIG = load_config(overrides={'encoder.name': 'ring_key', 'query.levels': 20, 'query.level': 20})
COEFFICIENTS = ConfidenceConfig(
    model='m',
    intercept=2.0,
    distance=-3.0,
    spatial_ratio=-4.0,
    verified_intercept=-3.0,
    verified_log_odds=0.5,
    score=8.0,
    score_elsewhere=-2.0,
)


@pytest.fixture(scope='module')
def drives(tmp_path_factory: pytest.TempPathFactory, street: Callable[..., Any]) -> list[PositionedDrive]:
    """Two drives of 75 m, a scan every 2.5 m."""
    folder = tmp_path_factory.mktemp('road')
    made = [street(count=60, lane_m=1.0 * i, noise_seed=i, name=f'drive_{i}') for i in range(2)]
    return [drive.subsampled(2.5) for drive in open_road([write_bag(one, folder / one.name) for one in made]).drives]


@pytest.fixture(scope='module')
def encoded(drives: list[PositionedDrive]) -> list[EncodedDrive]:
    return encoded_drives(drives, make_encoder(CONFIG.encoder))


@pytest.fixture(scope='module')
def queries(drives: list[PositionedDrive], encoded: list[EncodedDrive]) -> LeftOutQueries:
    sequences, rows = [drive.sequence for drive in drives], [drive.rows for drive in drives]
    return left_out_queries(encoded, 5.0, 25.0, RoadAlignments(encoded, sequences, rows, 5))


class OwnSignatures:
    """Signatures of the first drive, which is session 1 in `EncodedDrive.places`."""

    def __init__(self, drive: PositionedDrive) -> None:
        self._drive, self._make = drive, SignatureMaker()

    def of(self, row: int) -> bytes:
        return pack(self._make(self._drive.scan(row)))

    def read(self, scans: Sequence[ScanKey]) -> dict[ScanKey, bytes]:
        rows = {int(stamp): row for row, stamp in enumerate(self._drive.stamps_ns)}
        return {scan: self.of(rows[scan.stamp_ns]) for scan in scans}


def answered(
    drives: list[PositionedDrive], query: EncodedDrive, table: PlaceTable, row: int
) -> tuple[Match | Rejection, int]:
    stage = QueryStage(QueryConfig(confidence=COEFFICIENTS), signatures=OwnSignatures(drives[0]))
    stage.load(table, 'm')
    mean = query.means[row]
    variance = np.full(len(mean), query.uncertainties[row], np.float32)
    signature = OwnSignatures(drives[1]).of(row)
    outcome = stage.query(Embedding(int(query.stamps_ns[row]), mean, variance, 'm', signature))
    assert isinstance(outcome, (Match, Rejection))
    return outcome, outcome.candidates[0].place_id


def test_each_answer_is_that_of_the_query_node(
    drives: list[PositionedDrive], encoded: list[EncodedDrive], queries: LeftOutQueries
) -> None:
    judged = queries.judged(COEFFICIENTS)
    mapped, query = encoded
    usable = int(np.sum(mapped.usable))
    for row in range(0, len(query), 9):
        (found,) = np.nonzero(queries.scan == usable + row)
        assert len(found) == 2
        for in_queries, kept in zip(found, halves(mapped.driven_m, mapped.map_rows(5.0)), strict=True):
            table = mapped.places(kept)
            outcome, first = answered(drives, query, table, row)
            expected = 1.0 / (1.0 + np.exp(-judged.log_odds[in_queries]))
            assert outcome.p_right == pytest.approx(expected, rel=1e-6)
            away_m = np.hypot(*(table.positions_m[first, :2] - query.poses[row, :2]))
            assert judged.right[in_queries] == (away_m <= 25.0)


def test_right_places_agree_better_than_wrong_ones(queries: LeftOutQueries) -> None:
    places = queries.aligned
    assert places is not None
    assert places.are_aligned.all()
    assert np.median(places.scores[places.right]) > np.median(places.scores[~places.right]) + 0.1


def without(switch: str) -> Config:
    names = {'encoder.name': 'ring_key', 'query.levels': 20, 'query.level': 20}
    return load_config(overrides={**names, switch: False})


def test_what_is_written_has_coefficients_of_alignments(drives: list[PositionedDrive]) -> None:
    limit, done = ErrorLimit(0.3, 0.75, 0.3), list[tuple[int, int]]()
    calibration, choice = calibrate_road(drives, CONFIG, limit, lambda *now: done.append(now))
    assert isinstance(choice, GateChoice)
    assert choice.fit.queries.aligned is not None
    query = load_config(overrides=calibration.values).query
    assert query.confidence.score > 0.0
    # Answers without an alignment have the gate of a calibration without them, or none passes.
    try:
        _, alone = calibrate_road(drives, without('query.verify'), limit)
    except DataError:
        assert query.min_probability_unaligned == 1.0
    else:
        assert isinstance(alone, GateChoice)
        assert query.min_probability_unaligned == alone.min_probability
    assert f'min_probability_unaligned {query.min_probability_unaligned:g}: ' in '\n'.join(calibration.lines)
    assert 'aligned with the 5 nearest' in calibration.lines[0]
    assert done == sorted(done)
    assert done[-1] == (done[-1][1], done[-1][1])


@pytest.mark.parametrize('switch', ['query.verify', 'encoder.signature'])
def test_a_vehicle_without_alignments_is_calibrated_without(drives: list[PositionedDrive], switch: str) -> None:
    calibration, choice = calibrate_road(drives, without(switch), ErrorLimit(0.3, 0.75, 0.3))
    assert isinstance(choice, GateChoice)
    assert choice.fit.queries.aligned is None
    assert load_config(overrides=calibration.values).query.min_probability_unaligned == 0.0


def test_a_map_of_few_places_is_searched_all_the_same(
    drives: list[PositionedDrive], encoded: list[EncodedDrive]
) -> None:
    sequences, rows = [drive.sequence for drive in drives], [drive.rows for drive in drives]
    found = RoadAlignments(encoded, sequences, rows, 5).aligned(0, np.array([0, 4]), 1, np.array([1, 20]), 25.0)
    assert found.scores.shape == (2, 5)
    assert np.isfinite(found.scores).sum(axis=1).tolist() == [2, 2]
    firsts = found.firsts(dataclasses.replace(COEFFICIENTS, score=0.0))
    assert firsts.columns.tolist() == [0, 0]
    assert firsts.right.tolist() == found.right[:, 0].tolist()
