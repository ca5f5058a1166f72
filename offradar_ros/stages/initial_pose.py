"""When a match tells a navigation stack where it is: once, whenever the vehicle has been found."""

from __future__ import annotations

import math

from offradar_ros.config import QueryConfig
from offradar_ros.retrieval.vehicle_pose import VehiclePose, vehicle_pose
from offradar_ros.types import Localisation, LocalisationState, Match, Outcome

_AWAY = (LocalisationState.LOST, LocalisationState.OFF_MAP)


class InitialPose:
    """Gives the first sound pose after a start, after the vehicle was lost or off the map, and after `ask`.

    AMCL and Nav2 start again from each pose that they are given: one with each scan would keep them from converging.
    """

    def __init__(self) -> None:
        self._is_wanted = True

    def ask(self) -> None:
        """Give the next sound pose, too."""
        self._is_wanted = True

    def pose(self, outcome: Outcome, localisation: Localisation | None, config: QueryConfig) -> VehiclePose | None:
        """The pose of this match, if it is to be given; the vehicle must be on the map, there, with a heading."""
        if localisation is None:
            return None
        if localisation.state in _AWAY:
            self._is_wanted = True
        if not self._is_wanted or localisation.state is not LocalisationState.ON_MAP or not isinstance(outcome, Match):
            return None
        found = vehicle_pose(outcome.candidates[0], config)
        x_m, y_m = localisation.position_m.tolist()
        if not found.has_heading or math.hypot(found.pose.x_m - x_m, found.pose.y_m - y_m) > config.tolerance_m:
            return None
        self._is_wanted = False
        return found
