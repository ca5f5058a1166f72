"""No scan has a say in the probability that judges it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from encoded_streets import encoded_street as street

from offradar_ros.calibration.cross_fit import cross_fit
from offradar_ros.calibration.left_out_queries import LeftOutQueries, left_out_queries
from offradar_ros.config import ConfidenceConfig
from offradar_ros.retrieval.confidence import TERMS, log_odds

PRIOR = ConfidenceConfig(intercept=1.0, distance=-1.0, spatial_ratio=-3.0, place_ratio=-2.0, unrelated_distance=3.0)


@pytest.fixture(scope='module')
def queries() -> LeftOutQueries:
    return left_out_queries([street(index, 200) for index in range(2)], 5.0, 25.0)


@pytest.mark.parametrize('prior', [None, PRIOR])
def test_the_labels_of_a_stretch_do_not_change_what_judges_it(
    queries: LeftOutQueries, prior: ConfidenceConfig | None
) -> None:
    before = cross_fit(queries, prior)
    here = queries.stretch == 3
    turned = dataclasses.replace(queries, right=np.where(here, ~queries.right, queries.right))
    after = cross_fit(turned, prior)
    np.testing.assert_array_equal(after.log_odds[here], before.log_odds[here])
    assert (np.abs(after.log_odds[~here] - before.log_odds[~here]) > 1e-6).all()
    assert after.coefficients != before.coefficients


@pytest.mark.parametrize('prior', [None, PRIOR])
def test_more_of_any_term_never_makes_an_answer_more_probable(
    queries: LeftOutQueries, prior: ConfidenceConfig | None
) -> None:
    found = cross_fit(queries, prior).coefficients
    assert all(getattr(found, name) <= 0.0 for name in TERMS)
    base = log_odds(queries.evidence, found)
    for name in ('distance', 'uncertainty', 'place_uncertainty'):
        more = dataclasses.replace(queries.evidence, **{name: getattr(queries.evidence, name) * 1.1})
        assert (log_odds(more, found) <= base + 1e-9).all()


def test_cross_fitted_probabilities_are_near_what_happens(queries: LeftOutQueries) -> None:
    found = cross_fit(queries, None)
    assert np.mean(found.p_right) == pytest.approx(np.mean(queries.right), abs=0.03)
    assert np.mean((found.p_right > 0.5) == queries.right) > 0.85
    assert ((found.p_right >= 0.0) & (found.p_right <= 1.0)).all()


def test_the_scales_of_a_prior_are_kept_and_measured_without_one(queries: LeftOutQueries) -> None:
    assert cross_fit(queries, PRIOR).coefficients.unrelated_distance == PRIOR.unrelated_distance
    apart = np.median(queries.evidence.distance_apart)
    assert cross_fit(queries, None).coefficients.unrelated_distance == pytest.approx(apart, abs=1e-3)
