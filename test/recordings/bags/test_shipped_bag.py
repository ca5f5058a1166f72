"""The bag in bags/ is what its README says: small, and made by the simulator."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.route_sessions import session_plan
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.recordings.bags.check import check_bag
from offradar_ros.recordings.bags.sequence import BagSequence

BAG = Path(__file__).resolve().parents[3] / 'bags' / 'session_1'


def test_it_is_small_and_without_fault() -> None:
    assert sum(file.stat().st_size for file in BAG.iterdir()) < 2 * 2**20
    assert check_bag(BAG).problems == ()


def test_it_is_what_the_command_makes() -> None:
    plan = session_plan(0, scans=10, seed=1, degraded=0.0)
    made, shipped = SimulatedSequence(make_city(CityPlan(seed=1)), plan), BagSequence(BAG)
    np.testing.assert_array_equal(shipped.stamps_ns, made.stamps_ns)
    for index in range(10):
        # numpy may change the last bits of its random numbers from version to version.
        assert np.mean(shipped.scan(index).power == made.scan(index).power) > 0.99
    assert shipped.trajectory is not None
    inside = np.isin(made.trajectory.stamps_ns, shipped.trajectory.stamps_ns)
    np.testing.assert_allclose(shipped.trajectory.positions, made.trajectory.positions[inside], rtol=0, atol=1e-8)
