"""The drives through the real nodes over DDS, each node a process of its own."""

from __future__ import annotations

import dataclasses
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from offradar_ros.errors import OffradarError
from offradar_ros.lab.demo.drives import Bars, Drive
from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.recordings.bags.reader import Bag, scan_topic
from offradar_ros.ros import qos
from offradar_ros.ros.answers import REPLIES
from offradar_ros.ros.outcome_message import match_record, rejection_record
from offradar_ros.types import Outcome

REPLAY_TIMEOUT_S = 240.0
MEET_S = 15.0


@dataclasses.dataclass(frozen=True)
class Driven:
    """Result of one drive: an outcome for each answered scan, the replay's counts and the merge report."""

    drive: Drive
    outcomes: tuple[Outcome, ...]
    counts: dict[str, int]
    latencies_s: tuple[float, ...]
    report: str


def drive_live(drives: list[Drive], folder: Path, params: Path, domain_id: int, bars: Bars) -> list[Driven]:
    """Replay every drive in lockstep; the nodes stop afterwards, whatever happens."""
    parameters = {'map.path': folder / 'map.db', 'map.start_session': False}
    with Stack(folder / 'logs', domain_id, parameters, [params]) as nodes, _listening(domain_id) as listener:
        nodes.wait_until_ready()
        listener.wait_until_met()
        return [_replayed(drive, nodes, listener.outcomes, bars) for drive in drives]


def _replayed(drive: Drive, nodes: Stack, outcomes: list[Outcome], bars: Bars) -> Driven:
    outcomes.clear()
    report = nodes.folder / f'{drive.name}.json'
    arguments = [str(drive.bag), '--lockstep', '--report', str(report), *(['--session'] if drive.mapped else [])]
    process = nodes.start('replay_node', arguments, f'replay_{drive.name}')
    with Bag(drive.bag) as bag:
        total = bag.counts[scan_topic(bag)]
    try:
        with bars(f'{"mapping" if drive.mapped else "querying"} {drive.name}') as progress:
            for _ in range(round(REPLAY_TIMEOUT_S * 10)):
                progress(len(outcomes), total)
                if process.process.poll() is not None:
                    break
                threading.Event().wait(0.1)
            if process.wait(1.0):
                raise OffradarError(f'replay of {drive.name} failed: {process.last_words()}')
            progress(len(outcomes), total)
    finally:
        process.stop()
    reported = json.loads(report.read_text(encoding='utf-8'))
    counts = {name: value for name, value in reported.items() if isinstance(value, int)}
    return Driven(drive, tuple(outcomes), counts, tuple(reported['latencies_s']), reported['session'])


class _Listener:
    """A node of the demonstration's own, as a vehicle's stack would have one, that keeps every answer."""

    def __init__(self, context: Context) -> None:
        self.node = Node('listener', context=context)
        self.outcomes: list[Outcome] = []
        self._met: set[str] = set()
        self._all_met = threading.Event()
        # Deeper than the results' own queue: in lockstep they come faster than a busy process takes them.
        self.node.create_subscription(PointCloud2, 'matches', self._on_match, qos.UPDATES)
        self.node.create_subscription(DiagnosticArray, 'rejections', self._on_rejection, qos.UPDATES)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.RESULTS)

    def wait_until_met(self) -> None:
        """Wait until the query node knows of this one, so that not even its first answer is missed."""
        if not self._all_met.wait(MEET_S):
            raise OffradarError(f'the query node has not found the demonstration within {MEET_S:g} s')

    def _on_match(self, message: PointCloud2) -> None:
        self.outcomes.append(match_record(message, 'matches'))

    def _on_rejection(self, message: DiagnosticArray) -> None:
        self.outcomes.append(rejection_record(message, 'rejections'))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        values = {item.key: item.value for status in message.status for item in status.values}
        self._met |= {topic for topic in REPLIES if values.get(f'subscribers./{topic}', '0') != '0'}
        if len(self._met) == len(REPLIES):
            self._all_met.set()


@contextmanager
def _listening(domain_id: int) -> Iterator[_Listener]:
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    listener = _Listener(context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(listener.node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    try:
        yield listener
    finally:
        executor.shutdown(5.0)
        thread.join(5.0)
        listener.node.destroy_node()
        rclpy.shutdown(context=context)
