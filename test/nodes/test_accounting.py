"""Every scan that was sent is answered or counted, whatever happens to it."""

from __future__ import annotations

import array
import threading
import time
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_nodes import WAIT_S, Observer, StartNode, wait_until
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Empty
from std_srvs.srv import Trigger

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.encoders.ring_key import RingKeyEncoder
from offradar_ros.messages import scan_from_image
from offradar_ros.nodes import encoder_node
from offradar_ros.nodes.encoder_node import B_SCANS, SCANS, EncoderNode
from offradar_ros.nodes.map_server_node import MapServerNode
from offradar_ros.nodes.query_node import QueryNode
from offradar_ros.ros import input_watch, navtech, qos
from offradar_ros.ros.embedding_message import embedding_message
from offradar_ros.ros.ledger import Ledger
from offradar_ros.ros.lost_messages import DOUBTED
from offradar_ros.ros.stage_node import StageNode
from offradar_ros.ros.stamps import header
from offradar_ros.types import Embedding, PolarScan

# The topics between these nodes and the test lose nothing: only what is tested does.
DEEP_PUBLISHER = {'qos_overrides./embedding.publisher.depth': 1000}
DEEP_SUBSCRIPTION = {'qos_overrides./embedding.subscription.depth': 100}


def image(second: int, **changes: Any) -> Image:
    power = np.random.default_rng(second).integers(1, 200, (400, 576), np.uint8)
    fields: dict[str, Any] = {'height': 400, 'width': 576, 'step': 576, 'encoding': '8UC1'}
    data = array.array('B', power.tobytes())
    return Image(header=header(second * 10**9, 'radar'), data=data, **(fields | changes))


def ledgers(node: StageNode) -> dict[str, Ledger]:
    return {ledger.name: ledger for ledger in node.ledgers}


def waiting(node: StageNode, name: str) -> int:
    """Messages that arrived, and have not ended."""
    return int(ledgers(node)[name].values()[f'{name}.waiting'])


class MoodyEncoder:
    """A ring key that is slow at some scans, fails at some, and returns nonsense for some, by their seconds."""

    runs_on = 'cpu'

    def __init__(self, config: EncoderConfig) -> None:
        self._encoder = RingKeyEncoder(config.ring_key)

    @property
    def info(self) -> ModelInfo:
        return self._encoder.info

    def encode(self, scan: PolarScan) -> Embedding:
        second = scan.stamp_ns // 10**9
        if second % 7 == 1:
            time.sleep(0.02)
        if second % 5 == 2:
            raise RuntimeError('no kernel image is available')
        found = self._encoder.encode(scan)
        if second % 5 == 3:
            return Embedding(found.stamp_ns, found.mean * np.float32(np.nan), found.variance, found.model)
        return found


@pytest.fixture
def moody(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(encoder_node, 'make_encoder', MoodyEncoder)
    yield


class Sender:
    """Sends scans of increasing seconds and counts them."""

    def __init__(self, observer: Observer) -> None:
        self.embeddings = observer.collect(PointCloud2, 'embedding', qos.UPDATES)
        self._publish = observer.publisher(Image, SCANS, qos.UPDATES)
        self.sent = 0

    def send(self, count: int, period_s: float = 0.0, **changes: Any) -> None:
        for _ in range(count):
            self.sent += 1
            self._publish(image(self.sent, **changes))
            time.sleep(period_s)

    def first(self, node: StageNode) -> None:
        """The first one shows that the node hears this publisher: from then on each one is counted."""
        wait_until(lambda: node.count_publishers(SCANS) == 1)
        self.send(1)
        wait_until(lambda: ledgers(node)['scans'].received == 1)


def settled(node: StageNode, sender: Sender) -> dict[str, int]:
    """Counts once every scan that was sent has arrived or is counted as lost, and none waits."""
    ledger = ledgers(node)['scans']
    wait_until(lambda: ledger.received + ledger.lost == sender.sent)
    wait_until(lambda: waiting(node, 'scans') == 0)
    return ledger.ends


def test_scans_at_many_times_real_time_are_answered_or_counted(
    observer: Observer, start_node: StartNode, moody: None
) -> None:
    """At several hundred a second, with refused ones between, through a deactivation and a configuration."""
    reports = observer.collect(DiagnosticArray, '/diagnostics')
    node = start_node(EncoderNode, {'encoder.backlog': 3} | DEEP_PUBLISHER)
    sender = Sender(observer)
    wait_until(lambda: observer.node.count_publishers('embedding') == 1)
    sender.first(node)
    for _ in range(4):
        sender.send(100, 0.002)
        sender.send(5, encoding='bgr8')
        sender.send(40)
    node.trigger_deactivate()
    sender.send(30, 0.001)
    wait_until(lambda: ledgers(node)['scans'].ends.get('inactive', 0) > 0)
    for transition in ('cleanup', 'configure', 'activate'):
        getattr(node, f'trigger_{transition}')()
    sender.send(100, 0.002)
    ends = settled(node, sender)
    answers = Counter(message.width > 0 for message in sender.embeddings)
    wait_until(lambda: len(sender.embeddings) == ends['encoded'] + ends['refused'])
    answers = Counter(message.width > 0 for message in sender.embeddings)
    assert answers == {True: ends['encoded'], False: ends['refused']}
    stamps = Counter(message.header.stamp.sec for message in sender.embeddings)
    assert set(stamps.values()) == {1}
    drops = node.status.drops
    assert ends['refused'] == sum(drops[cause] for cause in ('wrong_encoding', 'encoder_failed', 'invalid_output'))
    assert drops['encoder_failed'] > 0
    assert drops['invalid_output'] > 0
    assert ends.get('overtaken', 0) == drops['overtaken']
    assert ledgers(node)['scans'].lost == drops['lost_before_arrival']
    assert sender.sent == sum(ends.values()) + drops['lost_before_arrival']

    def reported() -> bool:
        values = {item.key: item.value for item in reports[-1].status[0].values}
        return values | ledgers(node)['scans'].values() == values

    wait_until(reported)


@pytest.mark.parametrize('idle', [None, qos.SCANS, qos_profile_sensor_data], ids=['alone', 'idle', 'best effort'])
def test_scans_that_are_lost_before_the_callback_are_counted(
    observer: Observer, start_node: StartNode, idle: QoSProfile | None
) -> None:
    """The executor is held up while more arrive than the subscription keeps; `idle` publishes nothing meanwhile."""
    node = start_node(EncoderNode)
    sender = Sender(observer)
    sender.first(node)
    if idle:
        observer.node.create_publisher(Image, SCANS, idle)
        wait_until(lambda: node.count_publishers(SCANS) == 2)
    held, go_on = threading.Event(), threading.Event()

    def hold(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        held.set()
        assert go_on.wait(WAIT_S)
        return response

    observer.node.create_service(Trigger, 'hold', hold)
    client = observer.node.create_client(Trigger, 'hold')
    assert client.wait_for_service(WAIT_S)
    client.call_async(Trigger.Request())
    assert held.wait(WAIT_S)
    sender.send(60)
    time.sleep(0.3)
    go_on.set()
    if idle is qos.SCANS:
        # The gap might be the start of the idle one's numbers, until enough others have followed.
        sender.send(DOUBTED, 0.05)
    settled(node, sender)
    ledger = ledgers(node)['scans']
    assert ledger.lost > 0
    assert ledger.received + ledger.lost == sender.sent
    assert node.status.drops['lost_before_arrival'] == ledger.lost


def test_scans_that_wait_when_the_node_is_closed_are_counted(
    observer: Observer, start_node: StartNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, allowed = threading.Event(), threading.Event()

    class Blocked(MoodyEncoder):
        def encode(self, scan: PolarScan) -> Embedding:
            begun.set()
            assert allowed.wait(WAIT_S)
            return super().encode(scan)

    monkeypatch.setattr(encoder_node, 'make_encoder', Blocked)
    node = start_node(EncoderNode, {'encoder.backlog': 10})
    sender = Sender(observer)
    sender.first(node)
    assert begun.wait(WAIT_S)
    sender.send(4)
    wait_until(lambda: ledgers(node)['scans'].received == 5)
    assert waiting(node, 'scans') == 5
    closing = threading.Thread(target=node.close)
    closing.start()
    allowed.set()
    closing.join(WAIT_S)
    assert ledgers(node)['scans'].ends == {'encoded': 1, 'inactive': 4}


@pytest.fixture
def navtech_msgs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stands in for `navtech_msgs`: an Image on `radar_data/b_scan_msg` is a RadarBScanMsg."""
    monkeypatch.setattr(Image, 'b_scan_img', property(lambda message: message), raising=False)
    monkeypatch.setattr(navtech, 'message_types', lambda: (Image, Empty))
    monkeypatch.setattr(navtech, 'scan_from_b_scan', scan_from_image)


def test_images_are_ignored_only_while_the_same_scans_come_with_their_angles(
    observer: Observer, start_node: StartNode, navtech_msgs: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = start_node(EncoderNode)
    embeddings = observer.collect(PointCloud2, 'embedding', qos.UPDATES)
    wait_until(lambda: node.count_subscribers('embedding') == 1)
    publish = {topic: observer.publisher(Image, topic, qos.UPDATES) for topic in (SCANS, B_SCANS)}

    def end_of(topic: str, second: int, **changes: Any) -> str:
        before = Counter(ledgers(node)['scans'].ends)
        publish[topic](image(second, **changes))
        wait_until(lambda: ledgers(node)['scans'].ends != before)
        return next(iter(Counter(ledgers(node)['scans'].ends) - before))

    assert end_of(SCANS, 10) == 'encoded'
    assert end_of(B_SCANS, 9, encoding='bgr8') == 'refused'
    assert end_of(SCANS, 11) == 'encoded'
    # The other topic is stamped by another clock, which may be behind.
    assert end_of(B_SCANS, 10) == 'encoded'
    assert end_of(SCANS, 12) == 'on_other_topic'
    assert end_of(B_SCANS, 11, encoding='bgr8') == 'refused'
    assert end_of(SCANS, 13) == 'encoded'
    assert end_of(B_SCANS, 12) == 'encoded'
    assert end_of(SCANS, 14) == 'on_other_topic'
    monkeypatch.setattr(input_watch, 'LEAST_S', 0.0)
    monkeypatch.setattr(input_watch, 'PERIODS', 0)
    assert end_of(SCANS, 15) == 'encoded'
    wait_until(lambda: sum(message.width > 0 for message in embeddings) == 6)


def test_a_scan_that_takes_long_is_reported(
    observer: Observer, start_node: StartNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    allowed = threading.Event()

    class Hanging(MoodyEncoder):
        def encode(self, scan: PolarScan) -> Embedding:
            assert allowed.wait(WAIT_S)
            return super().encode(scan)

    monkeypatch.setattr(encoder_node, 'make_encoder', Hanging)
    monkeypatch.setattr(encoder_node, 'SLOW_S', 0.1)
    reports = observer.collect(DiagnosticArray, '/diagnostics')
    start_node(EncoderNode)
    Sender(observer).send(1)
    wait_until(lambda: any('the encoder hangs' in status.message for m in reports for status in m.status))
    allowed.set()


def test_embeddings_are_answered_or_counted_also_where_the_search_fails(
    observer: Observer, start_node: StartNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = start_node(QueryNode, DEEP_SUBSCRIPTION)
    rejections = observer.collect(DiagnosticArray, 'rejections', qos.UPDATES)
    publish = observer.publisher(PointCloud2, 'embedding', qos.UPDATES)
    sound = node.stage.query

    def failing(embedding: Embedding) -> Any:
        if embedding.stamp_ns % 3 == 0:
            raise IndexError('out of bounds')
        return sound(embedding)

    monkeypatch.setattr(node.stage, 'query', failing)
    mean, variance = np.ones(8, np.float32), np.ones(8, np.float32)
    for stamp in range(1, 31):
        publish(embedding_message(Embedding(stamp, mean, variance, 'ab' * 32), 'radar'))
        time.sleep(0.005)
    wait_until(lambda: len(rejections) == 30)
    wait_until(lambda: waiting(node, 'embeddings') == 0)
    assert ledgers(node)['embeddings'].ends == {'rejected': 30}
    assert node.status.counts['rejected.invalid_embedding'] == node.status.drops['internal_error'] == 10


@pytest.mark.parametrize('kind', [QueryNode, MapServerNode])
def test_embeddings_that_are_refused_are_counted(
    observer: Observer, start_node: StartNode, kind: type[StageNode]
) -> None:
    node = start_node(kind, DEEP_SUBSCRIPTION)
    publish = observer.publisher(PointCloud2, 'embedding', qos.UPDATES)
    sound = embedding_message(Embedding(10**9, np.ones(8, np.float32), np.ones(8, np.float32), 'ab' * 32), 'radar')
    for second in range(2, 5):
        publish(PointCloud2(header=header(second * 10**9, 'radar'), width=3, height=1))
    publish(sound)
    wait_until(lambda: ledgers(node)['embeddings'].received == 4)
    wait_until(lambda: waiting(node, 'embeddings') == 0)
    ends = ledgers(node)['embeddings'].ends
    assert ends == ({'rejected': 4} if kind is QueryNode else {'refused': 3, 'taken_up': 1})
