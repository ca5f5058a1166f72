"""The evidence of one query, of many at once, and of a slow loop are the same."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from offradar_ros.mapping.place_columns import take_rows
from offradar_ros.retrieval.evidence import evidence_table
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.types import Embedding, Evidence, PlaceTable

MODEL = 'a' * 64
TOLERANCE_M = 25.0


def road(count: int, seed: int, spacing_m: float = 10.0) -> PlaceTable:
    """Places of a straight road, of random means of length 1."""
    rng = np.random.default_rng(seed)
    means = rng.normal(size=(count, 8)).astype(np.float32)
    return PlaceTable(
        np.arange(count, dtype=np.int64) * 3,
        np.ones(count, np.int32),
        np.arange(count, dtype=np.int64),
        np.column_stack([np.arange(count) * spacing_m, np.zeros((count, 2))]),
        np.zeros(count),
        np.full(count, np.nan, np.float32),
        rng.uniform(0.5, 2.0, count).astype(np.float32),
        means / np.linalg.norm(means, axis=1, keepdims=True),
    )


def by_loop(places: PlaceTable, mean: NDArray[np.float32], uncertainty: float) -> Evidence:
    def distances(point: NDArray[np.float32]) -> NDArray[np.float64]:
        return np.array([math.dist(point.tolist(), other.tolist()) for other in places.means])

    of_query = distances(mean)
    first = int(np.argmin(of_query))
    of_place = distances(places.means[first])
    elsewhere = [
        row
        for row in range(len(places))
        if math.dist(places.positions_m[row, :2].tolist(), places.positions_m[first, :2].tolist()) > TOLERANCE_M
    ]
    return Evidence(
        float(of_query[first]),
        min((float(of_query[row]) for row in elsewhere), default=math.inf),
        min((float(of_place[row]) for row in elsewhere), default=math.inf),
        uncertainty,
        float(places.uncertainties[first]),
    )


def one_by_one(places: PlaceTable, means: NDArray[np.float32], uncertainties: NDArray[np.float64]) -> list[Evidence]:
    searched = SearchedMap()
    searched.load(places, MODEL)
    found = []
    for mean, uncertainty in zip(means, uncertainties.tolist(), strict=True):
        search = searched.around(Embedding(1, mean, np.full(8, uncertainty, np.float32), MODEL))
        found.append(search.evidence(search.nearest(3)[0], TOLERANCE_M))
    return found


@given(st.integers(1, 40), st.integers(0, 100), st.sampled_from([1.0, 10.0, 30.0]))
def test_many_queries_have_the_evidence_of_each(count: int, seed: int, spacing_m: float) -> None:
    places = road(count, seed, spacing_m)
    rng = np.random.default_rng(seed + 1)
    means = (places.means[rng.integers(0, count, 6)] + rng.normal(0, 0.2, (6, 8))).astype(np.float32)
    uncertainties = rng.uniform(0.5, 2.0, 6).astype(np.float32).astype(np.float64)
    table = evidence_table(places, means, uncertainties, TOLERANCE_M)
    for row, one in enumerate(one_by_one(places, means, uncertainties)):
        many = Evidence(
            *(
                float(getattr(table, name)[row])
                for name in ('distance', 'distance_apart', 'place_distance_apart', 'uncertainty', 'place_uncertainty')
            )
        )
        assert many == one
        looped = by_loop(places, means[row], uncertainties[row])
        for name in ('distance', 'distance_apart', 'place_distance_apart', 'uncertainty', 'place_uncertainty'):
            assert getattr(one, name) == pytest.approx(getattr(looped, name), rel=1e-6, abs=1e-6)


def test_places_that_are_excluded_for_a_query_count_as_absent() -> None:
    places, queries = road(40, 3), road(6, 4)
    exclude = np.random.default_rng(5).random((6, 40)) < 0.5
    found = evidence_table(places, queries.means, np.ones(6), 25.0, exclude)
    for row in range(6):
        kept = np.flatnonzero(~exclude[row])
        alone = evidence_table(take_rows(places, kept), queries.means[row : row + 1], np.ones(1), 25.0)
        assert found.nearest[row] == kept[alone.nearest[0]]
        for name in ('distance', 'distance_apart', 'place_distance_apart', 'place_uncertainty'):
            assert getattr(found, name)[row] == getattr(alone, name)[0]


def test_the_running_session_counts_where_it_is_searched() -> None:
    searched = SearchedMap()
    places = road(6, 0, spacing_m=100.0)
    searched.load(places, MODEL)
    query = Embedding(1000, places.means[0], np.ones(8, np.float32), MODEL)
    before = searched.around(query, include_running=True)
    elsewhere = before.evidence(before.nearest(1)[0], TOLERANCE_M).distance_apart
    assert elsewhere > 0.0
    twin = PlaceTable(
        np.array([99], np.int64),
        np.array([2], np.int32),
        np.array([999], np.int64),
        np.array([[5000.0, 0.0, 0.0]]),
        np.zeros(1),
        np.full(1, np.nan, np.float32),
        np.ones(1, np.float32),
        places.means[:1].copy(),
    )
    searched.update(twin, MODEL, committed=False)
    with_running, without = (searched.around(query, include_running=running) for running in (True, False))
    assert with_running.evidence(with_running.nearest(1)[0], TOLERANCE_M).distance_apart == 0.0
    assert without.evidence(without.nearest(1)[0], TOLERANCE_M).distance_apart == elsewhere
