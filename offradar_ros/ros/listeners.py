"""Who hears a topic, as far as this node has discovered the others."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible


def count_listeners(node: Node, topic: str, msgtype: str, offered: QoSProfile) -> int:
    """How many subscriptions of the resolved name `topic` a publisher of this type and quality of service can reach.

    Those of another type, or that ask for more than is offered, are never connected to it.
    """
    return sum(
        subscription.topic_type == msgtype
        and qos_check_compatible(offered, subscription.qos_profile)[0] != QoSCompatibility.ERROR
        for subscription in node.get_subscriptions_info_by_topic(topic)
    )
