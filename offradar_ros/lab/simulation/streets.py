"""The road network of a world."""

from __future__ import annotations

import dataclasses
import enum
import functools
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.roundabout import Roundabout

Array = NDArray[np.float64]
Edge = tuple[int, int]


class StreetKind(str, enum.Enum):
    """Kinds of streets."""

    NARROW = 'narrow'
    ORDINARY = 'ordinary'
    BOULEVARD = 'boulevard'
    OPEN_ROAD = 'open road'


@dataclasses.dataclass(frozen=True)
class Profile:
    """A street across.

    Attributes:
        kind: kind of the street.
        half_width_m: half the width between its kerbs.
        median_m: half the width of the median along its centre line; 0 for none.
    """

    kind: StreetKind
    half_width_m: float
    median_m: float = 0.0


@dataclasses.dataclass(frozen=True, eq=False)
class Streets:
    """A road network.

    Attributes:
        nodes_m: (N, 2) float64, crossings.
        inner: (N,) bool, whether routes may use a crossing: the city surrounds it.
        lines: two nodes of each street, the lower first → (M, 2) float64, its centre line from one to the other.
        profiles: the profile of each street.
        roundabouts: crossings that are roundabouts.
    """

    nodes_m: Array
    inner: NDArray[np.bool_]
    lines: dict[Edge, Array]
    profiles: dict[Edge, Profile]
    roundabouts: dict[int, Roundabout] = dataclasses.field(default_factory=dict)

    def line(self, start: int, end: int) -> Array:
        """(M, 2) centre line from node to node."""
        return self.lines[start, end] if start < end else self.lines[end, start][::-1]

    def joined(self, parts: Sequence[Array], nodes: Sequence[int]) -> Array:
        """One (M, 2) line of several, each of which meets the next at the next of `nodes`; it goes round islands."""
        line = parts[0]
        for node, part in zip(nodes, parts[1:], strict=True):
            roundabout = self.roundabouts.get(node)
            line = roundabout.joined(line, part) if roundabout else np.concatenate([line, part])
        return line

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
