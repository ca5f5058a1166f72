"""What the cache is filled from: drives, each with its poses in the frame of its world."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from offradar_ros.sequence import RadarSequence


class OpenDrive(NamedTuple):
    """A drive's scans and what is known of each; N scans are taken of the sequence's.

    Attributes:
        sequence: where the scans are from.
        indices: (N,) which of its scans are taken, increasing.
        poses: (N, 3) float64 x, y in metres of the world's frame, and heading in radians (NaN where unknown).
        kinds: N names of what is wrong with a scan; empty for a clean one, and where nothing is known.
        severities: (N,) float32 how badly, 0 for a clean scan to 1, NaN where nothing is known.
    """

    sequence: RadarSequence
    indices: NDArray[np.intp]
    poses: NDArray[np.float64]
    kinds: tuple[str, ...]
    severities: NDArray[np.float32]


class Drive(Protocol):
    """A frozen dataclass of plain values that say everything about a drive: it is hashed, and sent to processes."""

    @property
    def name(self) -> str:
        """What to call its files."""

    @property
    def world(self) -> str:
        """The coordinate frame of its poses: drives of one world share it, those of two are never near each other."""

    def open(self) -> OpenDrive:
        """The scans; DataError where they cannot be read."""
