"""Result of a calibration: parameters for the nodes, with the fingerprint of the model that they are for."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from offradar_ros.config import ConfidenceConfig, Config, RingKeyConfig, Value, parameters, replace_values
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.retrieval.confidence import shipped_confidences

SCALE = 'encoder.ring_key.variance_scale'
CONFIDENCE = 'query.confidence.'
MIN_PROBABILITY = 'query.min_probability'
MIN_PROBABILITY_UNALIGNED = 'query.min_probability_unaligned'


class Thresholds(NamedTuple):
    """Δ, N and n of `QueryConfig`."""

    delta: float
    levels: int
    level: int


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
    config: Config, encoder: Encoder, factor: float, thresholds: Thresholds, coefficients: ConfidenceConfig | None
) -> dict[str, Value]:
    """Every parameter of the encoder, and Δ, N, n, the model and the coefficients of the query, by dotted name.

    `factor` multiplies the ring key's variance. Its scale is part of the model: `query.model` and the model of the
    coefficients are the fingerprint with the scale that is written, not that of `encoder`, which made the embeddings.
    """
    values: dict[str, Value] = {
        leaf.name: leaf.value for leaf in parameters(config) if leaf.name.startswith('encoder.') and leaf.value != ''
    }
    if config.encoder.name == 'ring_key':
        values[SCALE] = config.encoder.ring_key.variance_scale * factor
        encoder = make_encoder(replace_values(config, {SCALE: values[SCALE]}).encoder)
    values |= {
        'query.delta': thresholds.delta,
        'query.levels': thresholds.levels,
        'query.level': thresholds.level,
        'query.model': encoder.info.fingerprint,
    }
    if coefficients is None:
        return values
    stamped = dataclasses.replace(coefficients, model=encoder.info.fingerprint)
    return values | {leaf.name: leaf.value for leaf in parameters(stamped, CONFIDENCE)}


def shipped_confidence(config: Config, usual_uncertainty: float) -> ConfidenceConfig | None:
    """The coefficients that ship for the encoder, with this usual U; the ring key's are for any of its scales."""
    if config.encoder.name == 'ring_key':
        config = replace_values(config, {SCALE: RingKeyConfig().variance_scale})
    shipped = shipped_confidences().get(make_encoder(config.encoder).info.fingerprint)
    return None if shipped is None else dataclasses.replace(shipped, usual_uncertainty=usual_uncertainty)
