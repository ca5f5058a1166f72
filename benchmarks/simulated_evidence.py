"""Streets of which a part is mapped, drives through them, and evidence drawn for each scan; no radar is simulated.

Similarities r are normal: mean 8 and standard deviation 3 at the right places, mean −3 and 3 at all others. The
evidence is their exact log likelihood ratio, (11 r − 27.5) / 9: calibrated, as the filter expects it. Among the others
there is at times an impostor, drawn as if it were right, which the ratio does not know of.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from belief_figures import RIGHT_WITHIN_M, Seen
from numpy.typing import NDArray

from offradar_ros.belief.place_belief import PlaceBelief

RIGHT, OTHERS, SIGMA, OWN_SIGMA = 8.0, -3.0, 3.0, 1.0
DEGRADED, IMPOSTORS = 0.35, 0.02
"""Shares of scans."""
STEP_M, PERIOD_NS = 2.5, 250_000_000
"""Ten metres a second, four scans a second."""


@dataclasses.dataclass(frozen=True)
class Streets:
    """A square grid of streets, with places on the mapped ones.

    Attributes:
        blocks: number of blocks along a side.
        block_m: length of a block, metres.
        spacing_m: distance between places of one street, metres.
        positions_m: (N, 2) float64 of the places.
    """

    blocks: int
    block_m: float
    spacing_m: float
    positions_m: NDArray[np.float64]

    @classmethod
    def drawn(cls, blocks: int, spacing_m: float, mapped: float, seed: int, block_m: float = 120.0) -> Streets:
        """Streets of which each block is mapped with probability `mapped`, places 1 m (standard deviation) off it."""
        rng = np.random.default_rng(seed)
        along = np.arange(spacing_m / 2, block_m, spacing_m)
        places = []
        for line in range(blocks + 1):
            for block in range(blocks):
                street = np.stack([block * block_m + along, np.full(len(along), line * block_m)], axis=1)
                places += [street_ for street_ in (street, street[:, ::-1]) if rng.random() < mapped]
        positions_m = np.concatenate(places)
        return cls(blocks, block_m, spacing_m, positions_m + rng.normal(0.0, 1.0, positions_m.shape))

    def drive(self, scans: int, step_m: float, rng: np.random.Generator) -> NDArray[np.float64]:
        """(scans, 2) positions of a drive from anywhere, with any turn at crossings except back."""
        crossing = rng.integers(0, self.blocks + 1, 2)
        heading = np.array([0, 0])
        corners = [crossing]
        while (len(corners) - 2) * self.block_m < scans * step_m:
            turns = [np.array(turn) for turn in ((1, 0), (-1, 0), (0, 1), (0, -1))]
            inside = [t for t in turns if ((crossing + t >= 0) & (crossing + t <= self.blocks)).all()]
            heading = rng.choice([t for t in inside if (t != -heading).any() or not heading.any()])
            crossing = crossing + heading
            corners.append(crossing)
        lengths_m = rng.uniform(0.0, self.block_m) + step_m * np.arange(scans)
        at, route = lengths_m / self.block_m, np.array(corners, np.float64) * self.block_m
        return np.stack([np.interp(at, np.arange(len(route)), route[:, axis]) for axis in range(2)], axis=1)


def evidence(
    streets: Streets,
    drive_m: NDArray[np.float64],
    rng: np.random.Generator,
    correlated_m: float = 0.0,
) -> Iterator[NDArray[np.float64] | None]:
    """Log likelihood ratios (N,) of each scan of a drive; None for a degraded one, which has no evidence.

    With `correlated_m`, the noise is the same from scan to scan but for what the distance driven changes: its
    correlation is exp(−distance / correlated_m).
    """
    places = len(streets.positions_m)
    kept = np.exp(-STEP_M / correlated_m) if correlated_m > 0.0 else 0.0
    # Right places resemble the scan together: they share all but a little of their noise.
    sigmas = np.concatenate([np.full(places, SIGMA), np.full(places, OWN_SIGMA), [np.sqrt(SIGMA**2 - OWN_SIGMA**2)]])
    noise = rng.normal(0.0, sigmas)
    for position_m in drive_m:
        noise = kept * noise + np.sqrt(1.0 - kept**2) * rng.normal(0.0, sigmas)
        impostor = rng.integers(places) if rng.random() < IMPOSTORS else None
        if rng.random() < DEGRADED:
            yield None
            continue
        distances_m = np.linalg.norm(streets.positions_m - position_m, axis=1)
        # Right, up to twice as far between right and others, and others.
        right = np.clip(2.0 - distances_m / RIGHT_WITHIN_M, 0.0, 1.0)
        similarities = OTHERS + right * (RIGHT - OTHERS)
        similarities += np.where(right > 0.0, noise[places:-1] + noise[-1], noise[:places])
        if impostor is not None:
            similarities[impostor] = rng.normal(RIGHT, SIGMA)
        yield (11.0 * similarities - 27.5) / 9.0


def localised(
    belief: PlaceBelief,
    streets: Streets,
    scans: int,
    odometry: bool,
    rng: np.random.Generator,
    correlated_m: float = 0.0,
) -> list[Seen]:
    """What the filter decides on each scan of a drive, from a cold start; `belief` has the places of `streets`."""
    belief.reset()
    drive_m = streets.drive(scans, STEP_M, rng)
    seen = []
    for index, ratios in enumerate(evidence(streets, drive_m, rng, correlated_m)):
        found = belief.step((index + 1) * PERIOD_NS, ratios, STEP_M if odometry else None)
        distances_m = np.linalg.norm(streets.positions_m - drive_m[index], axis=1)
        error_m = float(distances_m[found.place_id])
        seen.append(Seen(found.state, error_m, float(distances_m.min()), ratios is not None))
    return seen
