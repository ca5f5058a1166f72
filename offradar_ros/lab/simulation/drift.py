"""How a radar deviates from its physics during one drive.

The gain and the noise of its receiver wander over minutes. What is beside the antenna, and dirt and water on the
radome, make some sectors weaker than others, which stays the same during a drive.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.physics import RadarPhysics

Array = NDArray[np.float64]

_PERIODS_S = (40.0, 130.0, 600.0)
_HARMONICS = 4


class Deviation(NamedTuple):
    """Deviation of one scan.

    Attributes:
        gain_db, noise_db: of the receiver's gain and noise.
        sectors: float32, linear gain of the antenna, of shape (A, 1) by azimuth, or (1, 1).
    """

    gain_db: float
    noise_db: float
    sectors: NDArray[np.float32]


NO_DEVIATION = Deviation(0.0, 0.0, np.ones((1, 1), np.float32))


class Drift:
    """The deviations during a drive; `seed` draws them. In decibels all are 0 on average."""

    def __init__(self, physics: RadarPhysics, azimuths: int, seed: int) -> None:
        rng = np.random.default_rng([seed, 10])
        self._physics = physics
        self._phases = rng.uniform(0.0, 2.0 * np.pi, (2, len(_PERIODS_S)))
        turns = np.outer(np.arange(1, _HARMONICS + 1), np.arange(azimuths)) * (2.0 * np.pi / azimuths)
        sectors_db = physics.sector_gain_db * _wave(turns + rng.uniform(0.0, 2.0 * np.pi, (_HARMONICS, 1)))
        self._sectors = (10.0 ** (sectors_db / 10.0)).astype(np.float32)[:, None]

    def at(self, seconds: float) -> Deviation:
        """The deviation of a scan `seconds` after the start."""
        gain, noise = (float(_wave(2.0 * np.pi * seconds / np.array(_PERIODS_S) + phases)) for phases in self._phases)
        return Deviation(self._physics.gain_drift_db * gain, self._physics.noise_drift_db * noise, self._sectors)


def _wave(phases: Array) -> Array:
    """Sum of the sines of (K, …) phases, scaled to a standard deviation of 1."""
    return np.asarray(np.sin(phases).sum(axis=0) * np.sqrt(2.0 / len(phases)))
