"""Tasks run in parallel, their errors are raised, and a killed process is reported."""

from __future__ import annotations

import errno
import importlib
import multiprocessing.process
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from offradar_ros.errors import DataError
from offradar_ros.processes import parallel_map

WAIT_S = 60.0


@pytest.mark.parametrize('processes', [1, 2])
def test_each_task_is_run_and_its_progress_reported(tmp_path: Path, processes: int) -> None:
    reported: list[tuple[int, int]] = []
    tasks = [(tmp_path / name, name) for name in ('a', 'b', 'c')]
    parallel_map(Path.write_text, tasks, processes, lambda done, total: reported.append((done, total)))
    assert reported == [(1, 3), (2, 3), (3, 3)]
    assert [path.read_text() for path, _ in tasks] == ['a', 'b', 'c']


@pytest.mark.parametrize('processes', [1, 2])
def test_results_are_in_the_order_of_the_tasks(processes: int) -> None:
    assert parallel_map(divmod, [(7, 2), (9, 4), (5, 5)], processes) == [(3, 1), (2, 1), (1, 0)]


def test_tasks_do_not_change_the_calling_process(tmp_path: Path) -> None:
    before = Path.cwd()
    parallel_map(os.chdir, [(tmp_path,), (tmp_path,)], 2)
    assert Path.cwd() == before


@pytest.mark.parametrize('processes', [1, 2])
def test_an_error_of_a_task_is_raised(tmp_path: Path, processes: int) -> None:
    with pytest.raises(FileNotFoundError, match='nowhere'):
        parallel_map(os.rmdir, [(tmp_path / 'nowhere',), (tmp_path / 'nowhere',)], processes)


def test_a_killed_process_is_reported() -> None:
    with pytest.raises(DataError, match='a process was killed'):
        parallel_map(signal.raise_signal, [(signal.SIGKILL,), (signal.SIGKILL,)], 2)


def test_a_process_that_dies_while_another_is_started_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def start(_: object) -> None:
        raise OSError('handle is closed')

    monkeypatch.setattr(multiprocessing.process.BaseProcess, 'start', start)
    with pytest.raises(DataError, match='a process was killed'):
        parallel_map(abs, [(1,), (2,)], 2)


def test_an_error_of_the_system_is_not_reported_as_a_killed_process(monkeypatch: pytest.MonkeyPatch) -> None:
    def start(_: object) -> None:
        raise BlockingIOError(errno.EAGAIN, 'Resource temporarily unavailable')

    monkeypatch.setattr(multiprocessing.process.BaseProcess, 'start', start)
    with pytest.raises(BlockingIOError, match='Resource temporarily unavailable'):
        parallel_map(abs, [(1,), (2,)], 2)


def test_workers_end_with_the_calling_process() -> None:
    code = 'import time; from offradar_ros.processes import parallel_map; parallel_map(time.sleep, [(900,)] * 2, 2)'
    parent = subprocess.Popen([sys.executable, '-c', code])
    try:
        assert within_s(WAIT_S, lambda: len(workers_of(parent.pid)) == 2)
        children = workers_of(parent.pid)
    finally:
        parent.kill()
        parent.wait()
    assert within_s(WAIT_S, lambda: not any(is_alive(pid) for pid in children))


def test_ctrl_c_ends_the_workers_which_remove_partial_files(tmp_path: Path) -> None:
    (tmp_path / 'slow_task.py').write_text(SLOW_TASK)
    tasks = [(str(tmp_path / name),) for name in 'abcd']
    code = (
        f'from slow_task import slow; from offradar_ros.processes import parallel_map; parallel_map(slow, {tasks}, 2)'
    )
    # Background jobs of a shell, and all processes that they start, ignore Ctrl-C; these tests may run as one.
    command = ['env', '--default-signal=INT', sys.executable, '-c', code]
    paths = os.pathsep.join([str(tmp_path), *sys.path])
    parent = subprocess.Popen(command, env={**os.environ, 'PYTHONPATH': paths}, stderr=subprocess.PIPE, text=True)
    try:
        assert within_s(WAIT_S, lambda: (tmp_path / 'a').exists() and (tmp_path / 'b').exists())
        parent.send_signal(signal.SIGINT)
        _, output = parent.communicate(timeout=WAIT_S)
    finally:
        parent.kill()
        parent.wait()
    assert output.rstrip().endswith('KeyboardInterrupt')
    assert within_s(WAIT_S, lambda: not any((tmp_path / name).exists() for name in 'abcd'))


def test_an_exit_within_a_finaliser_is_raised_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'slow_task.py').write_text(SLOW_TASK)
    monkeypatch.syspath_prepend(tmp_path)
    interrupted = importlib.import_module('slow_task').interrupted_in_a_finaliser
    with pytest.raises(DataError, match='a process was killed'):
        parallel_map(interrupted, [(str(tmp_path / name),) for name in 'ab'], 2)
    # One worker may still be at work when the other is known to have ended.
    assert within_s(WAIT_S, lambda: not any((tmp_path / name).exists() for name in 'ab'))
    assert 'Traceback' not in capfd.readouterr().err


SLOW_TASK = """
import os, pathlib, signal, time, weakref

class Held:
    pass

def interrupted_in_a_finaliser(path):
    held = Held()
    weakref.finalize(held, os.kill, os.getpid(), signal.SIGTERM)
    del held
    slow(path)

def slow(path):
    mark = pathlib.Path(path)
    mark.touch()
    try:
        time.sleep(900)
    finally:
        mark.unlink()
"""


def workers_of(pid: int) -> list[int]:
    """Processes that `pid` has started, except the one that tracks its semaphores."""
    listed = Path(f'/proc/{pid}/task/{pid}/children').read_text().split()
    return [int(child) for child in listed if 'spawn_main' in Path(f'/proc/{child}/cmdline').read_text()]


def is_alive(pid: int) -> bool:
    """Whether a process exists and is not a zombie."""
    try:
        state = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state not in 'ZX'


def within_s(seconds: float, holds: Callable[[], bool]) -> bool:
    deadline_s = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > deadline_s:
            return False
        time.sleep(0.05)
    return True


def test_no_tasks() -> None:
    parallel_map(os.rmdir, [], 2)
