"""Which district a point of the city lies in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.city.plan import CityPlan
from offradar_ros.lab.simulation.city.style import ESTATES, Style, as_estate, draw_style

_BLOCKS_A_PATCH = 4
_ESTATES = {False: 0.2, True: 0.6}
"""Share of the districts of kinds `ESTATES` that repeat one building: more in a regular grid."""


class Patches:
    """Districts around random centres; each kind of the plan occurs once before any occurs again."""

    def __init__(self, rng: np.random.Generator, plan: CityPlan, nodes_m: NDArray[np.float64], regular: bool) -> None:
        count = max(len(plan.districts), round((plan.blocks[0] + 2) * (plan.blocks[1] + 2) / _BLOCKS_A_PATCH))
        rounds = -(-count // len(plan.districts))
        kinds = [plan.districts[i] for _ in range(rounds) for i in rng.permutation(len(plan.districts))][:count]
        drawn = [draw_style(rng, kind) for kind in kinds]
        self.styles: tuple[Style, ...] = tuple(
            as_estate(rng, style) if style.kind in ESTATES and rng.random() < _ESTATES[regular] else style
            for style in drawn
        )
        self._centres_m = _spread(rng, count, nodes_m, plan.block_m)

    def at(self, point_m: NDArray[np.float64]) -> Style:
        """The style at a (2,) point."""
        return self.styles[int(np.argmin(np.sum((self._centres_m - point_m) ** 2, axis=1)))]


def _spread(rng: np.random.Generator, count: int, nodes_m: NDArray[np.float64], jitter_m: float) -> NDArray[np.float64]:
    """(count, 2) points near nodes; each is the one of eight random points that is farthest from all before it."""
    points = np.empty((0, 2))
    while len(points) < count:
        drawn = nodes_m[rng.integers(len(nodes_m), size=8)] + rng.uniform(-0.5, 0.5, (8, 2)) * jitter_m
        nearest = np.min(np.sum((drawn[:, None] - points[None]) ** 2, axis=2), axis=1, initial=np.inf)
        points = np.vstack([points, drawn[[int(np.argmax(nearest))]]])
    return points
