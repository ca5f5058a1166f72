"""The test region of a split: circles and polygons in UTM."""

from __future__ import annotations

import dataclasses
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import ConfigError
from offradar_ros.geometry import geodetic_to_utm


@dataclasses.dataclass(frozen=True)
class Circle:
    """A disc in UTM.

    Attributes:
        northing_m: of its centre, metres.
        easting_m: of its centre, metres.
        radius_m: above 0, metres.
    """

    northing_m: float
    easting_m: float
    radius_m: float

    def __post_init__(self) -> None:
        if not self.radius_m > 0.0:
            raise ConfigError(f'circle: expected a radius_m above 0, got {self.radius_m:g}')

    def outside_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) metres that (N, 2) easting, northing lie outside; negative inside."""
        return np.asarray(np.hypot(*(points_m - (self.easting_m, self.northing_m)).T) - self.radius_m)


@dataclasses.dataclass(frozen=True)
class Polygon:
    """A polygon of straight sides; `vertices` are easting, northing in metres of UTM, in either sense of rotation."""

    vertices: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        if len(self.vertices) < 3 or any(len(vertex) != 2 for vertex in self.vertices):
            raise ConfigError('polygon: expected at least three vertices of two numbers, easting and northing')

    def outside_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) metres that (N, 2) easting, northing lie outside; negative inside."""
        # From the first vertex: OpenCV computes in float32, which resolves a northing to half a metre only.
        first = np.array(self.vertices[0])
        outline = (np.array(self.vertices) - first).astype(np.float32)
        relative = (points_m - first).tolist()
        return np.array([-cv2.pointPolygonTest(outline, point, True) for point in relative], np.float64)


@dataclasses.dataclass(frozen=True)
class Region:
    """The union of circles and polygons in the UTM zone `epsg`; without any, no region: no point is inside."""

    epsg: int = 0
    circles: tuple[Circle, ...] = ()
    polygons: tuple[Polygon, ...] = ()

    def __post_init__(self) -> None:
        zone = self.epsg % 100
        if self and not (self.epsg // 100 in (326, 327) and 1 <= zone <= 60):
            raise ConfigError(f'key epsg: expected the code of a UTM zone, 326zz north or 327zz south, got {self.epsg}')

    def __bool__(self) -> bool:
        return bool(self.circles or self.polygons)

    def outside_m(self, points_lla: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) float64 metres that (N, 3) latitude°, longitude°, altitude m lie outside; 0 or negative inside.

        Infinite without a region, and NaN for a point that is not finite.
        """
        outside_m = np.full(len(points_lla), math.inf)
        known = np.isfinite(points_lla).all(axis=1)
        outside_m[~known] = math.nan
        if self and known.any():
            points_m = geodetic_to_utm(points_lla[known], self.epsg)[:, :2]
            shapes: list[Circle | Polygon] = [*self.circles, *self.polygons]
            outside_m[known] = np.min([shape.outside_m(points_m) for shape in shapes], axis=0)
        return outside_m
