"""The pipeline, the replay in lockstep and the live nodes answer the same recording alike."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from live_nodes import ROOMY, Observer, replay, wait_until
from outcome_key import key
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from std_srvs.srv import Trigger

from offradar_ros.config import load_config
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.mapping.store import MapStore
from offradar_ros.recordings.bags.reader import TYPES, Bag
from offradar_ros.recordings.bags.topics import ODOMETRY, ODOMETRY_TYPE, VEHICLE_ODOMETRY
from offradar_ros.recordings.drive import drive
from offradar_ros.retrieval.confidence import shipped_confidences
from offradar_ros.ros import qos
from offradar_ros.types import Localisation, LocalisationState, Match, Outcome

PARAMETERS = {
    'map.match_distance_m': 4.0,
    'query.top_k': 3,
    'position.heading': 'auto',
    'query.delta': 0.4,
    'encoder.name': 'ring_key',
    'encoder.ring_key.variance_scale': 2.1,
}
SCANS = 16


def coefficients() -> dict[str, Any]:
    """Those of the ring key, for the scale of the variance in PARAMETERS."""
    (shipped,) = [c for c in shipped_confidences().values() if c.model == ring_key_fingerprint({})]
    values = dataclasses.asdict(dataclasses.replace(shipped, model=ring_key_fingerprint(PARAMETERS)))
    return {f'query.confidence.{name}': value for name, value in values.items()}


def ring_key_fingerprint(values: dict[str, Any]) -> str:
    return make_encoder(load_config(overrides=values | {'encoder.name': 'ring_key'}).encoder).info.fingerprint


@pytest.fixture
def drives(street_bag: Callable[..., Path]) -> list[tuple[Path, bool]]:
    """Two mapping sessions and one that only queries, partly degraded; each an hour after the one before."""
    hour_ns = 3600 * 10**9
    start_ns = 1_600_000_000 * 10**9
    return [
        (street_bag('first', count=SCANS, start_ns=start_ns), True),
        (street_bag('second', count=SCANS, start_ns=start_ns + hour_ns, lane_m=1.0, noise_seed=1), True),
        (
            street_bag(
                'third', count=SCANS, start_ns=start_ns + 2 * hour_ns, lane_m=-1.0, noise_seed=2, degraded=(3, 4, 9)
            ),
            False,
        ),
    ]


def with_odometry(bag: Path) -> Path:
    """A copy of a bag that has the positions as odometry of the vehicle, too."""
    copy = bag.parent / f'{bag.name}_odometry'
    with Reader(bag) as reader, Writer(copy, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {c.topic: writer.add_connection(c.topic, c.msgtype, typestore=TYPES) for c in reader.connections}
        topics[VEHICLE_ODOMETRY] = writer.add_connection(VEHICLE_ODOMETRY, ODOMETRY_TYPE, typestore=TYPES)
        for connection, log_ns, data in reader.messages():
            writer.write(topics[connection.topic], log_ns, data)
            if connection.topic == ODOMETRY:
                writer.write(topics[VEHICLE_ODOMETRY], log_ns, data)
    return copy


def assert_same(found: Localisation, expected: Localisation) -> None:
    """Equal but for the rounding of a matrix product, which depends on where in memory the numbers are."""
    assert (found.stamp_ns, found.state, found.place_id) == (expected.stamp_ns, expected.state, expected.place_id)
    assert (found.p_on_map, found.p_here) == pytest.approx((expected.p_on_map, expected.p_here), abs=1e-12)
    np.testing.assert_allclose(found.position_m, expected.position_m, atol=1e-9)
    np.testing.assert_allclose(found.covariance_m2, expected.covariance_m2, atol=1e-9)


def through_pipeline(drives: list[tuple[Path, bool]], path: Path, **parameters: Any) -> list[Outcome]:
    config = load_config(overrides=PARAMETERS | {'map.path': str(path)} | parameters)
    outcomes: list[Outcome] = []
    for bag, mapped in drives:
        with Bag(bag) as opened, SessionMap(config.map) as session_map:
            result = drive(
                opened, config, make_encoder(config.encoder), session_map, session='drive' if mapped else None
            )
        outcomes += result.outcomes
    return outcomes


def through_nodes(
    drives: list[tuple[Path, bool]],
    path: Path,
    stack: Callable[..., Stack],
    observer: Observer,
    *play: str,
    **parameters: Any,
) -> list[Outcome]:
    outcomes = observer.collect_outcomes()
    with stack(PARAMETERS | ROOMY | {'map.path': str(path)} | parameters) as nodes:
        nodes.wait_until_ready()
        observer.wait_until_connected()
        for bag, mapped in drives:
            replay(nodes, bag, *play, *(['--session'] if mapped else []))
        wait_until(lambda: len(outcomes) == SCANS * len(drives))
    return outcomes


def assert_same_map(one: Path, other: Path) -> None:
    stored = [MapStore.open_read_only(path) for path in (one, other)]
    a, b = (each.places for each in stored)
    assert a.place_ids.tolist() == b.place_ids.tolist()
    assert a.stamps_ns.tolist() == b.stamps_ns.tolist()
    assert a.session_ids.tolist() == b.session_ids.tolist()
    assert a.positions_m.tobytes() == b.positions_m.tobytes()
    assert np.isfinite(a.yaws_rad).any()
    assert a.yaws_rad.tobytes() == b.yaws_rad.tobytes()
    assert np.isfinite(a.yaw_sds_rad).any()
    assert a.yaw_sds_rad.tobytes() == b.yaw_sds_rad.tobytes()
    assert a.means.tobytes() == b.means.tobytes()
    assert a.uncertainties.tobytes() == b.uncertainties.tobytes()
    assert stored[0].signatures == stored[1].signatures
    assert set(zip(a.session_ids.tolist(), a.stamps_ns.tolist(), strict=True)) <= stored[0].signatures.keys()


@pytest.mark.parametrize('signatures', ['from the file', 'by messages'])
def test_lockstep_gives_the_answers_and_map_of_the_pipeline(
    drives: list[tuple[Path, bool]], tmp_path: Path, stack: Callable[..., Stack], observer: Observer, signatures: str
) -> None:
    expected = through_pipeline(drives, tmp_path / 'pipeline.db')
    path = tmp_path / 'nodes.db'
    file = {'query.map_path': str(path)} if signatures == 'from the file' else {}
    found = through_nodes(drives, path, stack, observer, '--lockstep', **file)
    assert [key(outcome) for outcome in found] == [key(outcome) for outcome in expected]
    assert_same_map(tmp_path / 'nodes.db', tmp_path / 'pipeline.db')
    # Without alignments, matches and rejections the comparison would prove nothing.
    assert sum(o.candidates[0].alignment is not None for o in expected if isinstance(o, Match)) > SCANS
    assert sum(isinstance(outcome, Match) for outcome in expected) > SCANS
    assert {o.reason.value for o in expected if not isinstance(o, Match)} == {'map_empty', 'uncertain'}


def test_twice_real_time_gives_the_answers_and_map_of_the_pipeline(
    drives: list[tuple[Path, bool]], tmp_path: Path, stack: Callable[..., Stack], observer: Observer
) -> None:
    expected = through_pipeline(drives, tmp_path / 'pipeline.db')
    found = through_nodes(drives, tmp_path / 'nodes.db', stack, observer, '--rate', '2')
    assert [key(outcome) for outcome in found] == [key(outcome) for outcome in expected]
    assert_same_map(tmp_path / 'nodes.db', tmp_path / 'pipeline.db')


def test_a_drive_can_be_matched_to_itself_but_never_a_scan_to_itself(
    drives: list[tuple[Path, bool]], tmp_path: Path
) -> None:
    first = drives[:1]
    without = through_pipeline(first, tmp_path / 'without.db')
    assert all(not isinstance(outcome, Match) for outcome in without)
    with_own = through_pipeline(first, tmp_path / 'with.db', **{'query.exclude_current_session': False})
    matches = [outcome for outcome in with_own if isinstance(outcome, Match)]
    assert matches
    assert all(candidate.distance > 0.0 for match in matches for candidate in match.candidates)


@pytest.mark.parametrize('odometry', [False, True])
def test_lockstep_localises_as_the_pipeline(
    odometry: bool,
    drives: list[tuple[Path, bool]],
    tmp_path: Path,
    stack: Callable[..., Stack],
    observer: Observer,
) -> None:
    if odometry:
        drives = [(with_odometry(bag), mapped) for bag, mapped in drives]
    # The ring key is not certain of much.
    certain = {'localisation.decide_probability': 0.55, 'localisation.keep_probability': 0.5}
    parameters = coefficients() | certain | {'query.gate': 'paper'}
    config = load_config(overrides=PARAMETERS | {'map.path': str(tmp_path / 'pipeline.db')} | parameters)
    expected: list[Localisation | None] = []
    for bag, mapped in drives:
        with Bag(bag) as opened, SessionMap(config.map) as session_map:
            encoder = make_encoder(config.encoder)
            expected += drive(opened, config, encoder, session_map, session='d' if mapped else None).localisations
    known = [localisation for localisation in expected if localisation is not None]
    assert len(known) == 2 * SCANS
    found, outcomes = observer.collect_localisations(), observer.collect_outcomes()
    starts = observer.collect(PoseWithCovarianceStamped, 'initialpose', qos.UPDATES)
    path = str(tmp_path / 'nodes.db')
    files = {'map.path': path, 'query.map_path': path, 'query.initial_pose': True}
    with stack(PARAMETERS | ROOMY | files | parameters) as nodes:
        nodes.wait_until_ready()
        observer.wait_until_connected(localisation=1, initialpose=1)
        for bag, mapped in drives:
            replay(nodes, bag, '--lockstep', *(['--session'] if mapped else []))
        wait_until(lambda: len(found) == len(known))
        answer = observer.call(Trigger, 'query/relocalise', Trigger.Request())
    for one, other in zip(found, known, strict=True):
        assert_same(one, other)
    assert LocalisationState.ON_MAP in {localisation.state for localisation in found}
    assert 'by the last 8 scans' in answer.message
    # Not with every scan, and with the heading of the drives, eastwards.
    assert 1 <= len(starts) <= len(drives)
    assert abs(starts[0].pose.pose.orientation.z) < 0.1
    assert starts[0].pose.covariance[35] < 0.1
    assert len(outcomes) == len(drives) * SCANS
