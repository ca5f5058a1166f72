"""Diagnostics are never OK in silence: they say what is missing, why, and what to do."""

from __future__ import annotations

import array
import math
import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from live_nodes import Observer, StartNode, wait_until
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, NavSatFix, PointCloud2
from std_srvs.srv import Trigger

from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.nodes.encoder_node import EncoderNode
from offradar_ros.nodes.map_server_node import MapServerNode
from offradar_ros.nodes.query_node import QueryNode
from offradar_ros.ros import answer_watch, input_watch, qos
from offradar_ros.ros.embedding_message import embedding_message, model_message
from offradar_ros.ros.place_message import PlaceRows, descriptors_message
from offradar_ros.ros.stage_node import StageNode
from offradar_ros.ros.stamps import header
from offradar_ros.types import Embedding, Place, PlaceTable, Pose

SECOND = 10**9
MODEL = ModelInfo('ring_key', 'ab' * 32, 8, {})
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
SCANS = 'radar_data/b_scan_image'


class Reports:
    """What one node reports."""

    def __init__(self, observer: Observer, name: str) -> None:
        self._name = f'{name}: offradar_ros'
        self._received: list[DiagnosticArray] = observer.collect(DiagnosticArray, '/diagnostics')

    @property
    def last(self) -> DiagnosticStatus | None:
        found = [each for message in list(self._received) for each in message.status if each.name == self._name]
        return found[-1] if found else None

    def wait_for(self, level: bytes, *texts: str) -> DiagnosticStatus:
        """The next report of a level whose message holds the texts."""

        def is_wanted() -> DiagnosticStatus | None:
            last = self.last
            return last if last and last.level == level and all(text in last.message for text in texts) else None

        try:
            found: DiagnosticStatus = wait_until(is_wanted)
        except AssertionError:
            pytest.fail(f'expected {level!r} with {texts}, got {self.last}')
        return found


@pytest.fixture(autouse=True)
def _short_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(input_watch, 'FIRST_S', 1.0)
    monkeypatch.setattr(input_watch, 'LEAST_S', 1.0)


def embedding(stamp_ns: int, model: str = MODEL.fingerprint) -> PointCloud2:
    mean = np.random.default_rng(stamp_ns).normal(size=8).astype(np.float32)
    return embedding_message(Embedding(stamp_ns, mean, np.ones(8, np.float32), model), 'radar')


def fix(stamp_ns: int) -> NavSatFix:
    return NavSatFix(header=header(stamp_ns, 'gps'), latitude=51.75, longitude=-1.25, altitude=70.0)


@pytest.mark.parametrize(
    ('kind', 'name', 'topic', 'source'),
    [
        (EncoderNode, 'encoder', f'/{SCANS}', "the radar's driver"),
        (MapServerNode, 'map_server', '/embedding', 'encoder_node'),
        (QueryNode, 'query', '/embedding', 'encoder_node'),
    ],
)
def test_an_input_that_nobody_publishes_is_a_warning_and_then_an_error(
    observer: Observer, start_node: StartNode, kind: type[StageNode], name: str, topic: str, source: str
) -> None:
    reports = Reports(observer, name)
    start_node(kind)
    expected = f'nothing ever came on {topic} in '
    reports.wait_for(DiagnosticStatus.WARN, expected)
    reports.wait_for(DiagnosticStatus.ERROR, expected, f'nobody publishes there: is {source} running')


def test_a_radar_that_stops_is_noticed_and_one_that_returns_too(observer: Observer, start_node: StartNode) -> None:
    reports = Reports(observer, 'encoder')
    node = start_node(EncoderNode)
    send = observer.publisher(Image, SCANS, qos.SCANS)
    received = len(observer.collect(PointCloud2, 'embedding'))

    def scan() -> bool:
        send(Image(header=header(received, 'radar'), encoding='rgb8'))
        return reports.last is not None and 'nothing' not in reports.last.message and node.status.drops.total() > 3

    wait_until(scan)
    reports.wait_for(
        DiagnosticStatus.ERROR, f'nothing on /{SCANS} for ', '/observer publishes there, and sends nothing'
    )
    wait_until(scan)


def test_a_topic_of_the_same_type_is_named(observer: Observer, start_node: StartNode) -> None:
    observer.node.create_publisher(Image, '/radar/polar', qos.SCANS)
    reports = Reports(observer, 'encoder')
    start_node(EncoderNode)
    reports.wait_for(
        DiagnosticStatus.ERROR, 'but sensor_msgs/msg/Image is published on /radar/polar', f'-r {SCANS}:=TOPIC'
    )


@pytest.fixture
def somebody(domain_id: int) -> Iterator[Observer]:
    """A second participant: within one, ROS allows a topic one type only."""
    somebody = Observer(domain_id)
    yield somebody
    somebody.close()


def test_another_type_on_the_topic_is_named(observer: Observer, start_node: StartNode, somebody: Observer) -> None:
    somebody.node.create_publisher(NavSatFix, SCANS, qos.SCANS)
    reports = Reports(observer, 'encoder')
    start_node(EncoderNode)
    reports.wait_for(DiagnosticStatus.ERROR, '/observer publishes sensor_msgs/msg/NavSatFix there')


def test_scans_that_are_published_best_effort_are_heard(observer: Observer, start_node: StartNode) -> None:
    node = start_node(EncoderNode)
    send = observer.node.create_publisher(Image, SCANS, BEST_EFFORT)

    def is_heard() -> bool:
        send.publish(Image(header=header(1, 'radar'), encoding='rgb8'))
        return node.status.drops.total() > 0

    wait_until(is_heard)


def test_an_override_of_the_quality_of_service_is_kept_and_named(observer: Observer, start_node: StartNode) -> None:
    observer.node.create_publisher(Image, SCANS, BEST_EFFORT)
    reports = Reports(observer, 'encoder')
    start_node(EncoderNode, {f'qos_overrides./{SCANS}.subscription.reliability': 'reliable'})
    reports.wait_for(
        DiagnosticStatus.ERROR,
        '/observer publishes there with another quality of service: best effort: set the parameter '
        f'qos_overrides./{SCANS}.subscription.reliability to best_effort',
    )


class Server:
    """A map server with a session, and what it is sent."""

    def __init__(self, observer: Observer, start_node: StartNode, **parameters: Any) -> None:
        self._observer = observer
        self.reports = Reports(observer, 'map_server')
        self.node = start_node(MapServerNode, parameters)
        observer.publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)(model_message(MODEL))
        self.embed = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
        wait_until(lambda: self.node.stage.map.model)
        self.stamp_ns = 10 * SECOND

    def scan(self) -> None:
        self.stamp_ns += SECOND // 4
        self.embed(embedding(self.stamp_ns))

    def wait_for(self, level: bytes, *texts: str) -> None:
        """As `Reports.wait_for`, while scans come."""

        def is_wanted() -> bool:
            self.scan()
            last = self.reports.last
            return last is not None and last.level == level and all(text in last.message for text in texts)

        try:
            wait_until(is_wanted)
        except AssertionError:
            pytest.fail(f'expected {level!r} with {texts}, got {self.reports.last}')

    def wait_for_another_report(self) -> None:
        before = self.reports.last
        wait_until(lambda: self.reports.last is not before)

    def end(self) -> str:
        return str(self._observer.call(Trigger, 'map_server/end_session', Trigger.Request()).message)


@pytest.fixture
def server(observer: Observer, start_node: StartNode) -> Callable[..., Server]:
    return lambda **parameters: Server(observer, start_node, **parameters)


def test_positions_that_are_published_best_effort_are_mapped_with(
    observer: Observer, server: Callable[..., Server]
) -> None:
    mapping = server()
    send = observer.node.create_publisher(NavSatFix, 'gps/fix', BEST_EFFORT)

    def is_mapped() -> bool:
        mapping.scan()
        send.publish(fix(mapping.stamp_ns))
        return len(mapping.node.stage.map) > 0

    wait_until(is_mapped)
    assert '1 inserted' in mapping.end()


def test_positions_are_listened_to_reliably_again(observer: Observer, server: Callable[..., Server]) -> None:
    """A replay in lockstep sends more positions at once than a best-effort subscription takes."""
    mapping = server()
    reliability = lambda: mapping.node._positions.subscription.qos_profile.reliability  # noqa: E731
    unreliable = observer.node.create_publisher(NavSatFix, 'gps/fix', BEST_EFFORT)
    wait_until(lambda: reliability() == ReliabilityPolicy.BEST_EFFORT)
    observer.node.destroy_publisher(unreliable)
    send = observer.node.create_publisher(NavSatFix, 'gps/fix', qos.POSITIONS)
    wait_until(lambda: reliability() == ReliabilityPolicy.RELIABLE and send.get_subscription_count() > 0)
    send.publish(fix(10 * SECOND))
    wait_until(lambda: mapping.node._positions.watch.ever)


def test_positions_that_never_came_are_named_live_and_in_the_report(
    observer: Observer, server: Callable[..., Server]
) -> None:
    receiver = observer.node.create_publisher(NavSatFix, '/fix', qos.POSITIONS)
    mapping = server(**{'position.wait_s': 1.0})
    expected = ('nothing ever came on /gps/fix in ', 'sensor_msgs/msg/NavSatFix is published on /fix')
    mapping.wait_for(DiagnosticStatus.ERROR, *expected, '-r gps/fix:=TOPIC')
    # The report is asked for after the drive, when the receiver may be off.
    observer.node.destroy_publisher(receiver)
    mapping.wait_for(DiagnosticStatus.ERROR, 'nobody publishes there: is the receiver of positions running')
    report = mapping.end()
    assert 'no position ever came on /gps/fix: nobody publishes there, but sensor_msgs/msg/NavSatFix' in report


def test_positions_of_the_other_type_are_named(observer: Observer, server: Callable[..., Server]) -> None:
    observer.node.create_publisher(Odometry, '/odom', qos.POSITIONS)
    mapping = server()
    mapping.wait_for(
        DiagnosticStatus.ERROR, 'nav_msgs/msg/Odometry is published on /odom: set position.source: odometry'
    )


def test_without_a_session_positions_are_not_missed(server: Callable[..., Server]) -> None:
    mapping = server(**{'map.start_session': False})
    mapping.wait_for(DiagnosticStatus.OK, 'Hz')
    for _ in range(3):
        mapping.wait_for_another_report()
        mapping.wait_for(DiagnosticStatus.OK, 'Hz')


def test_clocks_that_are_apart_are_told_of(observer: Observer, server: Callable[..., Server]) -> None:
    mapping = server(**{'position.wait_s': 0.5})
    send = observer.publisher(NavSatFix, 'gps/fix', qos.POSITIONS)

    def scan_and_fix() -> bool:
        mapping.scan()
        send(fix(mapping.stamp_ns - 37 * SECOND))
        last = mapping.reports.last
        told = {value.key: value.value for value in last.values}.get('trouble.clocks_apart', '') if last else ''
        # The stamps of this test run faster than its clock: a message that arrives late is off by more than it is late.
        return re.search(r'the clocks of radar and positions disagree by 3[5-9]\.', told) is not None

    wait_until(scan_and_fix)


def test_a_map_of_another_model_is_an_error(observer: Observer, server: Callable[..., Server]) -> None:
    mapping = server()
    send = observer.publisher(NavSatFix, 'gps/fix', qos.POSITIONS)
    for second in (10, 11):
        send(fix(second * SECOND))
    mapping.scan()
    wait_until(lambda: len(mapping.node.stage.map))
    other = ModelInfo('variational', 'cd' * 32, 8, {})
    observer.publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)(model_message(other))
    mapping.reports.wait_for(DiagnosticStatus.ERROR, 'ring_key', 'variational')
    # The right one comes back.
    observer.publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)(model_message(MODEL))
    wait_until(lambda: mapping.reports.last and 'variational' not in mapping.reports.last.message)


def test_odometry_that_never_turns_with_the_vehicle_is_named(observer: Observer, start_node: StartNode) -> None:
    """Its driver leaves the orientation as it is in a new message."""
    reports = Reports(observer, 'map_server')
    start_node(MapServerNode, {'position.source': 'odometry', 'position.heading': 'auto'})
    send = observer.publisher(Odometry, 'ground_truth/odometry', qos.POSITIONS)
    for tenths in range(200):
        turned = 0.02 * tenths
        message = Odometry(header=header(10 * SECOND + tenths * SECOND // 10, 'map'))
        message.pose.pose.position.x, message.pose.pose.position.y = 40.0 * math.sin(turned), -40.0 * math.cos(turned)
        send(message)
    status = reports.wait_for(DiagnosticStatus.WARN, 'the heading that comes with positions is always 0.0°')
    assert 'trouble.heading' in {each.key for each in status.values}


def test_a_query_node_without_a_map_says_why(observer: Observer, start_node: StartNode, tmp_path: Path) -> None:
    reports = Reports(observer, 'query')
    query = start_node(QueryNode)
    reports.wait_for(DiagnosticStatus.ERROR, 'no map to search: nobody publishes /map/descriptors: is map_server_node')
    start_node(MapServerNode)
    reports.wait_for(DiagnosticStatus.ERROR, 'no map to search: no session with a mapped scan has ended')
    query.trigger_deactivate()
    query.destroy_node()
    path = tmp_path / 'town.db'
    start_node(QueryNode, {'query.map_path': str(path)})
    reports.wait_for(DiagnosticStatus.ERROR, f'no map to search: query.map_path: {path} does not exist yet')


def test_a_query_that_rejects_everything_says_so(
    observer: Observer, start_node: StartNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(answer_watch, 'REJECTED', 5)
    reports = Reports(observer, 'query')
    rows = [Place(i, 1, i, Pose(10.0 * i, 0.0), 0.9, np.full(8, i, np.float32)) for i in range(3)]
    table = PlaceTable.from_places(rows, 8)
    start_node(QueryNode)
    observer.publisher(PointCloud2, 'map/descriptors', qos.LATCHED)(
        descriptors_message(PlaceRows(table, MODEL.fingerprint, committed=True), 0)
    )
    send = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
    for stamp in range(5):
        send(embedding((stamp + 1) * SECOND, 'cd' * 32))
    reports.wait_for(DiagnosticStatus.ERROR, 'were all rejected, mostly as wrong_model: the map and the encoder are of')


def test_who_else_publishes_our_outputs_is_named(observer: Observer, start_node: StartNode) -> None:
    reports = Reports(observer, 'encoder')
    start_node(EncoderNode)
    observer.node.create_publisher(PointCloud2, 'embedding', qos.RESULTS)
    status = reports.wait_for(DiagnosticStatus.WARN, '/observer publishes /embedding too: launched twice?')
    assert 'trouble.rival./observer' in {each.key for each in status.values}


def test_a_second_node_of_the_same_name_is_named(observer: Observer, start_node: StartNode) -> None:
    reports = Reports(observer, 'query')
    start_node(QueryNode)
    start_node(QueryNode)
    reports.wait_for(DiagnosticStatus.WARN, 'another /query publishes /localisation, ', 'too: launched twice?')


def test_another_type_on_our_output_is_named(observer: Observer, start_node: StartNode, somebody: Observer) -> None:
    reports = Reports(observer, 'map_server')
    start_node(MapServerNode)
    somebody.node.create_publisher(OccupancyGrid, 'map', qos.LATCHED)
    reports.wait_for(DiagnosticStatus.WARN, '/map also carries nav_msgs/msg/OccupancyGrid', '-r /map_server:/map:=NAME')


def test_a_map_file_that_is_removed_is_an_error(observer: Observer, start_node: StartNode, tmp_path: Path) -> None:
    reports = Reports(observer, 'map_server')
    path = tmp_path / 'town.db'
    start_node(MapServerNode, {'map.path': str(path), 'map.start_session': False})
    path.rename(tmp_path / 'elsewhere.db')
    reports.wait_for(DiagnosticStatus.ERROR, f'{path}: the map file was removed or renamed')
    (tmp_path / 'elsewhere.db').rename(path)
    wait_until(lambda: reports.last and str(path) not in reports.last.message)


def test_two_sources_of_one_input_are_named(observer: Observer, start_node: StartNode, somebody: Observer) -> None:
    """As where a recording is played while the driver runs, or two receivers are on."""
    encoder, server = Reports(observer, 'encoder'), Reports(observer, 'map_server')
    start_node(EncoderNode)
    start_node(MapServerNode)
    for participant in (observer, somebody):
        participant.node.create_publisher(Image, SCANS, qos.SCANS)
        participant.node.create_publisher(NavSatFix, 'gps/fix', qos.POSITIONS)
    status = encoder.wait_for(DiagnosticStatus.WARN, f'/{SCANS} is published by /observer and /observer, and mixed')
    assert f'trouble.several_sources.{SCANS}' in {each.key for each in status.values}
    server.wait_for(DiagnosticStatus.WARN, '/gps/fix is published by /observer and /observer, and mixed: stop one')


def test_one_source_is_no_trouble(observer: Observer, start_node: StartNode) -> None:
    reports = Reports(observer, 'encoder')
    node = start_node(EncoderNode)
    send = observer.publisher(Image, SCANS, qos.SCANS)
    send(Image(header=header(1, 'radar'), encoding='rgb8'))
    wait_until(node.status.drops.total)
    assert 'mixed' not in reports.wait_for(DiagnosticStatus.WARN, 'wrong_encoding').message


@pytest.mark.parametrize(
    ('kind', 'name'), [(EncoderNode, 'encoder'), (MapServerNode, 'map_server'), (QueryNode, 'query')]
)
def test_simulated_time_without_a_clock_is_named(
    observer: Observer, start_node: StartNode, kind: type[StageNode], name: str
) -> None:
    reports = Reports(observer, name)
    start_node(kind, {'use_sim_time': True})
    reports.wait_for(DiagnosticStatus.WARN, 'use_sim_time is true, and nothing came on /clock: start who publishes it')
    observer.publisher(Clock, '/clock', qos.RESULTS)(Clock(clock=Time(sec=5)))
    wait_until(lambda: reports.last and '/clock' not in reports.last.message)


def is_handled(node: StageNode, count: int) -> bool:
    return node.status.handled >= count


def test_scans_that_are_no_whole_turn_are_named(observer: Observer, start_node: StartNode) -> None:
    reports = Reports(observer, 'encoder')
    node = start_node(EncoderNode, {'encoder.backlog': 50})
    send = observer.publisher(Image, SCANS, qos.SCANS)
    power = np.random.default_rng(0).integers(1, 256, (200, 576)).astype(np.uint8)
    for number in range(1, 13):
        data = array.array('B', power.tobytes())
        send(
            Image(header=header(number * SECOND, 'radar'), height=200, width=576, step=576, encoding='8UC1', data=data)
        )
        wait_until(partial(is_handled, node, number))
    reports.wait_for(DiagnosticStatus.WARN, 'fewer rows than radar.azimuth_samples = 400, and are taken for the first')
