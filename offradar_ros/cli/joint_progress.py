"""One progress bar of what several processes do at once, each on a task of its own."""

import contextlib
import multiprocessing
import signal
import threading
from collections.abc import Callable, Iterator
from multiprocessing.managers import SyncManager
from queue import Queue
from typing import Optional

Shares = Queue[Optional[float]]
"""Takes the share of its task that a process has just done; all shares of a task add up to 1."""


@contextlib.contextmanager
def joint_progress(progress: Callable[[float, float], None], tasks: int) -> Iterator[Shares]:
    """Yields what may be sent to the processes; `progress` is told (tasks done, tasks), fractions of them included."""
    progress(0.0, tasks)
    manager = SyncManager(ctx=multiprocessing.get_context('spawn'))
    # A terminal's Ctrl-C reaches every process of it.
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


def telling(shares: Shares) -> Callable[[int, int], None]:
    """A function of (done, total), to be called once for each of the task's `total` parts."""

    def tell(_done: int, total: int) -> None:
        shares.put(1.0 / total)

    return tell


def _add_up(shares: Shares, progress: Callable[[float, float], None], tasks: int) -> None:
    done = 0.0
    while (share := shares.get()) is not None:
        done += share
        # Rounded, so that parts that add up to a task show as one.
        progress(min(round(done, 6), tasks), tasks)
