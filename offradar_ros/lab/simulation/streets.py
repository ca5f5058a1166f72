"""The road network of a world."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Edge = tuple[int, int]


@dataclasses.dataclass(frozen=True, eq=False)
class Streets:
    """A road network.

    Attributes:
        nodes_m: (N, 2) float64, crossings.
        inner: (N,) whether routes may use a crossing: the city goes on around it.
        lines: every street's two nodes, the lower first → (M, 2) float64, its middle line from one to the other.
        half_widths: every street's half width between the kerbs, metres.
    """

    nodes_m: Array
    inner: NDArray[np.bool_]
    lines: dict[Edge, Array]
    half_widths: dict[Edge, float]

    def line(self, start: int, end: int) -> Array:
        """(M, 2) from node to node."""
        return self.lines[start, end] if start < end else self.lines[end, start][::-1]

    @functools.cached_property
    def around(self) -> dict[int, list[int]]:
        """Every node's neighbours along streets."""
        return neighbours(self.lines)


def neighbours(edges: Iterable[Edge]) -> dict[int, list[int]]:
    """Every node's neighbours, in the order of the edges."""
    around: dict[int, list[int]] = {}
    for a, b in edges:
        around.setdefault(a, []).append(b)
        around.setdefault(b, []).append(a)
    return around
