"""Replay of the drives through the nodes over DDS, each node in a separate process."""

from __future__ import annotations

import dataclasses
import json
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from offradar_ros.errors import OffradarError
from offradar_ros.lab.demo.drives import DemoDrive, ProgressBars
from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.lab.live.spin_thread import SpinThread
from offradar_ros.mapping.store import MapStore
from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.scan_topic import scan_topic
from offradar_ros.ros import qos
from offradar_ros.ros.answer_log import REPLIES
from offradar_ros.ros.connections import Connections
from offradar_ros.ros.initialise import initialise
from offradar_ros.ros.localisation_message import localisation_record
from offradar_ros.ros.outcome_message import match_record, rejection_record
from offradar_ros.types import Localisation, Outcome, PlaceTable

MAP = 'map.db'
REPLAY_TIMEOUT_S = 600.0
CONNECT_S = 60.0
POLL_S = 0.1


@dataclasses.dataclass(frozen=True)
class ReplayedDrive:
    """Result of one drive.

    Attributes:
        drive: the drive.
        places: the map that its scans were searched for in.
        outcomes: one for each answered scan.
        localisations: where the vehicle is after each scan, by the scan's stamp.
        counts: counts of the replay.
        latencies_s: seconds from each scan to its answer.
        report: merge report of the session, as text.
    """

    drive: DemoDrive
    places: PlaceTable
    outcomes: tuple[Outcome, ...]
    localisations: Mapping[int, Localisation]
    counts: dict[str, int]
    latencies_s: tuple[float, ...]
    report: str


def replay_drives(
    drives: list[DemoDrive], folder: Path, params: Path, domain_id: int, bars: ProgressBars
) -> list[ReplayedDrive]:
    """Replay every drive in lockstep; the nodes are stopped afterwards, also after an error."""
    parameters = {'map.path': folder / MAP, 'map.start_session': False}
    with Stack(folder / 'logs', domain_id, parameters, [params]) as nodes, _listening(domain_id) as listener:
        nodes.wait_until_ready()
        listener.wait_until_connected()
        return [_replayed(drive, nodes, listener, bars) for drive in drives]


def _replayed(drive: DemoDrive, nodes: Stack, listener: _Listener, bars: ProgressBars) -> ReplayedDrive:
    outcomes, localisations = listener.outcomes, listener.localisations
    outcomes.clear()
    localisations.clear()
    places = MapStore.open_read_only(nodes.folder.parent / MAP).committed()
    report = nodes.folder / f'{drive.name}.json'
    arguments = [str(drive.bag), '--lockstep', '--report', str(report), *(['--session'] if drive.mapped else [])]
    process = nodes.start('replay_node', arguments, f'replay_{drive.name}')
    with Bag(drive.bag) as bag:
        total = bag.counts[scan_topic(bag)]
    try:
        with bars(f'{"mapping" if drive.mapped else "querying"} {drive.name}') as progress:
            for _ in range(round(REPLAY_TIMEOUT_S / POLL_S)):
                progress(len(outcomes), total)
                if process.process.poll() is not None:
                    break
                threading.Event().wait(POLL_S)
            if process.wait(1.0):
                raise OffradarError(f'replay of {drive.name} failed: {process.last_line()}')
            progress(len(outcomes), total)
    finally:
        process.stop()
    reported = json.loads(report.read_text(encoding='utf-8'))
    counts = {name: value for name, value in reported.items() if isinstance(value, int)}
    latencies_s = tuple(reported['latencies_s'])
    return ReplayedDrive(drive, places, tuple(outcomes), dict(localisations), counts, latencies_s, reported['session'])


class _Listener:
    """A node that keeps every answer and localisation, as a subscriber in a vehicle would receive it."""

    def __init__(self, context: Context) -> None:
        self.node = Node('listener', context=context)
        self.outcomes: list[Outcome] = []
        self.localisations: dict[int, Localisation] = {}
        self._connections = Connections(self.node)
        # A deeper queue than that of the publishers: in lockstep answers may arrive faster than they are taken.
        self.node.create_subscription(PointCloud2, 'matches', self._on_match, qos.UPDATES)
        self.node.create_subscription(DiagnosticArray, 'rejections', self._on_rejection, qos.UPDATES)
        self.node.create_subscription(DiagnosticArray, 'localisation', self._on_localisation, qos.UPDATES)

    def wait_until_connected(self) -> None:
        """Wait until the query node is connected to this node, so that the first answer is received."""
        for _ in range(round(CONNECT_S / POLL_S)):
            if all(self._connections.count(topic) > 0 for topic in REPLIES):
                return
            threading.Event().wait(POLL_S)
        raise OffradarError(f'the query node is not connected to the demonstration after {CONNECT_S:g} s')

    def _on_match(self, message: PointCloud2) -> None:
        self.outcomes.append(match_record(message, 'matches'))

    def _on_rejection(self, message: DiagnosticArray) -> None:
        self.outcomes.append(rejection_record(message, 'rejections'))

    def _on_localisation(self, message: DiagnosticArray) -> None:
        found = localisation_record(message, 'localisation')
        self.localisations[found.stamp_ns] = found


@contextmanager
def _listening(domain_id: int) -> Iterator[_Listener]:
    context = Context()
    initialise([], context=context, domain_id=domain_id)
    listener = _Listener(context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(listener.node)
    spin = SpinThread(executor)
    try:
        yield listener
    finally:
        spin.stop()
        listener.node.destroy_node()
        rclpy.shutdown(context=context)
