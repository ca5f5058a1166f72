"""One progress bar for several processes, each of which does one task at a time."""

import contextlib
import multiprocessing
import signal
import threading
from collections.abc import Callable, Iterator
from multiprocessing.managers import SyncManager
from queue import Queue
from typing import Optional

Shares = Queue[Optional[float]]
"""Carries the shares of tasks that processes have done; all shares of one task add up to 1."""


@contextlib.contextmanager
def joint_progress(progress: Callable[[float, float], None], tasks: int) -> Iterator[Shares]:
    """Yields a queue for the processes; `progress` gets (tasks done, tasks), with fractions of tasks."""
    progress(0.0, tasks)
    manager = SyncManager(ctx=multiprocessing.get_context('spawn'))
    # A terminal sends Ctrl-C to this process too.
    manager.start(signal.signal, (signal.SIGINT, signal.SIG_IGN))
    with manager:
        shares: Shares = manager.Queue()
        reader = threading.Thread(target=_add_up, args=(shares, progress, tasks))
        reader.start()
        try:
            yield shares
        finally:
            shares.put(None)
            reader.join()
    progress(tasks, tasks)


def share_reporter(shares: Shares) -> Callable[[int, int], None]:
    """A function of (done, total), to be called once for each of the `total` parts of a task."""

    def report(_done: int, total: int) -> None:
        shares.put(1.0 / total)

    return report


def _add_up(shares: Shares, progress: Callable[[float, float], None], tasks: int) -> None:
    done = 0.0
    while (share := shares.get()) is not None:
        done += share
        # Rounded, because the parts of a task add up to nearly 1.
        progress(min(round(done, 6), tasks), tasks)
