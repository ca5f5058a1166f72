"""A program that drives a map server: sessions of scans, each at a place of its own."""

from __future__ import annotations

import time

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from faults.acknowledged_sessions import INFO, known_embedding
from offradar_ros.messages import stamp_ns
from offradar_ros.ros import qos
from offradar_ros.ros.embedding_message import embedding_message, model_message
from offradar_ros.ros.stamps import header

SCANS = 4
"""Scans of a session."""
STEP_NS = 1_000_000
APART_M, SIDE = 20.0, 800
"""Each scan is at a place of its own, of a square of so many each way, on a path without jumps."""
FIRST_ANSWER_S, ANSWER_S = 0.3, 40.0
PARAMETERS: dict[str, object] = {'map.start_session': False, 'position.source': 'odometry'}
"""What a map server needs to be driven by it."""


def session_of(answer: str) -> int:
    """The id of the session that an answer of the map server is about."""
    return int(answer.split()[1].rstrip(':,'))


class MapCaller:
    """Sends `known_embedding`s to a map server in a domain and calls its services."""

    def __init__(self, domain_id: int) -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self._node = Node('caller', context=self._context, enable_rosout=False, start_parameter_services=False)
        self._executor = SingleThreadedExecutor(context=self._context)
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

    def close(self) -> None:
        """Leave the domain."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def _on_handled(self, message: Header) -> None:
        self._handled.add(stamp_ns(message.stamp))

    def wait_until_heard(self) -> None:
        """Wait until the server answers each service, hears every topic, and is heard. An empty session runs then."""
        while not all(topic.get_subscription_count() for topic in (self._model, self._embeddings, self._positions)):
            self._executor.spin_once(0.005)
        # The first answers may be lost: the server has not discovered this client yet. So each call may be repeated.
        for name, awaited in (('subscribers', '"/map_server/handled": 1'), ('end_session', ''), ('start_session', '')):
            while (answer := self._answered(name, FIRST_ANSWER_S)) is None or awaited not in answer[1]:
                pass

    def call(self, name: str) -> tuple[bool, str]:
        """Success and message of an answer; TimeoutError if there is none for long."""
        answer = self._answered(name, ANSWER_S)
        if answer is None:
            raise TimeoutError(f'{name}: no answer within {ANSWER_S:g} s')
        return answer

    def _answered(self, name: str, timeout_s: float) -> tuple[bool, str] | None:
        future = self._clients[name].call_async(Trigger.Request())
        self._executor.spin_until_future_complete(future, timeout_s)
        if not future.done():
            self._clients[name].remove_pending_request(future)
            return None
        return future.result().success, future.result().message

    def send_scans(self) -> None:
        """Scans of new places, each of which the server has taken up."""
        stamps = []
        for k in range(SCANS + 1):
            self._stamp += STEP_NS
            row, column = divmod(self._stamp // STEP_NS % SIDE**2, SIDE)
            column = SIDE - 1 - column if row % 2 else column
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
