"""Scans made by several processes, and pictures of worlds."""

from __future__ import annotations

import functools
import operator
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from offradar_ros.errors import DataError
from offradar_ros.lab.simulation.ahead import ScansAhead, made_ahead
from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.picture import Panel, draw_worlds
from offradar_ros.lab.simulation.sensor import SimulatedSensor
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.types import PolarScan


@pytest.fixture(scope='module')
def drive() -> SimulatedSequence:
    city = make_city(CityPlan(seed=2, blocks=(1, 1), route_m=200.0))
    return SimulatedSequence(city, SessionPlan(scans=12, degraded=0.3), SimulatedSensor(100, 64, 1.0))


class Dies:
    """Ends the process that it arrives at."""

    def __reduce__(self) -> tuple[object, tuple[int]]:
        return os._exit, (1,)


def stamp_and_sum(scan: PolarScan) -> tuple[int, int]:
    return scan.stamp_ns, int(scan.power.sum())


def test_processes_give_the_same_in_the_same_order(drive: SimulatedSequence) -> None:
    expected = [stamp_and_sum(drive.scan(index)) for index in range(12)]
    for workers in (1, 2):
        ahead = ScansAhead(drive, workers)
        assert [stamp_and_sum(ahead.scan(index)) for index in range(len(ahead))] == expected


def test_an_error_of_another_process_arrives(drive: SimulatedSequence) -> None:
    with pytest.raises(AttributeError, match='no_such_thing'):
        list(made_ahead(drive, operator.attrgetter('no_such_thing'), 2))


def test_a_process_that_dies_is_named(drive: SimulatedSequence) -> None:
    with pytest.raises(DataError, match='a process was killed: expected more memory, or fewer than 2'):
        list(made_ahead(drive, functools.partial(print, Dies()), 2))


def test_scans_made_ahead_are_given_once_and_in_order(drive: SimulatedSequence) -> None:
    ahead = ScansAhead(drive, 1)
    ahead.scan(0)
    with pytest.raises(IndexError):
        ahead.scan(5)
    ended = ScansAhead(drive, 1)
    for index in range(12):
        ended.scan(index)
    with pytest.raises(IndexError):
        ended.scan(12)


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
