"""Where the vehicle is after many scans: the evidence of each scan and the odometry in, a localisation out."""

from __future__ import annotations

import collections
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.belief.aligned_position import with_aligned_position
from offradar_ros.belief.odometry import Odometry
from offradar_ros.belief.place_belief import PlaceBelief
from offradar_ros.belief.place_evidence import log_likelihood_ratios
from offradar_ros.config import LocalisationConfig
from offradar_ros.retrieval.confidence import SimilarPlaces
from offradar_ros.retrieval.vehicle_pose import VehiclePose
from offradar_ros.types import Localisation, LocalisationState, Pose


class _Scan(NamedTuple):
    stamp_ns: int
    similar: SimilarPlaces | None
    travelled_m: float | None
    pose: VehiclePose | None


class Relocalisation(NamedTuple):
    """The answer of the last scans, without any before them.

    Attributes:
        localisation: None if there was no scan.
        detail: one line for people: the place and its probability, or why none is certain enough.
    """

    localisation: Localisation | None
    detail: str

    @property
    def found(self) -> bool:
        """Whether the place is certain enough."""
        return self.localisation is not None and self.localisation.state is LocalisationState.ON_MAP


class LocaliseStage:
    """The belief over the places of a map (docs/localisation.md), and the last scans. Not thread-safe."""

    def __init__(self, config: LocalisationConfig, tolerance_m: float) -> None:
        self.config = config
        self._belief = PlaceBelief(config, tolerance_m)
        self._odometry = Odometry(round(config.restart_after_s * 1e9))
        self._scans: collections.deque[_Scan] = collections.deque(maxlen=config.relocalise_scans)

    def set_places(self, positions_m: NDArray[np.float64], place_ids: NDArray[np.int64]) -> None:
        """As `PlaceBelief.set_places`; the ids ascend."""
        self._belief.set_places(positions_m, place_ids)

    def add_odometry(self, stamp_ns: int, pose: Pose) -> None:
        """Add a position of the vehicle; RefusedInput unless it is newer than the last one."""
        self._odometry.add(stamp_ns, pose)

    def add_scan(self, stamp_ns: int, similar: SimilarPlaces | None, pose: VehiclePose | None = None) -> Localisation:
        """Where the vehicle is after this scan; `similar` is None for a scan that says nothing.

        `pose` is that of the vehicle by an alignment, if it is at the place found; the position uses it if it agrees.

        RefusedInput (`repeated_stamp`, `stamp_backwards`): the scan is left out.
        """
        last = self._scans[-1] if self._scans else None
        travelled_m = None
        if last is not None and last.stamp_ns < stamp_ns:
            travelled_m = self._odometry.driven_m(last.stamp_ns, stamp_ns, self.config.max_speed_mps)
        scan = _Scan(stamp_ns, similar, travelled_m, pose)
        found = _step(self._belief, scan, self.config.recall)
        if last is not None and stamp_ns < last.stamp_ns:
            self._scans.clear()
        self._scans.append(scan)
        return found

    def relocalise(self) -> Relocalisation:
        """Where the last `relocalise_scans` scans are, if nothing is known of the vehicle before them."""
        belief = self._belief.without_memory()
        found = None
        for scan in self._scans:
            found = _step(belief, scan, self.config.recall)
        if found is None:
            return Relocalisation(None, 'no scan has been received')
        used = sum(scan.similar is not None for scan in self._scans)
        return Relocalisation(found, f'{_told(found)}, by the last {len(self._scans)} scans, {used} of them usable')


def _step(belief: PlaceBelief, scan: _Scan, recall: float) -> Localisation:
    ratios = None
    if scan.similar is not None:
        ratios = log_likelihood_ratios(scan.similar, belief.place_ids, belief.shares, recall)
    found = belief.step(scan.stamp_ns, ratios, scan.travelled_m)
    return found if scan.pose is None else with_aligned_position(found, scan.pose)


def _told(found: Localisation) -> str:
    if found.place_id is None:
        return 'the map is empty'
    x_m, y_m = found.position_m.tolist()
    place = f'place {found.place_id} at ({x_m:.1f}, {y_m:.1f}) m with probability {found.p_here:.4f}'
    if found.state is LocalisationState.ON_MAP:
        return place
    return f'{found.state.value}: off the map with probability {1.0 - found.p_on_map:.4f}, {place}'
