"""The pose of a query in the frame of a place's scan."""

from __future__ import annotations

import dataclasses

import numpy as np

from offradar_ros.alignment.coarse import Spectra, rough_poses, spectra
from offradar_ros.alignment.refine import Edges, Slopes, edges, refine, slopes
from offradar_ros.alignment.signature import Signature
from offradar_ros.alignment.top_down import STANDING, Twist, half, top_down
from offradar_ros.types import Alignment

MOST_YAWS = 8
REACH_M = 20.0
"""Farther away than this, a place is not aligned with."""
_COARSE_PIXELS, _FINE_PIXELS = 1200, 3000
_COARSE_STEPS, _FINE_STEPS = 8, 15


@dataclasses.dataclass(frozen=True, eq=False)
class PreparedPlace:
    """The scan of a place, ready for queries to be aligned with it."""

    spectra: Spectra
    coarse: Slopes
    fine: Slopes


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
    return PreparedPlace(spectra(signature, coarse), slopes(coarse), slopes(fine))


def prepare_query(signature: Signature, twist: Twist = STANDING) -> PreparedQuery:
    """What an alignment needs of a query; `twist` is the velocity of its vehicle at the stamp."""
    fine = top_down(signature, twist)
    coarse = half(fine)
    return PreparedQuery(spectra(signature, coarse), edges(coarse, _COARSE_PIXELS), edges(fine, _FINE_PIXELS))


def align(place: PreparedPlace, query: PreparedQuery) -> Alignment:
    """The best pose of the query in the frame of the place: rough poses, each refined, and the best one again."""
    rough = rough_poses(place.spectra, query.spectra, MOST_YAWS, REACH_M)
    coarse = [refine(place.coarse, query.coarse, pose, _COARSE_STEPS) for pose in rough]
    best = max(coarse, key=lambda refined: refined.correlation)
    fine = refine(place.fine, query.fine, best.pose, _FINE_STEPS)
    covariance = np.asarray(np.linalg.pinv(fine.information), np.float64)
    return Alignment(fine.pose, covariance, fine.correlation)
