"""Parallel work by processes on the cores of this machine."""

from __future__ import annotations

import concurrent.futures
import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from types import FrameType
from typing import Any, TypeVar

import cv2

from offradar_ros.errors import DataError

Progress = Callable[[int, int], None]
ResultT = TypeVar('ResultT')

_TERMINATE_WAIT_S = 2.0
"""Longest wait for a worker to terminate."""
_RETRY_S = 0.01
_CLOSED = 'handle is closed'
"""Message of multiprocessing for a pipe that Python 3.11 closes if a worker dies while another is started."""

_ending = threading.Event()
"""Set in a worker that received SIGTERM: a task that is already in its queue cannot be cancelled otherwise."""
_exit_raised = threading.Event()
"""Set in a worker whose exit was raised and not dropped: another would interrupt the removal of partial files."""


def parallel_map(
    function: Callable[..., ResultT],
    tasks: Sequence[tuple[Any, ...]],
    processes: int = 0,
    progress: Progress | None = None,
) -> list[ResultT]:
    """Results of `function` for the arguments in each of `tasks`, in their order.

    `processes` work in parallel (0: one for each core); one process or one task runs in the calling process.
    `progress` is called with (done, total) after each task. The first error is raised, and tasks that have not started
    are cancelled. DataError for a process that was killed.
    """
    processes = min(len(tasks), processes or len(os.sched_getaffinity(0)))
    if processes < 2:
        results = []
        for done, task in enumerate(tasks, start=1):
            results.append(function(*task))
            if progress:
                progress(done, len(tasks))
        return results
    with worker_pool(processes) as pool:
        futures = [pool.submit(_run_unless_ending, function, task) for task in tasks]
        for done, future in enumerate(concurrent.futures.as_completed(futures), start=1):
            future.result()
            if progress:
                progress(done, len(tasks))
        return [future.result() for future in futures]


@contextlib.contextmanager
def worker_pool(
    processes: int, start: Callable[..., None] | None = None, arguments: Sequence[Any] = ()
) -> Iterator[ProcessPoolExecutor]:
    """New processes, with one OpenCV thread each, that call `start` with `arguments` before their first task.

    An error within the block cancels tasks that have not started; DataError for a process that was killed. Ctrl-C
    reaches the calling process only, which terminates the workers by an exception in their tasks, so that they remove
    partial files. Workers also end when the calling process dies.
    """
    before = set(multiprocessing.active_children())
    # A fork of a process with threads, which learned encoders start, may hang.
    context = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(processes, context, _initialise_worker, (start, *arguments)) as pool:
        try:
            yield pool
        except BaseException as error:
            pool.shutdown(wait=False, cancel_futures=True)
            if isinstance(error, KeyboardInterrupt):
                _terminate_all(set(multiprocessing.active_children()) - before)
            killed = isinstance(error, (concurrent.futures.BrokenExecutor, SystemExit))
            if killed or (isinstance(error, OSError) and error.args == (_CLOSED,)):
                raise DataError(f'a process was killed: expected more memory, or fewer than {processes}') from error
            raise


def _terminate_all(workers: set[multiprocessing.process.BaseProcess]) -> None:
    for worker in workers:
        worker.terminate()
    # Their queued tasks may use resources that the caller closes next.
    for worker in workers:
        worker.join(_TERMINATE_WAIT_S)


def _run_unless_ending(function: Callable[..., ResultT], task: tuple[Any, ...]) -> ResultT:
    if _ending.is_set():
        sys.exit(128 + signal.SIGTERM)
    return function(*task)


def _on_sigterm(_number: int, _frame: FrameType | None) -> None:
    _ending.set()
    _exit_raised.set()
    sys.exit(128 + signal.SIGTERM)


def _retry_dropped_exit(ignored: Any) -> None:
    """Python prints and drops an exception within a finaliser: if that was the exit, request it again."""
    if ignored.exc_type is SystemExit:
        _exit_raised.clear()
        threading.Timer(_RETRY_S, _exit_again).start()
    else:
        sys.__unraisablehook__(ignored)


def _exit_again() -> None:
    ident = threading.main_thread().ident
    if not _exit_raised.is_set() and ident is not None:
        signal.pthread_kill(ident, signal.SIGTERM)


def _initialise_worker(start: Callable[..., None] | None, *arguments: Any) -> None:
    cv2.setNumThreads(1)
    # Ctrl-C of a terminal reaches all of its processes.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _on_sigterm)
    sys.unraisablehook = _retry_dropped_exit
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if start is not None:
        start(*arguments)


def _end_with_parent() -> None:
    """End when the parent dies: workers share the pipe of tasks, so that its end would not close it."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
