"""From a world and a moving radar to one polar scan.

Each azimuth is one ray from the position of the radar at that moment. `scene` adds up the returns along it, `receiver`
applies the beam and the range response and records them with noise and speckle; `degradation` is applied in between.
All this is computed in cells of about 0.175 m, and interpolated to smaller range bins.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.degradation import Degradation, degraded_noise, degraded_signal, lost_rows
from offradar_ros.lab.simulation.drift import NO_DEVIATION, Deviation
from offradar_ros.lab.simulation.physics import NOMINAL_PHYSICS, RadarPhysics, linear_power
from offradar_ros.lab.simulation.receiver import Receiver
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.scene import Scene
from offradar_ros.lab.simulation.sensor import SimulatedSensor
from offradar_ros.lab.simulation.weather import CLEAR, Weather

_CELL_M = 0.175


class RadarModel:
    """Renders scans of one sensor in one weather."""

    def __init__(
        self,
        sensor: SimulatedSensor,
        physics: RadarPhysics = NOMINAL_PHYSICS,
        weather: Weather = CLEAR,
        ground_seed: int = 0,
    ) -> None:
        self.sensor = sensor
        bins_per_cell = max(1, round(_CELL_M / sensor.range_resolution_m))
        self._cell_m = bins_per_cell * sensor.range_resolution_m
        cells = -(-sensor.range_bins // bins_per_cell)
        self.azimuths_rad: NDArray[np.float64] = np.arange(sensor.azimuths, dtype=np.float64) * (
            2.0 * np.pi / sensor.azimuths
        )
        self._scene = Scene(sensor.azimuths, cells, self._cell_m, physics, weather, ground_seed)
        self._receiver = Receiver(sensor.azimuths, cells, self._cell_m, bins_per_cell, sensor.range_bins, physics)

    def render(
        self,
        reflectors: Reflectors,
        poses: NDArray[np.float64],
        rng: np.random.Generator,
        degradation: Degradation | None = None,
        deviation: Deviation = NO_DEVIATION,
    ) -> NDArray[np.uint8]:
        """(A, R) uint8 power seen from (A, 3) poses x, y, heading, one for each azimuth, because the radar moves.

        `degradation` does not change the noise and the speckle that are drawn from `rng`.
        """
        fault_rng = np.random.default_rng(rng.integers(2**63))
        near = reflectors.within(poses[len(poses) // 2, :2], self.sensor.max_range_m + 5.0)
        returned, diffuse = self._scene.power(near, poses)
        signal = (self._receiver.spread(returned) + diffuse) * deviation.sectors
        if degradation:
            signal = degraded_signal(signal, degradation, self._cell_m)
        noise = self._receiver.noise_with_streaks(signal, linear_power(deviation.noise_db))
        if degradation:
            noise = degraded_noise(noise, degradation, self._cell_m, fault_rng)
        power = self._receiver.recorded(signal, noise, rng, linear_power(deviation.gain_db))
        power[lost_rows(len(power), degradation, fault_rng)] = 0
        return power
