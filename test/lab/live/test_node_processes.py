"""Node processes have their parameters, stay on their cores, and report their usage."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from offradar_ros.errors import OffradarError
from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.lab.live.process_usage import process_usage


def test_memory_and_time_are_those_of_the_process() -> None:
    program = 'import sys, time; held = b"1" * (64 * 2**20); del held; time.process_time(); print(flush=True); input()'
    with subprocess.Popen([sys.executable, '-c', program], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        used = process_usage(process.pid)
        process.communicate(b'\n')
    assert used.peak_bytes > 64 * 2**20 > used.resident_bytes > 2**20
    assert 0.0 <= used.cpu_s < 60.0
    with pytest.raises(OffradarError, match='has ended'):
        process_usage(process.pid)


def test_the_time_of_all_threads_counts() -> None:
    before_s, wall_s = process_usage(os.getpid()).cpu_s, time.process_time()
    while time.process_time() < wall_s + 0.2:
        pass
    assert 0.15 < process_usage(os.getpid()).cpu_s - before_s < 2.0


def test_where_one_cannot_be_started_none_is_left(
    tmp_path: Path, domain_id: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[subprocess.Popen[bytes]] = []

    class Noted(subprocess.Popen[bytes]):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            started.append(self)

    monkeypatch.setattr(subprocess, 'Popen', Noted)
    names = ('encoder_node', 'query_node')
    (tmp_path / 'query_node.log').mkdir()
    for cpus, error in ((None, IsADirectoryError), ({10**4}, OSError)):
        with pytest.raises(error), Stack(tmp_path, domain_id, {}, names=names, cpus=cpus):
            pass
    assert len(started) == 2
    assert [process.poll() is None for process in started] == [False, False]


def test_each_node_has_its_parameters_its_cores_and_its_figures(tmp_path: Path, domain_id: int) -> None:
    names = ('encoder_node', 'query_node')
    core = min(os.sched_getaffinity(0))
    parameters: dict[str, object] = {'query.delta': 3.0, 'query.level': 10}
    own: dict[str, dict[str, object]] = {'query_node': {'query.delta': 1.0}, 'encoder_node': {'encoder.backlog': 2}}
    with Stack(
        tmp_path, domain_id, parameters, names=names, own_parameters=own, environment={'GREETING': 'hello'}, cpus={core}
    ) as nodes:
        nodes.wait_until_ready()
        assert 'rejects U above 2.0' in nodes.nodes['query_node'].log.read_text()
        used = nodes.usage()
        for name, node in nodes.nodes.items():
            threads = Path(f'/proc/{node.process.pid}/task').iterdir()
            assert {frozenset(os.sched_getaffinity(int(thread.name))) for thread in threads} == {frozenset({core})}
            assert b'GREETING=hello' in Path(f'/proc/{node.process.pid}/environ').read_bytes()
            assert used[name].peak_bytes >= used[name].resident_bytes > 2**20
            assert used[name].cpu_s > 0.0
