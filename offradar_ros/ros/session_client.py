"""The map server's session services, for a process that drives a replay."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from offradar_ros.errors import OffradarError
from offradar_ros.ros.connections import SUBSCRIBERS, Introduction

COMMIT_S = 60.0
"""Longest wait for an answer: a session may have changed a million places."""
PATIENCE_S = 2.0
"""A wait longer than this is reported."""
INTRODUCED_S = 5.0
"""A map server that has not discovered its caller after this time is called all the same."""
POLL_S = 0.1


class SessionClient:
    """Calls the services of the node `map_server` and returns their answers; OffradarError if they report a failure.

    Args:
        node: the node whose context and namespace are used.
        timeout_s: longest wait for the map server.
        report: called with one line when a wait takes long; by default the node logs it.
        check: called about ten times a second during a wait, which it may end by raising.

    Attributes:
        waiting_for: what it waits for, as text.
    """

    def __init__(
        self,
        node: Node,
        timeout_s: float,
        report: Callable[[str], None] | None = None,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        self._node = node
        self._timeout_s = timeout_s
        self._report = report or (lambda text: node.get_logger().info(text))
        self._check = check
        self.waiting_for = ''

    def start(self) -> str:
        """Start a session."""
        return self.call('start_session')

    def end(self) -> str:
        """End the session and return its merge report."""
        return self.call('end_session')

    def call(self, name: str) -> str:
        """Any of the services, by name."""
        client = self._node.create_client(Trigger, f'map_server/{name}')
        introduction = Introduction(self._node, Trigger, f'map_server/{SUBSCRIBERS}')
        answer_s = max(self._timeout_s, COMMIT_S)
        try:
            self.waiting_for = f'the service {client.service_name}'
            hint = f'gives up after {self._timeout_s:g} s; is map_server_node running, in this domain and namespace?'
            if not self._wait(client.service_is_ready, self._timeout_s, hint):
                where = self._elsewhere(client.service_name)
                raise OffradarError(f'service map_server/{name}: no map server within {self._timeout_s:g} s{where}')
            # An answer to a client that the server has not discovered yet is lost, and the call may be carried out.
            hint = 'it has not discovered its caller yet'
            self._wait(introduction.is_complete, min(self._timeout_s, INTRODUCED_S), hint)
            future = client.call_async(Trigger.Request())
            self.waiting_for = f'the answer of {client.service_name}, which may be carried out all the same'
            if not self._wait(future.done, answer_s, f'gives up after {answer_s:g} s'):
                raise OffradarError(f'service map_server/{name}: no answer within {answer_s:g} s')
            response = future.result()
            if not response.success:
                raise OffradarError(f'service map_server/{name}: {response.message}')
            return str(response.message)
        finally:
            introduction.close()
            self._node.destroy_client(client)

    def _elsewhere(self, wanted: str) -> str:
        """Map servers of other namespaces than that of the service `wanted`, and how to reach them."""
        ending = f'/map_server/{wanted.rpartition("/")[2]}'
        services = [service for service, _ in self._node.get_service_names_and_types()]
        # A service that is only asked for is among them.
        found = sorted(each.removesuffix(ending) for each in services if each.endswith(ending) and each != wanted)
        if not found:
            return ''
        return (
            f': there is one in {", ".join(namespace or "/" for namespace in found)}: name the namespace '
            '(offradar session --namespace, or --ros-args -r __ns:= of replay_node)'
        )

    def _wait(self, done: Callable[[], bool], timeout_s: float, hint: str) -> bool:
        executor = SingleThreadedExecutor(context=self._node.context)
        executor.add_node(self._node)
        started_s, reported = time.monotonic(), False
        try:
            while not done():
                self._check()
                if not self._node.context.ok():
                    raise ExternalShutdownException
                waited_s = time.monotonic() - started_s
                if waited_s >= timeout_s:
                    return False
                if waited_s >= PATIENCE_S and not reported:
                    reported = True
                    self._report(f'waiting for {self.waiting_for} ({hint})')
                executor.spin_once(timeout_sec=min(POLL_S, timeout_s - waited_s))
            return True
        finally:
            executor.remove_node(self._node)
            executor.shutdown()
