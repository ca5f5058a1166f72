"""Scans rendered by several processes, and pictures of worlds."""

from __future__ import annotations

import functools
import operator
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from offradar_ros.errors import DataError
from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.picture import Panel, draw_worlds
from offradar_ros.lab.simulation.prefetch import PrefetchedSequence, prefetch
from offradar_ros.lab.simulation.sensor import SimulatedSensor
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.types import PolarScan


@pytest.fixture(scope='module')
def drive() -> SimulatedSequence:
    city = make_city(CityPlan(seed=2, blocks=(1, 1), route_m=200.0))
    return SimulatedSequence(city, SessionPlan(scans=12, degraded=0.3), SimulatedSensor(100, 64, 1.0))


class Killer:
    """Ends the process that unpickles it."""

    def __reduce__(self) -> tuple[object, tuple[int]]:
        return os._exit, (1,)


def stamp_and_sum(scan: PolarScan) -> tuple[int, int]:
    return scan.stamp_ns, int(scan.power.sum())


def test_processes_give_the_same_scans_in_the_same_order(drive: SimulatedSequence) -> None:
    expected = [stamp_and_sum(drive.scan(index)) for index in range(12)]
    for workers in (1, 2):
        prefetched = PrefetchedSequence(drive, workers)
        assert [stamp_and_sum(prefetched.scan(index)) for index in range(len(prefetched))] == expected


def test_an_error_in_another_process_is_raised_here(drive: SimulatedSequence) -> None:
    with pytest.raises(AttributeError, match='no_such_thing'):
        list(prefetch(drive, operator.attrgetter('no_such_thing'), 2))


def test_a_killed_process_is_reported(drive: SimulatedSequence) -> None:
    with pytest.raises(DataError, match='a process was killed: expected more memory, or fewer than 2'):
        list(prefetch(drive, functools.partial(print, Killer()), 2))


def test_prefetched_scans_are_read_once_and_in_order(drive: SimulatedSequence) -> None:
    prefetched = PrefetchedSequence(drive, 1)
    prefetched.scan(0)
    with pytest.raises(IndexError):
        prefetched.scan(5)
    finished = PrefetchedSequence(drive, 1)
    for index in range(12):
        finished.scan(index)
    with pytest.raises(IndexError):
        finished.scan(12)


def test_worlds_are_drawn_with_their_drives(drive: SimulatedSequence, tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    city = make_city(CityPlan(seed=2, blocks=(1, 1), route_m=200.0))
    panels = [Panel('all', city), Panel('near', city, (drive.poses,), 60.0)]
    draw_worlds(tmp_path / 'worlds.png', panels)
    picture = cv2.imread(str(tmp_path / 'worlds.png'))
    assert picture is not None
    left, right = picture[:, : picture.shape[1] // 2], picture[:, picture.shape[1] // 2 :]
    for half in (left, right):
        red = (half[..., 2] > 180) & (half[..., 0] < 90) & (half[..., 1] < 90)
        assert np.count_nonzero(red) > 100
