"""Diagnostics count, rate and time what a node does."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus

from offradar_ros.ros.diagnostics import NodeStatus, Trouble


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


def test_troubles_set_the_level_and_say_what_to_do() -> None:
    node = NodeStatus('encoder: offradar_ros')
    warn, error = Trouble('slow', 'slow: wait'), Trouble('no_scans', 'no scans: start the radar', is_error=True)
    (status,) = node.message(0, [warn]).status
    assert (status.level, status.message) == (DiagnosticStatus.WARN, 'slow: wait')
    (status,) = node.message(0, [warn, error]).status
    assert (status.level, status.message) == (DiagnosticStatus.ERROR, 'no scans: start the radar; slow: wait')
    assert values(status)['trouble.no_scans'] == 'no scans: start the radar'
    (status,) = node.message(0).status
    assert status.level == DiagnosticStatus.OK


def test_drops_say_their_cause_and_the_last_reason() -> None:
    node = NodeStatus('encoder: offradar_ros')
    node.drop('wrong_size', 'scan 1: too wide')
    node.drop('wrong_size', 'scan 2: too wide')
    assert node.message(0).status[0].message == '2 dropped in the last period (wrong_size): scan 2: too wide'
    node.drop('wrong_size', 'scan 3: too wide')
    node.drop('wrong_size', 'scan 4: too wide')
    node.drop('late', 'scan 5: late')
    assert node.message(0).status[0].message == '3 dropped in the last period, mostly wrong_size: scan 4: too wide'
    node.drop('internal_error', 'Traceback:\n  in x\nKeyError: 1')
    assert node.message(0).status[0].message == '1 dropped in the last period (internal_error): KeyError: 1'


def test_the_reason_of_a_recent_drop_is_known() -> None:
    now_s = 100.0
    node = NodeStatus('map_server: offradar_ros', lambda: now_s)
    assert node.recent_reason('not_saved', 1e9) is None
    node.drop('not_saved', 'disk full')
    now_s = 105.0
    assert node.recent_reason('not_saved', 5.0) == 'disk full'
    assert node.recent_reason('not_saved', 4.9) is None
