"""A city from its plan."""

from __future__ import annotations

import numpy as np

from offradar_ros.lab.simulation.city.frontage import Frontage
from offradar_ros.lab.simulation.city.ground import Ground
from offradar_ros.lab.simulation.city.infill import add_infill
from offradar_ros.lab.simulation.city.island import add_island
from offradar_ros.lab.simulation.city.lattice import make_streets
from offradar_ros.lab.simulation.city.median import add_median
from offradar_ros.lab.simulation.city.patches import Patches
from offradar_ros.lab.simulation.city.plan import CityPlan
from offradar_ros.lab.simulation.city.scenery import Scenery
from offradar_ros.lab.simulation.random_route import make_route
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.streets import Streets
from offradar_ros.lab.simulation.world import World

_MARGIN_M = 80.0
"""Distance from the outermost crossings to the edge of the city."""


_REGULAR = 0.15
"""Share of the cities that are a regular grid of straight streets."""

_MEDIAN_M = 5.0
"""Distance of medians to the edges of crossings."""


def make_city(plan: CityPlan) -> World:
    """The world of a plan: streets, objects along and between them, and a route; the same plan gives the same city."""
    rng = np.random.default_rng([plan.seed, 5])
    regular = bool(rng.random() < _REGULAR)
    streets = make_streets(rng, plan, regular)
    low, high = streets.nodes_m.min(axis=0) - _MARGIN_M, streets.nodes_m.max(axis=0) + _MARGIN_M
    patches = Patches(rng, plan, streets.nodes_m, regular)
    scenery, ground = Scenery(), Ground(low, high)
    _add_roads(scenery, ground, rng, streets)
    for edge, line in streets.lines.items():
        for second, side in enumerate((line, line[::-1])):
            Frontage(rng, side, streets.profiles[edge], patches, second=bool(second)).add_to(scenery, ground)
    add_infill(scenery, ground, rng, patches, low, high)
    kerbs, others = (scenery.parking(on_street=on_street) for on_street in (True, False))
    kerbs, others = kerbs[ground.places_on_one_street(kerbs)], others[ground.places_off_the_road(others)]
    return World(
        reflectors=_off_the_road(scenery.reflectors(), ground),
        vegetation=_off_the_road(scenery.vegetation.reflectors(), ground),
        parking=np.concatenate([kerbs, others]),
        route=make_route(streets, plan.seed, plan.route_m, plan.closed),
        streets=streets,
        road=ground.road(kerbs),
        ground_seed=plan.seed,
    )


def _add_roads(scenery: Scenery, ground: Ground, rng: np.random.Generator, streets: Streets) -> None:
    """Pave all streets and roundabouts, then add medians and islands."""
    for edge, line in streets.lines.items():
        ground.pave(line, streets.profiles[edge].half_width_m)
    for roundabout in streets.roundabouts.values():
        ground.pave_circle(roundabout.centre_m, roundabout.outer_m)
    for edge, line in streets.lines.items():
        if streets.profiles[edge].median_m:
            start, end = (_crossing_m(streets, node) + _MEDIAN_M for node in edge)
            add_median(scenery, ground, rng, line, streets.profiles[edge], (start, end))
    for roundabout in streets.roundabouts.values():
        add_island(scenery, ground, rng, roundabout)


def _crossing_m(streets: Streets, node: int) -> float:
    """Distance from a crossing to its edge, along its streets."""
    if node in streets.roundabouts:
        return streets.roundabouts[node].outer_m
    joined = streets.neighbours[node]
    return max(streets.profiles[min(node, other), max(node, other)].half_width_m for other in joined)


def _off_the_road(reflectors: Reflectors, ground: Ground) -> Reflectors:
    """Without hedges, trees and poles of one street that stand on another."""
    return reflectors.select(
        ground.walls_off_the_road(reflectors.walls_m), ground.points_off_the_road(reflectors.scatterers_m)
    )
