"""Where the vehicle is in the map, from the place that it was found at and the alignment with its scan."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import QueryConfig
from offradar_ros.types import Candidate, Pose


@dataclasses.dataclass(frozen=True, eq=False)
class VehiclePose:
    """A pose of the vehicle in the ``map`` frame.

    Attributes:
        pose: position, and yaw, NaN where it is unknown.
        covariance: (3, 3) float64 of x, y in m and yaw in rad; the variance of an unknown yaw is π², and nothing is
            correlated with it.
    """

    pose: Pose
    covariance: NDArray[np.float64]

    @property
    def has_heading(self) -> bool:
        """Whether the yaw is known."""
        return not math.isnan(self.pose.yaw_rad)


def vehicle_pose(candidate: Candidate, config: QueryConfig) -> VehiclePose:
    """The pose of the vehicle if it is at this place.

    With X and Ψ the position and heading of the place, t and ψ those of the vehicle in its frame, and R(Ψ) a rotation,

        x = X + R(Ψ) t,   yaw = Ψ + ψ,   Σ = J diag(σ², σ², σ_Ψ²) Jᵀ + G Σ_a Gᵀ

    where J and G are the derivatives by the pose of the place and by the alignment, whose covariance is Σ_a; σ is
    `query.place_sigma_m`, and σ_Ψ is that of the place's heading, or `query.place_sigma_deg` where the map does not
    have it. Without an alignment, or with one whose score is below
    `query.min_pose_score`, the vehicle is somewhere near the place: its position, with `query.position_sigma_m`. Where
    the place has no heading, t may point anywhere.
    """
    place, found = candidate.pose, candidate.alignment
    at_place = Pose(place.x_m, place.y_m, place.z_m)
    if found is None or found.score < config.min_pose_score:
        return VehiclePose(at_place, np.diag([config.position_sigma_m**2, config.position_sigma_m**2, math.pi**2]))
    variance = config.place_sigma_m**2
    forward_m, left_m, turned_rad = found.pose.tolist()
    if math.isnan(place.yaw_rad):
        away = (forward_m**2 + left_m**2 + float(np.trace(found.covariance[:2, :2]))) / 2.0
        return VehiclePose(at_place, np.diag([variance + away, variance + away, math.pi**2]))
    cos, sin = math.cos(place.yaw_rad), math.sin(place.yaw_rad)
    x_m, y_m = cos * forward_m - sin * left_m, sin * forward_m + cos * left_m
    by_place = np.array([[1.0, 0.0, -y_m], [0.0, 1.0, x_m], [0.0, 0.0, 1.0]])
    by_alignment = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    sd_rad = math.radians(config.place_sigma_deg) if math.isnan(place.yaw_sd_rad) else place.yaw_sd_rad
    of_place = np.diag([variance, variance, sd_rad**2])
    covariance = by_place @ of_place @ by_place.T + by_alignment @ found.covariance @ by_alignment.T
    yaw_rad = math.remainder(place.yaw_rad + turned_rad, 2.0 * math.pi)
    pose = Pose(place.x_m + x_m, place.y_m + y_m, place.z_m, yaw_rad)
    return VehiclePose(pose, (covariance + covariance.T) / 2.0)
