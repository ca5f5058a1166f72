"""Localisation in the query stage: on the map, off it, from the last scans alone, and where it is not possible."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray
from street_sequence import StreetSequence

from offradar_ros.alignment.signature import SignatureMaker
from offradar_ros.alignment.signature_code import pack
from offradar_ros.config import ConfidenceConfig, LocalisationConfig, QueryConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.retrieval.received_signatures import ReceivedSignatures
from offradar_ros.stages.query import QueryStage
from offradar_ros.types import Embedding, Localisation, LocalisationState, Place, PlaceTable, Pose, ScanKey

MODEL = 'a' * 64
COEFFICIENTS = ConfidenceConfig(
    model=MODEL, intercept=3.0, distance=-6.0, spatial_ratio=-10.0, place_ratio=-10.0, unrelated_distance=1.0
)
CONFIG = QueryConfig(confidence=COEFFICIENTS)
PERIOD_NS, STEP_M = 500_000_000, 5.0
PLACES = 60


def appearance(start_m: float, count: int, seed: int) -> NDArray[np.float32]:
    """(N, 64) means of unit length, every 5 m of a road: near positions look alike, others do not."""
    x_m = start_m + STEP_M * np.arange(count)
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(2, 16)), rng.uniform(0.02, 0.12, 16)
    phases = np.outer(x_m, waves[1])
    made = np.concatenate([np.cos(phases + waves[0][0]), np.sin(phases + waves[0][1])], axis=1)
    spread = np.concatenate([made, np.roll(made, 5, axis=1) * np.sign(made)], axis=1)
    means: NDArray[np.float32] = (spread / np.linalg.norm(spread, axis=1, keepdims=True)).astype(np.float32)
    return means


def road() -> PlaceTable:
    means = appearance(0.0, PLACES, 1)
    made = [Place(100 + i, 1, i, Pose(STEP_M * i, 0.0), 1.0, mean) for i, mean in enumerate(means)]
    return PlaceTable.from_places(made, means.shape[1])


def scan(number: int, mean: NDArray[np.float32]) -> Embedding:
    return Embedding((number + 1) * PERIOD_NS, mean, np.ones(len(mean), np.float32), MODEL)


def drive(stage: QueryStage, first: int, means: NDArray[np.float32]) -> list[Localisation]:
    found = []
    for number, mean in enumerate(means, start=first):
        stage.query(scan(number, mean))
        localised = stage.localise()
        assert localised is not None
        found.append(localised)
    return found


@pytest.fixture
def stage() -> QueryStage:
    made = QueryStage(CONFIG, LocalisationConfig(relocalise_scans=6))
    made.load(road(), MODEL)
    return made


def along(start_m: float, count: int) -> NDArray[np.float32]:
    return appearance(start_m + 1.5, count, 1)


def elsewhere(count: int) -> NDArray[np.float32]:
    return appearance(0.0, count, 2)


def test_it_follows_the_vehicle_off_the_map_and_back(stage: QueryStage) -> None:
    mapped = drive(stage, 0, along(100.0, 12))
    assert mapped[-1].state is LocalisationState.ON_MAP
    assert mapped[-1].position_m[0] == pytest.approx(100.0 + 11 * STEP_M, abs=15.0)
    away = drive(stage, 12, elsewhere(20))
    assert away[-1].state is LocalisationState.OFF_MAP
    assert away[-1].p_on_map < 0.01
    back = drive(stage, 32, along(20.0, 20))
    assert back[-1].state is LocalisationState.ON_MAP
    assert back[-1].position_m[0] == pytest.approx(20.0 + 19 * STEP_M, abs=15.0)


def test_relocalising_uses_the_last_scans_alone(stage: QueryStage) -> None:
    assert stage.relocalise() == (None, 'no scan has been received')
    drive(stage, 0, elsewhere(30))
    off = stage.relocalise()
    assert not off.found
    assert off.localisation is not None
    assert off.detail.startswith(('off_map: ', 'unsure: '))
    drive(stage, 30, along(150.0, 6))
    found = stage.relocalise()
    assert found.found
    assert found.localisation is not None
    assert found.localisation.position_m[0] == pytest.approx(175.0, abs=10.0)
    assert found.detail.endswith('by the last 6 scans, 6 of them usable')
    # It forgets nothing that the belief knows.
    assert stage.relocalise().localisation is not None


def test_odometry_narrows_where_the_vehicle_may_be(stage: QueryStage) -> None:
    without = drive(stage, 0, along(100.0, 4))[-1]
    driven = QueryStage(CONFIG, LocalisationConfig())
    driven.load(road(), MODEL)
    for number in range(4):
        driven.add_odometry((number + 1) * PERIOD_NS, Pose(STEP_M * number, 0.0))
    with_odometry = drive(driven, 0, along(100.0, 4))[-1]
    assert with_odometry.p_here > without.p_here
    with pytest.raises(RefusedInput, match='odometry of stamp'):
        driven.add_odometry(PERIOD_NS * 3, Pose(0.0, 0.0))


def test_a_scan_twice_changes_nothing(stage: QueryStage) -> None:
    (first,) = drive(stage, 0, along(100.0, 1))
    stage.query(scan(0, along(100.0, 1)[0]))
    with pytest.raises(RefusedInput, match='already received'):
        stage.localise()
    # Refused by the encoder: nothing to count here.
    stage.query(Embedding(PERIOD_NS, np.empty(0, np.float32), np.empty(0, np.float32), MODEL))
    assert stage.localise() is None
    assert drive(stage, 1, along(105.0, 1))[0].stamp_ns > first.stamp_ns


def test_a_scan_that_says_nothing_only_moves_the_belief(stage: QueryStage) -> None:
    known = drive(stage, 0, along(100.0, 8))[-1]
    stage.query(Embedding(9 * PERIOD_NS, np.empty(0, np.float32), np.empty(0, np.float32), MODEL))
    predicted = stage.localise()
    assert predicted is not None
    assert predicted.stamp_ns == 9 * PERIOD_NS
    assert predicted.p_here < known.p_here


def test_after_a_map_change_the_belief_is_of_the_new_map(stage: QueryStage) -> None:
    drive(stage, 0, along(100.0, 8))
    table = road()
    moved = dataclasses.replace(table, positions_m=table.positions_m + np.array([0.0, 500.0, 0.0]))
    stage.load(moved, MODEL)
    found = drive(stage, 8, along(140.0, 6))[-1]
    assert found.position_m[1] == pytest.approx(500.0, abs=1.0)


def test_it_says_why_there_is_no_localisation() -> None:
    stage = QueryStage(CONFIG)
    assert stage.localise() is None
    stage.query(scan(0, along(0.0, 1)[0]))
    assert stage.localise() is None
    assert stage.relocalise().detail == 'no map to search'
    small = QueryStage(CONFIG, LocalisationConfig(max_places=10))
    small.load(road(), MODEL)
    small.query(scan(0, along(0.0, 1)[0]))
    assert small.localise() is None
    assert 'more than localisation.max_places = 10' in small.relocalise().detail
    assert QueryStage(CONFIG, LocalisationConfig(max_places=0)).not_localised == 'localisation.max_places is 0'
    other = QueryStage(QueryConfig())
    other.load(road(), MODEL)
    assert other.not_localised == f'no coefficients of the probability are known for model {MODEL[:12]}'


def test_without_the_tolerance_that_it_had_it_starts_again(stage: QueryStage) -> None:
    drive(stage, 0, along(100.0, 8))
    stage.reconfigure(dataclasses.replace(CONFIG, tolerance_m=30.0))
    assert stage.relocalise().detail == 'no scan has been received'
    assert drive(stage, 8, along(140.0, 4))[-1].state is LocalisationState.ON_MAP


def along_the_street(*, verify: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N,) errors of the position in m, and (N,) variances, 1 m beside places that are every 5 m of a street.

    The scans are half-way between two places.
    """
    make, mapped, driven = (
        SignatureMaker(),
        StreetSequence(count=33),
        StreetSequence(count=33, lane_m=1.0, noise_seed=2),
    )
    means = appearance(0.0, 9, 1)
    places = [Place(i, 1, i, Pose(STEP_M * i, 0.0, 0.0, 0.0), 1.0, means[i]) for i in range(9)]
    signatures = ReceivedSignatures()
    stage = QueryStage(dataclasses.replace(CONFIG, verify=verify), LocalisationConfig(), signatures)
    stage.load(PlaceTable.from_places(places, means.shape[1]), MODEL)
    for place in places:
        signatures.put(ScanKey(1, place.stamp_ns), pack(make(mapped.scan(4 * place.stamp_ns))))
    errors_m, variances_m2 = [], []
    for number, row in enumerate(range(6, 28, 4)):
        embedded = scan(number, appearance(1.25 * row, 1, 1)[0])
        stage.query(dataclasses.replace(embedded, signature=pack(make(driven.scan(row)))))
        found = stage.localise()
        assert found is not None
        errors_m.append(np.hypot(*(found.position_m - [1.25 * row, 1.0])))
        variances_m2.append(np.trace(found.covariance_m2))
    return np.array(errors_m), np.array(variances_m2)


def test_an_alignment_makes_the_position_exact() -> None:
    errors_m, variances_m2 = along_the_street(verify=True)
    of_places_m, of_places_m2 = along_the_street(verify=False)
    assert errors_m.max() < 0.6
    assert np.median(of_places_m) > 1.0
    assert variances_m2.max() < 0.5 * of_places_m2.min()


def test_no_answer_depends_on_localisation(stage: QueryStage) -> None:
    plain = QueryStage(CONFIG, LocalisationConfig(max_places=0))
    plain.load(road(), MODEL)
    for number, mean in enumerate(np.concatenate([along(100.0, 6), elsewhere(6)])):
        localised, other = stage.query(scan(number, mean)), plain.query(scan(number, mean))
        stage.localise()
        assert repr(localised) == repr(other)
