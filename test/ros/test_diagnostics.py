"""Diagnostics count, rate and time what a node does."""

from __future__ import annotations

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


def test_rate_and_latency_percentiles_are_of_the_handled_messages() -> None:
    now_s = 100.0
    node = NodeStatus('encoder: offradar_ros', lambda: now_s)
    now_s = 110.0
    assert 'latency_p50_ms' not in values(node.message(0).status[0])
    for latency_s in [0.010] * 99 + [1.0]:
        node.handle(now_s - latency_s)
    now_s = 130.0
    reported = values(node.message(0).status[0])
    assert (reported['handled'], reported['rate_hz']) == ('100', '5.00')
    # Linear between the 99th and the 100th: at 0.99 · 99 = 98.01 of 0 to 99.
    assert (reported['latency_p50_ms'], reported['latency_p99_ms']) == ('10.00', '19.90')
