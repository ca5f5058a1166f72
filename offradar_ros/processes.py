"""Long work shared out to processes of this machine's cores."""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures.process import BrokenProcessPool
from types import FrameType
from typing import Any, TypeVar

import cv2

from offradar_ros.errors import DataError

Progress = Callable[[int, int], None]
ResultT = TypeVar('ResultT')


class WorkerPool(concurrent.futures.ProcessPoolExecutor):
    """Fresh processes, which use one thread each for images, ignore Ctrl-C and end when this process does.

    Each calls `start` with `arguments` before its first task. BrokenProcessPool is raised wherever one of them died.
    """

    def __init__(self, processes: int, start: Callable[..., None] | None = None, arguments: Sequence[Any] = ()) -> None:
        # A fork of a process that runs threads, as learned encoders do, may hang.
        super().__init__(processes, multiprocessing.get_context('spawn'), _start, (start, *arguments))

    def submit(
        self, function: Callable[..., ResultT], /, *arguments: Any, **named: Any
    ) -> concurrent.futures.Future[ResultT]:
        """As of any executor."""
        try:
            return super().submit(function, *arguments, **named)
        except OSError as error:
            # One died while another was being started: Python 3.11 then closes what that one is handed. The system's
            # own errors have a number.
            if error.errno is not None:
                raise
            raise BrokenProcessPool('a process died while another was being started') from error


def shared_out(
    function: Callable[..., ResultT],
    tasks: Sequence[tuple[Any, ...]],
    processes: int = 0,
    progress: Progress | None = None,
) -> list[ResultT]:
    """What `function` returns for each of `tasks`, by so many `processes` (0: one a core); with one it is done here.

    `progress` is told (done, all) after each. The first error ends it and what has not begun is never done; DataError
    for a process that was killed. Ctrl-C reaches this process alone, which ends the others amid their tasks, by an
    exception, so that they tidy up; they also end when it dies.
    """
    processes = min(len(tasks), processes or len(os.sched_getaffinity(0)))
    if processes < 2:
        results = []
        for done, task in enumerate(tasks, start=1):
            results.append(function(*task))
            if progress:
                progress(done, len(tasks))
        return results
    before = set(multiprocessing.active_children())
    with WorkerPool(processes) as pool:
        try:
            futures = [pool.submit(_done, function, task) for task in tasks]
            for done, future in enumerate(concurrent.futures.as_completed(futures), start=1):
                future.result()
                if progress:
                    progress(done, len(tasks))
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            workers = set(multiprocessing.active_children()) - before
            for worker in workers:
                worker.terminate()
            # What they still take from their queue may need what the caller is about to close.
            for worker in workers:
                worker.join(_END_S)
            raise
        except (concurrent.futures.BrokenExecutor, SystemExit) as error:
            raise DataError(f'a process was killed: expected more memory, or fewer than {processes}') from error
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        return [future.result() for future in futures]


_END_S = 2.0
"""So long is waited for a worker that was asked to end."""

_ENDED = threading.Event()
"""In a worker: that it was asked to end. The task that is then in its queue already cannot be cancelled."""


def _done(function: Callable[..., ResultT], task: tuple[Any, ...]) -> ResultT:
    if _ENDED.is_set():
        sys.exit(128 + signal.SIGTERM)
    return function(*task)


def _end(_number: int, _frame: FrameType | None) -> None:
    _ENDED.set()
    sys.exit(128 + signal.SIGTERM)


def _start(start: Callable[..., None] | None, *arguments: Any) -> None:
    cv2.setNumThreads(1)
    # A terminal's Ctrl-C reaches every process of it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if start is not None:
        start(*arguments)


def _end_with_parent() -> None:
    """Workers wait for work on a pipe that they hold open for each other: of a dead parent they would hear nothing."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
