"""The pose of a query in the frame of a place's scan."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from offradar_ros.alignment.coarse import REACH_M, Spectra, rough_poses, spectra
from offradar_ros.alignment.refine import Edges, Surface, edges, refine, surface
from offradar_ros.alignment.signature import Signature
from offradar_ros.alignment.top_down import STANDING, Twist, half, top_down
from offradar_ros.errors import RefusedInput
from offradar_ros.types import Alignment

_COARSE_PIXELS, _FINE_PIXELS = 1200, 3000
_COARSE_STEPS, _FINE_STEPS = 2, 5


_SCALE, _FLOOR_RAD = 6.24, 0.0019
"""Pixels beside one another err alike, and the sweep of a moving radar bends its image: errors are larger than the
curvature of the correlation says. These hold 95 % of the errors in their ellipsoids over the simulated worlds of the
protocol `confidence` (benchmarks/alignment_covariance.py)."""
_UNKNOWN = np.diag([REACH_M**2, REACH_M**2, math.pi**2])


@dataclasses.dataclass(frozen=True, eq=False)
class PreparedPlace:
    """The scan of a place, ready for queries to be aligned with it."""

    spectra: Spectra
    coarse: Surface
    fine: Surface


@dataclasses.dataclass(frozen=True, eq=False)
class PreparedQuery:
    """The scan of a query, ready to be aligned with places."""

    spectra: Spectra
    coarse: Edges
    fine: Edges


def prepare_place(signature: Signature, twist: Twist = STANDING) -> PreparedPlace:
    """What an alignment needs of a place; `twist` is the velocity of its vehicle at the stamp."""
    fine = top_down(signature, twist)
    coarse = half(fine)
    return PreparedPlace(spectra(signature, coarse), surface(coarse), surface(fine))


def prepare_query(signature: Signature, twist: Twist = STANDING) -> PreparedQuery:
    """What an alignment needs of a query; `twist` is the velocity of its vehicle at the stamp."""
    fine = top_down(signature, twist)
    coarse = half(fine)
    return PreparedQuery(spectra(signature, coarse), edges(coarse, _COARSE_PIXELS), edges(fine, _FINE_PIXELS))


def align(place: PreparedPlace, query: PreparedQuery) -> Alignment:
    """The best pose of the query in the frame of the place: rough poses, each refined, and the best one again.

    Where the scans do not agree at all, with a score of 0 or less, the pose is that of the place, and its covariance
    that of no knowledge. RefusedInput (`unlike_signatures`) if the signatures were made with other settings.
    """
    if place.spectra.config != query.spectra.config:
        raise RefusedInput(
            'unlike_signatures',
            f'the signature of a place was made with {place.spectra.config}, that of the scan with '
            f'{query.spectra.config}: expected the same; not aligned',
        )
    rough = refine(place.coarse, query.coarse, rough_poses(place.spectra, query.spectra), _COARSE_STEPS)
    best = int(np.argmax(rough.correlations))
    fine = refine(place.fine, query.fine, rough.poses[best : best + 1], _FINE_STEPS)
    score = float(fine.correlations[0])
    if score <= 0.0:
        return Alignment(np.zeros(3), _UNKNOWN.copy(), score)
    x_m, y_m, yaw_rad = fine.poses[0].tolist()
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    covariance = _SCALE**2 * turn @ fine.covariances[0] @ turn.T
    covariance[2, 2] += _FLOOR_RAD**2
    pose = np.array([x_m, y_m, math.remainder(yaw_rad, 2.0 * math.pi)])
    return Alignment(pose, covariance, score)
