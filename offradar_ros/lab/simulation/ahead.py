"""Simulated scans made ahead by several processes, in order."""

from __future__ import annotations

import collections
import concurrent.futures
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from offradar_ros.geometry import Trajectory
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.processes import worker_pool
from offradar_ros.types import PolarScan

T = TypeVar('T')

_AHEAD = 4
"""Scans that are waiting or being made, for each process."""

_job: tuple[SimulatedSequence, Callable[[PolarScan], object]]


def made_ahead(sequence: SimulatedSequence, make: Callable[[PolarScan], T], workers: int) -> Iterator[T]:
    """`make(scan)` of every scan, in order; the same whatever the number of processes, 1 for this one alone.

    `make` is a function of a module, and what it returns travels between processes. DataError where one was killed.
    """
    if workers <= 1 or len(sequence) < 2:
        yield from (make(sequence.scan(index)) for index in range(len(sequence)))
        return
    with worker_pool(workers, _start, (sequence, make)) as pool:
        waiting: collections.deque[concurrent.futures.Future[Any]] = collections.deque()
        for index in range(len(sequence)):
            waiting.append(pool.submit(_made, index))
            if len(waiting) >= _AHEAD * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _start(sequence: SimulatedSequence, make: Callable[[PolarScan], object]) -> None:
    global _job  # noqa: PLW0603
    _job = sequence, make


def _made(index: int) -> object:
    sequence, make = _job
    return make(sequence.scan(index))


class ScansAhead:
    """A simulated sequence whose scans several processes make; they can be asked for once each, in order."""

    def __init__(self, sequence: SimulatedSequence, workers: int) -> None:
        self._sequence = sequence
        self._scans = enumerate(made_ahead(sequence, _as_it_is, workers))
        self.name, self.layout = sequence.name, sequence.layout
        self.stamps_ns: NDArray[np.int64] = sequence.stamps_ns
        self.trajectory: Trajectory = sequence.trajectory

    def __len__(self) -> int:
        return len(self._sequence)

    def scan(self, index: int) -> PolarScan:
        """The next scan; IndexError for any other."""
        at, scan = next(self._scans, (-1, None))
        if at != index or scan is None:
            raise IndexError(f'scan {index}: scans made ahead are given once each, in order')
        return scan


def _as_it_is(scan: PolarScan) -> PolarScan:
    return scan
