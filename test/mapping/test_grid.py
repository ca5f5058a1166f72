"""The position grid against a loop over all points."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.mapping.grid import PositionGrid

Point = tuple[float, float]
"""x and y in metres."""

coordinate = st.one_of(
    st.floats(-1e8, 1e8), st.floats(-1e18, 1e18), st.integers(-40, 40).map(lambda n: n * 2.5), st.floats(-20.0, 20.0)
)
point = st.tuples(coordinate, coordinate)


@settings(max_examples=200, deadline=None)
@given(st.lists(point, max_size=30), point, st.sampled_from([0.1, 2.5, 5.0, 1000.0]), st.floats(0.01, 30.0))
def test_no_point_within_the_radius_is_missed(
    points: list[Point], centre: Point, cell_m: float, radius_m: float
) -> None:
    grid = PositionGrid(cell_m=max(cell_m, radius_m / 20))
    for index, (x, y) in enumerate(points):
        grid.add(index, x, y)
    near = grid.near(*centre, radius_m)
    assert len(near) == len(set(near))
    within = {i for i, (x, y) in enumerate(points) if math.hypot(x - centre[0], y - centre[1]) < radius_m}
    assert within <= set(near)


@settings(max_examples=100, deadline=None)
@given(st.lists(point, max_size=30), point, st.sampled_from([0.01, 2.5, 5.0, 1000.0]))
def test_fill_equals_add_of_each_point(points: list[Point], centre: Point, cell_m: float) -> None:
    one, other = PositionGrid(cell_m), PositionGrid(cell_m)
    for index, (x, y) in enumerate(points):
        one.add(index, x, y)
    other.fill(np.array(points, np.float64).reshape(-1, 2))
    assert sorted(other.near(*centre, 10 * cell_m)) == sorted(one.near(*centre, 10 * cell_m))
    for index, (x, y) in enumerate(points):
        assert index in other.near(x, y, 0.0)
        other.remove(index, x, y)
        assert index not in other.near(x, y, 0.0)


def test_only_neighbouring_cells_are_searched() -> None:
    grid = PositionGrid(5.0)
    for index in range(1000):
        grid.add(index, 5.0 * index, 0.0)
    assert len(grid.near(2500.0, 1.0, 5.0)) <= 3


def test_remove_removes_one_point() -> None:
    grid = PositionGrid(5.0)
    grid.add(0, 1.0, 1.0)
    grid.add(1, 2.0, 2.0)
    grid.remove(0, 1.0, 1.0)
    assert grid.near(1.0, 1.0, 5.0) == [1]
    grid.remove(1, 2.0, 2.0)
    assert grid.near(1.0, 1.0, 5.0) == []
