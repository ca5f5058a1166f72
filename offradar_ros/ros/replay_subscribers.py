"""Subscribers of the topics that a replay publishes."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping

from rclpy.node import Node
from rclpy.publisher import Publisher

from offradar_ros.recordings.bags.topics import FIX_TYPE, ODOMETRY_TYPE
from offradar_ros.ros.connections import count_reachable

ANNOUNCED_S = 6.5
"""Nodes announce themselves every three seconds: after this time, one that was lost twice has come.

The first one of a new node often is, so that another process is found up to three seconds later.
"""
UNCHANGED_S = 1.0
"""After this time without a new node or subscription, all are taken to be known."""


class ReplaySubscribers:
    """The subscriptions of the topics that a bag is played on, as far as this node has discovered them.

    Args:
        node: the node that plays.
        publishers: publishers by the names of their topics in the bag.
        msgtypes: types of these topics, as ``package/msg/Name``.
        scan_topic: the topic of the scans.
    """

    def __init__(
        self, node: Node, publishers: Mapping[str, Publisher], msgtypes: Mapping[str, str], scan_topic: str
    ) -> None:
        self._node, self._publishers, self._msgtypes = node, publishers, msgtypes
        self._scan_topic = scan_topic
        self._known: list[object] = []
        self._started_s = self._changed_s = time.monotonic()

    def is_discovered(self) -> bool:
        """Whether every subscriber is known by now; true at once if our nodes read every topic of the bag."""
        others = [topic for topic in self._publishers if topic != self._scan_topic]
        if all(self._msgtypes[topic] in (FIX_TYPE, ODOMETRY_TYPE) for topic in others):
            return True
        counts = [self._node.count_subscribers(publisher.topic_name) for publisher in self._publishers.values()]
        known = [*sorted(self._node.get_node_names_and_namespaces()), *counts]
        now_s = time.monotonic()
        if known != self._known:
            self._known, self._changed_s = known, now_s
        return now_s - self._started_s >= ANNOUNCED_S and now_s - self._changed_s >= UNCHANGED_S

    def unconnected(self) -> list[str]:
        """Topics of the bag with a compatible subscription that is not connected yet."""
        return [
            topic
            for topic, publisher in self._publishers.items()
            if publisher.get_subscription_count() < self._reachable(publisher.topic_name)
        ]

    def _reachable(self, name: str) -> int:
        own = (self._node.get_namespace(), self._node.get_name())
        offers = self._node.get_publishers_info_by_topic(name)
        return max(
            (count_reachable(self._node, name, o) for o in offers if (o.node_namespace, o.node_name) == own), default=0
        )

    def has_others(self, topic: str, answers: Iterable[str]) -> bool:
        """Whether a node subscribes to the topic that publishes none of the topics `answers`."""
        names = [self._node.resolve_topic_name(answer) for answer in answers]
        answering = [info for name in names for info in self._node.get_publishers_info_by_topic(name)]
        known = {(info.node_namespace, info.node_name) for info in answering}
        listening = self._node.get_subscriptions_info_by_topic(self._publishers[topic].topic_name)
        return any((info.node_namespace, info.node_name) not in known for info in listening)
