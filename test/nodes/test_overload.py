"""More scans than can be encoded: the newest is answered, the others are counted, and nothing hangs."""

from __future__ import annotations

import array
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_nodes import WAIT_S, Observer, StartNode, wait_until
from sensor_msgs.msg import Image, PointCloud2
from std_srvs.srv import Trigger

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.encoders.ring_key import RingKeyEncoder
from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.nodes import encoder_node
from offradar_ros.nodes.encoder_node import EncoderNode
from offradar_ros.ros import qos
from offradar_ros.ros.stamps import header
from offradar_ros.types import Embedding, PolarScan

# With this depth scans are lost only where losses are counted.
DEEP = {'qos_overrides./radar_data/b_scan_image.subscription.depth': 100}


def image(second: int) -> Image:
    power = np.random.default_rng(second).integers(1, 200, (400, 576), np.uint8)
    data = array.array('B', power.tobytes())
    return Image(header=header(second * 10**9, 'radar'), height=400, width=576, step=576, encoding='8UC1', data=data)


class BlockedEncoder:
    """A ring key that encodes a scan only when the test allows it."""

    runs_on = 'cpu'

    def __init__(self, config: EncoderConfig) -> None:
        self._encoder = RingKeyEncoder(config.ring_key)
        self.begun, self.allowed = threading.Semaphore(0), threading.Semaphore(0)

    @property
    def info(self) -> ModelInfo:
        return self._encoder.info

    def encode(self, scan: PolarScan) -> Embedding:
        self.begun.release()
        assert self.allowed.acquire(timeout=WAIT_S)
        return self._encoder.encode(scan)

    def wait_until_busy(self) -> None:
        assert self.begun.acquire(timeout=WAIT_S)

    def allow(self, scans: int = 1000) -> None:
        self.allowed.release(scans)


@pytest.fixture
def blocked(monkeypatch: pytest.MonkeyPatch, observer: Observer) -> Iterator[BlockedEncoder]:
    encoder = BlockedEncoder(EncoderConfig())
    monkeypatch.setattr(encoder_node, 'make_encoder', lambda config: encoder)
    yield encoder
    # A test that failed must not wait for it.
    encoder.allow()


class Driven:
    """An encoder node that receives scans at whole seconds."""

    def __init__(self, observer: Observer, start_node: StartNode, **parameters: Any) -> None:
        self.node = start_node(EncoderNode, DEEP | parameters)
        self._embeddings = observer.collect(PointCloud2, 'embedding', qos.UPDATES)
        self._send = observer.publisher(Image, 'radar_data/b_scan_image', qos.UPDATES)
        wait_until(lambda: observer.node.count_publishers('embedding') == 1)

    def send(self, *seconds: int) -> None:
        for second in seconds:
            self._send(image(second))

    @property
    def answered(self) -> list[int]:
        return [message.header.stamp.sec for message in self._embeddings]


@pytest.mark.parametrize(('backlog', 'answered'), [(1, [1, 20]), (3, [1, 18, 19, 20])])
def test_the_newest_scan_is_answered_and_the_overtaken_are_counted(
    observer: Observer,
    start_node: StartNode,
    blocked: BlockedEncoder,
    backlog: int,
    answered: list[int],
) -> None:
    driven = Driven(observer, start_node, **{'encoder.backlog': backlog})
    reports = observer.collect(DiagnosticArray, '/diagnostics')
    driven.send(1)
    blocked.wait_until_busy()
    driven.send(*range(2, 21))
    overtaken = 20 - len(answered)
    wait_until(lambda: driven.node.status.drops['overtaken'] == overtaken)
    time.sleep(0.3)
    blocked.allow()
    wait_until(lambda: len(driven.answered) == len(answered))
    assert driven.answered == answered

    def reported() -> dict[str, str]:
        values = {item.key: item.value for item in reports[-1].status[0].values} if reports else {}
        return values if values.get('handled') == str(len(answered)) else {}

    values = wait_until(reported)
    assert values['dropped.overtaken'] == values['dropped'] == str(overtaken)
    # What a scan waits for is part of its latency.
    assert float(values['latency_p50_ms']) >= 300.0


def test_an_inactive_node_forgets_waiting_scans_and_answers_the_one_in_progress(
    observer: Observer, start_node: StartNode, blocked: BlockedEncoder
) -> None:
    driven = Driven(observer, start_node)
    driven.send(1)
    blocked.wait_until_busy()
    driven.send(2, 3)
    wait_until(lambda: driven.node.status.drops['overtaken'] == 1)
    deactivated = threading.Thread(target=driven.node.trigger_deactivate)
    deactivated.start()
    wait_until(lambda: not driven.node.active)
    blocked.allow()
    deactivated.join(WAIT_S)
    assert not deactivated.is_alive()
    wait_until(lambda: driven.answered == [1])
    for transition in ('cleanup', 'configure', 'activate'):
        getattr(driven.node, f'trigger_{transition}')()
    driven.send(4)
    wait_until(lambda: driven.answered == [1, 4])


def test_a_recording_starts_after_the_waiting_scans(
    observer: Observer, start_node: StartNode, blocked: BlockedEncoder
) -> None:
    driven = Driven(observer, start_node, **{'encoder.backlog': 10})
    driven.send(7)
    blocked.wait_until_busy()
    driven.send(8, 8)
    assert observer.call(Trigger, 'encoder/start_recording', Trigger.Request()).success
    driven.send(8)
    blocked.allow()
    wait_until(lambda: driven.answered == [7, 8, 8])
    assert driven.node.status.drops == {'repeated_stamp': 1}


@pytest.mark.parametrize('signals', [[signal.SIGINT], [signal.SIGINT, signal.SIGINT], [signal.SIGTERM]])
def test_a_signal_in_a_flood_of_scans_ends_the_node_cleanly(
    observer: Observer, stack: Callable[..., Stack], signals: list[signal.Signals]
) -> None:
    embeddings = observer.collect(PointCloud2, 'embedding', qos.UPDATES)
    with stack(names=('encoder_node',)) as nodes:
        nodes.wait_until_ready()
        send = observer.publisher(Image, 'radar_data/b_scan_image', qos.SCANS)
        flooding = threading.Event()

        def flood() -> None:
            scan = image(1)
            while not flooding.is_set():
                scan.header.stamp.sec += 1
                send(scan)
                time.sleep(0.001)

        thread = threading.Thread(target=flood)
        thread.start()
        try:
            wait_until(lambda: len(embeddings) > 3)
            (node,) = nodes.nodes.values()
            for number in signals:
                node.process.send_signal(number)
                time.sleep(0.01)
            assert node.wait(WAIT_S) == 0
        finally:
            flooding.set()
            thread.join()
    printed = node.log.read_text()
    assert 'Traceback' not in printed
    assert 'publisher' not in printed
