"""What a city's parts add to it, piece by piece, and the frame that a piece is drawn in."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.reflectors import Reflectors

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """Where a piece is: its corner in the city, and the unit vector that its x axis, `along`, points to; y is left."""

    corner_m: Array
    along: Array

    def place(self, points_m: Array) -> Array:
        """(N, 2) metres along and to the left → (N, 2) in the city."""
        left = np.array([-self.along[1], self.along[0]])
        return np.asarray(self.corner_m + points_m[:, :1] * self.along + points_m[:, 1:] * left)

    @property
    def heading(self) -> float:
        """Of the x axis, counter-clockwise from east."""
        return float(np.arctan2(self.along[1], self.along[0]))


class Scenery:
    """Collects walls, points and places to park."""

    def __init__(self) -> None:
        self._walls: list[Array] = [np.empty((0, 2))]
        self._walls_m: list[Array] = [np.empty((0, 2, 2))]
        self._points: list[Array] = [np.empty((0, 3))]
        self._parking: list[Array] = [np.empty((0, 3))]

    def add_walls(self, corners_m: Array, decibels: float, through: float, *, closed: bool = False) -> None:
        """Walls from each of (K, 2) corners to the next."""
        following = np.roll(corners_m, -1, axis=0)
        walls = np.stack([corners_m, following], axis=1)[: None if closed else -1]
        self._walls_m.append(walls)
        self._walls.append(np.tile([10.0 ** (decibels / 10.0), through], (len(walls), 1)))

    def add_points(self, points_m: Array, decibels: Array | float) -> None:
        """Scatterers at (N, 2)."""
        self._points.append(
            np.column_stack([points_m, np.broadcast_to(10.0 ** (np.asarray(decibels) / 10.0), len(points_m))])
        )

    def add_parking(self, points_m: Array, heading: float) -> None:
        """Places to park at (N, 2)."""
        self._parking.append(np.column_stack([points_m, np.full(len(points_m), heading)]))

    def reflectors(self) -> Reflectors:
        """Everything but parked cars."""
        walls, points = np.concatenate(self._walls), np.concatenate(self._points)
        return Reflectors(np.concatenate(self._walls_m), walls[:, 0], walls[:, 1], points[:, :2], points[:, 2])

    def parking(self) -> Array:
        """(K, 3) x, y, heading."""
        return np.concatenate(self._parking)
