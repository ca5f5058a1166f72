"""The pose of a query in the frame of a place's scan."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from offradar_ros.alignment.coarse import REACH_M, Spectra, rough_poses, spectra
from offradar_ros.alignment.refine import Edges, Surface, edges, refine, surface
from offradar_ros.alignment.signature import Signature
from offradar_ros.alignment.top_down import half, top_down
from offradar_ros.alignment.twist import STANDING, Twist
from offradar_ros.errors import RefusedInput
from offradar_ros.types import Alignment

_COARSE_PIXELS, _FINE_PIXELS = 1200, 3000
_COARSE_STEPS, _FINE_STEPS = 4, 5
_SPREAD = 4.0
"""Variance of a pose over that of independent pixels: neighbouring pixels differ alike, and what stood there changes.

Fitted on simulated cities (docs/alignment.md), so that 95 % ellipses hold 95 % of the true poses.
"""
_FLOOR = np.diag([0.02**2, 0.02**2, 0.0016**2])
"""No pose is known better, in m² and rad²: stamps, the mounting of the sensor, the levels of a signature."""
_UNKNOWN = np.diag([REACH_M**2, REACH_M**2, math.pi**2])


@dataclasses.dataclass(frozen=True, eq=False)
class PreparedPlace:
    """The scan of a place, ready for queries to be aligned with it; `seen_share` is that of its sectors."""

    spectra: Spectra
    coarse: Surface
    fine: Surface
    seen_share: float


@dataclasses.dataclass(frozen=True, eq=False)
class PreparedQuery:
    """The scan of a query, ready to be aligned with places; `seen_share` is that of its sectors."""

    spectra: Spectra
    coarse: Edges
    fine: Edges
    seen_share: float


def prepare_place(signature: Signature, twist: Twist = STANDING) -> PreparedPlace:
    """What an alignment needs of a place; `twist` is the velocity of its vehicle at the stamp."""
    fine = top_down(signature, twist)
    coarse = half(fine)
    return PreparedPlace(spectra(signature, coarse), surface(coarse), surface(fine), _seen_share(signature))


def prepare_query(signature: Signature, twist: Twist = STANDING) -> PreparedQuery:
    """What an alignment needs of a query; `twist` is the velocity of its vehicle at the stamp."""
    fine = top_down(signature, twist)
    coarse = half(fine)
    coarse_edges, fine_edges = edges(coarse, _COARSE_PIXELS), edges(fine, _FINE_PIXELS)
    return PreparedQuery(spectra(signature, coarse), coarse_edges, fine_edges, _seen_share(signature))


def _seen_share(signature: Signature) -> float:
    # Without any sector nothing agrees, whatever its variance.
    return max(float(signature.seen.mean()), 1.0 / len(signature.seen))


def align(place: PreparedPlace, query: PreparedQuery, expected: NDArray[np.float64] | None = None) -> Alignment:
    """The best pose of the query in the frame of the place: rough poses, each refined, and the best one again.

    With (3,) `expected`, x, y in m and yaw in rad, only that near it.

    Where the scans do not agree at all, with a score of 0 or less, the pose is that of the place, and its covariance
    that of no knowledge. RefusedInput (`unlike_signatures`) if the signatures were made with other settings.
    """
    if place.spectra.config != query.spectra.config:
        raise RefusedInput(
            'unlike_signatures',
            f'the signature of a place was made with {place.spectra.config}, that of the scan with '
            f'{query.spectra.config}: expected the same; not aligned',
        )
    starts = rough_poses(place.spectra, query.spectra) if expected is None else expected[None, :]
    rough = refine(place.coarse, query.coarse, starts, _COARSE_STEPS)
    best = int(np.argmax(rough.correlations))
    fine = refine(place.fine, query.fine, rough.poses[best : best + 1], _FINE_STEPS)
    score = float(fine.correlations[0])
    if score <= 0.0:
        return Alignment(np.zeros(3), _UNKNOWN.copy(), score)
    x_m, y_m, yaw_rad = fine.poses[0].tolist()
    pose = np.array([x_m, y_m, math.remainder(yaw_rad, 2.0 * math.pi)])
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    # Where sectors are missing, the pixels that are left lie at their edges.
    spread = _SPREAD / (place.seen_share * query.seen_share) ** 2
    return Alignment(pose, turn @ (spread * fine.covariances[0]) @ turn.T + _FLOOR, score)
