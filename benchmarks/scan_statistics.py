"""Statistics to compare simulated with recorded scans."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.types import PolarScan

Array = NDArray[np.float64]

QUANTILES = (0.5, 0.75, 0.9, 0.95, 0.99, 0.999)
BANDS_M = ((5, 15), (15, 30), (30, 60), (60, 100), (100, 160))
LAGS_M = (0.175, 0.35, 0.7, 1.4, 2.8, 5.6)
LAGS_ROWS = (1, 2, 3, 5, 10, 20)
STEP_M = 2.0
"""Step in range of the mean byte against range."""
_NEAREST_M = 3.0
"""Nearer returns are of the vehicle."""


@dataclasses.dataclass(frozen=True)
class Statistics:
    """Statistics of several scans of one sensor, in bytes.

    Attributes:
        quantiles: of all bytes beyond 3 m, at `QUANTILES`.
        bands: mean byte in each of `BANDS_M`, NaN beyond the sensor's range.
        along_range: autocorrelation at `LAGS_M`.
        along_azimuth: autocorrelation at `LAGS_ROWS`.
    """

    quantiles: Array
    bands: Array
    along_range: Array
    along_azimuth: Array


def statistics(scans: list[PolarScan]) -> Statistics:
    """Means over `scans`, which have one size."""
    resolution_m = scans[0].range_resolution_m
    power = np.stack([scan.power for scan in scans]).astype(np.float32)
    seen = power[:, :, round(_NEAREST_M / resolution_m) :]
    deviation = seen - seen.mean()
    variance = float(np.mean(deviation**2))
    lags = [max(1, round(lag / resolution_m)) for lag in LAGS_M]
    return Statistics(
        quantiles=np.quantile(seen, QUANTILES),
        bands=np.array([_mean(power, *(round(edge / resolution_m) for edge in band)) for band in BANDS_M]),
        along_range=np.array([np.mean(deviation[:, :, k:] * deviation[:, :, :-k]) for k in lags]) / variance,
        along_azimuth=np.array([np.mean(deviation * np.roll(deviation, k, 1)) for k in LAGS_ROWS]) / variance,
    )


def mean_against_range(scans: list[PolarScan]) -> tuple[Array, Array]:
    """Ranges in metres and the mean byte about each."""
    count = int(scans[0].max_range_m / STEP_M)
    bins = STEP_M / scans[0].range_resolution_m
    power = np.stack([scan.power for scan in scans]).mean(axis=(0, 1), dtype=np.float64)
    means = [power[round(k * bins) : round((k + 1) * bins)].mean() for k in range(count)]
    return (np.arange(count, dtype=np.float64) + 0.5) * STEP_M, np.array(means, np.float64)


def _mean(power: NDArray[np.float32], start: int, stop: int) -> float:
    return float(power[:, :, start:stop].mean()) if start < 0.9 * power.shape[2] else float('nan')
