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
from offradar_ros.lab.simulation.random_route import make_route
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.world import World

_MARGIN_M = 80.0
"""Distance from the outermost crossings to the edge of the city."""


def make_city(plan: CityPlan) -> World:
    """The world of a plan: streets, objects along and between them, and a route; the same plan gives the same city."""
    rng = np.random.default_rng([plan.seed, 5])
    streets = make_streets(rng, plan)
    low, high = streets.nodes_m.min(axis=0) - _MARGIN_M, streets.nodes_m.max(axis=0) + _MARGIN_M
    patches = Patches(rng, plan, streets.nodes_m)
    scenery, ground = Scenery(), Ground(low, high)
    for edge, line in streets.lines.items():
        ground.pave(line, streets.half_widths[edge])
    for edge, line in streets.lines.items():
        for side in (line, line[::-1]):
            Frontage(rng, side, streets.half_widths[edge], patches).add_to(scenery, ground)
    add_infill(scenery, ground, rng, patches, low, high)
    return World(
        reflectors=_off_the_road(scenery.reflectors(), ground),
        parking=scenery.parking()[ground.cars_off_the_lanes(scenery.parking()[:, :2])],
        route=make_route(streets, plan.seed, plan.route_m, plan.closed),
        streets=streets,
    )


def _off_the_road(reflectors: Reflectors, ground: Ground) -> Reflectors:
    """Without hedges, trees and poles of one street that stand on another."""
    return reflectors.select(
        ground.walls_off_the_road(reflectors.walls_m), ground.points_off_the_road(reflectors.scatterers_m)
    )
