"""Memory that grows is told from memory that is noisy, and a scan that is neither answered nor counted is lost."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip('rclpy')

from faults.soak import Tally, growth


def test_growth_is_a_slope_after_the_warm_up() -> None:
    seconds, noise = np.arange(120.0), np.random.default_rng(0).normal(0.0, 0.2, 120)
    warm = np.where(seconds < 40.0, 3.0 * (seconds - 40.0), 0.0)
    flat, leaking = 100.0 + warm + noise, 100.0 + warm + noise + seconds / 15.0
    assert abs(growth(list(zip(seconds.tolist(), flat.tolist(), strict=True)))[0]) < 0.2
    slope, rise = growth(list(zip(seconds.tolist(), leaking.tolist(), strict=True)))
    assert slope == pytest.approx(4.0, abs=0.2)
    assert rise == pytest.approx(4.0, abs=0.8)


def test_what_is_lost() -> None:
    assert Tally(sent=10, answered=6, twice=0, counted=4).lost == 0
    assert Tally(sent=10, answered=6, twice=0, counted=3).lost == 1
    assert Tally(sent=10, answered=8, twice=0, counted=3).lost == -1
    assert Tally(sent=10, answered=6, twice=0, counted=3, unheard=1).lost == 0
