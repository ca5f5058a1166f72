"""Long work shared out to processes of this machine's cores."""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import cv2

from offradar_ros.errors import DataError

Progress = Callable[[int, int], None]
ResultT = TypeVar('ResultT')


def shared_out(
    function: Callable[..., ResultT],
    tasks: Sequence[tuple[Any, ...]],
    processes: int = 0,
    progress: Progress | None = None,
) -> list[ResultT]:
    """What `function` returns for each of `tasks`, by so many `processes` (0: one a core); with one it is done here.

    `progress` is told (done, all) after each. The first error ends it and what has not begun is never done; DataError
    for a process that was killed. Ctrl-C reaches this process alone, which ends the others; they also end when it dies.
    """
    processes = min(len(tasks), processes or len(os.sched_getaffinity(0)))
    if processes < 2:
        results = []
        for done, task in enumerate(tasks, start=1):
            results.append(function(*task))
            if progress:
                progress(done, len(tasks))
        return results
    # Fresh processes: a fork of one that runs threads, as learned encoders do, may hang.
    context = multiprocessing.get_context('spawn')
    with concurrent.futures.ProcessPoolExecutor(processes, context, initializer=_start) as pool:
        futures = [pool.submit(function, *task) for task in tasks]
        try:
            for done, future in enumerate(concurrent.futures.as_completed(futures), start=1):
                future.result()
                if progress:
                    progress(done, len(tasks))
        except concurrent.futures.BrokenExecutor as error:
            raise DataError(f'a process was killed: expected more memory, or fewer than {processes}') from error
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        return [future.result() for future in futures]


def _start() -> None:
    cv2.setNumThreads(1)
    # A terminal's Ctrl-C reaches every process of it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Workers wait for work on a pipe that they hold open for each other: of a dead parent they would hear nothing."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
