"""Parts of the mapped road that are left out of a map, so that queries there are off the map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.open_set import by_turns
from offradar_ros.errors import ConfigError
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.protocol import Protocol

WHOLE = 0
"""Number of the map of which nothing is left out; maps 1 and 2 complement each other."""


def maps_of(protocol: Protocol) -> tuple[int, ...]:
    """Numbers of the maps that are made of each drive."""
    return (1, 2) if protocol.leaves_out else (WHOLE,)


def stretch_m(protocol: Protocol, drive: Drive) -> float:
    """Length in metres of the stretches that are mapped and left out by turns; 0 if nothing is left out."""
    return _length_m(drive) / 2.0 if protocol.leave_out else protocol.leave_out_m


def require_left_out(protocol: Protocol, drive: Drive) -> None:
    """ConfigError if the drive is not longer than a stretch: one of its maps would be all that is left out."""
    if 0.0 < _length_m(drive) <= stretch_m(protocol, drive):
        raise ConfigError(
            f'leave_out_m: expected less than the path length of {drive.name}, {_length_m(drive):.0f} m, got '
            f'{protocol.leave_out_m:g} m'
        )


def _length_m(drive: Drive) -> float:
    return float(drive.driven_m[-1] - drive.driven_m[0])


def rows_in_map(drive: Drive, rows: NDArray[np.intp], number: int, stretch: float) -> NDArray[np.intp]:
    """Those of the (P,) rows of a drive that a map holds: of map 1 the 1st, 3rd, … stretch, of map 2 the others."""
    return rows if number == WHOLE else by_turns(drive.driven_m, rows, stretch)[number - 1]
