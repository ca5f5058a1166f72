"""Diagnostics count, rate and time what a node does."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticStatus

from offradar_ros.ros.diagnostics import NodeStatus


def values(status: DiagnosticStatus) -> dict[str, str]:
    return {item.key: item.value for item in status.values}


def test_drops_are_counted_by_cause_and_warned_of_once() -> None:
    node = NodeStatus('encoder: offradar_ros')
    node.drops['wrong_encoding'] += 2
    node.drops['short_step'] += 1
    (status,) = node.message(5_000_000_001).status
    assert status.level == DiagnosticStatus.WARN
    assert values(status) | {'dropped': '3', 'dropped.wrong_encoding': '2', 'dropped.short_step': '1'} == values(status)
    (later,) = node.message(6_000_000_000).status
    assert later.level == DiagnosticStatus.OK
    assert values(later)['dropped'] == '3'


def test_latency_percentiles_are_of_the_handled_messages() -> None:
    node = NodeStatus('encoder: offradar_ros')
    assert 'latency_p50_ms' not in values(node.message(0).status[0])
    for age_s in [0.010] * 99 + [1.0]:
        node.handle(time.monotonic() - age_s)
    told = values(node.message(0).status[0])
    assert told['handled'] == '100'
    assert 10.0 <= float(told['latency_p50_ms']) < 500.0 < float(told['latency_p99_ms']) + 500.0
