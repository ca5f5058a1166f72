"""The gate keeps both promises as often as it says, on many simulated roads, and refuses where it cannot."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.calibration.cross_fit import CrossFit, cross_fit
from offradar_ros.calibration.error_control import ErrorLimit
from offradar_ros.calibration.gate_choice import PROBABILITIES, choose_gate
from offradar_ros.calibration.gate_picture import draw_gate
from offradar_ros.calibration.left_out_queries import LeftOutQueries
from offradar_ros.config import ConfidenceConfig
from offradar_ros.errors import DataError
from offradar_ros.retrieval.confidence import probability
from offradar_ros.retrieval.evidence import EvidenceTable

SHIPPED = ConfidenceConfig(intercept=0.5, distance=-2.0, spatial_ratio=-9.0, place_ratio=-6.0, unrelated_distance=1.0)


class World(NamedTuple):
    """How distances on and off the map are drawn; off the map, `alike` of the scans resemble a mapped place."""

    hard: float
    alike: float


def drawn(world: World, scans: int, rng: np.random.Generator) -> LeftOutQueries:
    """Two rows for each scan, one on the map and one off it, of scans that are independent of each other."""
    on_map = np.tile([True, False], scans)
    apart = rng.uniform(0.8, 1.0, 2 * scans)
    off = np.where(rng.random(2 * scans) < world.alike, 0.35, 0.85)
    ratio = np.clip(np.where(on_map, 0.45, off) + rng.normal(0.0, 0.1, 2 * scans), 0.05, 1.0)
    right = on_map & (rng.random(2 * scans) > world.hard * ratio**6)
    evidence = EvidenceTable(
        np.zeros(2 * scans, np.int64),
        ratio * apart,
        apart,
        np.minimum(apart * rng.uniform(0.9, 1.2, 2 * scans), 1.0),
        rng.lognormal(0.0, 0.1, 2 * scans),
        np.ones(2 * scans),
    )
    scan = np.repeat(np.arange(scans), 2)
    in_turn = on_map == (scan % 2 == 0)
    stretch = scan * 8 // scans
    return LeftOutQueries(2, 0, evidence, right, on_map, scan, in_turn, stretch, scan // 20)


def rates(queries: LeftOutQueries, p_right: NDArray[np.float64], gate: float) -> tuple[float, float]:
    """Share of wrong answers where half of the scans are off the map, and of scans off it that are answered."""
    answered = p_right >= gate
    return float(np.mean(~queries.right[answered])), float(np.mean(answered[~queries.on_map]))


@pytest.mark.parametrize(
    ('name', 'world', 'limit'),
    [
        ('wrong answers decide', World(8.0, 0.005), ErrorLimit(0.1, 0.8, 0.2)),
        ('answers off the map decide', World(1.0, 0.005), ErrorLimit(0.3, 0.8, 0.03)),
    ],
)
def test_the_promises_fail_as_rarely_as_stated(name: str, world: World, limit: ErrorLimit) -> None:
    """What is written is judged on a large fresh set: coefficients of all stretches with the chosen gate."""
    rng = np.random.default_rng(7)
    fresh = drawn(world, 40_000, rng)
    draws, broken, kept = 150, 0, 0
    for _ in range(draws):
        try:
            choice = choose_gate(cross_fit(drawn(world, 500, rng), SHIPPED), limit)
        except DataError:
            continue
        wrong, off = rates(fresh, probability(fresh.evidence, choice.fit.coefficients), choice.min_probability)
        bad = wrong > limit.error_rate or off > limit.off_map_rate
        broken, kept = broken + bad, kept + (not bad)
    allowed = (1.0 - limit.confidence) * draws
    assert broken <= allowed + 3.0 * math.sqrt(allowed * limit.confidence)
    assert kept > 0.7 * draws
    # The gate is needed: half of the answers to all scans would be wrong.
    assert rates(fresh, np.ones(len(fresh)), 0.5)[0] > 0.5


def fitted(p_right: NDArray[np.float64], right: NDArray[np.bool_], on_map: NDArray[np.bool_]) -> CrossFit:
    """Rows in pairs, one scan each."""
    count = len(right)
    evidence = EvidenceTable(np.zeros(count, np.int64), *np.ones((5, count)))
    scan = np.arange(count) // 2
    in_turn = np.arange(count) % 2 == scan % 2
    queries = LeftOutQueries(2, 0, evidence, right, on_map, scan, in_turn, scan % 8, scan // 10)
    return CrossFit(queries, ConfidenceConfig(), np.log(p_right) - np.log1p(-p_right), right)


def test_the_lowest_gate_that_keeps_both_is_chosen() -> None:
    on_map = np.tile([True, False], 2000)
    p_right = np.where(on_map, 0.96, 0.04)
    # Ten of the scans off the map are answered below 0.8, and a hundred below 0.7.
    p_right[1:20:2], p_right[101:300:2] = 0.78, 0.65
    fit = fitted(p_right, on_map, on_map)
    assert choose_gate(fit, ErrorLimit(0.05, 0.95, 0.01)).min_probability == 0.7
    assert choose_gate(fit, ErrorLimit(0.05, 0.95, 0.005)).min_probability == 0.8
    assert choose_gate(fit, ErrorLimit(0.2, 0.95, 0.1)).min_probability == PROBABILITIES[-1] == 0.5
    chosen = choose_gate(fit, ErrorLimit(0.05, 0.95, 0.01))
    assert (chosen.off_map_answered, chosen.off_map_scans) == (10, 2000)
    assert (chosen.answered, chosen.wrong) == (1005, 5)


def test_a_scan_at_the_gate_is_answered_as_by_the_query() -> None:
    on_map = np.tile([True, False], 500)
    exact = np.where(on_map, 0.9, 0.1)
    chosen = choose_gate(fitted(exact, on_map, on_map), ErrorLimit(0.05, 0.95, 0.01))
    p_right = chosen.fit.p_right[chosen.fit.queries.mixed]
    assert chosen.answered == np.sum(p_right >= chosen.min_probability)


def test_too_few_scans_are_told_how_many_are_needed_and_what_they_can_promise() -> None:
    on_map = np.tile([True, False], 120)
    fit = fitted(np.where(on_map, 0.99, 0.01), on_map, on_map)
    with pytest.raises(DataError, match=r'expected at least 368 scans that are off the map .*, got 120') as caught:
        choose_gate(fit, ErrorLimit(0.1, 0.95, 0.01))
    found = re.search(r'--off-map-rate (0\.\d+) or higher', str(caught.value))
    assert found
    rate = float(found[1])
    assert choose_gate(fit, ErrorLimit(0.1, 0.95, rate)).off_map_answered == 0
    with pytest.raises(DataError):
        choose_gate(fit, ErrorLimit(0.1, 0.95, rate - 2e-4))
    with pytest.raises(DataError, match='expected at least 183 answers, got 60'):
        choose_gate(fit, ErrorLimit(0.02, 0.95, 0.1))


def test_where_no_gate_keeps_both_the_best_of_each_is_reported() -> None:
    on_map = np.tile([True, False], 1000)
    fit = fitted(np.full(2000, 0.9995), on_map, on_map)
    with pytest.raises(
        DataError, match=r'no probability up to 0.999 .* at best, each by itself, up to 0\.5\d+ and 1\.'
    ):
        choose_gate(fit, ErrorLimit(0.05, 0.95, 0.01))


def test_it_is_drawn(tmp_path: Path) -> None:
    cv2 = pytest.importorskip('cv2')
    pytest.importorskip('matplotlib')
    queries = drawn(World(0.5, 0.05), 300, np.random.default_rng(2))
    draw_gate(choose_gate(cross_fit(queries, SHIPPED), ErrorLimit(0.3, 0.9, 0.2)), tmp_path / 'drawn.png')
    assert cv2.imread(str(tmp_path / 'drawn.png')).std() > 10.0
