"""The static thresholds of the paper's equation."""

import pytest

from offradar_ros.config import QueryConfig
from offradar_ros.retrieval.thresholds import static_thresholds, threshold_at


@pytest.mark.parametrize(('delta', 'levels'), [(0.5, 10), (0.1, 1), (1.0, 7), (0.0, 3), (2.5, 100)])
def test_thresholds_are_those_of_the_equation(delta: float, levels: int) -> None:
    thresholds = static_thresholds(delta, levels)
    assert len(thresholds) == levels + 1
    for n in range(levels + 1):
        assert thresholds[n] == pytest.approx((1 - delta) + n * (2 * delta / levels), abs=1e-12)


def test_the_ends_are_one_minus_and_one_plus_delta() -> None:
    thresholds = static_thresholds(0.25, 8)
    assert (thresholds[0], thresholds[4], thresholds[-1]) == (0.75, 1.0, 1.25)


def test_the_level_chooses_the_threshold() -> None:
    assert threshold_at(QueryConfig(delta=0.5, levels=10, level=0)) == 0.5
    assert threshold_at(QueryConfig(delta=0.5, levels=10, level=5)) == 1.0
    assert threshold_at(QueryConfig()) == 1.5
