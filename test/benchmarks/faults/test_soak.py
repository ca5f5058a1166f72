"""Memory that grows is told from memory that is noisy, and a scan that is neither answered nor counted is lost."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip('rclpy')

from faults.soak import Accounts, Tally, growth


def test_growth_is_a_slope_after_the_warm_up() -> None:
    seconds, noise = np.arange(120.0), np.random.default_rng(0).normal(0.0, 0.2, 120)
    warm = np.where(seconds < 40.0, 3.0 * (seconds - 40.0), 0.0)
    flat, leaking = 100.0 + warm + noise, 100.0 + warm + noise + seconds / 15.0
    assert abs(growth(list(zip(seconds.tolist(), flat.tolist(), strict=True)))[0]) < 0.2
    slope, rise = growth(list(zip(seconds.tolist(), leaking.tolist(), strict=True)))
    assert slope == pytest.approx(4.0, abs=0.2)
    assert rise == pytest.approx(4.0, abs=0.8)


def test_memory_that_falls_at_the_end_of_each_session_does_not_grow() -> None:
    """Whatever part of a session the measurement begins and ends with."""
    for phase in range(10):
        seconds = np.arange(60.0)
        saw = 160.0 + 0.4 * ((seconds + phase) % 10.0)
        assert abs(growth(list(zip(seconds.tolist(), saw.tolist(), strict=True)))[1]) < 0.5
        leaking = saw + seconds / 10.0
        slope, rise = growth(list(zip(seconds.tolist(), leaking.tolist(), strict=True)))
        assert slope == pytest.approx(6.0, abs=1.0)
        assert rise > 2.5


def test_what_is_lost_and_what_is_counted_twice() -> None:
    tallies = [
        Tally(sent=10, answered=6, twice=0, counted=4),
        Tally(sent=10, answered=6, twice=0, counted=3),
        Tally(sent=10, answered=8, twice=0, counted=3),
        Tally(sent=10, answered=6, twice=0, counted=3, unheard=1),
    ]
    assert [(tally.lost, tally.overcounted) for tally in tallies] == [(0, 0), (1, 0), (0, 1), (0, 0)]


def test_a_scan_before_the_beginning_that_is_reported_late_is_no_loss() -> None:
    """The third is overtaken after the encoder's last report, and the fourth is answered."""
    accounts = Accounts()

    def report(overtaken: int, at: int, *nodes: str) -> None:
        for node in nodes:
            accounts.report(node, {'scans.overtaken': str(overtaken)} if node == 'encoder' else {}, at)

    assert not accounts.are_complete
    accounts.sent += [1, 2]
    for stamp in (1, 2):
        accounts.answer(stamp, stamp + 5)
    report(0, 8, 'encoder', 'query')
    assert accounts.are_complete
    accounts.sent += [10, 20]
    assert not accounts.are_complete
    accounts.answer(20, 25)
    assert not accounts.are_complete
    report(1, 30, 'encoder')
    assert not accounts.are_complete
    report(1, 31, 'query')
    assert accounts.are_complete
    accounts.begin()
    accounts.sent += [40, 50]
    accounts.answer(50, 55)
    report(2, 60, 'encoder', 'query')
    assert accounts.tally() == Tally(sent=5, answered=4, twice=0, counted=1)
    assert (accounts.tally().lost, accounts.tally().overcounted) == (0, 0)
