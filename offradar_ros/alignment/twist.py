"""The velocity of a vehicle during a sweep."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

FASTEST = 100.0
"""No road vehicle moves faster, in m/s and rad/s."""
_STRAIGHT_RAD = 1e-6


@dataclasses.dataclass(frozen=True)
class Twist:
    """Velocity of a vehicle in its own frame (REP 103): metres a second forward and to the left, radians a second."""

    forward_mps: float = 0.0
    left_mps: float = 0.0
    yaw_radps: float = 0.0

    @classmethod
    def between(cls, pose: NDArray[np.float64], seconds: float) -> Twist:
        """The constant velocity that leads to (3,) `pose`, x, y in m and yaw in rad of the start's frame, in that time.

        The logarithm of SE(2), over the time. With θ the yaw, ``v = A t`` where ``A`` has θ/2 · cot(θ/2) on its
        diagonal, and ±θ/2 beside it.
        """
        x_m, y_m, yaw_rad = pose.tolist()
        half = yaw_rad / 2.0
        along = half / math.tan(half) if abs(half) > _STRAIGHT_RAD else 1.0
        return cls((along * x_m + half * y_m) / seconds, (along * y_m - half * x_m) / seconds, yaw_rad / seconds)

    def pose_after(self, seconds: float) -> NDArray[np.float64]:
        """(3,) float64 the pose that this velocity leads to: the inverse of `between`."""
        yaw_rad = self.yaw_radps * seconds
        sin, cos = math.sin(yaw_rad), math.cos(yaw_rad)
        if abs(yaw_rad) > _STRAIGHT_RAD:
            along, across = sin / yaw_rad, (1.0 - cos) / yaw_rad
        else:
            along, across = 1.0, yaw_rad / 2.0
        x_m, y_m = self.forward_mps * seconds, self.left_mps * seconds
        return np.array([along * x_m - across * y_m, across * x_m + along * y_m, yaw_rad])


STANDING = Twist()
