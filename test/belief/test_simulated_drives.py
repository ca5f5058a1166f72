"""Drives on and off a half-mapped grid of streets, with evidence drawn from its model and 35 % of scans without any."""

from __future__ import annotations

import numpy as np
import pytest
from belief_figures import GRACE_M, LIMIT, TOLERANCE_M, Seen
from simulated_evidence import STEP_M, Streets, localised

from offradar_ros.belief.place_belief import PlaceBelief
from offradar_ros.config import LocalisationConfig
from offradar_ros.types import LocalisationState

CONFIG = LocalisationConfig(independent_m=STEP_M)
"""The noise of each scan is drawn by itself."""
STREETS = Streets.drawn(6, 10.0, 0.5, seed=4)
FOUND = LocalisationState.ON_MAP


def drive(scans: int, odometry: bool, seed: int) -> list[Seen]:
    belief = PlaceBelief(CONFIG, TOLERANCE_M)
    belief.set_places(STREETS.positions_m, np.arange(len(STREETS.positions_m)))
    rng = np.random.default_rng(seed)
    return localised(belief, STREETS, scans, odometry, rng)


@pytest.mark.parametrize('odometry', [True, False])
def test_the_vehicle_is_found_within_a_few_scans_with_evidence(odometry: bool) -> None:
    counts = []
    for seed in range(80):
        seen = drive(24, odometry, seed)
        if all(scan.nearest_m <= 10.0 for scan in seen):
            first = next(index for index, scan in enumerate(seen) if scan.state is FOUND)
            assert not seen[first].wrong()
            counts.append(sum(scan.usable for scan in seen[: first + 1]))
    assert len(counts) > 15
    assert np.mean(np.array(counts) <= LIMIT) >= 0.9


@pytest.mark.parametrize('odometry', [True, False])
def test_states_are_right_on_and_off_the_map(odometry: bool) -> None:
    seen = drive(1500, odometry, seed=100)
    behind = round(GRACE_M / STEP_M)
    for index in range(behind, len(seen)):
        lately = seen[index - behind : index + 1]
        if all(scan.nearest_m > TOLERANCE_M for scan in lately):
            assert seen[index].state is not FOUND
        if all(scan.nearest_m <= 10.0 for scan in lately):
            assert seen[index].state is not LocalisationState.OFF_MAP
    wrong = [scan for scan in seen if scan.state is FOUND and scan.error_m > TOLERANCE_M]
    assert len(wrong) <= 0.005 * len(seen)
    assert sum(scan.state is LocalisationState.OFF_MAP for scan in seen) > 300
    assert sum(scan.state is FOUND for scan in seen) > 300
