"""Answers of running nodes to the scans of a replay: received by stamp, and counted."""

from __future__ import annotations

import dataclasses
import functools
from collections import Counter
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from offradar_ros.errors import RefusedInput
from offradar_ros.messages import SHORTEST, header_stamp_ns, stamp_ns
from offradar_ros.ros import qos
from offradar_ros.ros.outcome_message import rejection_record

REPLIES = ('matches', 'rejections')
"""The two topics of answers; each embedding is answered on one of them."""

HANDLED = 'map_server/handled'
"""The stamp of each scan that the map server has handled, published only while there is a subscriber."""

TOPICS = ('embedding', *REPLIES, HANDLED)


@dataclasses.dataclass(frozen=True)
class Answers:
    """Counts over the scans of a replay; latencies in seconds from sending a scan to its last answer."""

    scans: int = 0
    embeddings: int = 0
    matches: int = 0
    rejections: int = 0
    unanswered: int = 0
    answered_twice: int = 0
    reasons: dict[str, int] = dataclasses.field(default_factory=dict)
    latencies_s: tuple[float, ...] = ()

    def __add__(self, other: Answers) -> Answers:
        fields = [field.name for field in dataclasses.fields(self) if field.name != 'reasons']
        reasons = dict(Counter(self.reasons) + Counter(other.reasons))
        return Answers(**{name: getattr(self, name) + getattr(other, name) for name in fields}, reasons=reasons)

    def summary(self, seconds: float) -> str:
        """One line."""
        reasons = ', '.join(f'{count} {reason}' for reason, count in sorted(self.reasons.items()))
        text = (
            f'replayed {self.scans} scans, {self.embeddings} embeddings, {self.matches} matches, '
            f'{self.rejections} rejections{f" ({reasons})" if reasons else ""}, {self.unanswered} unanswered, '
            f'{self.answered_twice} answered twice in {seconds:.1f} s'
        )
        if self.latencies_s:
            p50, p99 = np.percentile(self.latencies_s, [50, 99]) * 1e3
            text += f' ({self.scans / max(seconds, 1e-9):.1f} scans/s); latency median {p50:.1f} ms, p99 {p99:.1f} ms'
        return text


class AnswerLog:
    """Subscribes to every topic that answers a scan."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._received: dict[str, Counter[int]] = {topic: Counter() for topic in TOPICS}
        self._reasons: dict[int, str] = {}
        self._expected: set[int] = set()
        self.awaited: tuple[str, ...] = ()
        for topic, kind in (('embedding', PointCloud2), ('matches', PointCloud2), (HANDLED, Header)):
            receive = functools.partial(self._receive, topic)
            node.create_subscription(kind, topic, receive, qos.UPDATES, raw=True)
        node.create_subscription(DiagnosticArray, 'rejections', self._receive_rejection, qos.UPDATES)

    def expect(self, stamp: int) -> None:
        """Count answers to the scan of this stamp from now on; others are not ours, and would be kept in vain."""
        self._expected.add(stamp)

    def _receive(self, topic: str, cdr: bytes) -> None:
        # Its publisher may write anything: a message shorter than a header is no answer.
        if len(cdr) >= SHORTEST and (stamp := header_stamp_ns(cdr)) in self._expected:
            self._received[topic][stamp] += 1

    def _receive_rejection(self, message: DiagnosticArray) -> None:
        try:
            stamp = stamp_ns(message.header.stamp)
        except RefusedInput:
            return
        if stamp not in self._expected:
            return
        self._received['rejections'][stamp] += 1
        try:
            self._reasons[stamp] = rejection_record(message, 'rejections').reason.value
        except RefusedInput as problem:
            self._reasons[stamp] = problem.cause

    def clear(self) -> None:
        """Forget what was received."""
        for received in self._received.values():
            received.clear()
        self._reasons.clear()
        self._expected.clear()

    def published(self) -> tuple[str, ...]:
        """The topics with a publisher."""
        return tuple(t for t in TOPICS if self._node.count_publishers(self._node.resolve_topic_name(t)))

    def missing(self, stamp: int) -> tuple[str, ...]:
        """The awaited topics on which nothing has been received for a scan."""
        silent = tuple(topic for topic in self.awaited if stamp not in self._received[topic])
        replied = any(stamp in self._received[topic] for topic in REPLIES)
        return tuple(topic for topic in silent if not (replied and topic in REPLIES))

    @property
    def total(self) -> int:
        """Number of messages received."""
        return sum(received.total() for received in self._received.values())

    def answers(self, sent: list[int], latencies_s: list[float]) -> Answers:
        """Counts over the sent stamps."""
        stamps = set(sent)
        replies = self._received['matches'] + self._received['rejections']
        counted = replies if any(topic in REPLIES for topic in self.awaited) else self._received['embedding']
        fields: dict[str, Any] = {
            'embeddings': sum(self._received['embedding'][stamp] for stamp in stamps),
            'matches': sum(self._received['matches'][stamp] for stamp in stamps),
            'rejections': sum(self._received['rejections'][stamp] for stamp in stamps),
            'unanswered': sum(counted[stamp] == 0 for stamp in stamps),
            'answered_twice': sum(counted[stamp] > 1 for stamp in stamps),
        }
        reasons = Counter(self._reasons[stamp] for stamp in stamps if stamp in self._reasons)
        return Answers(scans=len(sent), **fields, reasons=dict(reasons), latencies_s=tuple(latencies_s))
