"""Each drive is searched for in the maps of the others."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.training.searches import NO_OTHER_PLACE, TOLERANCE_M, search_pairs

MakeLine = Callable[..., Drive]


def line(make_line: MakeLine, name: str, world: str, x_m: list[float], left_m: float = 0.0) -> Drive:
    positions = np.column_stack([x_m, np.full(len(x_m), left_m)])
    return make_line(name, world, positions, np.zeros(len(x_m), np.bool_))


def test_every_drive_is_searched_for_in_the_others_of_its_world(make_line: MakeLine) -> None:
    drives = [line(make_line, name, world, [0.0, 40.0]) for name, world in (('a', 'v'), ('b', 'v'), ('c', 'w'))]
    found = search_pairs(drives, [np.eye(2)] * 3, 5.0)
    assert [search.queried for search in found] == [1, 0]
    assert all(search.queries.tolist() == [0, 1] for search in found)


@pytest.mark.parametrize('spacing_m', [5.0, 15.0])
def test_margins_compare_the_nearest_right_and_wrong_places(make_line: MakeLine, spacing_m: float) -> None:
    rng = np.random.default_rng(4)
    mapped = line(make_line, 'map', 'w', np.cumsum(rng.uniform(2.0, 9.0, 40)).tolist())
    driven = line(make_line, 'drive', 'w', rng.uniform(-60.0, 260.0, 50).tolist(), 6.0)
    # Descriptors that are not L2-normalised: distance decides, not the angle.
    descriptors = [rng.normal(size=(40, 3)), rng.normal(size=(50, 3))]
    search = search_pairs([mapped, driven], descriptors, spacing_m)[0]
    cells = (mapped.poses[:, 0] - mapped.poses[0, 0]) // spacing_m
    places = [i for i in range(40) if i == 0 or cells[i] != cells[i - 1]]
    queries: list[int] = []
    for query in range(50):
        away = [float(np.hypot(*(driven.poses[query, :2] - mapped.poses[i, :2]))) for i in places]
        distances = [float(np.sum((descriptors[1][query] - descriptors[0][i]) ** 2)) for i in places]
        right = [d for d, m in zip(distances, away, strict=True) if m <= TOLERANCE_M]
        wrong = [d for d, m in zip(distances, away, strict=True) if m > TOLERANCE_M]
        if right:
            assert search.margins[len(queries)] == pytest.approx((min(wrong) - min(right)) / 2.0)
            assert (search.margins[len(queries)] > 0.0) == (away[int(np.argmin(distances))] <= TOLERANCE_M)
            queries.append(query)
    assert 10 < len(queries) < 50
    assert search.queries.tolist() == queries


def test_without_a_wrong_place_every_answer_is_right(make_line: MakeLine) -> None:
    drives = [line(make_line, name, 'w', [0.0]) for name in 'ab']
    (search, _) = search_pairs(drives, [np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])], 5.0)
    assert search.margins.tolist() == [NO_OTHER_PLACE]


def test_queries_far_from_all_places_have_margins_too(make_line: MakeLine) -> None:
    drives = [line(make_line, name, 'w', [0.0, 100.0]) for name in 'ab']
    search, _ = search_pairs(drives, [np.array([[3.0, 0.0], [10.0, 0.0]]), np.array([[0.0, 0.0], [12.0, 0.0]])], 5.0)
    assert search.margins.tolist() == [(100.0 - 9.0) / 2.0, (81.0 - 4.0) / 2.0]
