"""A map server that is killed at random instants: what it answered to be ended is in its file, whole.

The node is the real one, and its services are called over DDS. Both it and its caller are forked from a process that
has imported everything and started nothing, so that a start takes a fraction of a second.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from faults.acknowledged_sessions import ENDED, INFO, judge, known_embedding
from faults.child_batches import run_in_children
from faults.result import CRASHED, SAME, Result, Settings, Verdict, summed
from offradar_ros.lab.live.node_processes import parameter_arguments
from offradar_ros.messages import stamp_ns
from offradar_ros.nodes.map_server_node import MapServerNode
from offradar_ros.ros import qos
from offradar_ros.ros.embedding_message import embedding_message, model_message
from offradar_ros.ros.run import run as run_node
from offradar_ros.ros.stamps import header

NAME = 'kills'
FULL = 300
DOMAIN_IDS = (93, 94)
SCANS = 4
"""Scans of a session."""
STEP_NS = 1_000_000
APART_M, SIDE = 100.0, 800
"""Each scan is at a place of its own, of a square of so many each way."""
KILLS_A_FILE = 25
READY_S = 30.0
WINDOW_S = 0.25
"""A kill comes within this time of the first answer; a session takes a few hundredths of a second."""
EARLY_SHARE = 0.15
"""Share of kills while the node starts."""


def run(settings: Settings) -> list[Result]:
    """Kill it, and look at the file."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    # Killed processes leave their shared memory behind.
    os.environ['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'
    started_s = time.monotonic()

    def attempt(index: int) -> Verdict:
        lane, number = index % len(DOMAIN_IDS), index // len(DOMAIN_IDS)
        os.environ['ROS_DOMAIN_ID'] = str(DOMAIN_IDS[lane])
        path = settings.folder / f'killed_{lane}_{number // KILLS_A_FILE}.db'
        return kill_once(path, np.random.default_rng([settings.seed, index]))

    verdicts = run_in_children(settings.tries(FULL), attempt, lanes=len(DOMAIN_IDS))
    ended = sum(int(verdict.detail.split()[0]) for verdict in verdicts if verdict.word == SAME)
    result = summed(NAME, 'kills of a map server', verdicts, time.monotonic() - started_s, sessions=ended)
    return [result]


def kill_once(path: Path, rng: np.random.Generator) -> Verdict:
    """One start, one kill, and what the file then holds."""
    acknowledgements = path.with_suffix('.acknowledged')
    known = set(read_acknowledged(acknowledgements))
    log = path.with_suffix('.log')
    server = forked(lambda: serve(path), log)
    caller = forked(lambda: call_for_ever(acknowledgements), log)
    try:
        if rng.random() < EARLY_SHARE:
            time.sleep(float(rng.uniform(0.0, 0.3)))
        else:
            wait_for_first(acknowledgements)
            time.sleep(float(rng.uniform(0.0, WINDOW_S)))
        if os.waitpid(server, os.WNOHANG)[0]:
            return Verdict(CRASHED, f'the map server ended by itself: {log.read_text()[-300:]}')
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(server, signal.SIGKILL)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(server, 0)
        # An answer that was sent before the kill may still be on its way.
        time.sleep(0.02)
        os.kill(caller, signal.SIGKILL)
        os.waitpid(caller, 0)
    acknowledged = read_acknowledged(acknowledgements)
    verdict = judge(path, dict.fromkeys(acknowledged, ENDED))
    return (
        dataclasses.replace(verdict, detail=f'{len(set(acknowledged) - known)} sessions')
        if verdict.word == SAME
        else verdict
    )


def forked(work: Callable[[], object], log: Path) -> int:
    """Process id of a child that does this; its output goes to the end of `log`."""
    pid = os.fork()
    if pid:
        return pid
    try:
        descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.dup2(descriptor, 1)
        os.dup2(descriptor, 2)
        work()
    finally:
        os._exit(0)


def serve(path: Path) -> None:
    """The node, as its executable runs it."""
    values: dict[str, object] = {
        'map.path': path,
        'map.start_session': False,
        'map.autosave_s': 0.02,
        'position.source': 'odometry',
    }
    run_node(MapServerNode, parameter_arguments(values))


def read_acknowledged(path: Path) -> list[int]:
    """Sessions whose end was answered with success, so far."""
    return [int(line) for line in path.read_text().split()] if path.exists() else []


def wait_for_first(path: Path) -> None:
    """Wait until this start's first session was acknowledged."""
    before, deadline_s = len(read_acknowledged(path)), time.monotonic() + READY_S
    while len(read_acknowledged(path)) == before and time.monotonic() < deadline_s:
        time.sleep(0.005)


def call_for_ever(acknowledgements: Path) -> None:
    """Start a session, send scans, end it, and so on; each answered end is written down at once."""
    caller = Caller()
    file = os.open(acknowledgements, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    caller.wait_until_heard()
    while True:
        caller.call('start_session')
        caller.send_scans()
        success, text = caller.call('end_session')
        if success:
            os.write(file, f'{int(text.split()[1].rstrip(":,"))}\n'.encode())


class Caller:
    """Sends scans to the map server and calls its services."""

    def __init__(self) -> None:
        rclpy.init()
        self._node = Node('caller', enable_rosout=False, start_parameter_services=False)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._model = self._node.create_publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)
        self._embeddings = self._node.create_publisher(PointCloud2, 'embedding', qos.RESULTS)
        self._positions = self._node.create_publisher(Odometry, 'ground_truth/odometry', qos.POSITIONS)
        self._handled: set[int] = set()
        self._node.create_subscription(Header, 'map_server/handled', self._on_handled, qos.UPDATES)
        self._clients = {
            name: self._node.create_client(Trigger, f'map_server/{name}')
            for name in ('start_session', 'end_session', 'subscribers')
        }
        self._model.publish(model_message(INFO))
        # A millisecond from scan to scan: fewer are sent in one, so that stamps grow over every start.
        self._stamp = time.time_ns()

    def _on_handled(self, message: Header) -> None:
        self._handled.add(stamp_ns(message.stamp))

    def wait_until_heard(self) -> None:
        """Wait until the server answers, hears every topic, and is heard."""
        while not (
            all(client.service_is_ready() for client in self._clients.values())
            and all(topic.get_subscription_count() for topic in (self._model, self._embeddings, self._positions))
        ):
            self._executor.spin_once(0.005)
        while '"/map_server/handled": 1' not in self.call('subscribers')[1]:
            pass

    def call(self, name: str) -> tuple[bool, str]:
        """Success and message of an answer; it is waited for until the process is killed."""
        future = self._clients[name].call_async(Trigger.Request())
        self._executor.spin_until_future_complete(future)
        return future.result().success, future.result().message

    def send_scans(self) -> None:
        """Scans of new places, each of which the server has taken up."""
        stamps = []
        for k in range(SCANS + 1):
            self._stamp += STEP_NS
            row, column = divmod(self._stamp // STEP_NS % SIDE**2, SIDE)
            pose = Odometry(header=header(self._stamp, 'map'))
            pose.pose.pose.position.x, pose.pose.pose.position.y = APART_M * column, APART_M * row
            pose.pose.pose.orientation.w = 1.0
            self._positions.publish(pose)
            if k < SCANS:
                stamps.append(self._stamp)
        for stamp in stamps:
            self._embeddings.publish(embedding_message(known_embedding(stamp), 'radar'))
            while stamp not in self._handled:
                self._executor.spin_once(0.01)
