"""`offradar session` with a real map server."""

from __future__ import annotations

import importlib.util
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

WAIT_S = 120.0
"""Longer than the command itself waits for a map server."""


def test_it_reports_what_it_needs(refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('importlib.util.find_spec', lambda name: None)
    printed = refused('session', 'start')
    assert "needs rclpy: source a ROS 2 installation, or pip install '.[ros]' in the project's folder" in printed


@pytest.mark.skipif(importlib.util.find_spec('rclpy') is None, reason='rclpy is not installed')
def test_every_action_reaches_the_map_server(tmp_path: Path, domain_id: int) -> None:
    from offradar_ros.lab.live.node_processes import Stack  # noqa: PLC0415

    parameters = {'map.path': tmp_path / 'map.db', 'map.start_session': False, 'map.allow_destructive': True}
    with Stack(tmp_path / 'logs', domain_id, parameters, names=['map_server_node']) as nodes:
        nodes.wait_until_ready()

        def call(action: str) -> tuple[int, str, str]:
            command = [sys.executable, '-m', 'offradar_ros.cli.main', 'session', action]
            ran = subprocess.run(
                command, env=nodes.environment, capture_output=True, text=True, timeout=WAIT_S, check=False
            )
            # Where the machine is busy, the two may take seconds to find one another.
            printed = [line for line in ran.stderr.splitlines(keepends=True) if not line.startswith('waiting for ')]
            return ran.returncode, ran.stdout, ''.join(printed)

        status, printed, _ = call('start')
        assert (status, 'session 1' in printed) == (0, True)
        status, printed, _ = call('end')
        assert (status, printed.startswith('session 1')) == (0, True)
        assert call('end') == (1, '', 'error: service map_server/end_session: no session runs: start one first\n')
        assert call('save')[0] == 0
        assert call('undo')[2].startswith('error: service map_server/undo_session: ')
        assert 'map.db' in call('clear')[1]


@pytest.mark.skipif(importlib.util.find_spec('rclpy') is None, reason='rclpy is not installed')
def test_what_takes_drives_away_is_refused_with_the_parameter_that_allows_it(tmp_path: Path, domain_id: int) -> None:
    from offradar_ros.lab.live.node_processes import Stack  # noqa: PLC0415

    with Stack(tmp_path / 'logs', domain_id, {'map.path': tmp_path / 'map.db'}, names=['map_server_node']) as nodes:
        nodes.wait_until_ready()
        command = [sys.executable, '-m', 'offradar_ros.cli.main', 'session', 'clear']
        ran = subprocess.run(
            command, env=nodes.environment, capture_output=True, text=True, timeout=WAIT_S, check=False
        )
    assert (ran.returncode, ran.stdout) == (1, '')
    (line,) = [line for line in ran.stderr.splitlines() if not line.startswith('waiting for ')]
    assert line.startswith('error: service map_server/clear: clear takes mapped drives away')
    assert 'map.allow_destructive:=true' in line


@pytest.mark.skipif(importlib.util.find_spec('rclpy') is None, reason='rclpy is not installed')
def test_no_map_server_is_one_line(domain_id: int) -> None:
    from offradar_ros.lab.live.node_processes import isolated_environment  # noqa: PLC0415

    command = [sys.executable, '-m', 'offradar_ros.cli.main', 'session', 'end', '--timeout', '0.5']
    ran = subprocess.run(
        command, env=isolated_environment(domain_id), capture_output=True, text=True, timeout=WAIT_S, check=False
    )
    assert (ran.returncode, ran.stdout) == (1, '')
    assert ran.stderr == 'error: service map_server/end_session: no map server within 0.5 s\n'


@pytest.mark.skipif(importlib.util.find_spec('rclpy') is None, reason='rclpy is not installed')
@pytest.mark.parametrize(('sent', 'status'), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_long_wait_is_reported_and_ends_with_a_signal(sent: signal.Signals, status: int) -> None:
    from offradar_ros.lab.live.node_processes import isolated_environment  # noqa: PLC0415

    command = [sys.executable, '-m', 'offradar_ros.cli.main', 'session', 'end']
    with subprocess.Popen(command, env=isolated_environment(76), stderr=subprocess.PIPE, text=True) as waiting:
        assert waiting.stderr is not None
        printed = waiting.stderr.readline()
        assert printed.startswith('waiting for the service /map_server/end_session (gives up after 60 s; is map_server')
        waiting.send_signal(sent)
        assert waiting.stderr.read() == 'interrupted while waiting for the service /map_server/end_session\n'
        assert waiting.wait(WAIT_S) == status


@pytest.mark.skipif(importlib.util.find_spec('rclpy') is None, reason='rclpy is not installed')
def test_a_map_server_that_does_not_answer_is_reported(tmp_path: Path) -> None:
    from offradar_ros.lab.live.node_processes import Stack  # noqa: PLC0415

    parameters = {'map.path': tmp_path / 'map.db', 'map.start_session': False}
    command = [sys.executable, '-m', 'offradar_ros.cli.main', 'session', 'start']
    with Stack(tmp_path / 'logs', 77, parameters, names=['map_server_node']) as nodes:
        nodes.wait_until_ready()
        # The first call tells that the two find one another.
        assert subprocess.run(command, env=nodes.environment, capture_output=True, timeout=WAIT_S, check=False).stdout
        server = nodes.nodes['map_server_node'].process
        server.send_signal(signal.SIGSTOP)
        try:
            with subprocess.Popen(command, env=nodes.environment, stderr=subprocess.PIPE, text=True) as waiting:
                assert waiting.stderr is not None
                printed = waiting.stderr.readline()
                assert printed.startswith('waiting for the ')
                waiting.send_signal(signal.SIGTERM)
                (last,) = waiting.stderr.readlines()
                assert last.startswith('interrupted while waiting for the ')
                assert waiting.wait(WAIT_S) == 143
        finally:
            server.send_signal(signal.SIGCONT)


@pytest.mark.skipif(importlib.util.find_spec('rclpy') is None, reason='rclpy is not installed')
def test_a_map_server_of_another_namespace_is_named_and_reached(tmp_path: Path, domain_id: int) -> None:
    from offradar_ros.lab.live.node_processes import Stack  # noqa: PLC0415

    nodes = Stack(tmp_path, domain_id, {})
    server = nodes.start('map_server_node', ['--ros-args', '-r', '__ns:=/car_1', '-p', 'map.start_session:=false'])

    def call(*arguments: str) -> tuple[int, str]:
        command = [sys.executable, '-m', 'offradar_ros.cli.main', 'session', 'start', *arguments]
        ran = subprocess.run(
            command, env=nodes.environment, capture_output=True, text=True, timeout=WAIT_S, check=False
        )
        return ran.returncode, ran.stdout + ran.stderr

    try:
        status, printed = call('--namespace', '/car_1')
        assert (status, 'session 1 started' in printed) == (0, True), printed
        status, printed = call('--timeout', '10')
        assert status == 1
        assert 'no map server within 10 s: there is one in /car_1: name the namespace' in printed
        status, printed = call('--namespace', 'car 1')
        assert (status, printed.count('\n'), 'car 1' in printed) == (1, 1, True), printed
    finally:
        server.stop()
