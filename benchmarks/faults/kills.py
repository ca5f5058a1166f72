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

from faults.acknowledged_sessions import ENDED, judge
from faults.child_batches import run_in_children
from faults.free_domains import free_domains
from faults.map_caller import PARAMETERS, MapCaller, session_of
from faults.result import CRASHED, SAME, Result, Settings, Verdict, summed
from offradar_ros.lab.live.node_processes import parameter_arguments
from offradar_ros.nodes.map_server_node import MapServerNode
from offradar_ros.ros.run import run as run_node

NAME = 'kills'
FULL = 300
LANES = 2
KILLS_A_FILE = 25
READY_S = 30.0
WINDOW_S = 0.25
"""A kill comes within this time of the first answer; a session takes a few hundredths of a second."""
EARLY_SHARE = 0.15
"""Share of kills while the node starts."""


def run(settings: Settings) -> list[Result]:
    """Kill it, and look at the file."""
    started_s = time.monotonic()
    with free_domains(LANES) as domain_ids:

        def attempt(index: int) -> Verdict:
            lane, number = index % LANES, index // LANES
            # Killed processes leave their shared memory behind: none is used.
            os.environ |= {
                'ROS_DOMAIN_ID': str(domain_ids[lane]),
                'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
                'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4',
            }
            path = settings.folder / f'killed_{lane}_{number // KILLS_A_FILE}.db'
            return kill_once(path, np.random.default_rng([settings.seed, index]))

        verdicts = run_in_children(settings.tries(FULL), attempt, lanes=LANES)
    ended = sum(int(verdict.detail.split()[0]) for verdict in verdicts if verdict.word == SAME)
    return [summed(NAME, 'kills of a map server', verdicts, time.monotonic() - started_s, sessions=ended)]


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
        **PARAMETERS,
        'map.path': path,
        'map.autosave_s': 0.02,
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
    caller = MapCaller(int(os.environ['ROS_DOMAIN_ID']))
    file = os.open(acknowledgements, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    caller.wait_until_heard()
    while True:
        caller.call('start_session')
        caller.send_scans()
        success, text = caller.call('end_session')
        if success:
            os.write(file, f'{session_of(text)}\n'.encode())
