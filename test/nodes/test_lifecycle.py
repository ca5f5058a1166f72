"""Nodes start by themselves or by transitions, accept parameters within bounds, and end cleanly without loss."""

from __future__ import annotations

import array
import contextlib
import itertools
import math
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from live_nodes import WAIT_S, Observer, StartNode, replay, wait_until
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.parameter import Parameter as RclpyParameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image, NavSatFix, PointCloud2
from small_maps import make_map
from std_srvs.srv import Trigger

from offradar_ros.encoders.onnx_model import read_onnx
from offradar_ros.encoders.pretrained import find_weights
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.lab.live.node_processes import Stack, isolated_environment
from offradar_ros.mapping.store import MapStore
from offradar_ros.nodes.encoder_node import EncoderNode
from offradar_ros.nodes.map_server_node import MapServerNode
from offradar_ros.nodes.query_node import QueryNode
from offradar_ros.ros import qos
from offradar_ros.ros.embedding_message import embedding_message, model_message
from offradar_ros.ros.place_message import PlaceRows, descriptors_message
from offradar_ros.ros.stage_node import StageNode
from offradar_ros.ros.stamps import header
from offradar_ros.stages import map as map_stage
from offradar_ros.types import Embedding, Place, PlaceTable, Pose

NODES = ['encoder_node', 'map_server_node', 'query_node']


def state(observer: Observer, node: str) -> int:
    return int(observer.call(GetState, f'{node}/get_state', GetState.Request()).current_state.id)


def change(observer: Observer, node: str, transition: int) -> bool:
    request = ChangeState.Request(transition=Transition(id=transition))
    return bool(observer.call(ChangeState, f'{node}/change_state', request).success)


@pytest.mark.parametrize(
    ('kind', 'name'), [(EncoderNode, 'encoder'), (MapServerNode, 'map_server'), (QueryNode, 'query')]
)
def test_without_autostart_a_node_waits_for_its_transitions(
    observer: Observer, start_node: StartNode, kind: type[StageNode], name: str
) -> None:
    start_node(kind, {'autostart': False})
    assert state(observer, name) == State.PRIMARY_STATE_UNCONFIGURED
    assert change(observer, name, Transition.TRANSITION_CONFIGURE)
    assert change(observer, name, Transition.TRANSITION_ACTIVATE)
    assert state(observer, name) == State.PRIMARY_STATE_ACTIVE
    assert change(observer, name, Transition.TRANSITION_DEACTIVATE)
    assert change(observer, name, Transition.TRANSITION_CLEANUP)
    assert change(observer, name, Transition.TRANSITION_CONFIGURE)
    assert change(observer, name, Transition.TRANSITION_ACTIVATE)


def test_a_configuration_that_fails_leaves_the_node_unconfigured(
    observer: Observer, start_node: StartNode, tmp_path: Path
) -> None:
    start_node(MapServerNode, {'autostart': False, 'map.path': str(tmp_path / 'no folder' / 'map.db')})
    assert not change(observer, 'map_server', Transition.TRANSITION_CONFIGURE)
    assert state(observer, 'map_server') == State.PRIMARY_STATE_UNCONFIGURED


def test_a_node_that_is_composed_ends_with_destroy_node(domain_id: int) -> None:
    program = (
        'import rclpy\n'
        'from offradar_ros.nodes.encoder_node import EncoderNode\n'
        'rclpy.init()\n'
        'node = EncoderNode()\n'
        'node.start()\n'
        'node.configure()\n'
        'node.destroy_node()\n'
        'rclpy.shutdown()\n'
    )
    environment = isolated_environment(domain_id)
    subprocess.run([sys.executable, '-c', program], env=environment, check=True, timeout=WAIT_S)


def test_the_model_reaches_a_late_subscriber(observer: Observer, start_node: StartNode) -> None:
    start_node(EncoderNode)
    received = observer.collect(DiagnosticStatus, 'embedding/model', qos.LATCHED)
    model = wait_until(lambda: received)[0]
    assert model.name == 'ring_key'
    assert len(model.hardware_id) == 64


def test_without_parameters_the_encoder_is_the_one_that_ships(observer: Observer) -> None:
    node = EncoderNode(context=observer.context)
    node.start()
    observer.add(node)
    received = observer.collect(DiagnosticStatus, 'embedding/model', qos.LATCHED)
    model = wait_until(lambda: received)[0]
    shipped = read_onnx(find_weights('compact', ('.onnx',))).header
    assert (model.name, model.hardware_id) == ('variational', shipped.fingerprint)
    node.close()


def set_parameter(observer: Observer, node: str, name: str, value: ParameterValue) -> Any:
    request = SetParameters.Request(parameters=[Parameter(name=name, value=value)])
    return observer.call(SetParameters, f'{node}/set_parameters', request).results[0]


def test_thresholds_change_at_run_time_within_bounds(observer: Observer, start_node: StartNode) -> None:
    node = start_node(QueryNode)
    level = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=5)
    assert set_parameter(observer, 'query', 'query.level', level).successful
    assert node.stage.threshold == 1.0
    too_high = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=11)
    refused = set_parameter(observer, 'query', 'query.level', too_high)
    assert not refused.successful
    assert 'expected at most query.levels = 10, got 11' in refused.reason
    assert node.stage.threshold == 1.0


def test_the_map_file_cannot_be_swapped_under_a_running_server(observer: Observer, start_node: StartNode) -> None:
    start_node(MapServerNode)
    other = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value='other.db')
    assert not set_parameter(observer, 'map_server', 'map.path', other).successful


def test_parameters_describe_themselves(observer: Observer, start_node: StartNode) -> None:
    start_node(MapServerNode)
    request = DescribeParameters.Request(names=['map.match_distance_m'])
    (described,) = observer.call(DescribeParameters, 'map_server/describe_parameters', request).descriptors
    assert '[m]' in described.description
    assert described.floating_point_range[0].from_value == 0.01


def run_node(name: str, environment: dict[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, '-m', f'offradar_ros.nodes.{name}', '--ros-args', *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=WAIT_S, check=False)


@pytest.mark.parametrize(
    ('name', 'arguments', 'expected'),
    [
        ('map_server_node', ['-p', 'map.path:=/no/such/folder/map.db'], '/no/such/folder'),
        ('map_server_node', ['-p', 'map.match_distance_m:=-1.0'], 'map.match_distance_m: expected at least 0.01 m'),
        ('query_node', ['-p', 'query.map_path:=/no/such/map.db'], '/no/such/map.db'),
        ('encoder_node', ['-p', 'encoder.weights:=missing'], 'encoder.weights: expected a .onnx or .safetensors'),
        ('encoder_node', ['-p', 'encoder.name:=mine'], 'encoder.name: expected one of variational, '),
        ('encoder_node', ['-p', 'radar.profile:=lidar'], 'radar.profile: expected one of auto'),
    ],
)
def test_a_start_that_must_fail_is_one_line_and_status_1(
    stack: Callable[..., Stack], name: str, arguments: list[str], expected: str
) -> None:
    ended = run_node(name, stack().environment, *arguments)
    errors = [line for line in ended.stderr.splitlines() if line.startswith('error: ')]
    assert ended.returncode == 1, ended.stderr
    assert len(errors) == 1
    assert expected in errors[0]
    assert 'Traceback' not in ended.stderr


@pytest.mark.usefixtures('hang_up_ends')
@pytest.mark.parametrize(
    'signals', [[signal.SIGINT], [signal.SIGINT, signal.SIGINT], [signal.SIGTERM], [signal.SIGHUP]]
)
def test_every_signal_ends_every_node_cleanly(stack: Callable[..., Stack], signals: list[signal.Signals]) -> None:
    with stack() as nodes:
        nodes.wait_until_ready()
        for number in signals:
            for node in nodes.nodes.values():
                node.process.send_signal(number)
            time.sleep(0.05)
        assert [node.wait(WAIT_S) for node in nodes.nodes.values()] == [0, 0, 0]
        assert all('Traceback' not in node.log.read_text() for node in nodes.nodes.values())


@pytest.mark.usefixtures('hang_up_ends')
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGHUP])
def test_an_interrupt_ends_the_session_and_keeps_it(
    stack: Callable[..., Stack], street_bag: Callable[..., Path], tmp_path: Path, number: signal.Signals
) -> None:
    """A terminal that is closed, or a connection that breaks, interrupts too."""
    with stack({'map.path': str(tmp_path / 'map.db'), 'map.start_session': True}) as nodes:
        nodes.wait_until_ready()
        replay(nodes, street_bag('drive', count=8), '--lockstep')
        server = nodes.nodes['map_server_node']
        server.process.send_signal(number)
        assert server.wait(WAIT_S) == 0
        assert 'session ended at exit' in server.log.read_text()
    stored = MapStore.open_read_only(tmp_path / 'map.db')
    assert [session.state for session in stored.sessions] == ['ended']
    assert len(stored.places) > 0


def test_an_ended_session_is_kept_after_a_kill_and_searched_then(
    stack: Callable[..., Stack], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    parameters = {'map.path': str(tmp_path / 'map.db'), 'query.delta': 100.0, 'query.min_probability': 0.0}
    first = street_bag('first', count=8)
    with stack(parameters) as nodes:
        nodes.wait_until_ready()
        replay(nodes, first, '--lockstep', '--session')
        nodes.nodes['map_server_node'].process.kill()
    with sqlite3.connect(tmp_path / 'map.db') as connection:
        assert connection.execute('PRAGMA integrity_check').fetchone() == ('ok',)
    with stack(parameters) as nodes:
        nodes.wait_until_ready()
        again = replay(nodes, street_bag('again', count=8, noise_seed=5), '--lockstep')
    assert '8 scans, 8 embeddings, 8 matches, 0 rejections' in again


def test_a_map_can_be_queried_without_a_map_server(
    stack: Callable[..., Stack], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    with stack({'map.path': str(tmp_path / 'map.db')}) as nodes:
        nodes.wait_until_ready()
        replay(nodes, street_bag('first', count=8), '--lockstep', '--session')
    parameters = {'query.map_path': str(tmp_path / 'map.db'), 'query.delta': 100.0, 'query.min_probability': 0.0}
    with stack(parameters, names=('encoder_node', 'query_node')) as nodes:
        nodes.wait_until_ready()
        printed = replay(nodes, street_bag('again', count=8, noise_seed=5), '--lockstep')
    assert '8 scans, 8 embeddings, 8 matches, 0 rejections, 0 unanswered' in printed


def test_a_map_file_that_comes_later_is_read_without_a_map_server(
    observer: Observer, start_node: StartNode, tmp_path: Path
) -> None:
    path = tmp_path / 'town.db'
    node = start_node(QueryNode, {'query.map_path': str(path)})
    assert node.stage.places == 0
    made = make_map(tmp_path / 'made.db', 0.5)
    # A copy that is on its way.
    path.write_bytes((tmp_path / 'made.db').read_bytes()[:5000])
    received = observer.collect(DiagnosticArray, '/diagnostics')
    wait_until(lambda: any(str(path) in s.message and 'yet' not in s.message for m in received for s in m.status))
    (tmp_path / 'made.db').replace(path)
    wait_until(lambda: node.stage.places == len(made))


def test_a_session_ends_while_the_vehicle_drives_and_positions_come_late(
    observer: Observer, start_node: StartNode
) -> None:
    node = start_node(MapServerNode, {'position.source': 'odometry'})
    model = ModelInfo('ring_key', 'ab' * 32, 8, {})
    observer.publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)(model_message(model))
    embed = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
    locate = observer.publisher(Odometry, 'ground_truth/odometry', qos.POSITIONS)
    sent = itertools.count(100)

    def drive() -> None:
        """Positions are three scans late, so that some scan always waits for one."""
        number = next(sent)
        embedding = Embedding(number * 10**8, np.ones(8, np.float32), np.ones(8, np.float32), model.fingerprint)
        embed(embedding_message(embedding, 'radar'))
        position = Odometry(header=header((number - 3) * 10**8, 'map'))
        position.pose.pose.position.x = float(number)
        position.pose.pose.orientation.w = 1.0
        locate(position)

    drives = observer.node.create_timer(0.05, drive)
    wait_until(lambda: len(node.stage.map) > 3)
    ended = trigger(observer, 'end_session')
    observer.node.destroy_timer(drives)
    assert ended.success, ended.message


def trigger(observer: Observer, service: str) -> Any:
    return observer.call(Trigger, f'map_server/{service}', Trigger.Request())


def test_sessions_are_services(
    observer: Observer, stack: Callable[..., Stack], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    path = tmp_path / 'map.db'
    descriptors = observer.collect(PointCloud2, 'map/descriptors', qos.LATCHED)
    with stack({'map.path': str(path), 'map.allow_destructive': True}) as nodes:
        nodes.wait_until_ready()
        assert not trigger(observer, 'end_session').success
        assert trigger(observer, 'start_session').success
        assert 'it continues' in trigger(observer, 'start_session').message
        replay(nodes, street_bag('drive', count=8), '--lockstep')
        assert not trigger(observer, 'start_session').success
        assert trigger(observer, 'save').success
        ended = trigger(observer, 'end_session')
        assert ended.success
        assert 'inserted' in ended.message
        mapped = len(MapStore.open_read_only(path).places)
        wait_until(lambda: descriptors and descriptors[-1].width == mapped)
        undone = trigger(observer, 'undo_session')
        assert undone.success, undone.message
        assert len(MapStore.open_read_only(path).places) == 0
        wait_until(lambda: descriptors[-1].width == 0)
        assert not trigger(observer, 'undo_session').success
        cleared = trigger(observer, 'clear')
        assert cleared.success
        assert Path(cleared.message.rpartition(' ')[2]).exists()


def test_many_calls_at_once_are_all_answered(observer: Observer, start_node: StartNode, tmp_path: Path) -> None:
    start_node(MapServerNode, {'map.path': str(tmp_path / 'town.db')})
    depth = QoSProfile(depth=1000)
    names = ('save', 'end_session', 'start_session', 'subscribers')
    clients = [observer.node.create_client(Trigger, f'map_server/{name}', qos_profile=depth) for name in names]
    for client in clients:
        assert client.wait_for_service(WAIT_S)
    answers = [client.call_async(Trigger.Request()) for _ in range(50) for client in clients]
    wait_until(lambda: all(answer.done() for answer in answers))


@pytest.mark.parametrize('service', ['undo_session', 'clear'])
def test_no_caller_takes_a_drive_away_unless_a_parameter_allows_it(
    observer: Observer, start_node: StartNode, tmp_path: Path, service: str
) -> None:
    server = start_node(MapServerNode, {'map.path': str(tmp_path / 'map.db')})
    refused = trigger(observer, service)
    assert not refused.success
    assert f'{service} takes mapped drives away' in refused.message
    assert 'map.allow_destructive:=true' in refused.message
    # Whoever may call the service may set parameters too: this one only changes at start.
    (result,) = server.set_parameters([RclpyParameter('map.allow_destructive', value=True)])
    assert not result.successful
    assert not trigger(observer, service).success
    assert trigger(observer, 'end_session').success, 'the running session is still there'
    assert not list(tmp_path.glob('*.bak'))


def test_no_node_loads_torch(domain_id: int) -> None:
    program = (
        'import sys; import offradar_ros.nodes.encoder_node, offradar_ros.nodes.map_server_node, '
        'offradar_ros.nodes.query_node, offradar_ros.nodes.replay_node; sys.exit("torch" in sys.modules)'
    )
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain_id)}
    assert subprocess.run([sys.executable, '-c', program], env=environment, check=False).returncode == 0


def test_the_encoder_encodes_without_torch(observer: Observer, stack: Callable[..., Stack], street: Any) -> None:
    """Libraries that the process has mapped, once it has answered a scan with the trained encoder in ONNX."""
    embeddings = observer.collect(PointCloud2, 'embedding')
    scan = street(count=1).scan(0)
    image = Image(header=header(scan.stamp_ns, 'radar'), height=400, width=576, step=576, encoding='8UC1')
    image.data = array.array('B', scan.power.tobytes())
    parameters = {'encoder.name': 'variational', 'encoder.weights': 'compact', 'encoder.backend': 'onnx'}
    with stack(parameters, names=('encoder_node',)) as nodes:
        nodes.wait_until_ready()
        wait_until(lambda: observer.node.count_publishers('embedding') == 1)
        observer.publisher(Image, 'radar_data/b_scan_image', qos.SCANS)(image)
        assert wait_until(lambda: embeddings)[0].width > 0
        mapped = Path(f'/proc/{nodes.nodes["encoder_node"].process.pid}/maps').read_text()
    assert 'onnxruntime' in mapped
    assert 'torch' not in mapped


def wait_for_places(node: QueryNode, count: int) -> None:
    """Wait until the node searches a map of `count` places."""
    wait_until(lambda: node.stage.places == count)


def map_of(count: int, value: float = 1.0) -> PointCloud2:
    rows = [Place(i, 1, i, Pose(10.0 * i, 0.0), 0.9, np.full(8, value, np.float32)) for i in range(count)]
    return descriptors_message(PlaceRows(PlaceTable.from_places(rows, 8), 'ab' * 32, committed=True), 0)


@pytest.mark.parametrize('bad', [PointCloud2(), map_of(4, math.nan)], ids=['no map', 'places that cannot be'])
def test_the_last_sound_map_counts_of_those_that_come_while_a_node_is_inactive(
    observer: Observer, start_node: StartNode, bad: PointCloud2
) -> None:
    node = start_node(QueryNode, {'autostart': False, 'qos_overrides./map/descriptors.subscription.depth': 10})
    deep = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    send = observer.publisher(PointCloud2, 'map/descriptors', deep)

    def change_to(*transitions: int) -> None:
        for transition in transitions:
            assert change(observer, 'query', transition)

    def come(*messages: PointCloud2) -> None:
        drops = node.status.drops.total()
        for message in (*messages, bad):
            send(message)
        wait_until(lambda: node.status.drops.total() > drops)

    come(map_of(1), map_of(2))
    change_to(Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)
    wait_for_places(node, 2)
    # Refused while active, it replaces neither that one nor one that comes later.
    come()
    change_to(Transition.TRANSITION_DEACTIVATE)
    come(map_of(5), map_of(3))
    change_to(Transition.TRANSITION_CLEANUP, Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)
    wait_for_places(node, 3)
    assert node.status.drops.total() == 3


def test_a_node_that_is_activated_again_searches_the_same_map(observer: Observer, start_node: StartNode) -> None:
    node = start_node(QueryNode, {'autostart': False})
    observer.publisher(PointCloud2, 'map/descriptors', qos.LATCHED)(map_of(3))
    time.sleep(0.5)
    for _ in range(2):
        assert change(observer, 'query', Transition.TRANSITION_CONFIGURE)
        assert change(observer, 'query', Transition.TRANSITION_ACTIVATE)
        wait_for_places(node, 3)
        assert change(observer, 'query', Transition.TRANSITION_DEACTIVATE)
        assert change(observer, 'query', Transition.TRANSITION_CLEANUP)


def test_neither_node_nor_session_end_if_the_map_cannot_be_written(
    observer: Observer, stack: Callable[..., Stack], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    path = tmp_path / 'map.db'
    parameters = {'map.path': str(path), 'map.start_session': True, 'map.autosave_s': 1.0}
    with stack(parameters) as nodes:
        nodes.wait_until_ready()
        replay(nodes, street_bag('drive', count=8), '--lockstep')
        server = nodes.nodes['map_server_node']
        wait_until(lambda: MapStore.open_read_only(path).sessions)
        with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as other:
            other.execute('BEGIN IMMEDIATE')
            replay(nodes, street_bag('more', count=8, lane_m=40.0, start_ns=1_700_000_000 * 10**9), '--lockstep')
            refused = trigger(observer, 'end_session')
            assert not refused.success
            assert 'locked' in refused.message
            assert server.process.poll() is None
            other.execute('ROLLBACK')
        assert trigger(observer, 'end_session').success
    (session,) = MapStore.open_read_only(path).sessions
    assert (session.state, session.report['inserted']) == ('ended', len(MapStore.open_read_only(path).places))


def test_a_map_too_large_for_a_message_is_read_from_its_file(
    observer: Observer, start_node: StartNode, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(map_stage, 'MAX_MESSAGE_PLACES', 2)
    path = str(tmp_path / 'map.db')
    parameters = {'map.path': path, 'map.start_session': False, 'map.match_distance_m': 1.0}
    start_node(MapServerNode, parameters | {'map.allow_destructive': True})
    query = start_node(QueryNode, {'query.map_path': path})
    info = ModelInfo('ring_key', 'ab' * 32, 8, {})
    observer.publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)(model_message(info))
    embed = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
    fix = observer.publisher(NavSatFix, 'gps/fix', qos.POSITIONS)
    updates = observer.collect(PointCloud2, 'map/updates', qos.UPDATES)
    second = 10**9

    def wait_for_updates(count: int) -> None:
        wait_until(lambda: sum(m.width > 0 for m in updates if m.width < 2) >= count)

    for session in range(3):
        assert trigger(observer, 'start_session').success
        start = 100 + 5 * session
        for i in range(2):
            lon = -1.25 + 0.001 * (2 * session + i)
            fix(NavSatFix(header=header((start + i) * second, 'gps'), latitude=51.75, longitude=lon))
            mean = np.full(8, 2.0 * session + i, np.float32)
            embedding = Embedding((start + i) * second, mean, np.ones(8, np.float32), info.fingerprint)
            embed(embedding_message(embedding, 'radar'))
            wait_for_updates(2 * session + i + 1)
        assert trigger(observer, 'end_session').success
        wait_for_places(query, 2 * (session + 1))
    assert trigger(observer, 'undo_session').success
    wait_for_places(query, 4)
    wait_for_places(start_node(QueryNode, {'query.map_path': path}), 4)


def test_misspelt_parameters_and_stray_arguments_are_refused(stack: Callable[..., Stack]) -> None:
    environment = stack().environment
    misspelt = run_node('encoder_node', environment, '-p', 'radar.rnge:=1.0')
    assert misspelt.returncode == 1
    assert 'radar.rnge' in misspelt.stderr
    missing = run_node('encoder_node', environment, '--params-file', '/no/such/file.yaml')
    assert missing.returncode == 1
    assert missing.stderr.count('error: ') == 1
    assert 'Traceback' not in missing.stderr
    command = [sys.executable, '-m', 'offradar_ros.nodes.query_node', 'stray']
    stray = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert stray.returncode == 2
    assert "argument 'stray' is unknown" in stray.stderr


def test_integers_are_accepted_for_decimals(stack: Callable[..., Stack]) -> None:
    with stack({'query.delta': 1, 'map.match_distance_m': 7}) as nodes:
        nodes.wait_until_ready()
        assert 'rejects U above 2.0' in nodes.nodes['query_node'].log.read_text()
