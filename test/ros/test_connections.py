"""A node reports how many subscriptions its outputs are connected to, and whether these are all that can be."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
import rclpy
from live_nodes import wait_until
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from offradar_ros.lab.live.spin_thread import SpinThread
from offradar_ros.ros import qos
from offradar_ros.ros.connections import SUBSCRIBERS, Connections, Introduction, count_reachable, serve_subscribers


@pytest.fixture
def make(domain_id: int) -> Iterator[Callable[[str], Node]]:
    """Makes nodes that spin in one context."""
    context = rclpy.context.Context()
    rclpy.init(context=context, domain_id=domain_id)
    executor = SingleThreadedExecutor(context=context)
    spin = SpinThread(executor)

    def make(name: str) -> Node:
        node = Node(name, context=context, enable_rosout=False)
        executor.add_node(node)
        return node

    yield make
    spin.stop()
    rclpy.shutdown(context=context)


def test_subscribers_are_counted_by_the_node_that_publishes(make: Callable[[str], Node]) -> None:
    source, watcher = make('source'), make('watcher')
    outputs = [source.create_publisher(Header, topic, qos.RESULTS) for topic in ('~/some', 'other')]
    serve_subscribers(source, outputs)
    connections = Connections(watcher)
    assert connections.count('nothing') == 0
    assert not connections.is_complete('source/some')
    subscription = watcher.create_subscription(Header, 'source/some', print, qos.RESULTS)
    wait_until(lambda: connections.count('source/some') == 1 and connections.is_complete('source/some'))
    # A transient-local subscription does not fit this volatile publisher: never connected, nor waited for.
    watcher.create_subscription(Header, 'source/some', print, qos.LATCHED)
    wait_until(lambda: len(watcher.get_subscriptions_info_by_topic('/source/some')) == 2)
    (offer,) = watcher.get_publishers_info_by_topic('/source/some')
    assert count_reachable(watcher, '/source/some', offer) == 1
    assert connections.is_complete('source/some')
    watcher.destroy_subscription(subscription)
    wait_until(lambda: connections.count('source/some') == 0)
    assert connections.count('other') == 0


def test_another_service_of_that_name_counts_for_nothing(make: Callable[[str], Node]) -> None:
    source, watcher = make('source'), make('watcher')
    source.create_publisher(Header, 'some', qos.RESULTS)
    requests: list[Trigger.Request] = []

    def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        requests.append(request)
        response.message = 'nobody'
        return response

    source.create_service(Trigger, f'~/{SUBSCRIBERS}', answer)
    connections = Connections(watcher)
    wait_until(lambda: connections.count('some') or len(requests) > 2)
    assert connections.count('some') == 0
    assert not connections.is_complete('some')


@pytest.mark.parametrize(
    'answer',
    [
        '',
        'no',
        '[' * 50_000,
        '{"/some": Infinity}',
        '{"/some": 1e999}',
        '{"/some": "1"}',
        '{"/some": -1}',
        '[1]',
        'null',
    ],
)
def test_the_service_of_another_package_may_answer_anything(make: Callable[[str], Node], answer: str) -> None:
    source, watcher = make('source'), make('watcher')
    source.create_publisher(Header, 'some', qos.RESULTS)
    calls: list[str] = []

    def serve(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        calls.append(answer)
        response.message = answer
        return response

    source.create_service(Trigger, f'~/{SUBSCRIBERS}', serve)
    connections = Connections(watcher)
    counts: list[int] = []

    def asked_again() -> bool:
        counts.append(connections.count('some'))
        return len(calls) > 2

    wait_until(asked_again)
    assert set(counts) == {0}


def test_a_node_is_introduced_when_the_other_one_has_answered_it(make: Callable[[str], Node]) -> None:
    watcher, other = make('watcher'), make('other')
    introduction = Introduction(watcher, Trigger, f'other/{SUBSCRIBERS}')
    assert not introduction.is_complete()
    serve_subscribers(other, ())
    wait_until(introduction.is_complete)
    introduction.close()
    assert not Introduction(watcher, Trigger, f'nobody/{SUBSCRIBERS}').is_complete()
