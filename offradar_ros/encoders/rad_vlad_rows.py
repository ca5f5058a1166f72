"""The local descriptors of FFT-RadVLAD: the spectrum of each azimuth's power along range.

Convention: the power between 0 and `max_range_m` is gathered into `bins` equal rings, blank nearer than `min_range_m`.
The magnitudes m_0 … m_{bins−1} of a row's discrete Fourier transform are symmetric (m_k = m_{bins−k}). Only the first
half is kept, and m_1 … m_{bins/2−1} are multiplied by √2, so that norms and distances equal those of the full spectrum.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.rings import ring_power
from offradar_ros.errors import ConfigError, RefusedInput
from offradar_ros.types import PolarScan

# Rows are multiples of this, so that sums in float64 are exact and do not depend on the order of the rows.
_PART = 2.0**-30


@dataclasses.dataclass(frozen=True)
class RowSettings:
    """Settings of the spectra; ConfigError for invalid ones.

    Attributes:
        max_range_m: outer edge of the last ring.
        min_range_m: nearer returns are blanked (Gadd and Newman blank 60 bins of 4.32 cm).
        bins: rings along range, even.
    """

    max_range_m: float
    min_range_m: float = 2.5
    bins: int = 512

    def __post_init__(self) -> None:
        if self.bins % 2 or not 2 <= self.bins <= 8192:
            raise ConfigError(f'rad_vlad: bins: expected an even number from 2 to 8192, got {self.bins}')
        if not 0.0 <= self.min_range_m < self.max_range_m <= 10_000.0:
            raise ConfigError(
                f'rad_vlad: expected 0 <= min_range_m < max_range_m <= 10000, got {self.min_range_m} and '
                f'{self.max_range_m}'
            )

    @property
    def features(self) -> int:
        """F, the length of a row's descriptor."""
        return self.bins // 2 + 1

    @property
    def weights(self) -> NDArray[np.float64]:
        """(F,) 1 or √2: the square root of how often a magnitude occurs in the full spectrum."""
        weights = np.full(self.features, 2.0**0.5)
        weights[[0, -1]] = 1.0
        return weights


def spectrum_rows(scan: PolarScan, settings: RowSettings) -> NDArray[np.float64]:
    """(A, F) unit spectra of the azimuths that hold power; RefusedInput ``no_signal`` if none does.

    A roll of the scan's rows is a roll of the spectra.
    """
    if not scan.power.size:
        raise RefusedInput('no_signal', f'scan at {scan.stamp_ns} ns is empty: shape {scan.power.shape}')
    power = ring_power(scan, settings.bins, settings.max_range_m, settings.min_range_m)
    spectra = np.abs(np.fft.rfft(power, axis=1)) * settings.weights
    norms = np.sqrt((spectra * spectra).sum(axis=1))
    powered = norms > 0.0
    if not powered.any():
        raise RefusedInput(
            'no_signal',
            f'scan at {scan.stamp_ns} ns holds no power between {settings.min_range_m:g} m and '
            f'{settings.max_range_m:g} m',
        )
    rows: NDArray[np.float64] = np.rint(spectra[powered] / (norms[powered, np.newaxis] * _PART)) * _PART
    return rows
