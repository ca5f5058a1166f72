"""Two scans of one place give the pose between them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from plane import Plane, make_plane, make_walls

from offradar_ros.alignment.align import align, align_each, prepare_place, prepare_query
from offradar_ros.alignment.signature import SignatureMaker
from offradar_ros.alignment.twist import STANDING, Twist
from offradar_ros.types import Alignment, PolarScan

PLANE = make_plane(1)
MAKE = SignatureMaker()


def aligned(place: PolarScan, query: PolarScan, of_place: Twist = STANDING, of_query: Twist = STANDING) -> Alignment:
    return align(prepare_place(MAKE(place), of_place), prepare_query(MAKE(query), of_query))


def errors(found: Alignment, pose: tuple[float, float, float]) -> tuple[float, float]:
    """Metres and degrees from the true pose."""
    off = found.pose - np.array(pose)
    return float(np.hypot(off[0], off[1])), abs(math.degrees(math.remainder(off[2], 2.0 * math.pi)))


@pytest.mark.parametrize('yaw_deg', [0.0, 3.0, 47.3, 90.0, -133.0, 180.0])
@pytest.mark.parametrize('shift_m', [(0.0, 0.0), (2.3, -1.1), (-6.0, 4.0)])
def test_any_heading_within_ten_metres(shift_m: tuple[float, float], yaw_deg: float) -> None:
    pose = (*shift_m, math.radians(yaw_deg))
    metres, degrees = errors(aligned(PLANE.scan(), PLANE.scan(pose, seed=1)), pose)
    assert metres < 0.1
    assert degrees < 0.2


def test_the_pose_is_that_of_the_query_in_the_frame_of_the_place() -> None:
    """Wherever the place lies on the map."""
    place, query = (12.0, -7.0, 2.0), (13.0, -4.0, 2.5)
    found = aligned(PLANE.scan(place), PLANE.scan(query, seed=1))
    cos, sin = math.cos(place[2]), math.sin(place[2])
    dx, dy = query[0] - place[0], query[1] - place[1]
    metres, degrees = errors(found, (cos * dx + sin * dy, cos * dy - sin * dx, query[2] - place[2]))
    assert metres < 0.1
    assert degrees < 0.2


@pytest.mark.parametrize(
    'twist', [Twist(20.0), Twist(12.0, 0.0, 0.8), Twist(0.0, 0.0, -1.0)], ids=['fast', 'turning', 'in place']
)
def test_motion_during_the_sweep_is_taken_out(twist: Twist) -> None:
    pose = (1.5, 2.0, math.radians(170.0))
    place, query = PLANE.scan(), PLANE.scan(pose, twist=twist, seed=1)
    metres, degrees = errors(aligned(place, query, of_query=twist), pose)
    assert metres < 0.15
    assert degrees < 0.3
    # Without the velocity the same two are further apart.
    ignored_m, ignored_deg = errors(aligned(place, query), pose)
    assert ignored_m > 2.0 * metres or ignored_deg > 2.0 * degrees


def test_scans_of_other_resolution_and_number_of_rows_fit() -> None:
    pose = (-2.0, 1.0, math.radians(30.0))
    query = PLANE.scan(pose, azimuths=576, range_bins=1200, range_resolution_m=0.0876, seed=1)
    metres, degrees = errors(aligned(PLANE.scan(), query), pose)
    assert metres < 0.15
    assert degrees < 0.3


@pytest.mark.parametrize('kept', [slice(0, 260), slice(120, 400)])
def test_part_of_a_turn_is_enough(kept: slice) -> None:
    pose = (2.0, -1.5, math.radians(-40.0))
    query = PLANE.scan(pose, seed=1)
    assert query.azimuth_stamps_ns is not None
    part = dataclasses.replace(
        query,
        power=query.power[kept],
        azimuths_rad=query.azimuths_rad[kept],
        azimuth_stamps_ns=query.azimuth_stamps_ns[kept],
    )
    metres, degrees = errors(aligned(PLANE.scan(), part), pose)
    assert metres < 0.15
    assert degrees < 0.3


def test_the_order_of_rows_does_not_matter() -> None:
    pose = (2.0, -1.5, 0.4)
    query = PLANE.scan(pose, seed=1)
    assert query.azimuth_stamps_ns is not None
    order = np.roll(np.arange(400), 123)
    rolled = dataclasses.replace(
        query,
        power=query.power[order],
        azimuths_rad=query.azimuths_rad[order],
        azimuth_stamps_ns=query.azimuth_stamps_ns[order],
    )
    np.testing.assert_allclose(
        aligned(PLANE.scan(), rolled).pose, aligned(PLANE.scan(), query).pose, rtol=0.0, atol=1e-6
    )


def test_another_place_agrees_less() -> None:
    here = [aligned(PLANE.scan(), PLANE.scan((1.0, 1.0, k), seed=k)).score for k in range(4)]
    elsewhere = [aligned(PLANE.scan(), make_plane(10 + k).scan(seed=k)).score for k in range(4)]
    assert min(here) > max(elsewhere) + 0.2


@pytest.mark.parametrize('yaw_deg', [0.0, 90.0, 180.0])
def test_the_covariance_is_larger_along_a_street_without_ends(yaw_deg: float) -> None:
    """Two walls: nothing says how far along them the vehicle is, but for what sticks out now and then."""
    x = np.arange(-90.0, 90.0, 0.4)
    walls = np.concatenate([np.column_stack([x, np.full_like(x, y)]) for y in (-9.0, 11.0)])
    street = Plane(walls, np.full(len(walls), 80.0))
    found = aligned(street.scan(), street.scan((0.0, 1.0, math.radians(yaw_deg)), seed=1))
    assert found.covariance[0, 0] > 4.0 * found.covariance[1, 1]


def test_a_scan_without_a_return_is_anywhere_near_the_place() -> None:
    place = PLANE.scan()
    empty = dataclasses.replace(place, power=np.ones_like(place.power))
    found = aligned(place, empty)
    assert found.score <= 0.0
    assert found.pose.tolist() == [0.0, 0.0, 0.0]
    np.testing.assert_allclose(np.diag(found.covariance), [400.0, 400.0, math.pi**2])


def test_the_covariance_holds_most_of_the_errors() -> None:
    """Within factors: its constants are those of streets, where more changes than noise."""
    rng = np.random.default_rng(5)
    squares = []
    for seed in range(30):
        pose = (*rng.uniform(-5.0, 5.0, 2).tolist(), float(rng.uniform(-math.pi, math.pi)))
        found = aligned(make_plane(20 + seed).scan(), make_plane(20 + seed).scan(pose, seed=1))
        off = found.pose - np.array(pose)
        off[2] = math.remainder(off[2], 2.0 * math.pi)
        squares.append(float(off @ np.linalg.solve(found.covariance, off)))
    # 95 % of a chi-squared of three degrees of freedom are below 7.81.
    assert 0.1 < np.mean(squares) < 3.0
    assert np.quantile(squares, 0.9) < 7.81


def test_missing_sectors_make_it_larger() -> None:
    query = PLANE.scan((1.0, 0.0, 0.1), seed=1)
    gaps = (np.arange(400) // 10) % 2 == 1
    query.power[gaps] = 0
    whole, part = aligned(PLANE.scan(), PLANE.scan((1.0, 0.0, 0.1), seed=1)), aligned(PLANE.scan(), query)
    assert np.linalg.det(part.covariance) > 4.0 * np.linalg.det(whole.covariance)


def test_several_places_at_once_give_what_each_gives() -> None:
    """Whatever else is aligned: right places, another one, and one of which nothing is seen."""
    empty = PLANE.scan()
    empty.power[:] = 1
    scans = [PLANE.scan(), make_plane(10).scan(), empty, PLANE.scan((3.0, -1.0, 2.0), seed=2)]
    places = [prepare_place(MAKE(scan)) for scan in scans]
    query = prepare_query(MAKE(PLANE.scan((1.0, 1.0, 0.5), seed=1)))
    for found, alone in zip(align_each(places, query), [align(place, query) for place in places], strict=True):
        np.testing.assert_allclose(found.pose, alone.pose, rtol=0.0, atol=1e-4)
        np.testing.assert_allclose(found.covariance, alone.covariance, rtol=1e-3)
        assert found.score == pytest.approx(alone.score, abs=1e-5)
    assert align_each([], query) == []


def test_near_an_expected_pose_only_that_is_found() -> None:
    """Which is faster, and is not led astray by what looks alike far away."""
    pose = (1.0, 0.5, math.radians(4.0))
    place, query = prepare_place(MAKE(PLANE.scan())), prepare_query(MAKE(PLANE.scan(pose, seed=1)))
    metres, degrees = errors(align(place, query, np.array([0.4, 0.0, 0.05])), pose)
    assert metres < 0.1
    assert degrees < 0.2
    elsewhere = align(place, query, np.array([13.0, 0.0, 1.0]))
    assert errors(elsewhere, pose)[0] > 3.0 or elsewhere.score < 0.3
    assert elsewhere.score < 0.5 * align(place, query).score


@pytest.mark.parametrize('heading_deg', [0.0, 22.5, 70.0, -45.0])
@pytest.mark.parametrize('along_m', [0.0, 2.0, 5.0])
def test_between_walls_without_end_nothing_is_known_along_them(along_m: float, heading_deg: float) -> None:
    """Not even that the vehicle stands, which is what looks likeliest. Across them and in heading it is known."""
    heading = math.radians(heading_deg)
    walls, direction = make_walls(heading), np.array([math.cos(heading), math.sin(heading)])
    found = aligned(walls.scan(), walls.scan((along_m * direction[0], along_m * direction[1], 0.0), seed=1))
    across = np.array([-direction[1], direction[0]])
    assert direction @ found.covariance[:2, :2] @ direction > 9.0**2
    assert across @ found.covariance[:2, :2] @ across < 1.0
    assert abs(across @ found.pose[:2]) < 0.3
    assert found.covariance[2, 2] < math.radians(1.0) ** 2
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0
