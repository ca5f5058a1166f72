"""Subscribers of a replay: one that can be connected is waited for, others are not."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rclpy
from live_nodes import wait_until
from rclpy.node import Node
from sensor_msgs.msg import Image
from std_msgs.msg import Bool

from offradar_ros.ros import qos
from offradar_ros.ros.replay_subscribers import ReplaySubscribers

TYPES = {'/scan': 'sensor_msgs/msg/Image', '/door': 'std_msgs/msg/Bool'}


@pytest.fixture
def player(domain_id: int) -> Iterator[Node]:
    context = rclpy.context.Context()
    rclpy.init(context=context, domain_id=domain_id)
    yield Node('player', context=context, enable_rosout=False)
    rclpy.shutdown(context=context)


@pytest.fixture
def subscribers(player: Node) -> ReplaySubscribers:
    publishers = {
        '/scan': player.create_publisher(Image, 'scan', qos.SCANS),
        '/door': player.create_publisher(Bool, 'door', qos.POSITIONS),
    }
    return ReplaySubscribers(player, publishers, TYPES, '/scan')


def test_a_subscriber_is_unconnected_until_the_publisher_knows_of_it(
    player: Node, subscribers: ReplaySubscribers, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert subscribers.unconnected() == []
    other = Node('other', context=player.context, enable_rosout=False)
    other.create_subscription(Bool, 'door', print, 10)
    # A transient-local subscription does not fit a volatile publisher: never connected.
    other.create_subscription(Bool, 'door', print, qos.LATCHED)
    wait_until(lambda: player.count_subscribers('door') == 2)
    wait_until(lambda: not subscribers.unconnected())
    publisher = next(each for each in player.publishers if each.topic_name == '/door')
    assert publisher.get_subscription_count() == 1
    monkeypatch.setattr(publisher, 'get_subscription_count', lambda: 0)
    assert subscribers.unconnected() == ['/door']


def test_the_nodes_that_answer_are_not_others(player: Node, subscribers: ReplaySubscribers) -> None:
    answering = Node('answering', context=player.context, enable_rosout=False)
    answering.create_publisher(Bool, 'answer', 10)
    answering.create_subscription(Image, 'scan', print, 10)
    wait_until(lambda: player.count_subscribers('scan') == 1 and player.count_publishers('answer') == 1)
    assert not subscribers.has_others('/scan', ['answer'])
    assert subscribers.has_others('/scan', [])
    assert not subscribers.has_others('/door', [])
