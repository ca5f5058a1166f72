"""A bag's raw messages into running nodes, and the count of what they answered."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2

from offradar_ros.bags.reader import STAMP, STAMP_OFFSET, Bag, RawMessage, header_stamp_ns, scan_topic
from offradar_ros.config import PositionConfig, RadarConfig
from offradar_ros.errors import OffradarError, RefusedInput
from offradar_ros.pipeline import in_lockstep_order
from offradar_ros.radar.stamps import StampGate
from offradar_ros.ros import qos
from offradar_ros.ros.stamps import time_message

SUBSCRIBERS = 'subscribers.'
ANSWERS = ('matches', 'rejections')
"""One of the two answers each embedding."""
CLOCK_PERIOD_S = 0.025
DISCOVERY_S = 4.0
SETTLE_S = 1.0
SILENT_SCANS = 3


@dataclasses.dataclass(frozen=True)
class PlayOptions:
    """How a bag is played; see `replay_node --help`."""

    rate: float = 1.0
    lockstep: bool = False
    restamp: bool = False
    timeout_s: float = 10.0


@dataclasses.dataclass(frozen=True)
class Answers:
    """What came back for the scans of a replay."""

    scans: int = 0
    embeddings: int = 0
    matches: int = 0
    rejections: int = 0
    unanswered: int = 0
    answered_twice: int = 0
    latencies_s: tuple[float, ...] = ()

    def __add__(self, other: Answers) -> Answers:
        mine, theirs = _fields(self), _fields(other)
        return Answers(**{name: mine[name] + theirs[name] for name in mine})

    def summary(self, seconds: float) -> str:
        """One line; latency is from sending the scan to its answer, transport included."""
        counts = ', '.join(f'{v} {k.replace("_", " ")}' for k, v in _fields(self).items() if k != 'latencies_s')
        text = f'replayed {counts} in {seconds:.1f} s ({self.scans / max(seconds, 1e-9):.1f} scans/s)'
        if self.latencies_s:
            p50, p99 = np.percentile(self.latencies_s, [50, 99]) * 1e3
            text += f'; latency median {p50:.1f} ms, p99 {p99:.1f} ms'
        return text


def _fields(answers: Answers) -> dict[str, Any]:
    return {field.name: getattr(answers, field.name) for field in dataclasses.fields(answers)}


def with_stamp(cdr: bytes, stamp_ns: int) -> bytes:
    """The same message with another header stamp."""
    changed = bytearray(cdr)
    STAMP.pack_into(changed, STAMP_OFFSET, stamp_ns // 10**9, stamp_ns % 10**9)
    return bytes(changed)


def message_class(msgtype: str) -> type | None:
    """The Python class of ``package/msg/Name``, or None where the package is not installed."""
    package, _, name = msgtype.split('/')
    try:
        found: type = getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError):
        return None
    return found


class Player:
    """Publishes a bag's messages and listens for what the nodes answer, by stamp."""

    def __init__(self, node: Node, bag: Bag, options: PlayOptions) -> None:
        self._node, self._bag, self._options = node, bag, options
        self._scan_topic = scan_topic(bag)
        self._publishers = dict(self._advertised())
        self._clock = node.create_publisher(Clock, '/clock', qos.RESULTS)
        self._heard: dict[str, Counter[int]] = {}
        self._awaited: tuple[str, ...] = ()
        self._subscribers: dict[str, str] = {}
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.RESULTS)
        for topic, kind, profile in (
            ('embedding', PointCloud2, qos.RESULTS),
            ('matches', PointCloud2, qos.RESULTS),
            ('rejections', DiagnosticArray, qos.RESULTS),
            ('map/updates', PointCloud2, qos.UPDATES),
        ):
            self._listen(topic, kind, profile)

    def wait_for_listeners(self) -> None:
        """Wait until a node reads the scans and discovery has settled; OffradarError if none comes."""
        publisher = self._publishers[self._scan_topic]
        if not self._spin_until(lambda: publisher.get_subscription_count() > 0):
            raise OffradarError(
                f'topic {publisher.topic_name}: nothing subscribed within {self._options.timeout_s:g} s: '
                'start the encoder node, or remap its input'
            )
        # A node that starts late, or whose announcement was lost, is announced again within three seconds.
        if not self._spin_until(self._is_complete, DISCOVERY_S):
            missing = ', '.join(topic for topic in self._heard if topic not in self._present())
            self._node.get_logger().info(f'no node publishes {missing}: not waiting for it')
        self._awaited = self._present()
        if not self._spin_until(self._have_met):
            self._node.get_logger().warning('the nodes have not all found one another: answers may be lost')

    def play(self) -> Answers:
        """Play the bag once; what was answered."""
        for heard in self._heard.values():
            heard.clear()
        self._latencies_s: list[float] = []
        sent = self._play_in_lockstep() if self._options.lockstep else self._play_at_rate()
        self._settle(sent)
        return self._answers(sent)

    def _play_in_lockstep(self) -> list[int]:
        others = [topic for topic in self._publishers if topic != self._scan_topic]
        gate = StampGate(round(RadarConfig().restart_after_s * 1e9))
        sent: list[int] = []
        silent = 0
        for message in in_lockstep_order(self._bag, self._scan_topic, others, PositionConfig().max_gap_s):
            self._publish(message)
            if message.topic != self._scan_topic:
                continue
            stamp = header_stamp_ns(message.cdr)
            try:
                gate.check(stamp)
            except RefusedInput:
                continue
            sent.append(stamp)
            sent_s = time.monotonic()
            if self._spin_until(functools.partial(self._is_answered, stamp)):
                self._latencies_s.append(time.monotonic() - sent_s)
                silent = 0
            elif (silent := silent + 1) == SILENT_SCANS:
                waited_s = silent * self._options.timeout_s
                raise OffradarError(f'the nodes answered none of the last {silent} scans within {waited_s:g} s')
        return sent

    def _play_at_rate(self) -> list[int]:
        sent: list[int] = []
        started_s = time.monotonic()
        for message in self._bag.messages(list(self._publishers)):
            due_s = started_s + (message.log_ns - self._bag.start_ns) / 1e9 / self._options.rate
            while (left_s := due_s - time.monotonic()) > 0:
                played_ns = round((time.monotonic() - started_s) * self._options.rate * 1e9)
                self._tick(self._bag.start_ns + played_ns)
                self._spin_for(min(left_s, CLOCK_PERIOD_S))
            stamp = self._publish(message)
            if message.topic == self._scan_topic:
                sent.append(stamp)
        return sent

    def _publish(self, message: RawMessage) -> int:
        if self._options.restamp:
            now_ns = time.time_ns()
            self._publishers[message.topic].publish(with_stamp(message.cdr, now_ns))
            return now_ns
        self._tick(message.log_ns)
        self._publishers[message.topic].publish(message.cdr)
        return header_stamp_ns(message.cdr)

    def _tick(self, stamp_ns: int) -> None:
        if not self._options.restamp:
            self._clock.publish(Clock(clock=time_message(stamp_ns)))

    def _is_answered(self, stamp: int) -> bool:
        heard = [topic for topic in self._awaited if stamp in self._heard[topic]]
        queried = any(topic in ANSWERS for topic in self._awaited)
        others = [topic for topic in self._awaited if topic not in ANSWERS]
        return all(topic in heard for topic in others) and (not queried or any(topic in ANSWERS for topic in heard))

    def _settle(self, sent: list[int]) -> None:
        """Wait for messages still on their way, then for answers: bounded in all, and over when nothing more comes."""
        if not self._options.lockstep:
            # Takes up to a heartbeat of 3 s. In lockstep the answers tell that everything arrived.
            for publisher in self._publishers.values():
                publisher.wait_for_all_acked(Duration(seconds=self._options.timeout_s))
        deadline_s = time.monotonic() + self._options.timeout_s
        quiet_s, last = time.monotonic(), -1
        while time.monotonic() < min(deadline_s, quiet_s + SETTLE_S):
            total = sum(heard.total() for heard in self._heard.values())
            if total != last:
                quiet_s, last = time.monotonic(), total
            if all(self._is_answered(stamp) for stamp in sent):
                return
            self._spin_for(0.01)

    def _answers(self, sent: list[int]) -> Answers:
        replies = self._heard['matches'] + self._heard['rejections']
        counted = replies if any(topic in ANSWERS for topic in self._awaited) else self._heard['embedding']
        return Answers(
            scans=len(sent),
            embeddings=sum(self._heard['embedding'][stamp] for stamp in set(sent)),
            matches=sum(self._heard['matches'][stamp] for stamp in set(sent)),
            rejections=sum(self._heard['rejections'][stamp] for stamp in set(sent)),
            unanswered=sum(counted[stamp] == 0 for stamp in set(sent)),
            answered_twice=sum(counted[stamp] > 1 for stamp in set(sent)),
            latencies_s=tuple(self._latencies_s),
        )

    def _advertised(self) -> Iterator[tuple[str, Publisher]]:
        for topic, msgtype in self._bag.topics.items():
            kind = message_class(msgtype)
            if kind is None:
                self._node.get_logger().warning(f'{topic}: type {msgtype} is not installed here: not played')
                continue
            profile = qos.SCANS if topic == self._scan_topic else qos.POSITIONS
            # Relative, so that namespaces and remappings work.
            yield topic, self._node.create_publisher(kind, topic.lstrip('/'), profile)

    def _listen(self, topic: str, kind: type, profile: QoSProfile) -> None:
        heard = self._heard[topic] = Counter()
        note: Callable[[bytes], None] = lambda cdr: heard.update([header_stamp_ns(cdr)])  # noqa: E731
        self._node.create_subscription(kind, topic, note, profile, raw=True)

    def _present(self) -> tuple[str, ...]:
        return tuple(topic for topic in self._heard if self._node.count_publishers(self._resolved(topic)))

    def _is_complete(self) -> bool:
        return len(self._present()) == len(self._heard)

    def _have_met(self) -> bool:
        return all(
            self._subscribers.get(name) == str(self._node.count_subscribers(name))
            for name in map(self._resolved, self._awaited)
        )

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            for item in status.values:
                if item.key.startswith(SUBSCRIBERS):
                    self._subscribers[item.key.removeprefix(SUBSCRIBERS)] = item.value

    def _resolved(self, topic: str) -> str:
        return str(self._node.resolve_topic_name(topic))

    def _spin_for(self, seconds: float) -> None:
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0:
            rclpy.spin_once(self._node, timeout_sec=left_s)

    def _spin_until(self, done: Callable[[], bool], timeout_s: float | None = None) -> bool:
        end_s = time.monotonic() + (self._options.timeout_s if timeout_s is None else timeout_s)
        while not done():
            left_s = end_s - time.monotonic()
            if left_s <= 0:
                return False
            rclpy.spin_once(self._node, timeout_sec=min(left_s, 0.1))
        return True
