"""What a belief decides on drives whose truth is known: the first right state, wrong states, and how late they end."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.types import Localisation, LocalisationState

TOLERANCE_M = 25.0
"""The vehicle is at a place if it is nearer to it than this."""
RIGHT_WITHIN_M = 10.0
"""A vehicle this near to a place is on the map."""
HELD_95 = -2.0 * math.log(0.05)
"""Squared errors, in units of their covariance, up to this are in the 95 % ellipse: χ² of two dimensions."""
LIMIT, GRACE_M = 5, 50.0
"""The targets: scans to ``on_map`` from a cold start, and distance within which a change is noticed."""


@dataclasses.dataclass(frozen=True)
class Seen:
    """One scan of a drive: the state, and the truth.

    Attributes:
        state: what the filter decided.
        error_m: distance from the vehicle to the position, or to the best place.
        nearest_m: distance from the vehicle to the nearest place of the map.
        usable: whether the scan had evidence.
        squared: the error of the position squared, in units of its covariance.
    """

    state: LocalisationState
    error_m: float
    nearest_m: float
    usable: bool
    squared: float = math.nan

    @classmethod
    def of(cls, found: Localisation, truth_m: NDArray[np.float64], nearest_m: float, usable: bool) -> Seen:
        """A scan at (2,) `truth_m` in the ``map`` frame."""
        error_m = found.position_m - truth_m
        squared = float(error_m @ np.linalg.solve(found.covariance_m2, error_m))
        return cls(found.state, float(np.hypot(*error_m)), nearest_m, usable, squared)

    def wrong(self) -> bool:
        """``on_map`` at another place, or ``off_map`` where a place is right."""
        if self.state is LocalisationState.ON_MAP:
            return self.error_m > TOLERANCE_M
        return self.state is LocalisationState.OFF_MAP and self.nearest_m <= RIGHT_WITHIN_M


def start_figures(drives: Sequence[Sequence[Seen]]) -> dict[str, float]:
    """Scans until the first ``on_map``, of drives that start on the map and stay on it; infinite if it never comes."""
    scans, usable, wrong = [], [], 0
    for seen in drives:
        first = next((i for i, scan in enumerate(seen) if scan.state is LocalisationState.ON_MAP), None)
        until = seen if first is None else seen[: first + 1]
        scans.append(np.inf if first is None else first + 1)
        usable.append(np.inf if first is None else sum(scan.usable for scan in until))
        wrong += first is not None and seen[first].wrong()
    return {
        'starts': len(drives),
        f'starts within {LIMIT} scans': float(np.mean(np.array(scans) <= LIMIT)),
        f'within {LIMIT} with evidence': float(np.mean(np.array(usable) <= LIMIT)),
        'median scans': float(np.median(scans)),
        '99 % scans': float(np.quantile(scans, 0.99, method='higher')),
        'first on_map wrong': wrong / max(len(drives), 1),
    }


def state_figures(drives: Sequence[Sequence[Seen]], step_m: float) -> dict[str, float]:
    """Wrong states of drives with a scan every `step_m`, and how far behind the last right place they are noticed."""
    tables = [_table(seen, step_m) for seen in drives]
    leavings_m = [left_m for table in tables for left_m in _leavings_m(table, step_m)]
    states, wrong, inside, outside, recent = (np.concatenate(columns) for columns in zip(*tables, strict=True))
    return {
        'wrong': float(np.mean(wrong)),
        'wrong on_map': float(np.mean(wrong & (states == 'on_map'))),
        f'wrong beyond {GRACE_M:g} m of a change': float(np.mean(wrong & ~recent)),
        'leavings': len(leavings_m),
        'noticed after, median m': float(np.quantile(leavings_m, 0.5, method='higher')) if leavings_m else np.nan,
        'most m': max(leavings_m, default=np.nan),
        'on_map where mapped': float(np.mean(states[inside] == 'on_map')),
        'off_map where not': float(np.mean(states[outside] == 'off_map')),
    }


def position_figures(drives: Sequence[Sequence[Seen]]) -> dict[str, float]:
    """Errors of the position while the state is rightly ``on_map``, and whether their covariance is true."""
    right = [scan for seen in drives for scan in seen if scan.state is LocalisationState.ON_MAP and not scan.wrong()]
    errors_m, squared = np.array([(scan.error_m, scan.squared) for scan in right]).T
    return {
        'error on the map, median m': float(np.median(errors_m)),
        '90 % m': float(np.quantile(errors_m, 0.9)),
        'in the 95 % ellipse': float(np.mean(squared <= HELD_95)),
    }


class _Table(NamedTuple):
    states: NDArray[np.str_]
    wrong: NDArray[np.bool_]
    inside: NDArray[np.bool_]
    outside: NDArray[np.bool_]
    recent: NDArray[np.bool_]


def _table(seen: Sequence[Seen], step_m: float) -> _Table:
    states = np.array([scan.state.value for scan in seen])
    wrong = np.array([scan.wrong() for scan in seen])
    inside = np.array([scan.nearest_m <= RIGHT_WITHIN_M for scan in seen])
    outside = np.array([scan.nearest_m > TOLERANCE_M for scan in seen])
    # Where the vehicle has entered or left the map a short distance ago, a delay is not yet wrong.
    recent = np.zeros(len(seen), np.bool_)
    for change in np.flatnonzero(inside[:-1] != inside[1:]) + 1:
        recent[change : change + round(GRACE_M / step_m)] = True
    return _Table(states, wrong, inside, outside, recent)


def _leavings_m(table: _Table, step_m: float) -> list[float]:
    """For each time that the vehicle leaves the map as ``on_map``: metres until the state ends, infinite if never."""
    left = np.flatnonzero(table.inside[:-1] & ~table.inside[1:]) + 1
    entered = np.flatnonzero(~table.inside[:-1] & table.inside[1:]) + 1
    found = []
    for end in left[table.states[left - 1] == 'on_map'].tolist():
        stretch = slice(end, next((start for start in entered.tolist() if start > end), len(table.states)))
        if table.outside[stretch].any():
            other = np.flatnonzero(table.states[stretch] != 'on_map')
            found.append((int(other[0]) + 1) * step_m if len(other) else np.inf)
    return found
