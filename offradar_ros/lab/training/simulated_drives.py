"""Drives through simulated cities: where training data is from unless somebody has recordings."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from offradar_ros.lab.simulation.city.make import make_city
from offradar_ros.lab.simulation.city.plan import CityPlan
from offradar_ros.lab.simulation.degradation import TRAINED_KINDS
from offradar_ros.lab.simulation.physics import NOMINAL_PHYSICS, RadarPhysics, draw_physics, held_out_physics
from offradar_ros.lab.simulation.sensor import TRAINING_SENSOR, SimulatedSensor
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.lab.simulation.source_digest import source_digest
from offradar_ros.lab.simulation.weather import CLEAR, Weather
from offradar_ros.lab.simulation.world import World
from offradar_ros.lab.training.config import DataConfig, ValidationConfig
from offradar_ros.lab.training.drive import OpenDrive

LANES_M = (0.0, 3.5, -1.5, 1.5, -6.0, -6.0)
"""Lane offsets of the drives of a city, in turn; the last two are the outer lanes of either direction, 12 m apart."""

_SHORT_SIGHTED = 1.0 / 3.0
_LEAST_REACH = 0.6


@dataclasses.dataclass(frozen=True)
class SimulatedDrive:
    """Drive `index` of the city of `seed`; every third goes the other way, over the same streets.

    A scan is taken every `spacing_m` on average. `physics` and `bad_weather` as in the configuration;
    `simulator` says which version of it renders the scans.
    """

    seed: int
    index: int
    scans: int
    spacing_m: float
    degraded: float
    physics: str
    bad_weather: float
    simulator: str = dataclasses.field(default_factory=source_digest)

    @property
    def name(self) -> str:
        """City and index."""
        return f'{self.world}_drive_{self.index}'

    @property
    def world(self) -> str:
        """The city."""
        return f'city_{self.seed}'

    def open(self) -> OpenDrive:
        """Scans are rendered when they are asked for."""
        city, plan = _city(self.seed), self.plan()
        sequence = SimulatedSequence(city, plan, _sensor(self.physics, self.seed))
        indices = np.arange(0, plan.scans, plan.scans // self.scans)
        faults = [sequence.degradations[i] for i in indices]
        return OpenDrive(
            sequence,
            indices,
            sequence.poses[indices],
            tuple(fault.kind.value if fault else '' for fault in faults),
            np.array([fault.severity if fault else 0.0 for fault in faults], np.float32),
        )

    def plan(self) -> SessionPlan:
        """The drive at its ordinary speed, of which `open` takes every so manieth scan."""
        rng = np.random.default_rng([self.seed, self.index])
        reverse = self.index % 3 == 2
        speed_mps = float(rng.uniform(6.0, 11.0))
        stride = max(1, round(self.spacing_m / (speed_mps * TRAINING_SENSOR.rotation_s)))
        return SessionPlan(
            name=self.name,
            seed=1000 * self.seed + self.index,
            scans=stride * self.scans,
            start_m=self.scans * self.spacing_m if reverse else 0.0,
            speed_mps=speed_mps,
            left_m=LANES_M[self.index % len(LANES_M)],
            reverse=reverse,
            traffic=float(rng.uniform(0.0, 20.0)),
            parked=float(rng.uniform(0.2, 0.9)),
            degraded=self.degraded,
            kinds=TRAINED_KINDS,
            physics=_physics(self.physics, self.seed),
            weather=_bad_weather(rng) if rng.random() < self.bad_weather else CLEAR,
        )


def _physics(kind: str, seed: int) -> RadarPhysics:
    if kind == 'nominal':
        return NOMINAL_PHYSICS
    return draw_physics(seed) if kind == 'drawn' else held_out_physics(seed)


def _sensor(physics: str, seed: int) -> SimulatedSensor:
    """Where physics is drawn, a third of the worlds have a radar that sees less far, down to a RADIATE's 100 m."""
    rng = np.random.default_rng([seed, 3])
    if physics == 'nominal' or rng.random() >= _SHORT_SIGHTED:
        return TRAINING_SENSOR
    share = float(rng.uniform(_LEAST_REACH, 1.0))
    return dataclasses.replace(TRAINING_SENSOR, range_bins=round(share * TRAINING_SENSOR.range_bins))


def _bad_weather(rng: np.random.Generator) -> Weather:
    """Rain, snow or fog, from light to about the worst there is, by even ratios."""
    share = float(rng.random())
    return (
        Weather(rain_mm_h=2.5 * 20.0**share),
        Weather(snow_mm_h=0.5 * 10.0**share),
        Weather(fog_visibility_m=500.0 * 0.1**share),
    )[int(rng.integers(3))]


@functools.lru_cache(maxsize=2)
def _city(seed: int) -> World:
    return make_city(CityPlan(seed=seed))


def simulated_drives(config: DataConfig | ValidationConfig) -> list[SimulatedDrive]:
    """Every drive through every simulated city of `config`."""
    return [
        SimulatedDrive(
            config.first_seed + world,
            index,
            config.scans,
            config.spacing_m,
            config.degraded,
            config.physics,
            config.bad_weather,
        )
        for world in range(config.worlds)
        for index in range(config.drives)
    ]
