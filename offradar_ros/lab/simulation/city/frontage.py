"""One side of a street: buildings, car parks or gardens, hedges, fences, trees, poles and parking places."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.city.building import add_building, footprint
from offradar_ros.lab.simulation.city.car_park import add_car_park
from offradar_ros.lab.simulation.city.fences import add_fence, add_guard_rail
from offradar_ros.lab.simulation.city.greenery import add_hedge, add_tree
from offradar_ros.lab.simulation.city.ground import Ground
from offradar_ros.lab.simulation.city.patches import Patches
from offradar_ros.lab.simulation.city.scenery import Frame, Scenery
from offradar_ros.lab.simulation.city.street_style import along_street
from offradar_ros.lab.simulation.city.style import Style
from offradar_ros.lab.simulation.route import polyline_at
from offradar_ros.lab.simulation.streets import Profile, StreetKind

Array = NDArray[np.float64]

_CORNER_M = 9.0
"""Distance from a crossing along each street that is kept free."""

_CAR_PARK_M = 2.5
"""Distance of a car park to the kerb and to the next plot."""

_ALLEYS = 0.5
"""Share of the sides of boulevards with a row of trees along the kerb."""


_KERBS = 0.8
"""Share of the sides of streets with kerbstones that a radar sees."""

_KERBSTONE_M = 1.3
_KERBSTONE_DB = (18.0, 34.0)


class Frontage:
    """The left side of a street along its (M, 2) line; cars do not park on the `second` side of a narrow street."""

    def __init__(
        self, rng: np.random.Generator, line_m: Array, profile: Profile, patches: Patches, *, second: bool
    ) -> None:
        self._rng, self._line, self._patches = rng, line_m, patches
        self._kind, self._half_width_m = profile.kind, profile.half_width_m
        self._parks = not (second and profile.kind is StreetKind.NARROW)
        self._length_m = float(np.sum(np.hypot(*np.diff(line_m, axis=0).T)))
        self._shift_m = float(rng.normal(0.0, 0.8))

    def add_to(self, scenery: Scenery, ground: Ground) -> None:
        """Add all plots along the street, then the objects on the kerb."""
        along = _CORNER_M
        while along < self._length_m - _CORNER_M:
            along += self._add_plot(scenery, ground, along)
        self._add_kerb(scenery)

    def _frame(self, along_m: float, aside_m: float) -> Frame:
        x, y, heading = polyline_at(self._line, np.array([along_m]), np.array([aside_m]))[0]
        return Frame(np.array([x, y]), np.array([np.cos(heading), np.sin(heading)]))

    def _style(self, along_m: float) -> Style:
        style = self._patches.at(self._frame(along_m, self._half_width_m + 10.0).corner_m)
        return along_street(style, self._kind)

    def _add_plot(self, scenery: Scenery, ground: Ground, along_m: float) -> float:
        """Add the plot that starts at `along_m`; returns the distance to the start of the next."""
        rng, style = self._rng, self._style(along_m)
        if rng.random() < style.car_parks:
            width = add_car_park(scenery, ground, rng, self._frame(along_m, self._half_width_m + _CAR_PARK_M))
            if width:
                return width + _CAR_PARK_M
        width, depth = float(rng.uniform(*style.width_m)), float(rng.uniform(*style.depth_m))
        # In an estate the fronts stand in one line.
        shift = self._shift_m if style.template is None else 0.0
        setback = max(1.2, style.setback_m + shift + float(rng.normal(0.0, style.uneven_m)))
        middle = self._frame(along_m + width / 2, self._half_width_m)
        kerb = Frame(middle.corner_m - middle.along * width / 2, middle.along)
        front = Frame(kerb.place(np.array([(0.0, setback)]))[0], kerb.along)
        if rng.random() < style.built:
            if not ground.claim(footprint(front, width, depth), 0.1):
                return 3.0
            own = rng if style.template is None else np.random.default_rng(style.template)
            add_building(scenery, own, style, front, width, depth)
        self._add_garden(scenery, kerb, style, width, setback)
        return width + (float(rng.uniform(*style.gap_m)) if rng.random() < style.gaps else 0.0)

    def _add_garden(self, scenery: Scenery, kerb: Frame, style: Style, width_m: float, setback_m: float) -> None:
        """Add a hedge or fence with a gap for the driveway, trees, and perhaps a parking place."""
        rng = self._rng
        if setback_m > 2.5:
            border = float(rng.uniform(1.2, min(3.0, setback_m - 1.0)))
            gap = float(rng.uniform(0.2, 0.7)) * width_m
            parts = [np.array([(0.0, border), (gap, border)]), np.array([(gap + 3.5, border), (width_m, border)])]
            for part in parts:
                if part[1, 0] - part[0, 0] > 1.5:
                    drawn = rng.random()
                    if drawn < style.hedges:
                        add_hedge(scenery, rng, kerb.place(part))
                    elif drawn < style.hedges + style.fences:
                        add_fence(scenery, rng, kerb.place(part))
            if rng.random() < 0.3 * style.gaps and setback_m > 7.2:
                place = np.array([(gap + 1.7, setback_m - 3.6, np.pi / 2)])
                scenery.add_parking(kerb.place_poses(place), on_street=False)
        for _ in range(rng.poisson(style.trees * width_m / 20.0)):
            place = np.array([(float(rng.uniform(0.0, width_m)), float(rng.uniform(1.2, max(1.5, setback_m - 1.0))))])
            add_tree(scenery, rng, kerb.place(place)[0], float(rng.uniform(0.6, 3.0)))

    def _add_kerb(self, scenery: Scenery) -> None:
        rng, length, half = self._rng, self._length_m, self._half_width_m
        self._add_kerbstones(scenery)
        style = self._style(length / 2)
        poles = np.arange(rng.uniform(0.2, 1.0) * style.poles_m, length, style.poles_m)
        poles = poles + rng.normal(0.0, 1.0, len(poles))
        places = polyline_at(self._line, poles, np.full(len(poles), half + 0.6) + rng.normal(0.0, 0.2, len(poles)))
        scenery.add_points(places[:, :2], style.pole_db + rng.normal(0.0, 3.0, len(poles)))
        # Signs, bins, hydrants and bollards.
        small = rng.uniform(0.0, length, rng.poisson(length / 12.0))
        places = polyline_at(self._line, small, half + rng.uniform(0.3, 2.0, len(small)))
        scenery.add_points(places[:, :2], rng.uniform(28.0, 48.0, len(small)))
        if rng.random() < style.rails:
            stations = np.arange(_CORNER_M + 3.0, length - _CORNER_M - 3.0, 6.0)
            if len(stations) > 1:
                add_guard_rail(
                    scenery, rng, polyline_at(self._line, stations, np.full(len(stations), half + 0.3))[:, :2]
                )
        if self._kind is StreetKind.BOULEVARD and rng.random() < _ALLEYS:
            self._add_alley(scenery)
        if rng.random() < style.parking and self._parks and half > (4.4 if self._kind is StreetKind.NARROW else 6.2):
            spots = np.arange(_CORNER_M + 5.0, length - _CORNER_M - 5.0, float(rng.uniform(5.8, 7.5)))
            places = polyline_at(self._line, spots, np.full(len(spots), half - 1.1))
            scenery.add_parking(places, on_street=True)

    def _add_kerbstones(self, scenery: Scenery) -> None:
        """A line of weak returns; entries and drains interrupt it, and some streets have none."""
        rng = self._rng
        if rng.random() > _KERBS:
            return
        stations = np.arange(_CORNER_M, self._length_m - _CORNER_M, _KERBSTONE_M)
        gaps = np.sin(stations / rng.uniform(3.0, 9.0) + rng.uniform(0.0, 2 * np.pi))
        stations = stations[gaps < rng.uniform(0.2, 1.0)]
        places = polyline_at(self._line, stations, self._half_width_m + rng.normal(0.0, 0.1, len(stations)))
        scenery.add_points(places[:, :2], rng.uniform(*_KERBSTONE_DB) + rng.normal(0.0, 4.0, len(stations)))

    def _add_alley(self, scenery: Scenery) -> None:
        """Add a row of trees of about the same size."""
        rng, size = self._rng, float(self._rng.uniform(1.0, 3.0))
        stations = np.arange(_CORNER_M + 2.0, self._length_m - _CORNER_M, float(rng.uniform(8.0, 14.0)))
        places = polyline_at(self._line, stations, np.full(len(stations), self._half_width_m + 1.0))
        for place in places[:, :2]:
            add_tree(scenery, rng, place, size * float(rng.uniform(0.7, 1.2)))
