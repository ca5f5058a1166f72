from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from offradar_ros.bags.reader import Bag
from offradar_ros.bags.sequence import BagSequence


def recorded(path: Path) -> list[tuple[str, int, bytes]]:
    with Bag(path) as bag:
        return [(message.topic, message.log_ns, message.cdr) for message in bag.messages()]


def test_the_same_seed_gives_the_same_bytes(done: Callable[..., str], tmp_path: Path) -> None:
    for name, seed in (('one', 4), ('again', 4), ('other', 5)):
        done('simulate', tmp_path / name, '--sessions', 2, '--scans', 4, '--seed', seed, '--degraded', 0.5)
    for session in ('session_1', 'session_2'):
        one, again, other = (recorded(tmp_path / name / session) for name in ('one', 'again', 'other'))
        assert one == again
        assert [m[:2] for m in one] == [m[:2] for m in other]
        assert one != other


def test_sessions_are_drives_of_one_route_a_day_apart(done: Callable[..., str], tmp_path: Path) -> None:
    said = done('simulate', tmp_path, '--sessions', 3, '--scans', 6)
    assert said == ''.join(f'{tmp_path / f"session_{n}"}: written\n' for n in (1, 2, 3))
    drives = [BagSequence(tmp_path / f'session_{n}') for n in (1, 2, 3)]
    assert [len(drive) for drive in drives] == [6, 6, 6]
    starts = [int(drive.stamps_ns[0]) for drive in drives]
    assert np.diff(starts).tolist() == [86400 * 10**9] * 2
    positions = [drive.trajectory.positions[:, :2] for drive in drives if drive.trajectory is not None]
    degrees_of_5_m = 5.0 / 60_000
    assert np.abs(positions[0] - positions[1]).max() < degrees_of_5_m
    assert np.abs(positions[0] - positions[2]).max() < degrees_of_5_m
    assert not np.array_equal(positions[0], positions[1])


def test_degraded_scans_are_as_many_as_asked_for(done: Callable[..., str], tmp_path: Path) -> None:
    for share in (0.0, 0.5):
        done('simulate', tmp_path / f'{share}', '--sessions', 1, '--scans', 8, '--degraded', share)
    clean, half = (BagSequence(tmp_path / f'{share}' / 'session_1') for share in (0.0, 0.5))
    assert sum(not np.array_equal(clean.scan(i).power, half.scan(i).power) for i in range(8)) == 4


def test_existing_drives_are_kept_unless_told(
    done: Callable[..., str], offradar: Callable[..., Any], refused: Callable[..., str], tmp_path: Path
) -> None:
    done('simulate', tmp_path, '--sessions', 1, '--scans', 2)
    assert 'exists already' in refused('simulate', tmp_path, '--sessions', 1, '--scans', 3)
    assert len(BagSequence(tmp_path / 'session_1')) == 2
    done('simulate', tmp_path, '--sessions', 1, '--scans', 3, '--overwrite')
    assert len(BagSequence(tmp_path / 'session_1')) == 3


def test_a_folder_that_cannot_be_written_is_refused(refused: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / 'file').write_text('in the way')
    assert 'cannot be written' in refused('simulate', tmp_path / 'file', '--scans', 2)
