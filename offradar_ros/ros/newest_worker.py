"""A worker that never falls behind by more than a few: what waits for it too long is dropped for what is newer."""

from __future__ import annotations

import collections
import threading
import traceback
from collections.abc import Callable
from typing import Generic, TypeVar

ItemT = TypeVar('ItemT')


class NewestWorker(Generic[ItemT]):
    """Handles items in a thread of its own, one by one and in order, while at most `backlog` others wait.

    One more makes the oldest that waits be dropped: `overtaken` is called with it, in the thread of `put`. An exception
    of `handle` is printed and costs that item only.
    """

    def __init__(self, handle: Callable[[ItemT], None], overtaken: Callable[[ItemT], None], backlog: int = 1) -> None:
        self._handle, self._overtaken, self._backlog = handle, overtaken, backlog
        self._waiting: collections.deque[ItemT] = collections.deque()
        self._busy = self._stopped = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name='newest')
        self._thread.start()

    def put(self, item: ItemT) -> None:
        """Let an item wait; after `stop`, forget it. Never blocks for long."""
        dropped: list[ItemT] = []
        with self._changed:
            if self._stopped:
                return
            self._waiting.append(item)
            while len(self._waiting) > self._backlog + (not self._busy):
                dropped.append(self._waiting.popleft())
            self._changed.notify_all()
        for each in dropped:
            self._overtaken(each)

    def forget(self) -> None:
        """Forget what waits, and return when nothing is in hand any more; not from `handle`."""
        with self._changed:
            self._waiting.clear()
            self._changed.wait_for(lambda: not self._busy)

    def stop(self) -> None:
        """Forget what waits and end the thread, after what it has in hand; may be called again, not from `handle`."""
        with self._changed:
            self._stopped = True
            self._waiting.clear()
            self._changed.notify_all()
        # However long that takes: an interpreter that ends under a working thread may crash.
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._waiting or self._stopped)
                if self._stopped:
                    return
                item = self._waiting.popleft()
                self._busy = True
            try:
                self._handle(item)
            except Exception:
                traceback.print_exc()
            # Else it lives on, 1.5 MB of it, until the next one comes.
            del item
