"""Subsampling by distance, against a slow loop, and distance driven by a vehicle whose positions wander."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.recordings.spacing import path_length_m, subsample_by_distance


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0.0, 9.0), min_size=1, max_size=40), st.floats(0.5, 20.0))
def test_the_first_scan_of_each_stretch_is_kept(steps: list[float], spacing_m: float) -> None:
    driven_m = np.cumsum(steps)
    kept, stretches = [], set()
    for index, metres in enumerate(driven_m.tolist()):
        stretch = int(metres / spacing_m + 1e-9)
        if stretch not in stretches:
            kept.append(index)
        stretches.add(stretch)
    assert subsample_by_distance(driven_m, spacing_m).tolist() == kept


def test_the_mean_spacing_is_the_requested_one() -> None:
    driven_m = 2.0 * np.arange(501, dtype=np.float64)
    assert np.diff(driven_m[subsample_by_distance(driven_m, 5.0)]).mean() == pytest.approx(5.0)


def test_a_vehicle_that_stands_still_drives_no_distance() -> None:
    rng = np.random.default_rng(1)
    still = rng.uniform(-0.3, 0.3, (200, 2))
    line = np.column_stack([np.arange(100.0), np.zeros(100)])
    positions = np.concatenate([line, line[-1] + still, line[-1] + line])
    assert path_length_m(positions)[299] == pytest.approx(99.0, abs=1.0)
    assert path_length_m(positions)[-1] == pytest.approx(198.0, abs=2.0)
    assert len(path_length_m(np.empty((0, 2)))) == 0
