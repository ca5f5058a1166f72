"""Parameters of one simulated drive through a world."""

from __future__ import annotations

import dataclasses

from offradar_ros.errors import ConfigError
from offradar_ros.lab.simulation.degradation import DegradationKind
from offradar_ros.lab.simulation.physics import NOMINAL_PHYSICS, RadarPhysics
from offradar_ros.lab.simulation.recorded_path import RecordedPath
from offradar_ros.lab.simulation.weather import CLEAR, Weather


@dataclasses.dataclass(frozen=True)
class SessionPlan:
    """One drive; the same plan always gives the same scans.

    Attributes:
        name: name of the drive.
        seed: of its noise, traffic, parked cars and degradations.
        scans: number of scans.
        path: a recorded path, driven at its recorded speed; None for the world's route.
        start_m: arc length of the route or path at the start.
        speed_mps: mean speed on a route between stops; it varies by an eighth.
        stops: number of stops on a route, of 4 s to 12 s each.
        left_m: mean lane offset to the left of the line; on a route it varies by 0.3 m, and is less where the road is
            not so wide or goes round obstacles.
        reverse: whether the line is driven backwards.
        traffic: other vehicles per kilometre of the line.
        parked: share of the parking places that are occupied.
        foliage: share of the leaves that vegetation has: 0 bare, 1 in leaf.
        degraded: share of the scans that are degraded; `kinds` and severities from 0.05 to 1 are drawn uniformly.
        kinds: kinds of degradation.
        physics: parameters of the radar and of surfaces.
        weather: rain, snow and fog.
        start_ns: stamp of the start.
    """

    name: str = 'drive'
    seed: int = 0
    scans: int = 200
    path: RecordedPath | None = None
    start_m: float = 0.0
    speed_mps: float = 8.0
    stops: int = 0
    left_m: float = 0.0
    reverse: bool = False
    traffic: float = 8.0
    parked: float = 0.6
    foliage: float = 1.0
    degraded: float = 0.0
    kinds: tuple[DegradationKind, ...] = tuple(DegradationKind)
    physics: RadarPhysics = NOMINAL_PHYSICS
    weather: Weather = CLEAR
    start_ns: int = 1_700_000_000_000_000_000

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ('seed', self.seed, 0, 2**63),
            ('scans', self.scans, 0, 10**7),
            ('speed_mps', self.speed_mps, 0.0, 100.0),
            ('stops', self.stops, 0, 10_000),
            ('traffic', self.traffic, 0.0, 500.0),
            ('parked', self.parked, 0.0, 1.0),
            ('foliage', self.foliage, 0.0, 1.0),
            ('degraded', self.degraded, 0.0, 1.0),
        ):
            if not low <= value <= high:
                raise ConfigError(f'{name} of a simulated drive: expected {low} to {high}, got {value}')
        if self.degraded and not self.kinds:
            raise ConfigError('kinds of a simulated drive: expected at least one kind of degradation, got none')
