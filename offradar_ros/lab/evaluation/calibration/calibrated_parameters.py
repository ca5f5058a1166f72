"""The parameters that a calibration writes, stamped with the model that they are for."""

from __future__ import annotations

from offradar_ros.config import Config, Value, parameters, replace_values
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder

SCALE = 'encoder.ring_key.variance_scale'


def calibrated_parameters(
    config: Config, encoder: Encoder, factor: float, delta: float, levels: int, level: int
) -> dict[str, Value]:
    """Every parameter of the encoder, and Δ, N, n and the model of the query, by dotted name.

    `factor` is what the ring key's variance is multiplied with. Its scale is part of the model: `query.model` is the
    fingerprint with the scale that is written, not that of `encoder`, which made the embeddings.
    """
    values: dict[str, Value] = {
        leaf.name: leaf.value for leaf in parameters(config) if leaf.name.startswith('encoder.') and leaf.value != ''
    }
    if config.encoder.name == 'ring_key':
        values[SCALE] = config.encoder.ring_key.variance_scale * factor
        encoder = make_encoder(replace_values(config, {SCALE: values[SCALE]}).encoder)
    return values | {
        'query.delta': delta,
        'query.levels': levels,
        'query.level': level,
        'query.model': encoder.info.fingerprint,
    }
