"""Exact search against distances computed pair by pair."""

import math
import random
from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.distance import cdist

from offradar_ros.errors import RefusedInput
from offradar_ros.retrieval.place_index import PlaceIndex
from offradar_ros.types import PlaceTable


def table_of(means: ArrayLike, place_ids: ArrayLike | None = None) -> PlaceTable:
    means = np.asarray(means, np.float32)
    count = len(means)
    ids = np.arange(count) if place_ids is None else np.asarray(place_ids)
    return PlaceTable(
        place_ids=ids.astype(np.int64),
        session_ids=np.ones(count, np.int32),
        stamps_ns=ids.astype(np.int64) * 10,
        positions_m=np.stack([ids * 1.0, ids * 2.0, ids * 3.0], axis=1),
        yaws_rad=np.full(count, np.nan),
        yaw_sds_rad=np.full(count, np.nan, np.float32),
        uncertainties=(ids / 10).astype(np.float32),
        means=means,
    )


def slow_search(
    entries: Mapping[int, NDArray[np.float32]], query: NDArray[np.float32], k: int
) -> list[tuple[float, int]]:
    """(float32 distance, id) of the k nearest, computed in Python."""
    ranked = []
    for place_id, mean in entries.items():
        square = math.fsum((float(a) - float(b)) ** 2 for a, b in zip(mean, query, strict=True))
        with np.errstate(over='ignore'):
            ranked.append((float(np.float32(math.sqrt(square))), place_id))
    return sorted(ranked)[:k]


def found(
    index: PlaceIndex, query: ArrayLike, k: int, exclude: NDArray[np.int64] | None = None
) -> list[tuple[float, int]]:
    return [(c.distance, c.place_id) for c in index.search(np.asarray(query, np.float32), k, exclude)]


Vector = list[float]

value = st.one_of(
    st.floats(-2, 2, width=32), st.sampled_from([0.0, 1.0, 1e4, 1e4 + 1e-3, -1e4, 3e-20, 1e-30, 1e19, -8e34])
)


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.lists(value, min_size=3, max_size=3), min_size=1, max_size=20),
    st.lists(value, min_size=3, max_size=3),
    st.integers(1, 25),
)
def test_search_of_any_numbers(means: list[Vector], query: Vector, k: int) -> None:
    index = PlaceIndex(3)
    index.upsert(table_of(means))
    asked = np.asarray(query, np.float32)
    assert found(index, asked, k) == slow_search(dict(enumerate(np.asarray(means, np.float32))), asked, k)


@pytest.mark.parametrize('k', [1, 25, 1024, 1025])
def test_search_in_a_map_that_is_large_enough_for_groups(k: int) -> None:
    """Many neighbouring places resemble the query, and the last rows belong to no group."""
    rng = np.random.default_rng(3)
    means = rng.normal(size=(120_000, 8)).astype(np.float32)
    means[70_000:72_000] = means[0] + 0.05 * rng.normal(size=(2000, 8))
    means[-3:] = means[0]
    index = PlaceIndex(8)
    index.upsert(table_of(means))
    exact = np.sqrt(np.sum((means.astype(float) - means[0].astype(float)) ** 2, axis=1)).astype(np.float32)
    order = np.argsort(exact, kind='stable')[:k]
    assert found(index, means[0], k) == [(float(exact[i]), int(i)) for i in order]
    all_but_forty = np.arange(40, 120_000)
    left = [(float(exact[i]), int(i)) for i in np.argsort(exact[:40], kind='stable')[:k]]
    assert found(index, means[0], k, exclude=all_but_forty) == left


def test_many_places_against_cdist() -> None:
    rng = np.random.default_rng(0)
    means = rng.normal(size=(3000, 64)).astype(np.float32)
    index = PlaceIndex(64)
    index.upsert(table_of(means))
    for query in rng.normal(size=(10, 64)).astype(np.float32):
        exact = cdist(query[None].astype(float), means.astype(float))[0]
        assert [c.place_id for c in index.search(query, 25)] == np.argsort(exact)[:25].tolist()


def test_near_duplicates_far_from_zero_keep_their_order() -> None:
    """|x|² − 2 x·q in single precision loses all of these differences."""
    rng = np.random.default_rng(1)
    centre = 100.0 + rng.normal(size=128)
    means = (centre + 1e-4 * rng.normal(size=(500, 128))).astype(np.float32)
    index = PlaceIndex(128)
    index.upsert(table_of(means))
    query = means[123]
    assert found(index, query, 500) == slow_search(dict(enumerate(means)), query, 500)
    assert index.search(query, 1)[0].distance == 0.0


@settings(max_examples=300, deadline=None)
@given(
    st.lists(st.lists(value, min_size=3, max_size=3), max_size=20),
    st.lists(st.lists(value, min_size=3, max_size=3), max_size=6),
    st.integers(1, 25),
    st.booleans(),
    st.randoms(use_true_random=False),
)
def test_search_many_equals_search_of_each_query(
    listed_means: list[Vector], listed_queries: list[Vector], k: int, repeat: bool, random: random.Random
) -> None:
    # Repeated places, and queries that equal places, give ties.
    means = np.array(listed_means + listed_means[:5] * repeat, np.float32).reshape(-1, 3)
    queries = np.concatenate([np.array(listed_queries, np.float32).reshape(-1, 3), means[:3]])
    index = PlaceIndex(3)
    index.upsert(table_of(means, 2 * np.arange(len(means))))
    left_out = np.array([[random.random() < 0.3 for _ in means] for _ in queries], np.bool_).reshape(
        len(queries), len(means)
    )
    for exclude in (None, left_out):
        rows, distances = index.search_many(queries, k, exclude)
        assert rows.shape == distances.shape == (len(queries), min(k, len(means)))
        for number, query in enumerate(queries):
            ids = None if exclude is None else index.place_ids[exclude[number]]
            expected = found(index, query, k, exclude=ids)
            listed = list(zip(distances[number].tolist(), index.place_ids[rows[number]].tolist(), strict=True))
            assert listed[: len(expected)] == expected
            # Distances beyond single precision are infinite too.
            assert all(distance == np.inf for distance, _ in listed[len(expected) :])


def test_search_many_against_cdist() -> None:
    rng = np.random.default_rng(4)
    # Far from the origin, where single precision suffers from cancellation; the last place equals the first.
    means = (rng.normal(size=(700, 16)) + 1000.0).astype(np.float32)
    means[-1] = means[0]
    queries = (means[rng.permutation(700)[:600]] + rng.normal(0.0, 0.01, (600, 16))).astype(np.float32)
    index = PlaceIndex(16)
    index.upsert(table_of(means))
    exact = cdist(queries.astype(float), means.astype(float))
    np.testing.assert_allclose(index.squared_distances(queries), exact**2, rtol=0.0, atol=1e-6)
    for k in (1, 5):
        rows, distances = index.search_many(queries, k)
        order = np.argsort(exact.astype(np.float32), axis=1, kind='stable')[:, :k]
        np.testing.assert_array_equal(rows, order)
        np.testing.assert_array_equal(distances, np.take_along_axis(exact, order, 1).astype(np.float32))


def test_equal_places_are_found_in_order_of_their_ids() -> None:
    index = PlaceIndex(4)
    index.upsert(table_of(np.zeros((300, 4))))
    rows, distances = index.search_many(np.zeros((3, 4), np.float32), 20)
    assert rows.tolist() == [list(range(20))] * 3
    assert not distances.any()


def test_search_without_places_or_without_queries() -> None:
    index = PlaceIndex(4)
    assert [part.shape for part in index.search_many(np.zeros((3, 4), np.float32), 5)] == [(3, 0), (3, 0)]
    assert index.squared_distances(np.zeros((3, 4), np.float32)).shape == (3, 0)
    index.upsert(table_of(np.zeros((2, 4))))
    assert [part.shape for part in index.search_many(np.zeros((0, 4), np.float32), 5)] == [(0, 2), (0, 2)]


def test_ties_are_in_order_of_place_ids() -> None:
    index = PlaceIndex(2)
    index.upsert(table_of(np.ones((6, 2)), place_ids=[9, 4, 30, 2, 7, 5]))
    assert [c.place_id for c in index.search(np.zeros(2, np.float32), 4)] == [2, 4, 5, 7]


def test_k_beyond_the_map_and_an_empty_map() -> None:
    index = PlaceIndex(2)
    assert index.search(np.zeros(2, np.float32), 5) == []
    index.upsert(table_of([[1, 0], [0, 2]]))
    assert len(index.search(np.zeros(2, np.float32), 5)) == 2


step = st.tuples(st.sampled_from(['upsert', 'remove']), st.lists(st.integers(0, 30), max_size=12))


@settings(max_examples=80, deadline=None)
@given(st.lists(step, max_size=8), st.lists(st.integers(0, 30), max_size=5))
def test_search_after_changes(steps: list[tuple[str, list[int]]], exclude: list[int]) -> None:
    index = PlaceIndex(4)
    entries: dict[int, NDArray[np.float32]] = {}
    rng = np.random.default_rng(7)
    for verb, ids in steps:
        means = rng.normal(size=(len(ids), 4)).astype(np.float32)
        table = table_of(means.reshape(-1, 4), ids)
        if verb == 'remove':
            index.remove(np.array(ids, np.int64))
            entries = {k: v for k, v in entries.items() if k not in ids}
        else:
            index.upsert(table)
            entries |= dict(zip(ids, means, strict=True))
        assert len(index) == len(entries)
        query = rng.normal(size=4).astype(np.float32)
        assert found(index, query, 5) == slow_search(entries, query, 5)
        left = {k: v for k, v in entries.items() if k not in exclude}
        assert found(index, query, 5, exclude=np.array(exclude, np.int64)) == slow_search(left, query, 5)


def test_a_candidate_has_the_pose_and_u_of_its_place() -> None:
    index = PlaceIndex(2)
    index.upsert(table_of([[3, 4]], place_ids=[8]))
    (candidate,) = index.search(np.zeros(2, np.float32), 1)
    assert (candidate.place_id, candidate.distance, candidate.uncertainty) == (8, 5.0, float(np.float32(0.8)))
    assert (candidate.pose.x_m, candidate.pose.y_m, candidate.pose.z_m) == (8.0, 16.0, 24.0)
    assert math.isnan(candidate.pose.yaw_rad)


@pytest.mark.parametrize(
    ('table', 'cause'),
    [
        (table_of([[1, 2, 3]]), 'wrong_dimension'),
        (table_of([[1, math.nan]]), 'invalid_place'),
        (table_of([[1, math.inf]]), 'invalid_place'),
    ],
)
def test_invalid_places_are_refused_and_change_nothing(table: PlaceTable, cause: str) -> None:
    index = PlaceIndex(2)
    index.upsert(table_of([[1, 2]]))
    with pytest.raises(RefusedInput) as refused:
        index.upsert(table)
    assert refused.value.cause == cause
    assert found(index, [1, 2], 1) == [(0.0, 0)]
