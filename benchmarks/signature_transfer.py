"""What signatures by messages cost: bytes, time and memory of a query node that starts beside a map server.

README.md explains each figure.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import itertools
import json
import statistics
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import rclpy
from faults.free_domains import free_domains
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from measuring import ROOT, rounded, single_threaded, write_results
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sample_signatures import packed_turns
from scan_sources import REAL, announce_machine, scan_sources
from sensor_msgs.msg import PointCloud2
from signatures import PLACES, SCANS, SEED, embedding, write_map
from synthetic_maps import synthetic_table

from offradar_ros.alignment.signature import SignatureMaker
from offradar_ros.lab.live.node_processes import NodeProcess, Stack, parameter_arguments
from offradar_ros.lab.live.spin_thread import SpinThread
from offradar_ros.ros import qos
from offradar_ros.ros.connections import Connections
from offradar_ros.ros.embedding_message import embedding_message
from offradar_ros.ros.outcome_message import match_record

RATE_HZ = 4.0
WAIT_S = 120.0
SETTLED_S = 3.0
"""After this time without an answer, no more are expected."""
SERVER = {'map.start_session': False}
QUERY = {'query.gate': 'paper', 'query.delta': 100.0, 'autostart': False}
"""Each scan is answered with a match."""


@dataclasses.dataclass
class Seen:
    """What passed between the nodes: times of `time.monotonic` in seconds, and bytes."""

    map_s: float = 0.0
    aligned_s: float = 0.0
    answers_s: list[float] = dataclasses.field(default_factory=list)
    answered_bytes: int = 0
    questions: int = 0
    asked_bytes: int = 0
    unaligned: int = 0
    map_bytes: int = 0

    def on_map(self, cdr: bytes) -> None:
        """The map."""
        self.map_s, self.map_bytes = time.monotonic(), len(cdr)

    def on_question(self, cdr: bytes) -> None:
        """A question of the query node."""
        self.questions += 1
        self.asked_bytes += len(cdr)

    def on_answer(self, cdr: bytes) -> None:
        """An answer of the map server."""
        self.answers_s.append(time.monotonic())
        self.answered_bytes += len(cdr)

    def on_match(self, message: PointCloud2) -> None:
        """An answer of the query node to a scan."""
        if self.aligned_s:
            return
        if match_record(message, 'matches').candidates[0].alignment is not None:
            self.aligned_s = time.monotonic()
        else:
            self.unaligned += 1


def main() -> None:
    """Measure, print, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--real', type=Path, default=REAL, metavar='FOLDER', help=f'recorded scans (default {REAL})')
    parser.add_argument('--runs', type=int, default=5)
    parser.add_argument('--out', type=Path, default=ROOT / 'benchmarks' / 'results' / 'signature_transfer.json')
    arguments = parser.parse_args()
    announce_machine()
    made: list[Any] = []
    for name, scans in scan_sources(arguments.real, SCANS):
        if not name.startswith('simulated'):
            made += map(SignatureMaker(), scans)
    with tempfile.TemporaryDirectory() as name, free_domains(1) as (domain_id,):
        folder, maps = Path(name), dict[str, list[dict[str, float]]]()
        turns = packed_turns(made, PLACES)
        for kind, signatures in (('with', turns), ('without', [b''] * PLACES)):
            write_map(folder / f'{kind}.db', iter(signatures))
            run = functools.partial(transferred, folder / f'{kind}.db', turns[-1], folder / 'logs', domain_id)
            maps[kind] = [run() for _ in range(arguments.runs)]
            print(f'{kind}: {json.dumps(median_of(maps[kind]), indent=1)}', flush=True)
    results = {'places': PLACES, 'runs': arguments.runs, **{kind: median_of(runs) for kind, runs in maps.items()}}
    write_results(arguments.out, results, {'means': SEED})


def median_of(runs: Iterable[dict[str, float]]) -> dict[str, float]:
    """The median of each figure over the runs."""
    every = list(runs)
    return {name: rounded(statistics.median(run[name] for run in every)) for name in every[0]}


def transferred(path: Path, signature: bytes, logs: Path, domain_id: int) -> dict[str, float]:
    """Figures of a query node that starts beside a map server with this map, while scans at its last place come."""
    seen, context = Seen(), Context()
    rclpy.init(context=context, domain_id=domain_id)
    node = Node('signature_transfer', context=context)
    for topic, profile, receive in (
        ('map/descriptors', qos.LATCHED, seen.on_map),
        ('map/signatures_wanted', qos.UPDATES, seen.on_question),
        ('map/signatures', qos.UPDATES, seen.on_answer),
    ):
        node.create_subscription(PointCloud2, topic, receive, profile, raw=True)
    node.create_subscription(PointCloud2, 'matches', seen.on_match, qos.UPDATES)
    embed = node.create_publisher(PointCloud2, 'embedding', qos.RESULTS)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    spin = SpinThread(executor)
    mean = synthetic_table(PLACES, SEED).means[-1]
    try:
        with Stack(logs, domain_id, SERVER | {'map.path': path}, names=('map_server_node',)) as nodes:
            nodes.wait_until_ready()
            wait_until(lambda: seen.map_bytes)
            query = nodes.start('query_node', parameter_arguments(QUERY))
            try:
                activate(node)
                loaded_s = wait_until(functools.partial(loaded, query))
                for number in itertools.count(PLACES + 1):
                    embed.publish(embedding_message(embedding(number, 1.0, mean, signature), 'radar'))
                    time.sleep(1.0 / RATE_HZ)
                    last_s = max([loaded_s, *seen.answers_s])
                    if time.monotonic() - last_s > SETTLED_S:
                        break
                return {
                    'map_bytes': seen.map_bytes,
                    'questions': seen.questions,
                    'asked_bytes': seen.asked_bytes,
                    'answered_bytes': seen.answered_bytes,
                    'answers': len(seen.answers_s),
                    'seconds': last_s - loaded_s,
                    'aligned_after_s': max(seen.aligned_s - loaded_s, 0.0),
                    'unaligned_before': seen.unaligned,
                    'query_bytes': query.usage().resident_bytes,
                    'query_peak_bytes': query.usage().peak_bytes,
                }
            finally:
                query.stop()
    finally:
        spin.stop()
        rclpy.shutdown(context=context)


def activate(node: Node) -> None:
    """Activate the query node once it and this node have discovered each other: nothing is missed then."""
    connections = Connections(node)
    topics = ('matches', 'map/signatures_wanted', 'map/signatures')
    wait_until(lambda: all(connections.count(topic) for topic in topics))
    client = node.create_client(ChangeState, 'query/change_state')
    wait_until(client.service_is_ready)
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        wait_until(client.call_async(ChangeState.Request(transition=Transition(id=transition))).done)


def loaded(query: NodeProcess) -> float:
    """The time, once the node has logged that it has the map; 0 before."""
    return time.monotonic() if f'map of {PLACES} places' in query.log.read_text(encoding='utf-8') else 0.0


def wait_until(done: Callable[[], float]) -> float:
    """What `done` returns, once that is not 0; SystemExit if it takes too long."""
    deadline_s = time.monotonic() + WAIT_S
    while not (found := done()):
        if time.monotonic() > deadline_s:
            raise SystemExit(f'error: still waiting after {WAIT_S:g} s: {done}')
        time.sleep(0.002)
    return found


if __name__ == '__main__':
    single_threaded()
    main()
