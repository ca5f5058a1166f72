"""What is a position and what is a stamp."""

from __future__ import annotations

import math

import pytest

from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import GeoPoint
from offradar_ros.positions.rules import END_NS, geo_point, require_accurate, require_pose, require_stamp
from offradar_ros.types import Pose


@pytest.mark.parametrize(
    ('latitude', 'longitude', 'cause'),
    [
        (0.0, 0.0, 'no_fix'),
        (-0.0, 0.0, 'no_fix'),
        (1e-9, -1e-7, 'no_fix'),
        (5e-324, 5e-324, 'no_fix'),
        (math.nan, -1.25, 'no_fix'),
        (51.75, math.nan, 'no_fix'),
        (math.nan, math.nan, 'no_fix'),
        (math.inf, -1.25, 'invalid_position'),
        (51.75, -math.inf, 'invalid_position'),
        (999.0, 999.0, 'invalid_position'),
        (-999.0, -1.25, 'invalid_position'),
        (1e10, 1e10, 'invalid_position'),
        (90.0, 180.0, 'invalid_position'),
        (-90.0, 0.0, 'invalid_position'),
        (51.75, 180.001, 'invalid_position'),
        (517_520_000.0, -12_577_000.0, 'invalid_position'),
    ],
)
def test_what_is_no_position(latitude: float, longitude: float, cause: str) -> None:
    with pytest.raises(RefusedInput) as refused:
        geo_point(latitude, longitude, 60.0)
    assert refused.value.cause == cause
    assert '\n' not in str(refused.value)


@pytest.mark.parametrize(('latitude', 'longitude'), [(51.75, -1.25), (0.0, 9.45), (51.48, 0.0), (-17.8, 180.0)])
def test_what_is_a_position(latitude: float, longitude: float) -> None:
    assert geo_point(latitude, longitude, 60.0) == GeoPoint(latitude, longitude, 60.0)


@pytest.mark.parametrize('altitude', [math.nan, math.inf, -math.inf, 1e10, -99_999.0])
def test_an_altitude_that_is_none_is_that_of_a_2d_fix(altitude: float) -> None:
    assert geo_point(51.75, -1.25, altitude) == GeoPoint(51.75, -1.25, 0.0)


@pytest.mark.parametrize('bad', [math.nan, math.inf, -1e10, 1e30])
@pytest.mark.parametrize('axis', ['x_m', 'y_m', 'z_m'])
def test_metres_are_finite_and_on_the_earth(bad: float, axis: str) -> None:
    values = {'x_m': 350_000.0, 'y_m': 4_000_000.0, 'z_m': 20.0}
    assert require_pose(Pose(**values)) == Pose(**values)
    with pytest.raises(RefusedInput) as refused:
        require_pose(Pose(**values | {axis: bad}))
    assert refused.value.cause == 'invalid_position'


@pytest.mark.parametrize('variances_m2', [(10_201.0, 1.0), (1.0, 10_201.0), (math.nan, 1e12), (math.inf, 0.0)])
def test_a_position_that_is_not_known_to_100_m_is_none(variances_m2: tuple[float, float]) -> None:
    with pytest.raises(RefusedInput) as refused:
        require_accurate(*variances_m2)
    assert refused.value.cause == 'no_fix'


@pytest.mark.parametrize('variances_m2', [(), (0.0, 0.0), (-1.0, -1.0), (math.nan, math.nan), (9_999.0, 400.0)])
def test_variances_that_say_nothing_leave_a_position(variances_m2: tuple[float, ...]) -> None:
    require_accurate(*variances_m2)


@pytest.mark.parametrize('stamp_ns', [0, 1, 10**9, 1_600_000_000_000_000_000, END_NS - 1])
def test_stamps_are_since_1970_or_since_a_simulation_started(stamp_ns: int) -> None:
    assert require_stamp(stamp_ns) == stamp_ns


@pytest.mark.parametrize('stamp_ns', [-1, -(10**18), END_NS, 4_102_444_800 * 10**9, 2**63 - 1])
def test_other_stamps_are_refused(stamp_ns: int) -> None:
    with pytest.raises(RefusedInput) as refused:
        require_stamp(stamp_ns)
    assert refused.value.cause == 'invalid_stamp'
