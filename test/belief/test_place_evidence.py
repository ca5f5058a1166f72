"""Log likelihood ratios of one scan: calibrated for off the map, largest where the scan resembles a place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.belief.place_evidence import EVEN_SHARE, log_likelihood_ratios
from offradar_ros.retrieval.confidence import SimilarPlaces

IDS = np.arange(10, 30, dtype=np.int64)
SHARES = np.full(20, 1 / 20)


def similar(log_odds: dict[int, float], base_rate: float = 0.5) -> SimilarPlaces:
    ids = np.array(sorted(log_odds), np.int64)
    return SimilarPlaces(ids, np.array([log_odds[place_id] for place_id in ids.tolist()]), base_rate)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=6), st.floats(0.05, 0.95), st.floats(0.5, 0.99))
def test_its_mean_over_the_road_is_that_of_the_answer_and_of_elsewhere(
    log_odds: list[float], base_rate: float, recall: float
) -> None:
    found = similar(dict(enumerate(log_odds, start=12)), base_rate)
    ratios = log_likelihood_ratios(found, IDS, SHARES, recall)
    # R p(f | right) / p(f | not right) where the answer is, 1 − R elsewhere.
    right = recall * np.exp(max(log_odds)) * (1.0 - base_rate) / base_rate
    elsewhere = (1.0 - recall) * (1.0 - len(log_odds) / 20)
    assert np.exp(ratios) @ SHARES == pytest.approx(right + elsewhere)


def test_a_scan_off_the_map_says_nothing_on_average() -> None:
    # Log-odds of answers that are right at the base rate: p(f | right) / p(f | not right) has mean 1 over the others.
    rng = np.random.default_rng(3)
    means = []
    for place_id, value in zip(rng.integers(10, 30, 20_000).tolist(), rng.normal(-2.0, 2.0, 20_000), strict=True):
        ratios = log_likelihood_ratios(similar({place_id: value}), IDS, SHARES, 0.9)
        means.append(np.exp(ratios))
    # exp of a normal variable of mean −2 and variance 4 has mean 1.
    np.testing.assert_allclose(np.mean(means), 1.0, atol=0.1)


def test_places_near_the_answer_share_it_by_how_well_they_resemble_the_scan() -> None:
    ratios = log_likelihood_ratios(similar({12: 3.0, 13: 6.0, 14: -30.0}), IDS, SHARES, 0.95)
    assert np.argmax(ratios) == 3
    assert ratios[2] < ratios[3]
    # Not nothing: a little is shared out evenly.
    assert np.exp(ratios[4] - ratios[3]) == pytest.approx(EVEN_SHARE / (3 * (1 - EVEN_SHARE)), rel=0.1)
    elsewhere = np.delete(ratios, [2, 3, 4])
    assert elsewhere == pytest.approx(np.log(0.05))


def test_places_that_are_not_in_the_map_any_more_are_left_out() -> None:
    ratios = log_likelihood_ratios(similar({5: 9.0, 12: 3.0, 40: 9.0}), IDS, SHARES, 0.95)
    assert ratios.tolist() == log_likelihood_ratios(similar({12: 3.0}), IDS, SHARES, 0.95).tolist()
    gone = log_likelihood_ratios(similar({5: 9.0}), IDS, SHARES, 0.95)
    assert gone == pytest.approx(np.log(0.05))
    assert len(log_likelihood_ratios(similar({5: 9.0}), IDS[:0], SHARES[:0], 0.95)) == 0
