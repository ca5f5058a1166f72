"""The drives of a protocol: plain values that say everything about each, and how to simulate it."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.lab.evaluation.protocol import VALIDATION, Lane, Protocol, RealStreets
from offradar_ros.lab.simulation.city.make import make_city
from offradar_ros.lab.simulation.city.plan import CityPlan
from offradar_ros.lab.simulation.map_image import read_map_image
from offradar_ros.lab.simulation.map_world import load_map_world
from offradar_ros.lab.simulation.physics import NOMINAL_PHYSICS, RadarPhysics, draw_physics, held_out_physics
from offradar_ros.lab.simulation.recorded_path import load_tum
from offradar_ros.lab.simulation.sensor import TRAINING_SENSOR
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.recordings.spacing import subsample_by_distance

_LANE_SHARE = 1.2
"""Lanes curve and speeds vary: so much more is driven than the scans' spacing asks for."""


@dataclasses.dataclass(frozen=True)
class CityDrive:
    """A drive through a procedural city, whose seed is also that of the radar's physics."""

    group: str
    seed: int
    index: int
    lane: Lane
    physics: str
    scans: int
    spacing_m: float
    degraded: float

    @property
    def world(self) -> str:
        """The frame of its poses."""
        return f'city_{self.seed}'

    def simulate(self) -> Simulated:
        """Scans are rendered when they are asked for."""
        plan = SessionPlan(
            name=f'{self.world}_{self.index + 1}',
            seed=1000 * self.seed + self.index,
            left_m=self.lane.left_m,
            start_m=self.lane.start_m,
            reverse=self.lane.reverse,
            degraded=self.degraded,
            physics=physics_of(self.physics, self.seed),
        )
        way_m = plan.speed_mps * TRAINING_SENSOR.rotation_s
        plan = dataclasses.replace(plan, scans=math.ceil(_LANE_SHARE * self.scans * self.spacing_m / way_m) + 1)
        sequence = SimulatedSequence(make_city(CityPlan(seed=self.seed)), plan, TRAINING_SENSOR)
        return _taken(sequence, self.spacing_m, self.scans)

    def source_digest(self) -> str:
        """Of the files that the drive is made from: there are none."""
        return ''


def physics_of(name: str, seed: int) -> RadarPhysics:
    """The radar of a world of this seed, as the protocol names it."""
    if name == 'nominal':
        return NOMINAL_PHYSICS
    return (draw_physics if name == 'drawn' else held_out_physics)(seed)


class Simulated(NamedTuple):
    """A sequence, which N of its scans are taken, and (N,) metres driven up to each."""

    sequence: SimulatedSequence
    indices: NDArray[np.intp]
    driven_m: NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class StreetDrive:
    """A recorded traversal of a nav2 map; files are in `folder`."""

    group: str
    street: RealStreets
    index: int
    physics: str
    spacing_m: float
    degraded: float
    folder: str

    @property
    def world(self) -> str:
        """The frame of its poses."""
        return self.street.name

    def simulate(self) -> Simulated:
        """Scans are rendered when they are asked for."""
        path = load_tum(Path(self.folder) / self.street.traversals[self.index])
        plan = SessionPlan(
            name=f'{self.world}_{self.index + 1}',
            seed=1000 * self.street.seed + self.index,
            scans=path.scans(TRAINING_SENSOR.rotation_s),
            path=path,
            degraded=self.degraded,
            physics=physics_of(self.physics, self.street.seed),
        )
        world = load_map_world(Path(self.folder) / self.street.map, self.street.seed)
        sequence = SimulatedSequence(world, plan, TRAINING_SENSOR)
        taken = _taken(sequence, self.spacing_m, len(sequence))
        if not self.street.centre_m:
            return taken
        away_m = np.hypot(*(sequence.poses[taken.indices, :2] - self.street.centre_m).T)
        near = away_m <= self.street.radius_m
        if not near.any():
            raise DataError(
                f'{self.street.traversals[self.index]}: never within {self.street.radius_m:g} m of the centre'
            )
        return Simulated(sequence, taken.indices[near], taken.driven_m[near])

    def source_digest(self) -> str:
        """Of the files that the drive is made from."""
        folder = Path(self.folder)
        traversal = folder / self.street.traversals[self.index]
        image = read_map_image(folder / self.street.map)
        try:
            digest = hashlib.sha256(traversal.read_bytes())
        except OSError as error:
            raise DataError(f'{traversal}: cannot be read ({error.strerror}); the protocol names it') from None
        digest.update(repr((image.occupied.shape, image.resolution_m, image.origin)).encode())
        digest.update(image.occupied.tobytes())
        return digest.hexdigest()


SimulatedDrive = CityDrive | StreetDrive


def _taken(sequence: SimulatedSequence, spacing_m: float, scans: int) -> Simulated:
    steps = np.diff(sequence.poses[:, :2], axis=0)
    driven_m = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
    indices = subsample_by_distance(driven_m, spacing_m)[:scans]
    return Simulated(sequence, indices, driven_m[indices])


def drives_of(protocol: Protocol, real_worlds: Path | None) -> Iterator[SimulatedDrive]:
    """Every drive of every group, and the validation drives; those of streets only where a folder of them is given."""
    for group in protocol.groups:
        for seed in group.cities:
            for index, lane in enumerate(protocol.lanes):
                yield CityDrive(
                    group.name,
                    seed,
                    index,
                    lane,
                    group.physics,
                    protocol.scans,
                    protocol.drive_spacing_m,
                    protocol.degraded,
                )
        for street in group.streets if real_worlds else ():
            for index in range(len(street.traversals)):
                yield StreetDrive(
                    group.name,
                    street,
                    index,
                    group.physics,
                    protocol.drive_spacing_m,
                    protocol.degraded,
                    str(real_worlds),
                )
    for seed in protocol.validation.cities:
        yield CityDrive(
            VALIDATION,
            seed,
            0,
            protocol.lanes[0],
            protocol.validation.physics,
            protocol.validation.scans,
            protocol.drive_spacing_m,
            0.0,
        )
