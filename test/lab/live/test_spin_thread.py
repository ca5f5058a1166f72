"""An executor in a separate thread stops without errors, also while callbacks run."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

rclpy = pytest.importorskip('rclpy')

from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402

from offradar_ros.lab.live.spin_thread import SpinThread  # noqa: E402

WAIT_S = 20.0


@pytest.fixture
def node(domain_id: int) -> Iterator[Node]:
    context = rclpy.context.Context()
    rclpy.init(context=context, domain_id=domain_id)
    yield Node('spinning', context=context, enable_rosout=False)
    rclpy.try_shutdown(context=context)


@pytest.fixture
def raised(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Exceptions that ended a thread."""
    found: list[object] = []
    monkeypatch.setattr(threading, 'excepthook', found.append)
    return found


def test_callbacks_run_until_it_is_stopped(node: Node, raised: list[object]) -> None:
    called = threading.Event()
    node.create_timer(0.001, called.set)
    for _ in range(20):
        executor = SingleThreadedExecutor(context=node.context)
        executor.add_node(node)
        spin = SpinThread(executor)
        assert called.wait(WAIT_S)
        spin.stop()
        called.clear()
        assert executor.get_nodes() == []
        spin.stop()
    assert not called.is_set()
    assert raised == []


def test_it_ends_with_its_context(node: Node, raised: list[object]) -> None:
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    spin = SpinThread(executor)
    rclpy.shutdown(context=node.context)
    spin.stop()
    assert raised == []
