"""Frames and positions against textbook formulas, and properties of every correct implementation."""

import csv
import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import (
    GeoPoint,
    LocalFrame,
    NoPosition,
    PositionBuffer,
    Trajectory,
    interpolate,
    utm_to_geodetic,
    wrap_angle,
    yaw_of_quaternion,
)
from offradar_ros.types import Pose

Position = tuple[float, float, float]
"""Latitude°, longitude°, altitude m."""

SEMI_MAJOR_M = 6378137.0
ECCENTRICITY_SQUARED = (2 - 1 / 298.257223563) / 298.257223563

latitude, longitude, altitude = st.floats(-89.9, 89.9), st.floats(-180.0, 180.0), st.floats(-400.0, 9000.0)
point = st.tuples(latitude, longitude, altitude)


def earth_centred(latitude_deg: float, longitude_deg: float, altitude_m: float) -> NDArray[np.float64]:
    """Earth-centred x, y, z of a WGS-84 position in metres, by the textbook."""
    phi, lam = math.radians(latitude_deg), math.radians(longitude_deg)
    normal = SEMI_MAJOR_M / math.sqrt(1 - ECCENTRICITY_SQUARED * math.sin(phi) ** 2)
    return np.array(
        [
            (normal + altitude_m) * math.cos(phi) * math.cos(lam),
            (normal + altitude_m) * math.cos(phi) * math.sin(lam),
            (normal * (1 - ECCENTRICITY_SQUARED) + altitude_m) * math.sin(phi),
        ]
    )


def east_north_up(origin: Position, position: Position) -> NDArray[np.float64]:
    phi, lam = math.radians(origin[0]), math.radians(origin[1])
    turn = np.array(
        [
            [-math.sin(lam), math.cos(lam), 0],
            [-math.sin(phi) * math.cos(lam), -math.sin(phi) * math.sin(lam), math.cos(phi)],
            [math.cos(phi) * math.cos(lam), math.cos(phi) * math.sin(lam), math.sin(phi)],
        ]
    )
    return np.asarray(turn @ (earth_centred(*position) - earth_centred(*origin)))


@settings(max_examples=100, deadline=None)
@given(point, st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(-100, 100)))
def test_local_frame_against_the_textbook_and_back(origin: Position, offset: Position) -> None:
    position = (origin[0] + offset[0], origin[1] + offset[1], origin[2] + offset[2])
    assume(abs(position[0]) < 90 and abs(position[1]) <= 180)
    frame = LocalFrame(GeoPoint(*origin))
    enu = frame.to_enu(np.array([position]))
    np.testing.assert_allclose(enu[0], east_north_up(origin, position), atol=1e-5)
    back = frame.to_geodetic(enu)[0]
    assert back[0] == pytest.approx(position[0], abs=1e-9)
    assert math.cos(math.radians(back[1] - position[1])) == pytest.approx(1.0, abs=1e-12)
    assert back[2] == pytest.approx(position[2], abs=1e-4)


def test_the_axes_are_east_north_up() -> None:
    frame = LocalFrame(GeoPoint(51.75, -1.25, 60.0))
    enu = frame.to_enu(np.array([(51.75, -1.249, 60.0), (51.751, -1.25, 60.0), (51.75, -1.25, 61.0)]))
    assert [int(np.argmax(row)) for row in enu] == [0, 1, 2]
    np.testing.assert_allclose(enu[2], (0, 0, 1), atol=1e-6)
    assert frame.to_enu(np.empty((0, 3))).shape == (0, 3)


def test_an_origin_may_be_of_numpy_scalars() -> None:
    position = np.array([51.75, -1.25, 60.0])
    np.testing.assert_allclose(LocalFrame(GeoPoint(*position)).to_enu(position[None]), 0.0, atol=1e-6)


@pytest.mark.parametrize(
    'values', [(90.1, 0.0), (-91.0, 0.0), (0.0, 180.5), (math.nan, 0.0), (0.0, math.nan), (0.0, 0.0, math.inf)]
)
def test_points_that_are_not_on_earth_are_refused(values: tuple[float, ...]) -> None:
    with pytest.raises(RefusedInput) as refused:
        GeoPoint(*values)
    assert refused.value.cause == 'invalid_position'


@pytest.mark.parametrize('degrees', [0.5, 36.4, 51.76, 80.0])
def test_utm_on_the_central_meridian_is_the_meridian_arc(degrees: float) -> None:
    """Easting 500 km, northing 0.9996 times the arc from the equator, integrated numerically."""
    phi = np.radians((np.arange(20000) + 0.5) * degrees / 20000)
    curvature = SEMI_MAJOR_M * (1 - ECCENTRICITY_SQUARED) / (1 - ECCENTRICITY_SQUARED * np.sin(phi) ** 2) ** 1.5
    arc = float(np.sum(curvature) * math.radians(degrees) / 20000)
    found = utm_to_geodetic(np.array([(500_000.0, 0.9996 * arc, 12.0)]), epsg=32630)
    np.testing.assert_allclose(found, [(degrees, -3.0, 12.0)], atol=1e-7)


def test_utm_against_a_receiver_with_both_coordinates(real_data: Path) -> None:
    rows = list(csv.DictReader((real_data / 'oxford_tiny' / 'gps' / 'gps.csv').open()))[::100]
    utm = np.array([[float(row[name]) for name in ('easting', 'northing', 'altitude')] for row in rows])
    lla = np.array([[float(row[name]) for name in ('latitude', 'longitude', 'altitude')] for row in rows])
    np.testing.assert_allclose(utm_to_geodetic(utm, epsg=32630), lla, atol=2e-6)


@given(st.floats(-1e4, 1e4))
def test_wrapped_angles_have_the_same_direction(angle: float) -> None:
    wrapped = float(wrap_angle(np.asarray(angle)))
    assert -math.pi < wrapped <= math.pi + 1e-9
    assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-9)


def test_half_a_turn_wraps_to_plus_pi() -> None:
    np.testing.assert_array_equal(wrap_angle(np.array([math.pi, -math.pi, 0.0])), [math.pi, math.pi, 0.0])


@given(st.floats(-3.1, 3.1), st.floats(-1.4, 1.4), st.floats(-3.1, 3.1), st.floats(0.95, 1.05))
def test_yaw_of_a_quaternion_is_where_its_x_axis_points(yaw: float, pitch: float, roll: float, length: float) -> None:
    x, y, z, w = Rotation.from_euler('ZYX', [yaw, pitch, roll]).as_quat() * length
    assert math.remainder(yaw_of_quaternion(x, y, z, w) - yaw, math.tau) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    'quaternion',
    [
        (0.0, 0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0, math.nan),
        (math.inf, 0.0, 0.0, 1.0),
        (0.0, 0.0, 1e300, 1e300),
        (0.0, 0.0, 0.0, 2.0),
        (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)),
    ],
    ids=['zeros', 'nan', 'inf', 'huge', 'too long', 'straight down'],
)
def test_a_quaternion_that_is_none_has_no_yaw(quaternion: tuple[float, float, float, float]) -> None:
    assert math.isnan(yaw_of_quaternion(*quaternion))


@pytest.mark.parametrize('latitude', [-34.0, 0.0, 51.75])
@pytest.mark.parametrize('east_m', [-60_000.0, 0.0, 60_000.0])
def test_headings_of_a_trajectory_turn_with_the_meridians(latitude: float, east_m: float) -> None:
    frame = LocalFrame(GeoPoint(latitude, 7.0, 50.0))
    start = frame.to_geodetic(np.array([[east_m, 20_000.0, 0.0]]))
    # A vehicle that goes north-east by the meridian where it is.
    metres = LocalFrame(GeoPoint(*start[0].tolist())).to_geodetic(np.array([[0.0, 0.0, 0.0], [10.0, 10.0, 0.0]]))
    there = Trajectory(np.array([0, 10]), metres, np.full(2, math.pi / 4), geodetic=True).in_frame(frame)
    east, north, _ = (there.positions[1] - there.positions[0]).tolist()
    np.testing.assert_allclose(there.yaws_rad, math.atan2(north, east), atol=1e-4)


def test_yaw_is_interpolated_along_the_shorter_arc_or_unknown() -> None:
    start, end = Pose(0, 0, 0, math.radians(170)), Pose(10, 20, 30, math.radians(-170))
    middle = interpolate(start, end, 0.5)
    assert (middle.x_m, middle.y_m, middle.z_m) == (5.0, 10.0, 15.0)
    assert abs(middle.yaw_rad) == pytest.approx(math.pi)
    assert math.isnan(interpolate(start, Pose(1, 1), 0.5).yaw_rad)


def slow_interpolation(known: list[tuple[int, float]], stamp: int, max_gap: int) -> float | NoPosition:
    """The expected answer of a buffer, by a loop over every pair."""
    for at, x in known:
        if at == stamp:
            return x
    if not known or stamp > known[-1][0]:
        return NoPosition.NOT_YET
    for (before, x0), (after, x1) in itertools.pairwise(known):
        if before < stamp < after and after - before <= max_gap:
            return x0 + (x1 - x0) * (stamp - before) / (after - before)
    return NoPosition.NEVER


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 60), st.floats(-1e6, 1e6)), max_size=12, unique_by=lambda item: item[0]),
    st.integers(-5, 65),
    st.integers(1, 20),
)
def test_the_buffer_and_the_trajectory_against_every_pair(
    positions: list[tuple[int, float]], stamp: int, max_gap: int
) -> None:
    positions = sorted(positions)
    expected = slow_interpolation(positions, stamp, max_gap)
    buffer = PositionBuffer(max_gap)
    for at, x in positions:
        buffer.add(at, Pose(x, -x))
    trajectory = Trajectory(
        stamps_ns=np.array([at for at, _ in positions], np.int64),
        positions=np.array([(x, -x, 0.0) for _, x in positions]).reshape(-1, 3),
        yaws_rad=np.full(len(positions), math.nan),
        geodetic=False,
    )
    found, along = buffer.at(stamp), trajectory.poses_at(np.array([stamp]), max_gap)[0]
    assert trajectory.covers(np.array([stamp]), max_gap).tolist() == [not isinstance(expected, NoPosition)]
    if isinstance(expected, NoPosition):
        assert found is expected
        assert np.isnan(along).all()
    else:
        assert isinstance(found, Pose)
        assert (found.x_m, found.y_m) == pytest.approx((expected, -expected), abs=1e-6)
        assert along[:3].tolist() == [found.x_m, found.y_m, found.z_m]


def test_the_buffer_refuses_positions_that_are_not_newer_or_not_finite() -> None:
    buffer = PositionBuffer(10)
    buffer.add(5, Pose(1.0, 1.0))
    for stamp, pose, cause in (
        (5, Pose(2.0, 2.0), 'repeated_position_stamp'),
        (4, Pose(2.0, 2.0), 'position_stamp_backwards'),
        (6, Pose(math.nan, 2.0), 'invalid_position'),
        (6, Pose(0.0, 0.0, math.inf), 'invalid_position'),
    ):
        with pytest.raises(RefusedInput) as refused:
            buffer.add(stamp, pose)
        assert refused.value.cause == cause
    kept = buffer.at(5)
    assert isinstance(kept, Pose)
    assert kept.x_m == 1.0
    assert buffer.last_stamp_ns == 5
    buffer.clear()
    assert buffer.last_stamp_ns is None
    assert buffer.at(5) is NoPosition.NOT_YET


def test_the_buffer_removes_the_oldest_first() -> None:
    buffer = PositionBuffer(10, capacity=3)
    for stamp in range(5):
        buffer.add(stamp, Pose(float(stamp), 0.0))
    assert buffer.at(1) is NoPosition.NEVER
    oldest = buffer.at(2)
    assert isinstance(oldest, Pose)
    assert oldest.x_m == 2.0


def test_the_origin_of_a_trajectory_is_its_first_position() -> None:
    lla = np.array([(51.75, -1.25, 60.0), (51.76, -1.25, 60.0)])
    trajectory = Trajectory(np.array([0, 10]), lla, np.zeros(2), geodetic=True)
    origin = trajectory.origin()
    assert origin is not None
    local = trajectory.in_frame(LocalFrame(origin))
    np.testing.assert_allclose(local.positions[0], 0.0, atol=1e-6)
    assert local.positions[1, 1] == pytest.approx(1112.5, abs=1.0)
    assert not local.geodetic and local.origin() is None and local.in_frame(LocalFrame(GeoPoint(0, 0))) is local
    assert local.poses_at(np.array([5]), max_gap_ns=10)[0, 1] == pytest.approx(local.positions[1, 1] / 2)


def test_poses_between_positions_turn_along_the_shorter_arc() -> None:
    yaws = np.radians([170.0, -170.0, 90.0])
    track = Trajectory(np.array([0, 10, 40]), np.arange(9.0).reshape(3, 3), yaws, geodetic=False)
    found = track.poses_at(np.array([-1, 0, 2, 5, 10, 20, 40, 41]), max_gap_ns=10)
    assert np.isnan(found).all(axis=1).tolist() == [True, False, False, False, False, True, False, True]
    np.testing.assert_allclose(found[[1, 2, 3, 4, 6], 0], [0.0, 0.6, 1.5, 3.0, 6.0])
    turned = np.degrees(found[[1, 2, 4, 6], 3])
    np.testing.assert_allclose(turned, [170.0, 174.0, -170.0, 90.0])
    assert abs(found[3, 3]) == pytest.approx(math.pi)
