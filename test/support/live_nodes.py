"""For tests of nodes: a node that publishes and subscribes, and a replay that is run to its end."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2

from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.lab.live.spin_thread import SpinThread
from offradar_ros.ros import qos
from offradar_ros.ros.connections import UNKNOWN, Connections, Introduction
from offradar_ros.ros.localisation_message import localisation_record
from offradar_ros.ros.outcome_message import match_record, rejection_record
from offradar_ros.ros.stage_node import StageNode
from offradar_ros.types import Localisation, Outcome

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
WAIT_S = 60.0
ROOMY = {
    'encoder.backlog': 1000,
    'qos_overrides./radar_data/b_scan_image.subscription.depth': 100,
    'qos_overrides./embedding.publisher.depth': 100,
    'qos_overrides./embedding.subscription.depth': 100,
}
"""Parameters with which a replay in real time loses no scan, however late a busy machine runs the nodes."""


NodeT = TypeVar('NodeT', bound=StageNode)


class StartNode(Protocol):
    """Starts a node within the test: `start_node(EncoderNode, {'radar.profile': 'cts350x'})`, with the ring key."""

    def __call__(self, kind: Callable[..., NodeT], parameters: dict[str, Any] | None = None) -> NodeT:
        """The node, active unless `autostart` is false."""
        ...


def wait_until(done: Callable[[], Any], timeout_s: float = WAIT_S) -> Any:
    """Poll until `done()` is true and return it; fails the test if that takes longer."""
    deadline_s = time.monotonic() + timeout_s
    while not (found := done()):
        assert time.monotonic() < deadline_s, f'still false after {timeout_s:g} s: {done}'
        time.sleep(0.01)
    return found


class Observer:
    """A node of the test that publishes its messages and keeps what it receives."""

    def __init__(self, domain_id: int) -> None:
        self.context = rclpy.context.Context()
        rclpy.init(context=self.context, domain_id=domain_id)
        self._clients: dict[str, Any] = {}
        self.node = Node('observer', context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._added: list[Node] = []
        self._spin = SpinThread(self._executor)

    def close(self) -> None:
        self._spin.stop()
        # What is left to the garbage collector may still be received by a later test in the same domain.
        for node in (*self._added, self.node):
            node.destroy_node()
        rclpy.shutdown(context=self.context)

    def add(self, node: Node) -> None:
        self._added.append(node)
        self._executor.add_node(node)

    def remove(self, node: Node) -> None:
        """End a node that was added: its topics are gone, as after its process was killed."""
        self._executor.remove_node(node)
        self._added.remove(node)
        node.destroy_node()

    def collect(self, kind: type, topic: str, profile: QoSProfile = qos.RESULTS, *, raw: bool = False) -> list[Any]:
        received: list[Any] = []
        self.node.create_subscription(kind, topic, received.append, profile, raw=raw)
        return received

    def collect_outcomes(self) -> list[Outcome]:
        outcomes: list[Outcome] = []
        self.node.create_subscription(
            PointCloud2, 'matches', lambda m: outcomes.append(match_record(m, 'matches')), qos.UPDATES
        )
        self.node.create_subscription(
            DiagnosticArray, 'rejections', lambda m: outcomes.append(rejection_record(m, 'rejections')), qos.UPDATES
        )
        return outcomes

    def collect_localisations(self) -> list[Localisation]:
        found: list[Localisation] = []
        self.node.create_subscription(
            DiagnosticArray, 'localisation', lambda m: found.append(localisation_record(m, 'localisation')), qos.UPDATES
        )
        return found

    def wait_until_connected(self, **subscribers: int) -> None:
        """Wait until the nodes are connected to one subscriber of their answers, and to these numbers for other topics.

        Before that, their messages are lost, even if this side has discovered them.
        """
        connections = Connections(self.node)
        wanted = {'matches': 1, 'rejections': 1, **subscribers}
        wait_until(lambda: all(connections.count(topic) >= count for topic, count in wanted.items()))

    def publisher(self, kind: type, topic: str, profile: QoSProfile) -> Callable[[Any], None]:
        """A function that publishes; returned when there is a subscriber, and all that are discovered know of it."""
        publisher = self.node.create_publisher(kind, topic, profile)
        wait_until(lambda: publisher.get_subscription_count() > 0)
        known = self.node.get_subscriptions_info_by_topic
        wait_until(lambda: all(each.node_name != UNKNOWN for each in known(publisher.topic_name)))
        for name in {f'{each.node_namespace.rstrip("/")}/{each.node_name}' for each in known(publisher.topic_name)}:
            self.wait_until_known_to(name)
        return publisher.publish

    def wait_until_known_to(self, name: str) -> None:
        """Wait until the node of this name has discovered all publishers, subscriptions and clients of this one."""
        if name == self.node.get_fully_qualified_name():
            return
        introduction = Introduction(self.node, GetParameters, f'{name}/get_parameters')
        wait_until(introduction.is_complete)
        introduction.close()

    def call(self, kind: type, service: str, request: Any, timeout_s: float = WAIT_S) -> Any:
        """The answer of a service of a node; AssertionError if none comes in time."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(kind, service)
            wait_until(self._clients[service].service_is_ready)
            self.wait_until_known_to(self.node.resolve_service_name(service).rpartition('/')[0])
        client = self._clients[service]
        assert client.wait_for_service(WAIT_S), service
        future = client.call_async(request)
        wait_until(future.done, timeout_s)
        return future.result()


def replay(nodes: Stack, bag: Path, *arguments: str, timeout_s: float = 3 * WAIT_S) -> str:
    """Run replay_node to its end and return what it printed; fails the test if it fails."""
    process = nodes.start('replay_node', [str(bag), *arguments], f'replay_{time.monotonic_ns()}')
    try:
        status = process.wait(timeout_s)
        printed = process.log.read_text()
        assert status == 0, printed
        return printed
    finally:
        process.stop()
