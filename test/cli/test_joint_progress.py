from __future__ import annotations

import pytest

from offradar_ros.cli.joint_progress import joint_progress, share_reporter


def test_parts_of_tasks_add_up() -> None:
    told: list[tuple[float, float]] = []
    with joint_progress(lambda done, total: told.append((done, total)), 3) as shares:
        for parts in (3, 2):
            report = share_reporter(shares)
            for done in range(parts):
                report(done + 1, parts)
    assert [total for _, total in told] == [3] * 7
    expected = [0, 1 / 3, 2 / 3, 1, 1.5, 2, 3]
    assert [done for done, _ in told] == pytest.approx(expected, abs=1e-6)
    # As people read it: whole tasks.
    assert [int(done) for done, _ in told] == [0, 0, 0, 1, 1, 2, 3]


def test_an_error_ends_it() -> None:
    with pytest.raises(KeyError), joint_progress(lambda _done, _total: None, 2):
        raise KeyError
