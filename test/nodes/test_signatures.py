"""Signatures reach query nodes by messages, so that nodes that are started plainly give poses."""

from __future__ import annotations

import array
import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from live_nodes import Observer, StartNode, replay, wait_until
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from sample_signatures import packed_signature
from sensor_msgs.msg import PointCloud2
from small_maps import MODEL
from std_srvs.srv import Trigger

from offradar_ros.alignment.signature_code import checksum_of
from offradar_ros.config import MapConfig
from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.nodes import query_node
from offradar_ros.nodes.map_server_node import MapServerNode
from offradar_ros.nodes.query_node import QueryNode
from offradar_ros.retrieval.received_signatures import MOST_WANTED
from offradar_ros.ros import qos
from offradar_ros.ros.embedding_message import embedding_message, model_message
from offradar_ros.ros.place_message import PlaceRows, descriptors_message, descriptors_record
from offradar_ros.ros.signatures_message import signatures_message, wanted_record
from offradar_ros.ros.stamps import header
from offradar_ros.types import Embedding, Match, Place, PlaceTable, Pose, ScanKey

SERVER = {'map.start_session': False, 'map.allow_destructive': True, 'position.source': 'odometry'}
UNSIGNED_EVERY = 10
"""So many scans of a map, and one of them has no signature."""


def signature_at(number: int, seed: int = 0) -> bytes:
    return b'' if number % UNSIGNED_EVERY == 7 else packed_signature(number + seed)


def mean_at(number: int) -> Any:
    return np.full(3, number, np.float32)


def write_map(path: Path, count: int, first: int = 1, seed: int = 0) -> dict[ScanKey, bytes]:
    """A map of `count` places; returns the signatures of their scans."""
    with SessionMap(MapConfig(path=str(path))) as session_map:
        session_map.adopt_model(MODEL)
        session_map.start_session('drive', 1)
        for number in range(first, first + count):
            ones = np.ones(3, np.float32)
            scan = Embedding(number, mean_at(number), ones, MODEL.fingerprint, signature_at(number, seed))
            session_map.merge(scan, Pose(10.0 * number, 0.0))
        session_map.end_session()
        return session_map.signatures.read(session_map.places().scans())


def held(query: QueryNode, scans: Any) -> dict[ScanKey, bytes]:
    return query.stage._received.read(list(scans))


def wait_for_signatures(query: QueryNode, expected: dict[ScanKey, bytes], places: int) -> None:
    """Wait until the node has the signatures of the whole map, which are then the expected ones."""
    wait_until(lambda: query.stage.places == places and not query.stage.missing_signatures)
    assert held(query, expected) == expected
    assert len(query.stage._received) == len(expected)


def end(observer: Observer, node: MapServerNode) -> None:
    """As a process ends that is killed: its topics are gone."""
    node.close()
    observer.remove(node)


def test_three_nodes_that_are_started_plainly_map_a_street_and_then_answer_with_poses(
    stack: Callable[..., Stack], observer: Observer, street_bag: Callable[..., Path]
) -> None:
    outcomes = observer.collect_outcomes()
    poses = observer.collect(PoseWithCovarianceStamped, 'match_pose', qos.UPDATES)
    # Not what a map or a query reads: the ring key does not take simple streets for certain.
    plain = {'position.heading': 'auto', 'query.gate': 'paper', 'query.delta': 100.0}
    with stack(plain) as nodes:
        nodes.wait_until_ready()
        observer.wait_until_connected(match_pose=1)
        replay(nodes, street_bag('mapped', count=16), '--lockstep', '--session')
        del outcomes[:]
        replay(nodes, street_bag('again', count=16, lane_m=1.0, noise_seed=1), '--lockstep')
        wait_until(lambda: len(outcomes) == len(poses) == 16)
    matches = [outcome for outcome in outcomes if isinstance(outcome, Match)]
    assert len(matches) == 16
    assert all(match.candidates[0].alignment is not None for match in matches)
    for number, pose in enumerate(poses):
        # Of the vehicle, not of the place: 1.25 m from scan to scan, a metre beside the lane that was mapped.
        assert pose.pose.pose.position.x == pytest.approx(poses[0].pose.pose.position.x + 1.25 * number, abs=0.6)
        assert pose.pose.pose.position.y == pytest.approx(1.0, abs=0.6)
        assert abs(pose.pose.pose.orientation.z) < 0.05
        assert pose.pose.covariance[35] < 0.1


def test_a_query_node_that_starts_late_gets_every_signature(
    observer: Observer, start_node: StartNode, tmp_path: Path
) -> None:
    count = 3 * MOST_WANTED + 5
    expected = write_map(tmp_path / 'town.db', count)
    assert 0 < len(expected) < count
    start_node(MapServerNode, SERVER | {'map.path': str(tmp_path / 'town.db')})
    query = start_node(QueryNode)
    wait_for_signatures(query, expected, count)
    assert not query.status.drops


def test_two_query_nodes_that_ask_at_once_get_every_signature(
    observer: Observer, start_node: StartNode, tmp_path: Path
) -> None:
    count = 3 * MOST_WANTED + 5
    expected = write_map(tmp_path / 'town.db', count)
    other_name = ['--ros-args', '-r', '__node:=second', '-r', 'matches:=second/matches']
    queries = [start_node(QueryNode), start_node(functools.partial(QueryNode, cli_args=other_name))]
    server = start_node(MapServerNode, SERVER | {'map.path': str(tmp_path / 'town.db')})
    for query in queries:
        wait_for_signatures(query, expected, count)
        # Both ask on one topic, and neither is a stranger there.
        assert not any('map/signatures' in trouble.text for trouble in query._all_troubles())
    assert not server.status.drops


def test_after_a_restart_of_the_server_the_signatures_are_those_of_its_map(
    observer: Observer, start_node: StartNode, tmp_path: Path
) -> None:
    first = write_map(tmp_path / 'first.db', 100)
    # Some of the same scans, with other signatures: none of the former map may be taken for them.
    second = write_map(tmp_path / 'second.db', 150, first=60, seed=1000)
    assert any(second[scan] != first[scan] for scan in first.keys() & second.keys())
    server = start_node(MapServerNode, SERVER | {'map.path': str(tmp_path / 'first.db')})
    query = start_node(QueryNode)
    wait_for_signatures(query, first, 100)
    end(observer, server)
    start_node(MapServerNode, SERVER | {'map.path': str(tmp_path / 'second.db')})
    wait_for_signatures(query, second, 150)


class StandIn:
    """In place of a map server: the test says which map there is, and what is answered."""

    def __init__(self, observer: Observer, query: QueryNode) -> None:
        self.query = query
        self.wanted = observer.collect(PointCloud2, 'map/signatures_wanted', qos.UPDATES)
        self.send = observer.publisher(PointCloud2, 'map/signatures', qos.RESULTS)
        self.update = observer.publisher(PointCloud2, 'map/updates', qos.UPDATES)
        self._descriptors = observer.publisher(PointCloud2, 'map/descriptors', qos.LATCHED)

    @staticmethod
    def table(count: int) -> PlaceTable:
        places = [Place(n, 1, n, Pose(10.0 * n, 0.0, 0.0, 0.0), 0.9, mean_at(n)) for n in range(1, count + 1)]
        return PlaceTable.from_places(places, 3)

    def send_map(self, count: int) -> None:
        checksums = tuple(checksum_of(packed_signature(number)) for number in range(1, count + 1))
        rows = PlaceRows(self.table(count), MODEL.fingerprint, committed=True, checksums=checksums)
        self._descriptors(descriptors_message(rows, 7))
        wait_until(lambda: self.query.stage.places == count)

    def next_question(self) -> tuple[ScanKey, ...]:
        wait_until(lambda: self.wanted)
        return wanted_record(self.wanted.pop(0), 'map/signatures_wanted')

    def has(self, scans: tuple[ScanKey, ...]) -> bool:
        return set(held(self.query, scans)) == set(scans)

    def answer(self, scans: tuple[ScanKey, ...]) -> PointCloud2:
        return signatures_message({scan: packed_signature(scan.stamp_ns) for scan in scans}, 7)


@pytest.fixture
def stand_in(observer: Observer, start_node: StartNode) -> StandIn:
    return StandIn(observer, start_node(QueryNode))


def test_a_lost_answer_is_asked_for_again(stand_in: StandIn) -> None:
    stand_in.send_map(MOST_WANTED + 3)
    lost = stand_in.next_question()
    while stand_in.query.stage.missing_signatures:
        asked = stand_in.next_question()
        stand_in.send(stand_in.answer(asked))
        wait_until(functools.partial(stand_in.has, asked))
    every = [ScanKey(1, number) for number in range(1, MOST_WANTED + 4)]
    assert set(lost) < set(every)
    assert held(stand_in.query, every) == {scan: packed_signature(scan.stamp_ns) for scan in every}


def test_a_damaged_answer_is_counted_and_a_sound_one_is_still_taken(stand_in: StandIn) -> None:
    stand_in.send_map(3)
    asked = stand_in.next_question()
    drops = stand_in.query.status.drops
    cut = stand_in.answer(asked)
    cut.data = cut.data[:-1]
    stand_in.send(cut)
    wait_until(lambda: drops['short_data'] == 1)
    strange = stand_in.answer(asked)
    strange.fields[3].name = 'other'
    stand_in.send(strange)
    wait_until(lambda: drops['wrong_fields'] == 1)
    assert stand_in.query.stage.missing_signatures == 3
    flipped = stand_in.answer(asked)
    at = next(field.offset for field in flipped.fields if field.name == 'signature')
    flipped.data[at + 70] ^= 1
    stand_in.send(flipped)
    wait_until(lambda: drops.total() > 2)
    assert drops == {'short_data': 1, 'wrong_fields': 1, 'invalid_signature': 1}
    stand_in.send(stand_in.answer(asked))
    wait_until(lambda: stand_in.query.stage.missing_signatures == 0)
    assert held(stand_in.query, asked) == {scan: packed_signature(scan.stamp_ns) for scan in asked}


def test_rows_bring_their_signatures_and_nothing_is_asked_for(stand_in: StandIn) -> None:
    table = stand_in.table(3)
    signatures = tuple(packed_signature(number) for number in (1, 2, 3))
    rows = PlaceRows(table, MODEL.fingerprint, committed=False, signatures=signatures)
    stand_in.update(descriptors_message(rows, 7))
    wait_until(lambda: stand_in.query._update_ledger.ends.get('taken_up'))
    stand_in.send_map(3)
    assert stand_in.query.stage.missing_signatures == 0
    assert tuple(held(stand_in.query, table.scans()).values()) == signatures


def test_rows_with_a_damaged_signature_are_counted_and_refused(stand_in: StandIn) -> None:
    rows = PlaceRows(stand_in.table(1), MODEL.fingerprint, committed=False, signatures=(packed_signature(1),))
    message = deserialize_message(serialize_message(descriptors_message(rows, 7)), PointCloud2)
    message.data[-20] ^= 1
    stand_in.update(message)
    wait_until(lambda: stand_in.query.status.drops['invalid_signature'] == 1)
    assert stand_in.query._update_ledger.ends == {'refused': 1}


def test_a_recording_starts_when_the_signatures_have_come(
    observer: Observer, stand_in: StandIn, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(query_node, 'PATIENCE_S', math.inf)
    stand_in.send_map(2 * MOST_WANTED)
    client = observer.node.create_client(Trigger, 'query/start_recording')
    wait_until(client.service_is_ready)
    observer.wait_until_known_to('/query')
    answered = client.call_async(Trigger.Request())
    for _ in range(2):
        assert not answered.done()
        stand_in.send(stand_in.answer(stand_in.next_question()))
    wait_until(answered.done)
    assert answered.result().success
    assert stand_in.query.stage.missing_signatures == 0


def test_a_recording_starts_without_signatures_that_never_come(
    observer: Observer, stand_in: StandIn, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(query_node, 'PATIENCE_S', 0.1)
    stand_in.send_map(2)
    assert observer.call(Trigger, 'query/start_recording', Trigger.Request()).success
    assert stand_in.query.stage.missing_signatures == 2


def test_a_question_that_is_none_is_counted_and_the_next_is_answered(
    observer: Observer, start_node: StartNode, tmp_path: Path
) -> None:
    write_map(tmp_path / 'town.db', 3)
    server = start_node(MapServerNode, SERVER | {'map.path': str(tmp_path / 'town.db')})
    answers = observer.collect(PointCloud2, 'map/signatures', qos.RESULTS)
    ask = observer.publisher(PointCloud2, 'map/signatures_wanted', qos.RESULTS)
    observer.wait_until_connected(**{'matches': 0, 'rejections': 0, 'map/signatures': 1})
    for bad in (PointCloud2(), stand_in_question(MOST_WANTED + 1), stand_in_question(3, seconds=-1)):
        ask(bad)
    wait_until(lambda: server.status.drops.total() == 3)
    assert server.status.drops == {'wrong_fields': 1, 'wrong_size': 1, 'invalid_place': 1}
    ask(stand_in_question(5))
    wait_until(lambda: answers)
    expected = {ScanKey(1, n): signature_at(n) if 1 <= n <= 3 else b'' for n in range(5)}
    assert serialize_message(answers[0]) == serialize_message(signatures_message(expected, 0))


def stand_in_question(count: int, seconds: int = 0) -> PointCloud2:
    points = np.zeros(count, np.dtype([('session_id', '<u4'), ('stamp_sec', '<i4'), ('stamp_nanosec', '<u4')]))
    points['session_id'], points['stamp_sec'], points['stamp_nanosec'] = 1, seconds, range(count)
    message = signatures_message({ScanKey(1, 1): b''}, 0)
    message.fields = message.fields[:3]
    message.width, message.point_step, message.row_step = count, 12, 12 * count
    message.data = array.array('B', points.tobytes())
    return message


class Driver:
    """Maps scans by messages, each at a place of its own; a session of them has its own uncertainty."""

    def __init__(self, observer: Observer, start_node: StartNode) -> None:
        self._observer = observer
        self.server = start_node(MapServerNode, SERVER)
        self.query = start_node(QueryNode)
        self._rows = observer.collect(PointCloud2, 'map/updates', qos.UPDATES)
        observer.publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)(model_message(MODEL))
        self._embed = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
        self._pose = observer.publisher(Odometry, 'ground_truth/odometry', qos.POSITIONS)
        wait_until(lambda: self.server.stage.map.model is not None)
        observer.wait_until_connected(**{'matches': 0, 'rejections': 0, 'map/updates': 2, 'map/descriptors': 1})
        self._second = 1000

    def call(self, service: str) -> None:
        answer = self._observer.call(Trigger, f'map_server/{service}', Trigger.Request())
        assert answer.success, answer.message

    def drive(self, places: range, uncertainty: float) -> None:
        """Map a scan at each of these places, 10 m apart."""
        for place in places:
            self._second += 1
            stamp_ns, rows = self._second * 10**9, self._rows
            del rows[:]
            position = Odometry(header=header(stamp_ns, 'map'))
            position.pose.pose.position.x = 10.0 * place
            position.pose.pose.orientation.w = 1.0
            self._pose(position)
            variance = np.full(3, uncertainty, np.float32)
            signature = signature_at(self._second)
            scan = Embedding(stamp_ns, mean_at(place), variance, MODEL.fingerprint, signature)
            self._embed(embedding_message(scan, 'radar'))
            wait_until(functools.partial(len, rows))
            (found,) = descriptors_record(rows[-1], 'map/updates').signatures or (b'',)
            assert found == signature

    def assert_same(self) -> dict[ScanKey, bytes]:
        """The query node holds the signatures of the places that it searches, and no others."""
        committed = self.server.stage.map.committed()
        expected = self.server.stage.map.signatures.read(committed.scans())
        wait_until(lambda: self.query.stage.places == len(committed))
        wait_until(lambda: held(self.query, committed.scans()) == expected)
        wait_until(lambda: not self.query.stage.missing_signatures)
        return expected


def test_signatures_follow_the_places_that_are_replaced_undone_and_cleared(
    observer: Observer, start_node: StartNode
) -> None:
    driver = Driver(observer, start_node)
    driver.call('start_session')
    driver.drive(range(8), 1.0)
    driver.call('end_session')
    first = driver.assert_same()
    assert len(first) == 7
    driver.call('start_session')
    driver.drive(range(4, 12), 0.5)
    # The drive does not change what is searched.
    assert driver.assert_same() == first
    driver.call('end_session')
    second = driver.assert_same()
    # Of the first drive, the scan of 1007 s has none, and those of 1005 s and later have been replaced.
    assert [scan.stamp_ns // 10**9 for scan in second] == [1001, 1002, 1003, 1004, *range(1009, 1017)]
    driver.call('undo_session')
    assert driver.assert_same() == first
    driver.call('clear')
    wait_until(lambda: not driver.query.stage.places)
    assert driver.assert_same() == {}
    driver.call('start_session')
    driver.drive(range(3), 1.0)
    driver.call('end_session')
    assert [scan.stamp_ns // 10**9 for scan in driver.assert_same()] == [1018, 1019]
