"""Rain, snow and fog between the radar and reflectors, at 77 GHz.

One-way attenuation in dB/km:

* rain: 1.132 R^0.718 (R mm/h), Recommendation ITU-R P.838-3, horizontal polarisation at 77 GHz.
* snow: 0.474 S^1.67 (S mm/h of melted water), and
* fog: 3.15 g, g = (0.024 / V)^(1/0.65) grams of water per cubic metre at a visibility of V km: the Rayleigh coefficient
  of Recommendation ITU-R P.840 for water at 10 °C, and Kunkel's (1984) relation of visibility and water content.

Volume backscatter η in m²/m³: rain 1.15e-4 R^0.718, snow 1.36e-5 S^0.793; that of fog is zero.

Snow and both backscatters are fits to Mie sums: drops of Marshall and Palmer's (1948) sizes, flakes of Gunn and
Marshall's (1958) sizes as spheres of 0.2 g/cm³; the same sum for rain is within 27 % of P.838-3.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_POWER_OF_A_SQUARE_METRE = 10.0**4.5
"""Return of a radar cross-section of 1 m² at 10 m: poles, of 1 to 20 m², have 44 to 58 dB."""

_CELL_M3 = math.pi / 4.0 * 0.0314 * 0.06 * 10.0**2 * 0.175
"""Volume of one range cell of the beam (1.8° wide, about 3.5° high) at 10 m."""


@dataclasses.dataclass(frozen=True)
class Weather:
    """Weather during one drive; the default is clear air.

    Attributes:
        rain_mm_h: 0 to 150; 2.5 is moderate, 10 heavy, 50 violent.
        snow_mm_h: 0 to 10, as melted water; 2.5 is heavy.
        fog_visibility_m: infinite without fog, 50 in the thickest.
    """

    rain_mm_h: float = 0.0
    snow_mm_h: float = 0.0
    fog_visibility_m: float = math.inf

    def attenuation_db_m(self) -> float:
        """One-way attenuation, decibels per metre."""
        rain: float = 1.132 * self.rain_mm_h**0.718
        snow: float = 0.474 * self.snow_mm_h**1.67
        water_g_m3: float = (24.0 / self.fog_visibility_m) ** (1.0 / 0.65)
        return (rain + snow + 3.15 * water_g_m3) / 1000.0

    def transmission(self, range_m: Array) -> Array:
        """Two-way transmission, of the shape of `range_m`."""
        return np.asarray(10.0 ** (-0.2 * self.attenuation_db_m() * range_m))

    def backscatter(self, range_m: Array) -> Array:
        """Power of the drops and flakes in the cells at `range_m`, with the receiver's noise at 1.

        The volume of a cell increases with range squared; the return of a drop falls with the fourth power of range.
        """
        eta = 1.15e-4 * self.rain_mm_h**0.718 + 1.36e-5 * self.snow_mm_h**0.793
        at_10_m = _POWER_OF_A_SQUARE_METRE * eta * _CELL_M3
        return np.asarray(at_10_m * (10.0 / np.maximum(range_m, 1.0)) ** 2 * self.transmission(range_m))


CLEAR = Weather()
