"""The measures of a district: for each kind there are ranges from which each district's measures are drawn."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from offradar_ros.lab.simulation.city.plan import District

Range = tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Style:
    """The measures of one district. A `Range` holds the limits of values that are drawn per building.

    Lengths are in metres, powers in decibels.

    Attributes:
        kind: kind of the district.
        angle_rad: orientation of buildings away from streets.
        built: share of the plots along streets that have a building.
        width_m, depth_m: size of a building.
        setback_m: distance from the kerb to the front; `uneven_m` is its standard deviation from plot to plot.
        gap_m: gap between plots, for the share `gaps` of them.
        wall_db: power of a wall at normal incidence.
        bays: share of the bays of a front that are recessed; balconies: share that have one.
        hedges, fences, rails: share of the plots (rails: of the streets) with one along the kerb.
        trees: mean number per 20 m of plots; poles_m: distance between poles on the kerb; pole_db: their power.
        parking: share of the kerbs where cars park.
        car_parks: share of the plots that are car parks.
        infill_ha, groves_ha, yards_ha, car_parks_ha: buildings, groups of trees, yards of metal objects, and car parks
            away from streets, per hectare.
        template: seed of the one building that an estate repeats at equal distances; None where buildings differ.
    """

    kind: District
    angle_rad: float
    built: float
    width_m: Range
    depth_m: Range
    setback_m: float
    uneven_m: float
    gaps: float
    gap_m: Range
    wall_db: Range
    bays: float
    balconies: float
    hedges: float
    fences: float
    rails: float
    trees: float
    poles_m: float
    pole_db: float
    parking: float
    infill_ha: float
    groves_ha: float
    yards_ha: float
    car_parks: float
    car_parks_ha: float
    template: int | None = None


# Numbers are drawn between two limits. Ranges are drawn by their middle and their width, each between two limits.
_NUMBERS: dict[District, dict[str, Range]] = {
    District.DENSE: {
        'built': (0.85, 1.0), 'setback_m': (1.5, 5.0), 'uneven_m': (0.1, 1.2), 'gaps': (0.05, 0.3), 'bays': (0.1, 0.6),
        'balconies': (0.0, 0.5), 'hedges': (0.0, 0.1), 'fences': (0.0, 0.15), 'rails': (0.0, 0.15), 'trees': (0.0, 0.8),
        'poles_m': (14.0, 32.0), 'pole_db': (44.0, 56.0), 'parking': (0.4, 1.0), 'infill_ha': (3.0, 9.0),
        'groves_ha': (0.0, 1.0), 'yards_ha': (0.0, 0.5),
        'car_parks': (0.00, 0.05), 'car_parks_ha': (0.0, 0.4),
    },
    District.SUBURB: {
        'built': (0.6, 0.95), 'setback_m': (4.0, 10.0), 'uneven_m': (0.5, 2.0), 'gaps': (0.9, 1.0), 'bays': (0.0, 0.3),
        'balconies': (0.0, 0.2), 'hedges': (0.2, 0.7), 'fences': (0.1, 0.5), 'rails': (0.0, 0.05), 'trees': (0.4, 2.0),
        'poles_m': (25.0, 45.0), 'pole_db': (40.0, 52.0), 'parking': (0.1, 0.6), 'infill_ha': (3.0, 8.0),
        'groves_ha': (1.0, 5.0), 'yards_ha': (0.0, 0.0),
        'car_parks': (0.00, 0.04), 'car_parks_ha': (0.0, 0.2),
    },
    District.PARK: {
        'built': (0.0, 0.08), 'setback_m': (6.0, 15.0), 'uneven_m': (1.0, 4.0), 'gaps': (0.8, 1.0), 'bays': (0.0, 0.3),
        'balconies': (0.0, 0.1), 'hedges': (0.05, 0.4), 'fences': (0.0, 0.5), 'rails': (0.0, 0.05), 'trees': (0.2, 1.8),
        'poles_m': (35.0, 80.0), 'pole_db': (38.0, 50.0), 'parking': (0.0, 0.4), 'infill_ha': (0.0, 0.7),
        'groves_ha': (3.0, 12.0), 'yards_ha': (0.0, 0.0),
        'car_parks': (0.00, 0.05), 'car_parks_ha': (0.0, 0.1),
    },
    District.OPEN: {
        'built': (0.02, 0.2), 'setback_m': (10.0, 25.0), 'uneven_m': (2.0, 6.0), 'gaps': (1.0, 1.0), 'bays': (0.0, 0.3),
        'balconies': (0.0, 0.0), 'hedges': (0.0, 0.15), 'fences': (0.0, 0.2), 'rails': (0.2, 0.9), 'trees': (0.0, 0.4),
        'poles_m': (40.0, 70.0), 'pole_db': (44.0, 56.0), 'parking': (0.0, 0.05), 'infill_ha': (0.1, 0.8),
        'groves_ha': (0.2, 1.5), 'yards_ha': (0.0, 0.2),
        'car_parks': (0.00, 0.08), 'car_parks_ha': (0.0, 0.1),
    },
    District.INDUSTRIAL: {
        'built': (0.5, 0.9), 'setback_m': (4.0, 14.0), 'uneven_m': (0.5, 5.0), 'gaps': (0.5, 1.0), 'bays': (0.0, 0.25),
        'balconies': (0.0, 0.02), 'hedges': (0.0, 0.1), 'fences': (0.3, 0.9), 'rails': (0.0, 0.2), 'trees': (0.0, 0.3),
        'poles_m': (25.0, 50.0), 'pole_db': (48.0, 60.0), 'parking': (0.0, 0.4), 'infill_ha': (0.5, 2.0),
        'groves_ha': (0.0, 0.4), 'yards_ha': (1.0, 5.0),
        'car_parks': (0.02, 0.15), 'car_parks_ha': (0.1, 0.6),
    },
}  # fmt: skip
_MIDDLES: dict[District, dict[str, tuple[Range, Range]]] = {
    District.DENSE: {
        'width_m': ((9.0, 20.0), (4.0, 14.0)), 'depth_m': ((9.0, 14.0), (2.0, 6.0)), 'gap_m': ((2.0, 5.0), (1.0, 3.0)),
        'wall_db': ((52.0, 62.0), (3.0, 12.0)),
    },
    District.SUBURB: {
        'width_m': ((9.0, 14.0), (2.0, 6.0)), 'depth_m': ((8.0, 12.0), (2.0, 4.0)), 'gap_m': ((4.0, 12.0), (2.0, 6.0)),
        'wall_db': ((49.0, 58.0), (3.0, 10.0)),
    },
    District.PARK: {
        'width_m': ((6.0, 14.0), (2.0, 6.0)), 'depth_m': ((6.0, 10.0), (2.0, 4.0)), 'gap_m': ((5.0, 25.0), (4.0, 10.0)),
        'wall_db': ((48.0, 58.0), (3.0, 10.0)),
    },
    District.OPEN: {
        'width_m': ((8.0, 30.0), (4.0, 15.0)), 'depth_m': ((8.0, 20.0), (2.0, 8.0)),
        'gap_m': ((8.0, 25.0), (5.0, 15.0)),
        'wall_db': ((50.0, 62.0), (3.0, 12.0)),
    },
    District.INDUSTRIAL: {
        'width_m': ((25.0, 50.0), (10.0, 30.0)), 'depth_m': ((20.0, 35.0), (6.0, 20.0)),
        'gap_m': ((4.0, 18.0), (2.0, 8.0)), 'wall_db': ((57.0, 67.0), (3.0, 10.0)),
    },
}  # fmt: skip


ESTATES = (District.DENSE, District.SUBURB, District.INDUSTRIAL)
"""Kinds of districts of which some repeat one building: terraces and blocks of flats, houses, halls."""


def draw_style(rng: np.random.Generator, kind: District) -> Style:
    """The measures of one district of a kind."""
    drawn: dict[str, Any] = {name: float(rng.uniform(*bounds)) for name, bounds in _NUMBERS[kind].items()}
    drawn |= {name: _range(rng, *bounds) for name, bounds in _MIDDLES[kind].items()}
    return Style(kind=kind, angle_rad=float(rng.uniform(0.0, np.pi)), **drawn)


def as_estate(rng: np.random.Generator, style: Style) -> Style:
    """The district with one building at equal distances, as the same builder makes them, or a terrace without gaps."""
    gap = float(rng.uniform(*style.gap_m)) if style.kind is not District.DENSE or rng.random() < 0.5 else 0.0
    width, depth, decibels = (float(rng.uniform(*bounds)) for bounds in (style.width_m, style.depth_m, style.wall_db))
    return dataclasses.replace(
        style,
        built=1.0,
        car_parks=0.0,
        width_m=(width, width),
        depth_m=(depth, depth),
        wall_db=(decibels, decibels),
        uneven_m=0.0,
        gaps=1.0,
        gap_m=(gap, gap),
        template=int(rng.integers(2**31)),
    )


def _range(rng: np.random.Generator, middles: Range, widths: Range) -> Range:
    middle, half = float(rng.uniform(*middles)), float(rng.uniform(*widths)) / 2
    return max(middle - half, middle / 3), middle + half
