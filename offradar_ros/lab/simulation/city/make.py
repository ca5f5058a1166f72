"""A city from its plan."""

from __future__ import annotations

import numpy as np

from offradar_ros.lab.simulation.city.frontage import Frontage
from offradar_ros.lab.simulation.city.ground import Ground
from offradar_ros.lab.simulation.city.infill import add_infill
from offradar_ros.lab.simulation.city.lattice import make_streets
from offradar_ros.lab.simulation.city.patches import Patches
from offradar_ros.lab.simulation.city.plan import CityPlan
from offradar_ros.lab.simulation.city.scenery import Scenery
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.walk import make_route
from offradar_ros.lab.simulation.world import World

_BEYOND_M = 80.0
"""The city goes on this far beyond its last streets."""


def make_city(plan: CityPlan) -> World:
    """Streets, what stands along them and between them, and a route; the same plan gives the same city."""
    rng = np.random.default_rng([plan.seed, 5])
    streets = make_streets(rng, plan)
    low, high = streets.nodes_m.min(axis=0) - _BEYOND_M, streets.nodes_m.max(axis=0) + _BEYOND_M
    patches = Patches(rng, plan, streets.nodes_m)
    scenery, ground = Scenery(), Ground(low, high)
    for edge, line in streets.lines.items():
        ground.pave(line, streets.half_widths[edge])
    for edge, line in streets.lines.items():
        for side in (line, line[::-1]):
            Frontage(rng, side, streets.half_widths[edge], patches).add_to(scenery, ground)
    add_infill(scenery, ground, rng, patches, low, high)
    return World(
        reflectors=_beside_the_road(scenery.reflectors(), ground),
        parking=scenery.parking()[ground.cars_off_the_lanes(scenery.parking()[:, :2])],
        route=make_route(streets, plan.seed, plan.route_m, plan.closed),
        streets=streets,
    )


def _beside_the_road(seen: Reflectors, ground: Ground) -> Reflectors:
    """Without hedges, branches and poles that one street would have in the middle of another."""
    walls, points = ground.walls_off_the_road(seen.walls_m), ground.points_off_the_road(seen.scatterers_m)
    return Reflectors(
        seen.walls_m[walls],
        seen.wall_powers[walls],
        seen.wall_through[walls],
        seen.scatterers_m[points],
        seen.scatterer_powers[points],
    )
