"""The newest is handled, what it overtakes is dropped and reported, and nothing stops the worker but `stop`."""

from __future__ import annotations

import gc
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from offradar_ros.ros.newest_worker import NewestWorker

WAIT_S = 60.0


class Slow:
    """A handler that takes up each item, and lays it down when it may."""

    def __init__(self) -> None:
        self.begun: list[Any] = []
        self.done: list[Any] = []
        self._taken_up, self._lay_down = threading.Semaphore(0), threading.Semaphore(0)

    def __call__(self, item: Any) -> None:
        self.begun.append(item)
        self._taken_up.release()
        assert self._lay_down.acquire(timeout=WAIT_S)
        self.done.append(item)

    def wait_until_busy(self) -> None:
        assert self._taken_up.acquire(timeout=WAIT_S)

    def finish(self, count: int = 1) -> None:
        self._lay_down.release(count)


@pytest.fixture
def make() -> Iterator[Callable[..., NewestWorker[Any]]]:
    made: list[NewestWorker[Any]] = []

    def make(handle: Callable[[Any], None], *arguments: Any) -> NewestWorker[Any]:
        made.append(NewestWorker(handle, *arguments))
        return made[-1]

    yield make
    for worker in made:
        worker.stop()


@pytest.mark.parametrize(('backlog', 'answered'), [(1, [0, 9]), (3, [0, 7, 8, 9])])
def test_an_overtaken_item_is_dropped_and_reported(
    make: Callable[..., NewestWorker[int]], backlog: int, answered: list[int]
) -> None:
    slow, overtaken = Slow(), list[int]()
    worker = make(slow, overtaken.append, backlog)
    worker.put(0)
    slow.wait_until_busy()
    for item in range(1, 10):
        worker.put(item)
    slow.finish(len(answered))
    for _ in answered[1:]:
        slow.wait_until_busy()
    worker.forget()
    assert slow.done == answered
    assert overtaken == [item for item in range(10) if item not in answered]


def test_an_item_for_an_idle_worker_overtakes_nothing(make: Callable[..., NewestWorker[int]]) -> None:
    slow, overtaken = Slow(), list[int]()
    worker = make(slow, overtaken.append)
    slow.finish(100)
    for item in range(100):
        worker.put(item)
        slow.wait_until_busy()
    worker.forget()
    assert slow.done == list(range(100))
    assert overtaken == []


def test_an_exception_concerns_one_item(
    make: Callable[..., NewestWorker[int]], capfd: pytest.CaptureFixture[str]
) -> None:
    handled = threading.Semaphore(0)
    seen: list[int] = []

    def handle(item: int) -> None:
        seen.append(item)
        handled.release()
        if item == 1:
            raise ValueError('damaged')

    worker = make(handle, lambda item: None)
    for item in range(3):
        worker.put(item)
        assert handled.acquire(timeout=WAIT_S)
    assert seen == [0, 1, 2]
    assert 'ValueError: damaged' in capfd.readouterr().err


def returns_when_finished(slow: Slow, call: Callable[[], list[Any]]) -> list[Any]:
    """Check that the call waits for the item that `slow` handles; returns what it returned."""
    returned: list[Any] = []
    calling = threading.Thread(target=lambda: returned.extend(call()))
    calling.start()
    time.sleep(0.05)
    assert calling.is_alive()
    slow.finish()
    calling.join(WAIT_S)
    assert not calling.is_alive()
    return returned


def test_stop_waits_for_the_item_in_progress_and_forgets_the_rest(make: Callable[..., NewestWorker[int]]) -> None:
    slow, overtaken = Slow(), list[int]()
    worker = make(slow, overtaken.append)
    worker.put(0)
    slow.wait_until_busy()
    worker.put(1)
    assert worker.busy_s > 0.0
    assert returns_when_finished(slow, worker.stop) == [1]
    assert not worker.put(2)
    assert worker.stop() == []
    assert worker.busy_s == 0.0
    assert slow.begun == slow.done == [0]
    assert overtaken == []


def test_forget_waits_for_the_item_in_progress_and_the_worker_continues(make: Callable[..., NewestWorker[int]]) -> None:
    slow = Slow()
    worker = make(slow, lambda item: None)
    worker.put(0)
    slow.wait_until_busy()
    worker.put(1)
    assert returns_when_finished(slow, worker.forget) == [1]
    assert slow.done == [0]
    assert worker.put(2)
    slow.wait_until_busy()
    slow.finish()
    worker.forget()
    assert slow.done == [0, 2]


def test_no_item_but_the_waiting_ones_is_kept(make: Callable[..., NewestWorker[Any]]) -> None:
    class Scan:
        """Has weak references, unlike a number."""

    begun, go_on = threading.Semaphore(0), threading.Event()

    def handle(item: Scan) -> None:
        begun.release()
        assert go_on.wait(WAIT_S)

    worker = make(handle, lambda item: None, 2)
    scans = [Scan() for _ in range(50)]
    alive = [weakref.ref(scan) for scan in scans]
    worker.put(scans.pop(0))
    assert begun.acquire(timeout=WAIT_S)
    while scans:
        worker.put(scans.pop(0))
    gc.collect()
    assert sum(reference() is not None for reference in alive) == 3
    go_on.set()
    for _ in range(2):
        assert begun.acquire(timeout=WAIT_S)
    worker.forget()
    gc.collect()
    assert not any(reference() is not None for reference in alive)
