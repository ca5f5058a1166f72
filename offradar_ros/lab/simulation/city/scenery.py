"""Collects the reflectors of a city, and the frames in which its objects are described."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.reflectors import Reflectors

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """The frame of an object: its corner, and the unit vector of its x axis, `along`; its y axis points to the left."""

    corner_m: Array
    along: Array

    def place(self, points_m: Array) -> Array:
        """(N, 2) metres in this frame → (N, 2) metres in the city."""
        left = np.array([-self.along[1], self.along[0]])
        return np.asarray(self.corner_m + points_m[:, :1] * self.along + points_m[:, 1:] * left)

    def place_poses(self, poses: Array) -> Array:
        """(N, 3) x, y, heading in this frame → the same in the city."""
        return np.column_stack([self.place(poses[:, :2]), poses[:, 2] + self.heading])

    @property
    def heading(self) -> float:
        """Direction of the x axis, radians counter-clockwise from east."""
        return float(np.arctan2(self.along[1], self.along[0]))


class Surfaces:
    """Collects walls and scatterers."""

    def __init__(self) -> None:
        self._walls: list[Array] = [np.empty((0, 2))]
        self._walls_m: list[Array] = [np.empty((0, 2, 2))]
        self._points: list[Array] = [np.empty((0, 3))]

    def add_walls(self, corners_m: Array, decibels: float, transmission: float, *, closed: bool = False) -> None:
        """Add walls from each of (K, 2) corners to the next; with `closed` also from the last to the first."""
        following = np.roll(corners_m, -1, axis=0)
        walls = np.stack([corners_m, following], axis=1)[: None if closed else -1]
        self._walls_m.append(walls)
        self._walls.append(np.tile([10.0 ** (decibels / 10.0), transmission], (len(walls), 1)))

    def add_points(self, points_m: Array, decibels: Array | float) -> None:
        """Add scatterers at (N, 2) points."""
        self._points.append(
            np.column_stack([points_m, np.broadcast_to(10.0 ** (np.asarray(decibels) / 10.0), len(points_m))])
        )

    def reflectors(self) -> Reflectors:
        """All walls and scatterers."""
        walls, points = np.concatenate(self._walls), np.concatenate(self._points)
        return Reflectors(np.concatenate(self._walls_m), walls[:, 0], walls[:, 1], points[:, :2], points[:, 2])


class Scenery(Surfaces):
    """Collects hard surfaces, vegetation, and parking places.

    Attributes:
        vegetation: leaves and twigs, whose returns depend on the season.
    """

    def __init__(self) -> None:
        super().__init__()
        self.vegetation = Surfaces()
        self._parking: dict[bool, list[Array]] = {on_street: [np.empty((0, 3))] for on_street in (True, False)}

    def add_parking(self, places: Array, *, on_street: bool) -> None:
        """Add parking places at (N, 3) x, y, heading."""
        self._parking[on_street].append(places)

    def parking(self, *, on_street: bool) -> Array:
        """(K, 3) x, y, heading of the parking places on streets, or of all others."""
        return np.concatenate(self._parking[on_street])
