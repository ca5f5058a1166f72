from __future__ import annotations

import dataclasses

import numpy as np

from offradar_ros.calibration.parameters import Thresholds, calibrated_parameters
from offradar_ros.config import ConfidenceConfig, Config, load_config, replace_values
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.retrieval.confidence import confidence_for

UNCERTAINTIES = np.array([0.9, 1.3, 1.5])


def test_the_fingerprint_is_that_of_the_written_scale() -> None:
    config = replace_values(
        Config(), {'encoder.name': 'ring_key', 'encoder.ring_key.variance_scale': 4.0, 'encoder.ring_key.rings': 64}
    )
    before = make_encoder(config.encoder)
    values = calibrated_parameters(config, before, UNCERTAINTIES, 0.5, Thresholds(0.3, 20, 7))
    written = load_config(overrides=values)
    assert written.encoder.ring_key.variance_scale == 2.0
    assert (written.query.delta, written.query.levels, written.query.level) == (0.3, 20, 7)
    assert written.query.model == make_encoder(written.encoder).info.fingerprint != before.info.fingerprint


def test_the_shipped_coefficients_are_kept_with_the_usual_uncertainty_of_the_sensor() -> None:
    for name in ('variational', 'ring_key'):
        config = replace_values(Config(), {'encoder.name': name, 'encoder.ring_key.variance_scale': 4.0})
        encoder = make_encoder(config.encoder)
        values = calibrated_parameters(config, encoder, UNCERTAINTIES, 1.0, Thresholds(0.3, 20, 7))
        query = load_config(overrides=values).query
        plain = make_encoder(replace_values(Config(), {'encoder.name': name}).encoder).info.fingerprint
        shipped = confidence_for(plain, ConfidenceConfig())
        assert shipped is not None
        assert query.confidence == dataclasses.replace(shipped, model=query.model, usual_uncertainty=1.3)


def test_settings_without_coefficients_have_none_afterwards() -> None:
    config = replace_values(Config(), {'encoder.name': 'ring_key', 'encoder.ring_key.rings': 64})
    encoder = make_encoder(config.encoder)
    values = calibrated_parameters(config, encoder, UNCERTAINTIES, 1.0, Thresholds(0.3, 20, 7))
    assert not any(name.startswith('query.confidence') for name in values)
