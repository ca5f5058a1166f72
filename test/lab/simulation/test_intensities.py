"""Simulated power against recorded power."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from offradar_ros.lab.simulation.city import CityPlan, District, make_city
from offradar_ros.lab.simulation.sensor import SimulatedSensor
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.radar.png import read_gray_png


def test_simulated_intensities_are_close_to_recorded_ones(real_data: Path) -> None:
    """Median and upper quantiles within 8 half decibels (4 dB), with scans of the recorded size."""
    file = sorted((real_data / 'oxford_tiny' / 'radar').glob('*.png'))[0]
    recorded = read_gray_png(file, max_bytes=2**24)[:, 11:]
    sensor = SimulatedSensor(range_bins=3768, range_resolution_m=0.0432)
    sequence = SimulatedSequence(
        make_city(CityPlan(seed=1, districts=(District.DENSE,))), SessionPlan(scans=40), sensor
    )
    simulated = np.stack([sequence.scan(i).power for i in range(0, 40, 10)])
    quantiles = [0.5, 0.75, 0.95, 0.99]
    np.testing.assert_allclose(np.quantile(simulated, quantiles), np.quantile(recorded, quantiles), atol=8)
