"""A worker with a short queue: when a newer item comes, the oldest one that waits is dropped."""

from __future__ import annotations

import collections
import threading
import time
import traceback
from collections.abc import Callable
from typing import Generic, TypeVar

ItemT = TypeVar('ItemT')


class NewestWorker(Generic[ItemT]):
    """Handles items in its own thread, one by one and in order, while at most `backlog` others wait.

    One more, and the oldest one that waits is dropped: `overtaken` is called with it, in the thread of `put`. An
    exception of `handle` is printed and concerns that item only.
    """

    def __init__(self, handle: Callable[[ItemT], None], overtaken: Callable[[ItemT], None], backlog: int = 1) -> None:
        self._handle, self._overtaken, self._backlog = handle, overtaken, backlog
        self._waiting: collections.deque[ItemT] = collections.deque()
        self._busy = self._stopped = False
        self._begun_s = 0.0
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name='newest')
        self._thread.start()

    @property
    def busy_s(self) -> float:
        """How long the item in progress has been handled; 0 if there is none."""
        with self._changed:
            return time.monotonic() - self._begun_s if self._busy else 0.0

    def put(self, item: ItemT) -> bool:
        """Queue an item; False after `stop`, which ignores it. Never blocks for long."""
        dropped: list[ItemT] = []
        with self._changed:
            if self._stopped:
                return False
            self._waiting.append(item)
            while len(self._waiting) > self._backlog + (not self._busy):
                dropped.append(self._waiting.popleft())
            self._changed.notify_all()
        for each in dropped:
            self._overtaken(each)
        return True

    def forget(self) -> list[ItemT]:
        """Clear the queue, and return what waited when the item in progress is done; not to be called from `handle`."""
        with self._changed:
            forgotten = self._clear()
            self._changed.wait_for(lambda: not self._busy)
        return forgotten

    def stop(self) -> list[ItemT]:
        """Clear the queue, end the thread after the item in progress, and return what waited.

        May be called again, but not from `handle`.
        """
        with self._changed:
            self._stopped = True
            forgotten = self._clear()
            self._changed.notify_all()
        # Without a time-out: an interpreter that exits while the thread works may crash.
        self._thread.join()
        return forgotten

    def _clear(self) -> list[ItemT]:
        forgotten = list(self._waiting)
        self._waiting.clear()
        return forgotten

    def _work(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._waiting or self._stopped)
                if self._stopped:
                    return
                item = self._waiting.popleft()
                self._busy, self._begun_s = True, time.monotonic()
            try:
                self._handle(item)
            except Exception:
                traceback.print_exc()
            # Otherwise its 1.5 MB stay in memory until the next item comes.
            del item
