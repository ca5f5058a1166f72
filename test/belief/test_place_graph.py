"""Neighbours, shares of road and ends of roads, against their definitions place by place."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.belief.place_graph import STRIDE_M, PlaceGraph
from offradar_ros.errors import RefusedInput

SPACING_M, TOLERANCE_M = 15.0, 30.0


def line(count: int, y_m: float = 0.0) -> NDArray[np.float64]:
    """Places every 10 m."""
    return np.stack([np.arange(count) * 10.0, np.full(count, y_m)], axis=1)


def graph(positions_m: NDArray[np.float64]) -> PlaceGraph:
    return PlaceGraph(positions_m, SPACING_M, TOLERANCE_M)


def test_all_figures_are_those_of_loops() -> None:
    rng = np.random.default_rng(3)
    x = rng.uniform(0.0, 80.0, (40, 2))
    made, mass = graph(x), rng.uniform(0.0, 1.0, 40)
    distance = [[float(np.hypot(*(a - b))) for b in x] for a in x]
    counts = [sum(d <= SPACING_M / 2 for d in row) for row in distance]
    shares = np.array([1.0 / c for c in counts])
    shares /= shares.sum()
    assert made.shares == pytest.approx(shares)
    driven, around = np.zeros(40), np.zeros(40)
    for i in range(40):
        near = [j for j in range(40) if distance[i][j] <= STRIDE_M + SPACING_M]
        for j in near:
            driven[j] += mass[i] * shares[j] / sum(shares[near])
        towards = sum(shares[j] * (x[j] - x[i]) for j in near)
        length = sum(shares[j] * distance[i][j] for j in near)
        assert made.ends[i] == pytest.approx(np.hypot(*towards) / length)
        around[i] = sum(mass[j] * max(0.0, 1.0 - (distance[i][j] / TOLERANCE_M) ** 2) for j in range(40))
        assert made.around(i).tolist() == [j for j in range(40) if distance[i][j] <= TOLERANCE_M]
    assert made.driven(mass) == pytest.approx(driven)
    assert made.best(mass) == int(np.argmax(around))


def test_a_road_ends_at_its_ends_only() -> None:
    ends = graph(line(30)).ends
    assert ends[[0, -1]] == pytest.approx(1.0)
    assert ends[5:25] == pytest.approx(0.0)
    assert graph(line(1)).ends.tolist() == [1.0]


def test_a_road_that_is_mapped_twice_as_densely_counts_no_more() -> None:
    made = graph(np.concatenate([line(40), line(40, 1000.0), line(40, 1002.0)]))
    assert made.shares[:40].sum() == pytest.approx(0.5)
    assert made.ends[5] == pytest.approx(0.0)


def test_the_best_place_is_the_certain_one() -> None:
    made = graph(line(9))
    mass = np.zeros(9)
    mass[4] = 1.0
    assert made.best(mass) == 4


def test_mass_moves_to_the_places_in_reach() -> None:
    made = graph(line(3))
    moved = made.moved_in(np.array([[-20.0, 0.0], [500.0, 0.0]]), np.array([0.6, 0.4]))
    assert moved == pytest.approx([0.6, 0.0, 0.0])


def test_places_that_are_all_in_one_spot_are_refused_before_their_pairs_are_listed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('offradar_ros.belief.place_graph.MAX_PAIRS', 99)
    assert len(graph(np.zeros((14, 2)))) == 14
    with pytest.raises(RefusedInput, match='105 pairs of places') as refused:
        graph(np.zeros((15, 2)))
    assert refused.value.cause == 'map_too_dense'
