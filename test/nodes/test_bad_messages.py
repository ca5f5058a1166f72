"""A node counts each bad message by cause, and answers the next good one."""

from __future__ import annotations

import array
import math
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from live_nodes import Observer, StartNode, wait_until
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Log
from sample_signatures import packed_signature
from sensor_msgs.msg import Image, NavSatFix, NavSatStatus, PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from offradar_ros.alignment.signature import SignatureMaker
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import MapError
from offradar_ros.mapping.store import MapStore
from offradar_ros.nodes.encoder_node import EncoderNode
from offradar_ros.nodes.map_server_node import MapServerNode
from offradar_ros.nodes.query_node import QueryNode
from offradar_ros.ros import qos
from offradar_ros.ros.connections import Connections
from offradar_ros.ros.embedding_message import embedding_message, embedding_record, model_message
from offradar_ros.ros.place_message import PlaceRows, descriptors_message
from offradar_ros.ros.stage_node import StageNode
from offradar_ros.ros.stamps import header
from offradar_ros.types import Embedding, Place, PlaceTable, Pose, Rejection

SECOND = 10**9
MODEL = ModelInfo('ring_key', 'ab' * 32, 8, {})


def image(stamp_ns: int = SECOND, **changes: Any) -> Image:
    power = np.random.default_rng(stamp_ns).integers(1, 200, (400, 576), np.uint8)
    fields: dict[str, Any] = {
        'header': Header(stamp=Time(sec=stamp_ns // SECOND, nanosec=stamp_ns % SECOND), frame_id='radar'),
        'height': 400,
        'width': 576,
        'step': 576,
        'encoding': '8UC1',
        'data': array.array('B', power.tobytes()),
    }
    return Image(**(fields | changes))


BAD_IMAGES: dict[str, dict[str, Any]] = {
    'wrong_encoding': {'encoding': 'bgr8'},
    'short_step': {'step': 500},
    'short_data': {'data': array.array('B', bytes(576 * 399))},
    'empty_image': {'height': 0, 'width': 0, 'step': 0, 'data': array.array('B')},
    'image_too_large': {
        'height': 20_000,
        'width': 15_000,
        'step': 15_000,
        'data': array.array('B', bytes(300_000_000)),
    },
    'no_signal': {'data': array.array('B', bytes(400 * 576))},
    'unknown_range_resolution': {'width': 300, 'step': 576},
}


@pytest.mark.parametrize('cause', BAD_IMAGES)
def test_a_bad_image_is_counted_and_answered_as_invalid(observer: Observer, start_node: StartNode, cause: str) -> None:
    node = start_node(EncoderNode)
    embeddings = observer.collect(PointCloud2, 'embedding')
    send = observer.publisher(Image, 'radar_data/b_scan_image', qos.SCANS)
    send(image(SECOND, **BAD_IMAGES[cause]))
    send(image(2 * SECOND))
    wait_until(lambda: len(embeddings) == 2)
    assert node.status.drops == {cause: 1}
    assert [message.width for message in embeddings] == [0, 128]
    assert embeddings[0].header.stamp.sec == 1


def test_an_image_without_the_configured_metadata_columns_is_refused(observer: Observer, start_node: StartNode) -> None:
    node = start_node(EncoderNode, {'radar.metadata_columns': '11'})
    send = observer.publisher(Image, 'radar_data/b_scan_image', qos.SCANS)
    send(image(width=8))
    wait_until(lambda: node.status.drops['no_metadata'] == 1)


def test_repeated_and_backward_stamps_are_dropped_and_a_restart_is_not(
    observer: Observer, start_node: StartNode
) -> None:
    node = start_node(EncoderNode, {'encoder.backlog': 10})
    embeddings = observer.collect(PointCloud2, 'embedding')
    send = observer.publisher(Image, 'radar_data/b_scan_image', qos.SCANS)
    for stamp_s in (100.0, 100.25, 100.25, 100.0, 100.125, 100.125, 100.5, 50.0, 50.25):
        send(image(round(stamp_s * SECOND)))
    wait_until(lambda: len(embeddings) == 6)
    assert node.status.drops == {'repeated_stamp': 3, 'stamp_backwards': 1}
    answers = [(m.header.stamp.sec + m.header.stamp.nanosec / SECOND, m.width) for m in embeddings]
    assert answers == [(100.0, 128), (100.25, 128), (100.125, 0), (100.5, 128), (50.0, 128), (50.25, 128)]


def test_a_repeated_scan_is_answered_at_the_start_of_a_recording(observer: Observer, start_node: StartNode) -> None:
    node = start_node(EncoderNode, {'encoder.backlog': 10})
    embeddings = observer.collect(PointCloud2, 'embedding')
    send = observer.publisher(Image, 'radar_data/b_scan_image', qos.SCANS)
    for stamp_s in (100.0, 100.25):
        send(image(round(stamp_s * SECOND)))
    wait_until(lambda: len(embeddings) == 2)
    for _ in range(2):
        assert observer.call(Trigger, 'encoder/start_recording', Trigger.Request()).success
        send(image(round(100.25 * SECOND)))
        send(image(round(100.25 * SECOND)))
        wait_until(lambda: node.status.drops['repeated_stamp'])
        node.status.drops.clear()
    wait_until(lambda: len(embeddings) >= 4)
    assert [message.width for message in embeddings] == [128] * 4
    node.trigger_deactivate()
    refused = observer.call(Trigger, 'encoder/start_recording', Trigger.Request())
    assert (refused.success, refused.message) == (False, 'the encoder is not active')


def test_a_scan_of_which_no_signature_can_be_made_is_encoded_and_said_to_have_none(
    observer: Observer, start_node: StartNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = start_node(EncoderNode)
    embeddings = observer.collect(PointCloud2, 'embedding')
    send = observer.publisher(Image, 'radar_data/b_scan_image', qos.SCANS)

    def fail(*_: object) -> NoReturn:
        raise ValueError('too strange')

    with monkeypatch.context() as patch:
        patch.setattr(SignatureMaker, '__call__', fail)
        send(image(SECOND))
        wait_until(lambda: len(embeddings) == 1)
    assert [trouble.cause for trouble in node.troubles()] == ['no_signature']
    assert 'ValueError: too strange' in next(iter(node.troubles())).text
    send(image(2 * SECOND))
    wait_until(lambda: len(embeddings) == 2)
    found = [embedding_record(message, 'embedding') for message in embeddings]
    assert [(len(one.mean), bool(one.signature)) for one in found] == [(128, False), (128, True)]
    assert node.status.counts['signatures.failed'] == 1
    assert node.status.drops == {}


def test_without_signatures_the_encoder_makes_none(observer: Observer, start_node: StartNode) -> None:
    node = start_node(EncoderNode, {'encoder.signature': False})
    embeddings = observer.collect(PointCloud2, 'embedding')
    observer.publisher(Image, 'radar_data/b_scan_image', qos.SCANS)(image(SECOND))
    wait_until(lambda: len(embeddings) == 1)
    assert embedding_record(embeddings[0], 'embedding').signature == b''
    assert not list(node.troubles())


def test_drops_are_on_the_diagnostics_topic(observer: Observer, start_node: StartNode) -> None:
    start_node(EncoderNode)
    received = observer.collect(DiagnosticArray, '/diagnostics')
    send = observer.publisher(Image, 'radar_data/b_scan_image', qos.SCANS)
    send(image(encoding='rgb8'))
    warning = wait_until(lambda: [s for m in received for s in m.status if s.level == DiagnosticStatus.WARN])[0]
    values = {item.key: item.value for item in warning.values}
    assert warning.name == 'encoder: offradar_ros'
    assert values['dropped.wrong_encoding'] == '1'


def embedding(stamp_ns: int = SECOND, model: str = MODEL.fingerprint, **changes: Any) -> Embedding:
    mean = np.random.default_rng(stamp_ns).normal(size=8).astype(np.float32)
    fields: dict[str, Any] = {'mean': mean, 'variance': np.ones(8, np.float32)}
    return Embedding(stamp_ns, model=model, **(fields | changes))


def places(count: int = 3) -> PlaceTable:
    rows = [Place(i, 1, i, Pose(10.0 * i, 0.0), 0.9, embedding(1000 + i).mean) for i in range(count)]
    return PlaceTable.from_places(rows, 8)


def damaged(name: str, value: float) -> dict[str, Any]:
    array_ = np.ones(8, np.float32)
    array_[3] = value
    return {name: array_}


BAD_EMBEDDINGS = {
    'nan mean': (damaged('mean', math.nan), 'invalid_embedding'),
    'infinite mean': (damaged('mean', math.inf), 'invalid_embedding'),
    'nan variance': (damaged('variance', math.nan), 'invalid_embedding'),
    'negative variance': (damaged('variance', -1.0), 'invalid_embedding'),
    'no numbers': ({'mean': np.empty(0, np.float32), 'variance': np.empty(0, np.float32)}, 'invalid_embedding'),
    'damaged signature': ({'signature': packed_signature(1)[:-1]}, 'invalid_embedding'),
    'another model': ({'model': 'cd' * 32}, 'wrong_model'),
    'another dimension': ({'mean': np.ones(5, np.float32), 'variance': np.ones(5, np.float32)}, 'wrong_model'),
}


@pytest.mark.parametrize('name', BAD_EMBEDDINGS)
def test_the_query_answers_a_bad_embedding_with_the_reason(
    observer: Observer, start_node: StartNode, name: str
) -> None:
    changes, reason = BAD_EMBEDDINGS[name]
    node = start_node(QueryNode)
    outcomes = observer.collect_outcomes()
    latched = observer.publisher(PointCloud2, 'map/descriptors', qos.LATCHED)
    latched(descriptors_message(PlaceRows(places(), MODEL.fingerprint, committed=True), 0))
    send = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
    wait_until(lambda: node.stage.places == 3)
    send(embedding_message(embedding(SECOND, **changes), 'radar'))
    send(embedding_message(embedding(2 * SECOND), 'radar'))
    wait_until(lambda: len(outcomes) == 2)
    assert isinstance(outcomes[0], Rejection)
    assert (outcomes[0].stamp_ns, outcomes[0].reason) == (SECOND, reason)
    assert not isinstance(outcomes[1], Rejection)


def test_the_query_rejects_a_model_that_its_thresholds_are_not_for(observer: Observer, start_node: StartNode) -> None:
    start_node(QueryNode, {'query.model': 'cd' * 32})
    outcomes = observer.collect_outcomes()
    send = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
    send(embedding_message(embedding(SECOND), 'radar'))
    send(embedding_message(embedding(2 * SECOND, model='cd' * 32), 'radar'))
    wait_until(lambda: len(outcomes) == 2)
    other, ours = outcomes
    assert isinstance(other, Rejection) and isinstance(ours, Rejection)
    assert (other.reason, ours.reason) == ('wrong_model', 'map_empty')
    assert 'abababababab' in other.detail and 'cdcdcdcdcdcd (query.model)' in other.detail


@pytest.mark.parametrize('node_type', [QueryNode, MapServerNode])
def test_a_cloud_that_is_no_embedding_is_counted_and_answered(
    observer: Observer, start_node: StartNode, node_type: type[StageNode]
) -> None:
    node = start_node(node_type)
    outcomes = observer.collect_outcomes()
    send = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
    send(PointCloud2(height=1, width=5))
    wait_until(lambda: node.status.drops['wrong_fields'] == 1)
    if node_type is QueryNode:
        (outcome,) = wait_until(lambda: outcomes)
        assert isinstance(outcome, Rejection)
        assert outcome.reason == 'invalid_embedding'


def fix(stamp_ns: int, status: int = NavSatStatus.STATUS_FIX, **changes: float) -> NavSatFix:
    fields: dict[str, Any] = {'latitude': 51.75, 'longitude': -1.25, 'altitude': 70.0}
    return NavSatFix(header=header(stamp_ns, 'gps'), status=NavSatStatus(status=status), **(fields | changes))


class Mapping:
    """A map server that receives embeddings and fixes."""

    def __init__(self, observer: Observer, start_node: StartNode, **parameters: Any) -> None:
        self.node = start_node(MapServerNode, {'map.autosave_s': 0.0} | parameters)
        self.model = observer.publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)
        self.embed = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
        self.fix = observer.publisher(NavSatFix, 'gps/fix', qos.POSITIONS)
        self.updates = observer.collect(PointCloud2, 'map/updates', qos.UPDATES)
        self.handled = observer.collect(Header, 'map_server/handled', qos.UPDATES)
        connections = Connections(observer.node)
        wait_until(lambda: all(connections.count(topic) for topic in ('map/updates', 'map_server/handled')))
        self.model(model_message(MODEL))
        wait_until(lambda: self.node.stage.map.model is not None)

    @property
    def places(self) -> int:
        return len(self.node.stage.map)


@pytest.fixture
def mapping(observer: Observer, start_node: StartNode) -> Mapping:
    return Mapping(observer, start_node)


def test_a_scan_between_two_fixes_is_mapped_and_one_without_is_dropped(mapping: Mapping) -> None:
    mapping.fix(fix(10 * SECOND))
    mapping.embed(embedding_message(embedding(9 * SECOND), 'radar'))
    mapping.embed(embedding_message(embedding(10 * SECOND + 500), 'radar'))
    wait_until(lambda: mapping.node.status.drops['no_position'] == 1)
    assert mapping.places == 0
    mapping.fix(fix(11 * SECOND))
    wait_until(lambda: mapping.places == 1)


@pytest.mark.parametrize(
    ('bad', 'cause'),
    [
        (fix(10 * SECOND + 1, NavSatStatus.STATUS_NO_FIX), 'no_fix'),
        (fix(10 * SECOND + 1, latitude=math.nan), 'no_fix'),
        (fix(10 * SECOND + 1, latitude=0.0, longitude=0.0), 'no_fix'),
        (fix(10 * SECOND + 1, latitude=91.0), 'invalid_position'),
        (fix(10 * SECOND), 'repeated_position_stamp'),
        (fix(10 * SECOND - 1), 'position_stamp_backwards'),
    ],
)
def test_a_bad_fix_is_counted_and_never_interpolated_with(mapping: Mapping, bad: NavSatFix, cause: str) -> None:
    mapping.fix(fix(10 * SECOND))
    mapping.fix(bad)
    wait_until(lambda: mapping.node.status.drops[cause] == 1)
    mapping.embed(embedding_message(embedding(10 * SECOND + 1000), 'radar'))
    mapping.fix(fix(11 * SECOND))
    wait_until(lambda: mapping.places == 1)
    assert mapping.node.stage.map.places().positions_m[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)


def test_clocks_that_disagree_are_in_the_diagnostics(mapping: Mapping) -> None:
    def handled(count: int) -> bool:
        return len(mapping.handled) >= count

    for k in range(12):
        mapping.fix(fix(100 * SECOND + k * SECOND // 10))
        mapping.embed(embedding_message(embedding(63 * SECOND + k * SECOND // 10), 'radar'))
        wait_until(partial(handled, k + 1))
    wait_until(lambda: any('TAI is 37 s ahead of UTC' in trouble.text for trouble in mapping.node.troubles()))


def test_embeddings_of_another_model_never_reach_the_map(mapping: Mapping) -> None:
    mapping.fix(fix(10 * SECOND))
    mapping.fix(fix(11 * SECOND))
    mapping.embed(embedding_message(embedding(10 * SECOND + 1, 'cd' * 32), 'radar'))
    mapping.embed(embedding_message(embedding(10 * SECOND + 2, **damaged('mean', math.nan)), 'radar'))
    mapping.embed(embedding_message(embedding(10 * SECOND + 3), 'radar'))
    wait_until(lambda: mapping.places == 1)
    assert mapping.node.status.drops == {'wrong_model': 1, 'invalid_embedding': 1}


def test_another_model_is_refused_once_the_map_has_places(mapping: Mapping) -> None:
    mapping.fix(fix(10 * SECOND))
    mapping.fix(fix(11 * SECOND))
    mapping.embed(embedding_message(embedding(10 * SECOND + 1), 'radar'))
    wait_until(lambda: mapping.places == 1)
    mapping.model(model_message(ModelInfo('ring_key', 'cd' * 32, 8, {})))
    wait_until(lambda: mapping.node.status.drops['wrong_model'] == 1)
    assert mapping.node.stage.map.model == MODEL


def test_every_embedding_is_reported_as_handled_and_only_changes_are_updates(mapping: Mapping) -> None:
    mapping.fix(fix(SECOND))
    mapping.fix(fix(2 * SECOND))
    for message in (
        embedding_message(embedding(SECOND), 'radar'),
        PointCloud2(header=header(2 * SECOND, 'radar'), height=1, width=5),
        embedding_message(embedding(3 * SECOND), 'radar'),
    ):
        mapping.embed(message)
    wait_until(lambda: len(mapping.handled) >= 3)
    assert [message.stamp.sec for message in mapping.handled] == [1, 2, 3]
    assert [(message.header.stamp.sec, message.width) for message in mapping.updates] == [(1, 1)]


def test_odometry_serves_as_position(observer: Observer, start_node: StartNode) -> None:
    node = start_node(MapServerNode, {'position.source': 'odometry'})
    observer.publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)(model_message(MODEL))
    pose = observer.publisher(Odometry, 'ground_truth/odometry', qos.POSITIONS)
    embed = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
    for second, x in ((10, 4.0), (11, 8.0)):
        odometry = Odometry(header=header(second * SECOND, 'map'))
        odometry.pose.pose.position.x = x
        pose(odometry)
    damaged_pose = Odometry(header=header(12 * SECOND, 'map'))
    damaged_pose.pose.pose.position.y = math.nan
    pose(damaged_pose)
    embed(embedding_message(embedding(10 * SECOND + SECOND // 4), 'radar'))
    wait_until(lambda: len(node.stage.map) == 1)
    assert node.stage.map.places().positions_m[0].tolist() == [5.0, 0.0, 0.0]
    wait_until(lambda: node.status.drops == {'invalid_position': 1})


def test_no_scan_is_lost_if_the_model_arrives_after_the_first_ones(observer: Observer, start_node: StartNode) -> None:
    node = start_node(MapServerNode)
    send_fix = observer.publisher(NavSatFix, 'gps/fix', qos.POSITIONS)
    embed = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
    handled = observer.collect(Header, 'map_server/handled', qos.UPDATES)
    connections = Connections(observer.node)
    wait_until(lambda: connections.count('map_server/handled'))
    send_fix(fix(10 * SECOND))
    send_fix(fix(11 * SECOND))
    for i in range(3):
        embed(embedding_message(embedding(10 * SECOND + i), 'radar'))
    wait_until(lambda: len(handled) == 3)
    observer.publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)(model_message(MODEL))
    wait_until(lambda: len(node.stage.map) == 1)
    assert node.status.drops == {}


def test_a_refused_model_does_not_replace_the_one_that_is_kept_for_the_next_activation(mapping: Mapping) -> None:
    hostile = model_message(MODEL)
    hostile.values[1].value = '1000000000000'
    mapping.model(hostile)
    wait_until(lambda: mapping.node.status.drops['wrong_fields'] == 1)
    for transition in ('deactivate', 'cleanup', 'configure', 'activate'):
        getattr(mapping.node, f'trigger_{transition}')()
    wait_until(lambda: mapping.node.stage.map.model == MODEL)
    # What can never be handled is not tried again, as what a full disk prevented is.
    assert mapping.node.status.drops['wrong_fields'] == 1


@pytest.mark.parametrize('dimension', ['9', '1000000000000'])
def test_a_forged_dimension_leaves_the_map_as_it_was(
    observer: Observer, start_node: StartNode, tmp_path: Path, dimension: str
) -> None:
    path = tmp_path / 'town.db'
    mapping = Mapping(observer, start_node, **{'map.path': str(path)})
    mapping.fix(fix(10 * SECOND))
    mapping.fix(fix(11 * SECOND))
    mapping.embed(embedding_message(embedding(10 * SECOND + 1), 'radar'))
    wait_until(lambda: mapping.places == 1)
    forged = model_message(MODEL)
    forged.values[1].value = dimension
    mapping.model(forged)
    wait_until(lambda: mapping.node.status.drops.total() == 1)
    assert observer.call(Trigger, 'map_server/end_session', Trigger.Request()).success
    mapping.node.close()
    stored = MapStore.open_read_only(path)
    assert (stored.model, len(stored.places)) == (MODEL, 1)


@pytest.mark.parametrize('topic', ['embedding', 'map/updates', 'map/descriptors'])
@pytest.mark.parametrize(('name', 'value'), [('offset', 2**31 - 4), ('offset', 2**32 - 4), ('count', 2**29)])
def test_a_cloud_with_an_overflowing_field_is_counted(
    observer: Observer, start_node: StartNode, topic: str, name: str, value: int
) -> None:
    node = start_node(QueryNode)
    profile = {'embedding': qos.RESULTS, 'map/updates': qos.UPDATES, 'map/descriptors': qos.LATCHED}[topic]
    cloud = descriptors_message(PlaceRows(places(), MODEL.fingerprint, committed=True), 0)
    if topic == 'embedding':
        cloud = embedding_message(embedding(), 'radar')
    setattr(cloud.fields[0], name, value)
    observer.publisher(PointCloud2, topic, profile)(cloud)
    wait_until(lambda: node.status.drops == {'wrong_fields': 1})


@pytest.mark.parametrize('node_type', [EncoderNode, QueryNode, MapServerNode])
def test_a_stamp_that_is_none_is_counted_once(
    observer: Observer, start_node: StartNode, node_type: type[StageNode]
) -> None:
    node = start_node(node_type)
    message: Any = image() if node_type is EncoderNode else embedding_message(embedding(), 'radar')
    message.header.stamp.nanosec = 2**32 - 1
    topic = 'radar_data/b_scan_image' if node_type is EncoderNode else 'embedding'
    observer.publisher(type(message), topic, qos.SCANS)(message)
    wait_until(lambda: node.status.drops == {'invalid_stamp': 1})


def is_longer(received: list[Any], count: int) -> bool:
    return len(received) > count


def test_stamps_that_jump_back_again_and_again_do_not_flood_the_log(observer: Observer, start_node: StartNode) -> None:
    """As those of two radars with two clocks on one topic."""
    node = start_node(EncoderNode, {'encoder.backlog': 50})
    embeddings = observer.collect(PointCloud2, 'embedding', qos.UPDATES)
    logged = observer.collect(Log, '/rosout', qos.UPDATES)
    send = observer.publisher(Image, 'radar_data/b_scan_image', qos.SCANS)
    for pair in range(20):
        for second in (100, 50):
            count = len(embeddings)
            send(image(second * SECOND + pair * SECOND // 4))
            wait_until(partial(is_longer, embeddings, count))
    assert node.status.counts['recordings.restarted'] == 20
    lines = [message.msg for message in list(logged) if 'jumped back' in message.msg]
    assert len(lines) < 10


def test_a_model_that_comes_while_the_disk_is_full_is_taken_when_there_is_space(
    observer: Observer, start_node: StartNode, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The encoder sends it once."""
    node = start_node(MapServerNode, {'map.path': str(tmp_path / 'town.db')})

    def fail(*_: object, **__: object) -> None:
        raise MapError('database or disk is full')

    with monkeypatch.context() as full:
        full.setattr(MapStore, 'write_model', fail)
        observer.publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)(model_message(MODEL))
        wait_until(lambda: node.status.drops['not_saved'])
        assert node.stage.map.model is None
    wait_until(lambda: node.stage.map.model == MODEL)
