"""Result of a calibration: parameters for the nodes, with the fingerprint of the model that they are for."""

from __future__ import annotations

import dataclasses

from offradar_ros.config import Config, Value, parameters, replace_values
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder

SCALE = 'encoder.ring_key.variance_scale'


@dataclasses.dataclass(frozen=True)
class Calibration:
    """Result of a calibration.

    Attributes:
        values: parameters by dotted name, as `config.write_parameters` takes them.
        source: which scans they come from, in a few words.
        lines: the report for a person.
    """

    values: dict[str, Value]
    source: str
    lines: tuple[str, ...]


def calibrated_parameters(
    config: Config, encoder: Encoder, factor: float, delta: float, levels: int, level: int
) -> dict[str, Value]:
    """Every parameter of the encoder, and Δ, N, n and the model of the query, by dotted name.

    `factor` multiplies the ring key's variance. Its scale is part of the model: `query.model` is the fingerprint with
    the scale that is written, not that of `encoder`, which made the embeddings.
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
