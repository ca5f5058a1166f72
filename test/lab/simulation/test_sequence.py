"""Simulated drives: reproducible, and consistent with their ground truth."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.geometry import LocalFrame
from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.degradation import DegradationKind
from offradar_ros.lab.simulation.sensor import SimulatedSensor
from offradar_ros.lab.simulation.sequence import ORIGIN, SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.lab.simulation.world import World
from offradar_ros.sequence import RadarSequence

SENSOR = SimulatedSensor(azimuths=200, range_bins=288, range_resolution_m=0.3472)


@pytest.fixture(scope='module')
def town() -> World:
    return make_city(CityPlan(seed=1, blocks=(2, 2), route_m=500.0))


def drive(town: World, **plan: Any) -> SimulatedSequence:
    return SimulatedSequence(town, SessionPlan(**({'scans': 20} | plan)), SENSOR)


def test_a_simulated_drive_is_a_radar_sequence(town: World) -> None:
    sequence = drive(town, name='monday')
    assert isinstance(sequence, RadarSequence)
    assert (sequence.name, sequence.layout, len(sequence)) == ('monday', 'simulation', 20)
    scan = sequence.scan(3)
    assert scan.power.shape == (200, 288) and scan.power.dtype == np.uint8
    assert scan.stamp_ns == sequence.stamps_ns[3]
    assert scan.range_resolution_m == SENSOR.range_resolution_m
    assert scan.azimuths_rad[50] == pytest.approx(np.pi / 2)
    for index in (-1, 20):
        with pytest.raises(IndexError):
            sequence.scan(index)


def test_the_same_seed_gives_the_same_bytes_in_any_order(town: World) -> None:
    one, other = (
        drive(town, seed=3, degraded=0.5),
        drive(make_city(CityPlan(seed=1, blocks=(2, 2), route_m=500.0)), seed=3, degraded=0.5),
    )
    forwards = [one.scan(i).power.tobytes() for i in range(20)]
    backwards = [other.scan(i).power.tobytes() for i in reversed(range(20))][::-1]
    assert forwards == backwards
    assert one.degradations == other.degradations
    assert drive(town, seed=4).scan(0).power.tobytes() != drive(town, seed=3).scan(0).power.tobytes()


def test_stamps_are_the_middle_of_each_rotation(town: World) -> None:
    sequence = drive(town, start_ns=10**18)
    assert sequence.stamps_ns.tolist() == [10**18 + 125_000_000 + 250_000_000 * i for i in range(20)]
    rows, following = (sequence.scan(i).azimuth_stamps_ns for i in (4, 5))
    assert rows is not None and following is not None
    assert rows[0] == 10**18 + 10**9 and rows[100] == sequence.stamps_ns[4]
    assert np.all(np.diff(rows) > 0) and rows[-1] < following[0]


def test_the_trajectory_gives_the_true_pose_at_each_scan(town: World) -> None:
    sequence = drive(town, left_m=1.0)
    assert sequence.trajectory.geodetic
    local = sequence.trajectory.in_frame(LocalFrame(ORIGIN))
    found = local.poses_at(sequence.stamps_ns, max_gap_ns=10**9)
    np.testing.assert_allclose(found[:, :2], sequence.poses[:, :2], atol=0.02)
    assert np.cos(found[:, 3] - sequence.poses[:, 2]).min() > 0.999


def test_the_plan_sets_start_speed_lane_and_direction(town: World) -> None:
    assert town.route is not None
    line = town.route.at(np.array([30.0]))[0]
    plain, left = (drive(town, start_m=30.0, left_m=left_m, scans=200).poses for left_m in (0.0, 2.0))
    assert np.hypot(*(plain[0, :2] - line[:2])) < 2.5
    offset = left[:, None, :2] - plain[None, :, :2]
    nearest = np.argmin(np.hypot(*offset.transpose(2, 0, 1)), axis=1)
    to_left = np.column_stack([-np.sin(plain[nearest, 2]), np.cos(plain[nearest, 2])])
    to_left_m = np.sum(offset[np.arange(len(left)), nearest] * to_left, axis=1)
    assert np.median(to_left_m) == pytest.approx(2.0, abs=0.2)
    steps = np.hypot(*np.diff(plain[:, :2], axis=0).T) / 0.25
    assert steps.mean() == pytest.approx(8.0, abs=0.5) and steps.std() > 0.2
    back = drive(town, start_m=30.0, reverse=True).poses
    assert np.cos(back[0, 2] - plain[0, 2]) < -0.99
    ahead = np.array([np.cos(back[0, 2]), np.sin(back[0, 2])])
    assert (back[5, :2] - back[0, :2]) @ ahead > 5.0


def test_the_ground_truth_lists_every_degraded_scan(town: World) -> None:
    sequence = drive(town, scans=90, degraded=1 / 3)
    kinds = [degradation.kind for degradation in sequence.degradations if degradation]
    assert len(kinds) == 30 and set(kinds) == set(DegradationKind)
    assert all(0.05 <= d.severity <= 1.0 for d in sequence.degradations if d)
    assert not any(drive(town).degradations)


def test_only_degraded_scans_differ_from_those_of_a_clean_drive(town: World) -> None:
    degraded, clean = drive(town, scans=30, degraded=0.5), drive(town, scans=30)
    for index, degradation in enumerate(degraded.degradations):
        same = degraded.scan(index).power.tobytes() == clean.scan(index).power.tobytes()
        assert same == (degradation is None)


def test_a_place_is_recognised_on_another_drive(town: World) -> None:
    """By the mean power over azimuths at each range, a simple ring key."""

    def keys(sequence: SimulatedSequence, indices: NDArray[np.int64]) -> NDArray[np.float64]:
        rows = np.stack([sequence.scan(int(i)).power[:, 10:].astype(float) for i in indices])
        return np.asarray((rows / np.linalg.norm(rows, axis=2, keepdims=True)).mean(axis=1))

    assert town.route is not None
    scans = int(town.route.length_m / 8.0 / 0.25)
    mapping, driving = drive(town, seed=5, scans=scans), drive(town, seed=6, scans=scans, start_m=20.0)
    mapped, queried = np.arange(0, scans, 2), np.arange(0, scans, 9)
    distances = np.linalg.norm(keys(driving, queried)[:, None] - keys(mapping, mapped)[None], axis=2)
    found = mapping.poses[mapped][distances.argmin(axis=1), :2]
    assert np.mean(np.hypot(*(found - driving.poses[queried, :2]).T) < 25.0) > 0.7


def test_parked_cars_and_traffic_change_from_drive_to_drive(town: World) -> None:
    quiet = drive(town, traffic=0.0, parked=0.0, scans=1).scan(0).power.astype(float)
    busy = drive(town, traffic=60.0, parked=1.0, scans=1).scan(0).power.astype(float)
    assert (busy > 60).sum() > (quiet > 60).sum()


def test_another_origin_moves_only_the_trajectory(town: World) -> None:
    moved = SimulatedSequence(town, SessionPlan(scans=2), SENSOR, dataclasses.replace(ORIGIN, latitude_deg=-33.0))
    assert moved.trajectory.positions[0, 0] == pytest.approx(-33.0, abs=0.01)
    assert moved.scan(0).power.tobytes() == drive(town, scans=2).scan(0).power.tobytes()
