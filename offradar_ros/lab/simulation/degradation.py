"""How a scan is degraded: the kind of fault, its severity, and the azimuth where it starts.

Severity is 0 (clean) to 1. For each kind, a higher severity degrades everything that a lower one does, and more. At
0.05 a fault is barely visible.
"""

from __future__ import annotations

import dataclasses
import enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
Rows = NDArray[np.intp]

_BLOCKING_POWER = 10.0**4.5
_BLOCKING_RANGE_M = 4.0
_STRIPES = 14


class DegradationKind(str, enum.Enum):
    """Faults that should raise the uncertainty; the functions below describe each."""

    BLOCKED = 'blocked'
    FLOODED = 'flooded'
    SATURATED = 'saturated'
    INTERFERENCE = 'interference'
    ATTENUATED = 'attenuated'
    PARTIAL = 'partial'


@dataclasses.dataclass(frozen=True)
class Degradation:
    """The fault of one scan; `severity` is 0 to 1, `azimuth` the row where it starts."""

    kind: DegradationKind
    severity: float
    azimuth: int


def degraded_signal(signal: Array, degradation: Degradation, cell_m: float) -> Array:
    """(A, C) mean power of returns in cells of `cell_m` metres, with the fault applied.

    * blocked: a lorry or dirt 4 m away hides up to half of the azimuths.
    * attenuated: dirt or water on the radome attenuates by up to 45 dB (two-way), unevenly over the azimuths.
    """
    azimuths, severity = len(signal), degradation.severity
    if degradation.kind is DegradationKind.BLOCKED:
        rows = (degradation.azimuth + np.arange(round(0.5 * severity * azimuths))) % azimuths
        near = round(_BLOCKING_RANGE_M / cell_m)
        signal = signal.copy()
        signal[rows] *= np.float32(1e-3)
        signal[rows, near : near + max(1, round(0.5 / cell_m))] += np.float32(_BLOCKING_POWER)
    elif degradation.kind is DegradationKind.ATTENUATED:
        turns = (np.arange(azimuths) - degradation.azimuth) / azimuths
        loss_db = 45.0 * severity * (0.85 + 0.15 * np.cos(2.0 * np.pi * turns))
        signal = signal * (10.0 ** (-0.1 * loss_db)).astype(np.float32)[:, None]
    return signal


def degraded_noise(noise: Array, degradation: Degradation, cell_m: float, rng: np.random.Generator) -> Array:
    """(A, C) mean power of noise in cells of `cell_m` metres, with the fault applied.

    * flooded: another transmitter raises the noise by up to 30 dB.
    * saturated: the receiver is overdriven by up to 45 dB, on up to half of the azimuths, in runs of 1 to 8.
    * interference: sweeps of another radar: up to 14 bright stripes whose range changes from azimuth to azimuth
      (spirals, seen from above), and up to 10 dB more noise.
    """
    severity = degradation.severity
    if degradation.kind is DegradationKind.FLOODED:
        noise = noise * np.float32(10.0 ** (3.0 * severity))
    elif degradation.kind is DegradationKind.SATURATED:
        noise = noise.copy()
        noise[_scattered_rows(len(noise), 0.5 * severity, rng)] += np.float32(10.0 ** (1.0 + 3.5 * severity))
    elif degradation.kind is DegradationKind.INTERFERENCE:
        noise = noise * np.float32(10.0**severity) + _stripes(noise.shape, severity, cell_m, rng)
    return noise


def lost_rows(azimuths: int, degradation: Degradation | None, rng: np.random.Generator) -> Rows:
    """Rows without power: with `PARTIAL` up to 70 % of the azimuths, in runs of 1 to 8; otherwise none."""
    if degradation is None or degradation.kind is not DegradationKind.PARTIAL:
        return np.empty(0, np.intp)
    return _scattered_rows(azimuths, 0.7 * degradation.severity, rng)


def _scattered_rows(azimuths: int, share: float, rng: np.random.Generator) -> Rows:
    """Runs of 1 to 8 rows in random order; the rows of a smaller share are among those of a larger one."""
    ends = np.unique(np.concatenate([np.cumsum(rng.integers(1, 9, azimuths)), [azimuths]]))
    runs = np.split(np.arange(azimuths), ends[ends < azimuths])
    order = rng.permutation(len(runs))
    return np.concatenate([runs[k] for k in order])[: round(share * azimuths)]


def _stripes(shape: tuple[int, ...], severity: float, cell_m: float, rng: np.random.Generator) -> Array:
    """(A, C) power of stripes; with severity their number and the power of each increase."""
    azimuths, cells = shape
    starts_m, widths_m = rng.uniform(0.0, cells * cell_m, _STRIPES), rng.uniform(1.0, 3.0, _STRIPES)
    slope_m, tops_db = rng.uniform(0.02, 0.3) * rng.choice([-1.0, 1.0]), rng.uniform(25.0, 45.0, _STRIPES)
    strengths = np.clip(_STRIPES * severity - np.arange(_STRIPES), 0.0, 1.0) * (0.4 + 0.6 * severity)
    ranges_m = (np.arange(cells, dtype=np.float32) + np.float32(0.5)) * np.float32(cell_m)
    length_m = cells * cell_m
    total = np.zeros(shape, np.float32)
    for start_m, width_m, top_db, strength in zip(starts_m, widths_m, tops_db, strengths, strict=True):
        if strength > 0.0:
            centres_m = np.mod(start_m + slope_m * np.arange(azimuths), length_m).astype(np.float32)
            distances_m = np.abs(ranges_m - centres_m[:, None])
            inside = np.minimum(distances_m, np.float32(length_m) - distances_m) < width_m
            total[inside] += np.float32(10.0 ** (0.1 * top_db * strength))
    return total
