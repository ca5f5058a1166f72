"""The velocity of a radar at each scan, from nothing but the scan before."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from offradar_ros.alignment.align import PreparedPlace, PreparedQuery, align, prepare_both
from offradar_ros.alignment.signature import Signature
from offradar_ros.alignment.twist import FASTEST, Twist
from offradar_ros.types import Alignment

LONGEST_S = 1.0
"""The velocity may change too much in a longer time between two scans; it is held for as long, too."""
_SHORTEST_S = 0.05
_AGREEING = 0.2
"""Score below which two scans do not agree where the vehicle was expected, and it is looked for everywhere."""
_MOST_BENT_M = 0.25
"""Error of a velocity, as metres over half a turn, above which it is not used: it would bend the scan anew."""
_CHANGE_MPS, _CHANGE_RADPS = 0.5, 0.1
_CHANGE_MPS2, _CHANGE_RADPS2 = 6.0, 1.5
"""More than this, and this for each second, from one estimate to the next is an error of one of them."""


@dataclasses.dataclass(frozen=True, eq=False)
class _Before:
    """The scan before, how the vehicle seemed to move then, and what was trusted last."""

    stamp_ns: int
    place: PreparedPlace
    seemed: Twist | None
    trusted: Twist | None
    trusted_ns: int


class ScanOdometry:
    """Velocities of successive scans. A scan is aligned with the one before. Not thread-safe.

    Both are bent alike by the motion during their sweeps, which hardly changes their relative pose. A velocity is
    trusted unless it is far from the estimate before it. Where two scans do not agree, the last one that was trusted
    holds for `LONGEST_S`.
    """

    def __init__(self) -> None:
        self._before: _Before | None = None

    def twist(self, signature: Signature, stamp_ns: int) -> Twist | None:
        """The velocity at the next scan; None where it is unknown, as at the first one or after a gap.

        It is not looked for if nothing could be straightened with it, since the rows have no stamps.
        """
        if not signature.turn_s:
            self._before = None
            return None
        before, (place, query) = self._before, prepare_both(signature)
        if before is None or not _SHORTEST_S <= (stamp_ns - before.stamp_ns) / 1e9 <= LONGEST_S:
            self._before = _Before(stamp_ns, place, None, None, stamp_ns)
            return None
        seconds = (stamp_ns - before.stamp_ns) / 1e9
        found = _aligned(before, query, seconds)
        seemed = _velocity(found, signature, seconds)
        trusted, trusted_ns = before.trusted, before.trusted_ns
        if seemed:
            likely = before.seemed is None or _are_alike(seemed, before.seemed, seconds)
            trusted, trusted_ns = seemed if likely else None, stamp_ns
        elif (stamp_ns - trusted_ns) / 1e9 > LONGEST_S:
            trusted = None
        self._before = _Before(stamp_ns, place, seemed, trusted, trusted_ns)
        return trusted

    def restart(self) -> None:
        """The next scan is the first one of a recording."""
        self._before = None


def _aligned(before: _Before, query: PreparedQuery, seconds: float) -> Alignment:
    """Where the vehicle is expected, else wherever the scans agree best: far poses may look alike, and take longer."""
    if expected := before.seemed or before.trusted:
        found = align(before.place, query, expected.pose_after(seconds))
        if found.score >= _AGREEING:
            return found
    return align(before.place, query)


def _velocity(found: Alignment, signature: Signature, seconds: float) -> Twist | None:
    """The velocity that the alignment shows; None if the scans do not agree, or not precisely enough."""
    twist = Twist.between(found.pose, seconds)
    fastest = max(abs(value) for value in dataclasses.astuple(twist))
    sigma_m = math.sqrt(float(np.linalg.eigvalsh(found.covariance[:2, :2]).max()))
    bent_m = sigma_m / seconds * abs(signature.turn_s) / 2.0
    return twist if found.score >= _AGREEING and fastest <= FASTEST and bent_m <= _MOST_BENT_M else None


def _are_alike(one: Twist, other: Twist, seconds: float) -> bool:
    change_mps = math.hypot(one.forward_mps - other.forward_mps, one.left_mps - other.left_mps)
    change_radps = abs(one.yaw_radps - other.yaw_radps)
    return (
        change_mps <= _CHANGE_MPS + _CHANGE_MPS2 * seconds and change_radps <= _CHANGE_RADPS + _CHANGE_RADPS2 * seconds
    )
