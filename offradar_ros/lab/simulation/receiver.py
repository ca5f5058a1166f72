"""What the antenna and the receiver make of the power that returns.

The antenna and the range window spread returns over azimuths and cells. The strongest return of an azimuth adds to the
noise of all its range. Noise and speckle are squared magnitudes of complex Gaussian fields, which neighbouring cells
share in part. The byte is the logarithm of power in half decibels.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.fields import RangeFields, interpolated
from offradar_ros.lab.simulation.physics import RadarPhysics, SpeckleLaw, ratio

Image = NDArray[np.float32]

_HALF_DECIBELS = np.float32(20.0 / math.log(10.0))
_AT_ONCE = 2**17
"""So many bins are recorded at a time: what is worked on then stays in the processor's cache."""


class Receiver:
    """For `azimuths` × `cells` of `cell_m` metres, recorded as `bins` of which `finer` make a cell."""

    def __init__(self, azimuths: int, cells: int, cell_m: float, finer: int, bins: int, physics: RadarPhysics) -> None:
        self._shape, self._finer, self._bins, self._physics = (azimuths, cells), finer, bins, physics
        row_rad = 2.0 * np.pi / azimuths
        # The beam acts there and back.
        beam = physics.beam_width_rad / 2.355 / math.sqrt(2.0)
        self._beam = _lobe(beam / row_rad, physics.side_lobe_width_rad / row_rad, physics.side_lobe_db)
        self._window = _lobe(physics.range_sigma_m / cell_m, physics.skirt_m / cell_m, physics.skirt_db)
        self._noise_fields = RangeFields(cells, finer, physics.noise_correlation_m / cell_m)
        self._speckle_fields = RangeFields(cells, finer, physics.speckle_correlation_m / cell_m)
        ranges_m = np.maximum((np.arange(cells) + 0.5) * cell_m, 1.0)
        near = (physics.noise_near_m / ranges_m) ** physics.noise_near_exponent
        self._noise: Image = (ratio(physics.noise_db) * (1.0 + near)).astype(np.float32)

    def spread(self, power: Image) -> Image:
        """(A, C) power as the beam and the window see it; azimuths go round."""
        margin = len(self._beam) // 2
        turned = np.pad(power, ((margin, margin), (0, 0)), mode='wrap')
        spread = cv2.sepFilter2D(turned, cv2.CV_32F, self._window, self._beam, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(spread[margin : margin + len(power)], np.float32)

    def noise_with_streaks(self, signal: Image) -> Image:
        """(A, C) mean power of noise, on azimuths with a strong return more of it."""
        strongest: Image = signal.max(axis=1, keepdims=True)
        return np.asarray(self._noise + np.float32(ratio(self._physics.streak_db)) * strongest, np.float32)

    def recorded(self, signal: Image, noise: Image, rng: np.random.Generator) -> NDArray[np.uint8]:
        """(A, bins) bytes from (A, C) mean powers."""
        azimuths, cells = self._shape
        white = rng.standard_normal((2, azimuths, cells), np.float32)
        # Speckle takes the noise's fields from half a rotation and a third of the range away, where they are strangers,
        # and is alike over neighbouring azimuths, as the beam overlaps them.
        away = np.roll(white, (azimuths // 2, cells // 3), axis=(1, 2))
        away += np.roll(away, 1, axis=1)
        away *= np.float32(math.sqrt(0.5))
        texture = rng.standard_gamma(1.5, self._shape, np.float32) if self._physics.speckle is SpeckleLaw.K else None
        recorded = np.empty((azimuths, self._bins), np.uint8)
        step = max(1, _AT_ONCE // self._bins)
        for start in range(0, azimuths, step):
            rows = slice(start, start + step)
            power = interpolated(noise[rows], self._finer) * self._noise_power(white[:, rows])
            speckle = self._speckle(away[:, rows])
            if texture is not None:
                speckle *= interpolated(texture[rows] / np.float32(1.5), self._finer)
            speckle *= interpolated(signal[rows], self._finer)
            power += speckle
            recorded[rows] = self._bytes(power[:, : self._bins])
        return recorded

    def _noise_power(self, white: Image) -> Image:
        power = self._noise_fields.power((white[0], white[1]))
        shape = self._physics.noise_shape
        if shape != 1.0:
            np.power(power, np.float32(shape), out=power)
            power *= np.float32(1.0 / math.gamma(1.0 + shape))
        return power

    def _speckle(self, white: Image) -> Image:
        """Mean 1 and variance 1 / looks."""
        looks = self._physics.speckle_looks
        if self._physics.speckle is SpeckleLaw.LOG_NORMAL:
            variance = math.log1p(1.0 / looks)
            field = self._speckle_fields.smooth(white[0])
            return np.asarray(np.exp(np.float32(math.sqrt(variance)) * field - np.float32(variance / 2)), np.float32)
        # A steady part beside an exponential one.
        share = np.float32(1.0 / math.sqrt(looks))
        power = self._speckle_fields.power((white[0], white[1]))
        power *= share
        power += np.float32(1.0) - share
        return power

    def _bytes(self, power: Image) -> NDArray[np.uint8]:
        """Half decibels of linear power, softly saturated; `power` is overwritten where it may be."""
        power *= np.float32(ratio(self._physics.gain_db))
        if self._physics.whole_powers:
            np.floor(power, out=power)
        level = np.log1p(power, out=power)
        level *= _HALF_DECIBELS
        knee, room = self._physics.knee, self._physics.ceiling - self._physics.knee
        over = level > knee
        if over.any():
            level[over] = knee + room * -np.expm1((knee - level[over]) / room)
        # Levels are neither negative nor above the ceiling, which is below 255.
        level += np.float32(0.5)
        return level.astype(np.uint8)


def _lobe(sigma: float, skirt_sigma: float, skirt_db: float) -> Image:
    """A lobe of standard deviation `sigma` steps on a wider, lower one; its sum is 1."""
    reach = int(np.ceil(max(2.5 * skirt_sigma, 3.0 * sigma)))
    steps = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (steps / sigma) ** 2) + ratio(skirt_db) * np.exp(-0.5 * (steps / skirt_sigma) ** 2)
    return np.asarray(weights / weights.sum(), np.float32)
