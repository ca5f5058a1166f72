"""Node processes for the demonstration, tests and benchmarks: start, wait for and end them."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO

from offradar_ros.errors import OffradarError
from offradar_ros.lab.live.process_usage import ProcessUsage, process_usage
from offradar_ros.ros.dds_profile import with_profile

STOP_S = 30.0
READY = 'active: '
"""Each node logs this when it is active."""


def isolated_environment(domain_id: int) -> dict[str, str]:
    """The environment of this process with another ROS domain, whose traffic stays on this machine.

    It has the DDS profile with shared memory for scans, unless the environment sets another profile of Fast DDS.
    """
    return {
        **with_profile(os.environ),
        'ROS_DOMAIN_ID': str(domain_id),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'PYTHONUNBUFFERED': '1',
    }


def parameter_arguments(values: Mapping[str, object], files: Sequence[Path] = ()) -> list[str]:
    """`--ros-args` for parameter files and single parameters, which override the files."""
    arguments = ['--ros-args']
    for path in files:
        arguments += ['--params-file', str(path)]
    for name, value in values.items():
        arguments += ['-p', f'{name}:={str(value).lower() if isinstance(value, bool) else value}']
    return arguments


class NodeProcess:
    """One node in a separate process, restricted to `cpus` if they are given; its output goes to `log`."""

    def __init__(
        self,
        name: str,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        log: Path,
        cpus: Collection[int] | None = None,
    ) -> None:
        self.name, self.log = name, log
        self._output: IO[bytes] = log.open('wb')
        self.process = subprocess.Popen(
            [sys.executable, '-m', f'offradar_ros.nodes.{name}', *arguments],
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
        )
        if cpus is not None:
            try:
                os.sched_setaffinity(self.process.pid, cpus)
            except OSError:
                self.stop()
                raise

    def usage(self) -> ProcessUsage:
        """Memory and CPU time so far; OffradarError if it has ended."""
        return process_usage(self.process.pid)

    def wait(self, timeout_s: float) -> int:
        """Exit status; OffradarError with the end of the log if it takes longer."""
        try:
            return self.process.wait(timeout_s)
        except subprocess.TimeoutExpired as error:
            raise OffradarError(f'{self.name}: still running after {timeout_s:g} s: {self.last_line()}') from error

    def last_line(self) -> str:
        """The last line of the log."""
        lines = self.log.read_text(encoding='utf-8', errors='replace').strip().splitlines()
        return lines[-1] if lines else 'no output'

    def stop(self) -> int:
        """Interrupt the process, kill it if it does not end, and return the exit status."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        self._output.close()
        return self.process.returncode


class Stack:
    """The encoder, map server and query nodes as processes; all are ended at the end of the context.

    `parameters` and parameter `files` are for all nodes, `own_parameters` for single nodes, by the names of their
    executables. `environment` is added to `isolated_environment`, and `cpus` restricts the cores of all nodes.
    """

    def __init__(
        self,
        folder: Path,
        domain_id: int,
        parameters: Mapping[str, object],
        files: Sequence[Path] = (),
        names: Sequence[str] = ('encoder_node', 'map_server_node', 'query_node'),
        *,
        own_parameters: Mapping[str, Mapping[str, object]] | None = None,
        environment: Mapping[str, str] | None = None,
        cpus: Collection[int] | None = None,
    ) -> None:
        self.folder = folder
        self.environment = isolated_environment(domain_id) | dict(environment or {})
        own = own_parameters or {}
        self._arguments = {
            name: parameter_arguments(dict(parameters) | dict(own.get(name, {})), files) for name in names
        }
        self._cpus = cpus
        self.nodes: dict[str, NodeProcess] = {}

    def __enter__(self) -> Stack:
        self.folder.mkdir(parents=True, exist_ok=True)
        with contextlib.ExitStack() as unless_all_start:
            unless_all_start.callback(self._stop)
            for name, arguments in self._arguments.items():
                self.nodes[name] = self.start(name, arguments)
            unless_all_start.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop()

    def _stop(self) -> None:
        for node in self.nodes.values():
            node.stop()

    def start(self, name: str, arguments: Sequence[str], log_name: str | None = None) -> NodeProcess:
        """Start another node of the package in the same domain; the caller ends it."""
        return NodeProcess(name, arguments, self.environment, self.folder / f'{log_name or name}.log', self._cpus)

    def usage(self) -> dict[str, ProcessUsage]:
        """Memory and CPU time of each node so far; OffradarError if one has ended."""
        return {name: node.usage() for name, node in self.nodes.items()}

    def wait_until_ready(self, timeout_s: float = 60.0) -> None:
        """Wait until every node has logged that it is active; OffradarError if one ends or takes too long."""
        deadline_s = time.monotonic() + timeout_s
        for node in self.nodes.values():
            while READY not in node.log.read_text(encoding='utf-8', errors='replace'):
                if node.process.poll() is not None:
                    raise OffradarError(f'{node.name}: ended with status {node.process.returncode}: {node.last_line()}')
                if time.monotonic() > deadline_s:
                    raise OffradarError(f'{node.name}: not ready after {timeout_s:g} s: {node.last_line()}')
                time.sleep(0.05)
