"""Coefficients are found again, never positive, and shared evenly between kinds of maps."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.calibration.aligned_places import AlignedPlaces
from offradar_ros.calibration.confidence_fit import fit_confidence, fit_verified
from offradar_ros.config import ConfidenceConfig
from offradar_ros.errors import DataError
from offradar_ros.retrieval.confidence import TERMS, logistic
from offradar_ros.retrieval.evidence import EvidenceTable

TRUE = np.array([-6.0, -4.0, -2.0, -1.0, -0.5])
SCALES = ConfidenceConfig(model='a' * 64, unrelated_distance=0.9)


def drawn(
    count: int, coefficients: NDArray[np.float64], seed: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    rng = np.random.default_rng(seed)
    terms = rng.normal(0.0, 0.7, (count, 5))
    odds = 1.0 + terms @ coefficients
    return terms, rng.random(count) < 1.0 / (1.0 + np.exp(-odds))


def coefficients_of(found: ConfidenceConfig) -> NDArray[np.float64]:
    return np.array([getattr(found, name) for name in TERMS])


def test_the_coefficients_of_drawn_answers_are_found_again() -> None:
    terms, right = drawn(40_000, TRUE)
    found = fit_confidence(terms, right, np.ones(len(right)), SCALES)
    np.testing.assert_allclose(coefficients_of(found), TRUE, atol=0.2)
    assert found.intercept == pytest.approx(1.0, abs=0.15)
    assert (found.model, found.unrelated_distance) == (SCALES.model, SCALES.unrelated_distance)


def test_no_coefficient_is_positive() -> None:
    terms, right = drawn(5000, -TRUE)
    found = coefficients_of(fit_confidence(terms, right, np.ones(len(right)), SCALES))
    assert (found <= 0.0).all()
    np.testing.assert_allclose(found, 0.0, atol=1e-6)


def test_a_weight_counts_as_that_many_queries() -> None:
    terms, right = drawn(8000, TRUE)
    twice = np.ones(len(right))
    twice[:2000] = 2.0
    repeated = np.concatenate([np.arange(2000), np.arange(8000)])
    weighted = fit_confidence(terms, right, twice, SCALES)
    plain = fit_confidence(terms[repeated], right[repeated], np.ones(10_000), SCALES)
    np.testing.assert_allclose(coefficients_of(weighted), coefficients_of(plain), rtol=0.02, atol=0.02)


def test_the_base_rate_is_the_weighted_share_of_right_answers_drawn_to_the_prior() -> None:
    terms, right = drawn(1000, TRUE)
    weights = np.where(right, 2.0, 1.0)
    share = weights[right].sum() / weights.sum()
    assert fit_confidence(terms, right, weights, SCALES).base_rate == pytest.approx(share)
    prior = dataclasses.replace(SCALES, base_rate=0.1)
    few = fit_confidence(terms[:5], np.ones(5, np.bool_), np.ones(5), SCALES, prior).base_rate
    many = fit_confidence(terms, right, weights, SCALES, prior).base_rate
    assert 0.1 < few < 0.6
    assert many == pytest.approx(share, abs=0.02)
    assert fit_confidence(terms, np.ones(1000, np.bool_), weights, SCALES, prior).base_rate < 1.0


def test_separable_answers_have_finite_coefficients() -> None:
    terms = np.zeros((100, 5))
    terms[:, 0] = np.linspace(-1.0, 1.0, 100)
    found = coefficients_of(fit_confidence(terms, terms[:, 0] < 0.0, np.ones(100), SCALES))
    assert np.isfinite(found).all()
    assert found[0] < -1.0


def test_few_queries_keep_the_prior_and_many_replace_it() -> None:
    prior = dataclasses.replace(SCALES, intercept=3.0, **dict(zip(TERMS, (TRUE / 2.0).tolist(), strict=True)))
    away = []
    for count in (5, 200, 40_000):
        terms, right = drawn(count, TRUE)
        away.append(np.abs(coefficients_of(fit_confidence(terms, right, np.ones(count), prior, prior)) - TRUE / 2.0))
    assert away[0].max() < 0.5
    assert (away[0] < away[2] + 0.1).all()
    assert away[0].sum() < away[1].sum() < away[2].sum()
    np.testing.assert_allclose(away[2], np.abs(TRUE) / 2.0, atol=0.2)


@pytest.mark.parametrize('right', [True, False])
def test_with_a_prior_answers_of_one_kind_shift_only_how_probable_they_are(right: bool) -> None:
    prior = dataclasses.replace(SCALES, intercept=0.5, **dict(zip(TERMS, TRUE.tolist(), strict=True)))
    terms, _ = drawn(50, TRUE)
    found = fit_confidence(terms, np.full(50, right), np.ones(50), prior, prior)
    before, after = (one.intercept + terms @ coefficients_of(one) for one in (prior, found))
    assert np.mean(after - before) * (1.0 if right else -1.0) > 0.0
    assert (coefficients_of(found) <= 0.0).all()


@pytest.mark.parametrize('right', [True, False])
def test_answers_of_one_kind_teach_nothing(right: bool) -> None:
    with pytest.raises(DataError, match='expected right and wrong answers'):
        fit_confidence(np.zeros((5, 5)), np.full(5, right), np.ones(5), SCALES)


def aligned(count: int, *, kind: str = 'telling') -> AlignedPlaces:
    """Two places of each query, of which at most one is right; by distance, their log-odds are about 0."""
    rng = np.random.default_rng(4)
    right = np.zeros((count, 2), np.bool_)
    right[np.arange(count), rng.integers(0, 2, count)] = rng.random(count) < 0.7
    odds = np.sort(rng.normal(0.0, 1.0, (count, 2)) + right, axis=1)[:, ::-1]
    scores = rng.normal(np.where(right, 0.6, 0.3), 0.1)
    if kind == 'noise':
        scores = np.random.default_rng(1).permutation(scores.ravel()).reshape(scores.shape)
    ones = np.ones(2 * count)
    evidence = EvidenceTable(np.zeros(2 * count, np.int64), OFFSET - odds.ravel(), ones, ones, ones, ones)
    return AlignedPlaces(evidence, scores, np.zeros_like(scores), right)


OFFSET = 10.0
ONLY_DISTANCE = ConfidenceConfig(intercept=OFFSET, distance=-1.0)
"""Log-odds are how much the distance is below the offset."""


def test_what_agrees_is_believed_and_comes_first() -> None:
    places = aligned(4000)
    found = fit_verified(places, np.ones(4000), ONLY_DISTANCE)
    assert found.score > 0.0
    assert found.verified_log_odds >= 0.0
    firsts = places.firsts(found)
    assert firsts.right.mean() > places.right[:, 0].mean() + 0.1
    # As probable as it says.
    p_right = logistic(firsts.log_odds)
    for low, high in ((0.0, 0.2), (0.2, 0.8), (0.8, 1.0)):
        part = (p_right >= low) & (p_right <= high)
        assert p_right[part].mean() == pytest.approx(firsts.right[part].mean(), abs=0.05)


def test_scores_that_tell_nothing_leave_the_probability_as_it_is() -> None:
    assert fit_verified(aligned(4000, kind='noise'), np.ones(4000), ONLY_DISTANCE).score < 1.0


@pytest.mark.parametrize('right', [True, False])
def test_alignments_need_right_and_wrong_answers(right: bool) -> None:
    places = aligned(100)
    alike = dataclasses.replace(places, right=np.full_like(places.right, right))
    with pytest.raises(DataError, match='right and wrong answers'):
        fit_verified(alike, np.ones(100), ONLY_DISTANCE)


KNOWN = dataclasses.replace(
    ONLY_DISTANCE, verified_intercept=-2.0, verified_log_odds=0.5, score=9.0, score_elsewhere=-3.0
)


def test_few_aligned_queries_keep_a_prior_and_many_replace_it() -> None:
    away = []
    for count in (4, 100, 4000):
        found = fit_verified(aligned(count), np.ones(count), ONLY_DISTANCE, KNOWN)
        away.append(abs(found.score - KNOWN.score))
    learned = fit_verified(aligned(4000), np.ones(4000), ONLY_DISTANCE).score
    assert away[0] < away[1] < away[2]
    assert away[2] == pytest.approx(abs(learned - KNOWN.score), rel=0.2)


def test_without_a_prior_for_scores_few_queries_leave_them_out() -> None:
    found = fit_verified(aligned(2), np.ones(2), ONLY_DISTANCE, ONLY_DISTANCE)
    assert 0.0 <= found.score < 1.0
    assert found.verified_log_odds == pytest.approx(1.0, abs=0.5)


def test_queries_of_which_a_place_is_not_aligned_teach_nothing() -> None:
    places = aligned(500)
    scores = places.scores.copy()
    scores[::2, 1] = np.nan
    partly = dataclasses.replace(places, scores=scores)
    assert fit_verified(partly, np.ones(500), ONLY_DISTANCE) == fit_verified(
        places.only(np.isfinite(scores[:, 1])), np.ones(250), ONLY_DISTANCE
    )
    nothing = dataclasses.replace(places, scores=np.full_like(scores, np.nan))
    assert fit_verified(nothing, np.ones(500), ONLY_DISTANCE, KNOWN) == ONLY_DISTANCE
