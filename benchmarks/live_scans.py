"""Publish scans to running nodes as a radar does, and record when each is answered."""

from __future__ import annotations

import dataclasses
import os
import time
from pathlib import Path
from types import TracebackType

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Image, NavSatFix, PointCloud2

from offradar_ros.lab.live.spin_thread import SpinThread
from offradar_ros.messages import header_stamp_ns, with_header_stamp
from offradar_ros.nodes.encoder_node import SCANS
from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.scan_topic import scan_topic
from offradar_ros.recordings.bags.topics import FIX, FIX_TYPE
from offradar_ros.ros import qos

WARM_UP_S = 20.0
"""Longest warm-up."""

WARM_UP_HZ = 10.0

QUIET_S = 3.0
"""Without a new answer for this long, the remaining scans count as not answered."""


@dataclasses.dataclass(frozen=True)
class Recording:
    """CDR bytes of a drive: `scans[i]` was taken where `fixes[i]` was."""

    scans: tuple[bytes, ...]
    fixes: tuple[bytes, ...]


def read_recording(path: Path) -> Recording:
    """Every scan of a bag with the position recorded next to it."""
    with Bag(path) as bag:
        scans = [(message.log_ns, message.cdr) for message in bag.messages([scan_topic(bag)])]
        fixes = [(message.log_ns, message.cdr) for message in bag.messages(bag.topics_of(FIX_TYPE))]
    nearest = [min(fixes, key=lambda fix: abs(fix[0] - log_ns))[1] for log_ns, _ in scans]
    return Recording(tuple(cdr for _, cdr in scans), tuple(nearest))


@dataclasses.dataclass(frozen=True)
class DriveTiming:
    """Number of scans that were sent, and the latency of each answered one, in the order of the scans."""

    sent: int
    latencies_s: tuple[float, ...]


class LiveScans:
    """A node that publishes scans as the driver of a radar, and receives the answers.

    Set ROS_DOMAIN_ID of this process to the domain of the nodes first.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._context = Context()
        rclpy.init(context=self._context, domain_id=int(os.environ['ROS_DOMAIN_ID']))
        self._node = Node('radar', context=self._context)
        self._scans = self._node.create_publisher(Image, SCANS, qos.SCANS)
        self._fixes = self._node.create_publisher(NavSatFix, FIX.lstrip('/'), qos.POSITIONS)
        self._sent_s: dict[int, float] = {}
        self._latency_s: dict[int, float] = {}
        self._next = 0
        self.first_embedding_s = 0.0
        self.diagnostics: dict[str, dict[str, str]] = {}
        self._node.create_subscription(PointCloud2, 'embedding', self._on_embedding, qos.RESULTS, raw=True)
        for kind, topic in ((PointCloud2, 'matches'), (DiagnosticArray, 'rejections')):
            self._node.create_subscription(kind, topic, self._on_answer, qos.UPDATES, raw=True)
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.RESULTS)
        executor = SingleThreadedExecutor(context=self._context)
        executor.add_node(self._node)
        self._spin = SpinThread(executor)

    def __enter__(self) -> LiveScans:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._spin.stop()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def warm_up(self, scans: int) -> None:
        """Send scans until `scans` of them were answered, so that all nodes are connected; SystemExit after 20 s."""
        deadline_s = time.monotonic() + WARM_UP_S
        while len(self._latency_s) < scans:
            if time.monotonic() > deadline_s:
                raise SystemExit(f'error: {len(self._latency_s)} of {scans} warm-up scans answered in {WARM_UP_S:g} s')
            self._send()
            time.sleep(1.0 / WARM_UP_HZ)
        self._wait_for_answers()

    def drive(self, seconds: float, rate_hz: float) -> DriveTiming:
        """Send a scan every 1 / `rate_hz` seconds, repeating the drive, and wait for the last answers."""
        self._sent_s, self._latency_s = {}, {}
        started_s = time.monotonic()
        for k in range(round(seconds * rate_hz)):
            while (left_s := started_s + k / rate_hz - time.monotonic()) > 0.0:
                time.sleep(left_s)
            self._send()
        self._wait_for_answers()
        latencies_s = dict(self._latency_s)
        return DriveTiming(len(self._sent_s), tuple(latencies_s[stamp] for stamp in sorted(latencies_s)))

    def _send(self) -> None:
        index = self._next % len(self._recording.scans)
        self._next += 1
        now_ns = time.time_ns()
        scan, fix = (with_header_stamp(cdr[index], now_ns) for cdr in (self._recording.scans, self._recording.fixes))
        self._sent_s[now_ns] = time.monotonic()
        self._scans.publish(scan)
        self._fixes.publish(fix)

    def _wait_for_answers(self) -> None:
        """Wait until every scan is answered, or no answer has come for `QUIET_S`."""
        last, quiet_s = -1, time.monotonic()
        while len(self._latency_s) < len(self._sent_s) and time.monotonic() - quiet_s < QUIET_S:
            if len(self._latency_s) != last:
                last, quiet_s = len(self._latency_s), time.monotonic()
            time.sleep(0.01)

    def _on_embedding(self, _cdr: bytes) -> None:
        self.first_embedding_s = self.first_embedding_s or time.monotonic()

    def _on_answer(self, cdr: bytes) -> None:
        stamp_ns = header_stamp_ns(cdr)
        if stamp_ns in self._sent_s:
            self._latency_s[stamp_ns] = time.monotonic() - self._sent_s[stamp_ns]

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.diagnostics[status.name.partition(':')[0]] = {item.key: item.value for item in status.values}
