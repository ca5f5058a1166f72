"""Long work in parallel, by processes of this machine's cores."""

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

_END_S = 2.0
"""Longest wait for a worker that was asked to end."""
_AGAIN_S = 0.01
_CLOSED = 'handle is closed'
"""What multiprocessing says of a pipe that Python 3.11 closes because one worker died while another was started."""

_ending = threading.Event()
"""In a worker: it was asked to end. The task that is then in its queue already cannot be cancelled."""
_exit_raised = threading.Event()
"""In a worker: its exit was raised, and not dropped. Another would interrupt the removal of partial files."""


def parallel_map(
    function: Callable[..., ResultT],
    tasks: Sequence[tuple[Any, ...]],
    processes: int = 0,
    progress: Progress | None = None,
) -> list[ResultT]:
    """What `function` returns for each of `tasks`, in their order, by so many `processes` (0: one a core).

    With one process, or one task, it is done in this one. `progress` is called with (done, all) after each. The first
    error ends it: what has not begun is never done. DataError for a process that was killed.
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
        futures = [pool.submit(_unless_ending, function, task) for task in tasks]
        for done, future in enumerate(concurrent.futures.as_completed(futures), start=1):
            future.result()
            if progress:
                progress(done, len(tasks))
        return [future.result() for future in futures]


@contextlib.contextmanager
def worker_pool(
    processes: int, start: Callable[..., None] | None = None, arguments: Sequence[Any] = ()
) -> Iterator[ProcessPoolExecutor]:
    """Fresh processes, each with one thread for images, that call `start` with `arguments` before their first task.

    An error within the block cancels what has not begun; DataError for a process that was killed. Ctrl-C reaches this
    process alone, which ends the others amid their tasks, by an exception, so that they remove partial files. They
    also end when this process dies.
    """
    before = set(multiprocessing.active_children())
    # A fork of a process that runs threads, as learned encoders do, may hang.
    context = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(processes, context, _start, (start, *arguments)) as pool:
        try:
            yield pool
        except BaseException as error:
            pool.shutdown(wait=False, cancel_futures=True)
            if isinstance(error, KeyboardInterrupt):
                _end_all(set(multiprocessing.active_children()) - before)
            killed = isinstance(error, (concurrent.futures.BrokenExecutor, SystemExit))
            if killed or (isinstance(error, OSError) and error.args == (_CLOSED,)):
                raise DataError(f'a process was killed: expected more memory, or fewer than {processes}') from error
            raise


def _end_all(workers: set[multiprocessing.process.BaseProcess]) -> None:
    for worker in workers:
        worker.terminate()
    # What they still take from their queue may need what the caller is about to close.
    for worker in workers:
        worker.join(_END_S)


def _unless_ending(function: Callable[..., ResultT], task: tuple[Any, ...]) -> ResultT:
    if _ending.is_set():
        sys.exit(128 + signal.SIGTERM)
    return function(*task)


def _end(_number: int, _frame: FrameType | None) -> None:
    _ending.set()
    _exit_raised.set()
    sys.exit(128 + signal.SIGTERM)


def _end_after_all(ignored: Any) -> None:
    """Python drops an exception that is raised within a finaliser, and prints it: the exit is asked for once more."""
    if ignored.exc_type is SystemExit:
        _exit_raised.clear()
        threading.Timer(_AGAIN_S, _end_again).start()
    else:
        sys.__unraisablehook__(ignored)


def _end_again() -> None:
    ident = threading.main_thread().ident
    if not _exit_raised.is_set() and ident is not None:
        signal.pthread_kill(ident, signal.SIGTERM)


def _start(start: Callable[..., None] | None, *arguments: Any) -> None:
    cv2.setNumThreads(1)
    # A terminal's Ctrl-C reaches every process of it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)
    sys.unraisablehook = _end_after_all
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if start is not None:
        start(*arguments)


def _end_with_parent() -> None:
    """Workers wait for tasks on a pipe that they hold open for each other: a dead parent does not close it."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
