"""Which publishers and subscriptions are connected: as this node has discovered it, and as their publishers report it.

Discovery takes two steps, one on each side. A subscriber may know a publisher that does not know it yet, and what is
published until then is lost. Only the publisher's node knows when it is connected, so each of our nodes answers the
service ``~/subscribers``. Only a process that must not lose a message calls it: a replay in lockstep, a test.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from typing import Any

from rclpy.client import Client
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.task import Future
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_srvs.srv import Trigger

from offradar_ros.bounded_input import parse_json

SUBSCRIBERS = 'subscribers'
ASK_S = 0.05
"""Time between two calls to one node."""
LOST_S = 1.0
"""A call without an answer after this time is repeated: it was made before discovery was complete."""
MAX_ANSWER_BYTES = 2**16
UNKNOWN = '_NODE_NAME_UNKNOWN_'
"""The name in the graph of a node of which only the topics are known so far."""


def serve_subscribers(node: Node, outputs: Sequence[Publisher]) -> None:
    """Let `node` answer ``~/subscribers``: as JSON, the number of subscriptions that each output is connected to."""

    def answer(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        response.message = json.dumps({output.topic_name: output.get_subscription_count() for output in outputs})
        return response

    node.create_service(Trigger, f'~/{SUBSCRIBERS}', answer)


def count_reachable(node: Node, topic: str, offer: TopicEndpointInfo) -> int:
    """How many subscriptions of the resolved name `topic` the publisher `offer` can reach.

    Subscriptions of another type or with an incompatible quality of service are never connected to it. `offer` must
    come from the graph: the profile that a publisher was created with has no deadline and lease, and fits none.
    """
    return sum(
        subscription.topic_type == offer.topic_type
        and qos_check_compatible(offer.qos_profile, subscription.qos_profile)[0] != QoSCompatibility.ERROR
        for subscription in node.get_subscriptions_info_by_topic(topic)
    )


class Introduction:
    """Whether another node has discovered all publishers, subscriptions and clients that `node` has made so far.

    What is published, or answered, before that is lost. A node's parts are announced in the order in which they were
    made: one that answers the client that is made here has discovered those before.

    Args:
        node: this node, which an executor spins.
        kind: type of `service`, whose request has a default.
        service: a service of the other node that changes nothing.
    """

    def __init__(self, node: Node, kind: type[Any], service: str) -> None:
        self._node, self._kind = node, kind
        self._client = node.create_client(kind, service)
        self._call: Future | None = None
        self._asked_s = 0.0

    def is_complete(self) -> bool:
        """Asks again at need; repeat it until it is true."""
        now_s = time.monotonic()
        if self._call is not None and self._call.done():
            return True
        if self._client.service_is_ready() and (self._call is None or now_s - self._asked_s >= LOST_S):
            if self._call is not None:
                self._client.remove_pending_request(self._call)
            self._call, self._asked_s = self._client.call_async(self._kind.Request()), now_s
        return False

    def close(self) -> None:
        """Release the client."""
        self._node.destroy_client(self._client)


class Connections:
    """How many subscriptions the publishers of a topic are connected to, as their nodes report it.

    No method waits: each one calls the nodes again, and returns their answers to earlier calls. Repeat it until the
    result is as expected, while an executor spins `node`.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._clients: dict[str, Client] = {}
        self._calls: dict[str, Future] = {}
        self._asked_s: dict[str, float] = {}
        self._counts: dict[str, dict[str, int]] = {}

    def count(self, topic: str) -> int:
        """The highest number that a publisher of the topic reports; 0 while none has answered."""
        name = self._node.resolve_topic_name(topic)
        return max((self._reported(offer, name) or 0 for offer in self._offers(name)), default=0)

    def is_complete(self, topic: str) -> bool:
        """Whether a publisher of the topic is connected to every subscription that it can reach."""
        name = self._node.resolve_topic_name(topic)
        return any(
            self._reported(offer, name) == count_reachable(self._node, name, offer) for offer in self._offers(name)
        )

    def _offers(self, name: str) -> list[TopicEndpointInfo]:
        offers: list[TopicEndpointInfo] = self._node.get_publishers_info_by_topic(name)
        return [offer for offer in offers if offer.node_name != UNKNOWN]

    def _reported(self, offer: TopicEndpointInfo, name: str) -> int | None:
        server = f'{offer.node_namespace.rstrip("/")}/{offer.node_name}'
        self._ask(server)
        return self._counts.get(server, {}).get(name)

    def _ask(self, server: str) -> None:
        if server not in self._clients:
            self._clients[server] = self._node.create_client(Trigger, f'{server}/{SUBSCRIBERS}')
        client, now_s = self._clients[server], time.monotonic()
        asked_s, call = self._asked_s.get(server, -LOST_S), self._calls.get(server)
        if call is not None and call.done():
            counts = _counts_in(call.result())
            if counts is not None:
                self._counts[server] = counts
        elif call is not None and now_s - asked_s >= LOST_S:
            client.remove_pending_request(call)
        elif call is not None:
            return
        self._calls.pop(server, None)
        if now_s - asked_s >= ASK_S and client.service_is_ready():
            self._asked_s[server] = now_s
            self._calls[server] = client.call_async(Trigger.Request())


def _counts_in(answer: Trigger.Response | None) -> dict[str, int] | None:
    """The counts by topic in an answer of ``~/subscribers``; None where a service of this name answers something else.

    The service may be of another package, and fail.
    """
    try:
        counts = parse_json(answer.message, MAX_ANSWER_BYTES) if answer is not None else None
    except ValueError:
        return None
    valid = isinstance(counts, dict) and all(type(count) is int and count >= 0 for count in counts.values())
    return counts if valid else None
