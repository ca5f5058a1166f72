"""The places of a map as a road network: which are neighbours, how much road each stands for, where the road ends."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import RefusedInput

MAX_PAIRS = 10_000_000
"""Most pairs of places that are near one another: of 200,000 places along roads, each has some ten neighbours."""

STRIDE_M = 10.0
"""Distance driven in one stride, the unit of motion. Neighbours are the places up to a stride plus the spacing away."""


class PlaceGraph:
    """Neighbours among N places, in the plane: heights are not used, because GPS altitudes differ between sessions.

    Attributes:
        positions_m: (N, 2) float64, in the ``map`` frame.
        shares: (N,) float64 ρ, sum 1: the share of the mapped road that each place stands for. A place counts
            1 / (number of places within half the spacing), so that a road mapped twice as densely counts no more.
        ends: (N,) float64 in [0, 1]: 0 where mapped road goes on in opposite directions, 1 where all of it is on one
            side, or there is none: e = |Σ_j ρ_j (x_j − x_i)| / Σ_j ρ_j |x_j − x_i| over the neighbours j of i.
    """

    def __init__(self, positions_m: NDArray[np.float64], spacing_m: float, tolerance_m: float) -> None:
        """RefusedInput('map_too_dense') for more than `MAX_PAIRS` neighbours, which memory has no room for."""
        # Imported here, because who has no map to search needs no SciPy.
        from scipy.spatial import cKDTree  # noqa: PLC0415

        self.positions_m = positions_m
        self._reach_m, self._tolerance_m = STRIDE_M + spacing_m, tolerance_m
        self._tree = cKDTree(positions_m)
        pairs = self._pairs(max(self._reach_m, tolerance_m))
        distances_m = np.hypot(*(positions_m[pairs[:, 0]] - positions_m[pairs[:, 1]]).T)
        near = pairs[distances_m <= spacing_m / 2]
        counts = 1.0 + np.bincount(near.ravel(), minlength=len(positions_m))
        self.shares: NDArray[np.float64] = (1.0 / counts) / np.sum(1.0 / counts)

        reached = distances_m <= self._reach_m
        # A place is its own neighbour: the vehicle may stay in its cell.
        self._neighbours = self._symmetric(pairs[reached], np.ones(int(reached.sum())), 1.0)
        self._shares_reached: NDArray[np.float64] = self._neighbours @ self.shares
        lengths = self._symmetric(pairs[reached], distances_m[reached], 0.0) @ self.shares
        towards = self._neighbours @ (self.shares[:, None] * positions_m)
        towards -= self._shares_reached[:, None] * positions_m
        alone = lengths <= 0.0
        ends = np.hypot(*towards.T) / np.where(alone, 1.0, lengths)
        self.ends: NDArray[np.float64] = np.where(alone, 1.0, np.minimum(ends, 1.0))

        tolerated = distances_m <= tolerance_m
        kernel = 1.0 - (distances_m[tolerated] / tolerance_m) ** 2
        self._near = self._symmetric(pairs[tolerated], kernel, 1.0)

    def __len__(self) -> int:
        return len(self.positions_m)

    def driven(self, mass: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) probabilities after a stride along mapped road: (Kᵀ b)_j, K_ij = ρ_j / Σ_k ρ_k, j and k neighbours of i.

        Anywhere in reach is equally likely for each metre of road, because the direction is not known.
        """
        spread: NDArray[np.float64] = self.shares * (self._neighbours @ (mass / self._shares_reached))
        return spread

    def best(self, mass: NDArray[np.float64]) -> int:
        """The row of the place with the most probability around it: the first largest of Σ_j b_j (1 − d_ij² / tol²).

        Nearer places count more (Epanechnikov's kernel), because otherwise every place within the tolerance of a
        certain one would be as good as it.
        """
        return int(np.argmax(self._near @ mass))

    def around(self, row: int) -> NDArray[np.intp]:
        """(M,) ascending rows of the places within the tolerance of this one, itself included."""
        return np.sort(np.asarray(self._tree.query_ball_point(self.positions_m[row], self._tolerance_m), np.intp))

    def moved_in(self, positions_m: NDArray[np.float64], mass: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) probabilities that (M,) `mass` at (M, 2) other positions gives to the places in reach, by their shares.

        Mass with no place in reach is not in the sum.
        """
        rows = self._tree.query_ball_point(positions_m, self._reach_m)
        found = np.zeros(len(self))
        for near, part in zip(rows, mass.tolist(), strict=True):
            if near:
                found[near] += part * self.shares[near] / self.shares[near].sum()
        return found

    def _pairs(self, distance_m: float) -> NDArray[np.intp]:
        # Counted first: places that are all in one spot have as many pairs as the square of their number.
        count = (int(self._tree.count_neighbors(self._tree, distance_m)) - len(self)) // 2
        if count > MAX_PAIRS:
            raise RefusedInput(
                'map_too_dense',
                f'{count} pairs of places are within {distance_m:g} m of one another: expected at most {MAX_PAIRS}, of '
                'places along roads',
            )
        pairs: NDArray[np.intp] = self._tree.query_pairs(distance_m, output_type='ndarray')
        return pairs.reshape(-1, 2)

    def _symmetric(self, pairs: NDArray[np.intp], values: NDArray[np.float64], diagonal: float) -> Any:
        """The sparse (N, N) matrix with `values` at (M, 2) `pairs` and mirrored, and `diagonal`."""
        from scipy.sparse import csr_array  # noqa: PLC0415

        own = np.arange(len(self))
        rows = np.concatenate([pairs[:, 0], pairs[:, 1], own])
        columns = np.concatenate([pairs[:, 1], pairs[:, 0], own])
        data = np.concatenate([values, values, np.full(len(own), diagonal)])
        return csr_array((data, (rows, columns)), shape=(len(self), len(self)))
