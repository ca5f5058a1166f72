"""Result of a calibration: parameters for the nodes, with the fingerprint of the model that they are for."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import ConfidenceConfig, Config, RingKeyConfig, Value, parameters, replace_values
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.retrieval.confidence import shipped_confidences

SCALE = 'encoder.ring_key.variance_scale'
CONFIDENCE = 'query.confidence.'


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
    config: Config, encoder: Encoder, uncertainties: NDArray[np.float64], factor: float, thresholds: Thresholds
) -> dict[str, Value]:
    """Every parameter of the encoder, and Δ, N, n, the model and the coefficients of the query, by dotted name.

    `factor` multiplies the ring key's variance. Its scale is part of the model: `query.model` is the fingerprint with
    the scale that is written, not that of `encoder`, which made the embeddings. Coefficients that ship for the encoder
    are kept, with the median of the drive's `uncertainties` (N,), multiplied by `factor`, as the usual U of the sensor.
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
    shipped = _shipped_confidence(config)
    if shipped is None:
        return values
    usual = dataclasses.replace(
        shipped, model=encoder.info.fingerprint, usual_uncertainty=float(np.median(uncertainties))
    )
    return values | {leaf.name: leaf.value for leaf in parameters(usual, CONFIDENCE)}


def _shipped_confidence(config: Config) -> ConfidenceConfig | None:
    """The coefficients that ship for the encoder; those of the ring key are for any scale of its variance."""
    if config.encoder.name == 'ring_key':
        config = replace_values(config, {SCALE: RingKeyConfig().variance_scale})
    return shipped_confidences().get(make_encoder(config.encoder).info.fingerprint)
