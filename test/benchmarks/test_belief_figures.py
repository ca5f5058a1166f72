"""Figures of the position that a belief gives, and of its covariance."""

from __future__ import annotations

import numpy as np
import pytest
from belief_figures import Seen, position_figures

from offradar_ros.types import Localisation, LocalisationState

ON_MAP, UNSURE = LocalisationState.ON_MAP, LocalisationState.UNSURE


def seen(state: LocalisationState, error_m: tuple[float, float], covariance_m2: np.ndarray) -> Seen:
    truth_m = np.array([100.0, 50.0])
    found = Localisation(1, state, 0.99, 3, 0.98, truth_m + error_m, covariance_m2)
    return Seen.of(found, truth_m, 2.0, usable=True)


def test_errors_are_those_of_right_states_on_the_map() -> None:
    flat = np.diag([4.0, 4.0])
    drives = [
        [seen(ON_MAP, (3.0, 4.0), flat), seen(UNSURE, (9.0, 0.0), flat)],
        [seen(ON_MAP, (0.0, 1.0), flat), seen(ON_MAP, (60.0, 0.0), flat), seen(ON_MAP, (2.0, 0.0), flat)],
    ]
    found = position_figures(drives)
    assert found['error on the map, median m'] == 2.0
    assert found['90 % m'] == pytest.approx(np.quantile([5.0, 1.0, 2.0], 0.9))
    # 5 m are 2.5 standard deviations of 2 m: 6.25 > 5.99.
    assert found['in the 95 % ellipse'] == pytest.approx(2 / 3)


def test_true_covariances_hold_95_of_a_hundred() -> None:
    rng = np.random.default_rng(4)
    factor = np.array([[2.0, 0.0], [1.5, 0.5]])
    errors = rng.normal(size=(20_000, 2)) @ factor.T
    drive = [seen(ON_MAP, (float(x), float(y)), factor @ factor.T) for x, y in errors]
    assert position_figures([drive])['in the 95 % ellipse'] == pytest.approx(0.95, abs=0.006)
