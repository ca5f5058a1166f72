"""What prevents a program that uses ROS from starting is one line that says what to do, and status 1."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from live_nodes import WAIT_S, Observer, StartNode, wait_until
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from offradar_ros.errors import ConfigError
from offradar_ros.lab.live.node_processes import Stack, isolated_environment
from offradar_ros.nodes.encoder_node import EncoderNode
from offradar_ros.nodes.map_server_node import MapServerNode
from offradar_ros.nodes.query_node import QueryNode
from offradar_ros.ros.stage_node import StageNode

PROJECT = Path(__file__).resolve().parents[2]
SESSION = str(PROJECT / 'bags' / 'session_1')
PROGRAMS = {
    'encoder_node': ['offradar_ros.nodes.encoder_node'],
    'map_server_node': ['offradar_ros.nodes.map_server_node'],
    'query_node': ['offradar_ros.nodes.query_node'],
    'replay_node': ['offradar_ros.nodes.replay_node', SESSION, '--timeout', '1'],
    'session': ['offradar_ros.cli.main', 'session', 'start', '--timeout', '1'],
}
WITH_ROS_ARGUMENTS = ('query_node', 'replay_node')
"""The three nodes start in the same way."""


def refused(program: str, environment: dict[str, str], *arguments: str, interpreter: tuple[str, ...] = ('-m',)) -> str:
    """The line with which a program refuses to start."""
    ran = subprocess.run(
        [sys.executable, *interpreter, *PROGRAMS[program], *arguments],
        env=environment,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert ran.returncode == 1, ran.stderr
    assert 'Traceback' not in ran.stderr
    (line,) = [each for each in ran.stderr.splitlines() if each.startswith('error: ')]
    return line


@pytest.mark.parametrize('program', PROGRAMS)
def test_a_home_that_cannot_be_written_is_one_line_that_names_the_way_out(program: str, domain_id: int) -> None:
    environment = {**isolated_environment(domain_id), 'HOME': '/proc/nonexistent'}
    environment.pop('ROS_LOG_DIR', None)
    line = refused(program, environment)
    assert '/proc/nonexistent/.ros/log' in line
    assert 'ROS_LOG_DIR' in line


@pytest.mark.parametrize('program', PROGRAMS)
def test_a_domain_that_is_none_is_one_line(program: str, domain_id: int) -> None:
    line = refused(program, {**isolated_environment(domain_id), 'ROS_DOMAIN_ID': '233'})
    assert 'ROS_DOMAIN_ID=233: expected a whole number from 0 to 232' in line


@pytest.mark.parametrize('program', PROGRAMS)
def test_a_switch_of_the_log_that_is_none_is_one_line(program: str, domain_id: int) -> None:
    line = refused(program, {**isolated_environment(domain_id), 'RCUTILS_COLORIZED_OUTPUT': 'yes'})
    assert line == 'error: RCUTILS_COLORIZED_OUTPUT=yes: expected 0 or 1'


FULL = """
import os, runpy, sys
os.statvfs = lambda path: type('', (), {'f_bavail': 1, 'f_frsize': 4096, 'f_blocks': 9999})
module, sys.argv = sys.argv[1], sys.argv[1:]
runpy.run_module(module, run_name='__main__', alter_sys=True)
"""


@pytest.mark.parametrize('program', PROGRAMS)
def test_shared_memory_that_is_full_is_one_line(program: str, domain_id: int) -> None:
    """Libraries of ROS would end the process without a word."""
    line = refused(program, isolated_environment(domain_id), interpreter=('-c', FULL))
    assert line.startswith('error: /dev/shm: the shared memory is full, and ROS cannot start: remove')


@pytest.mark.parametrize('program', WITH_ROS_ARGUMENTS)
@pytest.mark.parametrize(
    ('arguments', 'expected'),
    [
        (['--params-file', '/no/such/file.yaml'], '--params-file /no/such/file.yaml: cannot be read'),
        (['--params-file'], 'params-file'),
        (['--bogus'], '--bogus'),
        (['-r', '__node:=bad name'], 'bad name'),
        (['-p', 'use_sim_time:=maybe'], 'use_sim_time'),
        (['--log-level', 'loud'], 'loud'),
    ],
)
def test_a_bad_argument_for_ros_is_one_line(program: str, arguments: list[str], expected: str, domain_id: int) -> None:
    assert expected in refused(program, isolated_environment(domain_id), '--ros-args', *arguments)


@pytest.mark.parametrize('program', WITH_ROS_ARGUMENTS)
def test_a_parameter_file_that_is_none_is_refused_and_not_waited_for(
    program: str, domain_id: int, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'bad.yaml').write_text(']{')
    (tmp_path / 'list.yaml').write_text('- 1\n')
    (tmp_path / 'folder').mkdir()
    for name in ('pipe', 'bad.yaml', 'list.yaml', 'folder'):
        path = str(tmp_path / name)
        assert path in refused(program, isolated_environment(domain_id), '--ros-args', '--params-file', path)


def test_a_fifo_in_a_bag_is_refused_and_not_waited_for(domain_id: int, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'metadata.yaml')
    ran = subprocess.run(
        [sys.executable, '-m', 'offradar_ros.nodes.replay_node', str(tmp_path)],
        env=isolated_environment(domain_id),
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert (ran.returncode, ran.stderr) == (
        1,
        f'error: {tmp_path / "metadata.yaml"}: is a FIFO: expected a file or a folder\n',
    )


@pytest.mark.parametrize(
    ('name', 'value'),
    [('autostart', '1'), ('qos_overrides./embedding.subscription.reliability', 'often')],
)
def test_a_bad_parameter_of_ros_is_one_line(name: str, value: str, domain_id: int) -> None:
    line = refused('query_node', isolated_environment(domain_id), '--ros-args', '-p', f'{name}:={value}')
    assert name.rpartition('.')[2] in line or value in line


@pytest.mark.parametrize(
    ('kind', 'name'), [(EncoderNode, 'encoder.weights'), (MapServerNode, 'map.path'), (QueryNode, 'query.map_path')]
)
def test_a_fifo_in_place_of_a_file_is_refused_and_not_waited_for(
    start_node: StartNode, tmp_path: Path, kind: type[StageNode], name: str
) -> None:
    os.mkfifo(tmp_path / 'pipe')
    with pytest.raises(ConfigError, match=f'parameter {name}: {tmp_path / "pipe"} is a FIFO: expected a file'):
        start_node(kind, {name: str(tmp_path / 'pipe')})


def test_a_file_for_other_nodes_and_misspelt_names_are_told_of(stack: Callable[..., Stack], tmp_path: Path) -> None:
    path = tmp_path / 'car.yaml'
    path.write_text('/other:\n  ros__parameters: {rate: 1}\nquery:\n  ros__parameters: {qeury: {level: 5}}\n')
    with stack(files=[path], names=('map_server_node', 'query_node')) as nodes:
        nodes.wait_until_ready()
        server, query = (nodes.nodes[name].log.read_text() for name in ('map_server_node', 'query_node'))
    assert f'{path}: has no parameters for /map_server, only for /other, /query: none of it is used' in server
    assert 'has no parameters' not in query
    assert 'parameters that no node of offradar_ros has, and that are not used: qeury.level' in query


@pytest.mark.parametrize('kind', [MapServerNode, QueryNode])
def test_a_node_outlives_its_parameters(
    observer: Observer, start_node: StartNode, kind: type[StageNode], monkeypatch: pytest.MonkeyPatch
) -> None:
    node = start_node(kind)
    before = node.config

    def fail(*_: object) -> None:
        raise ZeroDivisionError

    with monkeypatch.context() as patch:
        patch.setattr('offradar_ros.ros.parameters.validate', fail)
        (result,) = node.set_parameters([Parameter('use_sim_time', value=False)])
    assert not result.successful
    assert 'internal error' in result.reason
    with monkeypatch.context() as patch:
        patch.setattr(node, 'apply', fail)
        node.set_parameters([Parameter('use_sim_time', value=False)])
    assert node.status.drops['internal_error'] == 2
    assert node.config == before


def test_a_service_that_fails_is_answered(observer: Observer, start_node: StartNode) -> None:
    node = start_node(QueryNode)

    def fail(_request: Trigger.Request, _response: Trigger.Response) -> Trigger.Response:
        raise ZeroDivisionError

    async def fail_later(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return fail(request, response)

    def refuse(_request: Trigger.Request, _response: Trigger.Response) -> Trigger.Response:
        raise PermissionError(13, 'Permission denied', '/data/town.db')

    node.create_service(Trigger, '~/fails', fail)
    node.create_service(Trigger, '~/fails_later', fail_later)
    node.create_service(Trigger, '~/refuses', refuse)
    for name, expected in {
        'fails': 'internal error',
        'fails_later': 'internal error',
        'refuses': '/data/town.db: Permission denied: run as a user who may',
    }.items():
        answer = observer.call(Trigger, f'query/{name}', Trigger.Request())
        assert not answer.success
        assert expected in answer.message


FAILING = """
import sys, threading
from offradar_ros.nodes import query_node
from offradar_ros.ros.run import run

class Failing(query_node.QueryNode):
    def __init__(self, **options):
        super().__init__(**options)
        self.ticks = 0
        self.create_timer(0.05, self.tick)

    def tick(self):
        self.ticks += 1
        if self.ticks == 5:
            print('still here', self.status.drops['internal_error'], flush=True)
        raise ZeroDivisionError

sys.exit(run(Failing))
"""


def test_a_callback_that_fails_does_not_end_the_process(domain_id: int, tmp_path: Path) -> None:
    log = tmp_path / 'log'
    with log.open('wb') as output:
        process = subprocess.Popen(
            [sys.executable, '-c', FAILING], env=isolated_environment(domain_id), stdout=output, stderr=output
        )
        try:
            wait_until(lambda: 'still here 4' in log.read_text())
            assert process.poll() is None
            process.terminate()
            assert process.wait(WAIT_S) == 0
        finally:
            process.kill()
            process.wait()
    assert 'ZeroDivisionError' in log.read_text()
