"""Random changes of a radar's receiver, so that a network does not rely on one gain, noise floor or saturation."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.training.config import BatchConfig
from offradar_ros.types import PolarScan

_GREATEST = 255.0
_BYTES_PER_DECIBEL = 2.0
_LEAST_HEADROOM = 0.5
"""A knee within half a byte of the greatest changes none."""


def draw_changes(config: BatchConfig, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(count, 3) float64 dB: gain, added noise floor, and how far the knee is below the greatest byte.

    Each is uniform: gain within ± `gain_db`, the others from 0 up to `floor_db` and `knee_db`.
    """
    low = (-config.gain_db, 0.0, 0.0)
    return rng.uniform(low, (config.gain_db, config.floor_db, config.knee_db), (count, 3))


def receiver_table(gain_db: float, floor_db: float, knee_db: float) -> NDArray[np.uint8]:
    """(256,) uint8: the byte that the changed receiver gives instead of each byte.

    A byte b is the logarithm of power P in half decibels, b = 20 log₁₀(1 + P), as in Navtech's sensors and the
    simulator. With gain g and added noise N, P becomes g P + N: strong returns move by a constant, and below the new
    floor all is near it. Above a knee at k = 255 − 2 `knee_db` levels are compressed towards 255,
    k + (255 − k)(1 − exp((k − b) / (255 − k))). Without changes it is the identity.
    """
    power = 10.0 ** (np.arange(256) / 20.0) - 1.0
    noise = 10.0 ** (_BYTES_PER_DECIBEL * floor_db / 20.0) - 1.0
    level = 20.0 * np.log10(1.0 + 10.0 ** (gain_db / 10.0) * power + noise)
    headroom = _BYTES_PER_DECIBEL * knee_db
    if headroom > _LEAST_HEADROOM:
        over = np.maximum(level - (_GREATEST - headroom), 0.0)
        level = np.minimum(level, _GREATEST - headroom) - headroom * np.expm1(-over / headroom)
    return np.asarray(np.rint(np.minimum(level, _GREATEST)), np.uint8)


def with_changes(scan: PolarScan, changes: NDArray[np.float64]) -> PolarScan:
    """The scan as another receiver would have given it; `changes` (3,) is a row of `draw_changes`."""
    if not changes.any():
        return scan
    return dataclasses.replace(scan, power=receiver_table(*changes)[scan.power])
