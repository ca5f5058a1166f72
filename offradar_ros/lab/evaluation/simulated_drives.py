"""The simulated drives of a protocol."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path

from offradar_ros.lab.drives.simulated import SimulatedDrive, Street, physics_of
from offradar_ros.lab.evaluation.protocol import VALIDATION, Lane, Protocol, RealStreets
from offradar_ros.lab.simulation.sensor import TRAINING_SENSOR
from offradar_ros.lab.simulation.session_plan import SessionPlan

_LANE_SHARE = 1.2
"""Share of the path length that is driven: lanes curve and speeds vary, so that more than 1 is needed."""

FOLIAGE = (1.0, 0.0, 0.5)
"""Share of the leaves in the drives through a world, in turn: each is searched for in maps of another season."""


@dataclasses.dataclass(frozen=True)
class PlannedDrive:
    """A simulated drive of a protocol.

    Attributes:
        group: of the protocol.
        index: of the drive in its world.
        source: how to simulate it.
    """

    group: str
    index: int
    source: SimulatedDrive


def simulated_drives(protocol: Protocol, streets: Path | None) -> Iterator[PlannedDrive]:
    """Every simulated drive of every group, and of validation; those of `streets` only if that folder is given."""
    spacing_m = protocol.drive_spacing_m
    for group in protocol.groups:
        physics, degraded = group.physics, protocol.degraded
        for seed in group.cities:
            for index, lane in enumerate(protocol.lanes):
                drive = city_drive(seed, index, lane, physics, protocol.scans, spacing_m, degraded)
                yield PlannedDrive(group.name, index, drive)
        for street in group.streets if streets else ():
            for index in range(len(street.traversals)):
                drive = street_drive(street, index, physics, spacing_m, degraded, str(streets))
                yield PlannedDrive(group.name, index, drive)
    validation = protocol.validation
    for seed in validation.cities:
        drive = city_drive(seed, 0, protocol.lanes[0], validation.physics, validation.scans, spacing_m, 0.0)
        yield PlannedDrive(VALIDATION, 0, drive)


def city_drive(
    seed: int, index: int, lane: Lane, physics: str, scans: int, spacing_m: float, degraded: float
) -> SimulatedDrive:
    """Drive `index` through the procedural city of `seed`, which is also that of the radar's physics."""
    world = f'city_{seed}'
    step_m = SessionPlan().speed_mps * TRAINING_SENSOR.rotation_s
    plan = SessionPlan(
        name=f'{world}_{index + 1}',
        seed=1000 * seed + index,
        scans=math.ceil(_LANE_SHARE * scans * spacing_m / step_m) + 1,
        left_m=lane.left_m,
        start_m=lane.start_m,
        reverse=lane.reverse,
        foliage=FOLIAGE[index % len(FOLIAGE)],
        degraded=degraded,
        physics=physics_of(physics, seed),
    )
    return SimulatedDrive(world, seed, plan, spacing_m=spacing_m, scans=scans)


def street_drive(
    street: RealStreets, index: int, physics: str, spacing_m: float, degraded: float, folder: str
) -> SimulatedDrive:
    """Traversal `index` of a nav2 map, whose files are in `folder`."""
    plan = SessionPlan(
        name=f'{street.name}_{index + 1}',
        seed=1000 * street.seed + index,
        foliage=FOLIAGE[index % len(FOLIAGE)],
        degraded=degraded,
        physics=physics_of(physics, street.seed),
    )
    path = Street(folder, street.map, street.traversals[index], street.centre_m, street.radius_m)
    return SimulatedDrive(street.name, street.seed, plan, spacing_m=spacing_m, street=path)
