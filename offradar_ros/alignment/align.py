"""The pose of a query in the frame of a place's scan."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.alignment.coarse import REACH_M, Spectra, rough_poses, spectra
from offradar_ros.alignment.refine import agreement, correlations, edges, refine, surface
from offradar_ros.alignment.signature import Signature
from offradar_ros.alignment.top_down import TopDown, half, top_down
from offradar_ros.alignment.twist import STANDING, Twist
from offradar_ros.errors import RefusedInput
from offradar_ros.types import Alignment

Array = NDArray[np.float64]

_COARSE_PIXELS, _FINE_PIXELS = 1200, 3000
_COARSE_STEPS, _FINE_STEPS = 4, 5
_SPREAD = 23.3
"""Variance of a pose over that of independent pixels: neighbouring pixels differ alike, and what stood there changes.

Fitted to the simulated worlds of the protocol `confidence` (benchmarks/alignment_covariance.py), so that 95 % of the
errors lie in their ellipsoids.
"""
_FLOOR = np.diag([0.02**2, 0.02**2, 0.0016**2])
"""No pose is known better, in m² and rad²: stamps, the mounting of the sensor, the levels of a signature."""
_ELSEWHERE_M = 5.0
_ALIKE_FROM, _ALIKE = 0.85, 0.95
"""Where scans agree as well so far from the pose, in the direction in which it is known least, that direction is not
known at all, as between walls without end. What shows in every scan of a sensor, as its beam that widens and its power
that falls with range, makes the curvature there larger than it is. In ordinary streets it is 0.75 at most."""
_LEAST_SCORE = 1e-3
_UNKNOWN = np.diag([REACH_M**2, REACH_M**2, math.pi**2])


class _Prepared:
    """What places and queries have alike; the spectra, which only rough poses need, are made when they are first read.

    Attributes:
        signature: of the scan.
        view: the scan from above at the resolution of rough poses.
    """

    def __init__(self, signature: Signature, view: TopDown) -> None:
        self.signature, self.view = signature, view

    @functools.cached_property
    def spectra(self) -> Spectra:
        """For rough poses."""
        return spectra(self.signature, self.view)

    @property
    def seen_share(self) -> float:
        """Share of the sectors that the scan has; without any nothing agrees, whatever its variance."""
        return max(float(self.signature.seen.mean()), 1.0 / len(self.signature.seen))


class PreparedPlace(_Prepared):
    """The scan of a place, ready for queries to be aligned with it."""

    def __init__(self, signature: Signature, fine: TopDown, coarse: TopDown) -> None:
        super().__init__(signature, coarse)
        self.coarse, self.fine = surface(coarse), surface(fine)


class PreparedQuery(_Prepared):
    """The scan of a query, ready to be aligned with places."""

    def __init__(self, signature: Signature, fine: TopDown, coarse: TopDown) -> None:
        super().__init__(signature, coarse)
        self.coarse, self.fine = edges(coarse, _COARSE_PIXELS), edges(fine, _FINE_PIXELS)


def prepare_place(signature: Signature, twist: Twist = STANDING) -> PreparedPlace:
    """What an alignment needs of a place; `twist` is the velocity of its vehicle at the stamp."""
    fine = top_down(signature, twist)
    return PreparedPlace(signature, fine, half(fine))


def prepare_query(signature: Signature, twist: Twist = STANDING) -> PreparedQuery:
    """What an alignment needs of a query; `twist` is the velocity of its vehicle at the stamp."""
    fine = top_down(signature, twist)
    return PreparedQuery(signature, fine, half(fine))


def prepare_both(signature: Signature, twist: Twist = STANDING) -> tuple[PreparedPlace, PreparedQuery]:
    """`prepare_place` and `prepare_query` of one scan, which is seen from above once."""
    fine = top_down(signature, twist)
    coarse = half(fine)
    return PreparedPlace(signature, fine, coarse), PreparedQuery(signature, fine, coarse)


def align(place: PreparedPlace, query: PreparedQuery, expected: Array | None = None) -> Alignment:
    """The best pose of the query in the frame of the place: rough poses, each refined, and the best one again.

    With (3,) `expected`, x, y in m and yaw in rad, only that near it.

    Where the scans do not agree at all, with a score of 0 or less, the pose is that of the place, and its covariance
    that of no knowledge. RefusedInput as `require_alike`.
    """
    require_alike(place, query)
    starts = rough_poses(place.spectra, query.spectra) if expected is None else expected[None, :]
    return _refined([place], query, [starts])[0]


def align_each(places: Sequence[PreparedPlace], query: PreparedQuery) -> list[Alignment]:
    """`align` with each place, together, which takes less time than one after the other."""
    for place in places:
        require_alike(place, query)
    return _refined(places, query, [rough_poses(place.spectra, query.spectra) for place in places]) if places else []


def require_alike(place: PreparedPlace, query: PreparedQuery) -> None:
    """RefusedInput (`unlike_signatures`) if the signatures were made with other settings."""
    if place.signature.config != query.signature.config:
        raise RefusedInput(
            'unlike_signatures',
            f'the signature of a place was made with {place.signature.config}, that of the scan with '
            f'{query.signature.config}: expected the same; not aligned',
        )


def _refined(places: Sequence[PreparedPlace], query: PreparedQuery, starts: Sequence[Array]) -> list[Alignment]:
    """The best pose at each place, of those that are reached from (K, 3) `starts` of each."""
    of_each = [place for place, of_place in zip(places, starts, strict=True) for _ in of_place]
    rough = refine([place.coarse for place in of_each], query.coarse, np.concatenate(starts), _COARSE_STEPS)
    agreeing = agreement([place.fine for place in of_each], query.fine, rough.poses)
    ends = np.cumsum([len(of_place) for of_place in starts])[:-1]
    reached = zip(np.split(rough.poses, ends), np.split(agreeing, ends), strict=True)
    best = np.array([poses[np.argmax(scores)] for poses, scores in reached])
    fine = refine([place.fine for place in places], query.fine, best, _FINE_STEPS)
    spreads = [
        _covariance(pose, covariance, place.seen_share * query.seen_share)
        for place, pose, covariance in zip(places, fine.poses, fine.covariances, strict=True)
    ]
    spreads = _widened(places, query, fine.poses, spreads)
    scores = agreement([place.fine for place in places], query.fine, fine.poses)
    return [_alignment(*one) for one in zip(fine.poses, scores.tolist(), spreads, strict=True)]


def _covariance(pose: Array, covariance: Array, seen_share: float) -> Array:
    """(3, 3) of a refined pose, from that in the frame of the query: turned into that of the place, and scaled."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    # Where sectors are missing, the pixels that are left lie at their edges.
    spread = _SPREAD / seen_share**2
    return np.asarray(turn @ (spread * covariance) @ turn.T + _FLOOR, np.float64)


def _widened(
    places: Sequence[PreparedPlace], query: PreparedQuery, poses: Array, covariances: Sequence[Array]
) -> list[Array]:
    """The covariances, each as wide as the reach along a direction in which the scans agree as well elsewhere."""
    least_known = [np.append(np.linalg.eigh(covariance[:2, :2])[1][:, 1], 0.0) for covariance in covariances]
    surfaces = [place.coarse for place in places]
    away = _ELSEWHERE_M * np.array(least_known)
    found = correlations(surfaces * 3, query.coarse, np.concatenate([poses, poses + away, poses - away]))
    here, ahead, behind = np.split(found, 3)
    alike = np.maximum(ahead, behind) / np.maximum(here, _LEAST_SCORE)
    unknown = np.clip((alike - _ALIKE_FROM) / (_ALIKE - _ALIKE_FROM), 0.0, 1.0)
    return [
        covariance + share * (REACH_M / 2.0) ** 2 * np.outer(direction, direction)
        for covariance, direction, share in zip(covariances, least_known, unknown.tolist(), strict=True)
    ]


def _alignment(pose: Array, score: float, covariance: Array) -> Alignment:
    if score <= 0.0:
        return Alignment(np.zeros(3), _UNKNOWN.copy(), score)
    x_m, y_m, yaw_rad = pose.tolist()
    return Alignment(np.array([x_m, y_m, math.remainder(yaw_rad, 2.0 * math.pi)]), covariance, score)
