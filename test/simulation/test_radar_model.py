"""The simulated radar against geometry worked out one ray at a time."""

import math

import numpy as np
import pytest

from offradar_ros.simulation.radar_model import RadarModel
from offradar_ros.simulation.reflectors import THROUGH, Reflectors
from offradar_ros.simulation.sensor import SimulatedSensor

SENSOR = SimulatedSensor(azimuths=360, range_bins=400, range_resolution_m=0.25)
NO_WALLS, NO_POINTS = np.empty((0, 2, 2)), np.empty((0, 2))


def seen(walls=NO_WALLS, points=NO_POINTS, wall_power=1e6, point_power=1e6, through=THROUGH) -> Reflectors:
    walls, points = np.asarray(walls, float), np.asarray(points, float)
    return Reflectors(
        walls,
        np.full(len(walls), wall_power),
        np.full(len(walls), through),
        points,
        np.full(len(points), point_power),
    )


def still(x=0.0, y=0.0, heading=0.0, azimuths=360):
    return np.tile([x, y, heading], (azimuths, 1))


def render(reflectors, poses, sensor=SENSOR, seed=0):
    return RadarModel(sensor).render(reflectors, poses, np.random.default_rng(seed))


@pytest.mark.parametrize('heading', [0.0, 0.5, -2.0, 7.0])
@pytest.mark.parametrize('bearing_deg', [0, 45, 90, 200, 359])
def test_a_point_is_seen_clockwise_from_forward_at_its_range(heading, bearing_deg):
    world_angle = heading - math.radians(bearing_deg)
    point = (5.0 + 40.0 * math.cos(world_angle), -3.0 + 40.0 * math.sin(world_angle))
    power = render(seen(points=[point]), still(5.0, -3.0, heading))
    row, column = np.unravel_index(np.argmax(power[:, 20:]), power[:, 20:].shape)
    assert min(abs(row - bearing_deg), 360 - abs(row - bearing_deg)) <= 1
    assert (column + 20.5) * 0.25 == pytest.approx(40.0, abs=0.6)


def test_walls_against_one_ray_at_a_time():
    walls = [((20.0, -30.0), (25.0, 40.0)), ((-40.0, 10.0), (10.0, 60.0)), ((-15.0, -50.0), (-15.0, 5.0))]
    power = render(seen(walls=walls), still(1.0, 2.0, 0.3))
    misses = 0
    for row in range(0, 360, 3):
        angle = 0.3 - math.radians(row)
        ranges = [hit for hit in (first_hit((1.0, 2.0), angle, wall) for wall in walls) if hit]
        if ranges:
            found = (np.argmax(power[row, 20:]) + 20.5) * 0.25
            misses += abs(found - min(ranges)) > 1.5
    assert misses <= 6


def first_hit(origin, angle, wall):
    """Range at which a ray meets a wall, by walking along the wall."""
    (x1, y1), (x2, y2) = wall
    previous = None
    for step in range(2001):
        x = x1 + (x2 - x1) * step / 2000 - origin[0]
        y = y1 + (y2 - y1) * step / 2000 - origin[1]
        side = math.sin(math.atan2(y, x) - angle)
        ahead = math.cos(math.atan2(y, x) - angle) > 0
        if previous is not None and ahead and side * previous <= 0:
            return math.hypot(x, y)
        previous = side
    return None


def test_a_wall_hides_what_is_behind_it():
    behind = (30.0, 0.0)
    wall = ((15.0, -5.0), (15.0, 5.0))
    around = slice(int(28 / 0.25), int(32 / 0.25))
    open_view = np.mean([render(seen(points=[behind]), still(), seed=s)[0, around].max() for s in range(8)])
    hidden = np.mean([render(seen([wall], [behind]), still(), seed=s)[0, around].max() for s in range(8)])
    # A twelfth of the power is 10.8 dB less, recorded in half decibels.
    assert open_view - hidden == pytest.approx(21.6, abs=5.0)


def test_a_wall_seen_aslant_returns_less():
    face_on = render(seen([((20.0, -8.0), (20.0, 8.0))]), still())[0]
    aslant = render(seen([((12.0, -8.0), (28.0, 8.0))]), still())[0]
    assert face_on.max() > aslant.max() + 5


def test_the_radar_moves_while_it_turns():
    """A point abeam on the right is looked at after a quarter of the rotation, on the left after three quarters."""
    poses = still()
    poses[:, 0] = np.linspace(0.0, 8.0, 360)
    power = render(seen(points=[(2.0, -30.0), (6.0, 30.0)]), poses)
    for row in (90, 270):
        around = power[row - 4 : row + 5, 100:140].astype(float)
        assert abs(np.argmax(around.max(axis=1)) - 4) <= 1


def test_turning_on_the_spot_rolls_the_rows():
    points = [(20.0, 5.0), (-30.0, 12.0), (3.0, -44.0)]
    before = render(seen(points=points), still()).astype(float)
    after = render(seen(points=points), still(heading=math.radians(30.0))).astype(float)
    difference = np.roll(before, 30, axis=0) - after
    strong = np.roll(before, 30, axis=0) > 70
    assert strong.sum() > 10
    assert abs(difference[strong].mean()) < 5.0


def test_with_nothing_to_see_there_is_noise_as_strong_as_asked():
    for decibels in (2.0, 6.0):
        power = render(seen(), still(), SimulatedSensor(azimuths=360, range_bins=400, noise_decibels=decibels))
        far = power[:, 300:].astype(float)
        drawn = np.random.default_rng(1).exponential(10 ** (decibels / 10), 100_000)
        expected = np.clip(np.rint(20 * np.log10(drawn)), 0, 255)
        assert far.mean() == pytest.approx(expected.mean(), abs=0.5)
        assert far.std() == pytest.approx(expected.std(), abs=0.5)


@pytest.mark.parametrize(
    'sensor',
    [
        SimulatedSensor(range_bins=3768, range_resolution_m=0.0432),
        SimulatedSensor(azimuths=399, range_bins=101, range_resolution_m=0.5),
        SimulatedSensor(azimuths=64, range_bins=50, range_resolution_m=2.0),
    ],
)
def test_any_sensor_gives_scans_of_its_size(sensor):
    power = RadarModel(sensor).render(
        seen([((20.0, -30.0), (20.0, 30.0))]), still(azimuths=sensor.azimuths), np.random.default_rng(0)
    )
    assert power.shape == (sensor.azimuths, sensor.range_bins) and power.dtype == np.uint8
    skip = int(4.0 / sensor.range_resolution_m)
    found = (np.argmax(power[0, skip:]) + skip + 0.5) * sensor.range_resolution_m
    assert found == pytest.approx(20.0, abs=max(0.8, 2 * sensor.range_resolution_m))
