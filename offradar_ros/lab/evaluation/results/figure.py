"""One figure with its uncertainty."""

from __future__ import annotations

import dataclasses

from offradar_ros.records import Measure


@dataclasses.dataclass(frozen=True)
class Interval:
    """A figure with a 95 % bootstrap interval over ordered pairs of drives; NaN for what could not be measured.

    Attributes:
        value: over the scans of all pairs together, so that one scale of U serves them all.
        low: lower end of the interval, NaN for a single pair.
        high: upper end.
    """

    value: Measure
    low: Measure
    high: Measure


@dataclasses.dataclass(frozen=True)
class Figure(Interval):
    """A figure that is also averaged over pairs: `pairs` is the mean of the figure of each pair."""

    pairs: Measure
