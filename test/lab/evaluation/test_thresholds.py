"""Thresholds from validation drives."""

from __future__ import annotations

import numpy as np
import pytest

from offradar_ros.lab.evaluation.protocol import Validation
from offradar_ros.lab.evaluation.thresholds import thresholds_from


def test_thresholds_cover_the_validation_drives() -> None:
    found = thresholds_from([0.9, 1.3, np.inf, 1.1], Validation((1,), quantile=0.5, levels=4))
    assert found.static == pytest.approx((0.7, 0.85, 1.0, 1.15, 1.3))
    assert found.deployed == pytest.approx(1.1)
    assert thresholds_from([0.9, 1.3], Validation((1,)), given=1.2).deployed == 1.2
    assert thresholds_from([], Validation((1,))).static == ()
