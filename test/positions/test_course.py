"""The course over ground, on ways whose heading is known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from offradar_ros.geometry import wrap_angle
from offradar_ros.positions.course import Course, CourseSettings, Heading, course_of

SECOND = 10**9
GAP_NS = 1_500_000_000
STEP_S = 0.01

Leg = tuple[float, float, float]
"""Seconds, speed at its end in m/s (below 0: in reverse), and curvature of the way in 1/m, to the left."""


class Way(NamedTuple):
    """Stamps in ns, x and y in metres, and the true headings in rad."""

    stamps_ns: NDArray[np.int64]
    points_m: NDArray[np.float64]
    yaws_rad: NDArray[np.float64]


def driven(legs: Sequence[Leg], *, rate_hz: float = 10.0, yaw_rad: float = 0.3, noise_m: float = 0.0) -> Way:
    """A vehicle that moves as it points, from the origin; each leg changes its speed steadily."""
    speed_mps, rows = 0.0, [(0.0, 0.0, yaw_rad)]
    for seconds, last_mps, curvature in legs:
        for step in range(round(seconds / STEP_S)):
            now_mps = speed_mps + (last_mps - speed_mps) * (step + 0.5) * STEP_S / seconds
            x_m, y_m, yaw = rows[-1]
            half = yaw + 0.5 * now_mps * curvature * STEP_S
            rows.append(
                (
                    x_m + now_mps * math.cos(half) * STEP_S,
                    y_m + now_mps * math.sin(half) * STEP_S,
                    yaw + now_mps * curvature * STEP_S,
                )
            )
        speed_mps = last_mps
    every = round(1.0 / rate_hz / STEP_S)
    table = np.array(rows)[::every]
    noise = np.random.default_rng(5).normal(0.0, noise_m, (len(table), 2))
    stamps_ns = 1_600_000_000 * SECOND + np.arange(len(table)) * round(SECOND / rate_hz)
    return Way(stamps_ns, table[:, :2] + noise, table[:, 2])


def live(way: Way, max_gap_ns: int = GAP_NS) -> list[Heading]:
    """The headings as they come, and those that the end decides."""
    course = Course(max_gap_ns)
    found: list[Heading] = []
    for stamp_ns, (x_m, y_m) in zip(way.stamps_ns.tolist(), way.points_m.tolist(), strict=True):
        found += course.add(stamp_ns, x_m, y_m)
    return found + course.settle()


def errors_deg(yaws_rad: Sequence[float] | NDArray[np.float64], way: Way) -> NDArray[np.float64]:
    return np.abs(np.degrees(wrap_angle(np.asarray(yaws_rad) - way.yaws_rad)))


def live_errors_deg(way: Way) -> NDArray[np.float64]:
    return errors_deg([heading.yaw_rad for heading in live(way)], way)


def after(way: Way, seconds: float) -> NDArray[np.bool_]:
    """The positions later than this after the first."""
    return np.asarray(way.stamps_ns - way.stamps_ns[0] > seconds * SECOND)


START: Leg = (4.0, 8.0, 0.0)


@pytest.mark.parametrize('yaw_rad', [0.0, 1.0, 3.1, -2.5])
@pytest.mark.parametrize('rate_hz', [1.0, 4.0, 10.0, 50.0])
def test_on_a_straight_street_it_is_the_direction_of_the_street(yaw_rad: float, rate_hz: float) -> None:
    way = driven([START, (10.0, 8.0, 0.0)], rate_hz=rate_hz, yaw_rad=yaw_rad)
    assert live_errors_deg(way)[after(way, 3.0)].max() < 1e-6


@pytest.mark.parametrize('rate_hz', [4.0, 10.0])
@pytest.mark.parametrize('curvature', [0.1, -0.1])
def test_it_does_not_lag_in_a_curve(rate_hz: float, curvature: float) -> None:
    way = driven([START, (10.0, 6.0, curvature)], rate_hz=rate_hz)
    # Where the curve begins its curvature jumps, which no steering does.
    assert live_errors_deg(way)[after(way, 5.0)].max() < 0.8
    assert np.ptp(way.yaws_rad) > math.pi


def test_a_motion_of_second_degree_is_exact_at_the_ends_too() -> None:
    seconds = np.arange(0.0, 6.0, 0.25)
    points = np.column_stack([5.0 * seconds, 0.2 * seconds**2])
    stamps_ns = np.round(seconds * SECOND).astype(np.int64)
    found = course_of(stamps_ns, points, GAP_NS)
    np.testing.assert_allclose(found[:, 0], np.arctan2(0.4 * seconds, 5.0), atol=1e-9)


@pytest.mark.parametrize(('noise_m', 'median_deg', 'worst_deg'), [(0.03, 0.4, 2.0), (0.5, 1.0, 5.0), (1.5, 3.0, 15.0)])
def test_noise_of_a_receiver_is_averaged_and_told(noise_m: float, median_deg: float, worst_deg: float) -> None:
    way = driven([START, *[(8.0, 8.0, 0.0), (4.0, 8.0, 0.02)] * 8], rate_hz=5.0, noise_m=noise_m)
    found = course_of(way.stamps_ns, way.points_m, GAP_NS)
    errors, told = errors_deg(found[:, 0], way)[after(way, 6.0)], np.degrees(found[after(way, 6.0), 1])
    assert np.median(errors) < median_deg
    assert np.percentile(errors, 99) < worst_deg
    # Of a right standard deviation 95 % of the errors are within two.
    assert np.mean(errors < 2.0 * told) > 0.9
    assert np.median(errors) > 0.15 * np.median(told)


def test_the_error_by_noise_is_that_of_the_formula() -> None:
    way = driven([START, (100.0, 8.0, 0.0)], rate_hz=4.0, noise_m=0.5)
    told = course_of(way.stamps_ns, way.points_m, GAP_NS, CourseSettings(drift_mps=0.0, lever_m=0.0))[:, 1]
    # Positions 2 m apart, a window of 16 m to each side.
    expected_rad = 0.5 * math.sqrt(1.5 * 2.0 / 16.0**3)
    assert np.median(told[after(way, 10.0)]) == pytest.approx(expected_rad, rel=0.2)


@pytest.mark.parametrize('noise_m', [0.0, 0.3, 1.0])
def test_a_vehicle_that_stands_keeps_its_heading(noise_m: float) -> None:
    way = driven([START, (10.0, 8.0, 0.0), (3.0, 0.0, 0.0), (60.0, 0.0, 0.0)], rate_hz=5.0, noise_m=noise_m)
    stands = after(way, 18.0)
    found = live(way)
    yaws, told = np.array([heading.yaw_rad for heading in found]), np.array([heading.sd_rad for heading in found])
    # It is measured last before the vehicle stops, and then does not change however long it stands.
    assert np.ptp(yaws[stands]) == 0.0
    assert (errors_deg(yaws, way)[stands] < 3.0 * np.degrees(told[stands])).all()
    assert errors_deg(yaws, way)[stands].max() < 15.0 * noise_m + 0.5


def test_a_receiver_that_repeats_one_position_while_it_stands_has_no_less_noise() -> None:
    legs = [START, (20.0, 8.0, 0.0), (3.0, 0.0, 0.0), (30.0, 0.0, 0.0), START, (10.0, 8.0, 0.0)]
    way = driven(legs, noise_m=0.5)
    repeated = way.points_m.copy()
    repeated[270:570] = repeated[270]
    found = course_of(way.stamps_ns, repeated, GAP_NS)
    again = after(way, 59.0)
    assert np.median(errors_deg(found[again, 0], way._replace(yaws_rad=way.yaws_rad[again]))) < 2.0
    assert np.degrees(found[again, 1]).min() > 0.8


BACK_INTO_A_DRIVE: list[Leg] = [
    START,
    (5.0, 8.0, 0.0),
    (4.0, 0.0, 0.0),
    (2.0, 0.0, 0.0),
    (2.0, -1.5, -0.15),
    (4.0, -1.5, -0.15),
    (2.0, 0.0, 0.0),
    (2.0, 0.0, 0.0),
    (2.0, 2.0, 0.15),
    (4.0, 2.0, 0.15),
    (4.0, 8.0, 0.0),
]


@pytest.mark.parametrize(('noise_m', 'worst_deg'), [(0.0, 8.0), (0.1, 20.0), (0.3, 30.0)])
def test_a_vehicle_that_reverses_keeps_its_heading(noise_m: float, worst_deg: float) -> None:
    way = driven(BACK_INTO_A_DRIVE, rate_hz=10.0, noise_m=noise_m)
    assert live_errors_deg(way)[after(way, 3.0)].max() < worst_deg
    assert live_errors_deg(way)[-10:].max() < 2.0
    # The direction in which it moved was the opposite for metres.
    moved = np.diff(driven(BACK_INTO_A_DRIVE).points_m, axis=0)
    ahead = moved[:, 0] * np.cos(way.yaws_rad[1:]) + moved[:, 1] * np.sin(way.yaws_rad[1:])
    assert ahead[ahead < 0].sum() < -8.0


def test_a_turn_in_three_points_ends_with_the_vehicle_the_right_way_round() -> None:
    forth, back = (4.0, 2.0, 0.18), (4.0, -2.0, -0.18)
    way = driven([START, (3.0, 0.0, 0.0), forth, (1.0, 0.0, 0.0), back, (1.0, 0.0, 0.0), forth, (4.0, 8.0, 0.0)])
    errors = live_errors_deg(way)[after(way, 3.0)]
    assert errors.max() < 20.0
    assert errors[-20:].max() < 1.0
    assert np.ptp(way.yaws_rad) > math.radians(120.0)


def test_a_u_turn_is_a_turn() -> None:
    way = driven([START, (5.0, 3.0, 0.0), (6.0, 3.0, 1 / 5.5), (4.0, 8.0, 0.0)], rate_hz=4.0)
    assert np.ptp(way.yaws_rad) > 3.0
    assert live_errors_deg(way)[after(way, 3.0)].max() < 12.0
    assert live_errors_deg(way)[-8:].max() < 1.0


OUT_OF_A_PARKING_SPACE: list[Leg] = [
    (10.0, 0.0, 0.0),
    (2.0, -1.0, 0.0),
    (5.0, -1.0, -0.2),
    (1.0, 0.0, 0.0),
    (3.0, 0.0, 0.0),
    (4.0, 8.0, 0.0),
    (5.0, 8.0, 0.0),
]


def test_live_the_heading_is_unknown_until_it_is_clear_which_way_is_forwards() -> None:
    way = driven(OUT_OF_A_PARKING_SPACE)
    yaws = np.array([heading.yaw_rad for heading in live(way)])
    errors = errors_deg(yaws, way)
    assert np.isnan(yaws[: 21 * 10]).all()
    assert np.nanmax(errors) < 5.0
    assert np.isfinite(yaws[-70:]).all()


def test_of_a_recording_the_end_tells_how_it_began() -> None:
    way = driven(OUT_OF_A_PARKING_SPACE)
    found = course_of(way.stamps_ns, way.points_m, GAP_NS)
    assert errors_deg(found[:, 0], way).max() < 10.0
    assert np.isfinite(found[:, 1]).all()
    known = np.array([heading.yaw_rad for heading in live(way)])
    after_all = np.isfinite(known)
    np.testing.assert_allclose(found[after_all, 0], known[after_all], atol=1e-9)


def test_a_slow_vehicle_has_a_heading_after_some_metres() -> None:
    way = driven([(2.0, 1.5, 0.0), (40.0, 1.5, 0.02)], rate_hz=5.0)
    errors = live_errors_deg(way)
    first = int(np.flatnonzero(np.isfinite(errors))[0])
    assert 15.0 < 0.3 * first < 30.0
    assert np.nanmax(errors) < 2.0


def test_reversing_ends_after_a_way_that_nobody_reverses() -> None:
    # It turns on the spot, which positions do not show.
    way = driven([START, (3.0, 0.0, 0.0), (2.0, 0.0, 0.0), (3.0, -3.0, 0.0), (30.0, -3.0, 0.0)])
    errors = live_errors_deg(way)
    assert errors[after(way, 14.0)][0] < 5.0
    assert errors[-1] > 175.0


def test_a_gap_between_positions_is_not_bridged() -> None:
    first, second = driven([START, (5.0, 8.0, 0.0)]), driven([(4.0, 1.0, 0.0), (10.0, 6.0, 0.0)], yaw_rad=2.0)
    way = Way(
        np.concatenate([first.stamps_ns, second.stamps_ns + 30 * SECOND]),
        np.concatenate([first.points_m, second.points_m + 100.0]),
        np.concatenate([first.yaws_rad, second.yaws_rad]),
    )
    start = len(first.yaws_rad)
    yaws = np.array([heading.yaw_rad for heading in live(way)])
    assert errors_deg(yaws, way)[start - 1] < 1.0
    assert np.isnan(yaws[start : start + 20]).all()
    assert errors_deg(yaws, way)[-1] < 1.0
    offline = course_of(way.stamps_ns, way.points_m, GAP_NS)[:, 0]
    assert errors_deg(offline, way).max() < 2.0


@pytest.mark.parametrize('period_s', [3.0, 5.0])
def test_positions_that_are_seconds_apart_have_a_course(period_s: float) -> None:
    way = driven([(6.0, 8.0, 0.0), (60.0, 8.0, 0.002)], rate_hz=1.0 / period_s)
    found = live(way, max_gap_ns=10 * SECOND)
    assert errors_deg([heading.yaw_rad for heading in found], way)[after(way, 20.0)].max() < 5.0


def test_who_never_moves_has_no_heading() -> None:
    stamps_ns = np.arange(100) * SECOND // 5
    points = np.zeros((100, 2))
    assert np.isnan(course_of(stamps_ns, points, GAP_NS)).all()
    noisy = points + np.random.default_rng(0).normal(0.0, 0.3, points.shape)
    assert np.isnan(course_of(stamps_ns, noisy, GAP_NS)[:, 0]).all()


@pytest.mark.parametrize('count', [0, 1, 2])
def test_a_few_positions_are_no_motion(count: int) -> None:
    found = course_of(np.arange(count) * SECOND // 4, np.arange(2.0 * count).reshape(count, 2), GAP_NS)
    assert found.shape == (count, 2)
    assert np.isnan(found).all()


@given(st.lists(st.integers(1, 40), min_size=1, max_size=30), st.integers(0, 10**6))
@settings(max_examples=50, deadline=None)
def test_headings_do_not_depend_on_how_positions_come(sizes: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    steps_ns = rng.integers(SECOND // 50, SECOND, sum(sizes)) * rng.choice([1, 1, 1, 1, 2], sum(sizes))
    stamps_ns = np.cumsum(steps_ns).tolist()
    points = np.cumsum(rng.normal(0.5, 1.0, (sum(sizes), 2)), axis=0).tolist()
    positions = [(stamp, x, y) for stamp, (x, y) in zip(stamps_ns, points, strict=True)]
    one, several = Course(GAP_NS), Course(GAP_NS)
    alone = [heading for position in positions for heading in one.add(*position)] + one.settle()
    together: list[Heading] = []
    for size in sizes:
        together += several.add_all(positions[:size])
        positions = positions[size:]
    together += several.settle()
    assert len(alone) == sum(sizes)
    np.testing.assert_allclose(np.array(together), np.array(alone), atol=1e-6)


@given(
    st.lists(st.tuples(st.integers(1, 10**10), st.floats(-2e7, 2e7), st.floats(-2e7, 2e7)), min_size=1, max_size=60),
    st.booleans(),
)
@settings(max_examples=100, deadline=None)
def test_any_positions_give_a_heading_each(steps: list[tuple[int, float, float]], tiny: bool) -> None:
    stamps_ns = np.cumsum([1 if tiny else step for step, _, _ in steps])
    course = Course(GAP_NS)
    found: list[Heading] = []
    for stamp_ns, (_, x_m, y_m) in zip(stamps_ns.tolist(), steps, strict=True):
        found += course.add(stamp_ns, x_m, y_m)
    found += course.settle()
    assert len(found) == len(steps)
    assert all(math.isnan(yaw) or abs(yaw) <= math.pi for yaw, _, _ in found)


def test_a_flood_of_positions_takes_bounded_memory() -> None:
    course = Course(GAP_NS)
    found = sum(len(course.add(stamp_ns, 1e-3 * stamp_ns, 0.0)) for stamp_ns in range(5000))
    assert 5000 - found <= 1024
    assert len(course._positions) <= 2 * 1024 + 1
