from __future__ import annotations

from offradar_ros.calibration.parameters import calibrated_parameters
from offradar_ros.config import Config, load_config, replace_values
from offradar_ros.encoders.registry import make_encoder


def test_the_fingerprint_is_that_of_the_written_scale() -> None:
    config = replace_values(
        Config(), {'encoder.name': 'ring_key', 'encoder.ring_key.variance_scale': 4.0, 'encoder.ring_key.rings': 64}
    )
    before = make_encoder(config.encoder)
    values = calibrated_parameters(config, before, 0.5, delta=0.3, levels=20, level=7)
    written = load_config(overrides=values)
    assert written.encoder.ring_key.variance_scale == 2.0
    assert (written.query.delta, written.query.levels, written.query.level) == (0.3, 20, 7)
    assert written.query.model == make_encoder(written.encoder).info.fingerprint != before.info.fingerprint
