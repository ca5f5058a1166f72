"""The position of a belief, made exact by the alignment of the last scan where the two agree."""

from __future__ import annotations

import dataclasses

import numpy as np

from offradar_ros.retrieval.vehicle_pose import VehiclePose
from offradar_ros.types import Localisation

MOST_SQUARED = 9.21034037
"""The most that the two may be apart, squared and in units of the covariance of that: χ² of two dimensions, 99 %."""


def with_aligned_position(found: Localisation, aligned: VehiclePose) -> Localisation:
    """`found` with the mean of both positions, weighted by their covariances, if they agree; else unchanged.

    For the position x and covariance P of the belief, and those of the alignment, y and Q,

        K = P (P + Q)⁻¹,   x⁺ = x + K (y − x),   P⁺ = (1 − K) P,   if (y − x)ᵀ (P + Q)⁻¹ (y − x) is small enough

    An alignment that puts the vehicle elsewhere is one with another place, or a wrong one. The probabilities stay as
    they are: the scan has entered them as evidence.
    """
    if found.place_id is None:
        return found
    apart_m = np.array([aligned.pose.x_m, aligned.pose.y_m]) - found.position_m
    together = found.covariance_m2 + aligned.covariance[:2, :2]
    if float(apart_m @ np.linalg.solve(together, apart_m)) > MOST_SQUARED:
        return found
    gain = np.linalg.solve(together, found.covariance_m2).T
    covariance_m2 = found.covariance_m2 - gain @ found.covariance_m2
    return dataclasses.replace(
        found, position_m=found.position_m + gain @ apart_m, covariance_m2=(covariance_m2 + covariance_m2.T) / 2.0
    )
