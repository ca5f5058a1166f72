"""A bag's raw messages into running nodes."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import time
from collections.abc import Callable, Iterator, Sequence

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from offradar_ros.config import PositionConfig
from offradar_ros.errors import OffradarError
from offradar_ros.messages import STAMP, STAMP_OFFSET, header_stamp_ns
from offradar_ros.recordings.bags.reader import Bag, RawMessage, scan_topic
from offradar_ros.recordings.bags.topics import FIX_TYPE, ODOMETRY_TYPE
from offradar_ros.recordings.drive import in_lockstep_order
from offradar_ros.ros import qos
from offradar_ros.ros.answers import TOPICS, AnswerLog, Answers
from offradar_ros.ros.listeners import count_listeners
from offradar_ros.ros.stamps import time_message

# What the nodes themselves say: a recording of it must not be mistaken for their answer.
OUTPUTS = (
    '/clock',
    '/diagnostics',
    '/embedding',
    '/embedding/model',
    '/map',
    '/map/descriptors',
    '/map/updates',
    '/match_pose',
    '/matches',
    '/parameter_events',
    '/rejections',
    '/rosout',
)
SUBSCRIBERS = 'subscribers.'
CLOCK_PERIOD_S = 0.025
DISCOVERY_S = 4.0
ANNOUNCED_S = 3.5
"""Everybody announces himself every three seconds: by then, those who missed the first time have met too."""
SETTLE_S = 1.0
"""Nothing new for so long, and everything is taken to have come."""
SILENT_SCANS = 3
BURST = 400
"""Messages sent without an answer in between that a busy process can be trusted to have room for."""
AHEAD_S = PositionConfig().max_gap_s


@dataclasses.dataclass(frozen=True)
class PlayOptions:
    """How a bag is played; see `replay_node --help`."""

    rate: float = 1.0
    lockstep: bool = False
    restamp: bool = False
    timeout_s: float = 10.0


def with_stamp(cdr: bytes, stamp_ns: int) -> bytes:
    """The same message with another header stamp; for messages that start with a header."""
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


def starts_with_header(kind: type) -> bool:
    """Whether a message's first field is a std_msgs/Header."""
    fields: dict[str, str] = kind.get_fields_and_field_types()  # type: ignore[attr-defined]
    return next(iter(fields.values()), '') == 'std_msgs/Header'


class Player:
    """Publishes a bag's messages and listens for what the nodes answer."""

    def __init__(self, node: Node, bag: Bag, options: PlayOptions) -> None:
        self._node, self._bag, self._options = node, bag, options
        self._scan_topic = scan_topic(bag)
        self._stamped: set[str] = set()
        self._publishers = dict(self._advertised())
        self._others = [topic for topic in self._publishers if topic != self._scan_topic]
        self._stuck: set[str] = set()
        self._start_recording = node.create_client(Trigger, 'encoder/start_recording')
        self._clock = node.create_publisher(Clock, '/clock', qos.RESULTS)
        self._log = AnswerLog(node)
        self._subscribers: dict[str, str] = {}
        self._around: list[object] = []
        self._started_s = self._changed_s = time.monotonic()
        self._sent: list[int] = []
        self._latencies_s: list[float] = []
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.RESULTS)

    def wait_for_listeners(self) -> None:
        """Wait until a node reads the scans and discovery has settled; OffradarError if none comes."""
        publisher = self._publishers[self._scan_topic]
        if not self._spin_until(lambda: publisher.get_subscription_count() > 0, self._options.timeout_s):
            raise OffradarError(
                f'topic {publisher.topic_name}: nothing subscribed within {self._options.timeout_s:g} s: '
                'start the encoder node, or remap its input'
            )
        # A node that starts late, or whose announcement was lost, is announced again within three seconds.
        if not self._spin_until(lambda: not self._absent(), DISCOVERY_S):
            self._node.get_logger().info(f'no node publishes {", ".join(self._absent())}: not waiting for it')
        self._log.awaited = self._log.present()
        longest_s = max(self._options.timeout_s, ANNOUNCED_S + SETTLE_S)
        if not self._spin_until(lambda: all((self._is_quiet(), self._have_met())), longest_s):
            self._node.get_logger().warning('the nodes have not all found one another: answers may be lost')
        if 'embedding' in self._log.awaited:
            self._spin_until(self._start_recording.service_is_ready, SETTLE_S)
        if not self._spin_until(lambda: not self._unmet(), self._options.timeout_s) and (unmet := self._unmet()):
            self._node.get_logger().warning(f'not everybody who listens to {", ".join(unmet)} will hear all of it')

    def play(self) -> None:
        """Play the bag once; OffradarError if in lockstep nothing answers any more."""
        self._announce()
        if self._options.lockstep:
            self._play_in_lockstep()
        else:
            self._play_at_rate()
        self._settle()

    def take_answers(self) -> Answers:
        """What was answered since the last call, also where `play` was cut short."""
        answers = self._log.answers(self._sent, self._latencies_s)
        self._sent, self._latencies_s = [], []
        self._log.clear()
        return answers

    def finish(self) -> None:
        """Stay until everybody has everything that was played in lockstep; may take a heartbeat of 3 s.

        The nodes' answers tell what those have heard. Others may have to ask for something again.
        """
        if self._options.lockstep:
            self._wait_for_acknowledgement([topic for topic in self._others if self._is_heard_by_others(topic)])

    def _announce(self) -> None:
        """Tell the encoder that a recording starts: one too short to be told by its stamps may be played again."""
        if not self._start_recording.service_is_ready():
            return
        told = self._start_recording.call_async(Trigger.Request())
        if not self._spin_until(told.done, self._options.timeout_s):
            self._node.get_logger().warning(f'{self._start_recording.service_name}: no answer')
        # What came late of the recording before has the stamps of this one.
        self._log.clear()

    def _play_in_lockstep(self) -> None:
        silent = burst = 0
        for message in in_lockstep_order(self._bag, self._scan_topic, self._others, AHEAD_S):
            repeated = message.topic == self._scan_topic and self._sent[-1:] == [header_stamp_ns(message.cdr)]
            self._publish(message)
            if message.topic != self._scan_topic:
                burst += 1
                if burst == BURST:
                    self._wait_for_acknowledgement(self._others)
                    burst = 0
                continue
            if repeated:
                continue
            stamp, sent_s = self._sent[-1], time.monotonic()
            if self._spin_until(functools.partial(self._is_answered, stamp), self._options.timeout_s):
                self._latencies_s.append(time.monotonic() - sent_s)
                silent = burst = 0
            elif (silent := silent + 1) == SILENT_SCANS:
                raise OffradarError(
                    f'nothing on {", ".join(self._log.missing(stamp))} for the last {silent} scans, each waited for '
                    f'{self._options.timeout_s:g} s'
                )

    def _is_answered(self, stamp: int) -> bool:
        return not self._log.missing(stamp)

    def _play_at_rate(self) -> None:
        first_ns = next(self._bag.messages([self._scan_topic])).log_ns
        # Positions from long before the drive are sent at once.
        base_ns = max(self._bag.start_ns, first_ns - round(AHEAD_S * 1e9))
        left, end_ns = self._bag.counts[self._scan_topic], 0
        started_s = time.monotonic()
        for message in self._bag.messages(list(self._publishers)):
            if left == 0 and message.log_ns > end_ns:
                break
            due_s = started_s + (message.log_ns - base_ns) / 1e9 / self._options.rate
            while (left_s := due_s - time.monotonic()) > 0:
                self._tick(base_ns + round((time.monotonic() - started_s) * self._options.rate * 1e9))
                self._spin_for(min(left_s, CLOCK_PERIOD_S))
            self._publish(message)
            if message.topic == self._scan_topic:
                left, end_ns = left - 1, message.log_ns + round(AHEAD_S * 1e9)

    def _publish(self, message: RawMessage) -> None:
        cdr = message.cdr
        if self._options.restamp and message.topic in self._stamped:
            cdr = with_stamp(cdr, time.time_ns())
        self._tick(message.log_ns)
        self._publishers[message.topic].publish(cdr)
        if message.topic == self._scan_topic:
            self._sent.append(header_stamp_ns(cdr))

    def _tick(self, stamp_ns: int) -> None:
        if not self._options.restamp:
            self._clock.publish(Clock(clock=time_message(stamp_ns)))

    def _settle(self) -> None:
        """Wait for messages still on their way, then for answers: bounded in all, and over when nothing more comes."""
        if not self._options.lockstep:
            # In lockstep the answers tell that everything arrived.
            self._wait_for_acknowledgement([*self._publishers])
        deadline_s = time.monotonic() + self._options.timeout_s
        quiet_s, last = time.monotonic(), -1
        while time.monotonic() < min(deadline_s, quiet_s + SETTLE_S):
            if self._log.total != last:
                quiet_s, last = time.monotonic(), self._log.total
            if all(self._is_answered(stamp) for stamp in self._sent):
                return
            self._spin_for(0.01)

    def _wait_for_acknowledgement(self, topics: Sequence[str]) -> None:
        """Until every subscriber has everything; may take a heartbeat of 3 s. One that is stuck is waited for once."""
        now = Duration(seconds=0)

        def lacking() -> set[str]:
            return {t for t in topics if t not in self._stuck and not self._publishers[t].wait_for_all_acked(now)}

        if not self._spin_until(lambda: not lacking(), self._options.timeout_s) and (stuck := lacking()):
            self._stuck |= stuck
            self._node.get_logger().warning(
                f'{", ".join(sorted(stuck))}: not acknowledged by every subscriber within '
                f'{self._options.timeout_s:g} s: not waiting for that any more'
            )

    def _advertised(self) -> Iterator[tuple[str, Publisher]]:
        for topic, msgtype in self._bag.topics.items():
            kind = message_class(msgtype)
            if topic != self._scan_topic and topic.endswith(OUTPUTS):
                self._node.get_logger().info(f'{topic}: said by the nodes when it was recorded: not played')
            elif kind is None:
                self._node.get_logger().warning(f'{topic}: type {msgtype} is not installed here: not played')
            else:
                if starts_with_header(kind):
                    self._stamped.add(topic)
                profile = qos.SCANS if topic == self._scan_topic else qos.POSITIONS
                # Relative, so that namespaces and remappings work.
                yield topic, self._node.create_publisher(kind, topic.lstrip('/'), profile)

    def _absent(self) -> list[str]:
        present = self._log.present()
        return [topic for topic in TOPICS if topic not in present]

    def _is_quiet(self) -> bool:
        """Whether all have been discovered, where a bag has topics that the nodes which answer know nothing of."""
        if all(self._bag.topics[topic] in (FIX_TYPE, ODOMETRY_TYPE) for topic in self._others):
            return True
        counts = [self._node.count_subscribers(publisher.topic_name) for publisher in self._publishers.values()]
        around = [*sorted(self._node.get_node_names_and_namespaces()), *counts]
        now_s = time.monotonic()
        if around != self._around:
            self._around, self._changed_s = around, now_s
        return now_s - self._started_s >= ANNOUNCED_S and now_s - self._changed_s >= SETTLE_S

    def _have_met(self) -> bool:
        """Whether each node that answers knows of everybody who can hear it."""
        for topic in map(self._node.resolve_topic_name, self._log.awaited):
            offers = self._node.get_publishers_info_by_topic(topic)
            known = self._subscribers.get(topic)
            if not any(known == str(count_listeners(self._node, topic, o.topic_type, o.qos_profile)) for o in offers):
                return False
        return True

    def _unmet(self) -> list[str]:
        """Topics of the bag that somebody can hear who is not connected yet."""
        offers = [(topic, self._bag.topics[topic], publisher) for topic, publisher in self._publishers.items()]
        return [
            topic
            for topic, msgtype, publisher in offers
            if publisher.get_subscription_count()
            < count_listeners(self._node, publisher.topic_name, msgtype, publisher.qos_profile)
        ]

    def _is_heard_by_others(self, topic: str) -> bool:
        node, awaited = self._node, map(self._node.resolve_topic_name, self._log.awaited)
        answering = [info for answer in awaited for info in node.get_publishers_info_by_topic(answer)]
        known = {(info.node_namespace, info.node_name) for info in answering}
        listening = node.get_subscriptions_info_by_topic(self._publishers[topic].topic_name)
        return any((info.node_namespace, info.node_name) not in known for info in listening)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            for item in status.values:
                if item.key.startswith(SUBSCRIBERS):
                    self._subscribers[item.key.removeprefix(SUBSCRIBERS)] = item.value

    def _spin_for(self, seconds: float) -> None:
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0:
            rclpy.spin_once(self._node, timeout_sec=left_s)

    def _spin_until(self, done: Callable[[], bool], timeout_s: float) -> bool:
        end_s = time.monotonic() + timeout_s
        while not done():
            left_s = end_s - time.monotonic()
            if left_s <= 0:
                return False
            rclpy.spin_once(self._node, timeout_sec=min(left_s, 0.1))
        return True
