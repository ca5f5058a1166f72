"""Profiles of a city's streets: an avenue, which is a row or column of the grid, has one kind from end to end."""

from __future__ import annotations

import numpy as np

from offradar_ros.lab.simulation.streets import Edge, Profile, StreetKind

_SHARES = {
    StreetKind.NARROW: 0.2,
    StreetKind.ORDINARY: 0.5,
    StreetKind.BOULEVARD: 0.2,
    StreetKind.OPEN_ROAD: 0.1,
}
_HALF_WIDTHS_M = {
    StreetKind.NARROW: (4.0, 5.0),
    StreetKind.ORDINARY: (6.0, 9.0),
    StreetKind.BOULEVARD: (10.0, 20.0),
    StreetKind.OPEN_ROAD: (7.0, 13.0),
}
_WITH_MEDIAN = {StreetKind.BOULEVARD: 0.5, StreetKind.OPEN_ROAD: 0.4}
_MEDIAN_M = (0.7, 2.2)
_CARRIAGEWAY_M = 9.0
"""A street has no median if that would leave less than this on each side."""

_EQUAL = 0.6
"""Share of the avenues of a regular grid that are equal."""

_MAX_SHARE = 0.18
"""Half widths are limited to this share of the mean distance between streets."""


def draw_profiles(
    rng: np.random.Generator, edges: list[Edge], rows: int, block_m: float, regular: bool
) -> dict[Edge, Profile]:
    """The profile of each street of a grid of `rows` nodes a column.

    Ordinary streets vary from crossing to crossing, unless the grid is `regular`: there most avenues are equal.
    """
    equal = Profile(StreetKind.ORDINARY, float(rng.uniform(*_HALF_WIDTHS_M[StreetKind.ORDINARY])))
    avenues: dict[tuple[bool, int], Profile] = {}
    profiles = {}
    for a, b in edges:
        along_row = b - a >= rows
        avenue = (along_row, a % rows if along_row else a // rows)
        profile = avenues.get(avenue)
        if profile is None:
            profile = avenues[avenue] = equal if regular and rng.random() < _EQUAL else _drawn(rng, block_m)
        if profile.kind is StreetKind.ORDINARY and not regular:
            profile = Profile(profile.kind, float(rng.uniform(*_HALF_WIDTHS_M[profile.kind])))
        profiles[a, b] = profile
    return profiles


def _drawn(rng: np.random.Generator, block_m: float) -> Profile:
    kind = list(_SHARES)[int(rng.choice(len(_SHARES), p=list(_SHARES.values())))]
    half_m = min(float(rng.uniform(*_HALF_WIDTHS_M[kind])), _MAX_SHARE * block_m)
    median_m = float(rng.uniform(*_MEDIAN_M))
    if rng.random() < _WITH_MEDIAN.get(kind, 0.0) and half_m - median_m >= _CARRIAGEWAY_M:
        return Profile(kind, half_m, median_m)
    return Profile(kind, half_m)
