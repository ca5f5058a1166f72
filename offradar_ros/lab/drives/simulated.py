"""Simulated drives: through a procedural city, or along a recorded traversal of a nav2 map."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.simulation.city.make import make_city
from offradar_ros.lab.simulation.city.plan import CityPlan
from offradar_ros.lab.simulation.map_image import read_map_image
from offradar_ros.lab.simulation.map_world import load_map_world
from offradar_ros.lab.simulation.physics import (
    NOMINAL_PHYSICS,
    RadarPhysics,
    draw_physics,
    held_out_physics,
    unseen_physics,
)
from offradar_ros.lab.simulation.recorded_path import load_tum
from offradar_ros.lab.simulation.sensor import TRAINING_SENSOR, SimulatedSensor
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.lab.simulation.source_digest import source_digest
from offradar_ros.lab.simulation.world import World
from offradar_ros.recordings.spacing import subsample_by_distance

_DRAWS = {'drawn': draw_physics, 'held_out': held_out_physics, 'unseen': unseen_physics}


@dataclasses.dataclass(frozen=True)
class Street:
    """The part of a recorded traversal of a nav2 map that is within `radius_m` of a centre.

    Attributes:
        folder: folder of the files.
        map: YAML file of the map.
        traversal: TUM file.
        centre_m: east and north of the centre, metres; empty for the whole traversal.
        radius_m: scans that are further from the centre are left out.
    """

    folder: str
    map: str
    traversal: str
    centre_m: tuple[float, ...] = ()
    radius_m: float = 0.0


class Sampled(NamedTuple):
    """The scans of a simulated sequence that form a drive.

    Attributes:
        sequence: all scans.
        rows: (N,) indices of the scans, increasing.
        driven_m: (N,) float64, metres driven up to each.
    """

    sequence: SimulatedSequence
    rows: NDArray[np.intp]
    driven_m: NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class SimulatedDrive:
    """How to simulate a drive, and which of its scans are kept.

    Attributes:
        world: frame of its poses.
        seed: seed of the world.
        plan: plan of the drive; along a street, the traversal replaces its path and its number of scans.
        sensor: size of the scans.
        stride: every `stride`-th scan is kept,
        spacing_m: these are subsampled by this distance, 0 for all,
        scans: and the first `scans` of these remain, 0 for all.
        street: the map and traversal; None for the city of `seed`.
    """

    world: str
    seed: int
    plan: SessionPlan
    sensor: SimulatedSensor = TRAINING_SENSOR
    stride: int = 1
    spacing_m: float = 0.0
    scans: int = 0
    street: Street | None = None

    @property
    def name(self) -> str:
        """Name of the plan."""
        return self.plan.name

    def settings(self) -> dict[str, Any]:
        """All values but the folder of the street, with digests of its files and of the simulator's source."""
        # The plan's path is read from the traversal.
        values = dataclasses.asdict(self)
        files = ''
        if self.street:
            del values['street']['folder']
            files = _digest(self.street)
        return {**values, 'simulator': source_digest(), 'files': files}

    def sampled(self) -> Sampled:
        """The sequence, whose scans are rendered on demand, and the kept scans; DataError if a file cannot be read."""
        plan, street = self.plan, self.street
        if street:
            path = load_tum(Path(street.folder) / street.traversal)
            plan = dataclasses.replace(plan, path=path, scans=path.scans(self.sensor.rotation_s))
            world = load_map_world(Path(street.folder) / street.map, self.seed)
        else:
            world = _city(self.seed)
        sequence = SimulatedSequence(world, plan, self.sensor)
        positions_m = sequence.poses[:, :2]
        driven_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(positions_m, axis=0).T))])
        rows = np.arange(0, len(sequence), self.stride)
        rows = rows[subsample_by_distance(driven_m[rows], self.spacing_m)][: self.scans or None]
        if street and street.centre_m:
            rows = rows[np.hypot(*(positions_m[rows] - street.centre_m).T) <= street.radius_m]
            if not len(rows):
                raise DataError(f'{street.traversal}: never within {street.radius_m:g} m of the centre')
        return Sampled(sequence, rows, driven_m[rows])

    def open(self) -> Drive:
        """The drive; its key is its name, because its scans are not in a cache."""
        sequence, rows, driven_m = self.sampled()
        faults = [sequence.degradations[row] for row in rows.tolist()]
        return Drive(
            name=self.name,
            world=self.world,
            key=self.name,
            stamps_ns=sequence.stamps_ns[rows],
            poses=sequence.poses[rows],
            driven_m=driven_m,
            kinds=np.array([fault.kind.value if fault else '' for fault in faults], np.str_),
            severities=np.array([fault.severity if fault else 0.0 for fault in faults], np.float64),
            read_scan=lambda row: sequence.scan(int(rows[row])),
        )


def physics_of(name: str, seed: int) -> RadarPhysics:
    """The radar of the world of `seed`: ``nominal``, or drawn as in training, validation or results (`_DRAWS`)."""
    return NOMINAL_PHYSICS if name == 'nominal' else _DRAWS[name](seed)


@functools.lru_cache(maxsize=2)
def _city(seed: int) -> World:
    return make_city(CityPlan(seed=seed))


def _digest(street: Street) -> str:
    """SHA-256 of the files of a street."""
    folder = Path(street.folder)
    traversal, image = folder / street.traversal, read_map_image(folder / street.map)
    try:
        digest = hashlib.sha256(traversal.read_bytes())
    except OSError as error:
        raise DataError(f'{traversal}: cannot be read ({error.strerror}); the protocol names it') from None
    digest.update(repr((image.occupied.shape, image.resolution_m, image.origin)).encode())
    digest.update(image.occupied.tobytes())
    return digest.hexdigest()
