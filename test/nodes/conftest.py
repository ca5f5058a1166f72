"""Nodes in the test's ROS domain: as processes, or within the test's process."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from live_nodes import NodeT, Observer, StartNode
from rclpy.parameter import Parameter

from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.ros.stage_node import StageNode

DEFAULTS = {'encoder.name': 'ring_key', 'position.heading': 'source'}
"""What tests say nothing of. Without a course, which needs the positions of the next 2 s, scans are mapped at once."""


@pytest.fixture
def observer(domain_id: int) -> Iterator[Observer]:
    observer = Observer(domain_id)
    yield observer
    observer.close()


@pytest.fixture
def hang_up_ends() -> Iterator[None]:
    """Processes that are started meanwhile end with their terminal, though the tests may run under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.fixture
def start_node(observer: Observer) -> Iterator[StartNode]:
    nodes: list[StageNode] = []

    def start(kind: Callable[..., NodeT], parameters: dict[str, Any] | None = None) -> NodeT:
        given = [Parameter(name, value=value) for name, value in (DEFAULTS | (parameters or {})).items()]
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
            tmp_path / 'logs', domain_id, DEFAULTS | {'map.start_session': False} | (parameters or {}), **options
        )

    return make
