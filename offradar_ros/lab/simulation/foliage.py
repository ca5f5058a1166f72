"""Vegetation by season.

A bare tree attenuates about 0.3 times as many decibels per metre as one in leaf: 0.75 against 2.5 dB/m were measured
through pecan trees at millimetre waves (quoted by Rappaport and Deng, ICC Workshops 2015, who measured at 73 GHz).
Volume backscatter is extinction times albedo: 0.3 times the extinction is 5 dB less. Limbs scatter a smaller part of
what they take than leaves do (branches with and without leaves at 10 GHz, Missouri S&T 1988); 2 dB are assumed.
"""

from __future__ import annotations

import dataclasses

from offradar_ros.lab.simulation.reflectors import Reflectors

_BARE_DB = -7.0
"""Returns of bare vegetation, against those in leaf."""

_BARE_ATTENUATION = 0.3
"""Its attenuation in decibels, as a share of that in leaf."""


def in_season(vegetation: Reflectors, foliage: float) -> Reflectors:
    """Vegetation, which is given in leaf, with a share of its leaves: 0 bare, 1 unchanged."""
    bare = 1.0 - foliage
    gain = 10.0 ** (_BARE_DB * bare / 10.0)
    return dataclasses.replace(
        vegetation,
        wall_powers=vegetation.wall_powers * gain,
        wall_transmission=vegetation.wall_transmission ** (1.0 - (1.0 - _BARE_ATTENUATION) * bare),
        scatterer_powers=vegetation.scatterer_powers * gain,
    )
