"""Drives through simulated cities, for training without recordings."""

from __future__ import annotations

import dataclasses

import numpy as np

from offradar_ros.lab.drives.simulated import SimulatedDrive, physics_of
from offradar_ros.lab.simulation.sensor import TRAINING_SENSOR, SimulatedSensor
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.lab.simulation.weather import CLEAR, Weather
from offradar_ros.lab.training.config import DataConfig, ValidationConfig

LANES_M = (0.0, 3.5, -1.5, 1.5, -7.5, -7.5)
"""Lane offsets of the drives of a city, in turn; the last two are the outer lanes of both directions, 15 m apart where
the street is wide enough."""

_SHORT_RANGE_SHARE = 1.0 / 3.0
_MIN_RANGE = 0.6
_RADAR_SEEDS = 10**8
"""Step between the seeds of the radars of a world: more than there are worlds."""


def simulated_drives(config: DataConfig | ValidationConfig) -> list[SimulatedDrive]:
    """Every drive through every simulated city of `config`."""
    return [
        city_drive(config.first_seed + world, index, config)
        for world in range(config.worlds)
        for index in range(config.drives)
    ]


def city_drive(seed: int, index: int, config: DataConfig | ValidationConfig) -> SimulatedDrive:
    """Drive `index` of the city of `seed`; every third is in the opposite direction, over the same streets.

    The mean distance between two scans is `config.spacing_m` metres. The first of `config.radars` radars is that of the
    seed.
    """
    radar_seed = seed + _RADAR_SEEDS * (index % config.radars)
    rng = np.random.default_rng([seed, index])
    reverse = index % 3 == 2
    speed_mps = float(rng.uniform(6.0, 11.0))
    stride = max(1, round(config.spacing_m / (speed_mps * TRAINING_SENSOR.rotation_s)))
    plan = SessionPlan(
        name=f'city_{seed}_drive_{index}',
        seed=1000 * seed + index,
        scans=stride * config.scans,
        start_m=config.scans * config.spacing_m if reverse else 0.0,
        speed_mps=speed_mps,
        left_m=LANES_M[index % len(LANES_M)],
        reverse=reverse,
        traffic=float(rng.uniform(0.0, 20.0)),
        parked=float(rng.uniform(0.2, 0.9)),
        foliage=_foliage(np.random.default_rng([seed, index, 1])),
        degraded=config.degraded,
        physics=physics_of(config.physics, radar_seed),
        weather=_bad_weather(rng) if rng.random() < config.bad_weather else CLEAR,
    )
    return SimulatedDrive(f'city_{seed}', seed, plan, _sensor(config.physics, radar_seed), stride)


def _sensor(physics: str, seed: int) -> SimulatedSensor:
    """Unless physics is nominal, a third of the worlds have a radar of shorter range, down to the 100 m of RADIATE."""
    rng = np.random.default_rng([seed, 3])
    if physics == 'nominal' or rng.random() >= _SHORT_RANGE_SHARE:
        return TRAINING_SENSOR
    share = float(rng.uniform(_MIN_RANGE, 1.0))
    return dataclasses.replace(TRAINING_SENSOR, range_bins=round(share * TRAINING_SENSOR.range_bins))


def _foliage(rng: np.random.Generator) -> float:
    """A quarter of the drives is in winter, a quarter in summer, the others between."""
    return float(np.clip(rng.uniform(-0.5, 1.5), 0.0, 1.0))


def _bad_weather(rng: np.random.Generator) -> Weather:
    """Rain, snow or fog, from light to extreme, with a log-uniform distribution."""
    share = float(rng.random())
    return (
        Weather(rain_mm_h=2.5 * 20.0**share),
        Weather(snow_mm_h=0.5 * 10.0**share),
        Weather(fog_visibility_m=500.0 * 0.1**share),
    )[int(rng.integers(3))]
