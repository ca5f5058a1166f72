"""What spoils a scan, by how much, and on which azimuths: part of the ground truth.

Severity runs from 0, nothing, to 1. Within a kind more of it always hides more: what a severity spoils, a higher one
spoils too. At 0.05 a fault is barely visible.
"""

from __future__ import annotations

import dataclasses
import enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
Rows = NDArray[np.intp]

_BLOCK = 10.0**4.5
_NEAR_M = 4.0
_STRIPES = 14


class DegradationKind(str, enum.Enum):
    """Faults that the uncertainty should rise for; the functions below say what each does."""

    BLOCKED = 'blocked'
    FLOODED = 'flooded'
    SATURATED = 'saturated'
    INTERFERENCE = 'interference'
    ATTENUATED = 'attenuated'
    PARTIAL = 'partial'


HELD_OUT_KINDS: tuple[DegradationKind, ...] = ()
"""Kinds that training is not shown, so that answers to faults never trained on can be judged."""

TRAINED_KINDS = tuple(kind for kind in DegradationKind if kind not in HELD_OUT_KINDS)
"""Kinds that training draws from."""


@dataclasses.dataclass(frozen=True)
class Degradation:
    """One scan's fault; `severity` 0 to 1, `azimuth` the row where it starts."""

    kind: DegradationKind
    severity: float
    azimuth: int


def degraded_signal(signal: Array, degradation: Degradation, cell_m: float) -> Array:
    """(A, C) mean power of what returns, cells of `cell_m` metres, as the fault leaves it.

    * blocked: a lorry or dirt hides up to half of the rotation behind a return 4 m away.
    * attenuated: dirt or water on the radome takes up to 45 dB there and back, unevenly round the rotation.
    """
    azimuths, severity = len(signal), degradation.severity
    if degradation.kind is DegradationKind.BLOCKED:
        rows = (degradation.azimuth + np.arange(round(0.5 * severity * azimuths))) % azimuths
        near = round(_NEAR_M / cell_m)
        signal = signal.copy()
        signal[rows] *= np.float32(1e-3)
        signal[rows, near : near + max(1, round(0.5 / cell_m))] += np.float32(_BLOCK)
    elif degradation.kind is DegradationKind.ATTENUATED:
        turns = (np.arange(azimuths) - degradation.azimuth) / azimuths
        loss_db = 45.0 * severity * (0.85 + 0.15 * np.cos(2.0 * np.pi * turns))
        signal = signal * (10.0 ** (-0.1 * loss_db)).astype(np.float32)[:, None]
    return signal


def degraded_noise(noise: Array, degradation: Degradation, cell_m: float, rng: np.random.Generator) -> Array:
    """(A, C) mean power of noise, cells of `cell_m` metres, with the fault in it.

    * flooded: another transmitter lifts it by up to 30 dB.
    * saturated: the receiver is overdriven, by up to 45 dB, on up to half of the azimuths, a few neighbours at a time.
    * interference: another radar's sweeps cross this one's: up to 14 bright stripes that drift in range from azimuth
      to azimuth, spirals from above, and up to 10 dB more noise.
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
    """Rows that arrive empty: with `PARTIAL` up to seven tenths, a few neighbours at a time, else none."""
    if degradation is None or degradation.kind is not DegradationKind.PARTIAL:
        return np.empty(0, np.intp)
    return _scattered_rows(azimuths, 0.7 * degradation.severity, rng)


def _scattered_rows(azimuths: int, share: float, rng: np.random.Generator) -> Rows:
    """Runs of 1 to 8 rows in an order of their own: a smaller share is the beginning of a larger one."""
    ends = np.unique(np.concatenate([np.cumsum(rng.integers(1, 9, azimuths)), [azimuths]]))
    runs = np.split(np.arange(azimuths), ends[ends < azimuths])
    order = rng.permutation(len(runs))
    return np.concatenate([runs[k] for k in order])[: round(share * azimuths)]


def _stripes(shape: tuple[int, ...], severity: float, cell_m: float, rng: np.random.Generator) -> Array:
    """(A, C) power of stripes: with severity all grow, and the next one rises out of nothing."""
    azimuths, cells = shape
    starts_m, widths_m = rng.uniform(0.0, cells * cell_m, _STRIPES), rng.uniform(1.0, 3.0, _STRIPES)
    slope_m, tops_db = rng.uniform(0.02, 0.3) * rng.choice([-1.0, 1.0]), rng.uniform(25.0, 45.0, _STRIPES)
    risen = np.clip(_STRIPES * severity - np.arange(_STRIPES), 0.0, 1.0) * (0.4 + 0.6 * severity)
    ranges_m = (np.arange(cells, dtype=np.float32) + np.float32(0.5)) * np.float32(cell_m)
    length_m = cells * cell_m
    total = np.zeros(shape, np.float32)
    for start_m, width_m, top_db, rise in zip(starts_m, widths_m, tops_db, risen, strict=True):
        if rise > 0.0:
            centres_m = np.mod(start_m + slope_m * np.arange(azimuths), length_m).astype(np.float32)
            away = np.abs(ranges_m - centres_m[:, None])
            inside = np.minimum(away, np.float32(length_m) - away) < width_m
            total[inside] += np.float32(10.0 ** (0.1 * top_db * rise))
    return total
