"""Statistics to compare simulated with recorded scans."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

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


PANELS = ('mean byte against range', 'quantiles', 'correlation along range', 'along azimuth')
"""What each scan is described by, for `energy_distances`: the panels of docs/simulator_statistics.png."""

_SHARES = np.linspace(0.025, 0.975, 39)


def energy_distances(simulated: list[PolarScan], recorded: dict[str, list[PolarScan]]) -> Array:
    """(4,) float64 energy distance (Székely and Rizzo, 2013) of simulated from recorded scans, for each of `PANELS`.

    With X and Y the curves of a random simulated and a random recorded scan, and the root mean square along a curve as
    the norm, 2 E|X − Y| − E|X − X'| − E|Y − Y'|, in bytes or as a correlation: 0 where curves are distributed alike.
    Every source of recorded scans has the same weight. Ranges are compared as far as all sensors see.
    """
    reach_m = min(scans[0].max_range_m for scans in [simulated, *recorded.values()])
    ours = [_curves(scan, reach_m) for scan in simulated]
    theirs = [_curves(scan, reach_m) for scans in recorded.values() for scan in scans]
    weights = np.concatenate([np.full(len(scans), 1.0 / len(scans) / len(recorded)) for scans in recorded.values()])
    return np.array(
        [
            _energy_distance(np.array([c[panel] for c in ours]), np.array([c[panel] for c in theirs]), weights)
            for panel in range(len(PANELS))
        ]
    )


def covered(simulated: list[PolarScan], recorded: dict[str, list[PolarScan]]) -> Array:
    """(4,) float64, share of the points of recorded curves between the 2.5 % and 97.5 % quantiles of simulated ones."""
    reach_m = min(scans[0].max_range_m for scans in [simulated, *recorded.values()])
    ours = [_curves(scan, reach_m) for scan in simulated]
    shares = []
    for panel in range(len(PANELS)):
        low, high = np.quantile([curves[panel] for curves in ours], (0.025, 0.975), axis=0)
        inside = [
            np.mean([(low <= c) & (c <= high) for c in (_curves(scan, reach_m)[panel] for scan in scans)])
            for scans in recorded.values()
        ]
        shares.append(np.mean(inside))
    return np.array(shares)


def _curves(scan: PolarScan, reach_m: float) -> tuple[Array, Array, Array, Array]:
    """The curves of one scan, in the order of `PANELS`."""
    found = statistics([scan])
    ranges_m, means = mean_against_range([scan])
    seen = scan.power[:, round(_NEAREST_M / scan.range_resolution_m) : round(reach_m / scan.range_resolution_m)]
    inside = (ranges_m > _NEAREST_M) & (ranges_m < reach_m - STEP_M)
    return means[inside], np.quantile(seen, _SHARES), found.along_range, found.along_azimuth


def _energy_distance(ours: Array, theirs: Array, weights: Array) -> float:
    """Of (N, K) curves, equally weighted, and (M, K) curves weighted by (M,) of sum 1."""
    across, within, between = (
        cdist(a, b) / np.sqrt(ours.shape[1]) for a, b in ((ours, theirs), (ours, ours), (theirs, theirs))
    )
    return float(2.0 * np.mean(across @ weights) - np.mean(within) - weights @ between @ weights)


def mean_against_range(scans: list[PolarScan]) -> tuple[Array, Array]:
    """Ranges in metres and the mean byte about each."""
    count = int(scans[0].max_range_m / STEP_M)
    bins = STEP_M / scans[0].range_resolution_m
    power = np.stack([scan.power for scan in scans]).mean(axis=(0, 1), dtype=np.float64)
    means = [power[round(k * bins) : round((k + 1) * bins)].mean() for k in range(count)]
    return (np.arange(count, dtype=np.float64) + 0.5) * STEP_M, np.array(means, np.float64)


def _mean(power: NDArray[np.float32], start: int, stop: int) -> float:
    return float(power[:, :, start:stop].mean()) if start < 0.9 * power.shape[2] else float('nan')
