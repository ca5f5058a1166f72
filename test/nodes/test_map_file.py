"""A map server whose file is taken away says so at each service, goes on, and loses nothing."""

from __future__ import annotations

import contextlib
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from live_nodes import WAIT_S, Observer, StartNode, wait_until
from nav_msgs.msg import Odometry
from rclpy.lifecycle import TransitionCallbackReturn
from sensor_msgs.msg import PointCloud2
from small_maps import MODEL, as_version_1, make_map
from std_srvs.srv import Trigger

from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.mapping.map_reader import read_map
from offradar_ros.nodes.map_server_node import MapServerNode
from offradar_ros.ros import qos
from offradar_ros.ros.embedding_message import embedding_message, model_message
from offradar_ros.ros.stamps import header
from offradar_ros.types import Embedding

ASKED_AGAIN_S = 5.0


def trigger(observer: Observer, service: str) -> Any:
    return observer.call(Trigger, f'map_server/{service}', Trigger.Request())


def start_session_of_next(observer: Observer) -> Any:
    """Start a session of a server that follows another: while that one is still listed, it may be asked in vain."""
    for _ in range(int(WAIT_S / ASKED_AGAIN_S)):
        with contextlib.suppress(AssertionError):
            request = Trigger.Request()
            return observer.call(Trigger, 'map_server/start_session', request, ASKED_AGAIN_S)
    pytest.fail('start_session was not answered')


class Driver:
    """Publishes scans, 10 m apart, that become places."""

    def __init__(self, observer: Observer) -> None:
        observer.publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)(model_message(MODEL))
        self._embed = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
        self._pose = observer.publisher(Odometry, 'ground_truth/odometry', qos.POSITIONS)
        self._updates = observer.collect(PointCloud2, 'map/updates', qos.UPDATES)
        self._second = 1000

    def drive(self, scans: int) -> None:
        """Publish so many scans and wait until they are mapped."""
        mapped = len(self._updates)
        for _ in range(scans):
            self._second += 1
            stamp_ns = self._second * 10**9
            position = Odometry(header=header(stamp_ns, 'map'))
            position.pose.pose.position.x = 10.0 * self._second
            position.pose.pose.orientation.w = 1.0
            self._pose(position)
            mean = np.full(3, self._second, np.float32)
            self._embed(
                embedding_message(Embedding(stamp_ns, mean, np.ones(3, np.float32), MODEL.fingerprint), 'radar')
            )
        wait_until(lambda: len(self._updates) >= mapped + scans)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    folder = tmp_path / 'maps'
    folder.mkdir()
    return folder / 'town.db'


def server(stack: Callable[..., Stack], path: Path) -> Stack:
    parameters = {
        'map.path': str(path),
        'map.start_session': False,
        'map.autosave_s': 0.0,
        'map.allow_destructive': True,
        'position.source': 'odometry',
    }
    return stack(parameters, names=('map_server_node',))


def map_session(observer: Observer, driver: Driver, scans: int) -> None:
    """A session of so many scans, from its start to its end."""
    assert trigger(observer, 'start_session').success
    driver.drive(scans)
    assert trigger(observer, 'end_session').success


def test_a_copy_made_while_the_server_runs_has_each_ended_session(
    observer: Observer, stack: Callable[..., Stack], path: Path
) -> None:
    with server(stack, path) as nodes:
        nodes.wait_until_ready()
        driver = Driver(observer)
        for session in (1, 2):
            map_session(observer, driver, 3)
            copy = path.with_name(f'laptop_{session}.db')
            shutil.copy(path, copy)
            assert len(read_map(copy).places) == 3 * session
            assert [stored.state for stored in read_map(copy).sessions] == ['ended'] * session


@pytest.mark.parametrize('replaced', [False, True])
def test_without_the_file_no_service_succeeds_until_the_whole_map_is_written_again(
    observer: Observer, stack: Callable[..., Stack], path: Path, replaced: bool
) -> None:
    with server(stack, path) as nodes:
        nodes.wait_until_ready()
        driver = Driver(observer)
        map_session(observer, driver, 3)
        assert trigger(observer, 'start_session').success
        driver.drive(2)
        for file in path.parent.glob('town.db*'):
            file.unlink()
        if replaced:
            make_map(path.with_name('other.db'), 1.0)
            path.with_name('other.db').rename(path)
        services = ['end_session', 'clear', *(['save'] if replaced else [])]
        for service in services:
            refused = trigger(observer, service)
            assert not refused.success, service
            assert str(path) in refused.message and 'save' in refused.message
        driver.drive(1)
        if replaced:
            path.rename(path.with_name('aside.db'))
        saved = trigger(observer, 'save')
        assert saved.success and saved.message == 'saved 6 places, the whole map, where its file was removed'
        assert trigger(observer, 'save').message == 'saved 6 places'
        assert len(read_map(path).places) == 6
        assert [stored.state for stored in read_map(path).sessions] == ['ended', 'running']
        driver.drive(1)
        assert trigger(observer, 'end_session').success
        assert len(read_map(path).places) == 7
        node = nodes.nodes['map_server_node']
        node.process.send_signal(signal.SIGINT)
        assert node.wait(WAIT_S) == 0
    assert [stored.state for stored in read_map(path).sessions] == ['ended', 'ended']


def test_a_shutdown_that_fails_for_want_of_the_file_leaves_an_empty_session(start_node: StartNode, path: Path) -> None:
    node = start_node(MapServerNode, {'map.path': str(path)})
    session = node.stage.map.running_session_id
    assert session is not None
    aside = path.rename(path.with_name('aside.db'))
    assert node.trigger_shutdown() == TransitionCallbackReturn.FAILURE
    assert (node.active, node.stage.map.running_session_id) == (True, session)
    aside.rename(path)
    assert node.trigger_shutdown() == TransitionCallbackReturn.SUCCESS


@pytest.mark.parametrize('is_running', [False, True])
def test_at_exit_the_whole_map_is_rescued(
    observer: Observer, stack: Callable[..., Stack], path: Path, is_running: bool
) -> None:
    with server(stack, path) as nodes:
        nodes.wait_until_ready()
        driver = Driver(observer)
        map_session(observer, driver, 3)
        if is_running:
            assert trigger(observer, 'start_session').success
            driver.drive(2)
        path.unlink()
        node = nodes.nodes['map_server_node']
        node.process.send_signal(signal.SIGINT)
        assert node.wait(WAIT_S) == 1
        (rescued,) = path.parent.glob('town.db.rescued-*.db')
        log = node.log.read_text()
        assert f'error: {path}: the map file was removed' in log
        assert f'the whole map was written to {rescued}' in log
        assert 'Traceback' not in log
    assert len(read_map(rescued).places) == (5 if is_running else 3)
    assert not path.exists()


def test_an_upgrade_is_logged(stack: Callable[..., Stack], path: Path) -> None:
    make_map(path, 1.0)
    as_version_1(path)
    with server(stack, path) as nodes:
        nodes.wait_until_ready()
        assert 'upgraded from map format 1 to 4' in nodes.nodes['map_server_node'].log.read_text()


def test_a_second_server_is_refused_though_the_lock_file_was_removed(
    observer: Observer, stack: Callable[..., Stack], path: Path
) -> None:
    with server(stack, path) as nodes:
        nodes.wait_until_ready()
        driver = Driver(observer)
        assert trigger(observer, 'start_session').success
        driver.drive(2)
        path.with_name('town.db.lock').unlink()
        command = [sys.executable, '-m', 'offradar_ros.nodes.map_server_node', '--ros-args']
        command += ['-p', f'map.path:={path}', '-r', '__node:=second']
        second = subprocess.run(
            command, env=nodes.environment, capture_output=True, text=True, timeout=WAIT_S, check=False
        )
        assert second.returncode == 1
        assert 'in use by another process that writes it' in second.stderr
        assert trigger(observer, 'end_session').success
    assert len(read_map(path).places) == 2


def test_a_terminal_that_is_gone_leaves_nothing_to_rescue(
    stack: Callable[..., Stack], path: Path, observer: Observer
) -> None:
    """At exit the report cannot be printed; the session is committed, and the file closed, all the same."""
    nodes = server(stack, path)
    with nodes:
        pass
    arguments = nodes._arguments['map_server_node']
    process = subprocess.Popen(
        [sys.executable, '-m', 'offradar_ros.nodes.map_server_node', *arguments],
        env=nodes.environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    try:
        driver = Driver(observer)
        assert start_session_of_next(observer).success
        driver.drive(3)
        assert process.stdout is not None
        process.stdout.close()
        process.terminate()
        assert process.wait(WAIT_S) == 0
    finally:
        process.kill()
        process.wait()
    assert [session.state for session in read_map(path).sessions] == ['ended']
    assert not list(path.parent.glob('*rescued*'))
