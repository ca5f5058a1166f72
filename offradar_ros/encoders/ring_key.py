"""The ring key: mean received power over range, which a turn on the spot does not change. It needs no weights.

After Kim and Kim (Scan Context, IROS 2018), in the form of Gadd and Newman for radar: the power of each azimuth is
L2-normalised, the key is the mean over azimuths, and keys are compared by Euclidean distance.
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

# Increased whenever the same settings would give another embedding.
FORMULA = 1

# Steps between rings of 1/8 of a row's root-mean-square power, typical of clean scans, halve the variance of a ring.
STEP_PRECISION = 64.0

# Rows are summed as fixed-point integers, so that the sum does not depend on the order of the rows.
FIXED_POINT = 2.0**30


class RingKeyEncoder:
    """Ring key, with a variance from the differences between azimuth sectors.

    **Variance.** A sector is 1/`sectors` of the rotation, and one starts at each azimuth. Let k_s be the ring key of
    sector s and s_i the variance, over all sectors, of the step k_{s,i} − k_{s,i−1} into ring i. Since rows are
    L2-normalised over d rings, d·s_i is independent of scale, and

        Σ_ii = variance_scale / (1 + 64 · d · s_i).

    Structure that differs between sectors (walls, poles, cars) identifies a place, and it causes steps from ring to
    ring; the smooth decrease of power with range does not. A ring without structure keeps the prior, `variance_scale`.
    The more structure is hidden, the higher is U: by noise, by saturated azimuths, in sectors that are blocked or full
    of clutter, when returns fall below the noise floor (rain), and also in an empty place. With a calibrated
    `variance_scale`, U is 1 on average over clean scans of one sensor.

    **Limits.** U does not show a degradation of a few azimuths (5 % blocked ones change U less than it varies over
    clean scans), a sector with clutter that varies as much as real structure, or that one place resembles another. A
    receiver that cuts off low power removes noise, and its U decreases. U depends on the sensor: calibrate each.
    """

    runs_on = 'cpu'

    def __init__(self, config: RingKeyConfig) -> None:
        """ConfigError if the rings would be empty."""
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
        """For the registry; ConfigError if the rings would be empty."""
        return cls(config.ring_key)

    @property
    def info(self) -> ModelInfo:
        """The model's identity: every setting is part of it."""
        return self._info

    def encode(self, scan: PolarScan) -> Embedding:
        """Key (rings,) and variance (rings,), float32; RefusedInput ``no_signal`` if all rings are zero.

        A roll of the rows, and so a turn on the spot, changes no bit of either.
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
        # Sorted, so that the sums over the sectors do not depend on the first one.
        spread = np.sort(steps, axis=0).var(axis=0)
        variance = self.config.variance_scale / (1.0 + STEP_PRECISION * spread.size * spread)
        return np.asarray(variance, np.float32)


def _sector_keys(rows: NDArray[np.int64], sectors: int) -> NDArray[np.float64]:
    """(A, rings) mean of the fixed-point rows (A, rings) in the sector that starts at each row."""
    width = max(1, round(len(rows) / sectors))
    sums = np.cumsum(np.concatenate([np.zeros_like(rows[:1]), rows, rows[: width - 1]]), axis=0)
    keys: NDArray[np.float64] = (sums[width:] - sums[:-width]) / (width * FIXED_POINT)
    return keys
