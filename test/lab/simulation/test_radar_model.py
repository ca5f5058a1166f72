"""The simulated radar against geometry that is computed one ray at a time."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from offradar_ros.lab.simulation.physics import (
    NOMINAL_PHYSICS,
    RadarPhysics,
    SpeckleLaw,
    draw_physics,
    held_out_physics,
    unseen_physics,
)
from offradar_ros.lab.simulation.radar_model import RadarModel
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.sensor import TRAINING_SENSOR, SimulatedSensor
from offradar_ros.lab.simulation.weather import CLEAR, Weather

Array = NDArray[np.float64]
Point = tuple[float, float]

# A radar that shows geometry alone: no ground clutter, uniform walls, no multipath, no saturation.
PLAIN = dataclasses.replace(
    NOMINAL_PHYSICS,
    returns_db=0.0,
    range_exponent=1.2,
    speckle_looks=1.5,
    texture_m=0.8,
    range_sigma_m=0.15,
    ground_db=-40.0,
    texture_exponent=0.0,
    echo_db=-90.0,
    tail_db=-120.0,
    slope_share=0.0,
    haze_db=-90.0,
    ghost_db=-90.0,
    streak_db=-120.0,
    occlusion=1.0,
    noise_near_m=0.0,
    knee=240.0,
    ceiling=250.0,
)
SENSOR = SimulatedSensor(azimuths=360, range_bins=400, range_resolution_m=0.25)
NO_WALLS, NO_POINTS = np.empty((0, 2, 2)), np.empty((0, 2))


def reflectors_of(
    walls: ArrayLike = NO_WALLS,
    points: ArrayLike = NO_POINTS,
    wall_power: float = 1e6,
    point_power: float = 1e6,
    transmission: float = 1.0 / 12.0,
) -> Reflectors:
    walls_m, points_m = np.asarray(walls, float), np.asarray(points, float)
    return Reflectors(
        walls_m,
        np.full(len(walls_m), wall_power),
        np.full(len(walls_m), transmission),
        points_m,
        np.full(len(points_m), point_power),
    )


def stationary(x: float = 0.0, y: float = 0.0, heading: float = 0.0, azimuths: int = 360) -> Array:
    return np.tile([x, y, heading], (azimuths, 1))


def render(
    reflectors: Reflectors,
    poses: Array,
    sensor: SimulatedSensor = SENSOR,
    seed: int = 0,
    physics: RadarPhysics = PLAIN,
    weather: Weather = CLEAR,
) -> NDArray[np.uint8]:
    return RadarModel(sensor, physics, weather).render(reflectors, poses, np.random.default_rng(seed))


@pytest.mark.parametrize('heading', [0.0, 0.5, -2.0, 7.0])
@pytest.mark.parametrize('bearing_deg', [0, 45, 90, 200, 359])
def test_a_point_is_seen_clockwise_from_forward_at_its_range(heading: float, bearing_deg: int) -> None:
    world_angle = heading - math.radians(bearing_deg)
    point = (5.0 + 40.0 * math.cos(world_angle), -3.0 + 40.0 * math.sin(world_angle))
    power = render(reflectors_of(points=[point]), stationary(5.0, -3.0, heading))
    row, column = np.unravel_index(np.argmax(power[:, 20:]), power[:, 20:].shape)
    assert min(abs(row - bearing_deg), 360 - abs(row - bearing_deg)) <= 1
    assert (column + 20.5) * 0.25 == pytest.approx(40.0, abs=0.6)


def test_walls_appear_at_the_range_of_the_first_hit() -> None:
    walls = [((20.0, -30.0), (25.0, 40.0)), ((-40.0, 10.0), (10.0, 60.0)), ((-15.0, -50.0), (-15.0, 5.0))]
    power = render(reflectors_of(walls=walls), stationary(1.0, 2.0, 0.3))
    misses = 0
    for row in range(0, 360, 3):
        angle = 0.3 - math.radians(row)
        ranges = [hit for hit in (first_hit((1.0, 2.0), angle, wall) for wall in walls) if hit]
        if ranges:
            found = (np.argmax(power[row, 20:]) + 20.5) * 0.25
            misses += abs(found - min(ranges)) > 1.5
    assert misses <= 6


def first_hit(origin: Point, angle: float, wall: tuple[Point, Point]) -> float | None:
    """Range at which a ray hits a wall, by stepping along the wall."""
    (x1, y1), (x2, y2) = wall
    previous: float | None = None
    for step in range(2001):
        x = x1 + (x2 - x1) * step / 2000 - origin[0]
        y = y1 + (y2 - y1) * step / 2000 - origin[1]
        side = math.sin(math.atan2(y, x) - angle)
        ahead = math.cos(math.atan2(y, x) - angle) > 0
        if previous is not None and ahead and side * previous <= 0:
            return math.hypot(x, y)
        previous = side
    return None


def test_a_wall_attenuates_what_is_behind_it() -> None:
    behind = (30.0, 0.0)
    wall = ((15.0, -5.0), (15.0, 5.0))
    around = slice(int(28 / 0.25), int(32 / 0.25))
    open_view = np.mean(
        [render(reflectors_of(points=[behind]), stationary(), seed=s)[0, around].max() for s in range(8)]
    )
    hidden = np.mean([render(reflectors_of([wall], [behind]), stationary(), seed=s)[0, around].max() for s in range(8)])
    # A twelfth of the power is 10.8 dB less, recorded in half decibels.
    assert open_view - hidden == pytest.approx(21.6, abs=5.0)


def test_an_oblique_wall_returns_less() -> None:
    normal = render(reflectors_of([((20.0, -8.0), (20.0, 8.0))]), stationary())[0]
    oblique = render(reflectors_of([((12.0, -8.0), (28.0, 8.0))]), stationary())[0]
    assert normal.max() > oblique.max() + 5


def test_the_radar_moves_while_it_turns() -> None:
    """A point on the right is scanned after a quarter of the rotation, one on the left after three quarters."""
    poses = stationary()
    poses[:, 0] = np.linspace(0.0, 8.0, 360)
    power = render(reflectors_of(points=[(2.0, -30.0), (6.0, 30.0)]), poses)
    for row in (90, 270):
        around = power[row - 4 : row + 5, 100:140].astype(float)
        assert abs(np.argmax(around.max(axis=1)) - 4) <= 1


def test_turning_on_the_spot_rolls_the_rows() -> None:
    points = [(20.0, 5.0), (-30.0, 12.0), (3.0, -44.0)]
    before = render(reflectors_of(points=points), stationary()).astype(float)
    after = render(reflectors_of(points=points), stationary(heading=math.radians(30.0))).astype(float)
    difference = np.roll(before, 30, axis=0) - after
    strong = np.roll(before, 30, axis=0) > 70
    assert strong.sum() > 10
    assert abs(difference[strong].mean()) < 5.0


@pytest.mark.parametrize('integer_powers', [True, False])
@pytest.mark.parametrize('noise_db', [2.0, 6.0])
def test_without_reflectors_there_is_noise_of_the_given_power(noise_db: float, integer_powers: bool) -> None:
    physics = dataclasses.replace(PLAIN, noise_db=noise_db, gain_db=3.0, integer_powers=integer_powers)
    far = render(reflectors_of(), stationary(), physics=physics)[:, 300:].astype(float)
    drawn = np.random.default_rng(1).exponential(10 ** ((noise_db + 3.0) / 10), 100_000)
    expected = np.rint(20 * np.log10(1.0 + (np.floor(drawn) if integer_powers else drawn)))
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
def test_any_sensor_gives_scans_of_its_size(sensor: SimulatedSensor) -> None:
    power = render(reflectors_of([((20.0, -30.0), (20.0, 30.0))]), stationary(azimuths=sensor.azimuths), sensor)
    assert power.shape == (sensor.azimuths, sensor.range_bins) and power.dtype == np.uint8
    skip = int(4.0 / sensor.range_resolution_m)
    found = (np.argmax(power[0, skip:]) + skip + 0.5) * sensor.range_resolution_m
    assert found == pytest.approx(20.0, abs=max(0.8, 2 * sensor.range_resolution_m))


def ranges_of(row: NDArray[np.uint8], above: int) -> list[float]:
    """Metres of a row's local maxima that are stronger than `above`."""
    peaks = [k for k in range(20, len(row) - 2) if row[k] > above and row[k] == row[k - 4 : k + 5].max()]
    return [(k + 0.5) * 0.25 for k in peaks]


def test_a_wall_at_normal_incidence_has_ghosts_at_two_and_three_times_its_range() -> None:
    physics = dataclasses.replace(PLAIN, ghost_db=-15.0)
    power = render(reflectors_of([((20.0, -8.0), (20.0, 8.0))]), stationary(), physics=physics)
    found = ranges_of(power[0], above=30)
    for expected in (20.0, 40.0, 60.0):
        assert any(abs(r - expected) < 1.0 for r in found)
    levels = [power[0, round(r / 0.25) - 3 : round(r / 0.25) + 3].max() for r in (20.0, 40.0, 60.0)]
    assert levels[0] > levels[1] > levels[2]


def test_a_wall_makes_a_mirror_image_of_a_pole_in_front_of_it() -> None:
    physics = dataclasses.replace(PLAIN, ghost_db=-10.0)
    wall, pole = ((20.0, -30.0), (20.0, 30.0)), (8.0, 9.0)
    # Its image stands at x = 32, as far behind the wall as the pole is in front.
    image_m, bearing = math.hypot(32.0, 9.0), math.atan2(9.0, 32.0)
    row, column = round(-bearing / (2 * math.pi) * 360) % 360, round(image_m / 0.25)
    around = np.s_[row - 2 : row + 3, column - 4 : column + 5]
    mirrored = render(reflectors_of([wall], [pole]), stationary(), physics=physics)[around].max()
    assert mirrored > render(reflectors_of([wall]), stationary(), physics=physics)[around].max() + 20


def test_strong_returns_raise_the_noise_of_their_azimuth() -> None:
    physics = dataclasses.replace(PLAIN, streak_db=-50.0)
    power = render(reflectors_of(points=[(20.0, 0.0)], point_power=1e8), stationary(), physics=physics).astype(float)
    assert power[0, 300:].mean() > power[180, 300:].mean() + 10


def test_the_recorded_byte_saturates_softly() -> None:
    levels = [
        render(
            reflectors_of(points=[(20.0, 0.0)], point_power=10.0**decades),
            stationary(),
            physics=dataclasses.replace(PLAIN, knee=120.0, ceiling=140.0),
        ).max()
        for decades in (5.0, 7.0, 9.0, 11.0)
    ]
    assert levels[0] < 120 and levels == sorted(levels) and levels[-1] <= 140


def test_patches_of_ground_clutter_are_fixed_in_the_world() -> None:
    physics = dataclasses.replace(PLAIN, ground_db=20.0, ground_patch_db=8.0)
    smooth = [
        render(reflectors_of(), stationary(x, heading=heading), seed=seed, physics=physics)[:, 60:300].astype(float)
        for x, heading, seed in ((0.0, 0.0, 0), (0.0, 0.0, 1), (0.0, math.radians(30), 2), (300.0, 0.0, 3))
    ]
    same, turned, elsewhere = (
        np.corrcoef(smooth[0].ravel(), other.ravel())[0, 1]
        for other in (smooth[1], np.roll(smooth[2], -30, axis=0), smooth[3])
    )
    assert same > elsewhere + 0.2
    assert turned > elsewhere + 0.2


def test_walls_occlude_the_ground() -> None:
    physics = dataclasses.replace(PLAIN, ground_db=25.0, ground_patch_db=0.0)
    power = render(
        reflectors_of([((20.0, -300.0), (20.0, 300.0))], transmission=0.0), stationary(), physics=physics
    ).astype(float)
    assert power[0, 200:].mean() < power[180, 200:].mean() - 20


def test_a_wall_is_bright_in_the_same_places_from_another_position() -> None:
    physics = dataclasses.replace(PLAIN, texture_exponent=2.0, specular_db=-40.0)
    wall = [((30.0, -60.0), (30.0, 60.0))]
    profiles = []
    for y in (0.0, 4.0):
        scans = [
            render(reflectors_of(wall), stationary(0.0, y), seed=s, physics=physics).astype(float) for s in range(20)
        ]
        along = np.linspace(-15.0, 15.0, 60)
        rows = np.rint(-np.arctan2(along - y, 30.0) / (2 * np.pi) * 360).astype(int) % 360
        columns = (np.hypot(along - y, 30.0) / 0.25).astype(int)
        profiles.append(np.mean([scan[rows, columns] for scan in scans], axis=0))
    assert np.corrcoef(profiles)[0, 1] > 0.5


def test_rain_attenuates_far_returns_more_and_returns_power_near_the_radar() -> None:
    points = [(15.0, 0.0), (0.0, -90.0)]
    heavy = Weather(rain_mm_h=150.0)
    sensor = dataclasses.replace(SENSOR, range_bins=400)
    clear, rain = (
        np.mean(
            [render(reflectors_of(points=points), stationary(), sensor, s, weather=w).astype(float) for s in range(12)],
            axis=0,
        )
        for w in (Weather(), heavy)
    )
    lost = [
        clear[row - 1 : row + 2, at - 4 : at + 4].max() - rain[row - 1 : row + 2, at - 4 : at + 4].max()
        for row, at in ((1, 60), (90, 360))
    ]
    # Two-way, in half decibels.
    assert lost[1] == pytest.approx(2 * 2 * heavy.attenuation_db_m() * 90.0, abs=4.0)
    assert lost[0] < lost[1]
    assert rain[180, 10:20].mean() > clear[180, 10:20].mean() + 5


def test_the_same_seed_gives_the_same_bytes() -> None:
    reflectors = reflectors_of([((20.0, -30.0), (25.0, 40.0))], [(10.0, 3.0)])
    for physics in (NOMINAL_PHYSICS, held_out_physics(1)):
        one, same, other = (render(reflectors, stationary(), seed=s, physics=physics).tobytes() for s in (1, 1, 2))
        assert one == same != other


@pytest.mark.parametrize('draw', [draw_physics, held_out_physics, unseen_physics])
def test_scans_of_all_drawn_radars_show_the_world(draw: Callable[[int], RadarPhysics]) -> None:
    """Bytes are neither all dark nor all bright, and walls and poles are stronger than what is behind the radar."""
    reflectors = reflectors_of(
        [((20.0, -15.0), (20.0, 15.0)), ((8.0, -30.0), (16.0, -30.0))], [(12.0, 14.0), (30.0, 40.0)]
    )
    for seed in range(12):
        power = render(reflectors, stationary(azimuths=400), TRAINING_SENSOR, seed, draw(seed)).astype(float)
        assert power.shape == (400, 512)
        assert 1.0 < power.mean() < 90.0 and power.max() > 60.0
        assert np.median(power[:, 117:]) < 75.0
        around = power[:, 55:71]
        assert np.abs(around[:10]).max() > np.quantile(around[180:220], 0.99)


@pytest.mark.parametrize('law', list(SpeckleLaw))
def test_speckle_of_every_law_has_the_mean_of_the_signal_and_its_own_spread(law: SpeckleLaw) -> None:
    """Of flat ground. Powers: Rayleigh of one look is exponential; the others have longer tails, log-normal as long."""
    physics = dataclasses.replace(
        PLAIN, speckle=law, speckle_looks=1.0, ground_db=40.0, ground_exponent=0.0, ground_start_m=0.1,
        ground_patch_db=0.0, integer_powers=False,
    )  # fmt: skip
    bytes_ = np.stack([render(reflectors_of(), stationary(), seed=s, physics=physics)[:, 40:360] for s in range(4)])
    power = 10.0 ** (bytes_.astype(float) / 20.0)
    assert 10.0 * np.log10(power.mean()) == pytest.approx(40.0 + PLAIN.gain_db, abs=0.6)
    spread = power.std() / power.mean()
    expected = {SpeckleLaw.RAYLEIGH: 1.0, SpeckleLaw.LOG_NORMAL: 1.0, SpeckleLaw.K: 1.5, SpeckleLaw.WEIBULL: 1.47}[law]
    assert spread == pytest.approx(expected, abs=0.2)


def test_a_return_leaves_a_tail_that_falls_behind_it() -> None:
    """Its length is the distance over which it falls to 1/e, 8.7 half decibels."""
    no_tail = dataclasses.replace(PLAIN, integer_powers=False)
    physics = dataclasses.replace(no_tail, tail_db=-20.0, tail_m=15.0)
    points = reflectors_of(points=[(20.0, 0.0)], point_power=1e9)
    without, with_tail = (
        np.mean([render(points, stationary(), seed=s, physics=p)[0] for s in range(20)], axis=0)
        for p in (no_tail, physics)
    )
    tail = with_tail[[int((20.0 + m) / 0.25) for m in (10.0, 25.0, 40.0)]]
    assert np.all(tail > without[[int((20.0 + m) / 0.25) for m in (10.0, 25.0, 40.0)]] + 15)
    assert np.diff(tail) == pytest.approx(-8.7, abs=5.0)
    assert with_tail[: int(17.0 / 0.25)] == pytest.approx(without[: int(17.0 / 0.25)], abs=3.0)


def test_several_walls_mirror() -> None:
    """A post in front of two walls has an image behind the second one only where two walls mirror."""
    walls = [((30.0, -20.0), (30.0, 20.0)), ((-20.0, 25.0), (20.0, 25.0))]
    near = reflectors_of(walls, [(10.0, 8.0)], point_power=1e8, transmission=0.0)
    images = [(50.0, 8.0), (10.0, 42.0)]

    def levels(count: int) -> list[float]:
        physics = dataclasses.replace(PLAIN, ghost_db=-10.0, ghost_walls=count)
        power = np.mean([render(near, stationary(), seed=s, physics=physics) for s in range(10)], axis=0)
        return [level_at(power, x, y) for x, y in images]

    none, one, two = levels(0), levels(1), levels(2)
    assert sum(found > base + 20 for found, base in zip(one, none, strict=True)) == 1
    assert all(found > base + 20 for found, base in zip(two, none, strict=True))


def level_at(power: NDArray[np.float64], x: float, y: float) -> float:
    row = round(-math.degrees(math.atan2(y, x))) % 360
    column = int(math.hypot(x, y) / 0.25)
    return float(power[row, column - 4 : column + 5].max())


def test_haze_is_near_and_alike_at_all_azimuths() -> None:
    physics = dataclasses.replace(PLAIN, haze_db=20.0, haze_m=15.0, integer_powers=False, ground_db=-90.0)
    power = render(reflectors_of(), stationary(), physics=physics).astype(float)
    assert power[:, 20:40].mean() > power[:, 350:].mean() + 20
    by_sector = power[:, 20:40].reshape(12, -1).mean(axis=1)
    assert np.ptp(by_sector) < 3
