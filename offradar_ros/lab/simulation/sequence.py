"""A simulated drive as a radar sequence."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.geometry import GeoPoint, LocalFrame, Trajectory, wrap_angle
from offradar_ros.lab.simulation.degradation import Degradation
from offradar_ros.lab.simulation.drift import Drift
from offradar_ros.lab.simulation.faults import draw_degradations
from offradar_ros.lab.simulation.radar_model import RadarModel
from offradar_ros.lab.simulation.sensor import SimulatedSensor
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.lab.simulation.traversal import Traversal
from offradar_ros.lab.simulation.world import World
from offradar_ros.types import PolarScan

ORIGIN = GeoPoint(51.7520, -1.2577, 60.0)
"""Default position of a world's origin."""

_POSITION_PERIOD_S = 0.1


class SimulatedSequence:
    """Scans rendered on demand, each from its own seed: the same at each call and in any order.

    A scan's stamp is the middle of its rotation. `layout` is ``simulation``.
    """

    layout = 'simulation'

    def __init__(
        self,
        world: World,
        plan: SessionPlan,
        sensor: SimulatedSensor | None = None,
        origin: GeoPoint = ORIGIN,
    ) -> None:
        self.plan = plan
        self.sensor = sensor or SimulatedSensor()
        self.name = plan.name
        self.degradations: tuple[Degradation | None, ...] = draw_degradations(plan)
        self._traversal = Traversal(plan, world, plan.scans * self.sensor.rotation_s)
        self._model = RadarModel(self.sensor, plan.physics, plan.weather, world.ground_seed)
        self._drift = Drift(plan.physics, self.sensor.azimuths, plan.seed)
        self._origin = origin
        period_ns = round(self.sensor.rotation_s * 1e9)
        self.stamps_ns: NDArray[np.int64] = plan.start_ns + period_ns // 2 + period_ns * np.arange(plan.scans)

    def __len__(self) -> int:
        return self.plan.scans

    def scan(self, index: int) -> PolarScan:
        """Scan `index`, rendered at each call; IndexError outside 0 to N − 1."""
        if not 0 <= index < len(self):
            raise IndexError(f'scan {index} of {len(self)}')
        azimuths, rotation_s = self.sensor.azimuths, self.sensor.rotation_s
        since_start_s = rotation_s * (index + np.arange(azimuths) / azimuths)
        power = self._model.render(
            self._traversal.reflectors_at(rotation_s * (index + 0.5), self.sensor.max_range_m),
            self._traversal.poses_at(since_start_s),
            np.random.default_rng([self.plan.seed, 3, index]),
            self.degradations[index],
            self._drift.at(rotation_s * (index + 0.5)),
        )
        return PolarScan(
            stamp_ns=int(self.stamps_ns[index]),
            power=power,
            azimuths_rad=self._model.azimuths_rad,
            range_resolution_m=self.sensor.range_resolution_m,
            azimuth_stamps_ns=self.plan.start_ns + np.rint(since_start_s * 1e9).astype(np.int64),
        )

    @property
    def poses(self) -> NDArray[np.float64]:
        """(N, 3) float64 true x, y in metres of the world and heading in radians at the scans' stamps."""
        return self._traversal.poses_at((self.stamps_ns - self.plan.start_ns) / 1e9)

    @property
    def trajectory(self) -> Trajectory:
        """True WGS-84 positions every 0.1 s, from before the first scan to after the last."""
        count = int(len(self) * self.sensor.rotation_s / _POSITION_PERIOD_S) + 4
        seconds = _POSITION_PERIOD_S * np.arange(-1, count, dtype=np.float64)
        poses = self._traversal.poses_at(seconds)
        enu = np.column_stack([poses[:, :2], np.zeros(len(poses))])
        return Trajectory(
            stamps_ns=self.plan.start_ns + np.rint(seconds * 1e9).astype(np.int64),
            positions=LocalFrame(self._origin).to_geodetic(enu),
            yaws_rad=wrap_angle(poses[:, 2]),
            geodetic=True,
        )
