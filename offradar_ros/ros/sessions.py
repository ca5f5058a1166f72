"""The map server's session services, for a process that drives a replay."""

from __future__ import annotations

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from offradar_ros.errors import OffradarError

COMMIT_S = 60.0
"""Longest wait for an answer: a session may have changed a million places."""


class SessionClient:
    """Calls the services of the node `map_server` and returns what they say; OffradarError if they refuse."""

    def __init__(self, node: Node, timeout_s: float) -> None:
        self._node = node
        self._timeout_s = timeout_s

    def start(self) -> str:
        """Start a session."""
        return self.call('start_session')

    def end(self) -> str:
        """End the session and return its merge report."""
        return self.call('end_session')

    def call(self, name: str) -> str:
        """Any of the services, by name."""
        client = self._node.create_client(Trigger, f'map_server/{name}')
        try:
            if not client.wait_for_service(self._timeout_s):
                raise OffradarError(f'service map_server/{name}: no map server within {self._timeout_s:g} s')
            future = client.call_async(Trigger.Request())
            executor = SingleThreadedExecutor(context=self._node.context)
            rclpy.spin_until_future_complete(self._node, future, executor, timeout_sec=max(self._timeout_s, COMMIT_S))
            response = future.result()
            if response is None:
                raise OffradarError(f'service map_server/{name}: no answer within {max(self._timeout_s, COMMIT_S):g} s')
            if not response.success:
                raise OffradarError(f'service map_server/{name}: {response.message}')
            return str(response.message)
        finally:
            self._node.destroy_client(client)
