"""The ring key: mean received power against range, which turning on the spot does not change. It needs no weights.

After Kim and Kim (Scan Context, IROS 2018), in the form that Gadd and Newman use for radar: each azimuth's power is
L2-normalised before the mean over azimuths is taken, and keys are compared by Euclidean distance.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import EncoderConfig, RingKeyConfig
from offradar_ros.encoders.fingerprint import fingerprint
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.encoders.rings import ring_power
from offradar_ros.errors import ConfigError, RefusedInput
from offradar_ros.types import Embedding, PolarScan

# Changes whenever the same settings would give another embedding.
FORMULA = 1

# A step between rings of 1/8 of a row's root-mean-square power, typical of clean scans, halves a ring's variance.
STEP_PRECISION = 64.0

# Rows are summed as integers of this many parts of one: such a sum has no order, so rolls leave it bit for bit.
FIXED_POINT = 2.0**30


class RingKeyEncoder:
    """Ring key and a variance made from how much the azimuth sectors tell apart.

    **Variance.** A sector is any 1/`sectors` of the rotation: one starts at each azimuth. Let k_s be the ring key of
    sector s and s_i the variance over all sectors of k_{s,i} − k_{s,i−1}, the step into ring i. With d rings of unit
    rows, d·s_i has no scale, and

        Σ_ii = variance_scale / (1 + 64 · d · s_i).

    Structure that differs from sector to sector (walls, poles, cars) is what identifies a place, and it makes steps
    from ring to ring; the smooth fall of power with range does not. A ring without it keeps the prior,
    `variance_scale`. Whatever hides structure raises U, the more the more is hidden: noise, saturated azimuths,
    sectors blocked or filled with clutter, returns that sink into the noise floor (rain), and also a truly empty
    place. With `variance_scale` calibrated, U is 1 on average over clean scans of one sensor.

    **It cannot see** a degradation of a few azimuths (5 % of them blocked moves U by no more than clean scans
    scatter), a sector filled with clutter that varies as much as the world, or one place that looks like another. A
    receiver that cuts off low power loses noise with it, and its U falls. U depends on the sensor: calibrate each.
    """

    runs_on = 'cpu'

    def __init__(self, config: RingKeyConfig) -> None:
        """ConfigError where the rings would be empty."""
        if config.min_range_m >= config.max_range_m:
            raise ConfigError(
                f'parameter encoder.ring_key.min_range_m: expected less than max_range_m = {config.max_range_m:g} m, '
                f'got {config.min_range_m:g}'
            )
        self.config = config
        settings = dataclasses.asdict(config)
        self._info = ModelInfo(
            name='ring_key',
            fingerprint=fingerprint('ring_key', {**settings, 'formula': FORMULA}),
            dimension=config.rings,
            metadata={key: f'{value}' for key, value in settings.items()},
        )

    @classmethod
    def from_config(cls, config: EncoderConfig) -> RingKeyEncoder:
        """As the registry makes it; ConfigError as above."""
        return cls(config.ring_key)

    @property
    def info(self) -> ModelInfo:
        """The model's identity: every setting is part of it."""
        return self._info

    def encode(self, scan: PolarScan) -> Embedding:
        """Key (rings,) and variance (rings,), float32; RefusedInput ``no_signal`` where all rings are zero.

        Neither changes by a bit when the rows are rolled: turning on the spot keeps the key and its variance.
        """
        if not scan.power.size:
            raise RefusedInput('no_signal', f'scan at {scan.stamp_ns} ns is empty: shape {scan.power.shape}')
        config = self.config
        power = ring_power(scan, config.rings, config.max_range_m, config.min_range_m)
        norms = np.linalg.norm(power, axis=1, keepdims=True)
        if not norms.any():
            raise RefusedInput(
                'no_signal',
                f'scan at {scan.stamp_ns} ns holds no power between {config.min_range_m:g} m and '
                f'{config.max_range_m:g} m',
            )
        rows = np.rint(power * (FIXED_POINT / np.where(norms > 0.0, norms, 1.0))).astype(np.int64)
        return Embedding(
            stamp_ns=scan.stamp_ns,
            mean=(rows.sum(axis=0) / (len(rows) * FIXED_POINT)).astype(np.float32),
            variance=self._variance(_sector_keys(rows, config.sectors)),
            model=self._info.fingerprint,
        )

    def _variance(self, sector_keys: NDArray[np.float64]) -> NDArray[np.float32]:
        """Keys of all sectors (A, rings) float64 → (rings,) float32."""
        steps = np.diff(sector_keys, axis=1, prepend=0.0)
        # Sorted, so that the sums over the sectors do not depend on which comes first.
        spread = np.sort(steps, axis=0).var(axis=0)
        variance = self.config.variance_scale / (1.0 + STEP_PRECISION * spread.size * spread)
        return np.asarray(variance, np.float32)


def _sector_keys(rows: NDArray[np.int64], sectors: int) -> NDArray[np.float64]:
    """(A, rings) mean of the rows of the sector that starts at each row, of fixed-point rows (A, rings)."""
    width = max(1, round(len(rows) / sectors))
    sums = np.cumsum(np.concatenate([np.zeros_like(rows[:1]), rows, rows[: width - 1]]), axis=0)
    keys: NDArray[np.float64] = (sums[width:] - sums[:-width]) / (width * FIXED_POINT)
    return keys
