"""Hostile messages on every input of the running nodes: they go on, and afterwards map and answer as before.

The overflowing clouds and the models that cannot be are among them. What is latched is received again by nodes that
start later, so they are started again too.
"""

from __future__ import annotations

import copy
import functools
import itertools
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from hostile_messages import Hostile, Input, hostile_messages, inputs
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from faults.content_digest import content_digest
from faults.free_domains import free_domains
from faults.result import Result, Settings
from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.lab.live.spin_thread import SpinThread
from offradar_ros.mapping.store import MapStore
from offradar_ros.messages import header_stamp_ns
from offradar_ros.ros import qos
from offradar_ros.ros.embedding_message import model_message

NAME = 'messages'
FULL = 2400
START_NS = 1_700_000_000 * 10**9
BARRIER = 40
"""After so many messages the nodes are asked for a sign of life: no queue overflows, and each message is handled."""
WAIT_S = 60.0
ATTEMPTS, ANSWER_S = 12, 5.0
WARM_UP = 1000
"""Number of the first scan that is sent until one is mapped, and then taken back."""
NODES = ('encoder', 'map_server', 'query')
SCANS = range(100, 180, 20)
"""Scans of a sound drive, by their numbers: 14 m and 5 s apart."""
DEPTH = 1000
PARAMETERS: dict[str, object] = {
    'encoder.name': 'ring_key',
    'encoder.backlog': DEPTH,
    'map.start_session': False,
    'map.allow_destructive': True,
    **{
        f'qos_overrides./{topic}.subscription.depth': DEPTH
        for topic in (
            'radar_data/b_scan_image',
            'embedding',
            'embedding/model',
            'map/descriptors',
            'map/updates',
            'map/signatures',
            'map/signatures_wanted',
        )
    },
}


class BrokenError(Exception):
    """A node that does not do what it did before; the text says which and how."""


def run(settings: Settings) -> list[Result]:
    """Attack the nodes, and see that they work as before."""
    started_s = time.monotonic()
    model = make_encoder(EncoderConfig(name='ring_key')).info
    parameters = {**PARAMETERS, 'map.path': settings.folder / 'attacked.db'}
    messages = itertools.chain(known_attacks(model), hostile_messages(settings.seed, model, START_NS))
    examples: list[str] = []
    sent, drops = 0, 0
    with free_domains(1) as (domain_id,), Vehicle(model, domain_id) as vehicle:
        try:
            with Stack(settings.folder / 'before', domain_id, parameters) as nodes:
                vehicle.connect(nodes)
                vehicle.drive(5_000)
                expected = places(settings)
                vehicle.call('start_session')
                for sent, one in enumerate(itertools.islice(messages, settings.tries(FULL)), 1):
                    vehicle.send(one)
                    if sent % BARRIER == 0:
                        vehicle.require_life(nodes)
                vehicle.require_life(nodes)
                # The sound ones among them were mapped: nothing else may have come of the attack.
                vehicle.call('undo_session')
                if places(settings) != expected:
                    raise BrokenError('the map is not as before')
                vehicle.drive(20_000)
                drops = vehicle.drops(nodes)
            expected = places(settings)
            with Stack(settings.folder / 'after', domain_id, parameters) as nodes:
                vehicle.connect(nodes)
                if places(settings) != expected:
                    raise BrokenError('the map is not as before, after a restart')
                vehicle.drive(40_000)
                vehicle.require_life(nodes)
        except BrokenError as broken:
            examples.append(f'after {sent} messages: {broken}')
    seconds = time.monotonic() - started_s
    return [
        Result(
            NAME,
            'hostile messages to running nodes',
            sent,
            same=sent if not examples else 0,
            crashes=len(examples),
            seconds=seconds,
            figures={'counted as dropped': drops},
            examples=tuple(examples),
        )
    ]


def places(settings: Settings) -> str:
    """A digest of the map; what the model is called is of no weight, and any sender may say it."""
    stored = MapStore.open_read_only(settings.folder / 'attacked.db')
    model = (stored.model.fingerprint, stored.model.dimension) if stored.model else None
    return content_digest(model, stored.places, stored.signatures)


def known_attacks(model: ModelInfo) -> Iterator[Hostile]:
    """Messages that have ended nodes of other versions: clouds whose sizes overflow, models that cannot be."""
    for one in inputs(model, START_NS):
        if one.kind is PointCloud2:
            yield from _overflowing(one)
    for fingerprint, dimension in (
        (model.fingerprint, model.dimension + 1),
        (model.fingerprint, 10**12),
        ('cd' * 32, 10**12),
        ('ef' * 32, 0),
        ('ef' * 32, -1),
        ('xyz', model.dimension),
        ('', 1),
    ):
        message = model_message(model)
        for item in message.values:
            item.value = {'fingerprint': fingerprint, 'dimension': str(dimension)}.get(item.key, item.value)
        yield Hostile('embedding/model', DiagnosticStatus, message, qos.LATCHED)


def _overflowing(one: Input) -> Iterator[Hostile]:
    sound = one.make(3)
    for field in range(len(sound.fields)):
        for offset in (2**31 - 4, 2**31 - 1, 2**31, 2**32 - 4, 2**32 - 1):
            message = copy.deepcopy(sound)
            message.fields[field].offset = offset
            yield Hostile(one.topic, one.kind, message, one.profile)
        for count in (0, 2**29 - 1, 2**29, 2**30, 2**32 - 1):
            message = copy.deepcopy(sound)
            message.fields[field].count = count
            yield Hostile(one.topic, one.kind, message, one.profile)


class Vehicle:
    """Publishes every input of the nodes and receives their answers."""

    def __init__(self, model: ModelInfo, domain_id: int) -> None:
        self._make = {one.topic: one for one in inputs(model, START_NS)}
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self._node = Node('vehicle', context=self._context)
        self._publishers: dict[str, Publisher] = {}
        self._clients: dict[str, Client] = {}
        self._answers: Counter[int] = Counter()
        self._drops: dict[str, dict[str, int]] = {}
        self._reports = self._warmed_up = 0
        for kind, topic in ((PointCloud2, 'matches'), (DiagnosticArray, 'rejections')):
            self._node.create_subscription(kind, topic, self._on_answer, qos.UPDATES, raw=True)
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.RESULTS)
        for one in self._make.values():
            profile = QoSProfile(depth=DEPTH, reliability=one.profile.reliability, durability=one.profile.durability)
            self._publishers[one.topic] = self._node.create_publisher(one.kind, one.topic, profile)
        executor = SingleThreadedExecutor(context=self._context)
        executor.add_node(self._node)
        self._spin = SpinThread(executor)

    def __enter__(self) -> Vehicle:
        return self

    def __exit__(self, *_: object) -> None:
        self._spin.stop()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def connect(self, nodes: Stack) -> None:
        """Wait until the nodes hear the scans and positions, and answer scans."""
        nodes.wait_until_ready(WAIT_S)
        heard = ('radar_data/b_scan_image', 'gps/fix', 'embedding', 'embedding/model', 'map/descriptors')
        self._await(
            lambda: all(self._publishers[topic].get_subscription_count() for topic in heard), 'the nodes are not found'
        )
        for name in NODES:
            self._await(functools.partial(self._answered, f'{name}/subscribers', 1.0), f'{name} does not answer')
        # Whether the nodes have discovered each of these publishers cannot be seen from here: it shows.
        for attempt in range(ATTEMPTS):
            report = self._session([WARM_UP + 40 * (self._warmed_up + attempt)])
            # A session without a change cannot be taken back: the one before it would be.
            if '1 inserted' in report:
                self.call('undo_session')
                self._warmed_up += attempt + 1
                return
            time.sleep(0.5)
        raise BrokenError(f'no sound scan is mapped: {report}')

    def send(self, one: Hostile) -> None:
        """Publish a message, sound or not."""
        self._publishers[one.topic].publish(one.message)

    def drive(self, first: int) -> None:
        """A session of four sound scans, which must all be mapped and answered."""
        report = self._session([first + number for number in SCANS])
        if f'{len(SCANS)} inserted' not in report:
            raise BrokenError(f'four sound scans were not mapped: {report}')

    def _session(self, numbers: list[int]) -> str:
        self.call('start_session')
        for number in numbers:
            for around in range(number - 4, number + 5):
                self._sound('gps/fix', around)
            stamp_ns = self._sound('radar_data/b_scan_image', number)
            self._await(functools.partial(self._answers.get, stamp_ns), f'scan {number} is not answered')
        time.sleep(0.5)
        return self.call('end_session')

    def _sound(self, topic: str, number: int) -> int:
        message = self._make[topic].make(number)
        self._publishers[topic].publish(message)
        return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)

    def call(self, name: str) -> str:
        """The answer of a service of the map server; BrokenError if it is none or a refusal."""
        answer = self._answered(f'map_server/{name}', WAIT_S)
        if answer is None or not answer.success:
            raise BrokenError(f'{name}: {answer.message if answer else "no answer"}')
        return str(answer.message)

    def require_life(self, nodes: Stack) -> None:
        """BrokenError for a node that has ended, does not answer, or has shown a traceback."""
        for name, node in zip(NODES, nodes.nodes.values(), strict=True):
            ended = node.process.poll
            for _ in range(ATTEMPTS):
                if ended() is not None or self._answered(f'{name}/subscribers', ANSWER_S):
                    break
            else:
                raise BrokenError(f'{name} does not answer')
            if node.process.poll() is not None:
                raise BrokenError(f'{name} ended with status {node.process.returncode}')
            if 'Traceback' in node.log.read_text(errors='replace'):
                raise BrokenError(f'{name}: a traceback in its log')

    def drops(self, nodes: Stack) -> int:
        """What the nodes have counted as dropped; BrokenError if one of the causes is a defect."""
        self._reports = 0
        self._await(lambda: self._reports > 2 * len(NODES), 'no diagnostics')
        if any('dropped.internal_error' in causes for causes in self._drops.values()):
            raise BrokenError(f'internal errors: {self._drops}')
        self.require_life(nodes)
        return sum(sum(causes.values()) for causes in self._drops.values())

    def _answered(self, name: str, timeout_s: float) -> Trigger.Response | None:
        client = self._clients.setdefault(name, self._node.create_client(Trigger, name))
        if not client.wait_for_service(timeout_s):
            return None
        future = client.call_async(Trigger.Request())
        deadline_s = time.monotonic() + timeout_s
        while not future.done() and time.monotonic() < deadline_s:
            time.sleep(0.002)
        return future.result() if future.done() else None

    def _await(self, done: Callable[[], Any], otherwise: str) -> None:
        deadline_s = time.monotonic() + WAIT_S
        while not done():
            if time.monotonic() > deadline_s:
                raise BrokenError(otherwise)
            time.sleep(0.002)

    def _on_answer(self, cdr: bytes) -> None:
        self._answers[header_stamp_ns(cdr)] += 1

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self._reports += 1
        for status in message.status:
            counts = {item.key: int(item.value) for item in status.values if item.key.startswith('dropped.')}
            self._drops[status.name] = counts
