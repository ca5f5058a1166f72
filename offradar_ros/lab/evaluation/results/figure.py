"""One figure with its interval."""

from __future__ import annotations

import dataclasses

from offradar_ros.records import Measure


@dataclasses.dataclass(frozen=True)
class Interval:
    """A figure with a 95 % bootstrap interval over ordered pairs of drives; NaN if it could not be measured.

    Attributes:
        value: over the queries of all pairs together, on one scale of U.
        low: lower end of the interval, NaN for a single pair.
        high: upper end of the interval.
    """

    value: Measure
    low: Measure
    high: Measure


@dataclasses.dataclass(frozen=True)
class Figure(Interval):
    """A figure that is also averaged over pairs: `pairs` is the mean of the figure of each pair."""

    pairs: Measure
