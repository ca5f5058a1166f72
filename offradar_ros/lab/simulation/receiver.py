"""From the power of returns to recorded bytes: antenna and receiver.

The beam and the range response spread returns over azimuths and cells. The strongest return of an azimuth raises the
noise at all its ranges. Noise and speckle are squared magnitudes of complex Gaussian fields, correlated between
neighbouring cells. The byte is the logarithm of power in half decibels.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.fields import RangeFields, interpolated
from offradar_ros.lab.simulation.physics import RadarPhysics, SpeckleLaw, linear_power

Image = NDArray[np.float32]

_HALF_DECIBELS = np.float32(20.0 / math.log(10.0))
_WEIBULL = 1.4
"""Exponent that turns exponentially distributed power into a Weibull distribution of shape 0.7; looks are not used."""

_BINS_PER_BLOCK = 2**17
"""Bins that are recorded at a time: few enough for the processor's cache."""


class Receiver:
    """For `azimuths` × `cells` of `cell_m` metres, recorded as `bins` range bins, `bins_per_cell` for each cell."""

    def __init__(
        self, azimuths: int, cells: int, cell_m: float, bins_per_cell: int, bins: int, physics: RadarPhysics
    ) -> None:
        self._shape, self._bins_per_cell, self._bins, self._physics = (azimuths, cells), bins_per_cell, bins, physics
        row_rad = 2.0 * np.pi / azimuths
        # The beam acts twice, on transmission and on reception.
        beam = physics.beam_width_rad / 2.355 / math.sqrt(2.0)
        self._beam = _lobe(beam / row_rad, physics.side_lobe_width_rad / row_rad, physics.side_lobe_db)
        self._range_response = _lobe(physics.range_sigma_m / cell_m, physics.skirt_m / cell_m, physics.skirt_db)
        self._noise_fields = RangeFields(cells, bins_per_cell, physics.noise_correlation_m / cell_m)
        self._speckle_fields = RangeFields(cells, bins_per_cell, physics.speckle_correlation_m / cell_m)
        ranges_m = np.maximum((np.arange(cells) + 0.5) * cell_m, 1.0)
        near = (physics.noise_near_m / ranges_m) ** physics.noise_near_exponent
        haze = linear_power(physics.haze_db) * np.exp(-ranges_m / physics.haze_m)
        self._noise: Image = (linear_power(physics.noise_db) * (1.0 + near + haze)).astype(np.float32)

    def spread(self, power: Image) -> Image:
        """(A, C) power after the beam and the range response; azimuths wrap around."""
        margin = len(self._beam) // 2
        wrapped = np.pad(power, ((margin, margin), (0, 0)), mode='wrap')
        spread = cv2.sepFilter2D(wrapped, cv2.CV_32F, self._range_response, self._beam, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(spread[margin : margin + len(power)], np.float32)

    def noise_with_streaks(self, signal: Image, factor: float = 1.0) -> Image:
        """(A, C) mean power of noise, `factor` times as strong; azimuths with a strong return have more."""
        strongest: Image = signal.max(axis=1, keepdims=True)
        streaks = np.float32(linear_power(self._physics.streak_db)) * strongest
        return np.asarray(np.float32(factor) * self._noise + streaks, np.float32)

    def recorded(self, signal: Image, noise: Image, rng: np.random.Generator, gain: float = 1.0) -> NDArray[np.uint8]:
        """(A, bins) uint8 from (A, C) mean powers of signal and noise; `gain` is beside that of the physics."""
        azimuths, cells = self._shape
        white = rng.standard_normal((2, azimuths, cells), np.float32)
        # Speckle uses the fields of the noise, shifted by half a rotation and a third of the range, where they are
        # independent of it. Neighbouring azimuths are correlated, because their beams overlap.
        shifted = np.roll(white, (azimuths // 2, cells // 3), axis=(1, 2))
        shifted += np.roll(shifted, 1, axis=1)
        shifted *= np.float32(math.sqrt(0.5))
        texture = rng.standard_gamma(1.5, self._shape, np.float32) if self._physics.speckle is SpeckleLaw.K else None
        recorded = np.empty((azimuths, self._bins), np.uint8)
        step = max(1, _BINS_PER_BLOCK // self._bins)
        for start in range(0, azimuths, step):
            rows = slice(start, start + step)
            power = interpolated(noise[rows], self._bins_per_cell) * self._noise_power(white[:, rows])
            speckle = self._speckle(shifted[:, rows])
            if texture is not None:
                speckle *= interpolated(texture[rows] / np.float32(1.5), self._bins_per_cell)
            speckle *= interpolated(signal[rows], self._bins_per_cell)
            power += speckle
            recorded[rows] = self._bytes(power[:, : self._bins], gain)
        return recorded

    def _noise_power(self, white: Image) -> Image:
        power = self._noise_fields.power((white[0], white[1]))
        return _weibull(power, self._physics.noise_shape)

    def _speckle(self, white: Image) -> Image:
        """(A, bins) of mean 1, and of variance 1 / looks but for Weibull's law."""
        looks = self._physics.speckle_looks
        if self._physics.speckle is SpeckleLaw.LOG_NORMAL:
            variance = math.log1p(1.0 / looks)
            field = self._speckle_fields.smooth(white[0])
            return np.asarray(np.exp(np.float32(math.sqrt(variance)) * field - np.float32(variance / 2)), np.float32)
        if self._physics.speckle is SpeckleLaw.WEIBULL:
            return _weibull(self._speckle_fields.power((white[0], white[1])), _WEIBULL)
        # The sum of a constant and an exponentially distributed part.
        share = np.float32(1.0 / math.sqrt(looks))
        power = self._speckle_fields.power((white[0], white[1]))
        power *= share
        power += np.float32(1.0) - share
        return power

    def _bytes(self, power: Image, gain: float) -> NDArray[np.uint8]:
        """Half decibels of linear power, softly saturated; `power` is overwritten."""
        power *= np.float32(gain * linear_power(self._physics.gain_db))
        if self._physics.integer_powers:
            np.floor(power, out=power)
        level = np.log1p(power, out=power)
        level *= _HALF_DECIBELS
        knee, headroom = self._physics.knee, self._physics.ceiling - self._physics.knee
        over = level > knee
        if over.any():
            level[over] = knee + headroom * -np.expm1((knee - level[over]) / headroom)
        # Levels are neither negative nor above the ceiling, which is below 255.
        level += np.float32(0.5)
        return level.astype(np.uint8)


def _weibull(power: Image, exponent: float) -> Image:
    """Exponentially distributed power of mean 1 to an exponent, of mean 1 again; `power` is overwritten."""
    if exponent != 1.0:
        np.power(power, np.float32(exponent), out=power)
        power *= np.float32(1.0 / math.gamma(1.0 + exponent))
    return power


def _lobe(sigma: float, skirt_sigma: float, skirt_db: float) -> Image:
    """(K,) Gaussian of standard deviation `sigma` steps plus a wider, lower one; normalised to sum 1."""
    reach = int(np.ceil(max(2.5 * skirt_sigma, 3.0 * sigma)))
    steps = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (steps / sigma) ** 2) + linear_power(skirt_db) * np.exp(-0.5 * (steps / skirt_sigma) ** 2)
    return np.asarray(weights / weights.sum(), np.float32)
