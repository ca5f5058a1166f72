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
        inner: (N,) bool, whether routes may use a crossing: the city surrounds it.
        lines: two nodes of each street, the lower first → (M, 2) float64, its centre line from one to the other.
        half_widths: half the width of each street between its kerbs, metres.
    """

    nodes_m: Array
    inner: NDArray[np.bool_]
    lines: dict[Edge, Array]
    half_widths: dict[Edge, float]

    def line(self, start: int, end: int) -> Array:
        """(M, 2) centre line from node to node."""
        return self.lines[start, end] if start < end else self.lines[end, start][::-1]

    @functools.cached_property
    def neighbours(self) -> dict[int, list[int]]:
        """Nodes that a street joins to each node."""
        return neighbours(self.lines)


def neighbours(edges: Iterable[Edge]) -> dict[int, list[int]]:
    """Nodes that an edge joins to each node, in the order of the edges."""
    found: dict[int, list[int]] = {}
    for a, b in edges:
        found.setdefault(a, []).append(b)
        found.setdefault(b, []).append(a)
    return found
