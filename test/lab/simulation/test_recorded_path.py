"""Recorded paths: read from TUM files, and driven as recorded."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.motion import PathMotion, RouteMotion
from offradar_ros.lab.simulation.recorded_path import RecordedPath, load_tum
from offradar_ros.lab.simulation.route import Route
from offradar_ros.lab.simulation.sensor import SimulatedSensor
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan

Array = NDArray[np.float64]


def write_tum(path: Path, seconds: Array, poses: Array) -> Path:
    lines = [
        f'{t:.6f} {x:.6f} {y:.6f} 0 0 0 {math.sin(yaw / 2):.9f} {math.cos(yaw / 2):.9f}'
        for t, (x, y, yaw) in zip(seconds.tolist(), poses.tolist(), strict=True)
    ]
    path.write_text('# a comment\n' + '\n'.join(lines) + '\n')
    return path


@given(
    st.lists(
        st.tuples(
            st.floats(0.01, 5.0), st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(-math.pi + 1e-6, math.pi - 1e-6)
        ),
        min_size=2,
        max_size=20,
    )
)
@settings(max_examples=40, deadline=None)
def test_a_path_is_read_as_it_was_written(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, ...]]
) -> None:
    table = np.array(rows, np.float64)
    # Within reach of a vehicle, and never twice the same position, which a receiver would hold.
    table[:, 1:3] += np.column_stack([1e4 + 0.001 * np.arange(len(table)), np.full(len(table), -1e4)])
    seconds = np.cumsum(table[:, 0])
    path = load_tum(write_tum(tmp_path_factory.mktemp('tum') / 'drive.tum', seconds, table[:, 1:]))
    np.testing.assert_allclose(path.seconds, seconds - seconds[0], atol=2e-6)
    np.testing.assert_allclose(path.poses[:, :2], table[:, 1:3], atol=1e-6)
    np.testing.assert_allclose(np.exp(1j * path.poses[:, 2]), np.exp(1j * table[:, 3]), atol=1e-6)
    assert np.abs(np.diff(path.poses[:, 2])).max() <= math.pi + 1e-9


@pytest.mark.parametrize(
    'text', ['', '0 0 0 0 0 0 0 1\n', '0 0 0\n', '0 0 0 0 0 0 0 0\n1 0 0 0 0 0 0 0\n', '1 a 0 0 0 0 0 1\n']
)
def test_a_damaged_file_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / 'drive.tum').write_text(text)
    with pytest.raises(DataError, match=r'drive\.tum'):
        load_tum(tmp_path / 'drive.tum')


@pytest.fixture
def path() -> RecordedPath:
    """Five seconds at rest, 10 m/s for ten seconds eastwards, then five seconds at rest."""
    seconds = np.arange(0.0, 20.25, 0.25)
    return RecordedPath(seconds, np.column_stack([10.0 * np.clip(seconds - 5.0, 0.0, 10.0), 0 * seconds, 0 * seconds]))


def test_a_path_may_stand_still(path: RecordedPath) -> None:
    assert path.duration_s == 20.0 and path.scans() == 80
    assert path.driven_m[-1] == pytest.approx(100.0)
    assert path.seconds_at(0.0) == 0.0 and path.seconds_at(50.0) == pytest.approx(10.0)
    assert path.scans(0.25, start_m=50.0) == 40
    assert path.route().length_m == pytest.approx(100.0, abs=3.0)
    standing = RecordedPath(np.array([0.0, 9.0]), np.zeros((2, 3)))
    assert standing.route().length_m > 0.0


def test_a_path_is_driven_at_its_speed_with_a_lane_offset_and_backwards(path: RecordedPath) -> None:
    at = np.array([0.0, 2.0, 7.0, 30.0])
    np.testing.assert_allclose(
        PathMotion(SessionPlan(left_m=2.0), path).at(at), [(0, 2, 0), (0, 2, 0), (20, 2, 0), (100, 2, 0)], atol=1e-9
    )
    np.testing.assert_allclose(PathMotion(SessionPlan(start_m=40.0), path).at(at)[:, 0], [40, 60, 100, 100], atol=1e-9)
    back = PathMotion(SessionPlan(left_m=2.0, reverse=True, start_m=100.0), path).at(at)
    np.testing.assert_allclose(back, [(100, -2, np.pi), (80, -2, np.pi), (30, -2, np.pi), (0, -2, np.pi)], atol=1e-9)


def test_a_city_may_be_driven_along_a_path(path: RecordedPath) -> None:
    city = make_city(CityPlan(seed=1, blocks=(2, 2), route_m=400.0))
    assert city.route is not None
    start = city.route.at(np.array([30.0]))[0]
    moved = RecordedPath(path.seconds, np.column_stack([city.route.at(30.0 + path.poses[:, 0])]))
    sequence = SimulatedSequence(city, SessionPlan(path=moved, scans=moved.scans()), SimulatedSensor(100, 100, 1.0))
    np.testing.assert_allclose(sequence.poses[:19], np.tile(start, (19, 1)), atol=1e-9)
    np.testing.assert_allclose(sequence.poses, moved.at(0.125 + 0.25 * np.arange(80.0)), atol=1e-9)
    assert sequence.scan(40).power.max() > 40


def test_a_stop_lasts_some_seconds_and_the_drive_goes_on() -> None:
    route = Route(np.array([(0.0, 0.0), (5000.0, 0.0)]), closed=False)
    at = np.arange(0.0, 200.0, 0.1)
    for seed in range(5):
        motions = [RouteMotion(SessionPlan(seed=seed, stops=n), route, None, 200.0) for n in (0, 2)]
        speeds = [np.hypot(*np.diff(motion.at(at)[:, :2], axis=0).T) / 0.1 for motion in motions]
        assert speeds[0].min() > 6.5
        still = np.count_nonzero(speeds[1] < 0.05) / 10
        assert 3.0 < still < 26.0
        assert np.abs(np.diff(speeds[1])).max() < 0.5
