"""The probability falls with every term, is finite for all evidence, and belongs to one model."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from offradar_ros.config import ConfidenceConfig, EncoderConfig, load_config
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import ConfigError
from offradar_ros.retrieval.confidence import confidence_for, log_odds, probability, shipped_confidences, without_rival
from offradar_ros.types import Evidence

COEFFICIENTS = ConfidenceConfig(
    model='a' * 64,
    intercept=5.0,
    distance=-4.0,
    spatial_ratio=-3.0,
    place_ratio=-2.0,
    uncertainty=-1.0,
    place_uncertainty=-0.5,
)
EVIDENCE = Evidence(0.4, 0.8, 0.9, 1.1, 0.9)
distances = st.floats(0.0, 2.0)
or_none = st.one_of(distances, st.just(math.inf))
variances = st.floats(0.0, 1e6)


def test_the_log_odds_are_the_sum_of_the_terms() -> None:
    expected = 5.0 - 4.0 * 0.4 - 3.0 * math.log(0.5) - 2.0 * math.log(0.4 / 0.9) - math.log(1.1) - 0.5 * math.log(0.9)
    assert float(log_odds(EVIDENCE, COEFFICIENTS)) == pytest.approx(expected)
    assert float(probability(EVIDENCE, COEFFICIENTS)) == pytest.approx(1.0 / (1.0 + math.exp(-expected)))


def test_the_usual_uncertainty_is_the_unit_of_both() -> None:
    scaled = dataclasses.replace(EVIDENCE, uncertainty=1.1 * 3.0, place_uncertainty=0.9 * 3.0)
    of_sensor = dataclasses.replace(COEFFICIENTS, usual_uncertainty=3.0)
    assert float(log_odds(scaled, of_sensor)) == pytest.approx(float(log_odds(EVIDENCE, COEFFICIENTS)))


@given(
    distances, st.one_of(distances, st.just(math.inf)), st.one_of(distances, st.just(math.inf)), variances, variances
)
def test_any_evidence_has_a_probability(distance: float, apart: float, place: float, u: float, place_u: float) -> None:
    found = float(probability(Evidence(distance, apart, place, u, place_u), COEFFICIENTS))
    assert 0.0 <= found <= 1.0
    assert np.isfinite(log_odds(Evidence(distance, apart, place, u, place_u), COEFFICIENTS))


@given(
    st.builds(Evidence, *(st.floats(0.05, 2.0) for _ in range(5))),
    st.sampled_from([field.name for field in dataclasses.fields(Evidence)]),
    st.floats(1.0, 3.0),
)
def test_worse_evidence_is_never_more_probable(evidence: Evidence, name: str, factor: float) -> None:
    # Nearer places elsewhere are worse, and more of everything else is.
    worse = 1.0 / factor if name.endswith('apart') else factor
    changed = dataclasses.replace(evidence, **{name: getattr(evidence, name) * worse})
    assert log_odds(changed, COEFFICIENTS) <= log_odds(evidence, COEFFICIENTS) + 1e-12


def test_a_map_without_another_place_uses_the_typical_distance() -> None:
    alone = without_rival(EVIDENCE)
    typical = dataclasses.replace(EVIDENCE, distance_apart=1.0, place_distance_apart=1.0)
    assert float(log_odds(alone, COEFFICIENTS)) == float(log_odds(typical, COEFFICIENTS))


def test_two_equal_places_apart_share_a_ratio_of_one() -> None:
    same = dataclasses.replace(EVIDENCE, distance=0.0, distance_apart=0.0)
    assert float(log_odds(same, COEFFICIENTS)) < float(
        log_odds(dataclasses.replace(same, distance_apart=0.5), COEFFICIENTS)
    )


@pytest.mark.parametrize('encoder', [EncoderConfig(), EncoderConfig(name='ring_key', weights='')])
def test_every_encoder_that_ships_has_coefficients(encoder: EncoderConfig) -> None:
    model = make_encoder(encoder).info.fingerprint
    found = confidence_for(model, ConfidenceConfig())
    assert found is shipped_confidences()[model]
    assert found is not None
    assert found.model == model


def test_configured_coefficients_are_for_their_model_alone() -> None:
    assert confidence_for('a' * 64, COEFFICIENTS) is COEFFICIENTS
    assert confidence_for('b' * 64, COEFFICIENTS) is None
    assert confidence_for('b' * 64, ConfidenceConfig()) is None


def test_a_coefficient_that_rewards_bad_evidence_is_refused() -> None:
    with pytest.raises(ConfigError, match=r'query.confidence.distance: expected at most 0'):
        load_config(None, {'query.confidence.distance': 1.0})
