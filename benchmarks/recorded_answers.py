"""What the query stage answers to recorded scans whose positions are known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from recorded_scans import Positions

from offradar_ros.config import QueryConfig
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.lab.evaluation.metrics.auroc import auroc
from offradar_ros.stages.query import QueryStage
from offradar_ros.types import Embedding, Match, Place, PlaceTable, PolarScan, Pose

FAR_M = 50.0
"""Beyond this from every place, a query counts as off the map; between the tolerance and this, as neither."""

Signal = Callable[['Answers'], NDArray[np.float64]]


class Answers(NamedTuple):
    """One row for each of Q queries of a map.

    Attributes:
        row: (Q,) int64, the first place.
        error_m, away_m: (Q,) float64, from the vehicle to the first place, and to the nearest place of the map.
        answered: (Q,) bool, whether the gate lets the answer through.
        p_right, distance, spatial_ratio, uncertainty: (Q,) float64; the ratio is 0 where no place is elsewhere.
    """

    row: NDArray[np.int64]
    error_m: NDArray[np.float64]
    away_m: NDArray[np.float64]
    answered: NDArray[np.bool_]
    p_right: NDArray[np.float64]
    distance: NDArray[np.float64]
    spatial_ratio: NDArray[np.float64]
    uncertainty: NDArray[np.float64]

    @property
    def right(self) -> NDArray[np.bool_]:
        """(Q,) whether the first place is within the tolerance of the vehicle."""
        return self.error_m <= QueryConfig().tolerance_m

    @property
    def on_map(self) -> NDArray[np.bool_]:
        """(Q,) whether any place is."""
        return self.away_m <= QueryConfig().tolerance_m

    @property
    def off_map(self) -> NDArray[np.bool_]:
        """(Q,) whether every place is farther than `FAR_M`."""
        return self.away_m > FAR_M

    def share(self, which: NDArray[np.bool_]) -> str:
        """The share of these queries that is answered, and their number, as text."""
        return f'{self.answered[which].mean():.3f} of {which.sum()}' if which.any() else 'none'

    def shares(self) -> tuple[str, str, str]:
        """`share` of queries within the tolerance of the map, up to `FAR_M` from it, and beyond."""
        return self.share(self.on_map), self.share(~self.on_map & ~self.off_map), self.share(self.off_map)


SIGNALS: dict[str, Signal] = {
    'distance': lambda answers: answers.distance,
    'spatial ratio': lambda answers: answers.spatial_ratio,
    'U': lambda answers: answers.uncertainty,
    'p_right': lambda answers: -answers.p_right,
}
"""Signals that grow where an answer becomes less probable."""


def aurocs(near: Answers, far: Answers) -> list[str]:
    """For each signal, how well it tells the queries off the map, of `far`, from those on it, of `near`."""
    off_map = np.repeat([False, True], [near.on_map.sum(), far.off_map.sum()])
    return [
        f'{auroc(np.concatenate([signal(near)[near.on_map], signal(far)[far.off_map]]), off_map):.3f}'
        for signal in SIGNALS.values()
    ]


def encode(encoder: Encoder, scans: Sequence[PolarScan]) -> list[Embedding]:
    """The embedding of each scan."""
    return [encoder.encode(scan) for scan in scans]


def table_of(embeddings: Sequence[Embedding], positions_m: Positions) -> PlaceTable:
    """A map of these scans, each a place, at positions (N, 2)."""
    rows = enumerate(zip(embeddings, positions_m.tolist(), strict=True))
    places = [Place(row, 1, row, Pose(x, y), scan.uncertainty, scan.mean) for row, (scan, (x, y)) in rows]
    return PlaceTable.from_places(places, len(embeddings[0].mean))


def answer(
    table: PlaceTable, queries: Sequence[Embedding], positions_m: Positions, config: QueryConfig | None = None
) -> Answers:
    """The answers to scans at positions (Q, 2); by default with the gate and the coefficients that ship."""
    stage = QueryStage(config or QueryConfig())
    stage.load(table, queries[0].model)
    outcomes = [stage.query(query) for query in queries]
    evidence = [outcome.evidence for outcome in outcomes if outcome.evidence is not None]
    row = np.array([outcome.candidates[0].place_id for outcome in outcomes])
    away_m = np.hypot(*(table.positions_m[np.newaxis, :, :2] - positions_m[:, np.newaxis]).transpose(2, 0, 1))
    return Answers(
        row,
        away_m[np.arange(len(row)), row],
        away_m.min(axis=1),
        np.array([isinstance(outcome, Match) for outcome in outcomes]),
        np.array([outcome.p_right for outcome in outcomes]),
        np.array([found.distance for found in evidence]),
        np.array([found.distance / found.distance_apart for found in evidence]),
        np.array([query.uncertainty for query in queries]),
    )


def print_row(*cells: object) -> None:
    """Print a row of a table in Markdown."""
    print('| ' + ' | '.join(map(str, cells)) + ' |', flush=True)


def print_head(*cells: str) -> None:
    """Print the head of a table in Markdown, after an empty line."""
    print()
    print_row(*cells)
    print('|---' * len(cells) + '|')
