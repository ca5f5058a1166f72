from __future__ import annotations

import dataclasses

from offradar_ros.calibration.parameters import Thresholds, calibrated_parameters, shipped_confidence
from offradar_ros.config import ConfidenceConfig, Config, load_config, replace_values
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.retrieval.confidence import confidence_for

COEFFICIENTS = ConfidenceConfig(model='other', intercept=1.0, distance=-2.0, usual_uncertainty=1.3)


def test_the_fingerprint_is_that_of_the_written_scale() -> None:
    config = replace_values(
        Config(), {'encoder.name': 'ring_key', 'encoder.ring_key.variance_scale': 4.0, 'encoder.ring_key.rings': 64}
    )
    before = make_encoder(config.encoder)
    values = calibrated_parameters(config, before, 0.5, Thresholds(0.3, 20, 7), COEFFICIENTS)
    written = load_config(overrides=values)
    assert written.encoder.ring_key.variance_scale == 2.0
    assert (written.query.delta, written.query.levels, written.query.level) == (0.3, 20, 7)
    assert written.query.model == make_encoder(written.encoder).info.fingerprint != before.info.fingerprint
    assert written.query.confidence == dataclasses.replace(COEFFICIENTS, model=written.query.model)


def test_the_coefficients_of_the_ring_key_ship_for_any_scale_of_its_variance() -> None:
    for name in ('variational', 'ring_key'):
        plain = replace_values(Config(), {'encoder.name': name})
        scaled = replace_values(plain, {'encoder.ring_key.variance_scale': 4.0})
        fingerprint = make_encoder(plain.encoder).info.fingerprint
        shipped = confidence_for(fingerprint, ConfidenceConfig())
        assert shipped is not None
        assert shipped_confidence(scaled, 1.3) == dataclasses.replace(shipped, usual_uncertainty=1.3)


def test_settings_without_coefficients_have_none_afterwards() -> None:
    config = replace_values(Config(), {'encoder.name': 'ring_key', 'encoder.ring_key.rings': 64})
    assert shipped_confidence(config, 1.0) is None
    values = calibrated_parameters(config, make_encoder(config.encoder), 1.0, Thresholds(0.3, 20, 7), None)
    assert not any(name.startswith('query.confidence') for name in values)
