from __future__ import annotations

import numpy as np
import pytest

from offradar_ros.encoders.k_means import group_sums, k_means, nearest_centres


def clusters(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    centres = rng.normal(size=(5, 7)) * 10
    points = np.concatenate([centre + rng.normal(size=(40, 7)) * 0.3 for centre in centres])
    return points.astype(np.float32), centres


def test_nearest_centres_against_a_loop() -> None:
    points, centres = clusters()
    nearest, distances = nearest_centres(points.astype(np.float64), centres)
    for point, index, distance in zip(points, nearest, distances, strict=True):
        expected = [np.sqrt(((point - centre) ** 2).sum()) for centre in centres]
        assert index == int(np.argmin(expected))
        assert distance == pytest.approx(min(expected), abs=1e-4)


def test_group_sums_against_a_loop() -> None:
    points, _ = clusters()
    groups = np.random.default_rng(1).integers(0, 4, len(points))
    sums, sizes = group_sums(points.astype(np.float64), groups, 6)
    for group in range(6):
        np.testing.assert_allclose(sums[group], points[groups == group].sum(axis=0), atol=1e-4)
        assert sizes[group] == (groups == group).sum()


@pytest.mark.parametrize('seed', range(5))
def test_clusters_far_apart_are_found(seed: int) -> None:
    points, centres = clusters(seed)
    found = k_means(points, 5, seed)
    _, distances = nearest_centres(centres, found.astype(np.float64))
    assert distances.max() < 0.3
    assert found.dtype == np.float32


def test_every_centre_is_the_mean_of_its_points() -> None:
    points = np.random.default_rng(3).normal(size=(500, 4)).astype(np.float32)
    centres = k_means(points, 9, 0)
    nearest, _ = nearest_centres(points, centres)
    for index in range(9):
        np.testing.assert_allclose(centres[index], points[nearest == index].mean(axis=0), atol=0.1)


def test_more_centres_reduce_the_distance() -> None:
    points = np.random.default_rng(3).normal(size=(300, 4)).astype(np.float32)
    distances = [float(nearest_centres(points, k_means(points, count, 0))[1].mean()) for count in (2, 8, 32, 300)]
    assert distances == sorted(distances, reverse=True)
    assert distances[-1] < 1e-2


def test_equal_points() -> None:
    centres = k_means(np.ones((20, 3), np.float32), 4, 0)
    np.testing.assert_array_equal(centres, np.ones((4, 3), np.float32))


def test_fewer_points_than_centres_are_refused() -> None:
    with pytest.raises(ValueError, match='expected 4 points or more, got 3'):
        k_means(np.ones((3, 2), np.float32), 4, 0)
