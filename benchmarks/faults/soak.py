"""The three nodes at many times real time, with bursts: every scan is answered or counted, and memory does not grow."""

from __future__ import annotations

import dataclasses
import time
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from live_scans import Recording, read_recording
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from scipy.stats import theilslopes
from sensor_msgs.msg import Image, NavSatFix, PointCloud2
from std_srvs.srv import Trigger

from faults.flipped_files import PROJECT
from faults.free_domains import free_domains
from faults.result import Result, Settings
from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.lab.live.spin_thread import SpinThread
from offradar_ros.messages import header_stamp_ns, stamp_ns, with_header_stamp
from offradar_ros.nodes.encoder_node import SCANS
from offradar_ros.recordings.bags.topics import FIX
from offradar_ros.ros import qos
from offradar_ros.ros.lost_messages import LostMessages

NAME = 'soak'
PACE_HZ = 40.0
"""Ten times a radar that turns four times a second."""
BURST_HZ = 300.0
CYCLE_S, BURST_S = 4.0, 1.0
SESSION_S = 10.0
WARM_UP_SHARE = 1 / 3
"""Share of the time before memory is expected to stay as it is."""
GROWTH_MB_PER_MIN = 1.0
"""A slope of a node's memory above this, and a rise above `RISE_MB`, is a leak."""
RISE_MB = 3.0
SHORTEST_S = 45.0
"""In less time than this, the memory of a process that has just started says nothing."""
COUNTED = {
    'encoder': ('scans.lost_before_arrival', 'scans.overtaken', 'scans.inactive'),
    'query': ('embeddings.lost_before_arrival',),
}
"""By node, what it reports of scans that nobody answers."""
PARAMETERS: Mapping[str, object] = {
    'encoder.threads': 1,
    'map.match_distance_m': 1.0,
    'map.start_session': False,
    # The radar's own receiver of the answers must not be what loses them.
    'qos_overrides./matches.publisher.depth': 1000,
    'qos_overrides./rejections.publisher.depth': 1000,
}


def run(settings: Settings) -> list[Result]:
    """Drive the nodes."""
    seconds = settings.soak_s * min(settings.scale, 1.0)
    recording = read_recording(PROJECT / 'bags' / 'session_1')
    parameters = {**PARAMETERS, 'map.path': settings.folder / 'soak.db'}
    started_s = time.monotonic()
    with free_domains(1) as (domain_id,), Stack(settings.folder / 'logs', domain_id, parameters) as nodes:
        nodes.wait_until_ready()
        with Radar(recording, domain_id) as radar:
            radar.connect()
            memory = drive(nodes, radar, seconds)
            radar.settle()
    accounts = radar.accounts
    tally = accounts.tally()
    ended = {name: node.process.returncode for name, node in nodes.nodes.items()}
    examples = [f'{name}: exit status {status}' for name, status in ended.items() if status]
    examples += [
        f'{name}: a traceback in its log' for name, node in nodes.nodes.items() if 'Traceback' in node.log.read_text()
    ]
    crashes = len(examples)
    for name, samples in memory.items():
        slope, rise = growth(samples)
        if seconds >= SHORTEST_S and slope > GROWTH_MB_PER_MIN and rise > RISE_MB:
            examples.append(f'{name}: memory grows by {slope:.2f} MB a minute')
    growing = len(examples) - crashes
    if tally.lost or tally.overcounted:
        examples.append(f'scans: {tally}; {accounts}')
    figures = {'sent': tally.sent, 'counted': tally.counted, 'unheard': tally.unheard, 'sessions': radar.sessions} | {
        f'{name} MB/min': round(growth(samples)[0], 3) for name, samples in memory.items()
    }
    return [
        Result(
            NAME,
            f'{seconds:.0f} s at {PACE_HZ:g} to {BURST_HZ:g} scans a second',
            tally.sent,
            refused=tally.counted,
            same=tally.answered,
            differences=tally.twice + tally.overcounted + growing,
            crashes=crashes,
            losses=tally.lost,
            seconds=time.monotonic() - started_s,
            figures=figures,
            examples=tuple(examples),
        )
    ]


@dataclasses.dataclass(frozen=True)
class Tally:
    """What became of the scans.

    `counted` is what the nodes' diagnostics say was not answered; `unheard` are answers that were sent, by the numbers
    of those after them, and lost on their way to this process.
    """

    sent: int
    answered: int
    twice: int
    counted: int
    unheard: int = 0

    @property
    def lost(self) -> int:
        """Scans that are neither answered nor counted."""
        return max(0, self._missing)

    @property
    def overcounted(self) -> int:
        """Scans that were counted twice, or counted and answered."""
        return max(0, -self._missing)

    @property
    def _missing(self) -> int:
        return self.sent - self.answered - self.counted - self.unheard


class Accounts:
    """The scans that were sent, the stamps of their answers, and what the nodes report of them.

    Attributes:
        sent: stamps in ns, each later than the one before.
        unheard: answers that were lost on their way here.
    """

    def __init__(self) -> None:
        self.sent: list[int] = []
        self.unheard = 0
        self._answers: Counter[int] = Counter()
        self._answered_ns = 0
        self._reports: dict[str, dict[str, str]] = {}
        self._reported_ns: dict[str, int] = {}
        self._counted_before = self._unheard_before = 0

    def answer(self, stamp_ns: int, received_ns: int) -> None:
        """The answer to a scan came at this time."""
        self._answers[stamp_ns] += 1
        self._answered_ns = received_ns

    def report(self, node: str, values: Mapping[str, str], stamp_ns: int) -> None:
        """The diagnostics of a node."""
        self._reports[node], self._reported_ns[node] = dict(values), stamp_ns

    @property
    def answered(self) -> int:
        """Number of scans that were answered."""
        return len(self._answers)

    @property
    def are_complete(self) -> bool:
        """Whether every scan up to now has been answered or counted, and the counts are here.

        The newest scan goes first and is never overtaken: its answer shows that those before it have ended.
        """
        newest_is_answered = bool(self.sent) and self.sent[-1] in self._answers
        return newest_is_answered and all(self._reported_ns.get(node, 0) > self._answered_ns for node in COUNTED)

    def begin(self) -> None:
        """Count from now on: scans before the nodes had found one another are in no count. Only when `are_complete`."""
        self.sent = [stamp for stamp in self.sent if stamp in self._answers]
        self._counted_before, self._unheard_before = self._counted(), self.unheard

    def tally(self) -> Tally:
        """What has become of the scans since `begin`, by the last reports."""
        answered = sum(stamp in self._answers for stamp in self.sent)
        twice = sum(self._answers[stamp] > 1 for stamp in self.sent)
        counted, unheard = self._counted() - self._counted_before, self.unheard - self._unheard_before
        return Tally(len(self.sent), answered, twice, counted, unheard)

    def __str__(self) -> str:
        """What the nodes say that became of their scans and embeddings, to find a loss by."""
        kept = {
            node: {key: value for key, value in values.items() if key.startswith(('scans.', 'embeddings.'))}
            for node, values in self._reports.items()
        }
        received = {'answers': self._answers.total(), 'of other stamps': len(set(self._answers) - set(self.sent))}
        return f'{kept | {"radar": received}}'

    def _counted(self) -> int:
        return sum(int(self._reports.get(node, {}).get(key, 0)) for node, keys in COUNTED.items() for key in keys)


def growth(samples: list[tuple[float, float]]) -> tuple[float, float]:
    """Robust slope in MB a minute, and rise in MB, of (seconds, MB) after the warm-up.

    Of the most in each session: within one, the map server's memory rises with what it keeps until the end, and falls.
    """
    most: dict[int, float] = {}
    for seconds, megabytes in samples[int(len(samples) * WARM_UP_SHARE) :]:
        session = int(seconds // SESSION_S)
        most[session] = max(most.get(session, megabytes), megabytes)
    if len(most) < 3:
        return 0.0, 0.0
    peaks, minutes = np.array(list(most.values())), np.array(list(most)) * SESSION_S / 60.0
    quarter = max(1, len(peaks) // 4)
    rise = float(np.median(peaks[-quarter:]) - np.median(peaks[:quarter]))
    return float(theilslopes(peaks, minutes)[0]), rise


def drive(nodes: Stack, radar: Radar, seconds: float) -> dict[str, list[tuple[float, float]]]:
    """Send scans for that long, with a burst in each cycle and a new session now and then; memory once a second."""
    memory: dict[str, list[tuple[float, float]]] = {name: [] for name in nodes.nodes}
    started_s = sampled_s = session_s = time.monotonic()
    while (elapsed_s := time.monotonic() - started_s) < seconds:
        rate_hz = BURST_HZ if elapsed_s % CYCLE_S > CYCLE_S - BURST_S else PACE_HZ
        sent_s = time.monotonic()
        radar.send()
        if sent_s - sampled_s >= 1.0:
            sampled_s = sent_s
            for name, usage in nodes.usage().items():
                memory[name].append((elapsed_s, usage.resident_bytes / 1e6))
        if sent_s - session_s >= SESSION_S:
            session_s = sent_s
            radar.next_session()
        time.sleep(max(0.0, sent_s + 1.0 / rate_hz - time.monotonic()))
    return memory


class Radar:
    """Publishes scans and positions, and keeps account of the answers."""

    def __init__(self, recording: Recording, domain_id: int) -> None:
        self._recording = recording
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self._node = Node('soak_radar', context=self._context)
        self._scans = self._node.create_publisher(Image, SCANS, qos.SCANS)
        self._fixes = self._node.create_publisher(NavSatFix, FIX.lstrip('/'), qos.POSITIONS)
        self.accounts = Accounts()
        for kind, topic in ((PointCloud2, 'matches'), (DiagnosticArray, 'rejections')):
            gaps = LostMessages(partial(self._node.count_publishers, topic))
            self._node.create_subscription(kind, topic, partial(self._on_answer, gaps), qos.UPDATES, raw=True)
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.RESULTS)
        self._clients = {
            name: self._node.create_client(Trigger, f'map_server/{name}') for name in ('start_session', 'end_session')
        }
        executor = SingleThreadedExecutor(context=self._context)
        executor.add_node(self._node)
        self._spin = SpinThread(executor)
        self.sessions = 0

    def __enter__(self) -> Radar:
        return self

    def __exit__(self, *_: object) -> None:
        self._spin.stop()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def connect(self) -> None:
        """Send scans until they are answered: from then on every node counts what it does not receive."""
        self._call('start_session')
        deadline_s = time.monotonic() + 60.0
        while self.accounts.answered < 8 or not self._await(lambda: self.accounts.are_complete, 5.0):
            if time.monotonic() > deadline_s:
                raise SystemExit('error: scans were not answered, or not reported on, within 60 s')
            self.send()
            time.sleep(0.2)
        self.accounts.begin()

    def send(self) -> None:
        """One scan with its position, stamped now; each stamp is later than the one before."""
        index = len(self.accounts.sent) % len(self._recording.scans)
        stamp_ns = time.time_ns()
        self._scans.publish(with_header_stamp(self._recording.scans[index], stamp_ns))
        self._fixes.publish(with_header_stamp(self._recording.fixes[index], stamp_ns))
        self.accounts.sent.append(stamp_ns)

    def next_session(self) -> None:
        """End the session and start another."""
        self._call('end_session')
        self._call('start_session')
        self.sessions += 1

    def settle(self) -> None:
        """A few scans at rest, after which every gap before them has been seen, and time for the last report."""
        for _ in range(8):
            self.send()
            time.sleep(0.25)
        self._await(lambda: self.accounts.are_complete and not self.accounts.tally().lost)

    def _await(self, done: Callable[[], bool], timeout_s: float = 10.0) -> bool:
        deadline_s = time.monotonic() + timeout_s
        while not (ended := done()) and time.monotonic() < deadline_s:
            time.sleep(0.1)
        return ended

    def _call(self, name: str) -> str:
        client = self._clients[name]
        if not client.wait_for_service(30.0):
            raise SystemExit(f'error: no service {name}')
        future = client.call_async(Trigger.Request())
        if not self._await(future.done, 60.0) or not future.result().success:
            raise SystemExit(f'error: {name}: {future.result().message if future.done() else "no answer in 60 s"}')
        return str(future.result().message)

    def _on_answer(self, gaps: LostMessages, cdr: bytes, info: Mapping[str, Any]) -> None:
        self.accounts.unheard += gaps.arrived(info)
        self.accounts.answer(header_stamp_ns(cdr), time.time_ns())

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            self.accounts.report(status.name.partition(':')[0], values, stamp_ns(message.header.stamp))
