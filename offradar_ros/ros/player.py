"""Plays a bag's raw messages into running nodes."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import time
from collections.abc import Iterator, Sequence

from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from offradar_ros.config import PositionConfig
from offradar_ros.errors import OffradarError
from offradar_ros.messages import SHORTEST, header_stamp_ns, with_header_stamp
from offradar_ros.positions.course import LOOK_AHEAD_S
from offradar_ros.recordings.bags.position_topic import position_topic
from offradar_ros.recordings.bags.positions import position_topics
from offradar_ros.recordings.bags.reader import Bag, RawMessage
from offradar_ros.recordings.bags.scan_topic import scan_topic
from offradar_ros.recordings.bags.topics import (
    COMPRESSED,
    COMPRESSED_TYPE,
    FIX,
    FIX_TYPE,
    ODOMETRY,
    SCANS,
    ChosenTopics,
)
from offradar_ros.recordings.drive import in_lockstep_order
from offradar_ros.ros import qos
from offradar_ros.ros.answer_log import HANDLED, REPLIES, TOPICS, AnswerLog, Answers
from offradar_ros.ros.connections import Connections
from offradar_ros.ros.recorded_outputs import DIAGNOSTICS, is_output, is_own_report
from offradar_ros.ros.replay_subscribers import ANNOUNCED_S, UNCHANGED_S, ReplaySubscribers
from offradar_ros.ros.spin import spin_for, spin_until
from offradar_ros.ros.stamps import time_message

ANNOUNCED_TO = {'embedding': 'encoder', HANDLED: 'map_server', REPLIES[0]: 'query'}
"""The nodes that want to know where a recording starts, by a topic that each publishes."""
CLOCK_PERIOD_S = 0.025
DISCOVERY_S = 7.0
"""A node that starts late, or whose announcement was lost, is announced again every three seconds."""
CONNECT_S = ANNOUNCED_S + UNCHANGED_S + 0.5
"""Shortest wait for the nodes to connect; a longer --timeout holds."""
QUIET_S = 1.0
"""After this time without an answer, no more answers are expected."""
SILENT_SCANS = 3
"""In lockstep, so many scans in a row without an answer end the replay."""
BURST = 400
"""Messages in a row, without an answer, that the queues of a busy process have room for."""
AHEAD_S = PositionConfig().max_gap_s
AFTER_S = 2 * AHEAD_S + LOOK_AHEAD_S
"""Positions up to this long after the last scan may decide its pose: the one after it, and the heading there."""
STATIC_TRANSFORMS = '/tf_static'
LATCHED_DEPTH = 100
"""Messages of a latched topic kept for late subscribers: of static transforms, each message may be of another node."""


@dataclasses.dataclass(frozen=True)
class PlayOptions:
    """How a bag is played; see `replay_node --help`."""

    rate: float = 1.0
    lockstep: bool = False
    restamp: bool = False
    timeout_s: float = 10.0
    topics: ChosenTopics = dataclasses.field(default_factory=ChosenTopics)


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
    """Publishes a bag's messages and counts the answers of the nodes."""

    def __init__(self, node: Node, bag: Bag, options: PlayOptions) -> None:
        self._node, self._bag, self._options = node, bag, options
        self._scan_topic = scan_topic(bag, wanted=options.topics.scans)
        self._names = self._played_as()
        self._stamped: set[str] = set()
        # Before the topics of the bag: of two types on one topic, a process can only have the first.
        self._clock = node.create_publisher(Clock, '/clock', qos.RESULTS)
        self._log = AnswerLog(node)
        self._publishers = dict(self._advertised())
        self._others = [topic for topic in self._publishers if topic != self._scan_topic]
        self._stuck: set[str] = set()
        self._start_recording = {
            topic: node.create_client(Trigger, f'{server}/start_recording') for topic, server in ANNOUNCED_TO.items()
        }
        self._connections = Connections(node)
        self._subscribers = ReplaySubscribers(node, self._publishers, bag.topics, self._scan_topic)
        self._sent: list[int] = []
        self._latencies_s: list[float] = []

    def wait_for_listeners(self) -> None:
        """Wait until a node subscribes to the scans and every node whose answers are awaited is connected.

        OffradarError if no node subscribes to the scans. Logs a warning where a subscriber may still miss messages.
        """
        publisher, timeout_s = self._publishers[self._scan_topic], self._options.timeout_s
        if not spin_until(self._node, lambda: publisher.get_subscription_count() > 0, timeout_s):
            raise OffradarError(
                f'topic {publisher.topic_name}: no subscriber within {timeout_s:g} s: '
                f'start the encoder node{self._other_input()}, or remap its input'
            )
        if not spin_until(self._node, lambda: not self._absent(), DISCOVERY_S):
            self._node.get_logger().info(f'no node publishes {", ".join(self._absent())}: not waiting for it')
        self._log.awaited = self._log.published()
        if not spin_until(self._node, self._are_connected, max(timeout_s, CONNECT_S)):
            self._node.get_logger().warning('the nodes are not all connected to one another: answers may be lost')
        for topic, client in self._start_recording.items():
            if topic in self._log.awaited:
                spin_until(self._node, client.service_is_ready, QUIET_S)
        if not spin_until(self._node, lambda: not self._subscribers.unconnected(), timeout_s) and (
            unconnected := self._subscribers.unconnected()
        ):
            self._node.get_logger().warning(f'not every subscriber of {", ".join(unconnected)} will receive all of it')
        self._warn_of_unheard_positions()

    def _warn_of_unheard_positions(self) -> None:
        """Say where positions are played on a topic that the map server does not read."""
        found = {topic: self._publishers.get(topic) for topic in position_topics(self._bag)}
        played = {topic: publisher for topic, publisher in found.items() if publisher is not None}
        if HANDLED in self._log.awaited and played and not any(p.get_subscription_count() for p in played.values()):
            self._node.get_logger().warning(
                f'nobody reads the positions on {", ".join(played)}: --positions NAME plays one of them on '
                f'{FIX.lstrip("/")} or {ODOMETRY.lstrip("/")}, as its type is'
            )

    def play(self) -> None:
        """Play the bag once; in lockstep, OffradarError if answers stop."""
        self._announce()
        if self._options.lockstep:
            self._play_in_lockstep()
        else:
            self._play_at_rate()
        self._wait_for_answers()

    def take_answers(self) -> Answers:
        """Answers since the last call, also if `play` was interrupted."""
        answers = self._log.answers(self._sent, self._latencies_s)
        self._sent, self._latencies_s = [], []
        self._log.clear()
        return answers

    def finish(self) -> None:
        """After lockstep, wait until every subscriber has received everything; this may take a heartbeat of 3 s.

        The answers of the nodes show what they have received. Other subscribers may need a message sent again.
        """
        if self._options.lockstep:
            awaited = self._log.awaited
            self._wait_for_acknowledgement([t for t in self._others if self._subscribers.has_others(t, awaited)])

    def _announce(self) -> None:
        """Announce a recording to the nodes: the stamps of a short one do not show that it is played again."""
        for client in self._start_recording.values():
            if not client.service_is_ready():
                continue
            answer = client.call_async(Trigger.Request())
            if not spin_until(self._node, answer.done, self._options.timeout_s):
                self._node.get_logger().warning(f'{client.service_name}: no answer')
        # A late answer to the recording before has a stamp of this one.
        self._log.clear()

    def _play_in_lockstep(self) -> None:
        silent = burst = 0
        for message in in_lockstep_order(self._bag, self._scan_topic, self._others, AHEAD_S):
            if self._is_cut(message):
                continue
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
            if spin_until(self._node, functools.partial(self._is_answered, stamp), self._options.timeout_s):
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
        # Positions from long before the first scan are sent at once.
        base_ns = max(self._bag.start_ns, first_ns - round(AHEAD_S * 1e9))
        left, end_ns = self._bag.counts[self._scan_topic], 0
        started_s = time.monotonic()
        for message in self._bag.messages(list(self._publishers)):
            if left == 0 and message.log_ns > end_ns:
                break
            due_s = started_s + (message.log_ns - base_ns) / 1e9 / self._options.rate
            while (left_s := due_s - time.monotonic()) > 0:
                self._tick(base_ns + round((time.monotonic() - started_s) * self._options.rate * 1e9))
                spin_for(self._node, min(left_s, CLOCK_PERIOD_S))
            if not self._is_cut(message):
                self._publish(message)
            if message.topic == self._scan_topic:
                left, end_ns = left - 1, message.log_ns + round(AFTER_S * 1e9)

    def _publish(self, message: RawMessage) -> None:
        cdr = message.cdr
        if message.msgtype == DIAGNOSTICS and is_own_report(self._bag, message):
            return
        if self._options.restamp and message.topic in self._stamped:
            cdr = with_header_stamp(cdr, time.time_ns())
        self._tick(message.log_ns)
        if message.topic == self._scan_topic:
            self._log.expect(header_stamp_ns(cdr))
        self._publishers[message.topic].publish(cdr)
        if message.topic == self._scan_topic:
            self._sent.append(header_stamp_ns(cdr))

    def _is_cut(self, message: RawMessage) -> bool:
        """Whether a message is too short for the stamp that it should start with; says so."""
        cut = message.topic in self._stamped and len(message.cdr) < SHORTEST
        if cut:
            self._node.get_logger().warning(
                f'{message.topic}: a message of {len(message.cdr)} bytes at {message.log_ns} ns is damaged: not played'
            )
        return cut

    def _tick(self, stamp_ns: int) -> None:
        if not self._options.restamp:
            self._clock.publish(Clock(clock=time_message(stamp_ns)))

    def _wait_for_answers(self) -> None:
        """Wait until messages are received, then for answers: at most `timeout_s` each, and while answers arrive."""
        if not self._options.lockstep:
            # In lockstep the answers show that everything arrived.
            self._wait_for_acknowledgement([*self._publishers])
        deadline_s = time.monotonic() + self._options.timeout_s
        quiet_s, last = time.monotonic(), -1
        while time.monotonic() < min(deadline_s, quiet_s + QUIET_S):
            if self._log.total != last:
                quiet_s, last = time.monotonic(), self._log.total
            if all(self._is_answered(stamp) for stamp in self._sent):
                return
            spin_for(self._node, 0.01)

    def _wait_for_acknowledgement(self, topics: Sequence[str]) -> None:
        """Wait until every subscriber has every message, which may take a heartbeat of 3 s; for a stuck one, once."""
        now = Duration(seconds=0)

        def missing() -> set[str]:
            return {t for t in topics if t not in self._stuck and not self._publishers[t].wait_for_all_acked(now)}

        if not spin_until(self._node, lambda: not missing(), self._options.timeout_s) and (stuck := missing()):
            self._stuck |= stuck
            self._node.get_logger().warning(
                f'{", ".join(sorted(stuck))}: not acknowledged by every subscriber within '
                f'{self._options.timeout_s:g} s: not waiting for that any more'
            )

    def _played_as(self) -> dict[str, str]:
        """The name that each topic is played on: relative, so that namespaces and remappings work.

        Topics that were chosen get the names of the nodes' inputs, in place of topics that have them in the bag.
        """
        bag, chosen, scans = self._bag, self._options.topics, self._scan_topic
        inputs: dict[str, str] = {}
        if chosen.scans:
            inputs[scans] = SCANS + (COMPRESSED if bag.topics[scans] == COMPRESSED_TYPE else '')
        if chosen.positions and (positions := position_topic(bag, scans, chosen.positions)):
            inputs[positions] = FIX if bag.topics[positions] == FIX_TYPE else ODOMETRY
        taken = {name: topic for topic, name in inputs.items()}
        names: dict[str, str] = {}
        for topic in bag.topics:
            instead = taken.get(topic, topic)
            if topic in inputs or instead == topic:
                names[topic] = inputs.get(topic, topic).lstrip('/')
            else:
                self._node.get_logger().info(f'{topic}: not played, {instead} is played in its place')
        return names

    def _other_input(self) -> str:
        """How the encoder node reads the scans, where it does not by itself."""
        if self._bag.topics[self._scan_topic] == COMPRESSED_TYPE:
            return ' with radar.transport: compressed'
        if self._names[self._scan_topic] != SCANS.lstrip('/'):
            return f', replay with --topic {self._scan_topic} to play it on {SCANS.lstrip("/")}'
        return ''

    def _advertised(self) -> Iterator[tuple[str, Publisher]]:
        log = self._node.get_logger()
        for topic, name in self._names.items():
            msgtype = self._bag.topics[topic]
            kind = message_class(msgtype)
            if topic != self._scan_topic and is_output(self._bag, topic):
                log.info(f'{topic}: said by the nodes when it was recorded: not played')
                continue
            if kind is None:
                log.warning(f'{topic}: type {msgtype} is not installed here: not played')
                continue
            try:
                publisher = self._node.create_publisher(kind, name, self._profile(topic))
            except (NameValidationException, RuntimeError) as error:
                # A name that ROS 2 does not allow, or one that this process has with another type.
                reason = str(error).splitlines()[0]
                if topic == self._scan_topic:
                    raise OffradarError(f'{topic}: cannot be played: {reason} (--topic {topic} renames it)') from error
                log.warning(f'{topic}: cannot be published as {msgtype} here: not played ({reason})')
                continue
            if starts_with_header(kind):
                self._stamped.add(topic)
            yield topic, publisher

    def _profile(self, topic: str) -> QoSProfile:
        if topic == self._scan_topic:
            return qos.SCANS
        if topic == STATIC_TRANSFORMS or self._bag.is_latched(topic):
            return QoSProfile(
                depth=LATCHED_DEPTH,
                reliability=ReliabilityPolicy.RELIABLE,
                durability=DurabilityPolicy.TRANSIENT_LOCAL,
            )
        return qos.POSITIONS

    def _absent(self) -> list[str]:
        published = self._log.published()
        return [topic for topic in TOPICS if topic not in published]

    def _are_connected(self) -> bool:
        # Each call asks the nodes again, so all are made.
        complete = [self._connections.is_complete(topic) for topic in self._log.awaited]
        return all([self._subscribers.is_discovered(), *complete])
