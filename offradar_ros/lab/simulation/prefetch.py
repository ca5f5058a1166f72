"""Simulated scans rendered in advance by several processes, in order."""

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

_PER_WORKER = 4
"""Scans that are rendered or waiting, for each process."""

_job: tuple[SimulatedSequence, Callable[[PolarScan], object]]


def prefetch(sequence: SimulatedSequence, convert: Callable[[PolarScan], T], workers: int) -> Iterator[T]:
    """`convert(scan)` of every scan, in order, by `workers` processes; with 1 in this process.

    The result does not depend on the number of processes. `convert` and what it returns must be picklable. DataError
    if a process was killed.
    """
    if workers <= 1 or len(sequence) < 2:
        yield from (convert(sequence.scan(index)) for index in range(len(sequence)))
        return
    with worker_pool(workers, _start, (sequence, convert)) as pool:
        waiting: collections.deque[concurrent.futures.Future[Any]] = collections.deque()
        for index in range(len(sequence)):
            waiting.append(pool.submit(_converted, index))
            if len(waiting) >= _PER_WORKER * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _start(sequence: SimulatedSequence, convert: Callable[[PolarScan], object]) -> None:
    global _job  # noqa: PLW0603
    _job = sequence, convert


def _converted(index: int) -> object:
    sequence, convert = _job
    return convert(sequence.scan(index))


class PrefetchedSequence:
    """A simulated sequence whose scans several processes render; each can be read once, in order."""

    def __init__(self, sequence: SimulatedSequence, workers: int) -> None:
        self._sequence = sequence
        self._scans = enumerate(prefetch(sequence, _unchanged, workers))
        self.name, self.layout = sequence.name, sequence.layout
        self.stamps_ns: NDArray[np.int64] = sequence.stamps_ns
        self.trajectory: Trajectory = sequence.trajectory

    def __len__(self) -> int:
        return len(self._sequence)

    def scan(self, index: int) -> PolarScan:
        """The next scan; IndexError for any other."""
        at, scan = next(self._scans, (-1, None))
        if at != index or scan is None:
            raise IndexError(f'scan {index}: prefetched scans can be read once each, in order')
        return scan


def _unchanged(scan: PolarScan) -> PolarScan:
    return scan
