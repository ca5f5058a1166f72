"""Nodes in a ROS domain of their own: as processes, or within the test where messages are sent by hand."""

from __future__ import annotations

import fcntl
import itertools
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from live_nodes import NodeT, Observer, StartNode
from rclpy.parameter import Parameter

from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.ros.stage_node import StageNode

# Domains above 101 use ports that Linux gives to other programs; each worker has twenty of its own.
_FIRST = 10 + 20 * int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw'))
RING_KEY = {'encoder.name': 'ring_key'}
_domains = itertools.cycle(range(_FIRST, _FIRST + 20))


@pytest.fixture
def domain_id() -> Iterator[int]:
    """A domain that no other run of the tests on this machine uses meanwhile: their nodes would answer one another."""
    for domain in itertools.islice(_domains, 20):
        with Path(tempfile.gettempdir(), f'offradar_ros_test_domain_{domain}').open('w') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    pytest.fail('every ROS domain of this worker is in use by another run of the tests')


@pytest.fixture
def observer(domain_id: int) -> Iterator[Observer]:
    observer = Observer(domain_id)
    yield observer
    observer.close()


@pytest.fixture
def start_node(observer: Observer) -> Iterator[StartNode]:
    nodes: list[StageNode] = []

    def start(kind: Callable[..., NodeT], parameters: dict[str, Any] | None = None) -> NodeT:
        given = [Parameter(name, value=value) for name, value in (RING_KEY | (parameters or {})).items()]
        node = kind(context=observer.context, parameter_overrides=given)
        nodes.append(node)
        node.start()
        observer.add(node)
        return node

    yield start
    for node in nodes:
        node.close()


@pytest.fixture
def stack(tmp_path: Path, domain_id: int) -> Callable[..., Stack]:
    """The three nodes as processes, with the ring key: `with stack({'map.path': …}) as nodes:`."""

    def make(parameters: dict[str, Any] | None = None, **options: Any) -> Stack:
        return Stack(
            tmp_path / 'logs', domain_id, RING_KEY | {'map.start_session': False} | (parameters or {}), **options
        )

    return make
